// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/multiple_scattering.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace envbake::runtime {
namespace {

// GGX of alpha = 1 has its albedo in closed form.
double rough_albedo(double mu) {
    return mu > 0 ? 1 - mu * std::log1p(1 / mu) : 1;
}
constexpr double kRoughAverage = 4.0 / 3 * (1 - std::numbers::ln2);

TEST(MultipleScattering, AverageFresnelIsTheMeanOfSchlick) {
    for (const double r0 : {0.0, 0.04, 0.5, 1.0}) {
        double mean = 0;
        constexpr int kPoints = 20000;
        for (int i = 0; i < kPoints; ++i) {
            const double c = (i + 0.5) / kPoints;
            mean += 2 * c * (r0 + (1 - r0) * std::pow(1 - c, 5)) / kPoints;
        }
        EXPECT_NEAR(average_fresnel(r0), mean, 1e-8) << r0;
        EXPECT_NEAR(average_fresnel(r0), (20 * r0 + 1) / 21, 1e-15) << r0;
    }
}

// Bounce by bounce: E of what arrives leaves, the rest meets another facet.
TEST(MultipleScattering, FresnelIsTheSumOverBounces) {
    for (const double r0 : {0.0, 0.04, 0.5, 0.95}) {
        for (const double average : {0.4, 0.7, 0.99}) {
            const double f = average_fresnel(r0);
            double inside = f * (1 - average), kept = 0;  // after the first bounce
            for (int bounce = 2; bounce < 2000; ++bounce) {
                kept += inside * f * average;
                inside *= f * (1 - average);
            }
            EXPECT_NEAR(multiple_scattering_fresnel(r0, average) * (1 - average), kept, 1e-14);
        }
    }
}

TEST(MultipleScattering, TheLobeReturnsWhatOneBounceLost) {
    for (const double mu : {0.0, 0.01, 0.5, 1.0}) {
        double sum = 0;
        constexpr int kPoints = 20000;
        for (int i = 0; i < kPoints; ++i) {
            const double c = (i + 0.5) / kPoints;
            sum += 2 * std::numbers::pi * c / kPoints *
                   multiple_scattering_lobe(rough_albedo(c), rough_albedo(mu), kRoughAverage);
        }
        EXPECT_NEAR(rough_albedo(mu) + sum, 1, 1e-7) << mu;
    }
    const double there = multiple_scattering_lobe(0.5, 0.8, 0.7);
    EXPECT_EQ(there, multiple_scattering_lobe(0.8, 0.5, 0.7));
    EXPECT_NEAR(there, 0.5 * 0.2 / (std::numbers::pi * 0.3), 1e-15);
}

TEST(MultipleScattering, AMirrorAndAMissingTableStayFinite) {
    EXPECT_EQ(multiple_scattering_lobe(1.0f, 1.0f, 1.0f), 0);
    EXPECT_EQ(multiple_scattering_fresnel(1.0f, 1.0f), 1);
    EXPECT_EQ(multiple_scattering_scale(1.0f, 1.0f), 1);
    EXPECT_EQ(environment_weights(1.0f, 0.75f, 0.25f).single, 1);
    EXPECT_EQ(environment_weights(1.0f, 0.75f, 0.25f).multiple, 0);

    EXPECT_EQ(multiple_scattering_fresnel(1.0f, 0.0f), 0);
    EXPECT_EQ(multiple_scattering_scale(1.0f, 0.0f), 1);
    EXPECT_EQ(environment_weights(1.0f, 0.0f, 0.0f).multiple, 0);
}

// White stays white, and nothing in between shines: over all A, B with A + B <= 1.
TEST(MultipleScattering, WhiteFurnaceAndEnergy) {
    for (double a = 0; a <= 1; a += 0.05) {
        for (double b = 0; a + b <= 1; b += 0.05) {
            const double albedo = a + b;
            if (albedo == 0) continue;
            EXPECT_NEAR(albedo * multiple_scattering_scale(1.0, albedo), 1, 1e-14);
            const EnvironmentWeights<double> white = environment_weights(1.0, a, b);
            EXPECT_NEAR(white.single + white.multiple, 1, 1e-14);

            for (double r0 = 0; r0 <= 1; r0 += 0.125) {
                const double one = r0 * a + b;
                EXPECT_LE(one * multiple_scattering_scale(r0, albedo), 1 + 1e-15);
                EXPECT_GE(one * multiple_scattering_scale(r0, albedo), one);
                const EnvironmentWeights<double> w = environment_weights(r0, a, b);
                EXPECT_EQ(w.single, one);
                EXPECT_GE(w.multiple, 0);
                EXPECT_GE(w.diffuse, -1e-15);
                EXPECT_NEAR(w.single + w.multiple + w.diffuse, 1, 1e-15);
                for (const double average : {0.4, 0.9, 1.0}) {
                    const double fresnel = multiple_scattering_fresnel(r0, average);
                    EXPECT_GE(fresnel, 0);
                    EXPECT_LE(one + fresnel * (1 - albedo), 1 + 1e-15);
                }
            }
        }
    }
}

// The trap of the header, and why: half a metal is not a metal of half the r0.
TEST(MultipleScattering, MixingR0FirstLosesEnergy) {
    const double half_metal = (0.04 + 1) / 2;
    const double mixed =
        (multiple_scattering_fresnel(0.04, 0.41) + multiple_scattering_fresnel(1.0, 0.41)) / 2;
    EXPECT_LT(multiple_scattering_fresnel(half_metal, 0.41), mixed - 0.1);
    EXPECT_LT(environment_weights(half_metal, 0.4, 0.01).multiple,
              (environment_weights(0.04, 0.4, 0.01).multiple +
               environment_weights(1.0, 0.4, 0.01).multiple) /
                      2 -
                  0.1);
}

}  // namespace
}  // namespace envbake::runtime
