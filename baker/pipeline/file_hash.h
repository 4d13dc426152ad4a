// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

namespace envbake {

/// What an input file held: enough to tell whether it is still the same.
struct FileHash {
    std::uint64_t bytes = 0;
    std::string xxh3;  ///< XXH3-64 of the content, 16 hexadecimal digits

    friend bool operator==(const FileHash&, const FileHash&) = default;
};

/// XXH3-64, 16 hexadecimal digits.
std::string hash_text(std::span<const std::byte> bytes);

/// Errors:  Failed  the file cannot be read
Expected<FileHash> hash_file(const std::filesystem::path& file);

}  // namespace envbake
