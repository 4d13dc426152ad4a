// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/vector.h"
#include "envbake/runtime/brdf.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace envbake {

/// A direction about +Z with density cos(theta) / pi.  u0, u1 in [0, 1).
inline DVec3 sample_cosine(double u0, double u1) {
    const double r = std::sqrt(u0), phi = 2 * std::numbers::pi * u1;
    return {r * std::cos(phi), r * std::sin(phi), std::sqrt(1 - u0)};
}

/// A microfacet normal about +Z among those that `v` sees, with density
///
///     D_v(h) = G1(v) max(0, v.h) D(h) / v.z
///
/// `v` unit, v.z > 0; alpha in (0, 1].  Source: [Heitz18] section 3: stretch the surface to a
/// hemisphere, pick a point of the hemisphere's disc as v sees it, come back.
inline DVec3 sample_visible_normal(const DVec3& v, double alpha, double u0, double u1) {
    const DVec3 stretched = glm::normalize(DVec3(alpha * v.x, alpha * v.y, v.z));
    // The disc's lower half is seen foreshortened: its first axis must be horizontal.
    const double across = std::hypot(stretched.x, stretched.y);
    const DVec3 axis1 =
        across > 1e-12 ? DVec3(-stretched.y / across, stretched.x / across, 0) : DVec3(1, 0, 0);
    const DVec3 axis2 = glm::cross(stretched, axis1);
    const double r = std::sqrt(u0), phi = 2 * std::numbers::pi * u1;
    const double t1 = r * std::cos(phi);
    const double s = (1 + stretched.z) / 2;
    const double t2 = (1 - s) * std::sqrt(std::max(0.0, 1 - t1 * t1)) + s * r * std::sin(phi);
    const DVec3 on_sphere =
        t1 * axis1 + t2 * axis2 + std::sqrt(std::max(0.0, 1 - t1 * t1 - t2 * t2)) * stretched;
    return glm::normalize(
        DVec3(alpha * on_sphere.x, alpha * on_sphere.y, std::max(1e-12, on_sphere.z)));
}

/// Density, per steradian of l, of reflecting `v` about sample_visible_normal():
///     D_v(h) / (4 v.h) = G1(v) D(h) / (4 n.v)
inline double visible_normal_pdf(double n_dot_v, double n_dot_h, double alpha) {
    return runtime::ggx_d(n_dot_h, alpha) /
           (4 * n_dot_v * (1 + runtime::ggx_lambda(n_dot_v, alpha)));
}

}  // namespace envbake
