// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/progress.h"
#include "baker/input/environment.h"
#include "baker/lighting/mip_layout.h"
#include "envbake/runtime/brdf.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace envbake {

/// Specular mips of the environment. Running a job takes no further decisions.
struct MipsJob {
    int face_size = 256;  ///< of mip 0; mip k has the n = max(1, face_size >> k) of MipLayout
    std::vector<float> perceptual_roughness;  ///< one per mip to bake, rising; 0 is the mirror
    std::vector<int> levels;                  ///< the mip index k of each entry above
    double tolerance = 1e-2;  ///< worst |v - r| / (r + 1e-3 mean) over texels and channels
    runtime::Distribution distribution = runtime::Distribution::Ggx;
    MipLayout layout = MipLayout::CubeFaces;
    int channels = 3;      ///< 1: the map is grey, red stands for all
    bool certify = false;  ///< open sources until the sum of their error bounds is below tolerance
};

/// "environment/mips/K": prefiltered radiance, row by row.
struct Mip {
    int level = 0;
    int faces = 6;              ///< 6, or 1: a lat-long image
    int width = 0, height = 0;  ///< of a face, or of the image
    int channels = 3;
    float perceptual_roughness = 0;
    std::vector<float> texels;  ///< [faces, height, width, channels]
    /// In the norm of MipsJob::tolerance. With MipsJob::certify it is proved: the sum over sources
    /// of what each can err by at most (error_bound.h), of the worst texel; no texel is further
    /// off.
    ///
    /// Otherwise calibrated, not proved: sums of the estimates of the worst tile, with factors that
    /// keep it above the worst texel of every map compared, all texels of them, and never under 0.9
    /// of the tolerance. Mip 0, and constant maps: rounding alone.
    double error_estimate = 0;

    std::uint64_t texel_count() const {
        return static_cast<std::uint64_t>(faces) * static_cast<std::uint64_t>(width) *
               static_cast<std::uint64_t>(height);
    }
};

/// levels[i] of a job, still without texels.
Mip empty_mip(const MipsJob& job, std::size_t i);

/// N = V = R: integral of L(l) w(l) over integral of w(l), w(l) = D(h) max(0, n.l), at the centre
/// of every texel, straight from the source texels: any grid, any size of map and mip. Mip 0
/// (roughness 0) is the box average of the source over the texel.
///
/// Roughness is clamped to [1e-3, 1] where it is not 0. Results are finite, and between the least
/// and the greatest radiance of their channel; a constant map stays constant.
///
/// Cost of a 1024 x 512 photograph on one core at tolerance 1e-3, mip 0 of 256 texels and r = 1/4,
/// 1/2, 3/4, 1 on faces of 128, 64, 32, 16: 75 to 90 ms for GGX, 130 to 140 ms for Beckmann; of
/// these mip 0 takes 16 and the clusters 12 to 17. Lobes narrower than a texel of the mip cost some
/// 5 to 25 us a texel down to r = 0.02, 200 us below. Memory: 25 MB for the clusters, however large
/// the map. Certified the five take some 40 s, ten times less at 1e-2. Threads: tiles in parallel;
/// the same bits on any number of threads.
std::vector<Mip> bake_mips(const MipsJob& job, const Environment& environment, Progress& progress);

}  // namespace envbake
