// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/lighting/lobe_weight.h"
#include "baker/lighting/source_view.h"

#include <algorithm>

namespace envbake::lighting {

// How far one source's value can be from the integral over it, at most: for a source of flux 1, as
// a multiple of the lobe's peak. Distances are chords from the source's centre; `reach` is how far
// any part of the source is from it.

/// What is known of a cluster: nothing but its moments up to the second order. Of the channel that
/// is worst.
template <class S>
struct ClusterSpread {
    S variance;  ///< V of its centre
    S reach;
    S deviation;  ///< at least the root of the largest eigenvalue of E[(w - c)(w - c)^T]
    S offset;     ///< at least |E[w - c]|
};

/// s = d.(w - c) is the argument of the Taylor series about mu = d.c: |s| <= S, E[s^2] <= q. The
/// series is right up to the second order; of the third and the fourth its remainder has
///
///     |K3| (S q + 1.2 V T) + sup |K4| (S^2 q + 2.1 T^2),  T = V (1 - mu^2),
///
/// the second parts for what the kernel takes them to be. Where the horizon may cut the cluster,
/// max(0, mu + s) and its model are each within [0, P], P = 2.25 reach, and differ on average by no
/// more than max(sqrt(q) / 2, sqrt(3 V) / 4) + |E s| [Scarf58].
template <class Weight, class Real, class S>
Real cluster_error_bound(const Weight& weight, const ClusterSpread<S>& of, const Real& distance2,
                         const Real& mu) {
    const Real one = Real{} + S(1), zero{};
    const Real distance = square_root(distance2);
    const Real closest = larger<Real>(zero, distance - of.reach), furthest = distance + of.reach;
    // Taylor coefficients of D, in absolute value, anywhere on the cluster.
    const WeightTerms<Real> d = weight.bounds(Real(closest * closest), Real(furthest * furthest));

    const Real perp = distance < one ? distance : one;
    const S radial = S(0.6) * of.reach * of.reach;
    const Real s = perp * of.reach + radial;
    const Real root_q = perp * of.deviation + radial;
    const Real q = root_q * root_q;
    const Real t = (perp * perp + S(2) * of.variance) * of.variance;
    const Real smooth = (d.k3 + d.k2) * (s * q + t * (S(1.2) * of.variance)) +
                        (d.k4 + d.k3) * (s * s * q + t * t * S(2.1));

    const S most = S(2.25) * of.reach, half = S(0.25) * std::sqrt(S(3) * of.variance);
    const Real kink = larger<Real>(root_q * S(0.5), zero + half) + of.offset;
    const S v2 = of.variance * of.variance;
    const Real cut = d.k0 * kink + d.k1 * (root_q * most + q) + d.k2 * (q * (S(2) * most)) +
                     (d.k2 + d.k3 * most) * (S(1.2) * most * v2) +
                     (d.k3 + d.k4 * most) * (S(2.1) * v2);
    const Real edge = zero + S(1.25) * of.reach;
    return mu > edge ? smooth : (mu < -edge ? zero : smooth + cut);
}

/// A part of a texel is known whole: uniform, and no parallelogram only by its taper and its bend.
/// By dimension its error is
///
///     D (x^6 + x^2 (taper + bend) h (1 / l + 1 / 2) + x^2 h^2),  x = h / l,
///
/// and h^2 D where the horizon cuts it. Lobe::kPartBound and kCutBound are above the largest
/// factors found on 10^5 random parts, directions and widths of lobe (unit/lighting/error_bound).
template <class Weight, class Real, class S>
Real part_error_bound(const Weight& weight, S extent, S irregular, S reach, const Real& distance2,
                      const Real& mu) {
    const Real zero{};
    const Real closest = larger<Real>(zero, square_root(distance2) - reach);
    const WeightNearby<Real> near = weight.nearby(Real(closest * closest));
    const Real x2 = near.inverse_length2 * (extent * extent);
    const Real inverse_l = square_root(near.inverse_length2);
    const Real smooth =
        near.envelope * S(Weight::kPartBound) *
        (x2 * x2 * x2 + x2 * ((inverse_l + S(0.5)) * (irregular * extent) + extent * extent));
    const Real cut = near.envelope * (S(Weight::kCutBound) * extent * extent);
    const Real edge = zero + reach;
    return mu > edge ? smooth : (mu < -edge ? zero : smooth + cut);
}

}  // namespace envbake::lighting
