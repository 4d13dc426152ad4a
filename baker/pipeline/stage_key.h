// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/pipeline/bake.h"

#include <string>
#include <vector>

namespace envbake {

/// One key a stage of the plan: a hash of all that decides what the stage leaves in the bundle.
/// That is this tool's version, what the files hold that it reads, the fields of its job, and those
/// of the stages that it works with: glossy and diffuse transport of a mesh come from the same
/// rays; where rows wait for bounces or an encoding, the transport of all meshes is one. Names of
/// files, memory and threads are not in it.
///
///   return  16 hexadecimal digits; "" of a stage that is skipped, and of the few that are made
///           from facts the plan needed anyway: SH and lights
std::vector<std::string> stage_keys(const BakeRequest& request, const BakeInputs& inputs,
                                    const BakePlan& plan);

}  // namespace envbake
