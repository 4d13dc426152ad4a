// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/runtime/sh.h"

#include <array>
#include <cstddef>
#include <optional>
#include <span>

namespace envbake::sh {

/// matrix[row][column], of column vectors: w' = matrix * w.
using Matrix3 = std::array<std::array<double, 3>, 3>;

/// Components in glTF's order; (0, 0, 0, 1) turns nothing, (0, sin a/2, 0, cos a/2) by a about +Y.
struct Quaternion {
    double x = 0, y = 0, z = 0, w = 1;
};

/// Turns coefficients as `matrix` turns directions: light that came from w comes from matrix * w.
///
///     L'(w) = L(M^-1 w),   l'_lm = sum_k R^l_mk l_lk,   R^l_mk = integral of Y_lm(M w) Y_lk(w) dw
///
/// One orthogonal matrix a band, made from the matrix and from nothing else: to go on turning,
/// multiply matrices or quaternions and build again, which costs microseconds. Coefficients that
/// are turned again and again lose their norm to rounding, and these matrices have no product here.
///
/// To shade a turned object with light that stays, turn the light by the object's transpose.
///
/// A plain value of 11 kB. Nothing here allocates or throws; const functions are thread-safe.
/// Source: [Ivanic96] with the corrections of [Ivanic98].
class Rotation {
  public:
    /// How far M^T M may be from the identity, each element: float matrices and drifted ones pass,
    /// scaled and sheared ones do not.
    static constexpr double kTolerance = 1e-4;

    /// Turns nothing, exactly.
    Rotation() noexcept;

    /// The nearest orthogonal matrix (polar decomposition) stands for one that is within
    /// kTolerance of it. Mirrors, det M = -1, are turned as they should be: the formulas hold for
    /// them too. Empty: further off, or not finite.
    ///
    ///   bands   1 .. 10, clamped: fewer are built sooner
    [[nodiscard]] static std::optional<Rotation> from_matrix(const Matrix3& matrix,
                                                             int bands = kMaxBundleBands) noexcept;

    /// Of any length but 0: it is normalised. Empty: of length 0 (below 1e-100), or not finite.
    [[nodiscard]] static std::optional<Rotation> from_quaternion(
        const Quaternion& q, int bands = kMaxBundleBands) noexcept;

    [[nodiscard]] int bands() const noexcept { return bands_; }

    /// R^l_mk; 0 <= l < bands(), |m|, |k| <= l. Orthogonal to 1e-14, right to 1e-13.
    [[nodiscard]] double element(int l, int m, int k) const noexcept {
        return elements_[slot(l, m, k)];
    }

    /// Turns [n * n, channels], n <= bands(): environment/sh, a row of diffuse transport. Sums are
    /// of doubles and rounded once: a float is within 6e-8 of the right one plus 1e-13 of the
    /// band's norm. `to` may be `from`. False, and nothing written: the spans differ in size, or
    /// are not channels times a square n * n <= bands()^2.
    [[nodiscard]] bool apply(std::span<const float> from, std::span<float> to,
                             int channels = 1) const noexcept;
    [[nodiscard]] bool apply(std::span<const double> from, std::span<double> to,
                             int channels = 1) const noexcept;

  private:
    /// Bands follow each other; 1 + 9 + 25 + ... of them before l.
    static constexpr std::size_t slot(int l, int m, int k) noexcept {
        const int before = l * (4 * l * l - 1) / 3;
        return static_cast<std::size_t>(before + (m + l) * (2 * l + 1) + (k + l));
    }

    void build(const Matrix3& orthogonal, int bands) noexcept;

    static constexpr int kElements =
        kMaxBundleBands * (4 * kMaxBundleBands * kMaxBundleBands - 1) / 3;

    int bands_ = kMaxBundleBands;
    std::array<double, kElements> elements_{};
};

}  // namespace envbake::sh
