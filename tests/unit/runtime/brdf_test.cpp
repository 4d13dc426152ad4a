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

// t = tan(theta) / alpha; midpoint rule.
TEST(BeckmannD, IsNormalised) {
    for (const double alpha : {1e-4, 0.01, 0.5, 1.0}) {
        constexpr int kSteps = 4000;
        double sum = 0;
        for (int i = 0; i < kSteps; ++i) {
            const double t = (i + 0.5) * 7 / kSteps, cos2 = 1 / (1 + alpha * t * alpha * t);
            // sin cos dtheta = tan cos^4 dtan
            sum +=
                beckmann_d(std::sqrt(cos2), alpha) * alpha * alpha * t * cos2 * cos2 * 7 / kSteps;
        }
        // Near the peak 1 - cos^2 is known to 1e-16 only, of alpha^2.
        EXPECT_NEAR(2 * pi * sum, 1, 1e-6) << alpha;
    }
}

TEST(BeckmannD, EndsAndMiddle) {
    EXPECT_DOUBLE_EQ(beckmann_d(1.0, 0.25), 1 / (pi * 0.0625));
    EXPECT_NEAR(beckmann_d(0.8, 0.5), std::exp(-2.25) / (pi * 0.25 * 0.4096), 1e-15);
    for (const float alpha : {1e-6f, 1e-3f, 1.0f}) {
        EXPECT_EQ(beckmann_d(0.0f, alpha), 0);
        EXPECT_EQ(beckmann_d(1e-30f, alpha), 0);
        EXPECT_TRUE(std::isfinite(beckmann_d(1.0f, alpha)));
    }
}

// Smith: what faces v, masked, is the area that v sees. Integral of G1 max(0, v.h) D(h) dh = n.v.
TEST(BeckmannLambda, MaskingLeavesTheProjectedArea) {
    for (const double alpha : {0.1, 0.5, 1.0}) {
        for (const double mu : {0.05, 0.3, 0.9}) {
            // Over slopes along and across v: the one across integrates to 1.
            const double cotangent = mu / std::sqrt(1 - mu * mu);
            constexpr int kSteps = 200000;
            double seen = 0;
            for (int i = 0; i < kSteps; ++i) {
                const double slope = ((i + 0.5) / kSteps * 2 - 1) * 7 * alpha;
                const double density =
                    std::exp(-slope * slope / (alpha * alpha)) / (alpha * std::sqrt(pi));
                seen += std::max(0.0, cotangent - slope) * density * 14 * alpha / kSteps;
            }
            EXPECT_NEAR(1 / (1 + beckmann_lambda(mu, alpha)), cotangent / seen, 1e-8)
                << alpha << ' ' << mu;
        }
    }
}

TEST(BeckmannLambda, AndVisibilityAreOneTheory) {
    for (const double alpha : {1e-4, 0.05, 0.4, 1.0}) {
        for (const double l : {1e-3, 0.2, 0.7, 1.0}) {
            for (const double v : {1e-3, 0.5, 1.0}) {
                const double g2 = 1 / (1 + beckmann_lambda(l, alpha) + beckmann_lambda(v, alpha));
                EXPECT_NEAR(beckmann_visibility(l, v, alpha) * 4 * l * v / g2, 1, 1e-12);
                EXPECT_DOUBLE_EQ(beckmann_visibility(l, v, alpha),
                                 beckmann_visibility(v, l, alpha));
                EXPECT_NEAR(beckmann_visibility(static_cast<float>(l), static_cast<float>(v),
                                                static_cast<float>(alpha)) /
                                beckmann_visibility(l, v, alpha),
                            1, 1e-5);
            }
        }
    }
    EXPECT_EQ(beckmann_lambda(1.0, 0.8), 0);
    EXPECT_EQ(beckmann_lambda(0.5, 1e-9), 0);
    EXPECT_EQ(beckmann_lambda(0.5f, 1e-9f), 0);
    // At grazing incidence s = alpha / sqrt(pi): V = 1 / (2 n.l s).
    EXPECT_NEAR(beckmann_visibility(1.0, 0.0, 0.5), std::sqrt(pi), 1e-14);
}

TEST(Smith, LambdaAndVisibilityAreOneTheory) {
    for (const double alpha : {1e-4, 0.05, 0.4, 1.0}) {
        for (const double l : {1e-3, 0.2, 0.7, 1.0}) {
            for (const double v : {1e-3, 0.5, 1.0}) {
                const double g2 = 1 / (1 + ggx_lambda(l, alpha) + ggx_lambda(v, alpha));
                EXPECT_NEAR(ggx_visibility(l, v, alpha) * 4 * l * v / g2, 1, 1e-12);
                EXPECT_DOUBLE_EQ(ggx_visibility(l, v, alpha), ggx_visibility(v, l, alpha));
            }
        }
    }
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
        for (const int size : {2, 17, 128}) {
            for (const TableAxis axis : {TableAxis::NDotV, TableAxis::Roughness}) {
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
    constexpr TableAxes kRoots = TableAxes::RootsEndPoints, kLinear = TableAxes::LinearCentres;
    EXPECT_DOUBLE_EQ(table_value(kRoots, TableAxis::NDotV, 3.0, 5), 0.31640625);  // (3/4)^4
    EXPECT_DOUBLE_EQ(table_value(kRoots, TableAxis::Roughness, 3.0, 5), 0.5625);
    EXPECT_DOUBLE_EQ(table_value(kLinear, TableAxis::NDotV, 3.0, 5), 0.7);
    EXPECT_DOUBLE_EQ(table_value(kLinear, TableAxis::Roughness, 2.5, 5), 0.6);
}

}  // namespace
}  // namespace envbake::runtime
