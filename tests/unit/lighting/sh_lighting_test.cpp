// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/sh_lighting.h"

#include "baker/core/random.h"
#include "baker/math/quadrature.h"
#include "envbake/runtime/sh.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

namespace envbake {
namespace {

using std::numbers::pi;

std::size_t slot(int l, int m) {
    return static_cast<std::size_t>(sh::index(l, m));
}

ShLighting random_lighting(int bands) {
    ShLighting lighting{bands, {}};
    RandomStream random(2, 0, 0);
    for (int i = 0; i < sh::coeff_count(bands); ++i) {
        lighting.coeffs.emplace_back(random.next(), random.next(), random.next());
    }
    return lighting;
}

TEST(ShLighting, IrradianceHasTheClampedCosineFoldedIn) {
    const ShLighting lighting = random_lighting(5), irradiance = to_irradiance(lighting);
    const double factors[] = {pi, 2 * pi / 3, pi / 4, 0, -pi / 24};
    for (int l = 0; l < 5; ++l) {
        for (int m = -l; m <= l; ++m) {
            EXPECT_NEAR(irradiance.coeffs[slot(l, m)].y, factors[l] * lighting.coeffs[slot(l, m)].y,
                        1e-15);
        }
    }
}

TEST(BandEnergy, IsRelativeToTheMeanAndOfTheWorstChannel) {
    ShLighting lighting{3, std::vector<DVec3>(9, DVec3(0))};
    lighting.coeffs[0] = DVec3(2e20, 1, 0);
    lighting.coeffs[slot(1, -1)] = DVec3(1e20, 0, 0);
    lighting.coeffs[slot(1, 1)] = DVec3(1e20, 0.1, 0);
    lighting.coeffs[slot(2, 0)] = DVec3(0, 3, 0);
    const std::vector<double> energy = band_energy(lighting);
    ASSERT_EQ(energy.size(), 3u);
    EXPECT_DOUBLE_EQ(energy[0], 1);
    EXPECT_DOUBLE_EQ(energy[1], 0.5);
    EXPECT_DOUBLE_EQ(energy[2], 9);
    EXPECT_EQ(band_energy({2, std::vector<DVec3>(4, DVec3(0))}), (std::vector<double>{0, 0}));
}

TEST(BandsWorthStoring, DropsFromTheLastBandOn) {
    const double limit = 3.0 / 8 * 1e-4;  // of the energies dropped, at a tolerance of 1e-2
    EXPECT_EQ(bands_worth_storing({1, 0.1, 0.9 * limit}, 1e-2), 2);
    EXPECT_EQ(bands_worth_storing({1, 0.1, 1.1 * limit}, 1e-2), 3);
    EXPECT_EQ(bands_worth_storing({1, 0.6 * limit, 0.6 * limit}, 1e-2), 2) << "they add up";
    EXPECT_EQ(bands_worth_storing({1, 0.4 * limit, 0.4 * limit}, 1e-2), 1);
    EXPECT_EQ(bands_worth_storing({1, 0, 0.5}, 1e-2), 3);
    EXPECT_EQ(bands_worth_storing({0, 0, 0}, 1e-2), 1) << "black";
    EXPECT_EQ(bands_worth_storing({1}, 1e-2), 1);
}

// The bound that is promised: a diffuse vertex that sees the directions of any mask changes by less
// than the tolerance.
TEST(BandsWorthStoring, HoldsForAnyVisibility) {
    constexpr int kBands = 6;
    ShLighting lighting = random_lighting(kBands);
    lighting.coeffs[0] = DVec3(4);
    for (int l = 1; l < kBands; ++l) {
        for (int m = -l; m <= l; ++m) lighting.coeffs[slot(l, m)] *= std::pow(0.25, l);
    }
    const int kept = bands_worth_storing(band_energy(lighting), 0.05);
    ASSERT_GT(kept, 1);
    ASSERT_LT(kept, kBands);
    const Quadrature rule = gauss_legendre(48);
    double worst = 0;
    for (int mask = 0; mask < 20; ++mask) {
        RandomStream random(9, 0, static_cast<std::uint64_t>(mask));
        const double tilt = random.next(), turn = 6 * random.next(), edge = random.next();
        double all = 0;
        for (std::size_t i = 0; i < rule.nodes.size(); ++i) {
            const double z = (1 + rule.nodes[i]) / 2, r = std::sqrt(1 - z * z);
            for (int j = 0; j < 96; ++j) {
                const double phi = 2 * pi * j / 96;
                const DVec3 w(r * std::cos(phi), r * std::sin(phi), z);
                if (w.x * std::cos(turn) + w.z * tilt > edge) continue;  // something in the way
                std::vector<double> y(lighting.coeffs.size());
                sh::evaluate(kBands, w.x, w.y, w.z, y.data());
                double dropped = 0;
                for (int l = kept; l < kBands; ++l) {
                    for (int m = -l; m <= l; ++m)
                        dropped += lighting.coeffs[slot(l, m)].x * y[slot(l, m)];
                }
                all += dropped * z / pi * rule.weights[i] / 2 * 2 * pi / 96;
            }
        }
        worst = std::max(worst, std::abs(all));
    }
    const double mean_radiance = 4 / (2 * std::sqrt(pi));
    EXPECT_LT(worst, 0.05 * mean_radiance);
    EXPECT_GT(worst, 0.0005 * mean_radiance) << "the test must have something to drop";
}

}  // namespace
}  // namespace envbake
