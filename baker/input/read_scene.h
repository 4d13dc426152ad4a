// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"
#include "baker/input/scene.h"

#include <filesystem>

namespace envbake {

enum class NormalWeighting { Angle, Area };

struct ReadSceneOptions {
    NormalWeighting computed_normals = NormalWeighting::Angle;  ///< where the file has none
    bool textures = true;  ///< decode the images that materials use; else Image::rgba stays empty
};

/// Reads the default scene of a .glb or .gltf file: without a default the first scene, without
/// scenes every root node.
///
/// - Read: triangles, strips and fans; interleaved, sparse and quantised accessors; Draco and
///   meshopt; morph targets at their default weights; skins in the pose of the file's nodes.
/// - A file may require the extensions EXT_meshopt_compression, KHR_draco_mesh_compression,
///   KHR_materials_emissive_strength, _ior and _specular, KHR_mesh_quantization and
///   KHR_texture_transform; any other is refused by name, and noted where it is only used.
/// - Missing normals are computed, smooth over the vertices that the primitive shares: glTF asks
/// for
///   flat ones, but rows of the bundle are vertices of the file, which cannot be split.
/// - A mesh may be marked in "extras", of its own or of the node that shows it (which then counts):
///   {"envbake": {"receives": false, "casts": false}}.
/// - URIs name files relative to the scene; `..` is followed, absolute paths and schemes are not.
/// - At most 64 Mi vertices and as many triangles, instances counted.
///
/// What was repaired or passed over is in Scene::notes. Deterministic. Threads: any.
///
/// Errors:  InvalidInput  the file breaks a rule that matters here, or has no triangles; the
/// message
///                        names the file and the element
///          Failed        the file cannot be opened
Expected<Scene> read_scene(const std::filesystem::path& file, const ReadSceneOptions& options = {});

}  // namespace envbake
