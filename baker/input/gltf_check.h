// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"

#include <nlohmann/json_fwd.hpp>

#include <string>
#include <string_view>
#include <vector>

namespace envbake::gltf {

/// Checks the JSON of a glTF file against the rules that the rest of the reader relies on: types,
/// indices, ranges, sizes without overflow, formats of the attributes that are read, a node graph
/// that is a forest, and extensions that are known. tinygltf sees the document only afterwards: it
/// takes much on trust.
///
/// Returns the faults: breaches of the specification that cannot change what is read (an empty
/// array, a misaligned accessor, ...), one line each.
///
/// Errors:  InvalidInput  "accessors[3].bufferView: ...": the element, the value seen, the accepted
/// Source:  [glTF 2.0], sections 3 and 5, and the extensions' own specifications.
Expected<std::vector<std::string>> check_document(const nlohmann::json& document);

/// Whether the reader knows what the extension means, so that a file may require it.
bool is_read_extension(std::string_view name);

/// Bytes of one component of an accessor; 0 when `component_type` is none of glTF's.
int component_bytes(int component_type);

}  // namespace envbake::gltf
