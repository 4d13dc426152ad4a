// SPDX-License-Identifier: Apache-2.0
#include "baker/core/text.h"
#include "baker/pipeline/array_values.h"
#include "baker/pipeline/merged_stages.h"
#include "baker/pipeline/run.h"

#include <algorithm>
#include <cstddef>
#include <utility>

namespace envbake {

namespace {

/// A shard's file, what its metadata says of itself, and what of the bake.
struct Opened {
    ShardFile file;
    Shard shard;
    Json shared;
};

Expected<Opened> open_shard(const std::filesystem::path& path) {
    ENVBAKE_TRY(const format::Reader reader, open_bundle(path));
    const auto info = reader.find(format::kShardName);
    if (!info)
        return Error{Errc::Usage,
                     concat(path.string(), ": is a whole bundle, not a part of `bake --shard`")};
    const Error damaged{Errc::InvalidBundle,
                        concat(path.string(), ": is damaged; bake this shard again")};
    const auto part = reader.view<std::uint32_t>(format::kShardName);
    const auto metadata = reader.find(format::kMetadataName);
    if (!part || part->size() != 2 || !reader.verify(*info) || !metadata ||
        !reader.verify(*metadata))
        return damaged;
    Opened opened{{path, {}},
                  {static_cast<int>((*part)[0]), static_cast<int>((*part)[1])},
                  parse_metadata(reader.metadata())};
    if (opened.shard.count < 1 || opened.shard.count > kMaxShards || opened.shard.index < 1 ||
        opened.shard.index > opened.shard.count || !opened.shared.is_object() ||
        !opened.shared.contains("results"))
        return damaged;
    for (auto& [output, result] : opened.shared["results"].items())
        opened.file.results.emplace(output, std::move(result));
    opened.shared.erase("results");
    opened.shared.erase("shard");
    return opened;
}

/// What of two bakes is not the same.
std::string difference(const Json& a, const Json& b) {
    for (const auto& [name, what] : {std::pair{"tool", "another version of envbake"},
                                     {"inputs", "other inputs"},
                                     {"options", "other options"}})
        if (!a.contains(name) || !b.contains(name) || a.at(name) != b.at(name)) return what;
    return "another binary or machine: what it found in the same inputs is not the same";
}

/// All of one bake, in order.
struct Parts {
    Json shared;
    std::vector<ShardFile> files;
};

Expected<Parts> open_all(const std::vector<std::filesystem::path>& paths) {
    Parts parts;
    std::size_t count = 0;
    for (const std::filesystem::path& path : paths) {
        ENVBAKE_TRY(Opened opened, open_shard(path));
        const auto of_count = static_cast<std::size_t>(opened.shard.count);
        if (count == 0) {
            count = of_count;
            parts.files.resize(count);
            parts.shared = std::move(opened.shared);
        } else {
            const std::string of_another = concat(path.string(), ": belongs to another bake than ",
                                                  paths.front().string(), ": ");
            if (of_count != count)
                return Error{Errc::InvalidBundle, concat(of_another, "it is one of ", of_count,
                                                         " parts, not of ", count)};
            if (opened.shared != parts.shared)
                return Error{Errc::InvalidBundle,
                             of_another + difference(opened.shared, parts.shared)};
        }
        ShardFile& place = parts.files[static_cast<std::size_t>(opened.shard.index - 1)];
        if (!place.path.empty())
            return Error{Errc::Usage, concat(path.string(), ": part ", opened.shard.index, " of ",
                                             count, " is there already: ", place.path.string())};
        place = std::move(opened.file);
    }
    for (std::size_t i = 0; i < count; ++i)
        if (parts.files[i].path.empty())
            return Error{Errc::Usage, concat("part ", i + 1, " of ", count, " is missing")};
    return parts;
}

bool bounces_light(const BakePlan& plan) {
    return std::any_of(plan.stages.begin(), plan.stages.end(), [](const PlannedStage& stage) {
        return stage.job && std::holds_alternative<PlannedBounces>(*stage.job);
    });
}

/// The scene that the parts were baked from.
Expected<Scene> read_same_scene(const std::filesystem::path& path, const SharedState& of_parts) {
    if (path.empty())
        return Error{Errc::Usage,
                     "light bounces in these parts, and for that the whole scene is needed: give "
                     "the one that they were baked from with --scene"};
    BakeRequest request = of_parts.request;
    request.scene = path;
    ENVBAKE_TRY(BakeInputs inputs, load_inputs(request));
    std::vector<InputFile> expected;
    for (const InputFile& file : of_parts.inputs.files)
        if (file.role != "environment") expected.push_back(file);
    if (!std::equal(inputs.files.begin(), inputs.files.end(), expected.begin(), expected.end(),
                    [](const InputFile& a, const InputFile& b) { return a.hash == b.hash; }))
        return Error{Errc::InvalidInput,
                     concat(path.string(),
                            ": is not the scene that the parts were baked from, or a file that it "
                            "refers to has changed")};
    // The hashes may be its own where the rest is not.
    const std::vector<MeshFacts>&seen = inputs.facts.meshes, &told = of_parts.inputs.facts.meshes;
    if (!std::equal(seen.begin(), seen.end(), told.begin(), told.end(),
                    [](const MeshFacts& a, const MeshFacts& b) {
                        return a.vertex_count == b.vertex_count && a.receives == b.receives;
                    }))
        return Error{Errc::InvalidBundle,
                     concat(path.string(), ": has other meshes than its parts; bake them again")};
    return *std::move(inputs.scene);
}

}  // namespace

Expected<BakeOutcome> merge_shards(const std::vector<std::filesystem::path>& paths,
                                   const std::filesystem::path& scene,
                                   const std::filesystem::path& output, Progress& progress) {
    ENVBAKE_TRY(const Parts parts, open_all(paths));
    const std::string name = paths.front().string();
    const Json& shared = parts.shared;
    try {
        if (shared.at("tool").at("version") != tool_version())
            return Error{
                Errc::InvalidBundle,
                concat(name, ": was made by envbake ",
                       printable(shared.at("tool").at("version").get<std::string>()), ", this is ",
                       tool_version(), "; merge with the envbake that baked")};
        SharedState state = read_shared(shared);
        state.request.output = output;
        const auto plan = plan_of_shards(shared, state);
        if (!plan) return Error{plan.error().code, concat(name, ": ", plan.error().message)};
        if (bounces_light(*plan)) {
            ENVBAKE_TRY(state.inputs.scene, read_same_scene(scene, state));
        }
        MergedStages stages(parts.files, state.inputs, state.request.isa, progress);
        return write_bundle(state.request, state.inputs, shared, *plan, stages, Older::Forget,
                            progress);
    } catch (const Json::exception& e) {
        return Error{Errc::InvalidBundle, concat(name,
                                                 ": its metadata is not that of a shard of "
                                                 "this version: ",
                                                 printable(e.what()))};
    }
}

}  // namespace envbake
