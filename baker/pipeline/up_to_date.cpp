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

/// The request's files, where each is there and holds what the bundle says.
std::optional<std::vector<std::filesystem::path>> unchanged_files(const BakeRequest& request,
                                                                  const Json& inputs) {
    if (has_input(inputs, "scene") != !request.scene.empty()) return {};
    if (has_input(inputs, "environment") != !request.environment.empty()) return {};
    std::vector<std::filesystem::path> files;
    for (const Json& input : inputs) {
        files.push_back(path_of(request, input.at("role"), input.at("name")));
        if (files.back().empty()) return {};
        const auto hash = hash_file(files.back());
        if (!hash || *hash != FileHash{input.at("bytes"), input.at("xxh3")}) return {};
    }
    return files;
}

}  // namespace

std::optional<std::vector<std::filesystem::path>> files_if_up_to_date(const BakeRequest& request) {
    const auto reader = format::Reader::open(request.output.c_str());
    if (!reader) return {};
    const Json metadata = parse_metadata(reader->metadata());
    try {
        if (metadata.at("tool").at("version") != tool_version() ||
            metadata.at("options") != options_json(request) ||
            metadata.value("shard", Json()) != shard_json(request.shard))
            return {};
        auto files = unchanged_files(request, metadata.at("inputs"));
        for (std::size_t i = 0; files && i < reader->array_count(); ++i)
            if (!reader->verify(reader->array(i))) return {};  // damaged: bake it again
        return files;
    } catch (const Json::exception&) {
        return {};  // another tool's bundle: its metadata lacks what ours has
    }
}

}  // namespace envbake
