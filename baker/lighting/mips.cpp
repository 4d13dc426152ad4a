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

int face_size_of(const MipsJob& job, int level) {
    return std::max(1, job.face_size >> level);
}

double alpha_of(float perceptual_roughness) {
    const double r = std::clamp(static_cast<double>(perceptual_roughness), 1e-3, 1.0);
    return r * r;
}

/// Measured: the worst texel then has a third of the tolerance on photographs, and all of it where
/// a map is made against the method (a texel of 120 degrees beside one a thousand times darker).
lighting::PrefilterAccuracy accuracy_for(double tolerance) {
    const double relative = std::clamp(tolerance, 1e-5, 0.3) / 1e-3;
    const double cluster = 3e-5 * (relative < 1 ? relative * relative : relative);
    return {.cluster = cluster,
            .horizon = 10 * cluster,
            .extent2 = std::clamp(std::cbrt(6 * tolerance), 0.03, 0.5),
            .interpolation = 1e-3 * std::min(relative, 5.0)};
}

}  // namespace

std::vector<Mip> bake_mips(const MipsJob& job, const Environment& environment, Progress& progress) {
    assert(job.levels.size() == job.perceptual_roughness.size());
    std::uint64_t texels = 0;
    double finest = 1;
    for (std::size_t i = 0; i < job.levels.size(); ++i) {
        const auto size = static_cast<std::uint64_t>(face_size_of(job, job.levels[i]));
        texels += 6 * size * size;
        if (job.perceptual_roughness[i] > 0) {
            finest = std::min(finest, alpha_of(job.perceptual_roughness[i]));
        }
    }
    progress.begin("environment/mips", "texels", texels);

    std::optional<lighting::ClusterTree> tree;
    std::vector<Mip> mips;
    for (std::size_t i = 0; i < job.levels.size(); ++i) {
        Mip mip;
        mip.level = job.levels[i];
        mip.face_size = face_size_of(job, mip.level);
        mip.perceptual_roughness = job.perceptual_roughness[i];
        if (mip.perceptual_roughness <= 0) {
            const std::vector<float> values =
                lighting::box_average(environment, MipLayout::CubeFaces, mip.face_size, 3);
            for (std::size_t t = 0; t + 2 < values.size(); t += 3) {
                mip.texels.emplace_back(values[t], values[t + 1], values[t + 2]);
            }
            mip.error_estimate = kRounding;
            progress.add(mip.texels.size());
        } else {
            if (!tree) tree.emplace(environment, lighting::base_extent_for(finest));
            lighting::Prefiltered result =
                lighting::prefilter_ggx(*tree, alpha_of(mip.perceptual_roughness), mip.face_size,
                                        accuracy_for(job.tolerance), progress);
            mip.texels = std::move(result.texels);
            // A map without excess over its floor is a constant one, and exact.
            const bool constant = tree->mean_excess() == DVec3{0};
            mip.error_estimate =
                kRounding + (constant ? 0 : std::max(result.error_estimate, job.tolerance / 2));
        }
        mips.push_back(std::move(mip));
    }
    return mips;
}

}  // namespace envbake
