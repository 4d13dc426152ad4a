// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/stage_key.h"

#include "baker/pipeline/metadata.h"

#include "envbake/format/reader.h"

#include <map>
#include <span>

namespace envbake {

namespace {

/// An array, whatever is in it: braces would make an object of some.
template <class... Values>
Json list(const Values&... values) {
    Json json = Json::array();
    (json.push_back(values), ...);
    return json;
}

/// What a stage adds to a key.
struct Part {
    std::string unit;                         ///< stages of one unit have one key; "": no key
    bool scene = false, environment = false;  ///< read by it
    Json job;                                 ///< all its fields that decide what it leaves
};

class Parts {
  public:
    Parts(const BakeRequest& request, const BakePlan& plan) : request_(request) {
        for (const PlannedStage& stage : plan.stages)
            if (stage.job)
                rows_wait_ = rows_wait_ || std::holds_alternative<PlannedBounces>(*stage.job) ||
                             std::holds_alternative<PlannedEncoding>(*stage.job);
    }

    Part operator()(const PlannedStage& stage) const {
        return std::visit([&](const auto& job) { return of(stage.output, job); }, *stage.job);
    }

  private:
    static Part of(const std::string&, const PlannedLights&) { return {}; }
    static Part of(const std::string&, const PlannedSh&) { return {}; }

    Part of(const std::string& output, const PlannedMips& mips) const {
        const MipsJob& job = mips.job;
        return {output, false, true,
                list(job.face_size, job.perceptual_roughness, job.levels, job.tolerance,
                     job.distribution, job.layout, job.channels, job.certify, mips.level_count,
                     mips.contrast, request_.tolerance, request_.compress)};
    }
    static Part of(const std::string& output, const PlannedTable& table) {
        return {output, false, false,
                list(table.job.size, table.job.axes, table.job.distribution, table.half)};
    }
    static Part of(const std::string& output, const PlannedLobe& lobe) {
        return {output, false, false,
                list(lobe.job.distribution, lobe.job.exit_bands, lobe.job.light_bands,
                     lobe.job.roughness[0], lobe.job.roughness[1])};
    }

    Part of(const std::string&, const PlannedGlossy& glossy) const {
        const LobeErrors& errors = glossy.errors;
        const bool half = request_.encoding != Encoding::F32;
        return {transport(glossy.mesh), true, false,
                list(fields(glossy.job), glossy.mesh, glossy.light_bands, glossy.with_diffuse,
                     glossy.bounces, errors.per_transport_error, errors.per_rounding_error,
                     errors.fit, errors.lost, half, request_.compress)};
    }
    Part of(const std::string& output, const PlannedDiffuse& diffuse) const {
        return {diffuse.job.shadowed ? transport(diffuse.mesh) : output, true, false,
                list(fields(diffuse.job), diffuse.mesh, diffuse.from_glossy, diffuse.bounces,
                     request_.compress)};
    }
    Part of(const std::string&, const PlannedBounces& bounces) const {
        const BounceJob& job = bounces.job;
        return {"transport", true, false,
                list(job.bands, job.channels, job.bounces, job.emission, job.tolerance, job.stride,
                     job.seed, request_.compress)};
    }
    Part of(const std::string&, const PlannedEmitted& emitted) const {
        return {"transport", true, false, list(emitted.mesh, request_.compress)};
    }
    Part of(const std::string&, const PlannedEncoding& planned) const {
        return {"transport", true, false,
                list(planned.encoding, planned.tolerance, planned.bands, request_.seed,
                     request_.compress)};
    }

    static Part of(const std::string&, const PlannedWavelet& wavelet) {
        return {"wavelets", true, false, list(fields(wavelet.job), wavelet.mesh)};
    }
    static Part of(const std::string&, const PlannedWaveletWeights& weights) {
        return {"wavelets", false, false, list(fields(weights.job))};
    }
    static Part of(const std::string& output, const PlannedWaveletLight& light) {
        return {output, false, true, list(light.channels)};
    }

    /// Rows that wait are turned into arrays together.
    std::string transport(std::size_t mesh) const {
        return rows_wait_ ? "transport" : concat("mesh/", mesh, "/transport");
    }
    /// A bake that may end on its time is another one than a bake that may not.
    Json fields(const DiffuseJob& job) const {
        return list(job.bands, job.row_bands, job.shadowed, job.tolerance, job.rays_per_vertex,
                    job.seed, job.shadowed ? request_.time_budget : 0);
    }
    static Json fields(const WaveletJob& job) { return list(job.face_size, job.tolerance); }

    const BakeRequest& request_;
    bool rows_wait_ = false;
};

std::string hash_of(const Json& json) {
    const std::string text = to_text(json, -1);
    return hash_text(std::as_bytes(std::span(text)));
}

/// Hash of what the files hold, and of what options change about it while they are read.
std::string content(const BakeRequest& request, const BakeInputs& inputs, bool of_environment) {
    Json json = Json::array();
    for (const InputFile& file : inputs.files)
        if ((file.role == "environment") == of_environment)
            json.push_back(list(file.hash.bytes, file.hash.xxh3));
    if (of_environment) {
        json.push_back(request.extract_lights);
    } else {
        json.push_back(request.area_weighted_normals);
        json.push_back(request.isa);
        for (const Mesh& mesh : inputs.scene->meshes) json.push_back(mesh.casts);
    }
    return hash_of(json);
}

}  // namespace

std::vector<std::string> stage_keys(const BakeRequest& request, const BakeInputs& inputs,
                                    const BakePlan& plan) {
    const Parts part_of(request, plan);
    struct Unit {
        bool scene = false, environment = false;
        Json jobs = Json::array();
    };
    std::map<std::string, Unit> units;
    std::vector<std::string> unit_of;
    for (const PlannedStage& stage : plan.stages) {
        const Part part = stage.job ? part_of(stage) : Part{};
        unit_of.push_back(part.unit);
        if (part.unit.empty()) continue;
        Unit& unit = units[part.unit];
        // Light is chosen for the transport that there is.
        if (stage.job && std::holds_alternative<PlannedWaveletLight>(*stage.job))
            unit = units["wavelets"];
        unit.scene = unit.scene || part.scene;
        unit.environment = unit.environment || part.environment;
        unit.jobs.push_back(list(stage.output, part.job));
    }
    const std::string scene = inputs.scene ? content(request, inputs, false) : "";
    const std::string environment = content(request, inputs, true);
    std::map<std::string, std::string> keys{{"", ""}};
    for (const auto& [name, unit] : units) {
        Json json = list(tool_version(), unit.jobs);
        if (unit.scene) json.push_back(list("scene", scene));
        if (unit.environment) json.push_back(list("environment", environment));
        keys[name] = hash_of(json);
    }
    std::vector<std::string> of_stages;
    for (const std::string& unit : unit_of) of_stages.push_back(keys.at(unit));
    return of_stages;
}

}  // namespace envbake
