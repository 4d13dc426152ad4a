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
/// below 1e-12 of l_00 on either grid, whatever its edges and its texels.
///
/// Lat-long: about its own pole a texel separates. Azimuth is integrated in closed form. Polar
/// angle: 32 rows at a time are summed onto as many Chebyshev nodes as a bound on the error of
/// interpolating the basis asks for (8 for 10 bands of 4096 rows), and only these are transformed.
/// One orthogonal matrix a band turns the pole to +Z. Cube: Gauss-Legendre in (u, v), the basis
/// once for all six faces.
///
/// Cost: lat-long, one read of the map and O(texels * (nodes + bands * nodes / 32)); cube,
/// O(texels * bands^2). A grey map has a third of the arithmetic and all of the reading. Memory:
/// the columns' table and 64 columns of a block a thread. Deterministic: blocks are summed in a
/// fixed order whatever the number of threads.
ShLighting project_sh(const ShLightingJob& job, const Environment& environment);

}  // namespace envbake
