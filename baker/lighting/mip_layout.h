// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/runtime/mip_layout.h"

namespace envbake {

/// Mip k of base size s, with n = max(1, s >> k): six faces of n x n texels, or one image of
/// 4 n x 2 n with the grid of make_lat_long_grid. Either way a texel is 90 degrees / n.
using runtime::MipLayout;

}  // namespace envbake
