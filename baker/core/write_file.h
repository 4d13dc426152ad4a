// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"

#include <filesystem>
#include <string_view>
#include <vector>

namespace envbake {

/// Refuses an output that is one of the inputs, under whatever name, or that exists and is no
/// regular file. Empty paths among the inputs are passed over.
///
/// Errors:  Usage
Expected<void> check_output(const std::filesystem::path& output,
                            const std::vector<std::filesystem::path>& inputs);

/// The name that write_file() of this process writes to first.
std::filesystem::path temporary_of(const std::filesystem::path& file);

/// Writes a file whole or not at all: to a temporary name beside it, then renamed.
///
/// Errors:  Failed  the folder cannot be written to, the disk is full
Expected<void> write_file(const std::filesystem::path& file, std::string_view content);

}  // namespace envbake
