// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/vector.h"
#include "envbake/runtime/brdf.h"

#include <vector>

namespace envbake {

struct BrdfTableJob {
    int size = 64;  ///< texels along each axis, >= 2
    runtime::TableAxes axes = runtime::TableAxes::SqrtEndPoints;
};

/// "brdf/ggx", [roughness, n.v, 2]: A and B with specular albedo = R0 A + B.
struct BrdfTable {
    int size = 0;
    std::vector<Vec2> texels;    ///< size * size, roughness-major
    double texel_error = 0;      ///< worst |stored - true|, by a rule of higher order on a sample of texels
    double lookup_error = 0;     ///< worst |bilinear look-up - true| over random (n.v, roughness)
    double lookup_error_rms = 0;
};

/// The split-sum table of GGX with height-correlated Smith, by Gauss-Legendre quadrature over the
/// half vector.
BrdfTable bake_brdf_table(const BrdfTableJob& job);

/// One entry in double, by the same rule with more nodes: A and B at (n_dot_v, roughness).
DVec2 brdf_integral(double n_dot_v, double perceptual_roughness, int nodes = 48);

}  // namespace envbake
