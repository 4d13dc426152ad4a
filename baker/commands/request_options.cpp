// SPDX-License-Identifier: Apache-2.0
#include "baker/commands/request_options.h"

#include "baker/transport/interreflection.h"

#include <string>
#include <vector>

namespace envbake {

void declare_request(CLI::App& app, BakeRequest& request) {
    app.add_option("scene", request.scene,
                   "glTF scene (.glb, .gltf); without one, only lighting is baked");
    app.add_option("--env", request.environment,
                   "Environment image (.hdr, .exr); without one, only transport is baked");

    app.add_option("--tolerance", request.tolerance,
                   "Relative error of transport (rms over vertices) and of mips (worst texel)")
        ->capture_default_str();
    app.add_option_function<std::string>(
           "--preset",
           [&request](const std::string& name) {
               request.tolerance = name == "preview" ? 3e-2 : name == "standard" ? 1e-2 : 1e-3;
           },
           "Tolerance by name: preview 3e-2, standard 1e-2, reference 1e-3")
        ->check(CLI::IsMember({"preview", "standard", "reference"}))
        ->excludes("--tolerance");
    app.add_option("--bands", request.bands, "SH bands, 1 to 10; n bands are n*n coefficients")
        ->capture_default_str();
    app.add_flag("--extract-lights", request.extract_lights,
                 "Leave the lights of environment/lights out of all other lighting arrays");
    app.add_flag("--irradiance", request.irradiance,
                 "Also bake environment/irradiance: SH with the clamped cosine folded in");
    app.add_flag("--window", request.window,
                 "Damp SH lighting by as little as leaves no negative irradiance");

    app.add_option_function<std::string>(
           "--distribution",
           [&request](const std::string& name) {
               using runtime::Distribution;
               request.distributions.clear();
               if (name != "beckmann") request.distributions.push_back(Distribution::Ggx);
               if (name != "ggx") request.distributions.push_back(Distribution::Beckmann);
           },
           "Microfacets of the specular arrays: ggx, beckmann or both")
        ->check(CLI::IsMember({"ggx", "beckmann", "both"}))
        ->default_str("ggx");
    app.add_option("--mip-size", request.mip_size, "Face edge of specular mip 0, texels")
        ->capture_default_str();
    app.add_option("--mip-count", request.mip_count,
                   "Specular mips; mip k of n holds roughness k/(n-1)")
        ->capture_default_str();
    app.add_flag("--certify", request.certify,
                 "Prove that no texel of the mips is off by more than --tolerance; much slower");
    app.add_option_function<std::string>(
           "--mip-layout",
           [&request](const std::string& name) {
               request.mip_layout =
                   name == "cube" ? runtime::MipLayout::CubeFaces : runtime::MipLayout::LatLong;
           },
           "cube: six faces; lat-long: one image, 4 mip-sizes wide and 2 high")
        ->check(CLI::IsMember({"cube", "lat-long"}))
        ->default_str("cube");
    app.add_option_function<std::vector<double>>(
           "--roughness-range",
           [&request](const std::vector<double>& range) {
               request.roughness_range = RoughnessRange{range[0], range[1]};
           },
           "Bake the mips for this roughness, MIN MAX; default: what the scene's materials have")
        ->expected(2);
    app.add_option("--table-size", request.table_size, "Texels along each axis of the BRDF tables")
        ->capture_default_str();
    app.add_flag("--half-tables", request.half_tables, "Store BRDF tables as 16-bit floats");
    app.add_option_function<std::string>(
           "--table-axes",
           [&request](const std::string& name) {
               request.table_axes = name == "roots" ? runtime::TableAxes::RootsEndPoints
                                                    : runtime::TableAxes::LinearCentres;
           },
           "roots: (n.v)^(1/4), r^(1/2), end points stored; linear: n.v, r, texel centres")
        ->check(CLI::IsMember({"roots", "linear"}))
        ->default_str("roots");
    app.add_option_function<std::string>(
           "--bounces",
           [&request](const std::string& text) {
               if (text == "all")
                   request.bounces = kAllBounces;
               else if (!CLI::detail::lexical_cast(text, request.bounces) || request.bounces < 0)
                   throw CLI::ValidationError("--bounces", text + ": a number from 0 on, or all");
           },
           "Light between surfaces: how often it is reflected, or all")
        ->type_name("N|all")
        ->default_str("0");
    app.add_option_function<std::string>(
           "--glossy",
           [&request](const std::string& name) {
               request.glossy = name == "auto" ? GlossyChoice::WhereItShows : GlossyChoice::All;
           },
           "Also bake mesh/I/glossy: auto, for lobes that SH can show and that reflect more than "
           "the "
           "tolerance, or all")
        ->check(CLI::IsMember({"auto", "all"}));
    app.add_option("--glossy-bands", request.glossy_bands,
                   "SH bands of what leaves a glossy surface, 1 to 5")
        ->capture_default_str();
    app.add_option_function<std::string>(
           "--wavelet",
           [&request](const std::string& text) {
               request.wavelet = text == "auto" ? WaveletUse::WhereNeeded : WaveletUse::Always;
               if (text != "auto") request.wavelet_size = std::stoi(text);
           },
           "Also bake wavelets, for hard shadows, with cube faces of this many texels; auto: of "
           "64, "
           "where SH lose more than the tolerance")
        ->check(CLI::IsMember({"auto", "16", "32", "64", "128"}));
    app.add_flag("--unshadowed", request.unshadowed,
                 "Also bake mesh/I/unshadowed: transport without occlusion, analytic");
    app.add_option_function<std::string>(
           "--encoding",
           [&request](const std::string& name) {
               request.encoding = name == "f32"       ? Encoding::F32
                                  : name == "f16"     ? Encoding::F16
                                  : name == "unorm16" ? Encoding::Unorm16
                                  : name == "unorm8"  ? Encoding::Unorm8
                                  : name == "cpca"    ? Encoding::Clustered
                                                      : Encoding::Auto;
           },
           "How transport is stored: f32, f16, unorm16, unorm8, cpca (clustered PCA), or auto: the "
           "smallest that keeps to the tolerance")
        ->check(CLI::IsMember({"f32", "f16", "unorm16", "unorm8", "cpca", "auto"}))
        ->default_str("f32");
    const auto add_names = [&app](const char* option, std::vector<std::string>& names,
                                  const char* what) {
        app.add_option(option, names, what)->type_name("NAME")->allow_extra_args(false);
    };
    add_names("--no-receive", request.not_receiving,
              "Bake no transport for this mesh: name of a node or a mesh, or mesh/I; repeatable");
    add_names("--no-cast", request.not_casting,
              "Let this mesh block no light: name of a node or a mesh, or mesh/I; repeatable");
    app.add_flag("--area-normals", request.area_weighted_normals,
                 "Where the file has no normals, weight faces by area instead of by angle");
    app.add_flag("--strict", request.strict,
                 "Refuse environments with NaN, infinite or negative texels");
    app.add_flag("--compress", request.compress, "Store mips and transport compressed with zstd");

    auto* const time_budget = app.add_option(
        "--time-budget", request.time_budget,
        "Wall seconds for the bake: transport gets fewer rays than the tolerance needs; 0: none");
    time_budget->capture_default_str()->check(CLI::Range(0.0, 1e9))->excludes("--bounces");

    app.add_option("--rays", request.rays_per_vertex,
                   "Expert: rays per vertex; 0 lets the tolerance decide")
        ->capture_default_str()
        ->excludes(time_budget)
        ->group("Expert options");
    app.add_option("--memory", request.memory_bytes,
                   "Memory for transport beside the scene and its tree: bytes, or 64MB, 1GB")
        ->transform(CLI::AsSizeValue(/*kb_is_1000=*/false))
        ->transform(CLI::Validator(  // comes before the one above, for which -1 is a large number
            [](std::string& text) {
                return text.starts_with('-') ? std::string("must not be negative") : "";
            },
            ""))
        ->default_str("256MB");
    app.add_option_function<std::string>(
           "--isa",
           [&request](const std::string& name) {
               for (const Isa isa : {Isa::Best, Isa::Sse42, Isa::Avx, Isa::Avx2, Isa::Avx512})
                   if (name == isa_name(isa)) request.isa = isa;
           },
           "Expert: instructions that rays are traced with; on a farm of mixed machines, those "
           "that "
           "all of them have")
        ->check(CLI::IsMember({"best", "sse4.2", "avx", "avx2", "avx512"}))
        ->default_str("best")
        ->group("Expert options");
    app.add_option("--seed", request.seed, "Expert: seed of the random turns")
        ->capture_default_str()
        ->group("Expert options");
}

}  // namespace envbake
