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

/// Reads the default scene of a .glb or .gltf file.
///
/// Errors:  InvalidInput  the file breaks a rule that matters here; the message names the element
///          Failed        the file cannot be opened
Expected<Scene> read_scene(const std::filesystem::path& file, const ReadSceneOptions& options = {});

}  // namespace envbake
