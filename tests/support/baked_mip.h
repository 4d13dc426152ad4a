// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/lighting/mips.h"
#include "envbake/runtime/cube.h"
#include "envbake/runtime/lat_long.h"
#include "tests/support/prefilter_reference.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

/// What tests ask of a mip, whatever its layout and channels.
namespace envbake::test {

/// One mip of `job`, of its face_size, at this roughness.
inline Mip bake_one(const Environment& environment, float roughness, MipsJob job) {
    Progress progress;
    job.perceptual_roughness = {roughness};
    job.levels = {0};
    return bake_mips(job, environment, progress).at(0);
}
inline Mip bake_one(const Environment& environment, float roughness, int face_size,
                    double tolerance = 1e-3) {
    MipsJob job;
    job.face_size = face_size;
    job.tolerance = tolerance;
    return bake_one(environment, roughness, job);
}

inline std::size_t texel_count(const Mip& mip) {
    return slot(mip.faces) * slot(mip.height) * slot(mip.width);
}

/// Red stands for all where there is one channel.
inline DVec3 texel_of(const Mip& mip, std::size_t texel) {
    const float* at = mip.texels.data() + texel * slot(mip.channels);
    return mip.channels == 1 ? DVec3(at[0]) : DVec3(at[0], at[1], at[2]);
}

inline DVec3 direction_of(const Mip& mip, std::size_t texel) {
    const int row = static_cast<int>(texel / slot(mip.width) % slot(mip.height));
    const int column = static_cast<int>(texel % slot(mip.width));
    if (mip.faces == 1) {
        const auto w = lat_long::direction((column + 0.5) / mip.width, (row + 0.5) / mip.height);
        return {w[0], w[1], w[2]};
    }
    const auto face = static_cast<cube::Face>(texel / slot(mip.width) / slot(mip.height));
    const auto w = cube::texel_direction<double>(face, row, column, mip.width);
    return {w[0], w[1], w[2]};
}

inline double solid_angle_of(const Mip& mip, std::size_t texel) {
    const int row = static_cast<int>(texel / slot(mip.width) % slot(mip.height));
    if (mip.faces == 1) {
        const double step = std::numbers::pi / mip.height;
        return (std::cos(step * row) - std::cos(step * (row + 1))) * 2 * std::numbers::pi /
               mip.width;
    }
    return cube::texel_solid_angle(row, static_cast<int>(texel % slot(mip.width)), mip.width);
}

inline DVec3 average_of(const Mip& mip) {
    DVec3 sum{0};
    for (std::size_t i = 0; i < texel_count(mip); ++i) {
        sum += texel_of(mip, i) * solid_angle_of(mip, i);
    }
    return sum / (4 * std::numbers::pi);
}

/// The worst error of some texels (all, where `count` is 0) against brute force.
inline double worst_error(const Mip& mip, const PrefilterReference& reference, int count,
                          std::uint64_t seed = 1) {
    double worst = 0;
    const std::size_t total = texel_count(mip), n = count > 0 ? slot(count) : total;
    RandomStream random(seed, 7, slot(mip.level));
    for (std::size_t i = 0; i < n; ++i) {
        const std::size_t texel =
            count > 0 ? static_cast<std::size_t>(random.next() * static_cast<double>(total)) : i;
        const auto r = static_cast<double>(mip.perceptual_roughness);
        worst = std::max(worst, reference.error(texel_of(mip, texel),
                                                reference.value(direction_of(mip, texel), r)));
    }
    return worst;
}

}  // namespace envbake::test
