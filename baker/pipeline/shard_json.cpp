// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/shard.h"

#include <limits>

namespace envbake {

// Numbers come back as they were: JSON holds doubles by their shortest exact text.
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RoughnessRange, min, max)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(LightFacts, count, share, strongest_share)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(EnvironmentFacts, mean, peak, contrast, grey, lights,
                                   sh_shadow_loss, band_energy)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(MaterialFacts, name, min_roughness, max_roughness, max_r0,
                                   max_diffuse_albedo, grey_albedo, max_emission)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(MeshFacts, vertex_count, triangle_count, free_vertex_count,
                                   material, receives, casts)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(FileHash, bytes, xxh3)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(InputFile, role, name, hash)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(BakeRequest, tolerance, bands, extract_lights, irradiance,
                                   window, distributions, mip_size, mip_count, certify, mip_layout,
                                   table_size, table_axes, half_tables, not_receiving, not_casting,
                                   bounces, glossy, glossy_bands, unshadowed, wavelet, wavelet_size,
                                   encoding, rays_per_vertex, isa, seed, memory_bytes, strict,
                                   area_weighted_normals, compress)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(CrossingError, per_crossing, solved, samples)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(DiffuseReport, vertex_count, unreferenced_count, merged_count,
                                   free_count, traced_count, solved_count, ray_count,
                                   check_ray_count, rays_per_vertex, repeated_ray_count, error_rms,
                                   error_p999, row_error, crossing_error, crossings)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(WaveletReport, vertex_count, unreferenced_count, free_count,
                                   traced_count, ray_count, coeff_count, byte_count)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(BrdfTable, size, texel_error, lookup_error, lookup_error_rms,
                                   sharp_lookup_error)

namespace {

template <class T>
Json to(const T& value) {
    return Json(nlohmann::json(value));
}
/// Throws where `json` lacks a value that `like` has, or has one of another kind: the library
/// itself makes 2^64 - 1 of -1, and any integer of 1e300.
void require_kinds(const Json& like, const Json& json) {
    bool same = like.type() == json.type();
    if (like.is_number_unsigned()) {
        same = json.is_number_unsigned();
    } else if (like.is_number_integer()) {  // an int, or an enumeration
        constexpr auto kMost = std::numeric_limits<int>::max();
        same = json.is_number_unsigned()
                   ? json.get<std::uint64_t>() <= std::uint64_t{kMost}
                   : json.is_number_integer() && json.get<std::int64_t>() >= -std::int64_t{kMost};
    } else if (like.is_number()) {
        same = json.is_number();
    }
    if (!same)
        throw Json::type_error::create(
            302, concat("type must be ", like.type_name(), ", but is ", json.type_name()), &json);
    if (like.is_object())
        for (const auto& [key, value] : like.items()) require_kinds(value, json.at(key));
    if (like.is_array() && !like.empty())
        for (const Json& element : json) require_kinds(like.front(), element);
}

/// A value whose lists are not empty, unless nothing else than what they hold can be read from
/// JSON.
template <class T>
T example() {
    return {};
}
template <>
DiffuseReport example() {
    DiffuseReport report;
    report.crossings = {0};
    return report;
}

template <class T>
void from(const Json& json, T& value) {
    require_kinds(to(example<T>()), json);
    nlohmann::json(json).get_to(value);
}
template <class T>
void from(const Json& json, std::vector<T>& values) {
    require_kinds(Json::array(), json);
    for (const Json& element : json) from(element, values.emplace_back());
}

Json to_list(const DVec3& v) {
    return {v.x, v.y, v.z};
}
DVec3 to_vector(const Json& json) {
    return {json.at(0).get<double>(), json.at(1).get<double>(), json.at(2).get<double>()};
}

Json lighting_json(const BakeInputs& inputs) {
    Json lights = Json::array(), coeffs = Json::array();
    for (const DominantLight& light : inputs.lights.lights)
        lights.push_back({{"direction", to_list(light.direction)},
                          {"irradiance", to_list(light.irradiance)},
                          {"angular_radius", light.angular_radius},
                          {"solid_angle", light.solid_angle},
                          {"share", light.share}});
    for (const DVec3& coeff : inputs.sh->coeffs) coeffs.push_back(to_list(coeff));
    return {{"lights", std::move(lights)}, {"bands", inputs.sh->bands}, {"sh", std::move(coeffs)}};
}

void read_lighting(const Json& json, BakeInputs& inputs) {
    require_kinds(Json::array(), json.at("lights"));
    require_kinds(Json::array(), json.at("sh"));
    for (const Json& of : json.at("lights")) {
        DominantLight light;
        light.direction = to_vector(of.at("direction"));
        light.irradiance = to_vector(of.at("irradiance"));
        of.at("angular_radius").get_to(light.angular_radius);
        of.at("solid_angle").get_to(light.solid_angle);
        of.at("share").get_to(light.share);
        inputs.lights.lights.push_back(light);
    }
    ShLighting& sh = inputs.sh.emplace();
    from(json.at("bands"), sh.bands);
    for (const Json& coeff : json.at("sh")) sh.coeffs.push_back(to_vector(coeff));
}

}  // namespace

Json shared_json(const BakeRequest& request, const BakeInputs& inputs, const Json& described) {
    Json shared = described;
    shared["request"] = to(request);
    if (request.roughness_range)
        shared["request"]["roughness_range"] = to(*request.roughness_range);
    shared["files"] = to(inputs.files);
    shared["facts"] = {{"has_scene", inputs.facts.has_scene},
                       {"materials", to(inputs.facts.materials)},
                       {"meshes", to(inputs.facts.meshes)}};
    if (inputs.facts.environment) {
        shared["facts"]["environment"] = to(*inputs.facts.environment);
        shared["lighting"] = lighting_json(inputs);
    }
    // Neither the bytes nor the shares depend on it.
    shared["request"].erase("memory_bytes");
    return shared;
}

SharedState read_shared(const Json& shared) {
    SharedState state;
    Json request = shared.at("request");
    request["memory_bytes"] = state.request.memory_bytes;
    from(request, state.request);
    if (request.contains("roughness_range"))
        from(request.at("roughness_range"), state.request.roughness_range.emplace());
    from(shared.at("files"), state.inputs.files);
    const Json& facts = shared.at("facts");
    facts.at("has_scene").get_to(state.inputs.facts.has_scene);
    from(facts.at("materials"), state.inputs.facts.materials);
    from(facts.at("meshes"), state.inputs.facts.meshes);
    if (facts.contains("environment")) {
        from(facts.at("environment"), state.inputs.facts.environment.emplace());
        read_lighting(shared.at("lighting"), state.inputs);
    }
    return state;
}

std::uint64_t read_count(const Json& json) {
    std::uint64_t count = 0;
    from(json, count);
    return count;
}

Json report_json(const DiffuseReport& report) {
    return to(report);
}
Json report_json(const WaveletReport& report) {
    return to(report);
}
Json report_json(const BrdfTable& table) {
    return to(table);
}
void read_report(const Json& json, DiffuseReport& report) {
    from(json, report);
}
void read_report(const Json& json, WaveletReport& report) {
    from(json, report);
}
void read_report(const Json& json, BrdfTable& table) {
    from(json, table);
}

}  // namespace envbake
