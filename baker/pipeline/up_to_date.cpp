// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/bake.h"
#include "baker/pipeline/metadata.h"

#include "envbake/format/reader.h"

namespace envbake {

namespace {

/// Bundles hold names as UTF-8 (to_text), whatever bytes the file system has.
bool same_name(const std::filesystem::path& file, const std::string& name) {
    return Json::parse(to_text(file.filename().string(), -1)) == name;
}

/// Where an input that a bundle names would be found for this request; empty where it has no place.
std::filesystem::path path_of(const BakeRequest& request, const std::string& role,
                              const std::string& name) {
    if (role == "scene") return same_name(request.scene, name) ? request.scene : "";
    if (role == "environment")
        return same_name(request.environment, name) ? request.environment : "";
    if (role == "resource") return request.scene.parent_path() / name;
    return "";
}

bool has_input(const Json& inputs, const char* role) {
    for (const Json& input : inputs)
        if (input.at("role") == role) return true;
    return false;
}

bool inputs_unchanged(const BakeRequest& request, const Json& inputs) {
    if (has_input(inputs, "scene") != !request.scene.empty()) return false;
    if (has_input(inputs, "environment") != !request.environment.empty()) return false;
    for (const Json& input : inputs) {
        const auto path = path_of(request, input.at("role"), input.at("name"));
        if (path.empty()) return false;
        const auto hash = hash_file(path);
        if (!hash) return false;
        if (*hash != FileHash{input.at("bytes"), input.at("xxh3")}) return false;
    }
    return true;
}

}  // namespace

bool is_up_to_date(const BakeRequest& request) {
    const auto reader = format::Reader::open(request.output.c_str());
    if (!reader) return false;
    for (std::size_t i = 0; i < reader->array_count(); ++i)
        if (!reader->verify(reader->array(i))) return false;  // damaged: bake it again
    const Json metadata = parse_metadata(reader->metadata());
    try {
        return metadata.at("tool").at("version") == tool_version() &&
               metadata.at("options") == options_json(request) &&
               inputs_unchanged(request, metadata.at("inputs"));
    } catch (const Json::exception&) {
        return false;  // another tool's bundle: its metadata lacks what ours has
    }
}

}  // namespace envbake
