// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace envbake::sh {

/// The real, orthonormal spherical harmonics without Condon-Shortley phase, polar axis +Z:
///
///     Y_lm(w) = K_lm P_l^|m|(z) * { sqrt2 cos(m phi), 1, sqrt2 sin(|m| phi) }   for m > 0, = 0, < 0
///     Y_1 = sqrt(3 / 4 pi) (y, z, x)
///
/// A size is given in bands: n bands are degrees 0 .. n - 1 and n^2 coefficients.

inline constexpr int kMaxBundleBands = 10;

constexpr int coeff_count(int bands) { return bands * bands; }
constexpr int index(int l, int m) { return l * l + l + m; }

}  // namespace envbake::sh
