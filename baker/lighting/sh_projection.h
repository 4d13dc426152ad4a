// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/environment.h"
#include "baker/lighting/sh_lighting.h"

namespace envbake {

struct ShLightingJob {
    int bands = 5;     ///< 1 .. 10
    int channels = 3;  ///< 1: the map is grey, and red stands for all
};

/// Integrates the piecewise-constant environment against the SH basis, in double. Relative error
/// below 1e-12 of l_00 on either grid, whatever its edges.
///
/// Lat-long: about its own pole a texel separates, so azimuth is integrated in closed form, polar
/// angle by as many Gauss-Legendre nodes as the tallest row needs, and one orthogonal matrix a band
/// turns the pole to +Z. Cube: Gauss-Legendre in (u, v), the basis once for all six faces.
///
/// Cost: O(texels * bands) lat-long, O(texels * bands^2) cube; memory a row a thread.
/// Deterministic: rows are summed in a fixed order whatever the number of threads.
ShLighting project_sh(const ShLightingJob& job, const Environment& environment);

}  // namespace envbake
