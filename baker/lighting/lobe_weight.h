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

/// Taylor coefficients of D about mu, orders 0 to 4 (derivatives over factorials).
template <class Real>
struct DensityTerms {
    Real d0, d1, d2, d3, d4;
};

/// What a lobe is at some distance from its axis.
template <class Real>
struct WeightNearby {
    Real density;          ///< D
    Real envelope;         ///< of what D changes by over l
    Real inverse_length2;  ///< 1 / l^2
};

/// How much of a source interpolation between 8 x 8 and between 4 x 4 Chebyshev nodes misses.
template <class S>
struct Missed {
    S fine, coarse;
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

    /// u = 1 - mu. The coefficients are (n + 1) t^2 (k t)^n.
    template <class Real>
    [[gnu::always_inline]] DensityTerms<Real> terms(const Real& u) const {
        const Real t = S(1) / (u * k + S(1));
        const Real y = t * k;
        const Real y0 = t * t, y1 = y0 * y, y2 = y1 * y, y3 = y2 * y;
        return {y0, S(2) * y1, S(3) * y2, S(4) * y3, S(5) * (y3 * y)};
    }

    /// By the square of the distance from the axis, as a chord: 2 u.
    template <class Real>
    WeightNearby<Real> nearby(const Real& distance2) const {
        const Real t = S(1) / (distance2 * (k / 2) + S(1));
        return {t * t, t * t, t * (k / 2)};
    }
    /// Taylor coefficients of D about any place between these distances, at most.
    template <class Real>
    DensityTerms<Real> bounds(const Real& closest2, const Real& /*furthest2*/) const {
        return terms(Real(closest2 * S(0.5)));
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
    /// Within +-half_width, relative to `near`: a pole at distance l is missed by 4 n rho^-n, with
    /// rho = x + sqrt(1 + x^2), x = l / half_width; rho^2 is within 3 % of 4 x^2 + 2 for x > 1.
    Missed<S> missed(const WeightNearby<S>& near, S half_width) const {
        const S inverse_x2 = near.inverse_length2 * (half_width * half_width);
        const S inverse_rho2 = inverse_x2 / (4 + 2 * inverse_x2);
        const S inverse_rho4 = inverse_rho2 * inverse_rho2;
        return {near.density * 32 * inverse_rho4 * inverse_rho4, near.density * 16 * inverse_rho4};
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
    [[gnu::always_inline]] DensityTerms<Real> terms(const Real& u) const {
        const Real most = Real{} + kMost;
        const Real v = u < most ? u : most;
        const Real i = S(2) / (S(2) - v);
        const Real d0 = exponential(v * i * (S(-0.5) * inverse_A)) * i * i;
        const Real x = i * inverse_A, y = i * S(-0.5);
        const Real d1 = d0 * y, d2 = d1 * y, d3 = d2 * y, d4 = d3 * y;
        return {d0, d1 * (S(2) - x), d2 * (S(3) + x * (x * S(0.5) - S(3))),
                d3 * (S(4) + x * (x * (S(2) - x * S(1.0 / 6)) - S(6))),
                d4 * (S(5) + x * (x * (S(5) + x * (x * S(1.0 / 24) - S(5.0 / 6))) - S(10)))};
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
    DensityTerms<Real> bounds(const Real& closest2, const Real& furthest2) const {
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
    /// A Gaussian of width sqrt(2) alpha is missed by some (half_width / width)^n.
    Missed<S> missed(const WeightNearby<S>& near, S half_width) const {
        const S x = half_width / alpha;
        const S x2 = x * x, x4 = x2 * x2;
        return {near.density * S(1e-4) * x4 * x4, near.density * S(0.05) * x4};
    }

  private:
    static constexpr S kMost = S(1.9);  ///< of u: behind the horizon, where the cosine is 0
};

}  // namespace envbake::lighting
