// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

namespace envbake::format {

/// Reads an unsigned integer at any alignment. The host is little-endian (layout.h asserts it).
template <class T>
T load(const std::byte* at) noexcept {
    T value;
    std::memcpy(&value, at, sizeof value);
    return value;
}

template <class T>
void store(std::byte* at, T value) noexcept {
    std::memcpy(at, &value, sizeof value);
}

/// Where the fields of the header stand, in bytes.
namespace header_field {
inline constexpr std::size_t kMajorAt = 8;            // u16
inline constexpr std::size_t kMinorAt = 10;           // u16
inline constexpr std::size_t kArrayCountAt = 12;      // u32
inline constexpr std::size_t kFileSizeAt = 16;        // u64
inline constexpr std::size_t kTableOffsetAt = 24;     // u64
inline constexpr std::size_t kTableSizeAt = 32;       // u64
inline constexpr std::size_t kTableChecksumAt = 40;   // u64
inline constexpr std::size_t kReservedAt = 48;        // u64, 0
inline constexpr std::size_t kHeaderChecksumAt = 56;  // u64, of bytes 0 .. 55
}  // namespace header_field

/// Where the fields of a table entry stand, in bytes.
namespace entry_field {
inline constexpr std::size_t kNameOffsetAt = 0;  // u32, from the start of the table
inline constexpr std::size_t kNameSizeAt = 4;    // u16
inline constexpr std::size_t kTypeAt = 6;        // u8
inline constexpr std::size_t kCodecAt = 7;       // u8
inline constexpr std::size_t kRankAt = 8;        // u8, then seven bytes of 0
inline constexpr std::size_t kReservedAt = 9;
inline constexpr std::size_t kShapeAt = 16;       // u64[6]
inline constexpr std::size_t kOffsetAt = 64;      // u64
inline constexpr std::size_t kStoredSizeAt = 72;  // u64
inline constexpr std::size_t kSizeAt = 80;        // u64
inline constexpr std::size_t kChecksumAt = 88;    // u64
}  // namespace entry_field

constexpr std::uint64_t align_up(std::uint64_t offset, std::uint64_t alignment) noexcept {
    return (offset + alignment - 1) / alignment * alignment;
}

}  // namespace envbake::format
