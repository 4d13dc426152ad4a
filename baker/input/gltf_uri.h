// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace envbake::gltf {

bool is_data_uri(std::string_view uri);

/// The bytes of data:[media type][;parameters];base64,... [RFC 2397]. The media type is not judged:
/// what the bytes are is decided by what refers to them.
///
/// Errors:  InvalidInput  no base64 marker, an empty parameter, or characters that are not base64
Expected<std::vector<std::byte>> decode_data_uri(std::string_view uri);

/// The file that a relative reference [RFC 3986, 4.2] names, percent-decoded. Plain spaces and raw
/// UTF-8 are taken as they stand; where no file has the decoded name, the name as written is tried.
/// `..` may leave the scene's folder, as exporters with a shared texture folder write; a scheme, an
/// absolute path and a NUL are refused, so that a scene names only files relative to itself.
///
/// Errors:  InvalidInput  refused, or there is no such regular file
Expected<std::filesystem::path> resolve_uri(const std::filesystem::path& folder,
                                            const std::string& uri);

/// At most `max_bytes` from the start of a regular file.
///
/// Errors:  Failed  it cannot be opened or read
Expected<std::vector<std::byte>> read_bytes(const std::filesystem::path& file,
                                            std::uint64_t max_bytes);

/// `text` as a JSON string, so that a hostile name cannot break a message into lines; long ones are
/// cut to 80 bytes.
std::string shown(std::string_view text);

}  // namespace envbake::gltf
