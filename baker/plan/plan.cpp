// SPDX-License-Identifier: Apache-2.0
#include "baker/plan/plan.h"

#include "baker/brdf/albedo_integral.h"
#include "baker/core/text.h"
#include "baker/lighting/sh_projection.h"
#include "baker/math/quadrature.h"
#include "envbake/runtime/lobe.h"
#include "envbake/runtime/wavelet.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace envbake {

namespace {

using runtime::Distribution;

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

std::string percentage(double fraction) {
    return format_number(100 * fraction) + " %";
}

PlannedStage plan_lights(const BakeRequest& request, const BakeFacts& facts) {
    PlannedStage stage{"environment/lights", "no environment", std::nullopt};
    if (!facts.environment) return stage;
    const LightFacts& lights = facts.environment->lights;
    if (lights.count == 0) {
        stage.reason = lights.strongest_share > 0
                           ? concat("no small light dominates: the strongest has ",
                                    percentage(lights.strongest_share), " of the energy")
                           : "no light is small and stands out";
        return stage;
    }
    stage.job = PlannedLights{lights.count};
    stage.reason = concat(lights.count, lights.count == 1 ? " light has " : " lights have ",
                          percentage(lights.share), " of the energy",
                          request.extract_lights ? ", left out of every other array" : "");
    return stage;
}

const char* grey_reason(const EnvironmentFacts& environment) {
    return environment.grey ? "; the environment is grey: one channel" : "";
}

int channels_of(const EnvironmentFacts& environment) {
    return environment.grey ? 1 : 3;
}

PlannedStage plan_sh(const BakeRequest& request, const BakeFacts& facts, bool irradiance) {
    PlannedStage stage{irradiance ? "environment/irradiance" : "environment/sh", "no environment",
                       std::nullopt};
    if (!facts.environment) return stage;
    if (irradiance && !request.irradiance) {
        stage.reason = "not asked for";
        return stage;
    }
    const EnvironmentFacts& environment = *facts.environment;
    const int bands = bands_worth_storing(environment.band_energy, request.tolerance);
    stage.job = PlannedSh{bands, channels_of(environment), irradiance, request.window};
    stage.reason = irradiance ? "environment/sh with the clamped cosine folded in"
                   : bands == request.bands
                       ? concat(bands, " bands of radiance")
                       : concat(bands, " of ", request.bands,
                                " bands: the others hold less than the tolerance");
    if (request.window) stage.reason += "; damped until irradiance is nowhere negative";
    stage.reason += grey_reason(environment);
    return stage;
}

bool is_asked_for(const BakeRequest& request, Distribution distribution) {
    const auto& asked = request.distributions;
    return std::find(asked.begin(), asked.end(), distribution) != asked.end();
}

/// Why neither mips nor a BRDF table of this lobe are needed; null where they are.
const char* why_no_specular(const BakeRequest& request, const BakeFacts& facts,
                            const SpecularNeed& need, Distribution distribution) {
    if (!facts.environment) return "no environment";
    if (!is_asked_for(request, distribution)) return "not asked for";
    if (facts.has_scene && need.lobe_count == 0) return "no material has a specular lobe";
    return nullptr;
}

PlannedStage plan_mips(const BakeRequest& request, const BakeFacts& facts, const SpecularNeed& need,
                       Distribution distribution) {
    const bool ggx = distribution == Distribution::Ggx;
    PlannedStage stage{ggx ? "environment/mips" : "environment/mips_beckmann", "", std::nullopt};
    if (const char* reason = why_no_specular(request, facts, need, distribution)) {
        stage.reason = reason;
        return stage;
    }
    RoughnessRange range;
    if (request.roughness_range) {
        range = *request.roughness_range;
        stage.reason = concat("roughness ", format_number(range.min), " to ",
                              format_number(range.max), " was asked for");
    } else if (facts.has_scene) {
        range = {need.min_roughness, need.max_roughness};
        stage.reason = concat(need.lobe_count, " of ", need.used_count,
                              " materials have a specular lobe, of roughness ",
                              format_number(range.min), " to ", format_number(range.max));
    } else {
        stage.reason = "no scene says which roughness is needed: all of them";
    }

    // Trilinear look-ups read the level below and the level above a roughness.
    const int last = request.mip_count - 1;
    const int first_level = static_cast<int>(std::floor(range.min * last));
    const int last_level = static_cast<int>(std::ceil(range.max * last));
    // Both lobes have the same mirror: GGX keeps it, where anything else is left for Beckmann.
    const bool has_mirror =
        !ggx && is_asked_for(request, Distribution::Ggx) && first_level == 0 && last_level > 0;
    PlannedMips mips;
    mips.level_count = request.mip_count;
    mips.job.face_size = request.mip_size;
    mips.job.tolerance = request.tolerance;
    mips.job.distribution = distribution;
    mips.job.layout = request.mip_layout;
    mips.job.channels = channels_of(*facts.environment);
    mips.job.certify = request.certify;
    for (int level = has_mirror ? 1 : first_level; level <= last_level; ++level) {
        mips.job.levels.push_back(level);
        mips.job.perceptual_roughness.push_back(
            last > 0 ? static_cast<float>(level) / static_cast<float>(last) : 0.0f);
    }
    if (has_mirror) stage.reason += "; the mirror is environment/mips/0";
    // Half of the tolerance is left for encoding.
    if (facts.environment->contrast <= request.tolerance / 2) {
        mips.job.face_size = 1;
        mips.contrast = facts.environment->contrast;
        stage.reason += concat("; the environment is constant to ", format_number(mips.contrast),
                               ": one texel a level");
    }
    if (request.certify) stage.reason += "; with a proved bound of every texel's error";
    stage.reason += grey_reason(*facts.environment);
    stage.job = std::move(mips);
    return stage;
}

PlannedStage plan_table(const BakeRequest& request, const BakeFacts& facts,
                        const SpecularNeed& need, Distribution distribution) {
    PlannedStage stage{distribution == Distribution::Ggx ? "brdf/ggx" : "brdf/beckmann", "",
                       std::nullopt};
    if (const char* reason = why_no_specular(request, facts, need, distribution)) {
        stage.reason = reason;
        return stage;
    }
    stage.job = PlannedTable{
        {.size = request.table_size, .axes = request.table_axes, .distribution = distribution},
        request.half_tables};
    stage.reason = "split-sum specular";
    return stage;
}

PlannedStage plan_diffuse(const BakeRequest& request, const BakeFacts& facts, std::size_t mesh,
                          bool shadowed, bool from_glossy = false) {
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
    if (!f.receives) {
        stage.reason = "marked as receiving nothing";
        return stage;
    }
    const MaterialFacts& material = facts.materials[f.material];
    // A metal that has glossy transport shows what light others send, too.
    const bool for_the_lobe = material.max_diffuse_albedo <= 0 && from_glossy;
    if (material.max_diffuse_albedo <= 0 && !(for_the_lobe && request.bounces > 0)) {
        stage.reason = concat("material ", quoted(material.name), " reflects nothing diffusely");
        return stage;
    }
    PlannedDiffuse diffuse;
    diffuse.mesh = mesh;
    diffuse.from_glossy = from_glossy;
    diffuse.job = DiffuseJob{.bands = request.bands,
                             .shadowed = shadowed,
                             .tolerance = request.tolerance,
                             .rays_per_vertex = request.rays_per_vertex,
                             .seed = request.seed,
                             .memory_bytes = request.memory_bytes};
    if (!shadowed)
        stage.reason = "analytic, no rays";
    else if (f.free_vertex_count == f.vertex_count)
        stage.reason = "analytic, no rays: nothing stands above any vertex";
    else if (f.free_vertex_count > 0)
        stage.reason = concat(percentage(static_cast<double>(f.free_vertex_count) /
                                         static_cast<double>(f.vertex_count)),
                              " of the vertices have nothing above them and need no rays");
    else
        stage.reason = "something stands above every vertex";
    if (for_the_lobe) stage.reason = "for the light that surfaces send into the lobe";
    stage.job = diffuse;
    return stage;
}

int glossy_light_bands(const BakeRequest& request) {
    return std::min(request.bands, runtime::kMaxGlossyBands);
}

/// The roughness for which a material's lobe is expanded.
RoughnessRange glossy_range(const BakeRequest& request, const MaterialFacts& material) {
    RoughnessRange range{material.min_roughness, material.max_roughness};
    if (request.glossy != GlossyChoice::All) range.min = std::max(range.min, kLeastGlossyRoughness);
    return range;
}

/// The part of uniform light that a lobe reflects, 2 integral of (R0 A + B) n.v d(n.v): the largest
/// of a range of roughness lies at one of its ends.
double reflected_share(const BakeRequest& request, const RoughnessRange& range, double r0) {
    const Quadrature rule = gauss_legendre(8);
    double largest = 0;
    for (const Distribution distribution : request.distributions) {
        for (const double roughness : {range.min, range.max}) {
            double share = 0;
            for (std::size_t i = 0; i < rule.nodes.size(); ++i) {
                const double x = (1 + rule.nodes[i]) / 2;  // n.v = x^2, as average_albedo has it
                const DVec2 albedo = albedo_integral(distribution, {x * x, roughness}, 16);
                share += rule.weights[i] * 2 * x * x * x * (r0 * albedo.x + albedo.y);
            }
            largest = std::max(largest, share);
        }
    }
    return largest;
}

/// What the plan asks of a material's lobe, worked out for the first mesh that has it.
struct LobeFacts {
    double share = 0;   ///< reflected_share()
    LobeErrors errors;  ///< the worst over its roughness: at its ends and in the middle
    std::vector<AxialForm> of_row, of_reflected;  ///< each of those
};

LobeFacts facts_of_lobe(const BakeRequest& request, const RoughnessRange& range, double r0) {
    LobeFacts facts{reflected_share(request, range, r0), {}, {}, {}};
    LobeErrors& worst = facts.errors;
    for (const Distribution distribution : request.distributions) {
        const LobeExpansionJob job{.distribution = distribution,
                                   .exit_bands = request.glossy_bands,
                                   .light_bands = glossy_light_bands(request)};
        for (const double roughness : {range.min, (range.min + range.max) / 2, range.max}) {
            LobeErrors errors = lobe_errors(job, roughness, r0);
            facts.of_row.push_back(std::move(errors.of_row));
            facts.of_reflected.push_back(std::move(errors.of_reflected));
            worst.per_transport_error =
                std::max(worst.per_transport_error, errors.per_transport_error);
            worst.per_rounding_error =
                std::max(worst.per_rounding_error, errors.per_rounding_error);
            worst.fit = std::max(worst.fit, errors.fit);
            worst.lost = std::max(worst.lost, errors.lost);
            if (range.min == range.max) break;
        }
    }
    return facts;
}

PlannedStage plan_glossy(const BakeRequest& request, const BakeFacts& facts, std::size_t mesh,
                         std::vector<std::optional<LobeFacts>>& lobes) {
    const MeshFacts& f = facts.meshes[mesh];
    const MaterialFacts& material = facts.materials[f.material];
    PlannedStage stage{concat("mesh/", mesh, "/glossy"), "", std::nullopt};
    if (request.glossy == GlossyChoice::None) {
        stage.reason = "not asked for";
        return stage;
    }
    if (f.triangle_count == 0) {
        stage.reason = "no triangles";
        return stage;
    }
    if (!f.receives) {
        stage.reason = "marked as receiving nothing";
        return stage;
    }
    if (!has_lobe(material)) {
        stage.reason = concat("material ", quoted(material.name), " has no specular lobe");
        return stage;
    }
    const RoughnessRange range = glossy_range(request, material);
    if (range.max < range.min) {
        stage.reason = concat("material ", quoted(material.name), " has roughness ",
                              format_number(material.max_roughness), " at most: under ",
                              format_number(kLeastGlossyRoughness),
                              " SH cannot show the lobe, environment/mips can");
        return stage;
    }
    std::optional<LobeFacts>& lobe = lobes[f.material];
    if (!lobe) lobe = facts_of_lobe(request, range, material.max_r0);
    const double share = lobe->share;
    if (request.glossy != GlossyChoice::All && share < request.tolerance) {
        stage.reason = concat("the lobe of material ", quoted(material.name), " reflects ",
                              percentage(share), " of the light, less than the tolerance");
        return stage;
    }
    PlannedGlossy glossy;
    glossy.mesh = mesh;
    glossy.light_bands = glossy_light_bands(request);
    glossy.errors = lobe->errors;
    glossy.with_diffuse = material.max_diffuse_albedo > 0 || request.bounces > 0;
    // Measured on the bunny, Suzanne and a shader ball: 1.15 to 2.7 of what it were with outlines
    // anywhere.
    constexpr double kNearTheHorizon = 1.5;
    glossy.job =
        DiffuseJob{.bands = request.bands,
                   .row_bands = glossy.light_bands + runtime::kExtraVisibilityBands,
                   .tolerance = request.tolerance,
                   .row_use = {lobe->of_row, kNearTheHorizon * glossy.errors.per_transport_error,
                               !(material.max_diffuse_albedo > 0)},
                   .rays_per_vertex = request.rays_per_vertex,
                   .seed = request.seed,
                   .memory_bytes = request.memory_bytes};
    stage.reason =
        concat("the lobe of material ", quoted(material.name), " reflects up to ",
               percentage(share), " of the light; ", request.glossy_bands, " bands miss ",
               percentage(glossy.errors.lost), " of it at roughness ", format_number(range.min));
    if (static_cast<double>(material.min_roughness) < range.min)
        stage.reason += concat("; sharper parts, down to ", format_number(material.min_roughness),
                               ", are for environment/mips");
    stage.job = glossy;
    return stage;
}

PlannedStage plan_lobe(const BakeRequest& request, const BakeFacts& facts,
                       const std::vector<PlannedStage>& glossy_stages, Distribution distribution) {
    const bool ggx = distribution == Distribution::Ggx;
    PlannedStage stage{ggx ? "brdf/ggx_lobe" : "brdf/beckmann_lobe", "", std::nullopt};
    if (request.glossy == GlossyChoice::None || !is_asked_for(request, distribution)) {
        stage.reason = "not asked for";
        return stage;
    }
    RoughnessRange all{1, 0};
    for (const PlannedStage& other : glossy_stages) {
        const auto* glossy = other.job ? std::get_if<PlannedGlossy>(&*other.job) : nullptr;
        if (glossy == nullptr) continue;
        const RoughnessRange range =
            glossy_range(request, facts.materials[facts.meshes[glossy->mesh].material]);
        all.min = std::min(all.min, range.min);
        all.max = std::max(all.max, range.max);
    }
    if (all.max < all.min) {
        stage.reason = "no mesh has glossy transport";
        return stage;
    }
    stage.reason = concat("roughness ", format_number(all.min), " to ", format_number(all.max),
                          ", ", request.glossy_bands, " bands of exit radiance");
    stage.job = PlannedLobe{{.distribution = distribution,
                             .exit_bands = request.glossy_bands,
                             .light_bands = glossy_light_bands(request),
                             .roughness = {all.min, all.max}}};
    return stage;
}

/// Wavelets: transport of the meshes that have diffuse transport, and light to go with it.
void add_wavelet_stages(const BakeRequest& request, const BakeFacts& facts,
                        std::vector<PlannedStage>& stages) {
    std::string lost;
    bool needed = true;
    if (facts.environment) {
        const double loss = facts.environment->sh_shadow_loss;
        needed = loss > request.tolerance;
        lost = concat(request.bands, " bands of SH lose ", percentage(loss),
                      " rms beside a hard shadow");
    }
    PlannedStage light{"environment/wavelet", lost, std::nullopt};
    if (request.wavelet == WaveletUse::Never) {
        light.reason = lost.empty() ? "not asked for" : concat("not asked for; ", lost);
        stages.push_back(std::move(light));
        return;
    }
    if (request.wavelet == WaveletUse::WhereNeeded && !needed) {
        light.reason = concat("not needed: ", lost);
        stages.push_back(std::move(light));
        return;
    }
    const WaveletJob job{.face_size = request.wavelet_size,
                         .tolerance = request.tolerance,
                         .memory_bytes = request.memory_bytes};
    const std::string faces = concat("faces of ", job.face_size, " texels");
    for (std::size_t mesh = 0; mesh < facts.meshes.size(); ++mesh) {
        PlannedStage stage = plan_diffuse(request, facts, mesh, true);
        stage.output = concat("mesh/", mesh, "/wavelet");
        if (stage.job) {
            stage.job = PlannedWavelet{job, mesh};
            stage.reason = concat(faces, "; direct light alone");
        }
        stages.push_back(std::move(stage));
    }
    stages.push_back(
        {"wavelet/weight", "to choose the terms of any map by", PlannedWaveletWeights{job}});
    if (facts.environment) {
        light.reason = concat(faces, "; ", lost, grey_reason(*facts.environment));
        light.job = PlannedWaveletLight{channels_of(*facts.environment)};
    } else {
        light.reason = "no environment";
    }
    stages.push_back(std::move(light));
}

/// Of the tolerance, what the bake gets where the encoding will take some: squares add up. f16 and
/// unorm16 add less than a thousandth. 8 bits add 4e-3 on scans, so that 0.9 would do for a
/// tolerance of 1e-2; clusters take what they get, and 0.8 costs, by the law of the error, a third
/// more rays.
double bake_share(Encoding encoding) {
    switch (encoding) {
        case Encoding::F32:
        case Encoding::F16:
        case Encoding::Unorm16:
            return 1;
        case Encoding::Unorm8:
            return 0.9;
        case Encoding::Clustered:
        case Encoding::Auto:
            break;
    }
    return 0.8;
}

const char* encoding_reason(Encoding encoding) {
    switch (encoding) {
        case Encoding::F32:
            break;
        case Encoding::F16:
            return "f16 was asked for";
        case Encoding::Unorm16:
            return "16 bits over the range of each coefficient were asked for";
        case Encoding::Unorm8:
            return "8 bits over the range of each coefficient were asked for";
        case Encoding::Clustered:
            return "clustered PCA was asked for";
        case Encoding::Auto:
            return "the smallest that keeps to the tolerance";
    }
    return "f32";
}

/// Transport waits for its encoding, and is given less of the tolerance.
void add_encoding_stage(const BakeRequest& request, std::vector<PlannedStage>& stages) {
    if (request.encoding == Encoding::F32) return;
    const double share = bake_share(request.encoding);
    bool any = false;
    for (PlannedStage& stage : stages) {
        if (!stage.job) continue;
        if (auto* bounces = std::get_if<PlannedBounces>(&*stage.job))
            bounces->job.tolerance *= share;
        auto* diffuse = std::get_if<PlannedDiffuse>(&*stage.job);
        if (diffuse == nullptr || !diffuse->job.shadowed) continue;
        diffuse->job.tolerance *= share;
        any = true;
    }
    if (!any) return;
    stages.push_back(
        {"encoding", encoding_reason(request.encoding),
         PlannedEncoding{request.encoding, request.tolerance * std::sqrt(1 - share * share),
                         request.bands}});
}

/// The rays of glossy transport are those of the diffuse transport behind it: they are as many as
/// the stricter of the two needs, whatever took some of the diffuse one's tolerance.
void share_rays(std::vector<PlannedStage>& stages) {
    PlannedGlossy* glossy = nullptr;  // the last one
    for (PlannedStage& stage : stages) {
        if (!stage.job) continue;
        if (auto* found = std::get_if<PlannedGlossy>(&*stage.job)) glossy = found;
        const auto* diffuse = std::get_if<PlannedDiffuse>(&*stage.job);
        if (diffuse == nullptr || !diffuse->from_glossy || !diffuse->job.shadowed) continue;
        glossy->bounces = diffuse->bounces;
        glossy->job.tolerance = std::min(glossy->job.tolerance, diffuse->job.tolerance);
    }
}

/// Of the meshes that have glossy transport, one lobe a material.
LobeLightJob lobes_of_meshes(const BakeRequest& request, const BakeFacts& facts,
                             const std::vector<PlannedStage>& stages,
                             const std::vector<std::optional<LobeFacts>>& of_materials) {
    LobeLightJob job{{}, {}, glossy_light_bands(request)};
    std::vector<std::size_t> lobe_of_material(of_materials.size(), LobeLightJob::kNoLobe);
    for (const PlannedStage& stage : stages) {
        const auto* glossy = stage.job ? std::get_if<PlannedGlossy>(&*stage.job) : nullptr;
        if (glossy == nullptr) continue;
        const std::size_t material = facts.meshes[glossy->mesh].material;
        std::size_t& lobe = lobe_of_material[material];
        if (lobe == LobeLightJob::kNoLobe) {
            lobe = job.errors.size();
            job.errors.push_back(of_materials[material]->of_reflected);
        }
        job.lobe_of_mesh.resize(facts.meshes.size(), LobeLightJob::kNoLobe);
        job.lobe_of_mesh[glossy->mesh] = lobe;
    }
    return job;
}

/// Light between the surfaces of all meshes that have transport.
PlannedStage plan_bounces(const BakeRequest& request, const BakeFacts& facts,
                          const std::vector<PlannedStage>& stages,
                          const std::vector<std::optional<LobeFacts>>& lobes) {
    PlannedStage stage{"bounces", "", std::nullopt};
    if (request.bounces == 0) {
        stage.reason = "not asked for";
        return stage;
    }
    double max_albedo = 0, vertices = 0, blocked = 0;
    bool grey = true, emission = false;
    for (const MeshFacts& f : facts.meshes)
        emission =
            emission || (f.triangle_count > 0 && facts.materials[f.material].max_emission > 0);
    for (const PlannedStage& other : stages) {
        const auto* diffuse = other.job ? std::get_if<PlannedDiffuse>(&*other.job) : nullptr;
        if (diffuse == nullptr || !diffuse->job.shadowed) continue;
        const MeshFacts& f = facts.meshes[diffuse->mesh];
        const MaterialFacts& material = facts.materials[f.material];
        max_albedo = std::max(max_albedo, static_cast<double>(material.max_diffuse_albedo));
        grey = grey && material.grey_albedo;
        vertices += static_cast<double>(f.vertex_count);
        blocked += static_cast<double>(f.vertex_count - f.free_vertex_count);
    }
    if (vertices == 0) {
        stage.reason = "no mesh has transport";
        return stage;
    }
    const double most = most_from_bounces(max_albedo, blocked / vertices, request.bands);
    if (blocked == 0) {
        stage.reason = "no vertex sees a surface";
        return stage;
    }
    if (!emission && most <= request.tolerance / 10) {
        stage.reason = concat("no albedo x form factor reaches the tolerance: all bounces add ",
                              format_number(most), " at most");
        return stage;
    }
    BounceJob job{.bands = request.bands,
                  .channels = grey ? 1 : 3,
                  .bounces = request.bounces,
                  .emission = emission,
                  .tolerance = request.tolerance,
                  .seed = request.seed,
                  .lobes = lobes_of_meshes(request, facts, stages, lobes)};
    // What add_bounces() says of itself, for 32 points a vertex, and the transport.
    const double bytes =
        vertices * (200 + 16 * 32 + 4.0 * (request.bands * request.bands * job.channels + 3));
    stage.reason = concat(
        request.bounces == kAllBounces ? "all of them" : concat("the first ", request.bounces),
        ", of albedo up to ", format_number(max_albedo),
        grey ? "; every albedo is grey: one channel" : "", emission ? "; surfaces shine" : "",
        job.lobes.errors.empty()
            ? ""
            : "; into lobes as their mean, and by direction where the mean errs too much",
        "; transport stays in memory: some ", format_bytes(static_cast<std::uint64_t>(bytes)));
    stage.job = PlannedBounces{job};
    return stage;
}

/// The diffuse transport waits for its bounces, and is given less of the tolerance. What surfaces
/// emit comes with them.
void add_bounces_stage(PlannedStage bounces, std::vector<PlannedStage>& stages) {
    std::vector<PlannedStage> emitted;
    for (PlannedStage& stage : stages) {
        auto* diffuse = stage.job ? std::get_if<PlannedDiffuse>(&*stage.job) : nullptr;
        if (!bounces.job || diffuse == nullptr || !diffuse->job.shadowed) continue;
        diffuse->bounces = true;
        diffuse->job.tolerance *= kDirectShare;
        if (std::get<PlannedBounces>(*bounces.job).job.emission)
            emitted.push_back({concat("mesh/", diffuse->mesh, "/emitted"),
                               "light of the surfaces that shine", PlannedEmitted{diffuse->mesh}});
    }
    stages.push_back(std::move(bounces));
    stages.insert(stages.end(), emitted.begin(), emitted.end());
}

/// Metals have diffuse transport for what bounces send into their lobes; not where nothing bounces.
void drop_transport_of_metals(const BakeFacts& facts, std::vector<PlannedStage>& stages) {
    PlannedGlossy* glossy = nullptr;  // the last one
    for (PlannedStage& stage : stages) {
        if (!stage.job) continue;
        if (auto* found = std::get_if<PlannedGlossy>(&*stage.job)) glossy = found;
        const auto* diffuse = std::get_if<PlannedDiffuse>(&*stage.job);
        if (diffuse == nullptr || !diffuse->from_glossy || diffuse->bounces) continue;
        const MaterialFacts& material = facts.materials[facts.meshes[diffuse->mesh].material];
        if (material.max_diffuse_albedo > 0) continue;
        glossy->with_diffuse = false;
        stage.reason = concat("material ", quoted(material.name), " reflects nothing diffusely");
        stage.job.reset();
    }
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
    if (request.roughness_range &&
        !(request.roughness_range->min >= 0 && request.roughness_range->max <= 1 &&
          request.roughness_range->min <= request.roughness_range->max))
        return usage("--roughness-range ", request.roughness_range->min, " ",
                     request.roughness_range->max, ": 0 <= MIN <= MAX <= 1 are possible");
    if (request.table_size < 2 || request.table_size > 1024)
        return usage("--table-size ", request.table_size, ": 2 to 1024 are possible");
    if (request.glossy_bands < 1 || request.glossy_bands > runtime::kMaxGlossyBands)
        return usage("--glossy-bands ", request.glossy_bands, ": 1 to ", runtime::kMaxGlossyBands,
                     " are possible");
    if (!wavelet::is_face_size(static_cast<std::uint64_t>(request.wavelet_size)))
        return usage("--wavelet ", request.wavelet_size, ": 16, 32, 64 or 128 are possible");
    if (request.bounces < 0) return usage("--bounces ", request.bounces, ": 0 or more, or all");
    if (request.rays_per_vertex < 0 || request.rays_per_vertex > 1 << 20)
        return usage("--rays ", request.rays_per_vertex, ": 1 to 1048576 are possible");
    return {};
}

/// Bytes of a stage's arrays, uncompressed.
struct ArrayBytes {
    const BakeFacts& facts;
    std::uint64_t bounce_channels;

    std::uint64_t operator()(const PlannedLights& lights) const {
        return lights.count * 9 * sizeof(float);
    }
    std::uint64_t operator()(const PlannedSh& sh) const {
        return static_cast<std::uint64_t>(sh.bands * sh.bands * sh.channels) * sizeof(float);
    }
    std::uint64_t operator()(const PlannedMips& mips) const {
        const std::uint64_t squares = mips.job.layout == MipLayout::CubeFaces ? 6 : 8;
        std::uint64_t texels = 0;
        for (const int level : mips.job.levels) {
            const auto n = static_cast<std::uint64_t>(std::max(1, mips.job.face_size >> level));
            texels += squares * n * n;
        }
        return texels * static_cast<std::uint64_t>(mips.job.channels) * sizeof(float);
    }
    /// With the average albedo of every row.
    std::uint64_t operator()(const PlannedTable& table) const {
        const auto size = static_cast<std::uint64_t>(table.job.size);
        return size * size * 2 * (table.half ? 2 : sizeof(float)) + size * sizeof(float);
    }
    std::uint64_t operator()(const PlannedLobe& lobe) const {
        const double steps = 32 * (lobe.job.roughness[1] - lobe.job.roughness[0]);
        const int exit = lobe.job.exit_bands;
        return static_cast<std::uint64_t>(std::ceil(steps) + 1) * 2 * sizeof(float) *
               (runtime::lobe_size(exit, lobe.job.light_bands) +
                runtime::lobe_size(exit, runtime::kLobeBands));
    }
    std::uint64_t operator()(const PlannedGlossy& glossy) const {
        const auto coeffs = static_cast<std::uint64_t>(glossy.job.row_bands * glossy.job.row_bands);
        return facts.meshes[glossy.mesh].vertex_count * (coeffs + 3) * sizeof(float);
    }
    std::uint64_t operator()(const PlannedDiffuse& diffuse) const {
        const auto coeffs = static_cast<std::uint64_t>(diffuse.job.bands * diffuse.job.bands);
        return facts.meshes[diffuse.mesh].vertex_count * coeffs * sizeof(float) *
               (diffuse.bounces ? bounce_channels : 1);
    }
    std::uint64_t operator()(const PlannedBounces&) const { return 0; }
    /// Ascending with the area of faces and the tolerance: measured on a scan, which has the most.
    std::uint64_t operator()(const PlannedWavelet& planned) const {
        const double n = planned.job.face_size;
        return facts.meshes[planned.mesh].vertex_count * static_cast<std::uint64_t>(2.5 * n * n);
    }
    std::uint64_t operator()(const PlannedWaveletWeights& weights) const {
        return wavelet::coeff_count(weights.job.face_size) * sizeof(float);
    }
    /// As the most that photographs needed.
    std::uint64_t operator()(const PlannedWaveletLight& light) const {
        return 128 * static_cast<std::uint64_t>(1 + light.channels) * sizeof(float);
    }
    std::uint64_t operator()(const PlannedEncoding&) const { return 0; }
    std::uint64_t operator()(const PlannedEmitted& emitted) const {
        return facts.meshes[emitted.mesh].vertex_count * 3 * sizeof(float);
    }
};

/// Adds up what the stages will cost. The ray count is the transport stage's own prediction.
void estimate_cost(BakePlan& plan, const BakeFacts& facts) {
    std::uint64_t bounce_channels = 1;
    for (const PlannedStage& stage : plan.stages)
        if (const auto* bounces = stage.job ? std::get_if<PlannedBounces>(&*stage.job) : nullptr)
            bounce_channels = static_cast<std::uint64_t>(bounces->job.channels);
    for (const PlannedStage& stage : plan.stages) {
        if (!stage.job) continue;
        plan.output_bytes += std::visit(ArrayBytes{facts, bounce_channels}, *stage.job);
        const auto add_rays = [&](std::size_t mesh, const DiffuseJob& job) {
            const MeshFacts& f = facts.meshes[mesh];
            plan.ray_count += (f.vertex_count - f.free_vertex_count) *
                              static_cast<std::uint64_t>(expected_rays_per_vertex(job));
        };
        if (const auto* glossy = std::get_if<PlannedGlossy>(&*stage.job))
            add_rays(glossy->mesh, glossy->job);
        if (const auto* w = std::get_if<PlannedWavelet>(&*stage.job)) {
            const MeshFacts& f = facts.meshes[w->mesh];
            plan.ray_count += (f.vertex_count - f.free_vertex_count) *
                              static_cast<std::uint64_t>(expected_wavelet_rays(w->job));
        }
        const auto* diffuse = std::get_if<PlannedDiffuse>(&*stage.job);
        if (diffuse != nullptr && diffuse->job.shadowed && !diffuse->from_glossy)
            add_rays(diffuse->mesh, diffuse->job);
    }
}

}  // namespace

Expected<BakePlan> make_plan(const BakeRequest& request, const BakeFacts& facts) {
    ENVBAKE_TRY_VOID(check_request(request, facts));
    const SpecularNeed need = specular_need(facts);
    BakePlan plan;
    plan.stages.push_back(plan_lights(request, facts));
    plan.stages.push_back(plan_sh(request, facts, /*irradiance=*/false));
    plan.stages.push_back(plan_sh(request, facts, /*irradiance=*/true));
    for (const Distribution d : {Distribution::Ggx, Distribution::Beckmann})
        plan.stages.push_back(plan_mips(request, facts, need, d));
    for (const Distribution d : {Distribution::Ggx, Distribution::Beckmann})
        plan.stages.push_back(plan_table(request, facts, need, d));
    std::vector<PlannedStage> glossy;
    std::vector<std::optional<LobeFacts>> lobes(facts.materials.size());
    for (std::size_t mesh = 0; mesh < facts.meshes.size(); ++mesh)
        glossy.push_back(plan_glossy(request, facts, mesh, lobes));
    if (facts.has_scene)
        for (const Distribution d : {Distribution::Ggx, Distribution::Beckmann})
            plan.stages.push_back(plan_lobe(request, facts, glossy, d));
    for (std::size_t mesh = 0; mesh < facts.meshes.size(); ++mesh) {
        plan.stages.push_back(std::move(glossy[mesh]));
        const bool from_glossy = plan.stages.back().job.has_value();
        plan.stages.push_back(plan_diffuse(request, facts, mesh, true, from_glossy));
        if (!facts.meshes[mesh].casts)
            plan.stages.back().reason += "; the mesh is marked as casting nothing";
        plan.stages.push_back(plan_diffuse(request, facts, mesh, false));
    }
    if (facts.has_scene) {
        add_bounces_stage(plan_bounces(request, facts, plan.stages, lobes), plan.stages);
        drop_transport_of_metals(facts, plan.stages);
    } else {
        plan.stages.push_back({"mesh", "no scene", std::nullopt});
    }
    add_wavelet_stages(request, facts, plan.stages);
    add_encoding_stage(request, plan.stages);
    share_rays(plan.stages);
    estimate_cost(plan, facts);
    return plan;
}

}  // namespace envbake
