// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/brdf.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace envbake::runtime {
namespace {

using std::numbers::pi;

// The projected area of all microfacets is that of the surface: integral of D(h) (n.h) dh = 1.
TEST(GgxD, IsNormalised) {
    for (const double alpha : {0.01, 0.1, 0.5, 1.0}) {
        // tan(theta) = alpha tan(s) flattens the peak; Simpson's rule in s.
        constexpr int kSteps = 4000;
        const double h = pi / 2 / kSteps;
        double sum = 0;
        for (int i = 0; i < kSteps; ++i) {
            const double s = (i + 0.5) * h, tangent = alpha * std::tan(s);
            const double cosine = 1 / std::sqrt(1 + tangent * tangent);
            const double d_theta = alpha / (std::cos(s) * std::cos(s)) * cosine * cosine;
            sum += ggx_d(cosine, alpha) * cosine * std::sqrt(1 - cosine * cosine) * d_theta * h;
        }
        EXPECT_NEAR(2 * pi * sum, 1, 1e-5) << alpha;
    }
}

TEST(BeckmannD, IsNormalised) {
    for (const double alpha : {0.01, 0.1, 0.5, 1.0}) {
        constexpr int kSteps = 4000;
        const double h = pi / 2 / kSteps;
        double sum = 0;
        for (int i = 0; i < kSteps; ++i) {
            const double s = (i + 0.5) * h, tangent = alpha * std::tan(s);
            const double cosine = 1 / std::sqrt(1 + tangent * tangent);
            const double d_theta = alpha / (std::cos(s) * std::cos(s)) * cosine * cosine;
            sum +=
                beckmann_d(cosine, alpha) * cosine * std::sqrt(1 - cosine * cosine) * d_theta * h;
        }
        EXPECT_NEAR(2 * pi * sum, 1, 1e-5) << alpha;
    }
    EXPECT_DOUBLE_EQ(beckmann_d(1.0, 0.25), 1 / (pi * 0.0625));
    EXPECT_EQ(beckmann_d(0.0, 0.25), 0);
    EXPECT_EQ(beckmann_d(1e-30f, 1e-3f), 0);
}

// What defines Lambda: the microfacets that v sees have the projected area of the surface,
// integral of D(h) max(0, v.h) dh = n.v (1 + Lambda(v)).
TEST(BeckmannLambda, MasksJustWhatIsSeenTwice) {
    constexpr int kTheta = 1500, kPhi = 720;
    for (const double alpha : {0.2, 0.6, 1.0}) {
        for (const double n_dot_v : {0.05, 0.3, 0.9}) {
            const double sin_v = std::sqrt(1 - n_dot_v * n_dot_v);
            double sum = 0;
            for (int i = 0; i < kTheta; ++i) {
                const double theta = (i + 0.5) / kTheta * pi / 2;
                const double weight = beckmann_d(std::cos(theta), alpha) * std::sin(theta);
                for (int j = 0; j < kPhi; ++j) {
                    const double phi = 2 * pi * (j + 0.5) / kPhi;
                    sum += weight * std::max(0.0, n_dot_v * std::cos(theta) +
                                                      sin_v * std::sin(theta) * std::cos(phi));
                }
            }
            sum *= pi / 2 / kTheta * 2 * pi / kPhi;
            EXPECT_NEAR(sum, n_dot_v * (1 + beckmann_lambda(n_dot_v, alpha)), 2e-5)
                << alpha << ' ' << n_dot_v;
        }
    }
    EXPECT_EQ(beckmann_lambda(1.0, 0.5), 0);
    EXPECT_GE(beckmann_lambda(0.9f, 0.01f), 0);
}

TEST(GgxD, MatchesTheTangentForm) {
    for (const double alpha : {0.001, 0.3, 1.0}) {
        for (const double c : {0.2, 0.9, 0.99999}) {
            const double tan2 = 1 / (c * c) - 1;
            const double expected =
                1 / (pi * alpha * alpha * std::pow(c, 4) * std::pow(1 + tan2 / (alpha * alpha), 2));
            EXPECT_NEAR(ggx_d(c, alpha) / expected, 1, 1e-9) << alpha << ' ' << c;
        }
    }
    EXPECT_DOUBLE_EQ(ggx_d(1.0, 0.25), 1 / (pi * 0.0625));
    // Float keeps its digits near the peak of a narrow lobe.
    EXPECT_NEAR(ggx_d(0.9999999f, 1e-3f) / ggx_d(double{0.9999999f}, double{1e-3f}), 1, 1e-6);
}

TEST(Smith, LambdaAndVisibilityAreOneTheory) {
    for (const double alpha : {1e-4, 0.05, 0.4, 1.0}) {
        for (const double l : {1e-3, 0.2, 0.7, 1.0}) {
            for (const double v : {1e-3, 0.5, 1.0}) {
                const double g2 = 1 / (1 + ggx_lambda(l, alpha) + ggx_lambda(v, alpha));
                EXPECT_NEAR(smith_visibility(l, v, alpha) * 4 * l * v / g2, 1, 1e-12);
                EXPECT_DOUBLE_EQ(smith_visibility(l, v, alpha), smith_visibility(v, l, alpha));
            }
        }
    }
    const double masked = 1 + beckmann_lambda(0.3, 0.5) + beckmann_lambda(0.6, 0.5);
    EXPECT_NEAR(smith_visibility(Distribution::Beckmann, 0.3, 0.6, 0.5) * 4 * 0.3 * 0.6 * masked, 1,
                1e-14);
    EXPECT_EQ(smith_visibility(Distribution::Ggx, 0.3, 0.6, 0.5), smith_visibility(0.3, 0.6, 0.5));
    // (sqrt(1 + x) - 1) / 2 as the paper has it, where it does not cancel.
    EXPECT_NEAR(ggx_lambda(0.3, 0.8), (std::sqrt(1 + 0.64 * (1 / 0.09 - 1)) - 1) / 2, 1e-15);
    EXPECT_EQ(ggx_lambda(1.0, 0.8), 0);
    EXPECT_NEAR(ggx_lambda(0.5, 1e-9) / (1e-18 * 3 / 4), 1, 1e-12);  // alpha^2 tan^2 / 4
}

TEST(Schlick, EndsAndMiddle) {
    EXPECT_EQ(schlick(0.04, 1.0), 0.04);
    EXPECT_EQ(schlick(0.04, 0.0), 1.0);
    EXPECT_NEAR(schlick_weight(0.25), std::pow(0.75, 5), 1e-16);
}

TEST(TableAxes, PositionsInvertValues) {
    for (const TableAxes axes : {TableAxes::RootsEndPoints, TableAxes::LinearCentres}) {
        for (const TableAxis axis : {TableAxis::NDotV, TableAxis::Roughness}) {
            for (const int size : {2, 17, 128}) {
                for (int i = 0; i < size; ++i) {
                    const double value = table_value<double>(axes, axis, i, size);
                    EXPECT_NEAR(table_position(axes, axis, value, size), i, 1e-12);
                }
                EXPECT_EQ(table_position(axes, axis, 0.0, size), 0);
                EXPECT_EQ(table_position(axes, axis, 1.0, size), size - 1);
                EXPECT_EQ(table_position(axes, axis, std::nan(""), size), 0);
            }
        }
    }
    constexpr auto kRoots = TableAxes::RootsEndPoints;
    EXPECT_DOUBLE_EQ(table_value<double>(kRoots, TableAxis::Roughness, 3, 5), 0.5625);
    EXPECT_DOUBLE_EQ(table_value<double>(kRoots, TableAxis::NDotV, 3, 5), 0.31640625);
    EXPECT_DOUBLE_EQ(table_value<double>(TableAxes::LinearCentres, TableAxis::NDotV, 3, 5), 0.7);
}

}  // namespace
}  // namespace envbake::runtime
