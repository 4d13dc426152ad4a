// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/environment.h"
#include "baker/math/vector.h"

#include <vector>

namespace envbake {

struct ShLightingJob {
    int bands = 5;  ///< 1 .. 10
};

/// "environment/sh": l_i = integral of L(w) Y_i(w) dw, RGB, slot sh::index(l, m); W m^-2.
struct ShLighting {
    int bands = 0;
    std::vector<DVec3> coeffs;  ///< bands * bands
};

/// Integrates the piecewise-constant environment against the SH basis, exactly in azimuth and by
/// Gauss-Legendre in polar angle, in double. Relative error below 1e-12 of l_00.
/// Deterministic: rows are summed in a fixed order whatever the number of threads.
ShLighting project_sh(const ShLightingJob& job, const Environment& environment);

}  // namespace envbake
