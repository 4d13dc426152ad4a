// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <numbers>

namespace envbake::lighting {

/// The weight of a prefiltered texel, N = V = R, as a function of mu = d.w alone:
///
///     D(h) max(0, n.l) ~ t^2 max(0, mu),  t = 1 / (A + b u),  u = 1 - mu,  A = alpha^2,  b = (1 -
///     A) / 2
///
/// GGX with n.h = cos(theta / 2) and the constant factor A / pi left out; `norm` is the integral of
/// the above over the sphere, 2 pi / b^2 (x - ln(1 + x)), x = b / A, and pi at alpha = 1.
template <class S>
struct GgxWeight {
    S A = 1;
    S b = 0;
    S inverse_norm = 1;

    static GgxWeight of(double alpha) {
        const double a = alpha * alpha;
        const double half = (1 - a) / 2;
        const double x = half / a;
        // x - ln(1 + x) over x^2, by its series where the difference would cancel.
        const double ratio =
            x < 1e-2 ? 0.5 - x * (1.0 / 3 - x * (1.0 / 4 - x * (1.0 / 5 - x * (1.0 / 6 - x / 7))))
                     : (x - std::log1p(x)) / (x * x);
        const double norm = 2 * std::numbers::pi / (a * a) * ratio;
        return {static_cast<S>(a), static_cast<S>(half), static_cast<S>(1 / norm)};
    }
};

/// Many texels as one: per channel the moments of radiance about a common centre. Central second
/// moments are kept whole, the radial part too.
template <class S>
struct ClusterMoments {
    S centre[3];     ///< mean direction, weighted by all channels, shorter than 1
    S variance;      ///< V = (1 - |centre|^2) / 2
    S flux[3];       ///< integral of L
    S first[3][3];   ///< [channel] integral of L (w - centre)
    S second[3][6];  ///< [channel] integral of L (w - centre)(w - centre)^T: xx yy zz xy xz yz
};

/// Part of a texel: uniform radiance over a parallelogram.
template <class S>
struct PatchMoments {
    S centre[3];
    S variance;
    S flux[3];
    S half_a[3];  ///< half sides
    S half_b[3];
};

template <class Real>
inline Real positive_part(const Real& x) {
    const Real zero{};
    return x > zero ? x : zero;
}

/// max(0, mu) and its slope, averaged over the extent of a source.
template <class Real>
struct Cosine {
    Real mean;
    Real slope;
};

/// ... over mu uniform within +- s.
template <class Real, class S>
inline Cosine<Real> cosine_over_interval(const Real& mu, S s) {
    const Real rise = positive_part<Real>(mu + s) - positive_part<Real>(mu - s);  // 0 .. 2 s
    return {rise * rise / (S(4) * s) + positive_part<Real>(mu - s), rise / (S(2) * s)};
}

/// ... over mu + x p + y q, x and y uniform in [-1, 1]: the box spline of the two sides, a third
/// difference of cubes. p, q >= 0. The shorter side is kept above 2 % of the longer, where the
/// difference still has digits; that moves the mean by less than 4e-5 of the longer side.
template <class Real, class S>
inline Cosine<Real> cosine_over_parallelogram(const Real& mu, Real p, Real q, S least) {
    const Real shortest = (p > q ? p : q) * S(0.02) + least;
    p = p > shortest ? p : shortest;
    q = q > shortest ? q : shortest;
    const Real a = positive_part<Real>(mu + p + q), b = positive_part<Real>(mu + p - q);
    const Real c = positive_part<Real>(mu - p + q), d = positive_part<Real>(mu - p - q);
    const Real inverse = S(1) / (p * q);
    const Real inside{(a * a * a - b * b * b - c * c * c + d * d * d) * (S(1) / S(24)) * inverse};
    const Real slope{(a * a - b * b - c * c + d * d) * (S(1) / S(8)) * inverse};
    // All above the horizon: the difference of cubes is mu itself, but for its rounding.
    const Real zero{};
    return {d > zero ? mu : inside, d > zero ? zero + S(1) : slope};
}

/// Adds the cluster's part of a texel looking along d, times `norm`, to sum[3].
///
/// Taylor series of the weight in mu about d.centre: exact moments to second order; in the third
/// and fourth the cluster is taken for a uniform square of the same variance (averaged over its
/// orientation: E3 = -1.2 mu V T, E4 = 2.1 T^2, T = V (1 - mu^2)).
///
///   u is |d - c|^2 / 2 + V, which is 1 - d.c without the cancellation.
template <bool kHorizon, class Real, class S>
inline void add_cluster(const GgxWeight<S>& k, const ClusterMoments<S>& n, const Real& dx,
                        const Real& dy, const Real& dz, Real* sum) {
    const Real x = dx - n.centre[0], y = dy - n.centre[1], z = dz - n.centre[2];
    const Real u = (x * x + y * y + z * z) * S(0.5) + n.variance;
    const Real mu = S(1) - u;
    const Real t = S(1) / (u * k.b + k.A);
    const Real t2 = t * t;
    const Real yy = t * k.b;
    Real cosine = mu, slope = Real{} + S(1);
    if constexpr (kHorizon) {
        const Cosine<Real> c = cosine_over_interval<Real, S>(mu, std::sqrt(S(3) * n.variance));
        cosine = c.mean;
        slope = c.slope;
    }
    const Real y_cosine = yy * cosine;
    const Real spread = u * (S(2) - u) * n.variance;  // T
    const Real higher = yy * yy * spread *
                        (spread * yy * (y_cosine * S(5) + slope * S(4)) * S(2.1) -
                         mu * (y_cosine * S(4) + slope * S(3)) * (S(1.2) * n.variance));
    const Real zeroth = t2 * (cosine + higher);
    const Real linear = t2 * (slope + S(2) * y_cosine);
    const Real quadratic = t2 * yy * (S(2) * slope + S(3) * y_cosine);
    const Real xx = dx * dx, y2 = dy * dy, zz = dz * dz, xy = dx * dy, xz = dx * dz, yz = dy * dz;
    for (int c = 0; c < 3; ++c) {
        const S* m = n.first[c];
        const S* q = n.second[c];
        sum[c] += zeroth * n.flux[c] + linear * (dx * m[0] + dy * m[1] + dz * m[2]) +
                  quadratic * (xx * q[0] + y2 * q[1] + zz * q[2] +
                               (xy * q[3] + xz * q[4] + yz * q[5]) * S(2));
    }
}

/// The same for a patch, whose second and fourth moments are those of its own parallelogram.
template <bool kHorizon, class Real, class S>
inline void add_patch(const GgxWeight<S>& k, const PatchMoments<S>& n, const Real& dx,
                      const Real& dy, const Real& dz, Real* sum) {
    const Real x = dx - n.centre[0], y = dy - n.centre[1], z = dz - n.centre[2];
    const Real u = (x * x + y * y + z * z) * S(0.5) + n.variance;
    const Real mu = S(1) - u;
    const Real t = S(1) / (u * k.b + k.A);
    const Real yy = t * k.b;
    const Real p = dx * n.half_a[0] + dy * n.half_a[1] + dz * n.half_a[2];
    const Real q = dx * n.half_b[0] + dy * n.half_b[1] + dz * n.half_b[2];
    Real cosine = mu, slope = Real{} + S(1);
    if constexpr (kHorizon) {
        const Cosine<Real> c = cosine_over_parallelogram<Real, S>(mu, p > Real{} ? p : -p,
                                                                  q > Real{} ? q : -q, S(1e-9));
        cosine = c.mean;
        slope = c.slope;
    }
    const Real y_cosine = yy * cosine;
    const Real p2 = p * p, q2 = q * q;
    const Real second = (p2 + q2) * S(1.0 / 3) + S(0.4) * n.variance * n.variance;
    const Real third = mu * (p2 + q2) * (S(-0.4) * n.variance);
    const Real fourth = (p2 * p2 + q2 * q2) * S(0.2) + p2 * q2 * S(2.0 / 3);
    const Real weight = t * t *
                        (cosine + yy * ((S(2) * slope + S(3) * y_cosine) * second +
                                        yy * ((S(3) * slope + S(4) * y_cosine) * third +
                                              yy * (S(4) * slope + S(5) * y_cosine) * fourth)));
    for (int c = 0; c < 3; ++c) sum[c] += weight * n.flux[c];
}

}  // namespace envbake::lighting
