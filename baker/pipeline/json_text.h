// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include <string>
#include <string_view>

namespace envbake {

using Json = nlohmann::ordered_json;

/// A bundle's metadata as its reader has it; discarded (Json::is_discarded) where it is not JSON,
/// or nested deeper than 64, which no bundle needs and recursive code would not survive.
Json parse_metadata(std::string_view text);

/// Text for people and files: bytes that are no UTF-8, as a file name may hold, become U+FFFD.
std::string to_text(const Json& json, int indent);

}  // namespace envbake
