// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/shard.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace envbake {

namespace {

template <class Enum>
bool one_of(Enum value, Enum last) {
    return static_cast<int>(value) >= 0 && static_cast<int>(value) <= static_cast<int>(last);
}
bool within(double value, double most) {
    return value >= 0 && value <= most;
}
bool is_finite(const DVec3& v) {
    return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

bool is_sound(const BakeRequest& request) {
    return !request.distributions.empty() && request.distributions.size() <= 2 &&
           std::all_of(request.distributions.begin(), request.distributions.end(),
                       [](auto d) { return one_of(d, runtime::Distribution::Beckmann); }) &&
           one_of(request.mip_layout, runtime::MipLayout::LatLong) &&
           one_of(request.table_axes, runtime::TableAxes::LinearCentres) &&
           one_of(request.glossy, GlossyChoice::All) &&
           one_of(request.wavelet, WaveletUse::Always) &&
           one_of(request.encoding, Encoding::Auto) && one_of(request.isa, Isa::Avx512);
}

bool is_sound(const MaterialFacts& material) {
    return within(material.min_roughness, material.max_roughness) &&
           within(material.max_roughness, 1) && within(material.max_r0, 1) &&
           within(material.max_diffuse_albedo, 1) && material.max_emission >= 0 &&
           std::isfinite(material.max_emission);
}

bool is_sound(const BakeFacts& facts) {
    std::uint64_t vertices = 0;
    for (const MeshFacts& mesh : facts.meshes) {
        if (mesh.vertex_count > kMaxVertices - vertices || mesh.triangle_count > kMaxVertices ||
            mesh.free_vertex_count > mesh.vertex_count || mesh.material >= facts.materials.size())
            return false;
        vertices += mesh.vertex_count;
    }
    return facts.has_scene != facts.meshes.empty() &&
           std::all_of(facts.materials.begin(), facts.materials.end(),
                       [](const MaterialFacts& material) { return is_sound(material); });
}

bool is_sound(const EnvironmentFacts& environment, const BakeInputs& inputs, int bands) {
    // Radiance is that of floats: no sum over a sphere of them is near this.
    constexpr double kMost = 1e45;
    const LightFacts& lights = environment.lights;
    const auto sound_light = [=](const DominantLight& light) {
        return is_finite(light.direction) && is_finite(light.irradiance) &&
               within(light.angular_radius, 4) && within(light.solid_angle, 13) &&
               within(light.share, kMost);
    };
    return within(environment.mean, kMost) && within(environment.peak, kMost) &&
           within(environment.contrast, kMost) && within(lights.share, kMost) &&
           within(lights.strongest_share, kMost) && within(environment.sh_shadow_loss, kMost) &&
           environment.band_energy.size() == static_cast<std::size_t>(bands) &&
           std::all_of(environment.band_energy.begin(), environment.band_energy.end(),
                       [](double energy) { return within(energy, 1e90); }) &&
           lights.count == inputs.lights.lights.size() &&
           std::all_of(inputs.lights.lights.begin(), inputs.lights.lights.end(), sound_light) &&
           inputs.sh->bands == bands &&
           inputs.sh->coeffs.size() ==
               static_cast<std::size_t>(bands) * static_cast<std::size_t>(bands) &&
           std::all_of(inputs.sh->coeffs.begin(), inputs.sh->coeffs.end(), is_finite);
}

/// describe_bake() without its keys, as far as it follows from the rest.
bool is_description(const Json& shared, const SharedState& state, const BakePlan& plan) {
    const BakeFacts& facts = state.inputs.facts;
    Json stages = shared.at("plan");
    for (Json& stage : stages) {
        if (stage.contains("key") && !stage.at("key").is_string()) return false;
        if (stage.is_object()) stage.erase("key");
    }
    if (stages != plan_json(plan) || shared.at("options") != options_json(state.request) ||
        !shared.at("conventions").is_object() ||
        shared.contains("environment") != facts.environment.has_value() ||
        shared.contains("scene") != facts.has_scene || shared.contains("meshes") != facts.has_scene)
        return false;
    if (facts.environment && !shared.at("environment").is_object()) return false;
    if (!facts.has_scene) return true;
    const Json& meshes = shared.at("meshes");
    if (!meshes.is_array() || meshes.size() != facts.meshes.size()) return false;
    for (std::size_t i = 0; i < meshes.size(); ++i)
        if (!meshes[i].is_object() || meshes[i].at("vertex_count") != facts.meshes[i].vertex_count)
            return false;
    return true;
}

}  // namespace

Expected<BakePlan> plan_of_shards(const Json& shared, const SharedState& state) {
    const Error contradicts{Errc::InvalidBundle,
                            "its metadata contradicts itself; bake this shard again"};
    const BakeInputs& inputs = state.inputs;
    const bool sound = is_sound(state.request) && is_sound(inputs.facts) &&
                       state.request.bands >= 1 && state.request.bands <= 10 &&
                       (!inputs.facts.environment ||
                        is_sound(*inputs.facts.environment, inputs, state.request.bands));
    if (!sound) return contradicts;
    auto plan = make_plan(state.request, inputs.facts);
    if (!plan || !is_description(shared, state, *plan)) return contradicts;
    return plan;
}

}  // namespace envbake
