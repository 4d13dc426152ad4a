// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/lighting/sh_window.h"
#include "baker/pipeline/bake.h"
#include "baker/pipeline/json_text.h"

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace envbake {

/// The wavelet arrays of a bundle.
struct WaveletLightSummary {
    std::size_t term_count = 0;
    std::size_t coeff_count = 0;
    double truncation = 0;
};
struct WaveletSummary {
    int face_size = 0;
    float step = 0;  ///< 0: no mesh has transport
    std::vector<std::pair<std::size_t, WaveletReport>> meshes;
    std::optional<WaveletLightSummary> light;
};

/// What the stages found out, beside the arrays themselves.
struct BakeReport {
    struct Stage {
        std::string key;                  ///< stage_keys()
        std::vector<std::string> arrays;  ///< that it left, in the order in which they were written
    };
    std::vector<Stage> stages;  ///< one a stage of the plan
    struct ArrayError {
        double value = 0;
        std::string norm;  ///< what the value is: "worst |v - r| / (r + 1e-3 mean)"
    };
    std::map<std::string, ArrayError> array_errors;
    struct MipLevel {
        int level = 0;
        int faces = 6;
        int width = 0, height = 0;  ///< of a face, or of a lat-long image
        double roughness = 0;
    };
    /// The specular side of one distribution.
    struct Lobe {
        std::vector<MipLevel> mip_levels;
        std::optional<BrdfTable> table;  ///< errors only are used
    };
    Lobe ggx, beckmann;
    int mip_count = 0;
    std::optional<ShWindow> window;
    std::vector<std::optional<DiffuseReport>> diffuse;  ///< one a mesh
    struct Glossy {
        DiffuseReport rays;
        int light_bands = 0;
        LobeErrors lobe;
        double error_rms = 0, error_p999 = 0;        ///< of rays, expansion and bounces
        std::optional<LobeLightReport> reflected{};  ///< where light bounces
    };
    std::vector<std::optional<Glossy>> glossy;  ///< one a mesh
    /// Of the specular side, in SH.
    struct ExpandedLobe {
        LobeExpansionJob job;
        int rows = 0;
    };
    std::optional<ExpandedLobe> ggx_lobe, beckmann_lobe;
    /// Of a mesh's transport; "" where it is f32.
    struct Encoding {
        std::string name;
        double error_rms = 0, error_worst = 0;  ///< relative, as DiffuseReport's
    };
    std::vector<Encoding> encodings;  ///< one a mesh; or none
    std::optional<BounceReport> bounces;
    std::optional<WaveletSummary> wavelet;
    double self_test_tolerance = 0;
};

/// The options that decide what the bytes are. Threads and verbosity are not among them.
Json options_json(const BakeRequest& request);

/// [index, count]; null of a whole bake.
Json shard_json(const std::optional<Shard>& shard);

/// "unorm8", as --encoding has it.
const char* encoding_name(Encoding encoding);

/// The plan as the bundle stores it: [{"output", "decision": "bake" | "skip", "reason"}].
Json plan_json(const BakePlan& plan);

/// What is known of a bake before its stages run.
Json describe_bake(const BakeRequest& request, const BakeInputs& inputs, const BakePlan& plan);

/// The whole document, docs/format.md. Nothing in it changes from run to run.
///   described  describe_bake()
Json metadata_json(const Json& described, const BakeRequest& request, const BakeReport& report);

/// Three significant digits: errors and statistics are estimates, and read better so. What is
/// rounded stays what it is if it is rounded again.
double rounded(double value);

/// Parts of a report as metadata_json() wrote them. Throw Json::exception where they are not there,
/// or of another type.
void read_table(const Json& json, BrdfTable& table);
DiffuseReport read_diffuse(const Json& json);
BakeReport::Encoding read_encoding(const Json& json);
BounceReport read_bounces(const Json& json);
BakeReport::Glossy read_glossy(const Json& json, const LobeErrors& lobe);
WaveletLightSummary read_wavelet_light(const Json& json);
WaveletReport read_wavelet_mesh(const Json& json);

/// "1.0.0"
std::string tool_version();

}  // namespace envbake
