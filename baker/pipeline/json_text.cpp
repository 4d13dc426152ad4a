// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/json_text.h"

#include <stdexcept>

namespace envbake {

Json parse_metadata(std::string_view text) {
    constexpr int kMaxDepth = 64;
    const auto callback = [](int depth, Json::parse_event_t, Json&) {
        if (depth > kMaxDepth) throw std::length_error("nested too deeply");
        return true;
    };
    try {
        return Json::parse(text, callback, /*allow_exceptions=*/false);
    } catch (const std::length_error&) {
        return Json(Json::value_t::discarded);
    }
}

std::string to_text(const Json& json, int indent) {
    return json.dump(indent, ' ', /*ensure_ascii=*/false, Json::error_handler_t::replace);
}

}  // namespace envbake
