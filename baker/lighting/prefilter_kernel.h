// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/lighting/lobe_weight.h"

#include <cmath>
#include <type_traits>

namespace envbake::lighting {

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

/// The same in float or double; no copy where they are what is asked for.
template <class S>
decltype(auto) in_precision(const ClusterMoments<float>& from) {
    if constexpr (std::is_same_v<S, float>) {
        return (from);
    } else {
        ClusterMoments<S> m;
        for (int i = 0; i < 3; ++i) {
            m.centre[i] = static_cast<S>(from.centre[i]);
            m.flux[i] = static_cast<S>(from.flux[i]);
            for (int j = 0; j < 3; ++j) m.first[i][j] = static_cast<S>(from.first[i][j]);
            for (int j = 0; j < 6; ++j) m.second[i][j] = static_cast<S>(from.second[i][j]);
        }
        m.variance = static_cast<S>(from.variance);
        return m;
    }
}

/// A texel or a part of one: uniform radiance over a parallelogram.
template <class S>
struct PatchMoments {
    S centre[3];  ///< less the origin of the tile's directions: a small patch keeps its digits
    S variance;
    S flux[3];
    S half_a[3];  ///< half sides
    S half_b[3];
    S slope_a, slope_b;  ///< centre . half_a, centre . half_b: all but 0
    S bulge_a, bulge_b;  ///< -2/15 |half_a|^2, -2/15 |half_b|^2
    S radial;            ///< (|half_a|^4 + |half_b|^4) / 45
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

/// Adds the cluster's part of a texel looking along d, times the lobe's norm, to sum[kChannels].
///
/// Taylor series of the weight in mu about d.centre: exact moments to second order; in the third
/// and fourth the cluster is taken for a uniform square of the same variance (averaged over its
/// orientation: E3 = -1.2 mu V T, E4 = 2.1 T^2, T = V (1 - mu^2)).
///
///   u is |d - c|^2 / 2 + V, which is 1 - d.c without the cancellation.
template <bool kHorizon, int kChannels, class Weight, class Real, class S>
inline void add_cluster(const Weight& weight, const ClusterMoments<S>& n, const Real& dx,
                        const Real& dy, const Real& dz, Real* sum) {
    const Real x = dx - n.centre[0], y = dy - n.centre[1], z = dz - n.centre[2];
    const Real u = (x * x + y * y + z * z) * S(0.5) + n.variance;
    const Real mu = S(1) - u;
    Real cosine = mu, slope = Real{} + S(1);
    if constexpr (kHorizon) {
        const Cosine<Real> c = cosine_over_interval<Real, S>(mu, std::sqrt(S(3) * n.variance));
        cosine = c.mean;
        slope = c.slope;
    }
    const WeightTerms<Real> k = weight.template terms<Real>(u, cosine, slope);
    const Real spread = u * (S(2) - u) * n.variance;  // T
    const Real zeroth =
        k.k0 + spread * (k.k4 * spread * S(2.1) - mu * k.k3 * (S(1.2) * n.variance));
    const Real xx = dx * dx, yy = dy * dy, zz = dz * dz, xy = dx * dy, xz = dx * dz, yz = dy * dz;
    for (int c = 0; c < kChannels; ++c) {
        const S* m = n.first[c];
        const S* q = n.second[c];
        sum[c] +=
            zeroth * n.flux[c] + k.k1 * (dx * m[0] + dy * m[1] + dz * m[2]) +
            k.k2 * (xx * q[0] + yy * q[1] + zz * q[2] + (xy * q[3] + xz * q[4] + yz * q[5]) * S(2));
    }
}

/// The same for a patch, with the moments of its own parallelogram bent onto the sphere: with
/// r = V - |s half_a + t half_b|^2 / 2 the offset along the centre, E3 = 3 mu E[(p s + q t)^2 r]. d
/// is counted from the origin of the patch's centre.
template <bool kHorizon, int kChannels, class Weight, class Real, class S>
inline void add_patch(const Weight& weight, const PatchMoments<S>& n, const Real& dx,
                      const Real& dy, const Real& dz, Real* sum) {
    const Real x = dx - n.centre[0], y = dy - n.centre[1], z = dz - n.centre[2];
    const Real u = (x * x + y * y + z * z) * S(0.5) + n.variance;
    const Real mu = S(1) - u;
    const Real p = x * n.half_a[0] + y * n.half_a[1] + z * n.half_a[2] + n.slope_a;
    const Real q = x * n.half_b[0] + y * n.half_b[1] + z * n.half_b[2] + n.slope_b;
    Real cosine = mu, slope = Real{} + S(1);
    if constexpr (kHorizon) {
        const Cosine<Real> c = cosine_over_parallelogram<Real, S>(mu, p > Real{} ? p : -p,
                                                                  q > Real{} ? q : -q, S(1e-9));
        cosine = c.mean;
        slope = c.slope;
    }
    const WeightTerms<Real> k = weight.template terms<Real>(u, cosine, slope);
    const Real p2 = p * p, q2 = q * q;
    const Real second = (p2 + q2) * S(1.0 / 3) + n.radial;
    const Real third = mu * (p2 * n.bulge_a + q2 * n.bulge_b);
    const Real fourth = (p2 * p2 + q2 * q2) * S(0.2) + p2 * q2 * S(2.0 / 3);
    const Real total = k.k0 + k.k2 * second + k.k3 * third + k.k4 * fourth;
    for (int c = 0; c < kChannels; ++c) sum[c] += total * n.flux[c];
}

}  // namespace envbake::lighting
