// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/exponential.h"
#include "baker/math/quadrature.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace envbake::lighting {

// The weight of a prefiltered texel, N = V = R, is a function of mu = d.w alone, the cosine between
// the texel's direction and the light's:
//
//     K(mu) = D(mu) max(0, mu),   D the distribution of normals at n.h = cos(theta / 2),
//
// up to a constant factor; 1 / inverse_norm is the integral of K over the sphere. Both lobes below
// have the members that the walk and the kernels ask for.

/// Taylor coefficients of K about mu, orders 0 to 4 (derivatives over factorials).
template <class Real>
struct WeightTerms {
    Real k0, k1, k2, k3, k4;
};

/// What a lobe is at some distance from its axis.
template <class Real>
struct WeightNearby {
    Real density;          ///< D
    Real envelope;         ///< of what D changes by over l
    Real inverse_length2;  ///< 1 / l^2
};

/// GGX, [Walter07] eq. 33, over its peak:
///
///     D = t^2,  t = 1 / (1 + k u),  u = 1 - mu,  k = (1 - A) / (2 A),  A = alpha^2
///
/// norm = 2 pi (k - ln(1 + k)) / k^2, and pi at alpha = 1. Over its peak: in float the fourth
/// derivative would overflow otherwise.
template <class S>
struct GgxWeight {
    S k = 0;
    S inverse_norm = 1;

    static GgxWeight of(double alpha) {
        const double A = alpha * alpha;
        const double k = (1 - A) / (2 * A);
        // By its series where the difference would cancel.
        const double ratio =
            k < 1e-2 ? 0.5 - k * (1.0 / 3 - k * (1.0 / 4 - k * (1.0 / 5 - k * (1.0 / 6 - k / 7))))
                     : (k - std::log1p(k)) / (k * k);
        return {static_cast<S>(k), static_cast<S>(1 / (2 * std::numbers::pi * ratio))};
    }

    /// `cosine` and `slope` stand for max(0, mu) and its derivative.
    template <class Real>
    [[gnu::always_inline]] WeightTerms<Real> terms(const Real& u, const Real& cosine,
                                                   const Real& slope) const {
        const Real t = S(1) / (u * k + S(1));
        const Real y = t * k;
        const Real d0 = t * t, d1 = d0 * y, d2 = d1 * y, d3 = d2 * y;
        const Real y_cosine = y * cosine;
        return {d0 * cosine, d0 * (slope + S(2) * y_cosine), d1 * (S(2) * slope + S(3) * y_cosine),
                d2 * (S(3) * slope + S(4) * y_cosine), d3 * (S(4) * slope + S(5) * y_cosine)};
    }

    /// By the square of the distance from the axis, as a chord: 2 u.
    template <class Real>
    WeightNearby<Real> nearby(const Real& distance2) const {
        const Real t = S(1) / (distance2 * (k / 2) + S(1));
        return {t * t, t * t, t * (k / 2)};
    }
    /// Taylor coefficients of D about any place between these distances, at most: (n + 1) t^2 y^n.
    template <class Real>
    WeightTerms<Real> bounds(const Real& closest2, const Real& /*furthest2*/) const {
        const Real t = S(1) / (closest2 * (k / 2) + S(1)), y = t * k;
        const Real d0 = t * t, d1 = d0 * y, d2 = d1 * y, d3 = d2 * y;
        return {d0, d1 * S(2), d2 * S(3), d3 * S(4), d3 * y * S(5)};
    }
    S density_at_horizon() const { return 1 / ((1 + k) * (1 + k)); }
    /// How far the lobe's core reaches, as a chord.
    double core() const { return std::sqrt(2 / std::max(static_cast<double>(k), 1e-3)); }

    /// A block of this extent serves the coarse front: (extent / l)^2.
    static constexpr double kFrontExtent2 = 1;
    /// Measured: the errors of one source, and of the lobe's core, beside those of GGX.
    static constexpr double kCurvature = 1;
    static constexpr double kCore = 1;
    /// See part_error_bound().
    static constexpr double kPartBound = 1.5, kCutBound = 0.25;
    /// Measured: what sums over many sources come to.
    static constexpr float kCoreSum = 0.06f, kCurvatureSum = 1, kMissedSum = 0.025f;
    /// The tail falls so slowly that no source is too far to matter.
    static constexpr bool kTailEnds = false;
    /// Interpolation from 8 Chebyshev points over +-half_width, relative to `near`: a pole at
    /// distance l is missed by 4 n rho^-n.
    S missed(const WeightNearby<S>& near, S half_width) const {
        const S x =
            near.inverse_length2 > 0 ? 1 / (std::sqrt(near.inverse_length2) * half_width) : S(1e3);
        const S rho = x + std::sqrt(1 + x * x);
        const S rho2 = rho * rho, rho4 = rho2 * rho2;
        return near.density * 32 / (rho4 * rho4);
    }
};

/// Beckmann, [Walter07] eq. 25, without the factor 1 / (pi A):
///
///     D = exp(-(i - 1) / A) i^2,  i = 2 / (1 + mu) = 1 / cos^2(theta / 2)
///
/// Its Taylor coefficients in mu are (-i / 2)^n L_n^(1)(i / A), generalised Laguerre polynomials,
/// by their generating function, [Abramowitz64] 22.9.15. With x = tan^2(theta / 2), norm = 4 pi *
/// integral over x in [0, 1] of exp(-x / A) (1 - x) / (1 + x).
template <class S>
struct BeckmannWeight {
    S inverse_A = 1;
    S alpha = 1;
    S inverse_norm = 1;

    static BeckmannWeight of(double alpha) {
        const double a = alpha * alpha;
        // exp(-40) of the weight is left out; 48 nodes are exact to rounding (measured).
        const double last = std::min(1.0, 40 * a);
        const Quadrature rule = gauss_legendre(48);
        double integral = 0;
        for (std::size_t i = 0; i < rule.nodes.size(); ++i) {
            const double x = last * (1 + rule.nodes[i]) / 2;
            integral += rule.weights[i] * std::exp(-x / a) * (1 - x) / (1 + x);
        }
        const double norm = 2 * std::numbers::pi * last * integral;
        return {static_cast<S>(1 / a), static_cast<S>(alpha), static_cast<S>(1 / norm)};
    }

    template <class Real>
    [[gnu::always_inline]] WeightTerms<Real> terms(const Real& u, const Real& cosine,
                                                   const Real& slope) const {
        const Real most = Real{} + kMost;
        const Real v = u < most ? u : most;
        const Real i = S(2) / (S(2) - v);
        const Real d0 = exponential(v * i * (S(-0.5) * inverse_A)) * i * i;
        const Real x = i * inverse_A, y = i * S(-0.5);
        const Real d1 = d0 * y, d2 = d1 * y, d3 = d2 * y, d4 = d3 * y;
        const Real l1 = S(2) - x;
        const Real l2 = S(3) + x * (x * S(0.5) - S(3));
        const Real l3 = S(4) + x * (x * (S(2) - x * S(1.0 / 6)) - S(6));
        const Real l4 = S(5) + x * (x * (S(5) + x * (x * S(1.0 / 24) - S(5.0 / 6))) - S(10));
        return {d0 * cosine, d0 * slope + d1 * l1 * cosine, d1 * l1 * slope + d2 * l2 * cosine,
                d2 * l2 * slope + d3 * l3 * cosine, d3 * l3 * slope + d4 * l4 * cosine};
    }

    template <class Real>
    WeightNearby<Real> nearby(const Real& distance2) const {
        const Real most = Real{} + kMost, half = distance2 * S(0.5);
        const Real u = half < most ? half : most;
        const Real i = S(2) / (S(2) - u);
        const Real root = exponential(u * i * (S(-0.25) * inverse_A)) * i;
        // A Gaussian's derivatives are Hermite functions, which its square root bounds: Cramer's
        // inequality, [Abramowitz64] 22.14.17. Its width is sqrt(2) alpha in 2 tan(theta / 2).
        return {root * root, root, i * i * (S(0.5) * inverse_A)};
    }
    /// Taylor coefficients of D about any place between these distances, at most: those of the
    /// Laguerre polynomials made positive, (i / 2)^n L_n^(1)(-i / A) D.
    template <class Real>
    WeightTerms<Real> bounds(const Real& closest2, const Real& furthest2) const {
        const Real most = Real{} + kMost, half = furthest2 * S(0.5);
        const Real i = S(2) / (S(2) - (half < most ? half : most));
        const Real d0 = nearby(closest2).density;
        const Real x = i * inverse_A, y = i * S(0.5);
        const Real d1 = d0 * y, d2 = d1 * y, d3 = d2 * y, d4 = d3 * y;
        return {d0, d1 * (x + S(2)), d2 * (x * (x * S(0.5) + S(3)) + S(3)),
                d3 * (x * (x * (x * S(1.0 / 6) + S(2)) + S(6)) + S(4)),
                d4 * (x * (x * (x * (x * S(1.0 / 24) + S(5.0 / 6)) + S(5)) + S(10)) + S(5))};
    }
    S density_at_horizon() const { return 4 * std::exp(-inverse_A); }
    double core() const { return 2 * static_cast<double>(alpha); }

    static constexpr double kFrontExtent2 = 4;
    static constexpr double kCurvature = 0.03;
    static constexpr double kCore = 0.015;
    static constexpr double kPartBound = 0.05, kCutBound = 0.08;
    static constexpr float kCoreSum = 0.02f, kCurvatureSum = 0.7f, kMissedSum = 0.02f;
    static constexpr bool kTailEnds = true;
    /// A Gaussian of width sqrt(2) alpha is missed by some (half_width / width)^8.
    S missed(const WeightNearby<S>& near, S half_width) const {
        const S x = half_width / alpha;
        const S x2 = x * x, x4 = x2 * x2;
        return near.density * S(1e-4) * x4 * x4;
    }

  private:
    static constexpr S kMost = S(1.9);  ///< of u: behind the horizon, where the cosine is 0
};

}  // namespace envbake::lighting
