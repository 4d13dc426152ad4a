// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "float8.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <utility>

// Vectors as wide as the build's registers: 16 floats with AVX-512 (-march=x86-64-v4 and up), 8
// with AVX2, 4 without either and in plain loops. Where a lane is a vertex no sum over lanes is
// left. Results of every width agree to rounding.

namespace envbake::runtime {

#if defined(ENVBAKE_VECTORS)
#if defined(ENVBAKE_AVX2) && defined(__AVX512F__)
inline constexpr std::size_t kWidth = 16;
#elif defined(ENVBAKE_AVX2)
inline constexpr std::size_t kWidth = 8;
#else
inline constexpr std::size_t kWidth = 4;
#endif
using Floats = float __attribute__((vector_size(4 * kWidth)));
using Words = std::uint32_t __attribute__((vector_size(4 * kWidth)));

/// Words below 2^31, which convert as signed numbers do: in one instruction.
inline Floats to_floats(const Words& words) {
    using Ints = std::int32_t __attribute__((vector_size(4 * kWidth)));
    return __builtin_convertvector(reinterpret_cast<Ints>(words), Floats);
}

inline Floats in_every_lane(float value) {
    return value - Floats{};  // 0 + value would have to be computed: it differs for -0
}

namespace detail {

template <class Vector, int... kIndices>
inline auto shuffled(const Vector& a, const Vector& b, std::integer_sequence<int, kIndices...>) {
    return __builtin_shufflevector(a, b, kIndices...);
}

/// 16 bytes in every four lanes, `stride` bytes apart.
template <std::size_t kWords = kWidth>
inline auto load_fours(const std::byte* from, std::size_t stride) {
    if constexpr (kWords == 4) {
        std::uint32_t __attribute__((vector_size(16))) four;
        std::memcpy(&four, from, sizeof four);
        return four;
    } else {
        return shuffled(load_fours<kWords / 2>(from, stride),
                        load_fours<kWords / 2>(from + kWords / 8 * stride, stride),
                        std::make_integer_sequence<int, int{kWords}>{});
    }
}

/// In every four lanes those numbered: 0 to 3 are of a's four, 4 to 7 of b's.
template <int... kNumbers, class Vector, int... kLane>
inline Vector in_fours(const Vector& a, const Vector& b, std::integer_sequence<int, kLane...>) {
    constexpr int kOf[4] = {kNumbers...};
    return __builtin_shufflevector(
        a, b, (kLane / 4 * 4 + kOf[kLane % 4] % 4 + kOf[kLane % 4] / 4 * int{kWidth})...);
}
template <int... kNumbers, class Vector>
inline Vector in_fours(const Vector& a, const Vector& b) {
    return in_fours<kNumbers...>(a, b, std::make_integer_sequence<int, int{kWidth}>{});
}

template <int kFirst>
inline void store_four(const Floats& v, float* to) {
    const Float4 four = __builtin_shufflevector(v, v, kFirst, kFirst + 1, kFirst + 2, kFirst + 3);
    std::memcpy(to, &four, sizeof four);
}

template <int... i>
inline void store_in_turns(const Floats& first, const Floats& second, const Floats& third,
                           float* to, std::integer_sequence<int, i...>) {
    ((store_four<4 * i>(first, to + 12 * i), store_four<4 * i>(second, to + 12 * i + 4),
      store_four<4 * i>(third, to + 12 * i + 8)),
     ...);
}

}  // namespace detail

/// columns[w]: word w of kWidth rows, `stride` bytes apart. Reads 16 bytes of each.
inline void load_columns(const std::byte* rows, std::size_t stride, Words (&columns)[4]) {
    using detail::in_fours;
    Words of[4];  // of[k]: rows k, k + 4 and so on
    for (std::size_t k = 0; k < 4; ++k) of[k] = detail::load_fours(rows + k * stride, 4 * stride);
    const Words even = in_fours<0, 4, 1, 5>(of[0], of[2]), odd = in_fours<0, 4, 1, 5>(of[1], of[3]);
    const Words even_next = in_fours<2, 6, 3, 7>(of[0], of[2]),
                odd_next = in_fours<2, 6, 3, 7>(of[1], of[3]);
    columns[0] = in_fours<0, 4, 1, 5>(even, odd);
    columns[1] = in_fours<2, 6, 3, 7>(even, odd);
    columns[2] = in_fours<0, 4, 1, 5>(even_next, odd_next);
    columns[3] = in_fours<2, 6, 3, 7>(even_next, odd_next);
}

/// kWidth colours, one after the other.
inline void store_columns(const Floats& r, const Floats& g, const Floats& b, float* to) {
    using detail::in_fours;
    const Floats rg = in_fours<0, 4, 1, 5>(r, g), rg_next = in_fours<2, 6, 3, 7>(r, g);
    const Floats gb = in_fours<0, 4, 1, 5>(g, b), gb_next = in_fours<2, 6, 3, 7>(g, b);
    const Floats br = in_fours<0, 4, 1, 5>(b, r), br_next = in_fours<2, 6, 3, 7>(b, r);
    const Floats first = in_fours<0, 1, 4, 7>(rg, br);            // r0 g0 b0 r1
    const Floats second = in_fours<2, 3, 4, 5>(gb, rg_next);      // g1 b1 r2 g2
    const Floats third = in_fours<0, 3, 6, 7>(br_next, gb_next);  // b2 r3 g3 b3
    detail::store_in_turns(first, second, third, to, std::make_integer_sequence<int, kWidth / 4>{});
}

#else
inline constexpr std::size_t kWidth = 4;
using Floats = Float4;
struct Words {
    std::array<std::uint32_t, 4> v{};

    friend Words operator&(Words a, std::uint32_t mask) {
        for (std::uint32_t& word : a.v) word &= mask;
        return a;
    }
    friend Words operator>>(Words a, std::uint32_t bits) {
        for (std::uint32_t& word : a.v) word >>= bits;
        return a;
    }
};

inline Floats in_every_lane(float value) {
    return {value, value, value, value};
}
inline Floats to_floats(const Words& words) {
    Floats floats;
    for (std::size_t i = 0; i < 4; ++i) floats[i] = static_cast<float>(words.v[i]);
    return floats;
}

/// columns[w]: word w of kWidth rows, `stride` bytes apart. Reads 16 bytes of each.
inline void load_columns(const std::byte* rows, std::size_t stride, Words (&columns)[4]) {
    for (std::size_t k = 0; k < 4; ++k)
        for (std::size_t w = 0; w < 4; ++w)
            std::memcpy(&columns[w].v[k], rows + k * stride + 4 * w, 4);
}

/// kWidth colours, one after the other.
inline void store_columns(const Floats& r, const Floats& g, const Floats& b, float* to) {
    for (std::size_t k = 0; k < 4; ++k) {
        to[3 * k] = r[k];
        to[3 * k + 1] = g[k];
        to[3 * k + 2] = b[k];
    }
}
#endif

}  // namespace envbake::runtime
