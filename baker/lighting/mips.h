// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/progress.h"
#include "baker/input/environment.h"
#include "baker/math/vector.h"

#include <vector>

namespace envbake {

/// Specular mips of the environment. Running a job takes no further decisions.
struct MipsJob {
    int face_size = 256;  ///< edge of mip 0, texels; mip k has max(1, face_size >> k)
    std::vector<float> perceptual_roughness;  ///< one per mip to bake, rising; 0 is the mirror
    std::vector<int> levels;                  ///< the mip index k of each entry above
    double tolerance = 1e-2;  ///< worst |v - r| / (r + 1e-3 mean) over texels and channels
};

/// "environment/mips/K": prefiltered radiance, [6, face_size, face_size, 3] row by row.
struct Mip {
    int level = 0;
    int face_size = 0;
    float perceptual_roughness = 0;
    std::vector<Vec3> texels;
    double error_estimate =
        0;  ///< in the norm of MipsJob::tolerance; at least the true worst error
};

/// GGX, N = V = R: integral of L(l) w(l) over integral of w(l), w(l) = D(h) max(0, n.l), at the
/// centre of every texel. Mip 0 (roughness 0) is the box average of the source over the texel.
std::vector<Mip> bake_mips(const MipsJob& job, const Environment& environment, Progress& progress);

}  // namespace envbake
