// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/vector.h"

#include <cstdint>
#include <string>
#include <variant>
#include <vector>

namespace envbake {

/// A latitude-longitude grid over the whole sphere. Texel (row, column) covers polar angles
/// theta_edges[row] .. [row + 1] from +Y, and azimuths phi_edges[column] .. [column + 1] about +Y,
/// phi = atan2(z, x). Radians; theta rises from 0 to pi, phi rises by exactly 2 pi from the first
/// edge to the last. Edges need not be evenly spaced: OpenEXR's convention has texels of half the
/// width at the seam and of half the height at the poles.
struct LatLongGrid {
    int width = 0;
    int height = 0;
    std::vector<double> theta_edges;  ///< height + 1
    std::vector<double> phi_edges;    ///< width + 1
};

/// Six square faces +X -X +Y -Y +Z -Z in OpenGL/KTX orientation (runtime/cube.h). Texel (row,
/// column) of a face covers edges[column] .. [column + 1] of the face coordinate u and edges[row]
/// .. [row + 1] of v; both run from -1 to 1, v downwards in the image.
struct CubeGrid {
    int size = 0;
    std::vector<double> edges;  ///< size + 1
};

/// What was found wrong with the texels of the file, and repaired: NaN and negative to 0, +Inf to
/// the largest finite value, -Inf to 0. A texel counts once for each of its channels.
struct RadianceRepairs {
    std::uint64_t nan_count = 0;
    std::uint64_t infinite_count = 0;  ///< +Inf
    std::uint64_t negative_count = 0;  ///< -Inf is counted here
    std::uint64_t total() const { return nan_count + infinite_count + negative_count; }
};

/// Distant radiance over the whole sphere: every texel a constant over its exact solid angle. That,
/// and not a resampled copy, is the truth that every lighting stage integrates.
struct Environment {
    std::string file_name;  ///< without folder
    std::variant<LatLongGrid, CubeGrid> grid;
    std::vector<Vec3>
        radiance;  ///< linear Rec. 709, finite, >= 0; rows from the top, faces in order
    RadianceRepairs repairs;
};

/// Radiance of the texel that direction `w` (unit) falls into.
Vec3 radiance_towards(const Environment& environment, const DVec3& w);

/// A grid of evenly spaced edges in envbake's own convention: u = phi / 2 pi + 1/2.
LatLongGrid make_lat_long_grid(int width, int height);
CubeGrid make_cube_grid(int size);

}  // namespace envbake
