// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"

#include <nlohmann/json.hpp>

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace envbake::gltf {

/// The two halves of a glTF file, its JSON parsed but not yet believed.
struct Container {
    nlohmann::json document;
    bool is_glb = false;
    std::optional<std::vector<std::byte>> bin;  ///< the GLB's second chunk
    std::vector<std::string> faults;            ///< breaches of the specification that do no harm
};

/// Splits and parses a .glb or .gltf file [glTF 2.0, section 4.4]; its first bytes decide which.
/// JSON may nest 256 deep and take 1 GiB: later stages walk it recursively.
///
/// Errors:  InvalidInput  the container or the JSON is broken
///          Failed        the file cannot be opened
Expected<Container> read_container(const std::filesystem::path& file);

}  // namespace envbake::gltf
