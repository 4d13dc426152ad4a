// SPDX-License-Identifier: Apache-2.0
#include "baker/input/read_environment.h"
#include "baker/lighting/mips.h"
#include "envbake/runtime/cube.h"
#include "tests/support/baked_mip.h"
#include "tests/support/prefilter_reference.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace envbake {
namespace {

using test::direction_of;
using test::texel_count;
using test::texel_of;

class MipsOfPhotographs : public testing::TestWithParam<const char*> {};

/// Random texels, and one whose horizon runs through the brightest texel of the map.
TEST_P(MipsOfPhotographs, MatchBruteForce) {
    const std::string file = std::string("environments/") + GetParam();
    ENVBAKE_REQUIRE_DATA(file.c_str());
    const auto environment = read_environment(test::data(file.c_str()));
    ASSERT_TRUE(environment) << environment.error();
    const test::PrefilterReference reference(*environment);
    const auto texels = test::texels_of(environment->grid);
    std::size_t brightest = 0;
    for (std::size_t i = 0; i < texels.size(); ++i) {
        if (environment->radiance[i].g > environment->radiance[brightest].g) brightest = i;
    }
    const DVec3 sun = texels[brightest].middle();

    for (const double tolerance : {1e-3, 1e-2}) {
        Progress progress;
        const auto mips = bake_mips({.face_size = 256,
                                     .perceptual_roughness = {0, 0.25f, 0.5f, 1},
                                     .levels = {0, 1, 2, 4},
                                     .tolerance = tolerance},
                                    *environment, progress);
        const DVec3 kept = test::average_of(mips[0]);
        for (int k = 0; k < 3; ++k) EXPECT_NEAR(kept[k] / reference.mean()[k], 1, 1e-6);
        for (std::size_t level = 1; level < mips.size(); ++level) {
            const Mip& mip = mips[level];
            RandomStream random(11, level, static_cast<std::uint64_t>(1 / tolerance));
            std::vector<std::size_t> picked;
            picked.push_back(
                static_cast<std::size_t>(random.next() * static_cast<double>(texel_count(mip))));
            std::size_t grazing = 0;
            for (std::size_t i = 0; i < texel_count(mip); ++i) {
                if (std::abs(glm::dot(sun, direction_of(mip, i))) <
                    std::abs(glm::dot(sun, direction_of(mip, grazing)))) {
                    grazing = i;
                }
            }
            picked.push_back(grazing);
            for (const std::size_t i : picked) {
                const DVec3 expected = reference.value(
                    direction_of(mip, i), static_cast<double>(mip.perceptual_roughness));
                const double error = reference.error(texel_of(mip, i), expected);
                EXPECT_LT(error, tolerance) << "level " << level << " texel " << i;
                EXPECT_LE(error, mip.error_estimate) << "level " << level << " texel " << i;
            }
        }
    }
}

INSTANTIATE_TEST_SUITE_P(, MipsOfPhotographs,
                         testing::Values("kloppenheim_05_1k.hdr", "dikhololo_night_1k.hdr",
                                         "studio_small_03_1k.hdr", "lebombo_1k.hdr",
                                         "potsdamer_platz_1k.hdr", "courtyard_1k.exr"));

}  // namespace
}  // namespace envbake
