// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/simd.h"

#include <bit>
#include <cmath>

namespace envbake {

inline float exponential(float x) {
    return std::exp(x > -87.0f ? x : -87.0f);
}
inline double exponential(double x) {
    return std::exp(x);
}

/// e^x by lanes, for x <= 0. Relative error below 2e-7 down to -87, where it stays at e^-87.
inline Float16 exponential(const Float16& x) {
    using Int16 = int __attribute__((vector_size(64)));
    const Float16 least = Float16{} - 87.0f;
    const Float16 bounded = x > least ? x : least;
    // x = n ln 2 + f: the sum with 1.5 2^23 rounds to an integer and leaves it in the low bits.
    const Float16 shifted = bounded * 1.44269504f + 12582912.0f;
    const Float16 n = shifted - 12582912.0f;
    const Float16 f = (bounded - n * 0.693359375f) + n * 2.12194440e-4f;
    Float16 series = f * (1.0f / 5040) + 1.0f / 720;
    series = series * f + 1.0f / 120;
    series = series * f + 1.0f / 24;
    series = series * f + 1.0f / 6;
    series = series * f + 0.5f;
    series = series * f + 1.0f;
    series = series * f + 1.0f;
    const Int16 power = (std::bit_cast<Int16>(shifted) << 23) + (127 << 23);
    return series * std::bit_cast<Float16>(power);
}

inline Double8 exponential(const Double8& x) {
    Double8 result = x;
    for (int i = 0; i < kDoubleLanes; ++i) result[i] = std::exp(x[i]);
    return result;
}

}  // namespace envbake
