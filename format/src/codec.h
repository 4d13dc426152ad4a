// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/format/error.h"

#include <cstddef>
#include <span>

#ifdef ENVBAKE_WITH_ZSTD
#include <zstd.h>
#endif

namespace envbake::format {

/// Decodes one zstd frame that must fill `out` exactly.
inline Errc zstd_decode([[maybe_unused]] std::span<const std::byte> stored,
                        [[maybe_unused]] std::span<std::byte> out) noexcept {
#ifdef ENVBAKE_WITH_ZSTD
    const std::size_t size = ZSTD_decompress(out.data(), out.size(), stored.data(), stored.size());
    return ZSTD_isError(size) || size != out.size() ? Errc::ArrayDecode : Errc::None;
#else
    return Errc::ArrayCodec;
#endif
}

}  // namespace envbake::format
