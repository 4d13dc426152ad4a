// SPDX-License-Identifier: Apache-2.0
#include "baker/core/text.h"
#include "baker/input/image_worker.h"
#include "baker/input/read_environment.h"
#include "baker/input/read_scene.h"
#include "baker/lighting/dominant_lights.h"
#include "baker/lighting/sh_projection.h"
#include "baker/lighting/wavelet_lighting.h"
#include "baker/pipeline/bake.h"
#include "baker/transport/free_vertices.h"

namespace envbake {

namespace {

Expected<void> add_file(std::vector<InputFile>& files, std::string role, std::string name,
                        const std::filesystem::path& path) {
    ENVBAKE_TRY(FileHash hash, hash_file(path));
    files.push_back({std::move(role), std::move(name), std::move(hash)});
    return {};
}

std::vector<MeshFacts> collect_mesh_facts(const Scene& scene) {
    std::vector<MeshFacts> facts;
    const std::vector<std::uint64_t> free_counts = count_free_vertices(scene);
    for (std::size_t i = 0; i < scene.meshes.size(); ++i) {
        const Mesh& mesh = scene.meshes[i];
        facts.push_back({mesh.vertex_count(), mesh.triangle_count(), free_counts[i],
                         static_cast<std::size_t>(mesh.material), mesh.receives, mesh.casts});
    }
    return facts;
}

/// Takes `mark` from the meshes that the user named: by "mesh/I" of the bundle, by the name of the
/// node, or by that of the file's mesh. A name that is nowhere is most likely misspelt.
Expected<void> mark_meshes(Scene& scene, const char* option, const std::vector<std::string>& names,
                           bool Mesh::*mark) {
    for (const std::string& name : names) {
        bool found = false;
        for (std::size_t i = 0; i < scene.meshes.size(); ++i) {
            Mesh& mesh = scene.meshes[i];
            if (name != concat("mesh/", i) && name != mesh.node_name && name != mesh.mesh_name)
                continue;
            mesh.*mark = false;
            found = true;
        }
        if (!found)
            return Error{Errc::Usage, concat(option, " ", quoted(name), ": ", scene.file_name,
                                             " has no node and no mesh of that name")};
    }
    return {};
}

/// Lights first: what is extracted is no longer there for the rest to see.
void collect_lighting_facts(const BakeRequest& request, BakeInputs& inputs) {
    inputs.lights = find_dominant_lights({}, *inputs.environment);
    if (request.extract_lights) remove_lights(inputs.lights, *inputs.environment);
    EnvironmentFacts facts = collect_facts(*inputs.environment);
    facts.lights = {.count = inputs.lights.lights.size(),
                    .strongest_share = inputs.lights.strongest_share};
    for (const DominantLight& light : inputs.lights.lights) facts.lights.share += light.share;
    inputs.sh =
        project_sh({.bands = request.bands, .channels = facts.grey ? 1 : 3}, *inputs.environment);
    facts.band_energy = band_energy(*inputs.sh);
    facts.sh_shadow_loss = sh_shadow_loss(*inputs.environment, request.bands);
    inputs.facts.environment = std::move(facts);
}

}  // namespace

std::string environment_name(const BakeInputs& inputs) {
    for (const InputFile& file : inputs.files)
        if (file.role == "environment") return file.name;
    return "";
}

Expected<BakeInputs> load_inputs(const BakeRequest& request) {
    BakeInputs inputs;
    if (!request.environment.empty()) start_image_worker();
    if (!request.scene.empty()) {
        const auto extension = request.scene.extension();
        if (extension == ".hdr" || extension == ".exr")
            return Error{Errc::Usage, concat(request.scene.string(),
                                             ": is an image, not a scene; give it with --env")};
        ReadSceneOptions options;
        if (request.area_weighted_normals) options.computed_normals = NormalWeighting::Area;
        ENVBAKE_TRY(inputs.scene, read_scene(request.scene, options));
        ENVBAKE_TRY_VOID(
            mark_meshes(*inputs.scene, "--no-receive", request.not_receiving, &Mesh::receives));
        ENVBAKE_TRY_VOID(
            mark_meshes(*inputs.scene, "--no-cast", request.not_casting, &Mesh::casts));
        const auto folder = request.scene.parent_path();
        for (const auto& path : inputs.scene->files_read) {
            const bool first = inputs.files.empty();
            const auto name = first ? path.filename() : path.lexically_relative(folder);
            ENVBAKE_TRY_VOID(
                add_file(inputs.files, first ? "scene" : "resource", name.generic_string(), path));
        }
        inputs.facts.has_scene = true;
        inputs.facts.materials = collect_material_facts(*inputs.scene);
        inputs.facts.meshes = collect_mesh_facts(*inputs.scene);
    }
    if (request.scene.empty() && !(request.not_receiving.empty() && request.not_casting.empty()))
        return Error{Errc::Usage, "--no-receive and --no-cast name meshes of a scene; give one"};
    if (!request.environment.empty()) {
        // Hashed first, while no map is in memory: a mapped file may be as large.
        ENVBAKE_TRY_VOID(add_file(inputs.files, "environment",
                                  request.environment.filename().string(), request.environment));
        ENVBAKE_TRY(inputs.environment,
                    read_environment(request.environment, {.strict = request.strict}));
        collect_lighting_facts(request, inputs);
    }
    return inputs;
}

}  // namespace envbake
