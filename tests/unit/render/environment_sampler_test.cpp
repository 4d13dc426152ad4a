// SPDX-License-Identifier: Apache-2.0
#include "baker/render/environment_sampler.h"

#include "baker/core/random.h"
#include "tests/unit/render/test_scenes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

namespace envbake {
namespace {

constexpr double kPi = std::numbers::pi;

Vec3 random_radiance(RandomStream& random) {
    // Some texels black, one in ten a hundred times as bright.
    const double pick = random.next();
    const double scale = pick < 0.2 ? 0 : pick > 0.9 ? 100 : 1;
    return Vec3(DVec3(random.next(), random.next(), random.next()) * scale);
}

std::vector<Environment> environments() {
    RandomStream random(1, 2, 3);
    std::vector<Environment> all;
    all.push_back(
        test::lat_long_environment(9, 5, [&](int, int) { return random_radiance(random); }));
    // Edges as OpenEXR has them: half a texel at the seam and at the poles.
    Environment uneven;
    LatLongGrid grid;
    grid.width = 6;
    grid.height = 4;
    grid.theta_edges = {0, kPi / 6, kPi / 2, 5 * kPi / 6, kPi};
    grid.phi_edges = {-0.3, 0.3, 1.5, 2.7, 3.9, 5.1, 2 * kPi - 0.3};
    uneven.grid = grid;
    for (int i = 0; i < 24; ++i) uneven.radiance.push_back(random_radiance(random));
    all.push_back(uneven);
    Environment cube;
    cube.grid = make_cube_grid(3);
    for (int i = 0; i < 54; ++i) cube.radiance.push_back(random_radiance(random));
    all.push_back(cube);
    return all;
}

/// Evenly spread directions: a spherical Fibonacci lattice.
DVec3 lattice_direction(int i, int count) {
    const double z = 1 - (2 * i + 1.0) / count;
    const double phi = 2 * kPi * std::fmod(i * 0.6180339887498949, 1.0);
    const double r = std::sqrt(1 - z * z);
    return {r * std::cos(phi), r * std::sin(phi), z};
}

TEST(EnvironmentSampler, DensityIntegratesToOne) {
    for (const Environment& environment : environments()) {
        const EnvironmentSampler sampler(environment);
        constexpr int kCount = 400'000;
        double sum = 0;
        for (int i = 0; i < kCount; ++i) sum += sampler.towards(lattice_direction(i, kCount)).pdf;
        // A lattice of n points misjudges texel borders by O(n^-1/2) of a texel at worst.
        EXPECT_NEAR(sum * 4 * kPi / kCount, 1, 2e-3);
    }
}

TEST(EnvironmentSampler, SeesTheTexelThatTheEnvironmentHas) {
    for (const Environment& environment : environments()) {
        const EnvironmentSampler sampler(environment);
        constexpr int kCount = 20'000;
        for (int i = 0; i < kCount; ++i) {
            const DVec3 w = lattice_direction(i, kCount);
            ASSERT_EQ(sampler.towards(w).radiance, radiance_towards(environment, w));
        }
    }
}

TEST(EnvironmentSampler, SamplesAgreeWithTheirDensity) {
    for (const Environment& environment : environments()) {
        const EnvironmentSampler sampler(environment);
        RandomStream random(7, 7, 7);
        // By importance sampling, and by a plain sum over a lattice: the integral of L max(0, w.x).
        double estimate = 0, expected = 0;
        constexpr int kCount = 200'000;
        for (int i = 0; i < kCount; ++i) {
            const auto light = sampler.sample(random.next(), random.next());
            ASSERT_GT(light.pdf, 0);
            ASSERT_NEAR(glm::length(light.direction), 1, 1e-12);
            const auto seen = sampler.towards(light.direction);
            ASSERT_EQ(seen.radiance, light.radiance);
            ASSERT_NEAR(seen.pdf / light.pdf, 1, 1e-9);
            estimate += luminance(DVec3(light.radiance)) * std::max(0.0, light.direction.x) /
                        light.pdf / kCount;
            const DVec3 w = lattice_direction(i, kCount);
            expected += luminance(DVec3(radiance_towards(environment, w))) * std::max(0.0, w.x) *
                        4 * kPi / kCount;
        }
        // Luminance over density is constant, so only the cosine is noise: sigma < 0.5 of the
        // largest value over sqrt(n); 5 sigma is 0.6 %.
        EXPECT_NEAR(estimate / expected, 1, 1.2e-2);
    }
}

// Columns of a lat-long map run clockwise seen from above: a quarter turn the other way is a map
// that is read a quarter of its width further to the right.
TEST(EnvironmentSampler, TurnsAsAShiftedMap) {
    RandomStream random(4, 5, 6);
    const Environment map =
        test::lat_long_environment(8, 5, [&](int, int) { return random_radiance(random); });
    Environment shifted = map;
    for (std::size_t i = 0; i < 40; ++i)
        shifted.radiance[i] = map.radiance[i / 8 * 8 + (i % 8 + 2) % 8];
    const EnvironmentSampler turned(map, LightTurn(kPi / 2)), truth(shifted);
    for (int i = 0; i < 1000; ++i) {
        const DVec3 w = lattice_direction(i, 1000);
        const auto a = turned.towards(w), b = truth.towards(w);
        EXPECT_EQ(a.radiance, b.radiance) << i;
        EXPECT_NEAR(a.pdf, b.pdf, 1e-12);
        EXPECT_EQ(a.direction, w);
        const auto picked = turned.sample(random.next(), random.next());
        const auto there = truth.towards(picked.direction);
        EXPECT_EQ(picked.radiance, there.radiance);
        EXPECT_NEAR(picked.pdf, there.pdf, 1e-12);
    }
}

TEST(EnvironmentSampler, NeverPicksABlackTexel) {
    const Environment environment = test::lat_long_environment(
        8, 4, [](int row, int column) { return Vec3(row == 2 && column == 5 ? 3.0f : 0.0f); });
    const EnvironmentSampler sampler(environment);
    for (const double u : {0.0, 0.25, 0.5, 1 - 0x1p-53}) {
        for (const double v : {0.0, 0.5, 1 - 0x1p-53}) {
            EXPECT_EQ(sampler.sample(u, v).radiance.x, 3.0f) << u << " " << v;
        }
    }
}

TEST(EnvironmentSampler, ABlackEnvironmentGivesNothing) {
    const Environment environment = test::constant_environment(0);
    const EnvironmentSampler sampler(environment);
    EXPECT_EQ(sampler.sample(0.3, 0.7).pdf, 0);
    EXPECT_EQ(sampler.towards(DVec3(0, 1, 0)).pdf, 0);
}

}  // namespace
}  // namespace envbake
