// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"

#include "envbake/format/reader.h"

#include <filesystem>
#include <string>
#include <vector>

namespace envbake {

/// A rule that a bundle breaks. Codes and names are stable (docs/format.md): below 100 those of
/// format::Errc, from 100 the rules about what arrays mean.
struct Finding {
    int code = 0;
    std::string name;     ///< "ArrayChecksum"
    std::string message;  ///< one line: which array, what value, what is accepted
};

/// Checks a bundle against every rule of the format, its own self-test included. A file that is no
/// readable bundle at all is one finding.
///
/// Errors:  Failed  the file cannot be opened
Expected<std::vector<Finding>> validate_bundle(const std::filesystem::path& file);

/// The same of a bundle that is open.
std::vector<Finding> validate_bundle(const format::Reader& reader);

}  // namespace envbake
