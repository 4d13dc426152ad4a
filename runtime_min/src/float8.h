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
// (SSE2, AVX, NEON), or plain loops. Arithmetic is by element and rounds alike in both.
#if defined(__GNUC__)
using Float8 = float __attribute__((vector_size(32)));

namespace detail {
template <class Vector, class T>
inline Vector copied(const T* from) {
    Vector v;
    std::memcpy(&v, from, sizeof v);
    return v;
}
}  // namespace detail

/// Elements of any type, at any alignment.
template <class T>
inline Float8 load8(const T* from) {
    using Elements __attribute__((vector_size(8 * sizeof(T)))) = T;
    return __builtin_convertvector(detail::copied<Elements>(from), Float8);
}
inline Float8 load8(const float* from) {
    return detail::copied<Float8>(from);
}
/// half_to_float() of every lane: the exponent's bias is mended by a product, which is exact, for
/// subnormals too.
inline Float8 load8(const HalfBits* from) {
    using U16x8 = std::uint16_t __attribute__((vector_size(16)));
    using U32x8 = std::uint32_t __attribute__((vector_size(32)));
    const U32x8 half = __builtin_convertvector(detail::copied<U16x8>(from), U32x8);
    const U32x8 magnitude = half & 0x7fffu;
    const U32x8 shifted = magnitude << 13;
    const Float8 scaled = detail::copied<Float8>(&shifted) * 0x1p112f;
    U32x8 bits = detail::copied<U32x8>(&scaled);
    const U32x8 not_finite = __builtin_convertvector(magnitude > 0x7bffu, U32x8);
    bits |= ((half & 0x8000u) << 16) | (not_finite & 0x7f800000u);
    return detail::copied<Float8>(&bits);
}
inline float lane(const Float8& v, std::size_t i) {
    return v[i];
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
inline float lane(const Float8& v, std::size_t i) {
    return v.v[i];
}
#endif

/// The sum of the lanes, pairwise.
inline float sum(const Float8& v) {
    return ((lane(v, 0) + lane(v, 4)) + (lane(v, 2) + lane(v, 6))) +
           ((lane(v, 1) + lane(v, 5)) + (lane(v, 3) + lane(v, 7)));
}

}  // namespace envbake::runtime
