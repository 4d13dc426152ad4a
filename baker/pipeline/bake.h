// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"
#include "baker/core/progress.h"
#include "baker/input/environment.h"
#include "baker/input/scene.h"
#include "baker/lighting/dominant_lights.h"
#include "baker/lighting/sh_projection.h"
#include "baker/pipeline/file_hash.h"
#include "baker/plan/plan.h"

#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace envbake {

/// One file that the bake read.
struct InputFile {
    std::string role;  ///< "scene", "environment", or "resource" of the scene
    std::string name;  ///< file name; of a resource: the path relative to the scene's folder
    FileHash hash;
};

struct BakeInputs {
    std::optional<Environment> environment;  ///< without the lights, where they are extracted
    DominantLights lights;
    std::optional<ShLighting> sh;  ///< of that environment, the bands asked for
    std::optional<Scene> scene;
    std::vector<InputFile> files;
    BakeFacts facts;
    std::chrono::steady_clock::time_point begun =
        std::chrono::steady_clock::now();  ///< reading them; BakeRequest::time_budget counts on
};

/// File name of the environment; "" without one.
std::string environment_name(const BakeInputs& inputs);

/// Reads the request's files and collects the facts the plan needs. No ray is cast.
Expected<BakeInputs> load_inputs(const BakeRequest& request);

/// What becomes of a bundle that is at request.output already.
enum class Older {
    Keep,    ///< what would come out the same is taken from it, not baked
    Forget,  ///< it is baked over
};

struct BakeOutcome {
    std::vector<std::string> shortfalls;  ///< what fell short of the tolerance, one line each
    std::vector<bool> kept;               ///< one a stage: taken from the older bundle
    bool traced = false;                  ///< some stage had rays to cast
};

/// Runs the plan and writes the bundle: the same bytes, whatever was kept. Nothing stands under
/// request.output until it is whole; an older bundle stays there until then. One that is damaged,
/// or made by another tool or version, is baked over.
///
/// Errors:  Failed        the output cannot be written, or a stage ran out of memory
///          InvalidInput  the environment is so bright that its lighting leaves the range of f32
Expected<BakeOutcome> run_plan(const BakeRequest& request, const BakeInputs& inputs,
                               const BakePlan& plan, Older older, Progress& progress);

/// Runs request.shard's part of the plan and writes what it gives, for merge_shards().
///
/// Errors:  Failed  as run_plan()
Expected<void> run_shard(const BakeRequest& request, const BakeInputs& inputs, const BakePlan& plan,
                         Progress& progress);

/// Makes of all shards of a bake, in any order, the bundle that run_plan() makes, byte for byte.
/// Light between surfaces is added here: shards have the rays that it follows, not where they end.
///   scene  that the shards were baked from; read only where light bounces
///
/// Errors:  InvalidBundle  a shard is damaged, or of another bake than the first
///          InvalidInput   it is another scene
///          Usage          a file is no shard; a shard or the scene is missing, or there twice
///          Failed         a file cannot be read, or the output not be written
Expected<BakeOutcome> merge_shards(const std::vector<std::filesystem::path>& shards,
                                   const std::filesystem::path& scene,
                                   const std::filesystem::path& output, Progress& progress);

/// The files that request.output was baked from, where it is an undamaged bundle that the same tool
/// made from the same inputs and options; else nothing. Reads and hashes files; opens no image and
/// no scene.
std::optional<std::vector<std::filesystem::path>> files_if_up_to_date(const BakeRequest& request);

}  // namespace envbake
