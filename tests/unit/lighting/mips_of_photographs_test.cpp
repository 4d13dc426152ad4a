// SPDX-License-Identifier: Apache-2.0
#include "baker/input/read_environment.h"
#include "baker/lighting/mips.h"
#include "envbake/runtime/cube.h"
#include "tests/support/prefilter_reference.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace envbake {
namespace {

class MipsOfPhotographs : public testing::TestWithParam<const char*> {};

DVec3 direction_of(std::size_t texel, int face_size) {
    const auto n = static_cast<std::size_t>(face_size);
    const auto w = cube::texel_direction<double>(static_cast<cube::Face>(texel / (n * n)),
                                                 static_cast<int>(texel % (n * n) / n),
                                                 static_cast<int>(texel % n), face_size);
    return {w[0], w[1], w[2]};
}

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
        double flux[3] = {};
        for (std::size_t i = 0; i < mips[0].texels.size(); ++i) {
            const double omega = cube::texel_solid_angle(static_cast<int>(i % 65536 / 256),
                                                         static_cast<int>(i % 256), 256);
            for (int k = 0; k < 3; ++k)
                flux[k] += omega * static_cast<double>(mips[0].texels[i][k]);
        }
        for (int k = 0; k < 3; ++k) {
            EXPECT_NEAR(flux[k] / (4 * std::numbers::pi) / reference.mean()[k], 1, 1e-6);
        }
        for (std::size_t level = 1; level < mips.size(); ++level) {
            const Mip& mip = mips[level];
            RandomStream random(11, level, static_cast<std::uint64_t>(1 / tolerance));
            std::vector<std::size_t> picked;
            picked.push_back(
                static_cast<std::size_t>(random.next() * static_cast<double>(mip.texels.size())));
            std::size_t grazing = 0;
            for (std::size_t i = 0; i < mip.texels.size(); ++i) {
                if (std::abs(glm::dot(sun, direction_of(i, mip.face_size))) <
                    std::abs(glm::dot(sun, direction_of(grazing, mip.face_size)))) {
                    grazing = i;
                }
            }
            picked.push_back(grazing);
            for (const std::size_t i : picked) {
                const DVec3 expected = reference.value(
                    direction_of(i, mip.face_size), static_cast<double>(mip.perceptual_roughness));
                const double error = reference.error(DVec3(mip.texels[i]), expected);
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
