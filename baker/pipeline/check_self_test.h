// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/pipeline/metadata.h"

#include "envbake/format/reader.h"

#include <string>
#include <vector>

namespace envbake {

/// Asks the runtime the questions under "selftest/" and compares its answers with the stored ones.
/// One line for each group of questions that it fails; none where all is well.
std::vector<std::string> check_self_test(const format::Reader& reader, const Json& metadata);

}  // namespace envbake
