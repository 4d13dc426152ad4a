// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/gltf_asset.h"
#include "baker/math/vector.h"

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace envbake::gltf {

/// What a primitive lacked and got, summed over the scene for the notes.
struct Repairs {
    std::uint64_t clamped_colors = 0;       ///< COLOR_0 components outside 0 .. 1
    std::uint64_t zeroed_uvs = 0;           ///< coordinates that were not finite
    std::uint64_t leftover_indices = 0;     ///< of triangle lists whose length is no multiple of 3
    std::uint64_t unweighted_vertices = 0;  ///< skinned, all weights 0: bound to their first joint
};

/// One vertex's joints, by index into the skin's joints; weights sum to 1.
struct Influence {
    std::uint32_t joint = 0;
    float weight = 0;
};

/// A primitive in the space of its mesh, morph targets applied. Empty or one a vertex.
struct Primitive {
    std::vector<Vec3> positions;  ///< finite
    std::vector<Vec3> normals;    ///< as the file has them: any length, not always finite
    std::vector<Vec2> uv0, uv1;
    std::vector<Vec4> colors;
    std::vector<std::uint32_t> triangles;  ///< 3 indices each, in range
    std::vector<Influence> influences;     ///< influences_per_vertex each
    std::size_t influences_per_vertex = 0;
};

/// "meshes[1].primitives[0]"
std::string primitive_path(int mesh, int primitive);

/// Reads and expands a primitive: triangles from lists, strips and fans [glTF 2.0, 3.7.2.1], none
/// from points and lines; Draco decoded; `weights[k]` of morph target k added.
///
/// Errors:  InvalidInput  names the primitive, the attribute, the vertex or the index
Expected<Primitive> read_primitive(Asset& asset, int mesh, int primitive,
                                   std::span<const double> weights, Repairs& repairs);

}  // namespace envbake::gltf
