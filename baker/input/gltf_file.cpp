// SPDX-License-Identifier: Apache-2.0
#include "baker/input/gltf_file.h"

#include "baker/input/gltf_uri.h"

#include <algorithm>
#include <cstdint>
#include <span>
#include <string_view>

namespace envbake::gltf {

namespace {

constexpr std::uint32_t kMagic = 0x46546c67;      // "glTF"
constexpr std::uint32_t kJsonChunk = 0x4e4f534a;  // "JSON"
constexpr std::uint32_t kBinChunk = 0x004e4942;   // "BIN\0"
constexpr std::uint64_t kMaxFileBytes = std::uint64_t{1} << 32;
constexpr std::size_t kMaxJsonBytes = std::size_t{1} << 30;
constexpr int kMaxDepth = 256;

Error refuse(std::string message) {
    return {Errc::InvalidInput, std::move(message)};
}

std::uint32_t u32_at(std::span<const std::byte> bytes, std::size_t offset) {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i)
        value |= std::to_integer<std::uint32_t>(bytes[offset + i]) << (8 * i);
    return value;
}

struct Chunks {
    std::span<const std::byte> json;
    std::optional<std::span<const std::byte>> bin;
};

Expected<Chunks> split_glb(std::span<const std::byte> bytes) {
    if (bytes.size() < 12) return refuse("GLB: the 12-byte header is cut short");
    if (const std::uint32_t version = u32_at(bytes, 4); version != 2)
        return refuse(concat("GLB: container version ", version, ", only 2 is supported"));
    const std::size_t length = u32_at(bytes, 8);
    if (length > bytes.size())
        return refuse(
            concat("GLB: the header says ", length, " bytes, the file has ", bytes.size()));
    bytes = bytes.first(length);

    Chunks chunks;
    std::size_t offset = 12;
    for (int i = 0; offset < length; ++i) {
        if (length - offset < 8)
            return refuse(concat("GLB: chunk ", i, ": its header is cut short"));
        const std::size_t size = u32_at(bytes, offset);
        const std::uint32_t type = u32_at(bytes, offset + 4);
        offset += 8;
        if (size > length - offset)
            return refuse(concat("GLB: chunk ", i, ": ", size, " bytes long, ", length - offset,
                                 " are left"));
        if (size % 4 != 0)
            return refuse(concat("GLB: chunk ", i, ": ", size, " bytes long, not a multiple of 4"));
        const auto payload = bytes.subspan(offset, size);
        offset += size;

        if (i == 0) {
            if (type != kJsonChunk) return refuse("GLB: chunk 0 is not of type JSON");
            chunks.json = payload;
        } else if (type == kJsonChunk) {
            return refuse(concat("GLB: chunk ", i, ": a second JSON chunk"));
        } else if (type == kBinChunk) {
            if (chunks.bin) return refuse(concat("GLB: chunk ", i, ": a second BIN chunk"));
            if (i != 1) return refuse(concat("GLB: chunk ", i, ": the BIN chunk must be chunk 1"));
            chunks.bin = payload;
        }  // chunks of other types belong to extensions: skipped, as the specification asks
    }
    if (chunks.json.empty()) return refuse("GLB: there is no JSON");
    return chunks;
}

/// How deep arrays and objects nest, without parsing: the parser's own stack must not be the limit.
int nesting_depth(std::string_view text) {
    int depth = 0;
    int deepest = 0;
    bool in_string = false;
    for (std::size_t i = 0; i < text.size(); ++i) {
        const char c = text[i];
        if (in_string) {
            if (c == '\\') ++i;
            if (c == '"') in_string = false;
        } else if (c == '"') {
            in_string = true;
        } else if (c == '[' || c == '{') {
            deepest = std::max(deepest, ++depth);
        } else if (c == ']' || c == '}') {
            --depth;
        }
    }
    return deepest;
}

Expected<nlohmann::json> parse_json(std::string_view text) {
    if (text.size() > kMaxJsonBytes)
        return refuse(
            concat("the JSON has ", text.size(), " bytes, at most ", kMaxJsonBytes, " are read"));
    if (nesting_depth(text) > kMaxDepth)
        return refuse(concat("the JSON nests deeper than ", kMaxDepth, " levels"));
    try {
        nlohmann::json document = nlohmann::json::parse(text.begin(), text.end());
        if (!document.is_object())
            return refuse(
                concat("the JSON is of type ", document.type_name(), ", it must be an object"));
        return document;
    } catch (const nlohmann::json::exception& e) {
        // "[json.exception.parse_error.101] parse error at line 1, ...": the bracket helps nobody.
        std::string_view what = e.what();
        if (const std::size_t end = what.find("] "); end != std::string_view::npos)
            what.remove_prefix(end + 2);
        return refuse(concat("not valid JSON: ", what.substr(0, 200)));
    }
}

}  // namespace

Expected<Container> read_container(const std::filesystem::path& file) {
    std::error_code ignored;
    if (!std::filesystem::exists(file, ignored))
        return Error{Errc::Failed, "there is no such file"};
    if (!std::filesystem::is_regular_file(file, ignored)) return refuse("not a regular file");
    ENVBAKE_TRY(std::vector<std::byte> bytes, read_bytes(file, kMaxFileBytes));
    if (bytes.empty()) return refuse("the file is empty");

    Container container;
    std::span<const std::byte> json(bytes);
    if (bytes.size() >= 4 && u32_at(bytes, 0) == kMagic) {
        container.is_glb = true;
        ENVBAKE_TRY(const Chunks chunks, split_glb(bytes));
        json = chunks.json;
        if (chunks.bin) container.bin.emplace(chunks.bin->begin(), chunks.bin->end());
    } else if (file.extension() == ".glb") {
        return refuse("GLB: the file does not begin with the magic \"glTF\"");
    }

    std::string_view text(reinterpret_cast<const char*>(json.data()), json.size());
    if (constexpr std::string_view kBom = "\xef\xbb\xbf"; text.substr(0, 3) == kBom) {
        container.faults.push_back("the JSON begins with a byte order mark");
        text.remove_prefix(3);
    }
    ENVBAKE_TRY(container.document, parse_json(text));
    return container;
}

}  // namespace envbake::gltf
