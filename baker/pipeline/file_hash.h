// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"

#include <cstdint>
#include <filesystem>
#include <string>

namespace envbake {

/// What an input file held: enough to tell whether it is still the same.
struct FileHash {
    std::uint64_t bytes = 0;
    std::string xxh3;  ///< XXH3-64 of the content, 16 hexadecimal digits

    friend bool operator==(const FileHash&, const FileHash&) = default;
};

/// Errors:  Failed  the file cannot be read
Expected<FileHash> hash_file(const std::filesystem::path& file);

}  // namespace envbake
