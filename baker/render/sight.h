// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/sample_texture.h"
#include "baker/input/scene.h"
#include "baker/math/vector.h"
#include "baker/render/camera.h"
#include "baker/trace/tracer.h"

#include <cstdint>
#include <span>
#include <vector>

namespace envbake {

/// A point of a surface as somebody sees it.
struct SurfacePoint {
    std::size_t mesh = 0;
    std::size_t triangle = 0;
    Vec3 barycentric{0};       ///< weights of the triangle's three vertices
    DVec3 to_viewer{0};        ///< unit
    DVec3 normal{0};           ///< interpolated, unit, on the viewer's side of the triangle
    DVec3 specular_normal{0};  ///< the same, bent where it leans away, so that n.v >= 1e-3
    DVec3 light_origin{0};     ///< where rays to the light start: just above the triangle
    SurfaceMaterial material;
};

/// One surface on a line of sight, and the share of the light it sends that arrives.
struct Layer {
    SurfacePoint point;
    float weight = 1;
};

/// What a line of sight passes, front to back.
struct Sight {
    std::vector<Layer> layers;
    float background = 1;  ///< share of what lies behind everything
};

/// Follows a ray as glTF viewers do: back faces of single-sided materials are not there, BLEND
/// surfaces cover the share `alpha` of what is straight behind them. At most 32 surfaces.
/// `sight` is overwritten (and its memory used again).
void look_along(const Scene& scene, const Tracer& tracer, const DVec3& origin,
                const DVec3& direction, Sight& sight);

/// White paper in place of every material: albedo 1, no specular, no emission; alpha stays.
SurfaceMaterial white_material(const SurfaceMaterial& material);

/// The places of the lines of sight through one pixel: a grid of `per_axis`^2 cells with one point
/// each, moved at random within its cell. The same in every picture of the same size, so that two
/// pictures differ by shading and not by edges.
void pixel_points(const Camera& camera, int x, int y, int per_axis, std::vector<DVec2>& points);

}  // namespace envbake
