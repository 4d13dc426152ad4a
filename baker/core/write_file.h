// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"

#include <filesystem>
#include <string_view>

namespace envbake {

/// Writes a file whole or not at all: to a temporary name beside it, then renamed.
///
/// Errors:  Failed  the folder cannot be written to, the disk is full
Expected<void> write_file(const std::filesystem::path& file, std::string_view content);

}  // namespace envbake
