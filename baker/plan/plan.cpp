// SPDX-License-Identifier: Apache-2.0
#include "baker/plan/plan.h"

#include "baker/core/text.h"

#include <algorithm>
#include <cmath>

namespace envbake {

namespace {

/// A material is asked for a specular lobe only where it has one: R0 = 0 means that
/// KHR_materials_specular switched it off. Every other lobe reflects at least the Schlick mean of
/// 1/21 of the light, more than any tolerance in use.
bool has_lobe(const MaterialFacts& material) {
    return material.max_r0 > 0;
}

/// What the scene's materials ask of the specular side.
struct SpecularNeed {
    std::size_t lobe_count = 0;  ///< materials in use that have a lobe
    std::size_t used_count = 0;  ///< materials in use
    float min_roughness = 1;
    float max_roughness = 0;
};

SpecularNeed specular_need(const BakeFacts& facts) {
    SpecularNeed need;
    for (std::size_t m = 0; m < facts.materials.size(); ++m) {
        const bool used = std::any_of(
            facts.meshes.begin(), facts.meshes.end(),
            [m](const MeshFacts& f) { return f.material == m && f.triangle_count > 0; });
        if (!used) continue;
        ++need.used_count;
        const MaterialFacts& material = facts.materials[m];
        if (!has_lobe(material)) continue;
        ++need.lobe_count;
        need.min_roughness = std::min(need.min_roughness, material.min_roughness);
        need.max_roughness = std::max(need.max_roughness, material.max_roughness);
    }
    return need;
}

PlannedStage plan_sh(const BakeRequest& request, const BakeFacts& facts) {
    PlannedStage stage{"environment/sh", "no environment", std::nullopt};
    if (!facts.environment) return stage;
    stage.job = ShLightingJob{request.bands};
    stage.reason = concat(request.bands, " bands of radiance");
    return stage;
}

/// Why neither mips nor a BRDF table are needed; null where they are.
const char* why_no_specular(const BakeFacts& facts, const SpecularNeed& need) {
    if (!facts.environment) return "no environment";
    if (facts.has_scene && need.lobe_count == 0) return "no material has a specular lobe";
    return nullptr;
}

PlannedStage plan_mips(const BakeRequest& request, const BakeFacts& facts,
                       const SpecularNeed& need) {
    PlannedStage stage{"environment/mips", "", std::nullopt};
    if (const char* reason = why_no_specular(facts, need)) {
        stage.reason = reason;
        return stage;
    }
    const int last = request.mip_count - 1;
    int first_level = 0, last_level = last;
    if (facts.has_scene && last > 0) {
        // Trilinear look-ups read the level below and the level above a roughness.
        const auto steps = static_cast<float>(last);
        first_level = static_cast<int>(std::floor(need.min_roughness * steps));
        last_level = static_cast<int>(std::ceil(need.max_roughness * steps));
    }
    PlannedMips mips;
    mips.level_count = request.mip_count;
    mips.job.face_size = request.mip_size;
    mips.job.tolerance = request.tolerance;
    for (int level = first_level; level <= last_level; ++level) {
        mips.job.levels.push_back(level);
        mips.job.perceptual_roughness.push_back(
            last > 0 ? static_cast<float>(level) / static_cast<float>(last) : 0.0f);
    }
    if (facts.has_scene)
        stage.reason =
            concat(need.lobe_count, " of ", need.used_count,
                   " materials have a specular lobe, of roughness ",
                   format_number(need.min_roughness), " to ", format_number(need.max_roughness));
    else
        stage.reason = "no scene says which roughness is needed: all of them";
    if (facts.environment->constant) {
        mips.job.face_size = 1;
        stage.reason += "; the environment is constant: one texel a level";
    }
    stage.job = std::move(mips);
    return stage;
}

PlannedStage plan_table(const BakeRequest& request, const BakeFacts& facts,
                        const SpecularNeed& need) {
    PlannedStage stage{"brdf/ggx", "", std::nullopt};
    if (const char* reason = why_no_specular(facts, need)) {
        stage.reason = reason;
        return stage;
    }
    stage.job = BrdfTableJob{request.table_size, request.table_axes};
    stage.reason = "split-sum specular";
    return stage;
}

std::string percentage(std::uint64_t part, std::uint64_t whole) {
    return format_number(100.0 * static_cast<double>(part) / static_cast<double>(whole)) + " %";
}

PlannedStage plan_diffuse(const BakeRequest& request, const BakeFacts& facts, std::size_t mesh,
                          bool shadowed) {
    const MeshFacts& f = facts.meshes[mesh];
    PlannedStage stage{concat("mesh/", mesh, shadowed ? "/diffuse" : "/unshadowed"), "",
                       std::nullopt};
    if (!shadowed && !request.unshadowed) {
        stage.reason = "not asked for";
        return stage;
    }
    if (f.triangle_count == 0) {
        stage.reason = "no triangles";
        return stage;
    }
    const MaterialFacts& material = facts.materials[f.material];
    if (material.max_diffuse_albedo <= 0) {
        stage.reason = concat("material ", quoted(material.name), " reflects nothing diffusely");
        return stage;
    }
    PlannedDiffuse diffuse;
    diffuse.mesh = mesh;
    diffuse.job = DiffuseJob{.bands = request.bands,
                             .shadowed = shadowed,
                             .tolerance = request.tolerance,
                             .rays_per_vertex = request.rays_per_vertex,
                             .seed = request.seed};
    if (!shadowed)
        stage.reason = "analytic, no rays";
    else if (f.free_vertex_count == f.vertex_count)
        stage.reason = "analytic, no rays: nothing stands above any vertex";
    else if (f.free_vertex_count > 0)
        stage.reason = concat(percentage(f.free_vertex_count, f.vertex_count),
                              " of the vertices have nothing above them and need no rays");
    else
        stage.reason = "something stands above every vertex";
    stage.job = diffuse;
    return stage;
}

Expected<void> check_request(const BakeRequest& request, const BakeFacts& facts) {
    const auto usage = [](auto... parts) { return Error{Errc::Usage, concat(parts...)}; };
    if (!facts.has_scene && !facts.environment)
        return usage("nothing to bake: give a scene, an environment (--env), or both");
    if (request.bands < 1 || request.bands > 10)
        return usage("--bands ", request.bands, ": 1 to 10 are possible");
    if (!(request.tolerance >= 1e-5 && request.tolerance <= 0.5))
        return usage("--tolerance ", request.tolerance, ": 1e-5 to 0.5 are possible");
    if (request.mip_size < 1 || request.mip_size > 4096)
        return usage("--mip-size ", request.mip_size, ": 1 to 4096 are possible");
    if (request.mip_count < 1 || request.mip_count > 16)
        return usage("--mip-count ", request.mip_count, ": 1 to 16 are possible");
    if (request.table_size < 2 || request.table_size > 1024)
        return usage("--table-size ", request.table_size, ": 2 to 1024 are possible");
    if (request.rays_per_vertex < 0 || request.rays_per_vertex > 1 << 20)
        return usage("--rays ", request.rays_per_vertex, ": 1 to 1048576 are possible");
    return {};
}

std::uint64_t mip_bytes(const PlannedMips& mips) {
    std::uint64_t bytes = 0;
    for (const int level : mips.job.levels) {
        const auto size = static_cast<std::uint64_t>(std::max(1, mips.job.face_size >> level));
        bytes += 6 * size * size * 3 * sizeof(float);
    }
    return bytes;
}

/// Adds up what the stages will cost. The ray count is the transport stage's own prediction.
void estimate_cost(BakePlan& plan, const BakeFacts& facts) {
    for (const PlannedStage& stage : plan.stages) {
        if (!stage.job) continue;
        if (const auto* sh = std::get_if<ShLightingJob>(&*stage.job))
            plan.output_bytes +=
                static_cast<std::uint64_t>(sh->bands * sh->bands) * 3 * sizeof(float);
        else if (const auto* mips = std::get_if<PlannedMips>(&*stage.job))
            plan.output_bytes += mip_bytes(*mips);
        else if (const auto* table = std::get_if<BrdfTableJob>(&*stage.job))
            plan.output_bytes += static_cast<std::uint64_t>(table->size) *
                                 static_cast<std::uint64_t>(table->size) * 2 * sizeof(float);
        else if (const auto* diffuse = std::get_if<PlannedDiffuse>(&*stage.job)) {
            const MeshFacts& f = facts.meshes[diffuse->mesh];
            const auto coeffs = static_cast<std::uint64_t>(diffuse->job.bands * diffuse->job.bands);
            plan.output_bytes += f.vertex_count * coeffs * sizeof(float);
            if (diffuse->job.shadowed)
                plan.ray_count +=
                    (f.vertex_count - f.free_vertex_count) *
                    static_cast<std::uint64_t>(expected_rays_per_vertex(diffuse->job));
        }
    }
}

}  // namespace

Expected<BakePlan> make_plan(const BakeRequest& request, const BakeFacts& facts) {
    ENVBAKE_TRY_VOID(check_request(request, facts));
    const SpecularNeed need = specular_need(facts);
    BakePlan plan;
    plan.stages.push_back(plan_sh(request, facts));
    plan.stages.push_back(plan_mips(request, facts, need));
    plan.stages.push_back(plan_table(request, facts, need));
    for (std::size_t mesh = 0; mesh < facts.meshes.size(); ++mesh) {
        plan.stages.push_back(plan_diffuse(request, facts, mesh, true));
        plan.stages.push_back(plan_diffuse(request, facts, mesh, false));
    }
    if (!facts.has_scene) plan.stages.push_back({"mesh", "no scene", std::nullopt});
    estimate_cost(plan, facts);
    return plan;
}

}  // namespace envbake
