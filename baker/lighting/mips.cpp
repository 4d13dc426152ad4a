// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/mips.h"

#include "baker/lighting/box_average.h"
#include "baker/lighting/cluster_tree.h"
#include "baker/lighting/prefilter.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>

namespace envbake {
namespace {

/// Rounding of the sums and of the result to float, relative.
constexpr double kRounding = 2e-6;

double alpha_of(float perceptual_roughness) {
    const double r = std::clamp(static_cast<double>(perceptual_roughness), 1e-3, 1.0);
    return r * r;
}

/// Measured: the worst texel then has a third of the tolerance on photographs, and all of it where
/// a map is made against the method (a texel of 120 degrees beside one a thousand times darker).
lighting::PrefilterAccuracy accuracy_for(double tolerance, bool certify) {
    const double relative = std::clamp(tolerance, 1e-5, 0.3) / 1e-3;
    const double cluster = 3e-5 * (relative < 1 ? relative * std::sqrt(relative) : relative);
    return {.cluster = cluster,
            .horizon = 4 * cluster,
            .extent2 = std::clamp(std::cbrt(6 * tolerance), 0.03, 0.5),
            .interpolation = 5e-4 * std::min(relative < 1 ? relative * relative : relative, 10.0),
            .negligible = (certify ? 1e-7 : 1e-6) * relative,
            .proved = certify ? tolerance : 0};
}

}  // namespace

Mip empty_mip(const MipsJob& job, std::size_t i) {
    const int n = std::max(1, job.face_size >> job.levels[i]);
    const bool cube = job.layout == MipLayout::CubeFaces;
    return {.level = job.levels[i],
            .faces = cube ? 6 : 1,
            .width = cube ? n : 4 * n,
            .height = cube ? n : 2 * n,
            .channels = job.channels,
            .perceptual_roughness = job.perceptual_roughness[i],
            .texels = {},
            .error_estimate = 0};
}

std::vector<Mip> bake_mips(const MipsJob& job, const Environment& environment, Progress& progress) {
    assert(job.levels.size() == job.perceptual_roughness.size());
    std::vector<Mip> mips;
    std::uint64_t texels = 0;
    double finest = 1;
    for (std::size_t i = 0; i < job.levels.size(); ++i) {
        const Mip& mip = mips.emplace_back(empty_mip(job, i));
        texels += mip.texel_count();
        if (mip.perceptual_roughness > 0) {
            finest = std::min(finest, alpha_of(mip.perceptual_roughness));
        }
    }
    progress.begin("environment/mips", "texels", texels);

    std::optional<lighting::ClusterTree> tree;
    for (Mip& mip : mips) {
        const int size = std::max(1, job.face_size >> mip.level);
        if (mip.perceptual_roughness <= 0) {
            mip.texels = lighting::box_average(environment, job.layout, size, job.channels);
            mip.error_estimate = kRounding;
            progress.add(mip.texels.size() / static_cast<std::size_t>(mip.channels));
            continue;
        }
        if (!tree) tree.emplace(environment, lighting::base_extent_for(finest));
        lighting::Prefiltered result =
            lighting::prefilter(*tree,
                                {.distribution = job.distribution,
                                 .alpha = alpha_of(mip.perceptual_roughness),
                                 .layout = job.layout,
                                 .size = size,
                                 .channels = job.channels,
                                 .accuracy = accuracy_for(job.tolerance, job.certify)},
                                progress);
        mip.texels = std::move(result.texels);
        // A map without excess over its floor is a constant one, and exact.
        const bool constant = tree->mean_excess() == DVec3{0};
        const double error =
            job.certify ? result.error_bound : std::max(result.error_estimate, 0.9 * job.tolerance);
        mip.error_estimate = kRounding + (constant ? 0 : error);
    }
    return mips;
}

}  // namespace envbake
