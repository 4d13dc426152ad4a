// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/pipeline/bake.h"

#include <nlohmann/json.hpp>

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace envbake {

using Json = nlohmann::ordered_json;

/// What the stages found out, beside the arrays themselves.
struct BakeReport {
    struct ArrayError {
        double value = 0;
        std::string norm;  ///< what the value is: "worst |v - r| / (r + 1e-3 mean)"
    };
    std::map<std::string, ArrayError> array_errors;
    struct MipLevel {
        int level = 0;
        int face_size = 0;
        double roughness = 0;
    };
    std::vector<MipLevel> mip_levels;
    int mip_count = 0;
    std::optional<BrdfTable> table;                     ///< errors only are used
    std::vector<std::optional<DiffuseReport>> diffuse;  ///< one a mesh
    double self_test_tolerance = 0;
};

/// The options that decide what the bytes are. Threads and verbosity are not among them.
Json options_json(const BakeRequest& request);

/// The plan as the bundle stores it: [{"output", "decision": "bake" | "skip", "reason"}].
Json plan_json(const BakePlan& plan);

/// The whole document, docs/metadata.md. Nothing in it changes from run to run.
Json metadata_json(const BakeRequest& request, const BakeInputs& inputs, const BakePlan& plan,
                   const BakeReport& report);

/// "1.0.0"
std::string tool_version();

}  // namespace envbake
