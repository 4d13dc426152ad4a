// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/pipeline/metadata.h"

#include <iosfwd>

namespace envbake {

/// Prints the stages of a plan (plan_json) a line each; meshes with the same fate and the same
/// reason share one: "bake   mesh/1..11,13/diffuse   something stands above every vertex".
void print_stages(const Json& stages, std::ostream& out);

/// Only what is skipped, without the word.
void print_skipped_stages(const Json& stages, std::ostream& out);

}  // namespace envbake
