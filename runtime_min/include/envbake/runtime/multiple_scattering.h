// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <numbers>

namespace envbake::runtime {

// A microfacet BRDF of one bounce loses the light that leaves a facet towards another: half of it
// and more on rough surfaces. Three ways to give it back from the BRDF table, each for one channel
// of the reflectance r0 at normal incidence:
//
//     [Kulla17]   a second lobe beside the first: for lights one by one
//     [Turquin19] a factor on the first lobe: cheapest, for lights and mips alike
//     [Fdez19]    weights of the mips and of the irradiance: for environments
//
// With A and B of lookup_brdf(), the albedo of one bounce is r0 A + B; E = A + B is that of a
// surface that absorbs nothing, and `average_albedo` its mean, lookup_average_albedo(). The table
// of the distribution in use, GGX or Beckmann.
//
// Each keeps the whole: r0 = 1 reflects all that arrives (the white furnace), no r0 in [0, 1]
// reflects more, provided that 0 <= A, B and A + B <= 1. What a looked-up E lacks in accuracy these
// inherit, not more.
//
// Trap: work these out for the dielectric (r0 = 0.04) and for the metal (r0 = base colour) apart,
// and mix the results by metalness. They are convex in r0, so that mixing r0 first loses energy.
//
// Every function is pure, allocates nothing and never throws. Real is float or double.

/// Schlick's Fresnel averaged over the hemisphere, 2 integral of F(c) c dc = (20 r0 + 1) / 21.
template <class Real>
Real average_fresnel(Real r0) noexcept {
    return r0 + (1 - r0) / 21;
}

/// Share of the light kept by the facets that it meets from the second on, over what [Kulla17]'s
/// lobe of no absorption returns.
///
///     F_ms = F^2 E / (1 - F (1 - E)),  F = average_fresnel(r0), E = average_albedo
///
/// The sum of F^k (1 - E)^(k - 2) E over k >= 2 bounces. In [0, 1], 1 for r0 = 1.
///
/// Source: [Kulla17] with one more factor F, for the bounce before the second, [Hill18].
template <class Real>
Real multiple_scattering_fresnel(Real r0, Real average_albedo) noexcept {
    const Real f = average_fresnel(r0);
    const Real kept = 1 - f * (1 - average_albedo);
    return kept > 0 ? f * f * average_albedo / kept : 0;
}

/// The lobe of the light that bounces more than once, of no absorption, per steradian. Multiply by
/// multiple_scattering_fresnel() and add to f of brdf.h.
///
///     f_ms(l, v) = (1 - E(n.l)) (1 - E(n.v)) / (pi (1 - E_avg))
///
/// Reciprocal; its integral against n.l dl is 1 - E(n.v). 0 for a mirror, which loses nothing.
///
/// Source: [Kulla17].
template <class Real>
Real multiple_scattering_lobe(Real albedo_l, Real albedo_v, Real average_albedo) noexcept {
    const Real lost = 1 - average_albedo;
    return lost > 0 ? (1 - albedo_l) * (1 - albedo_v) * std::numbers::inv_pi_v<Real> / lost : 0;
}

/// Factor for the lobe of one bounce, E = A + B of the direction to the viewer:
///
///     1 + r0 (1 - E) / E
///
/// 1 where E is 0, which it is without a table only. Not reciprocal.
///
/// Source: [Turquin19].
template <class Real>
Real multiple_scattering_scale(Real r0, Real albedo_v) noexcept {
    return albedo_v > 0 ? 1 + r0 * (1 - albedo_v) / albedo_v : 1;
}

/// Weights of what an environment gives:
///
///     radiance = single * sample_mips(R) + (multiple + albedo * diffuse) * irradiance(n) / pi
///
/// single + multiple + diffuse = 1: what the specular layer does not reflect is left for the
/// diffuse one. A metal has no diffuse layer: leave that term out.
template <class Real>
struct EnvironmentWeights {
    Real single = 0;    ///< r0 A + B
    Real multiple = 0;  ///< bounces from the second on: arrive from everywhere
    Real diffuse = 0;   ///< of a dielectric
};

/// `a` and `b`: A and B of lookup_brdf() for the direction to the viewer.
///
///     single = r0 a + b,  multiple = single F (1 - E) / (1 - F (1 - E)),  E = a + b
///
/// F = average_fresnel(r0).
///
/// Source: [Fdez19], with Schlick's Fresnel instead of its variant that falls with roughness.
template <class Real>
EnvironmentWeights<Real> environment_weights(Real r0, Real a, Real b) noexcept {
    const Real lost = average_fresnel(r0) * (1 - (a + b));
    const Real single = r0 * a + b;
    const Real multiple = lost < 1 ? single * lost / (1 - lost) : 0;
    return {single, multiple, 1 - single - multiple};
}

}  // namespace envbake::runtime
