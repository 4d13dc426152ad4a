// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/vector.h"
#include "envbake/runtime/brdf.h"

#include <cstdint>
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

    double texel_error = 0;  ///< worst |stored - albedo_integral| over 32 texels

    // Of a bilinear look-up: worst in the middle of the cells of any n.v around the least
    // roughness, and at 1024 random (n.v, r).
    double lookup_error = 0;        ///< worst for r >= kSharpestRoughness, at any n.v
    double lookup_error_rms = 0;    ///< of the random points of such r
    double sharp_lookup_error = 0;  ///< worst for the sharper lobes: 0.1, of any table
};

/// The split-sum table: albedo_integral.h at every texel, rounded to float.
///
/// 0 <= A, B and A + B <= 1 hold for every texel. Every texel of 128 x 128, of either lobe and
/// axes, was compared with the reference: within 1e-6. O(size^2); the same bits on any number of
/// threads.
BrdfTable bake_brdf_table(const BrdfTableJob& job);

/// The texels as half floats (runtime/half.h), A and B in turn. A is the nearest; B is, or the next
/// lower, so that A + B <= 1 holds of the halves too. Within 2^-11 of the floats, 4.9e-4.
std::vector<std::uint16_t> half_texels(const BrdfTable& table);

}  // namespace envbake
