// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace envbake::format {

static_assert(std::endian::native == std::endian::little,
              "arrays are little-endian and used in place: this host would need a copying reader");

// The bundle, byte for byte: docs/format.md. Multi-byte integers are little-endian.
//
//     header (64 bytes) | arrays, each on a 64-byte boundary | table: entries, then names

inline constexpr std::array<std::uint8_t, 8> kMagic{0x89, 'E', 'N', 'V', 'B', 0x0d, 0x0a, 0x1a};
inline constexpr std::uint16_t kMajor = 1;
inline constexpr std::uint16_t kMinor = 0;
inline constexpr std::size_t kHeaderSize = 64;
inline constexpr std::size_t kEntrySize = 96;
inline constexpr std::size_t kAlignment = 64;
inline constexpr std::size_t kMaxRank = 6;
inline constexpr std::size_t kMaxNameSize = 255;
inline constexpr std::string_view kMetadataName = "metadata";  ///< u8 [n]: the JSON document, UTF-8
/// u32 [2], I and N: the file is part I of N of a bake.
inline constexpr std::string_view kShardName = "shard";

/// What an element is. The numbers are those of the file.
enum class ElementType : std::uint8_t {
    F32 = 0,
    F16 = 1,
    U8 = 2,
    U16 = 3,
    U32 = 4,
    I8 = 5,
    I16 = 6
};
inline constexpr std::uint8_t kElementTypeCount = 7;

/// How an array is stored. The numbers are those of the file.
enum class Codec : std::uint8_t { None = 0, Zstd = 1 };
inline constexpr std::uint8_t kCodecCount = 2;

constexpr std::size_t element_size(ElementType type) {
    constexpr std::array<std::uint8_t, kElementTypeCount> sizes{4, 2, 1, 2, 4, 1, 2};
    return sizes[static_cast<std::size_t>(type)];
}

/// "f32", "u16", ...
constexpr std::string_view to_string(ElementType type) {
    constexpr std::array<std::string_view, kElementTypeCount> names{"f32", "f16", "u8", "u16",
                                                                    "u32", "i8",  "i16"};
    return names[static_cast<std::size_t>(type)];
}

constexpr std::string_view to_string(Codec codec) {
    return codec == Codec::None ? "none" : "zstd";
}

/// The C++ type that holds an element; f16 travels as its bits (runtime/half.h converts).
struct Half {
    std::uint16_t bits;
};
template <class T>
inline constexpr ElementType kElementTypeOf =
    [] { static_assert(sizeof(T) == 0, "not an element type"); }();
template <>
inline constexpr ElementType kElementTypeOf<float> = ElementType::F32;
template <>
inline constexpr ElementType kElementTypeOf<Half> = ElementType::F16;
template <>
inline constexpr ElementType kElementTypeOf<std::uint8_t> = ElementType::U8;
template <>
inline constexpr ElementType kElementTypeOf<std::uint16_t> = ElementType::U16;
template <>
inline constexpr ElementType kElementTypeOf<std::uint32_t> = ElementType::U32;
template <>
inline constexpr ElementType kElementTypeOf<std::int8_t> = ElementType::I8;
template <>
inline constexpr ElementType kElementTypeOf<std::int16_t> = ElementType::I16;

/// One line of the table.
struct ArrayInfo {
    std::string_view name;
    ElementType type = ElementType::F32;
    Codec codec = Codec::None;
    std::uint8_t rank = 0;  ///< 1 .. 6
    std::array<std::uint64_t, kMaxRank>
        shape{};                    ///< elements along each axis, slowest first; then 0
    std::uint64_t offset = 0;       ///< bytes from the start of the file, 64-aligned
    std::uint64_t stored_size = 0;  ///< bytes in the file
    std::uint64_t size = 0;         ///< bytes decoded: product of shape x element size
    std::uint64_t checksum = 0;     ///< XXH3-64 of the stored bytes

    std::uint64_t element_count() const { return size / element_size(type); }
};

/// 1 to 255 characters of a-z 0-9 _ - . in parts joined by single slashes: "environment/mips/3".
constexpr bool is_valid_name(std::string_view name) {
    if (name.empty() || name.size() > kMaxNameSize) return false;
    char previous = '/';
    for (char c : name) {
        const bool plain =
            (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-' || c == '.';
        if (!plain && c != '/') return false;
        if (c == '/' && previous == '/') return false;
        previous = c;
    }
    return previous != '/';
}

}  // namespace envbake::format
