// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/metadata.h"

#include "baker/pipeline/stage_key.h"

#include <charconv>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace envbake {

namespace {

const char* axes_name(runtime::TableAxes axes) {
    return axes == runtime::TableAxes::RootsEndPoints ? "roots" : "linear";
}

const char* axes_in_words(runtime::TableAxes axes) {
    return axes == runtime::TableAxes::RootsEndPoints
               ? "texel (i, j) of n holds roughness (i / (n - 1))^2 and n.v (j / (n - 1))^4"
               : "texel (i, j) of n holds roughness (i + 1/2) / n and n.v (j + 1/2) / n";
}

Json distribution_names(const BakeRequest& request) {
    Json names = Json::array();
    for (const runtime::Distribution d : request.distributions)
        names.push_back(d == runtime::Distribution::Ggx ? "ggx" : "beckmann");
    return names;
}

const char* glossy_name(GlossyChoice choice) {
    switch (choice) {
        case GlossyChoice::None:
            break;
        case GlossyChoice::WhereItShows:
            return "auto";
        case GlossyChoice::All:
            return "all";
    }
    return "none";
}

Json wavelet_option(const BakeRequest& request) {
    if (request.wavelet == WaveletUse::Always) return request.wavelet_size;
    return request.wavelet == WaveletUse::WhereNeeded ? "auto" : "off";
}

Json range_json(const std::optional<RoughnessRange>& range) {
    return range ? Json{range->min, range->max} : Json();
}

Json conventions() {
    return {
        {"space", "glTF world space: right-handed, +Y up, metres"},
        {"radiance", "linear, scene-referred, Rec. 709 primaries, not tone-mapped, not clamped"},
        {"cube_faces", "+X -X +Y -Y +Z -Z, OpenGL/KTX orientation, rows from the top"},
        {"sh",
         "real, orthonormal, no Condon-Shortley phase, polar axis +Z: Y_1 = sqrt(3/4pi) (y, z, x); "
         "index l*l + l + m"},
        {"lighting", "l_i = integral of L(w) Y_i(w) dw"},
        {"diffuse",
         "T_i = 1/pi integral of V(w) max(0, n.w) Y_i(w) dw, with bounces the light that surfaces "
         "reflect in place of V = 0; exit radiance = albedo * (sum_i l_i T_i + emitted)"},
        {"glossy",
         "V_i = 1/pi integral of V(w) max(0, n.w) Y_i(w) dw without bounces, to six bands more "
         "than "
         "the lighting; with mesh/I/normal and brdf/..._lobe it makes the matrices t of exit "
         "radiance sum_j (sum_i l_i t_ij) Y_j(o), t = R0 a + b"},
        {"reflected",
         "r_qi: to the blocked directions of a vertex surfaces send a mean, by mesh/I/diffuse, and "
         "sum_q (sum_i l_i r_qi) (Y_q(w) - mean of Y_q) more"},
        {"emitted", "what surfaces that shine send to a vertex, 1/pi integral of L cos, RGB"},
        {"roughness", "perceptual, alpha = roughness^2; mip k of n holds roughness k / (n - 1)"},
        {"mips",
         "N = V = R: integral of L(l) w(l) over integral of w(l), w(l) = D(h) max(0, n.l), D is "
         "GGX "
         "or Beckmann by the array's name"},
        {"brdf",
         "specular albedo = R0 A + B, GGX or Beckmann by the array's name, height-correlated "
         "Smith, Schlick"},
        {"wavelet",
         "2D Haar, orthonormal, non-standard decomposition, on each cube face; lighting is "
         "radiance "
         "times solid angle of a texel, transport 1/pi of the texel's mean of V(w) max(0, n.w)"},
        {"lights",
         "rows of direction towards the light, irradiance RGB of a surface that faces it, angular "
         "radius, solid angle, share of the environment's energy"},
    };
}

Json inputs_json(const std::vector<InputFile>& files) {
    Json list = Json::array();
    for (const InputFile& file : files)
        list.push_back({{"role", file.role},
                        {"name", file.name},
                        {"bytes", file.hash.bytes},
                        {"xxh3", file.hash.xxh3}});
    return list;
}

Json mips_json(const BakeReport::Lobe& lobe, int count) {
    Json levels = Json::array();
    for (const auto& level : lobe.mip_levels) {
        Json json = {{"level", level.level}};
        if (level.faces == 6) {
            json["face_size"] = level.width;
        } else {
            json["width"] = level.width;
            json["height"] = level.height;
        }
        json["roughness"] = level.roughness;
        levels.push_back(std::move(json));
    }
    return {{"count", count}, {"levels", levels}};
}

Json window_json(const ShWindow& window) {
    return {{"lambda", window.lambda},
            {"factors", window.factors},
            {"irradiance_rms_loss", rounded(window.rms_loss)},
            {"irradiance_peak_kept", rounded(window.peak_kept)}};
}

Json environment_json(const BakeRequest& request, const Environment& environment,
                      const EnvironmentFacts& facts) {
    Json json;
    if (const auto* grid = std::get_if<LatLongGrid>(&environment.grid)) {
        json["mapping"] = "latitude-longitude";
        json["width"] = grid->width;
        json["height"] = grid->height;
    } else {
        json["mapping"] = "cube";
        json["face_size"] = std::get<CubeGrid>(environment.grid).size;
    }
    json["mean"] = rounded(facts.mean);
    json["peak"] = facts.peak;
    json["contrast"] = rounded(facts.contrast);
    json["grey"] = facts.grey;
    json["repaired"] = {{"nan", environment.repairs.nan_count},
                        {"infinite", environment.repairs.infinite_count},
                        {"negative", environment.repairs.negative_count}};
    if (facts.lights.count > 0)
        json["lights"] = {{"count", facts.lights.count},
                          {"share", rounded(facts.lights.share)},
                          {"extracted", request.extract_lights}};
    json["sh_shadow_loss"] = rounded(facts.sh_shadow_loss);
    return json;
}

Json table_json(const BrdfTable& table, runtime::TableAxes axes) {
    return {{"axes", axes_name(axes)},
            {"axes_in_words", axes_in_words(axes)},
            {"texel_error", rounded(table.texel_error)},
            {"lookup_error", rounded(table.lookup_error)},
            {"lookup_error_rms", rounded(table.lookup_error_rms)},
            {"lookup_error_from_roughness", kSharpestRoughness},
            {"lookup_error_of_sharper_lobes", rounded(table.sharp_lookup_error)}};
}

Json diffuse_json(const DiffuseReport& r) {
    return {{"rays_per_vertex", r.rays_per_vertex},
            {"rays", r.ray_count},
            {"check_rays", r.check_ray_count},
            {"traced", r.traced_count},
            {"solved", r.solved_count},
            {"free", r.free_count},
            {"merged", r.merged_count},
            {"unreferenced", r.unreferenced_count},
            {"error_rms", rounded(r.error_rms)},
            {"error_p999", rounded(r.error_p999)}};
}

Json encoding_json(const BakeReport::Encoding& e) {
    return {{"name", e.name},
            {"error_rms", rounded(e.error_rms)},
            {"error_worst", rounded(e.error_worst)}};
}

Json bounces_json(const BounceReport& r) {
    return {{"count", r.bounces},
            {"every_blocked_ray", rounded(r.stride)},
            {"points", r.point_count},
            {"points_on_black_backs", r.black_back_count},
            {"shrink", rounded(r.shrink)},
            {"left_out", std::isfinite(r.left_out) ? Json(rounded(r.left_out)) : Json()},
            {"error_rms", rounded(r.error_rms)},
            {"error_p999", rounded(r.error_p999)},
            {"emitted_error_rms", rounded(r.emitted_error_rms)}};
}

Json glossy_json(const BakeReport::Glossy& g) {
    Json json = {
        {"light_bands", g.light_bands},           {"rays", g.rays.ray_count},
        {"error_rms", rounded(g.error_rms)},      {"error_p999", rounded(g.error_p999)},
        {"expansion_error", rounded(g.lobe.fit)}, {"lost_by_exit_bands", rounded(g.lobe.lost)}};
    if (g.reflected)
        json["reflected"] = {{"bands", g.reflected->bands},
                             {"every_blocked_ray", rounded(g.reflected->stride)},
                             {"error_rms", rounded(g.reflected->error_rms)},
                             {"error_p999", rounded(g.reflected->error_p999)}};
    return json;
}

Json lobe_json(const BakeReport::ExpandedLobe& lobe) {
    return {{"exit_bands", lobe.job.exit_bands},
            {"light_bands", lobe.job.light_bands},
            {"roughness", {lobe.job.roughness[0], lobe.job.roughness[1]}}};
}

Json wavelet_json(const WaveletSummary& wavelet) {
    Json json = {{"face_size", wavelet.face_size}};
    if (wavelet.step > 0) json["step"] = wavelet.step;
    if (wavelet.light)
        json["light"] = {{"terms", wavelet.light->term_count},
                         {"of", wavelet.light->coeff_count},
                         {"truncation", rounded(wavelet.light->truncation)}};
    return json;
}

Json wavelet_mesh_json(const WaveletReport& r) {
    return {{"rays", r.ray_count},
            {"traced", r.traced_count},
            {"free", r.free_count},
            {"unreferenced", r.unreferenced_count},
            {"coefficients", r.coeff_count}};
}

Json meshes_json(const Scene& scene) {
    Json list = Json::array();
    for (const Mesh& mesh : scene.meshes) {
        Json json = {{"node", mesh.node},
                     {"node_name", mesh.node_name},
                     {"mesh", mesh.mesh},
                     {"mesh_name", mesh.mesh_name},
                     {"primitive", mesh.primitive},
                     {"material", scene.materials[static_cast<std::size_t>(mesh.material)].name},
                     {"vertex_count", mesh.vertex_count()},
                     {"triangle_count", mesh.triangle_count()},
                     {"normals", mesh.normals_computed ? "computed" : "from the file"}};
        if (!mesh.receives) json["receives"] = false;
        if (!mesh.casts) json["casts"] = false;
        list.push_back(std::move(json));
    }
    return list;
}

void add_reports(Json& meshes, const BakeReport& report) {
    for (std::size_t i = 0; i < meshes.size(); ++i) {
        Json& json = meshes[i];
        if (report.diffuse[i]) json["diffuse"] = diffuse_json(*report.diffuse[i]);
        if (report.glossy[i]) json["glossy"] = glossy_json(*report.glossy[i]);
        if (report.wavelet)
            for (const auto& [index, r] : report.wavelet->meshes)
                if (index == i) json["wavelet"] = wavelet_mesh_json(r);
        if (i < report.encodings.size() && !report.encodings[i].name.empty())
            json["diffuse"]["encoding"] = encoding_json(report.encodings[i]);
    }
}

template <class T>
void read(const Json& json, const char* member, T& value) {
    value = json.at(member).get<T>();
}

}  // namespace

double rounded(double value) {
    char text[32];
    const auto written =
        std::to_chars(text, std::end(text), value, std::chars_format::scientific, 2);
    std::from_chars(text, written.ptr, value);
    return value;
}

void read_table(const Json& json, BrdfTable& table) {
    read(json, "texel_error", table.texel_error);
    read(json, "lookup_error", table.lookup_error);
    read(json, "lookup_error_rms", table.lookup_error_rms);
    read(json, "lookup_error_of_sharper_lobes", table.sharp_lookup_error);
}

DiffuseReport read_diffuse(const Json& json) {
    DiffuseReport r;
    read(json, "rays_per_vertex", r.rays_per_vertex);
    read(json, "rays", r.ray_count);
    read(json, "check_rays", r.check_ray_count);
    read(json, "traced", r.traced_count);
    read(json, "solved", r.solved_count);
    read(json, "free", r.free_count);
    read(json, "merged", r.merged_count);
    read(json, "unreferenced", r.unreferenced_count);
    read(json, "error_rms", r.error_rms);
    read(json, "error_p999", r.error_p999);
    return r;
}

BakeReport::Encoding read_encoding(const Json& json) {
    BakeReport::Encoding e;
    read(json, "name", e.name);
    read(json, "error_rms", e.error_rms);
    read(json, "error_worst", e.error_worst);
    return e;
}

BounceReport read_bounces(const Json& json) {
    BounceReport r;
    read(json, "count", r.bounces);
    read(json, "every_blocked_ray", r.stride);
    read(json, "points", r.point_count);
    read(json, "points_on_black_backs", r.black_back_count);
    read(json, "shrink", r.shrink);
    r.left_out = std::numeric_limits<double>::infinity();
    if (!json.at("left_out").is_null()) read(json, "left_out", r.left_out);
    read(json, "error_rms", r.error_rms);
    read(json, "error_p999", r.error_p999);
    read(json, "emitted_error_rms", r.emitted_error_rms);
    return r;
}

BakeReport::Glossy read_glossy(const Json& json, const LobeErrors& lobe) {
    BakeReport::Glossy g;
    g.lobe = lobe;
    read(json, "light_bands", g.light_bands);
    read(json, "rays", g.rays.ray_count);
    read(json, "error_rms", g.error_rms);
    read(json, "error_p999", g.error_p999);
    if (const auto reflected = json.find("reflected"); reflected != json.end()) {
        g.reflected.emplace();
        read(*reflected, "bands", g.reflected->bands);
        read(*reflected, "every_blocked_ray", g.reflected->stride);
        read(*reflected, "error_rms", g.reflected->error_rms);
        read(*reflected, "error_p999", g.reflected->error_p999);
    }
    return g;
}

WaveletLightSummary read_wavelet_light(const Json& json) {
    WaveletLightSummary light;
    read(json, "terms", light.term_count);
    read(json, "of", light.coeff_count);
    read(json, "truncation", light.truncation);
    return light;
}

WaveletReport read_wavelet_mesh(const Json& json) {
    WaveletReport r;
    read(json, "rays", r.ray_count);
    read(json, "traced", r.traced_count);
    read(json, "free", r.free_count);
    read(json, "unreferenced", r.unreferenced_count);
    read(json, "coefficients", r.coeff_count);
    return r;
}

std::string tool_version() {
    return ENVBAKE_VERSION;
}

const char* encoding_name(Encoding encoding) {
    constexpr const char* kNames[] = {"f32", "f16", "unorm16", "unorm8", "cpca", "auto"};
    return kNames[static_cast<std::size_t>(encoding)];
}

Json shard_json(const std::optional<Shard>& shard) {
    return shard ? Json{shard->index, shard->count} : Json();
}

Json options_json(const BakeRequest& r) {
    return {{"tolerance", r.tolerance},
            {"bands", r.bands},
            {"extract_lights", r.extract_lights},
            {"irradiance", r.irradiance},
            {"window", r.window},
            {"distributions", distribution_names(r)},
            {"mip_size", r.mip_size},
            {"mip_count", r.mip_count},
            {"certify", r.certify},
            {"mip_layout", r.mip_layout == runtime::MipLayout::CubeFaces ? "cube" : "lat-long"},
            {"roughness_range", range_json(r.roughness_range)},
            {"table_size", r.table_size},
            {"table_axes", axes_name(r.table_axes)},
            {"table_type", r.half_tables ? "f16" : "f32"},
            {"no_receive", r.not_receiving},
            {"no_cast", r.not_casting},
            {"glossy", glossy_name(r.glossy)},
            {"glossy_bands", r.glossy_bands},
            {"unshadowed", r.unshadowed},
            {"bounces", r.bounces == kAllBounces ? Json("all") : Json(r.bounces)},
            {"wavelet", wavelet_option(r)},
            {"encoding", encoding_name(r.encoding)},
            {"rays", r.rays_per_vertex},
            {"time_budget", r.time_budget},
            {"isa", isa_name(r.isa)},
            {"seed", r.seed},
            {"strict", r.strict},
            {"normals", r.area_weighted_normals ? "area" : "angle"},
            {"compress", r.compress}};
}

Json plan_json(const BakePlan& plan) {
    Json list = Json::array();
    for (const PlannedStage& stage : plan.stages)
        list.push_back({{"output", stage.output},
                        {"decision", stage.job ? "bake" : "skip"},
                        {"reason", stage.reason}});
    return list;
}

Json describe_bake(const BakeRequest& request, const BakeInputs& inputs, const BakePlan& plan) {
    Json json;
    json["tool"] = {{"name", "envbake"}, {"version", tool_version()}};
    json["inputs"] = inputs_json(inputs.files);
    json["options"] = options_json(request);
    json["conventions"] = conventions();
    if (inputs.environment)
        json["environment"] =
            environment_json(request, *inputs.environment, *inputs.facts.environment);
    if (inputs.scene) {
        json["scene"] = {{"materials", inputs.scene->materials.size()},
                         {"notes", inputs.scene->notes}};
        json["meshes"] = meshes_json(*inputs.scene);
    }
    json["plan"] = plan_json(plan);
    const std::vector<std::string> keys = stage_keys(request, inputs, plan);
    for (std::size_t i = 0; i < keys.size(); ++i)
        if (!keys[i].empty()) json["plan"][i]["key"] = keys[i];
    return json;
}

Json metadata_json(const Json& described, const BakeRequest& request, const BakeReport& report) {
    Json json;
    for (const char* name : {"tool", "inputs", "options", "conventions"})
        json[name] = described.at(name);
    if (described.contains("environment")) {
        Json& environment = json["environment"] = described.at("environment");
        if (report.window) environment["window"] = window_json(*report.window);
        if (!report.ggx.mip_levels.empty())
            environment["mips"] = mips_json(report.ggx, report.mip_count);
        if (!report.beckmann.mip_levels.empty())
            environment["mips_beckmann"] = mips_json(report.beckmann, report.mip_count);
    }
    if (report.ggx.table) json["brdf"]["ggx"] = table_json(*report.ggx.table, request.table_axes);
    if (report.beckmann.table)
        json["brdf"]["beckmann"] = table_json(*report.beckmann.table, request.table_axes);
    if (report.ggx_lobe) json["brdf"]["ggx_lobe"] = lobe_json(*report.ggx_lobe);
    if (report.beckmann_lobe) json["brdf"]["beckmann_lobe"] = lobe_json(*report.beckmann_lobe);
    if (report.wavelet) json["wavelet"] = wavelet_json(*report.wavelet);
    if (report.bounces) json["bounces"] = bounces_json(*report.bounces);
    if (described.contains("scene")) {
        json["scene"] = described.at("scene");
        add_reports(json["meshes"] = described.at("meshes"), report);
    }
    Json arrays = Json::object();
    for (const auto& [name, error] : report.array_errors)
        arrays[name] = {{"error", rounded(error.value)}, {"norm", error.norm}};
    json["arrays"] = std::move(arrays);
    Json& plan = json["plan"] = described.at("plan");
    for (std::size_t i = 0; i < report.stages.size(); ++i)
        if (plan[i].at("decision") == "bake") plan[i]["arrays"] = report.stages[i].arrays;
    json["self_test"] = {{"tolerance", report.self_test_tolerance}};
    return json;
}

}  // namespace envbake
