// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/vector.h"
#include "envbake/runtime/brdf.h"

#include <vector>

namespace envbake {

struct BrdfTableJob {
    int size = 64;  ///< texels along each axis, >= 2
    runtime::TableAxes axes = runtime::TableAxes::RootsEndPoints;
    runtime::Distribution distribution = runtime::Distribution::Ggx;
};

/// Sharper lobes are looked up worse by any table: where r and n.v both approach 0, A + B depends
/// on n.v / r^2 alone, so that a corner of texels holds the whole dip of 0.1 however small it is.
/// Renderers do not go there: this is the least roughness they use.
inline constexpr double kSharpestRoughness = 0.045;

/// "brdf/ggx" or "brdf/beckmann", [roughness, n.v, 2]: A and B with specular albedo = R0 A + B.
///
/// Errors are absolute, the worse of A and B.
struct BrdfTable {
    int size = 0;
    std::vector<Vec2> texels;  ///< size * size, roughness-major
    /// Of every row: 2 integral of (A + B) n.v d(n.v), the average over the hemisphere. Error 1e-6.
    std::vector<float> average_albedo;

    double texel_error = 0;  ///< worst |stored - albedo_integral| over 48 texels

    // Of a bilinear look-up, measured at 3072 random (n.v, r) and in the middle of 1024 cells of
    // small n.v and r, where it is worst.
    double lookup_error = 0;        ///< worst for r >= kSharpestRoughness, at any n.v
    double lookup_error_rms = 0;    ///< of the random points of such r
    double sharp_lookup_error = 0;  ///< worst for the sharper lobes
};

/// The split-sum table: albedo_integral.h at every texel, rounded to float.
///
/// 0 <= A, B and A + B <= 1 hold for every texel. Every texel of 128 x 128, of either lobe and
/// axes, was compared with the reference: within 1e-6. O(size^2); the same bits on any number of
/// threads.
BrdfTable bake_brdf_table(const BrdfTableJob& job);

}  // namespace envbake
