// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/format/reader.h"

#include <string>
#include <vector>

namespace envbake {

/// Asks the runtime the questions under "selftest/" and compares its answers with the stored ones,
/// within `tolerance` of |stored| + 1e-3 of the group's largest.
/// One line for each group of questions that it fails; none where all is well.
std::vector<std::string> check_self_test(const format::Reader& reader, double tolerance);

}  // namespace envbake
