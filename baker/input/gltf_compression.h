// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"

#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace envbake::gltf {

/// The fields of EXT_meshopt_compression, checked by check_document.
struct MeshoptLayout {
    std::size_t count = 0;
    std::size_t stride = 0;  ///< bytes
    std::string mode;        ///< ATTRIBUTES, TRIANGLES or INDICES
    std::string filter;      ///< NONE, OCTAHEDRAL, QUATERNION or EXPONENTIAL
};

/// Errors:  InvalidInput  the stream is damaged, or claims more than it can hold
Expected<std::vector<std::byte>> decode_meshopt(std::span<const std::byte> encoded,
                                                const MeshoptLayout& layout);

/// One attribute of a Draco mesh, tightly packed.
struct DracoAttribute {
    int component_type = 0;  ///< glTF's number
    int component_count = 0;
    std::vector<std::byte> bytes;
};

struct DracoMesh {
    std::size_t vertex_count = 0;
    std::vector<std::uint32_t> indices;
    std::map<std::string, DracoAttribute> attributes;  ///< by glTF semantic
};

/// Decodes a triangle mesh. `ids` maps glTF semantics to the stream's unique attribute ids;
/// vertices stand in the order of the decoder's points.
///
/// Draco runs in the image worker: a few bytes can make it take gigabytes, or seconds.
///
/// Errors:  InvalidInput  the stream is damaged, or lacks an attribute
///          Failed        the worker cannot be started
Expected<DracoMesh> decode_draco(std::span<const std::byte> encoded,
                                 const std::map<std::string, int>& ids);
/// The second half of it: from the bytes that the worker leaves, image_worker/protocol.h, which may
/// be any.
Expected<DracoMesh> read_draco_mesh(std::span<const std::byte> decoded,
                                    const std::map<std::string, int>& ids);

}  // namespace envbake::gltf
