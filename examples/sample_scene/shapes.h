// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vec3.h"

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

namespace envbake::sample {

/// Triangles in metres, +Y up, counter-clockwise seen from the side that the normals point to.
struct Mesh {
    std::vector<std::array<float, 3>> positions;
    std::vector<std::array<float, 3>> normals;  ///< unit
    std::vector<std::uint32_t> triangles;       ///< 3 indices each
};

struct SurfaceSample {
    Vec3 position;
    Vec3 normal;  ///< unit, outwards
};

/// Adds the surface at(i, j), i in [0, rows], j in [0, columns], as a grid of triangles. With
/// `closed`, column `columns` is column 0 again and its vertices are shared. Triangles are turned
/// to agree with the normals; those without an area (at a pole) are left out.
void add_patch(Mesh& mesh, int rows, int columns, bool closed,
               const std::function<SurfaceSample(int i, int j)>& at);

/// A point of an outline in the half-plane of radius and height, with its outward normal.
struct ProfilePoint {
    double radius = 0, y = 0;
    double normal_radius = 0, normal_y = 0;
};
using Profile = std::vector<ProfilePoint>;

/// A straight stretch in steps no longer than `step`. Outside is on the right hand of the walk from
/// a to b when radius points right and height up: walk up a wall and inwards over a top.
Profile line(Vec3 a, Vec3 b, double step);
/// A circular stretch about (radius, y) from angle `from_deg` to `to_deg` (0 outwards, 90 up),
/// outside where the circle's outside is, or its inside when `hollow`.
Profile arc(Vec3 centre, double circle_radius, double from_deg, double to_deg, int steps,
            bool hollow = false);

/// Turns a profile about +Y, from azimuth `from_deg` to `to_deg` (0 at +X, 90 at +Z); a full turn
/// closes on itself. Between two profiles added one after the other the edge stays hard.
void add_lathe(Mesh& mesh, const Profile& profile, int segments, double from_deg = 0,
               double to_deg = 360);

Mesh make_sphere(double radius, int segments);
/// Ring of `major` radius about +Y and `minor` radius of its tube.
Mesh make_torus(double major, double minor, int segments, int sides);
/// Tube of radius `tube` along the (p, q) torus knot that winds p times about the axis +Z.
Mesh make_torus_knot(int p, int q, double major, double minor, double tube, int segments,
                     int sides);
/// Box of full size `size` about the origin, with edges rounded to `edge_radius`.
Mesh make_rounded_box(Vec3 size, double edge_radius, int flat_steps, int round_steps);

}  // namespace envbake::sample
