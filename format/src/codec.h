// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/format/error.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

#ifdef ENVBAKE_WITH_ZSTD
#include <zstd.h>
#endif

namespace envbake::format {

inline constexpr std::uint64_t kAlwaysDecoded = 8u << 20, kMostRatio = 16;

/// What the compressed arrays of a file of `file_size` bytes may decode to, in all: a small file
/// cannot ask for much memory.
constexpr std::uint64_t max_decoded_size(std::uint64_t file_size) noexcept {
    return std::max(kAlwaysDecoded, file_size * kMostRatio);
}
/// The other way round: 0 where any file may.
constexpr std::uint64_t smallest_file_for(std::uint64_t decoded_size) noexcept {
    return decoded_size <= kAlwaysDecoded ? 0 : (decoded_size + kMostRatio - 1) / kMostRatio;
}

/// Whether the bytes begin with a zstd frame (no skippable one) whose header states `size` as that
/// of its content. False where the build lacks zstd.
inline bool zstd_states_size([[maybe_unused]] std::span<const std::byte> stored,
                             [[maybe_unused]] std::uint64_t size) noexcept {
#ifdef ENVBAKE_WITH_ZSTD
    constexpr unsigned char kFrameMagic[4] = {0x28, 0xb5, 0x2f, 0xfd};  // RFC 8878, 3.1.1
    if (stored.size() < sizeof(kFrameMagic) ||
        std::memcmp(stored.data(), kFrameMagic, sizeof(kFrameMagic)) != 0)
        return false;
    const unsigned long long stated = ZSTD_getFrameContentSize(stored.data(), stored.size());
    return stated != ZSTD_CONTENTSIZE_ERROR && stated != ZSTD_CONTENTSIZE_UNKNOWN && stated == size;
#else
    return false;
#endif
}

/// Decodes exactly one zstd frame, without bytes behind it, that states and has the size of `out`.
inline Errc zstd_decode([[maybe_unused]] std::span<const std::byte> stored,
                        [[maybe_unused]] std::span<std::byte> out) noexcept {
#ifdef ENVBAKE_WITH_ZSTD
    if (!zstd_states_size(stored, out.size()) ||
        ZSTD_findFrameCompressedSize(stored.data(), stored.size()) != stored.size())
        return Errc::ArrayDecode;
    const std::size_t size = ZSTD_decompress(out.data(), out.size(), stored.data(), stored.size());
    return ZSTD_isError(size) || size != out.size() ? Errc::ArrayDecode : Errc::None;
#else
    return Errc::ArrayCodec;
#endif
}

}  // namespace envbake::format
