// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/runtime/half.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>

// Eight floats, in one of three forms that the flags of the build choose: AVX2 with FMA and F16C
// (-march=x86-64-v3 and up), the vector extension of GCC and clang (SSE2, NEON), or plain loops,
// which -DENVBAKE_PLAIN_LOOPS asks for. Their results agree to rounding.
#if !defined(ENVBAKE_PLAIN_LOOPS) && (defined(__clang__) || (defined(__GNUC__) && __GNUC__ >= 12))
#define ENVBAKE_VECTORS
#if defined(__AVX2__) && defined(__FMA__) && defined(__F16C__)
#define ENVBAKE_AVX2
#include <immintrin.h>
#endif
#endif

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

#if defined(ENVBAKE_VECTORS)
using Float4 = float __attribute__((vector_size(16)));

#if defined(ENVBAKE_AVX2)
using Float8 = __m256;

inline void multiply_add(const Float8& a, const Float8& b, Float8& sum) {
    sum = _mm256_fmadd_ps(a, b, sum);
}

inline Float8 all_lanes(float value) {
    return _mm256_set1_ps(value);
}
/// The value, then zeros.
inline Float8 first_lane(float value) {
    return _mm256_zextps128_ps256(_mm_set_ss(value));
}

/// Eight elements, at any alignment.
inline Float8 load8(const float* from) {
    return _mm256_loadu_ps(from);
}
inline Float8 load8(const HalfBits* from) {
    return _mm256_cvtph_ps(_mm_loadu_si128(reinterpret_cast<const __m128i*>(from)));
}
inline Float8 load8(const std::uint8_t* from) {
    const __m128i bytes = _mm_loadl_epi64(reinterpret_cast<const __m128i*>(from));
    return _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(bytes));
}

/// The sum of the lanes of each of four.
inline Float4 sums(const Float8* v) {
    const Float8 ab = _mm256_add_ps(_mm256_unpacklo_ps(v[0], v[1]), _mm256_unpackhi_ps(v[0], v[1]));
    const Float8 cd = _mm256_add_ps(_mm256_unpacklo_ps(v[2], v[3]), _mm256_unpackhi_ps(v[2], v[3]));
    const Float8 all = _mm256_add_ps(_mm256_shuffle_ps(ab, cd, _MM_SHUFFLE(1, 0, 1, 0)),
                                     _mm256_shuffle_ps(ab, cd, _MM_SHUFFLE(3, 2, 3, 2)));
    return _mm256_castps256_ps128(all) + _mm256_extractf128_ps(all, 1);
}
#else
/// Two vectors of the target's width: GCC 12 makes slow work of wider ones than that.
struct Float8 {
    Float4 low{}, high{};
};

inline void multiply_add(const Float8& a, const Float8& b, Float8& sum) {
    sum.low += a.low * b.low;
    sum.high += a.high * b.high;
}

inline Float8 all_lanes(float value) {
    return {Float4{} + value, Float4{} + value};
}
/// The value, then zeros.
inline Float8 first_lane(float value) {
    return {Float4{value, 0, 0, 0}, Float4{}};
}

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
inline Float8 to_floats(U16x8 words) {
    return {__builtin_convertvector(lower(words), Float4),
            __builtin_convertvector(upper(words), Float4)};
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
    return {detail::copied<Float4>(from), detail::copied<Float4>(from + 4)};
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
    return {detail::halves_to_floats(detail::lower(words)),
            detail::halves_to_floats(detail::upper(words))};
}

/// The sum of the lanes of each of four.
inline Float4 sums(const Float8* v) {
    const Float4 a = v[0].low + v[0].high, b = v[1].low + v[1].high;
    const Float4 c = v[2].low + v[2].high, d = v[3].low + v[3].high;
    const Float4 ab =
        __builtin_shufflevector(a, b, 0, 4, 1, 5) + __builtin_shufflevector(a, b, 2, 6, 3, 7);
    const Float4 cd =
        __builtin_shufflevector(c, d, 0, 4, 1, 5) + __builtin_shufflevector(c, d, 2, 6, 3, 7);
    return __builtin_shufflevector(ab, cd, 0, 1, 4, 5) +
           __builtin_shufflevector(ab, cd, 2, 3, 6, 7);
}
#endif

/// Four colours, the sums of their three channels' lanes.
inline void store_colours(const Float8 (&channels)[3][4], std::array<float, 3>* colours) {
    const Float4 r = sums(channels[0]), g = sums(channels[1]), b = sums(channels[2]);
    const Float4 rg = __builtin_shufflevector(r, g, 0, 4, 1, 5);             // r0 g0 r1 g1
    const Float4 rg_next = __builtin_shufflevector(r, g, 2, 6, 3, 7);        // r2 g2 r3 g3
    const Float4 bg = __builtin_shufflevector(rg, b, 3, 5, 3, 5);            // g1 b1
    const Float4 first = __builtin_shufflevector(rg, b, 0, 1, 4, 2);         // r0 g0 b0 r1
    const Float4 second = __builtin_shufflevector(bg, rg_next, 0, 1, 4, 5);  // g1 b1 r2 g2
    const Float4 third = __builtin_shufflevector(rg_next, b, 6, 2, 3, 7);    // b2 r3 g3 b3
    std::memcpy(colours->data(), &first, sizeof first);
    std::memcpy(colours->data() + 4, &second, sizeof second);
    std::memcpy(colours->data() + 8, &third, sizeof third);
}
#else
/// Of four numbers: by element, what vectors have.
struct Float4 {
    std::array<float, 4> v{};

    float& operator[](std::size_t i) { return v[i]; }
    float operator[](std::size_t i) const { return v[i]; }
    Float4& operator+=(const Float4& other) {
        for (std::size_t i = 0; i < 4; ++i) v[i] += other.v[i];
        return *this;
    }
    friend Float4 operator+(Float4 a, const Float4& b) { return a += b; }
    friend Float4 operator-(const Float4& a, const Float4& b) { return a + -1.0f * b; }
    friend Float4 operator*(Float4 a, const Float4& b) {
        for (std::size_t i = 0; i < 4; ++i) a.v[i] *= b.v[i];
        return a;
    }
    friend Float4 operator*(float a, const Float4& b) { return Float4{a, a, a, a} * b; }
};

struct Float8 {
    std::array<float, kLanes> v{};
};

inline Float8 all_lanes(float value) {
    Float8 all;
    all.v.fill(value);
    return all;
}
inline Float8 first_lane(float value) {
    return {{value}};
}

inline void multiply_add(const Float8& a, const Float8& b, Float8& sum) {
    for (std::size_t i = 0; i < kLanes; ++i) sum.v[i] += a.v[i] * b.v[i];
}

template <class T>
inline Float8 load8(const T* from) {
    Float8 loaded;
    for (std::size_t i = 0; i < kLanes; ++i) loaded.v[i] = to_float(from[i]);
    return loaded;
}

/// Four colours, the sums of their three channels' lanes.
inline void store_colours(const Float8 (&channels)[3][4], std::array<float, 3>* colours) {
    for (std::size_t k = 0; k < 4; ++k)
        for (std::size_t c = 0; c < 3; ++c) {
            const std::array<float, kLanes>& x = channels[c][k].v;
            colours[k][c] = ((x[0] + x[4]) + (x[2] + x[6])) + ((x[1] + x[5]) + (x[3] + x[7]));
        }
}
#endif

}  // namespace envbake::runtime
