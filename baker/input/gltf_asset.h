// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"

#include <tiny_gltf.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace envbake::gltf {

/// A checked glTF file with its bytes at hand. tinygltf types the document; buffers and images are
/// read here, on demand and by our own rules for URIs, and its own loaders never run. Internal to
/// baker/input: no tinygltf type leaves the room.
class Asset {
  public:
    /// Errors:  InvalidInput  read_container, check_document; a buffer is missing or too short
    ///          Failed        the file cannot be opened
    static Expected<Asset> open(const std::filesystem::path& file);

    const tinygltf::Model& model() const { return model_; }
    std::size_t image_count() const { return images_.size(); }
    const std::string& image_name(int image) const;

    /// The bytes of a buffer view, decompressed where EXT_meshopt_compression says so. Valid as
    /// long as the asset.
    Expected<std::span<const std::byte>> buffer_view(int index);

    /// The encoded bytes (PNG, JPEG) of an image. A file that is read is added to files_read.
    Expected<std::vector<std::byte>> image_bytes(int image);

    std::vector<std::filesystem::path> files_read;  ///< the glTF file first
    std::vector<std::string> unread_extensions;     ///< used by the file, and none of ours
    std::vector<std::string> faults;  ///< breaches of the specification that do no harm

  private:
    struct ImageSource {
        std::string name;
        std::string uri;
        int buffer_view = -1;
    };

    Expected<std::span<const std::byte>> buffer_range(int buffer, std::uint64_t offset,
                                                      std::uint64_t length) const;

    std::filesystem::path folder_;
    tinygltf::Model model_;
    std::vector<std::vector<std::byte>> buffers_;  ///< empty: the file gives no data
    std::vector<ImageSource> images_;
    std::map<int, std::vector<std::byte>> decoded_views_;
};

}  // namespace envbake::gltf
