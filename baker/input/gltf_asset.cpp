// SPDX-License-Identifier: Apache-2.0
#include "baker/input/gltf_asset.h"

#include "baker/input/gltf_check.h"
#include "baker/input/gltf_compression.h"
#include "baker/input/gltf_file.h"
#include "baker/input/gltf_uri.h"

#include <nlohmann/json.hpp>

#include <exception>
#include <utility>

namespace envbake::gltf {

namespace {

using nlohmann::json;

constexpr std::uint64_t kMaxImageFileBytes = std::uint64_t{1} << 30;

Error refuse(std::string message) {
    return {Errc::InvalidInput, std::move(message)};
}

Error at(const std::string& where, const Error& error) {
    return {error.code, concat(where, ": ", error.message)};
}

const json* find(const json& object, const char* key) {
    const auto it = object.find(key);
    return it == object.end() ? nullptr : &*it;
}

/// The one place that calls tinygltf. It gets the parts of the checked document that the reader
/// uses, without buffers and images, so that it opens no file and decodes nothing.
///
/// tinygltf 2.7 refuses indices whose accessor has no buffer view, which Draco and all-zero
/// accessors need: such indices are withheld and put back into the model.
Expected<tinygltf::Model> typed_model(const json& document) {
    json known = {{"asset", {{"version", "2.0"}}}};
    for (const char* key : {"accessors", "bufferViews", "materials", "meshes", "nodes", "samplers",
                            "scene", "scenes", "skins", "textures"})
        if (const json* v = find(document, key)) known[key] = *v;

    struct Withheld {
        std::size_t mesh, primitive;
        int indices;
    };
    std::vector<Withheld> withheld;
    if (known.contains("meshes")) {
        json& meshes = known["meshes"];
        for (std::size_t m = 0; m < meshes.size(); ++m) {
            json& primitives = meshes[m]["primitives"];
            for (std::size_t p = 0; p < primitives.size(); ++p) {
                const json* indices = find(primitives[p], "indices");
                if (!indices) continue;
                const int accessor = indices->get<int>();
                if (known["accessors"][static_cast<std::size_t>(accessor)].contains("bufferView"))
                    continue;
                withheld.push_back({m, p, accessor});
                primitives[p].erase("indices");
            }
        }
    }

    tinygltf::Model model;
    try {
        const std::string text = known.dump();
        tinygltf::TinyGLTF loader;
        std::string error, warning;
        if (!loader.LoadASCIIFromString(&model, &error, &warning, text.data(),
                                        static_cast<unsigned>(text.size()), ""))
            return refuse(concat("tinygltf refuses it: ", shown(error)));
    } catch (const std::exception& e) {
        return refuse(concat("tinygltf refuses it: ", shown(e.what())));
    }
    for (const Withheld& w : withheld)
        model.meshes[w.mesh].primitives[w.primitive].indices = w.indices;
    return model;
}

}  // namespace

Expected<Asset> Asset::open(const std::filesystem::path& file) {
    ENVBAKE_TRY(Container container, read_container(file));
    const json& document = container.document;
    ENVBAKE_TRY(const std::vector<std::string> faults, check_document(document));

    Asset asset;
    asset.folder_ = file.parent_path();
    asset.files_read.push_back(file);
    asset.faults = std::move(container.faults);
    asset.faults.insert(asset.faults.end(), faults.begin(), faults.end());
    ENVBAKE_TRY(asset.model_, typed_model(document));
    if (const json* used = find(document, "extensionsUsed"))
        for (const json& name : *used)
            if (!is_read_extension(name.get_ref<const std::string&>()))
                asset.unread_extensions.push_back(name.get<std::string>());

    const json none = json::array();
    const json* buffers = find(document, "buffers");
    for (const json& buffer : buffers ? *buffers : none) {
        const std::string where = concat("buffers[", asset.buffers_.size(), "]");
        const auto byte_length = buffer["byteLength"].get<std::uint64_t>();
        const json* uri = find(buffer, "uri");
        std::vector<std::byte> bytes;
        if (uri && is_data_uri(uri->get_ref<const std::string&>())) {
            auto decoded = decode_data_uri(uri->get_ref<const std::string&>());
            if (!decoded) return at(where + ".uri", decoded.error());
            bytes = *std::move(decoded);
        } else if (uri) {
            auto path = resolve_uri(asset.folder_, uri->get_ref<const std::string&>());
            if (!path) return at(where + ".uri", path.error());
            auto read = read_bytes(*path, byte_length);
            if (!read) return at(concat(where, ".uri ", *uri), read.error());
            bytes = *std::move(read);
            asset.files_read.push_back(*path);
        } else if (container.is_glb && asset.buffers_.empty() && container.bin) {
            bytes = *std::move(container.bin);
            if (bytes.size() > byte_length + 3)
                return refuse(concat(where, ": byteLength is ", byte_length, ", the BIN chunk has ",
                                     bytes.size()));
        } else {
            const json* extensions = find(buffer, "extensions");
            const bool fallback = extensions && extensions->contains("EXT_meshopt_compression");
            if (container.is_glb && asset.buffers_.empty() && !fallback)
                return refuse(concat(where, ": has no uri, and the GLB has no BIN chunk"));
            asset.buffers_.emplace_back();  // refused when it is used
            continue;
        }
        if (bytes.size() < byte_length)
            return refuse(concat(where, ": byteLength is ", byte_length, ", there are only ",
                                 bytes.size(), " bytes"));
        asset.buffers_.push_back(std::move(bytes));
    }

    const json* images = find(document, "images");
    for (const json& image : images ? *images : none) {
        const json* name = find(image, "name");
        const json* uri = find(image, "uri");
        const json* view = find(image, "bufferView");
        ImageSource source;
        if (uri) source.uri = uri->get<std::string>();
        if (view) source.buffer_view = view->get<int>();
        if (name)
            source.name = name->get<std::string>();
        else if (uri && !is_data_uri(source.uri))
            source.name = source.uri;
        else
            source.name = concat("images[", asset.images_.size(), "]");
        asset.images_.push_back(std::move(source));
    }
    return asset;
}

const std::string& Asset::image_name(int image) const {
    return images_[static_cast<std::size_t>(image)].name;
}

Expected<std::span<const std::byte>> Asset::buffer_range(int buffer, std::uint64_t offset,
                                                         std::uint64_t length) const {
    const auto& bytes = buffers_[static_cast<std::size_t>(buffer)];
    if (bytes.empty()) return refuse(concat("buffers[", buffer, "] has no uri and no data"));
    if (offset > bytes.size() || length > bytes.size() - offset)
        return refuse(concat("bytes ", offset, " .. ", offset + length, " are not inside buffers[",
                             buffer, "]"));
    return std::span<const std::byte>(bytes).subspan(offset, length);
}

Expected<std::span<const std::byte>> Asset::buffer_view(int index) {
    const tinygltf::BufferView& view = model_.bufferViews[static_cast<std::size_t>(index)];
    const std::string where = concat("bufferViews[", index, "]");
    const auto extension = view.extensions.find("EXT_meshopt_compression");
    if (extension == view.extensions.end()) {
        auto range = buffer_range(view.buffer, view.byteOffset, view.byteLength);
        if (!range) return at(where, range.error());
        return range;
    }
    if (const auto known = decoded_views_.find(index); known != decoded_views_.end())
        return std::span<const std::byte>(known->second);

    const tinygltf::Value& e = extension->second;
    const auto integer = [&](const char* key) {
        return e.Has(key) ? static_cast<std::uint64_t>(e.Get(key).GetNumberAsDouble())
                          : std::uint64_t{0};
    };
    const std::string in_extension = where + ".extensions.EXT_meshopt_compression";
    auto encoded = buffer_range(static_cast<int>(integer("buffer")), integer("byteOffset"),
                                integer("byteLength"));
    if (!encoded) return at(in_extension, encoded.error());
    auto decoded = decode_meshopt(
        *encoded, {.count = static_cast<std::size_t>(integer("count")),
                   .stride = static_cast<std::size_t>(integer("byteStride")),
                   .mode = e.Get("mode").Get<std::string>(),
                   .filter = e.Has("filter") ? e.Get("filter").Get<std::string>() : "NONE"});
    if (!decoded) return at(in_extension, decoded.error());
    return std::span<const std::byte>(decoded_views_[index] = *std::move(decoded));
}

Expected<std::vector<std::byte>> Asset::image_bytes(int image) {
    const ImageSource& source = images_[static_cast<std::size_t>(image)];
    const std::string where = concat("images[", image, "]");
    if (source.buffer_view >= 0) {
        auto view = buffer_view(source.buffer_view);
        if (!view) return at(where, view.error());
        return std::vector<std::byte>(view->begin(), view->end());
    }
    if (is_data_uri(source.uri)) {
        auto decoded = decode_data_uri(source.uri);
        if (!decoded) return at(where + ".uri", decoded.error());
        return decoded;
    }
    auto path = resolve_uri(folder_, source.uri);
    if (!path) return at(where + ".uri", path.error());
    auto bytes = read_bytes(*path, kMaxImageFileBytes);
    if (!bytes) return at(concat(where, ".uri ", shown(source.uri)), bytes.error());
    files_read.push_back(*path);
    return bytes;
}

}  // namespace envbake::gltf
