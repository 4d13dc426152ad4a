// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/scene.h"
#include "baker/trace/half_space_tree.h"
#include "baker/transport/ray_origin.h"

#include <cstdint>
#include <vector>

namespace envbake {

/// A vertex is free where no occluder of the scene rises above the plane through its ray origin,
/// perpendicular to its shading normal: V = 1 over its hemisphere, and its transport is analytic.
inline bool is_free(const RayOrigin& origin, const HalfSpaceTree& occluders) {
    return !occluders.any_above(origin.position, origin.normal);
}

/// Free vertices of every mesh of the scene; casts no ray. Copies of a free vertex count, vertices
/// that are on no surface do not. O(V log F), a microsecond or so a vertex.
std::vector<std::uint64_t> count_free_vertices(const Scene& scene);

}  // namespace envbake
