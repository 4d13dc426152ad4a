// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/plan/bake_request.h"

#include <CLI/CLI.hpp>

namespace envbake {

/// The options that bake and plan share.
void declare_request(CLI::App& app, BakeRequest& request);

}  // namespace envbake
