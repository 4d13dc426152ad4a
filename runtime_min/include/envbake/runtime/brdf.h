// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <numbers>

namespace envbake::runtime {

// The specular lobe that everything here agrees on: GGX or Beckmann normals, height-correlated
// Smith masking, Schlick's Fresnel. The BRDF is f = D(h) V(l, v) F(v.h), per steradian.
//
// Real is float or double. Every argument n_dot_x is a cosine in [0, 1]; `alpha` is the perceptual
// roughness squared, in (0, 1].

/// GGX distribution of microfacet normals, isotropic, per steradian.
///
///     D(h) = alpha^2 / (pi (sin^2 + alpha^2 cos^2)^2),  cos = n.h,  integral of D(h) (n.h) dh = 1
///
/// Source: [Walter07] eq. 33, tangents multiplied out.
template <class Real>
Real ggx_d(Real n_dot_h, Real alpha) {
    // Two positive terms, sin^2 as (1 - c)(1 + c): a small alpha loses no digits near the peak.
    const Real sin2 = (1 - n_dot_h) * (1 + n_dot_h);
    const Real alpha_cos = alpha * n_dot_h;
    const Real denominator = sin2 + alpha_cos * alpha_cos;
    return alpha * alpha / (std::numbers::pi_v<Real> * denominator * denominator);
}

/// Smith's Lambda of GGX: masking of one direction is G1 = 1 / (1 + Lambda).
///
///     Lambda(w) = (sqrt(1 + alpha^2 tan^2) - 1) / 2,  tan of the angle between w and n
///
/// Defined for n_dot_w in (0, 1].  Source: [Heitz14] eq. 72.
template <class Real>
Real ggx_lambda(Real n_dot_w, Real alpha) {
    // (sqrt(1 + x) - 1) / 2 as x / (2 (sqrt(1 + x) + 1)): no cancellation for a small alpha.
    const Real x = alpha * alpha * (1 - n_dot_w) * (1 + n_dot_w) / (n_dot_w * n_dot_w);
    return x / (2 * (std::sqrt(1 + x) + 1));
}

/// Joint visibility of GGX, V = G2 / (4 n.l n.v), with G2 = 1 / (1 + Lambda(l) + Lambda(v)).
///
///     V = 1 / (2 (n.l s(n.v) + n.v s(n.l))),  s(c) = sqrt(alpha^2 + (1 - alpha^2) c^2)
///
/// Infinite only where n.l and n.v are both 0.  Source: [Heitz14] eq. 99, denominators multiplied
/// out.
template <class Real>
Real ggx_visibility(Real n_dot_l, Real n_dot_v, Real alpha) {
    const Real alpha2 = alpha * alpha;
    const Real s_v = std::sqrt(alpha2 + (1 - alpha2) * n_dot_v * n_dot_v);
    const Real s_l = std::sqrt(alpha2 + (1 - alpha2) * n_dot_l * n_dot_l);
    return 1 / (2 * (n_dot_l * s_v + n_dot_v * s_l));
}

/// Beckmann distribution of microfacet normals, isotropic, per steradian.
///
///     D(h) = exp(-tan^2 / alpha^2) / (pi alpha^2 cos^4),  cos = n.h,  integral of D(h) (n.h) dh =
///     1
///
/// Source: [Walter07] eq. 25.
template <class Real>
Real beckmann_d(Real n_dot_h, Real alpha) {
    const Real cos2 = n_dot_h * n_dot_h;
    if (!(cos2 > 0)) return 0;
    const Real tan2 = (1 - n_dot_h) * (1 + n_dot_h) / cos2;
    // As two quotients: alpha^2 cos^4 may be 0 in float where the exponential is 0 already.
    const Real width2 = alpha * alpha;
    const Real density = std::exp(-tan2 / width2) * std::numbers::inv_pi_v<Real> / width2;
    return density > 0 ? density / cos2 / cos2 : 0;
}

/// Smith's Lambda of Beckmann, exact.
///
///     Lambda(w) = exp(-a^2) / (2 a sqrt(pi)) - erfc(a) / 2,  a = 1 / (alpha tan)
///
/// Defined for n_dot_w in (0, 1]. The difference loses its relative accuracy as a grows, where
/// Lambda itself vanishes: the absolute error is a rounding of exp(-a^2).  Source: [Heitz14]
/// eq. 68.
template <class Real>
Real beckmann_lambda(Real n_dot_w, Real alpha) {
    const Real tangent_alpha = alpha * std::sqrt((1 - n_dot_w) * (1 + n_dot_w)) / n_dot_w;
    if (!(tangent_alpha > 0)) return 0;
    const Real a = 1 / tangent_alpha;
    const Real lambda =
        tangent_alpha * std::exp(-a * a) * std::numbers::inv_sqrtpi_v<Real> / 2 - std::erfc(a) / 2;
    return lambda > 0 ? lambda : 0;
}

/// Joint visibility of Beckmann.
///
///     V = 1 / (2 (n.l s(n.v) + n.v s(n.l))),  s(c) = c (1 + 2 Lambda)
///                                                  = c erf(a) + alpha sin exp(-a^2) / sqrt(pi)
///
/// Two positive terms: no cancellation, and nothing divides by c.  Infinite only where n.l and n.v
/// are both 0.  Source: [Heitz14] eq. 99 with eq. 68.
template <class Real>
Real beckmann_visibility(Real n_dot_l, Real n_dot_v, Real alpha) {
    const auto s = [alpha](Real c) {
        const Real scale = alpha * std::sqrt((1 - c) * (1 + c));
        if (!(scale > 0)) return c;
        const Real a = c / scale;
        return c * std::erf(a) + scale * std::exp(-a * a) * std::numbers::inv_sqrtpi_v<Real>;
    };
    return 1 / (2 * (n_dot_l * s(n_dot_v) + n_dot_v * s(n_dot_l)));
}

/// (1 - v.h)^5: F = R0 + (1 - R0) * schlick_weight.  Source: [Schlick94] eq. 24.
template <class Real>
Real schlick_weight(Real v_dot_h) {
    const Real m = 1 - v_dot_h;
    const Real m2 = m * m;
    return m2 * m2 * m;
}

/// Fresnel reflectance of one channel; r0 is the reflectance at normal incidence.
template <class Real>
Real schlick(Real r0, Real v_dot_h) {
    return r0 + (1 - r0) * schlick_weight(v_dot_h);
}

/// Distribution of microfacet normals. Both come with height-correlated Smith masking.
enum class Distribution {
    Ggx,       ///< [Walter07] eq. 33, after Trowbridge and Reitz. Metadata: "ggx"
    Beckmann,  ///< [Walter07] eq. 25. Metadata: "beckmann"
};

/// How the texels of a BRDF table lie over (n.v, perceptual roughness r). What happens at grazing
/// angles happens at n.v of about alpha = r^2, so the roots of n.v are those of r^2.
enum class TableAxes {
    RootsEndPoints,  ///< (n.v)^(1/4), r^(1/2); texel i at i / (size - 1). Metadata: "roots"
    LinearCentres,   ///< n.v, r; texel i at (i + 1/2) / size. Metadata: "linear"
};
enum class TableAxis { NDotV, Roughness };  ///< columns, rows

/// n.v or r at texel `index` of an axis with `size` texels; fractions lie between texels.
template <class Real>
Real table_value(TableAxes axes, TableAxis axis, Real index, int size) {
    if (axes == TableAxes::LinearCentres) return (index + Real(0.5)) / static_cast<Real>(size);
    const Real root = index / static_cast<Real>(size - 1);
    return axis == TableAxis::NDotV ? root * root * root * root : root * root;
}

/// The inverse: where `value` (in [0, 1]) lies between texels, in [0, size - 1]. Values beyond the
/// centres of the first and the last texel take that texel.
template <class Real>
Real table_position(TableAxes axes, TableAxis axis, Real value, int size) {
    const Real last = static_cast<Real>(size - 1);
    const Real root = axis == TableAxis::NDotV ? std::sqrt(std::sqrt(value)) : std::sqrt(value);
    const Real position = axes == TableAxes::LinearCentres
                              ? value * static_cast<Real>(size) - Real(0.5)
                              : root * last;
    // Written so that a NaN takes the first texel.
    return position > 0 ? (position < last ? position : last) : 0;
}

}  // namespace envbake::runtime
