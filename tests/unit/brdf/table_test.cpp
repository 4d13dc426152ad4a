// SPDX-License-Identifier: Apache-2.0
#include "baker/brdf/table.h"

#include "baker/core/parallel.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <vector>

namespace envbake {
namespace {

using runtime::TableAxes;
using std::numbers::pi;

double sum(DVec2 v) {
    return v.x + v.y;
}

// alpha = 1 makes D constant: A + B = 1 - mu ln(1 + 1/mu).
TEST(BrdfIntegral, RoughestSurfaceMatchesClosedForm) {
    for (const double mu : {1e-6, 0.01, 0.1, 0.5, 0.999, 1.0}) {
        EXPECT_NEAR(sum(brdf_integral(mu, 1)), 1 - mu * std::log1p(1 / mu), 1e-11) << mu;
    }
}

// E_avg = 2 * integral of mu (A + B) = 4/3 (1 - ln 2) at alpha = 1.
TEST(BrdfIntegral, RoughestSurfaceHasItsAverageAlbedo) {
    double average = 0;
    constexpr int kPoints = 2000;
    for (int i = 0; i < kPoints; ++i) {
        const double mu = (i + 0.5) / kPoints;
        average += 2 * mu * sum(brdf_integral(mu, 1, 12)) / kPoints;
    }
    EXPECT_NEAR(average, 4.0 / 3 * (1 - std::numbers::ln2), 1e-7);  // midpoint rule: h^2 / 3
}

TEST(BrdfIntegral, MirrorIsExactAndItsLimit) {
    for (const double mu : {0.0, 0.05, 0.3, 0.8, 1.0}) {
        const double b = std::pow(1 - mu, 5);
        EXPECT_NEAR(brdf_integral(mu, 0).x, 1 - b, 1e-15);
        EXPECT_NEAR(brdf_integral(mu, 0).y, b, 1e-15);
        if (mu == 0) continue;
        // The distance is that of a lobe of width alpha = 1e-4 seen under mu: (alpha / mu)^2.
        const double bound = 6 * std::pow(1e-4 / mu, 2);
        EXPECT_NEAR(brdf_integral(mu, 0.01).x, 1 - b, bound);
        EXPECT_NEAR(brdf_integral(mu, 0.01).y, b, bound);
        EXPECT_NEAR(brdf_integral(mu, 1e-9).x, 1 - b, 2e-9);
        EXPECT_NEAR(brdf_integral(mu, 1e-9).y, b, 2e-9);
    }
}

// n.v = 1: v.h = n.h, l = reflect(n), A and B are integrals over one angle; the values are from a
// quadrature of those.
TEST(BrdfIntegral, NormalIncidence) {
    const double rows[][3] = {{0.25, 0.915785059323, 2.73709264256e-05},
                              {0.5, 0.687801540158, 4.69749526204e-05},
                              {1.0, 0.306819205145, 3.36142947255e-05}};
    for (const auto& [alpha, a, b] : rows) {
        const DVec2 value = brdf_integral(1, std::sqrt(alpha));
        EXPECT_NEAR(value.x, a, 2e-12);
        EXPECT_NEAR(value.y, b, 1e-15);
    }
}

// From an adaptive quadrature that shares nothing with this one, to 12 digits.
TEST(BrdfIntegral, KnownValues) {
    const double rows[][4] = {{0.00390625, 0.2, 0.376819862244, 0.602781164131},
                              {0.05, 0.2, 0.357711119721, 0.533256993048},
                              {0.05, 0.8, 0.839532233786, 0.0555062020181},
                              {0.3, 0.5, 0.772535514677, 0.0653702498986},
                              {0.7, 0.5, 0.880774731731, 0.00456102027694},
                              {0.95, 0.9, 0.427345052047, 0.000117187757632}};
    for (const auto& [mu, r, a, b] : rows) {
        const DVec2 value = brdf_integral(mu, r);
        EXPECT_NEAR(value.x, a, 2e-12) << mu << ' ' << r;
        EXPECT_NEAR(value.y, b, 2e-12) << mu << ' ' << r;
    }
}

// At grazing incidence nothing is lost, whatever the roughness: A + B = 1. At alpha = 1 the
// half vectors have the density 2 x / pi, x = v.h, and B = 2 * integral of (1 - x)^5 x = 1 / 21.
TEST(BrdfIntegral, GrazingIncidence) {
    for (const double r : {1e-5, 1e-3, 0.0625, 0.25, 0.5, 1.0}) {
        const DVec2 value = brdf_integral(0, r);
        EXPECT_NEAR(sum(value), 1, 2e-10) << r;
        // The value at 0 is the limit: the approach is that of mu ln(mu) / alpha.
        const DVec2 near = brdf_integral(1e-9 * r * r, r);
        EXPECT_NEAR(near.x, value.x, 1e-7) << r;
        EXPECT_NEAR(near.y, value.y, 1e-7) << r;
    }
    EXPECT_NEAR(brdf_integral(0, 1).y, 1.0 / 21, 1e-10);
}

// A and B straight from their definition: over l, by the midpoint rule, with D, G and F written
// with angles and tangents as the papers have them.
DVec2 by_definition(double mu, double r) {
    const double alpha = r * r;
    const auto lambda = [&](double theta) {
        const double a = 1 / (alpha * std::tan(theta));
        return (std::sqrt(1 + 1 / (a * a)) - 1) / 2;
    };
    const double theta_v = std::acos(mu);
    const DVec3 v(std::sin(theta_v), 0, mu);
    constexpr int kTheta = 1200, kPhi = 600;
    DVec2 value(0);
    for (int i = 0; i < kTheta; ++i) {
        const double theta = (i + 0.5) / kTheta * pi / 2;
        DVec2 ring(0);
        for (int j = 0; j < kPhi; ++j) {
            const double phi = (j + 0.5) / kPhi * pi;
            const DVec3 l(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi),
                          std::cos(theta));
            const DVec3 h = glm::normalize(l + v);
            const double t2 = (1 - h.z * h.z) / (h.z * h.z);
            const double d =
                1 / (pi * alpha * alpha * std::pow(h.z, 4) * std::pow(1 + t2 / (alpha * alpha), 2));
            const double g = 1 / (1 + lambda(theta) + lambda(theta_v));
            const double f = d * g / (4 * mu * l.z) * l.z;
            const double fresnel = std::pow(1 - glm::dot(v, h), 5);
            ring += f * DVec2(1 - fresnel, fresnel);
        }
        value += ring * std::sin(theta);
    }
    return value * (pi / 2 / kTheta * 2 * pi / kPhi);
}

TEST(BrdfIntegral, MatchesTheDefinition) {
    for (const auto& [mu, r] : {std::pair{0.9, 0.4}, {0.5, 0.6}, {0.2, 0.8}, {0.1, 1.0}}) {
        const DVec2 expected = by_definition(mu, r), value = brdf_integral(mu, r);
        // The midpoint rule's error, measured by halving both counts: below 1e-6.
        EXPECT_NEAR(value.x, expected.x, 2e-6) << mu << ' ' << r;
        EXPECT_NEAR(value.y, expected.y, 2e-6) << mu << ' ' << r;
    }
}

class Table : public testing::TestWithParam<TableAxes> {};
INSTANTIATE_TEST_SUITE_P(Axes, Table,
                         testing::Values(TableAxes::RootsEndPoints, TableAxes::LinearCentres));

TEST_P(Table, EveryTexelIsTrueAndAnAlbedo) {
    for (const int size : {2, 3, 21}) {
        const BrdfTable table = bake_brdf_table({.size = size, .axes = GetParam()});
        ASSERT_EQ(table.size, size);
        ASSERT_EQ(table.texels.size(), static_cast<std::size_t>(size * size));
        double worst = 0;
        for (int row = 0; row < size; ++row) {
            for (int column = 0; column < size; ++column) {
                // Positions written out: what the metadata promises, not what the code computes.
                const bool sqrt_axes = GetParam() == TableAxes::RootsEndPoints;
                const auto at = [&](int i) {
                    return sqrt_axes ? std::pow(i / (size - 1.0), 2) : (i + 0.5) / size;
                };
                const Vec2 texel = table.texels[static_cast<std::size_t>(row * size + column)];
                const DVec2 truth = brdf_integral(at(column), at(row), 40);
                worst = std::max({worst, std::abs(static_cast<double>(texel.x) - truth.x),
                                  std::abs(static_cast<double>(texel.y) - truth.y)});
                EXPECT_GE(texel.x, 0);
                EXPECT_GE(texel.y, 0);
                EXPECT_LE(sum(texel), 1);
            }
        }
        EXPECT_LT(worst, 6e-7) << size;  // 5e-7 measured at 128 x 128
        // A sample cannot exceed the whole; 64 of so few texels come near it.
        EXPECT_LE(table.texel_error, worst + 1e-9);
        EXPECT_GT(table.texel_error, 0);
    }
}

TEST_P(Table, LookUpErrorIsMeasuredNotFlattered) {
    const BrdfTable table = bake_brdf_table({.size = 32, .axes = GetParam()});
    // Another sample, another look-up: a clamped bilinear filter written in texel coordinates.
    double worst = 0, square_sum = 0;
    constexpr int kPoints = 1500;
    for (int i = 0; i < kPoints; ++i) {
        // An R2 sequence, [Roberts18].
        const double mu = std::fmod(0.5 + 0.7548776662466927 * i, 1) * (i % 3 == 0 ? 0.1 : 1.0);
        const double r = std::fmod(0.5 + 0.5698402909980532 * i, 1);
        const bool sqrt_axes = GetParam() == TableAxes::RootsEndPoints;
        const auto place = [&](double x) {
            return std::clamp(sqrt_axes ? std::sqrt(x) * 31 : x * 32 - 0.5, 0.0, 31.0);
        };
        const double x = place(mu), y = place(r);
        DVec2 found(0);
        for (int row = 0; row < 32; ++row) {
            for (int column = 0; column < 32; ++column) {
                const double weight =
                    std::max(0.0, 1 - std::abs(x - column)) * std::max(0.0, 1 - std::abs(y - row));
                if (weight > 0) {
                    const std::size_t texel = static_cast<std::size_t>(row * 32 + column);
                    found += weight * DVec2(table.texels[texel]);
                }
            }
        }
        const DVec2 e = found - brdf_integral(mu, r, 16);
        worst = std::max({worst, std::abs(e.x), std::abs(e.y)});
        square_sum += glm::dot(e, e);
    }
    const double rms = std::sqrt(square_sum / (2 * kPoints));
    EXPECT_GT(table.lookup_error, 0.3 * worst);
    EXPECT_LT(table.lookup_error, 4 * worst);
    EXPECT_GT(table.lookup_error_rms, 0.7 * rms);
    EXPECT_LT(table.lookup_error_rms, 1.4 * rms);
}

TEST_P(Table, SameBitsOnAnyNumberOfThreads) {
    std::vector<Vec2> one;
    {
        const ThreadLimit limit(1);
        one = bake_brdf_table({.size = 37, .axes = GetParam()}).texels;
    }
    const ThreadLimit limit(4);
    const std::vector<Vec2> four = bake_brdf_table({.size = 37, .axes = GetParam()}).texels;
    ASSERT_EQ(one.size(), four.size());
    EXPECT_EQ(std::memcmp(one.data(), four.data(), one.size() * sizeof(Vec2)), 0);
}

// The reason for the default axes: fewer texels, a smaller error.
TEST(Table, DefaultAxesLookUpBetter) {
    const BrdfTable sqrt_axes = bake_brdf_table({.size = 64});
    const BrdfTable linear = bake_brdf_table({.size = 96, .axes = TableAxes::LinearCentres});
    EXPECT_LT(sqrt_axes.lookup_error, 0.5 * linear.lookup_error);
    EXPECT_LT(sqrt_axes.lookup_error_rms, 0.5 * linear.lookup_error_rms);
    EXPECT_LT(sqrt_axes.lookup_error_rms, 3.5e-4);  // 2.7e-4 measured
}

}  // namespace
}  // namespace envbake
