// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/environment.h"

#include <vector>

namespace envbake::bench {

/// The textbook projection as a baseline: the basis at the centre of every texel times its exact
/// solid angle, evaluated texel by texel. Lat-long grids only.
std::vector<DVec3> sampled_sh(const Environment& environment, int bands);

/// The truth for both: 4 x 4 Gauss-Legendre points a texel, 1e-14 of l_00. Lat-long grids only.
std::vector<DVec3> integrated_sh(const Environment& environment, int bands);

/// The map at half the resolution: 2 x 2 texels averaged by their solid angles.
Environment halved(const Environment& environment);

}  // namespace envbake::bench
