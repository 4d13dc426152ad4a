// SPDX-License-Identifier: Apache-2.0
#include "baker/input/read_environment.h"
#include "baker/lighting/mips.h"
#include "tests/support/every_texel_reference.h"
#include "tests/support/prefilter_reference.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <cstdio>
#include <string>
#include <tuple>
#include <vector>

namespace envbake {
namespace {

using runtime::Distribution;

/// The rough levels of the default mips, compared with brute force in every `every`-th group of 16
/// texels; where that is all of them, so is their energy.
void expect_within_tolerance(const Environment& environment, Distribution distribution,
                             double tolerance, std::size_t every,
                             const std::vector<int>& levels = {1, 2, 3, 4}) {
    std::vector<float> roughness;
    for (const int level : levels) roughness.push_back(0.25f * static_cast<float>(level));
    Progress progress;
    const auto mips = bake_mips({.face_size = 256,
                                 .perceptual_roughness = roughness,
                                 .levels = levels,
                                 .tolerance = tolerance,
                                 .distribution = distribution},
                                environment, progress);
    for (const Mip& mip : mips) {
        const test::EveryTexelReference reference(
            environment, static_cast<double>(mip.perceptual_roughness), distribution);
        const test::MipErrors errors = reference.check(mip, every);
        std::printf(
            "%s %s r = %.2f: worst %.2e of %zu texels, stated %.1e; nRMSE %.1e; energy "
            "%.1e %.1e %.1e\n",
            environment.file_name.c_str(), distribution == Distribution::Ggx ? "ggx" : "beckmann",
            static_cast<double>(mip.perceptual_roughness), errors.worst, errors.checked,
            mip.error_estimate, errors.rms, errors.energy.x, errors.energy.y, errors.energy.z);
        EXPECT_LT(errors.worst, tolerance) << "texel " << errors.texel;
        EXPECT_LE(errors.worst, mip.error_estimate) << "texel " << errors.texel;
        if (every > 1) continue;
        for (int k = 0; k < 3; ++k) EXPECT_LT(std::abs(errors.energy[k]), tolerance / 100) << k;
    }
}

TEST(MipsEveryTexel, ReferenceAgreesWithTheOtherOne) {
    const auto environment = test::sun_and_sky(test::lat_long_grid(64, 32));
    const test::PrefilterReference careful(environment);
    for (const float r : {0.4f, 1.0f}) {
        const test::EveryTexelReference fast(environment, static_cast<double>(r),
                                             Distribution::Ggx);
        Mip mip = test::bake_one(environment, r, 1);
        for (std::size_t i = 0; i < test::texel_count(mip); ++i) {
            const DVec3 value = careful.value(test::direction_of(mip, i), static_cast<double>(r));
            for (int k = 0; k < 3; ++k) {
                mip.texels[i * 3 + test::slot(k)] = static_cast<float>(value[k]);
            }
        }
        EXPECT_LT(fast.check(mip).worst, 2e-5) << r;
    }
}

class MipsOfSkies : public testing::TestWithParam<Distribution> {};

TEST_P(MipsOfSkies, SomeTexels) {
    expect_within_tolerance(test::sun_and_sky(test::lat_long_grid(192, 96)), GetParam(), 1e-3, 601);
}

TEST_P(MipsOfSkies, EveryTexelOfTheRoughest) {
    expect_within_tolerance(test::sun_and_sky(test::lat_long_grid(128, 64)), GetParam(), 1e-3, 1,
                            {3, 4});
}

/// Minutes: for --gtest_also_run_disabled_tests.
TEST_P(MipsOfSkies, DISABLED_EveryTexel) {
    expect_within_tolerance(test::sun_and_sky(test::lat_long_grid(1024, 512)), GetParam(), 1e-3, 1);
}

INSTANTIATE_TEST_SUITE_P(, MipsOfSkies, testing::Values(Distribution::Ggx, Distribution::Beckmann));

class MipsOfPhotographs : public testing::TestWithParam<std::tuple<const char*, Distribution>> {};

TEST_P(MipsOfPhotographs, DISABLED_EveryTexel) {
    const auto& [name, distribution] = GetParam();
    const std::string file = std::string("environments/") + name;
    ENVBAKE_REQUIRE_DATA(file.c_str());
    const auto environment = read_environment(test::data(file.c_str()));
    ASSERT_TRUE(environment) << environment.error();
    expect_within_tolerance(*environment, distribution, 1e-3, 1);
}

INSTANTIATE_TEST_SUITE_P(
    , MipsOfPhotographs,
    testing::Combine(testing::Values("kloppenheim_05_1k.hdr", "dikhololo_night_1k.hdr",
                                     "studio_small_03_1k.hdr", "lebombo_1k.hdr",
                                     "potsdamer_platz_1k.hdr", "courtyard_1k.exr"),
                     testing::Values(Distribution::Ggx, Distribution::Beckmann)));

}  // namespace
}  // namespace envbake
