// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"

#include <filesystem>
#include <string>
#include <vector>

namespace envbake {

/// The rule "output: inputs" as make, ninja and CMake read it, and an empty rule for every input:
/// one that is gone is then a reason to bake, and no reason for make to stop.
///
/// Names are written as they are given, for tools compare them as text. Space, tab, '#' and '$'
/// are escaped as compilers escape them; that is all the three have in common.
///
/// Errors:  Usage  a name holds a line break, which no tool can read
Expected<std::string> depfile_text(const std::filesystem::path& output,
                                   const std::vector<std::filesystem::path>& inputs);

}  // namespace envbake
