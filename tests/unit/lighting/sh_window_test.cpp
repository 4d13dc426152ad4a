// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/sh_window.h"

#include "baker/core/random.h"
#include "baker/lighting/sh_projection.h"
#include "envbake/runtime/sh.h"
#include "tests/support/environments.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

namespace envbake {
namespace {

using std::numbers::pi;

/// A light of flux `colour` in one direction: l_i = Y_i(w).
ShLighting delta_light(int bands, const DVec3& w, const DVec3& colour = DVec3(1)) {
    std::vector<double> y(static_cast<std::size_t>(sh::coeff_count(bands)));
    sh::evaluate(bands, w.x, w.y, w.z, y.data());
    ShLighting lighting{bands, {}};
    for (const double value : y) lighting.coeffs.push_back(value * colour);
    return lighting;
}

ShLighting constant_light(int bands, const DVec3& radiance) {
    ShLighting lighting{
        bands, std::vector<DVec3>(static_cast<std::size_t>(sh::coeff_count(bands)), DVec3(0))};
    lighting.coeffs[0] = 2 * std::sqrt(pi) * radiance;
    return lighting;
}

DVec3 irradiance(const ShLighting& lighting, const DVec3& n) {
    std::vector<double> y(lighting.coeffs.size());
    sh::evaluate(lighting.bands, n.x, n.y, n.z, y.data());
    DVec3 E(0);
    for (int l = 0; l < lighting.bands; ++l) {
        for (int m = -l; m <= l; ++m) {
            const auto i = static_cast<std::size_t>(sh::index(l, m));
            E += sh::clamped_cosine(l) * y[i] * lighting.coeffs[i];
        }
    }
    return E;
}

DVec3 random_direction(RandomStream& random) {
    const double z = 1 - 2 * random.next(), phi = 2 * pi * random.next();
    const double r = std::sqrt(1 - z * z);
    return {r * std::cos(phi), r * std::sin(phi), z};
}

/// The least irradiance of any channel, over the largest: random directions, then a walk downhill
/// with shrinking steps from the lowest of them.
double least_over_largest(const ShLighting& lighting) {
    RandomStream random(7, 0, 0);
    double least = 1e300, largest = 0;
    std::array<DVec3, 3> at{};
    DVec3 low(1e300);
    for (int i = 0; i < 20000; ++i) {
        const DVec3 n = random_direction(random), E = irradiance(lighting, n);
        for (int c = 0; c < 3; ++c) {
            largest = std::max(largest, E[c]);
            if (E[c] < low[c]) low[c] = E[c], at[static_cast<std::size_t>(c)] = n;
        }
    }
    for (int c = 0; c < 3; ++c) {
        DVec3& n = at[static_cast<std::size_t>(c)];
        for (double step = 0.02; step > 1e-8; step *= 0.9) {
            const DVec3 moved = glm::normalize(n + step * random_direction(random));
            const double E = irradiance(lighting, moved)[c];
            if (E < low[c]) low[c] = E, n = moved;
        }
        least = std::min(least, low[c]);
    }
    return least / largest;
}

// The least lambda for a lone light in 3 bands, from a quadrature of its own: 0.177731851545, with
// w_1 = 0.5845, w_2 = 0.1352; the peak falls from 1.0625 to 0.5845. Of all directions.
TEST(ShWindow, OfALoneLightIsTheKnownOne) {
    RandomStream random(3, 0, 0);
    for (int i = 0; i < 5; ++i) {
        const ShWindow window = nonnegative_window(delta_light(3, random_direction(random)));
        EXPECT_GE(window.lambda, 0.177731851545);
        EXPECT_LT(window.lambda, 0.177731851545 * 1.003);
        EXPECT_NEAR(window.factors[1], 0.584478, 1e-3);
        EXPECT_NEAR(window.factors[2], 0.135165, 1e-3);
        EXPECT_NEAR(window.peak_kept, 0.584478 / 1.0625, 1e-3);
        // sqrt(sum A_l^2 (2 l + 1) (1 - w_l)^2 / sum A_l^2 (2 l + 1))
        const double a0 = pi * pi, a1 = 3 * std::pow(2 * pi / 3, 2), a2 = 5 * pi * pi / 16;
        EXPECT_NEAR(window.rms_loss,
                    std::sqrt((a1 * std::pow(1 - 0.584478, 2) + a2 * std::pow(1 - 0.135165, 2)) /
                              (a0 + a1 + a2)),
                    1e-3);
    }
}

TEST(ShWindow, LeavesNoNegativeIrradianceInAnyChannel) {
    RandomStream random(5, 0, 0);
    for (const int bands : {2, 3, 4, 5, 7, 10}) {
        ShLighting lighting = constant_light(bands, DVec3(0.002, 0.001, 0.003));
        for (int light = 0; light < 2; ++light) {
            const ShLighting one = delta_light(bands, random_direction(random),
                                               DVec3(random.next(), random.next(), random.next()));
            for (std::size_t i = 0; i < one.coeffs.size(); ++i) lighting.coeffs[i] += one.coeffs[i];
        }
        const ShWindow window = nonnegative_window(lighting);
        EXPECT_GE(least_over_largest(windowed(lighting, window)), 0) << bands;
        if (bands == 2) continue;
        // ... and by little more than it takes.
        ASSERT_LT(least_over_largest(lighting), 0) << "the test needs light that rings";
        ShWindow smaller = window;
        for (int l = 0; l < bands; ++l) {
            smaller.factors[static_cast<std::size_t>(l)] =
                1 / (1 + 0.97 * window.lambda * std::pow(l * (l + 1.0), 2));
        }
        EXPECT_LT(least_over_largest(windowed(lighting, smaller)), 0) << bands;
    }
}

TEST(ShWindow, LightThatDoesNotRingIsLeftAsItIs) {
    for (const ShLighting& lighting :
         {constant_light(5, DVec3(1, 2, 3)), constant_light(5, DVec3(0)),
          constant_light(1, DVec3(1)), constant_light(5, DVec3(0, 1e30, 1e-30))}) {
        const ShWindow window = nonnegative_window(lighting);
        EXPECT_EQ(window.lambda, 0);
        EXPECT_EQ(window.rms_loss, 0);
        EXPECT_EQ(window.peak_kept, 1);
        EXPECT_EQ(windowed(lighting, window).coeffs, lighting.coeffs);
    }
}

// Brightness does not matter, colour does not shift.
TEST(ShWindow, ScalesWithTheLight) {
    const DVec3 w = glm::normalize(DVec3(1, 2, 3));
    const double lambda = nonnegative_window(delta_light(5, w)).lambda;
    for (const DVec3& colour : {DVec3(1e30), DVec3(1e-30), DVec3(1, 0, 1e5)}) {
        EXPECT_NEAR(nonnegative_window(delta_light(5, w, colour)).lambda / lambda, 1, 1e-5);
    }
}

}  // namespace
}  // namespace envbake
