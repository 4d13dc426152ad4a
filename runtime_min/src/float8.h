// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/runtime/half.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace envbake::runtime {

inline constexpr std::size_t kLanes = 8;

/// The bits of an f16, as a type of its own.
struct HalfBits {
    std::uint16_t bits;
};

inline float to_float(float value) {
    return value;
}
inline float to_float(HalfBits value) {
    return half_to_float(value.bits);
}
inline float to_float(std::uint8_t value) {
    return value;
}
inline float to_float(std::uint16_t value) {
    return value;
}

// Eight floats: the vector extension of GCC and clang, lowered to what the target of the build has
// (SSE2, AVX, NEON), or plain loops. Arithmetic is by element and in the same order in both.
#if defined(__clang__) || (defined(__GNUC__) && __GNUC__ >= 12)
using Float4 = float __attribute__((vector_size(16)));
#if defined(__AVX__)
using Float8 = float __attribute__((vector_size(32)));
#else
/// Two vectors of the target's width: GCC 12 makes slow work of wider ones than that.
struct Float8 {
    Float4 low{}, high{};
    Float8& operator+=(const Float8& other) {
        low += other.low;
        high += other.high;
        return *this;
    }
    friend Float8 operator*(const Float8& a, const Float8& b) {
        return {a.low * b.low, a.high * b.high};
    }
};
#endif

namespace detail {

using U8x16 = std::uint8_t __attribute__((vector_size(16)));
using U16x8 = std::uint16_t __attribute__((vector_size(16)));
using I32x4 = std::int32_t __attribute__((vector_size(16)));

template <class Vector, class T>
inline Vector copied(const T* from) {
    Vector v;
    std::memcpy(&v, from, sizeof v);
    return v;
}
/// Unsigned words as 32-bit integers, the lower four and the upper: interleaved with 0, one
/// instruction each.
inline I32x4 lower(U16x8 words) {
    return reinterpret_cast<I32x4>(
        __builtin_shufflevector(words, U16x8{}, 0, 8, 1, 9, 2, 10, 3, 11));
}
inline I32x4 upper(U16x8 words) {
    return reinterpret_cast<I32x4>(
        __builtin_shufflevector(words, U16x8{}, 4, 12, 5, 13, 6, 14, 7, 15));
}
inline Float8 joined(Float4 low, Float4 high) {
#if defined(__AVX__)
    return __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7);
#else
    return {low, high};
#endif
}
inline Float8 to_floats(U16x8 words) {
    return joined(__builtin_convertvector(lower(words), Float4),
                  __builtin_convertvector(upper(words), Float4));
}
/// half_to_float() of every lane: the exponent's bias is mended by a product, which is exact, for
/// subnormals too.
inline Float4 halves_to_floats(I32x4 half) {
    const I32x4 magnitude = half & 0x7fff;
    const Float4 scaled = reinterpret_cast<Float4>(magnitude << 13) * 0x1p112f;
    const I32x4 not_finite = (magnitude > 0x7bff) & 0x7f800000;
    const I32x4 sign = (half & 0x8000) << 16;
    return reinterpret_cast<Float4>(reinterpret_cast<I32x4>(scaled) | sign | not_finite);
}

}  // namespace detail

/// Eight elements, at any alignment.
inline Float8 load8(const float* from) {
    return detail::joined(detail::copied<Float4>(from), detail::copied<Float4>(from + 4));
}
inline Float8 load8(const std::uint16_t* from) {
    return detail::to_floats(detail::copied<detail::U16x8>(from));
}
inline Float8 load8(const std::uint8_t* from) {
    using U64x2 = std::uint64_t __attribute__((vector_size(16)));
    std::uint64_t eight = 0;
    std::memcpy(&eight, from, 8);
    const auto bytes = reinterpret_cast<detail::U8x16>(U64x2{eight, 0});
    return detail::to_floats(reinterpret_cast<detail::U16x8>(__builtin_shufflevector(
        bytes, detail::U8x16{}, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23)));
}
inline Float8 load8(const HalfBits* from) {
    const auto words = detail::copied<detail::U16x8>(from);
    return detail::joined(detail::halves_to_floats(detail::lower(words)),
                          detail::halves_to_floats(detail::upper(words)));
}

inline Float4 folded(const Float8& v) {
#if defined(__AVX__)
    return __builtin_shufflevector(v, v, 0, 1, 2, 3) + __builtin_shufflevector(v, v, 4, 5, 6, 7);
#else
    return v.low + v.high;
#endif
}
/// The sum of the lanes of each of four.
inline std::array<float, 4> sums(const Float8* v) {
    const Float4 a = folded(v[0]), b = folded(v[1]), c = folded(v[2]), d = folded(v[3]);
    const Float4 ab =
        __builtin_shufflevector(a, b, 0, 4, 1, 5) + __builtin_shufflevector(a, b, 2, 6, 3, 7);
    const Float4 cd =
        __builtin_shufflevector(c, d, 0, 4, 1, 5) + __builtin_shufflevector(c, d, 2, 6, 3, 7);
    const Float4 all =
        __builtin_shufflevector(ab, cd, 0, 1, 4, 5) + __builtin_shufflevector(ab, cd, 2, 3, 6, 7);
    return {all[0], all[1], all[2], all[3]};
}
#else
struct Float8 {
    std::array<float, kLanes> v{};
    Float8& operator+=(const Float8& other) {
        for (std::size_t i = 0; i < kLanes; ++i) v[i] += other.v[i];
        return *this;
    }
    friend Float8 operator*(const Float8& a, const Float8& b) {
        Float8 product;
        for (std::size_t i = 0; i < kLanes; ++i) product.v[i] = a.v[i] * b.v[i];
        return product;
    }
};
template <class T>
inline Float8 load8(const T* from) {
    Float8 loaded;
    for (std::size_t i = 0; i < kLanes; ++i) loaded.v[i] = to_float(from[i]);
    return loaded;
}
inline std::array<float, 4> sums(const Float8* v) {
    std::array<float, 4> result;
    for (std::size_t k = 0; k < 4; ++k) {
        const std::array<float, kLanes>& x = v[k].v;
        result[k] = ((x[0] + x[4]) + (x[2] + x[6])) + ((x[1] + x[5]) + (x[3] + x[7]));
    }
    return result;
}
#endif

}  // namespace envbake::runtime
