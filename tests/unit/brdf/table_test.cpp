// SPDX-License-Identifier: Apache-2.0
#include "baker/brdf/table.h"

#include "baker/brdf/albedo_integral.h"
#include "baker/core/parallel.h"
#include "baker/math/quadrature.h"
#include "envbake/runtime/half.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <numbers>
#include <tuple>
#include <vector>

namespace envbake {
namespace {

using runtime::TableAxes;
using std::numbers::pi;

using runtime::Distribution;
using runtime::TableAxis;

constexpr Distribution kGgx = Distribution::Ggx, kBeckmann = Distribution::Beckmann;

double sum(DVec2 v) {
    return v.x + v.y;
}

double worse(DVec2 a, DVec2 b) {
    return std::max(std::abs(a.x - b.x), std::abs(a.y - b.y));
}

// The truth by another road, for n.v > 0: over the slopes rho (cos(phi), sin(phi)) of the facets,
// with G2 from Lambdas as in the papers. With k = tan(theta_v) cos(phi),
//
//     v.h / (n.h n.v) = 1 - rho k,    n.l = n.v (1 - 2 rho k - rho^2) / (1 + rho^2)
//
// so that l is above the horizon inside a disc, rho < exp(-asinh(k)), which the panels of
// phi approach where k changes its sign. Measured: within 6e-9 of finer rules down to n.v = 1e-9.
DVec2 over_slopes(Distribution distribution, double mu, double r) {
    const bool is_ggx = distribution == kGgx;
    const double alpha = r * r, tan_v = std::sqrt((1 - mu) * (1 + mu)) / mu;
    const auto lambda = [&](double cosine) {
        const double sine = std::sqrt((1 - cosine) * (1 + cosine));
        if (!(sine > 0)) return 0.0;
        const double a = cosine / (alpha * sine);
        if (is_ggx) {
            const double x = 1 / (a * a);
            return x / (2 * (std::sqrt(1 + x) + 1));
        }
        return a > 26 ? 0 : std::exp(-a * a) / (2 * a * std::sqrt(pi)) - std::erfc(a) / 2;
    };
    static const Quadrature kPhi = gauss_legendre(10), kRho = gauss_legendre(64);
    std::vector<double> edges{0};  // of pi/2 - phi
    for (double edge = std::min(mu, 0.5); edge < 0.8; edge *= 2) edges.push_back(edge);
    edges.push_back(pi / 2);
    const double lambda_v = lambda(mu);
    DVec2 value(0);
    for (const int side : {-1, 1}) {
        for (std::size_t panel = 0; panel + 1 < edges.size(); ++panel) {
            const double width = edges[panel + 1] - edges[panel];
            for (std::size_t i = 0; i < kPhi.nodes.size(); ++i) {
                const double psi = edges[panel] + width * (1 + kPhi.nodes[i]) / 2;
                const double k = side * std::sin(psi) * tan_v;
                const double horizon = std::asinh(std::exp(-std::asinh(k)) / alpha);
                const double end = std::min(horizon, is_ggx ? 20 : 2.6);
                for (std::size_t j = 0; j < kRho.nodes.size(); ++j) {
                    const double z = end * (1 + kRho.nodes[j]) / 2, t = std::sinh(z);
                    const double rho = alpha * t;
                    const double n_l = mu * (1 - 2 * rho * k - rho * rho) / (1 + rho * rho);
                    if (n_l <= 0) continue;  // a rounding beyond the horizon
                    const double p22 =
                        (is_ggx ? 1 / ((1 + t * t) * (1 + t * t)) : std::exp(-t * t)) / pi;
                    const double g2 = 1 / (1 + lambda_v + lambda(std::min(n_l, 1.0)));
                    const double weight = 2 * width / 2 * kPhi.weights[i] * end / 2 *
                                          kRho.weights[j] * t * std::cosh(z);
                    const double v_h = mu * (1 - rho * k) / std::sqrt(1 + rho * rho);
                    const double fresnel = std::pow(std::max(0.0, 1 - v_h), 5);
                    value += weight * p22 * g2 * (1 - rho * k) * DVec2(1 - fresnel, fresnel);
                }
            }
        }
    }
    return value;
}

/// The same at the ends, where the limits are known or near.
DVec2 truth_at(Distribution distribution, double mu, double r) {
    if (r == 0) return {1 - std::pow(1 - mu, 5), std::pow(1 - mu, 5)};
    return over_slopes(distribution, mu > 0 ? mu : 1e-9 * r * r, r);
}

// alpha = 1 makes D constant: A + B = 1 - mu ln(1 + 1/mu).
TEST(AlbedoIntegral, RoughestSurfaceMatchesClosedForm) {
    for (const double mu : {1e-6, 0.01, 0.1, 0.5, 0.999, 1.0}) {
        EXPECT_NEAR(sum(albedo_integral(kGgx, {mu, 1})), 1 - mu * std::log1p(1 / mu), 1e-11) << mu;
    }
}

// E_avg = 2 * integral of mu (A + B) = 4/3 (1 - ln 2) at alpha = 1.
TEST(AlbedoIntegral, RoughestSurfaceHasItsAverageAlbedo) {
    double average = 0;
    constexpr int kPoints = 2000;
    for (int i = 0; i < kPoints; ++i) {
        const double mu = (i + 0.5) / kPoints;
        average += 2 * mu * sum(albedo_integral(kGgx, {mu, 1}, 12)) / kPoints;
    }
    EXPECT_NEAR(average, 4.0 / 3 * (1 - std::numbers::ln2), 1e-7);  // midpoint rule: h^2 / 3
}

// n.v = 1: v.h = n.h, l = reflect(n), A and B are integrals over one angle; the values are from a
// quadrature of those.
TEST(AlbedoIntegral, NormalIncidence) {
    const double rows[][3] = {{0.25, 0.915785059323, 2.73709264256e-05},
                              {0.5, 0.687801540158, 4.69749526204e-05},
                              {1.0, 0.306819205145, 3.36142947255e-05}};
    for (const auto& [alpha, a, b] : rows) {
        const DVec2 value = albedo_integral(kGgx, {1, std::sqrt(alpha)});
        EXPECT_NEAR(value.x, a, 2e-12);
        EXPECT_NEAR(value.y, b, 1e-15);
    }
}

// From an adaptive quadrature that shares nothing with this one, to 12 digits.
TEST(AlbedoIntegral, KnownValuesOfGgx) {
    const double rows[][4] = {{0.00390625, 0.2, 0.376819862244, 0.602781164131},
                              {0.05, 0.2, 0.357711119721, 0.533256993048},
                              {0.05, 0.8, 0.839532233786, 0.0555062020181},
                              {0.3, 0.5, 0.772535514677, 0.0653702498986},
                              {0.7, 0.5, 0.880774731731, 0.00456102027694},
                              {0.95, 0.9, 0.427345052047, 0.000117187757632}};
    for (const auto& [mu, r, a, b] : rows) {
        const DVec2 value = albedo_integral(kGgx, {mu, r});
        EXPECT_NEAR(value.x, a, 2e-12) << mu << ' ' << r;
        EXPECT_NEAR(value.y, b, 2e-12) << mu << ' ' << r;
    }
}

TEST(AlbedoIntegral, KnownValuesOfBeckmann) {
    const double rows[][4] = {{0.00390625, 0.2, 0.168380508319, 0.812594190967},
                              {0.05, 0.2, 0.271742999155, 0.646996486535},
                              {0.05, 0.8, 0.876868047897, 0.101172454358},
                              {0.3, 0.5, 0.810381603715, 0.0972944361837},
                              {0.7, 0.5, 0.978950865114, 0.0060287535587},
                              {0.95, 0.9, 0.6513381903, 0.000239727317769}};
    for (const auto& [mu, r, a, b] : rows) {
        const DVec2 value = albedo_integral(kBeckmann, {mu, r});
        EXPECT_NEAR(value.x, a, 2e-12) << mu << ' ' << r;
        EXPECT_NEAR(value.y, b, 2e-12) << mu << ' ' << r;
    }
}

class Lobe : public testing::TestWithParam<Distribution> {};
INSTANTIATE_TEST_SUITE_P(Distributions, Lobe, testing::Values(kGgx, kBeckmann));

// At grazing incidence nothing is lost, whatever the roughness: A + B = 1.
TEST_P(Lobe, GrazingIncidence) {
    for (const double r : {1e-5, 1e-3, 0.0625, 0.25, 0.5, 1.0}) {
        const DVec2 value = albedo_integral(GetParam(), {0, r});
        EXPECT_NEAR(sum(value), 1, 2e-10) << r;
        // The value at 0 is the limit: the approach is that of mu ln(mu) / alpha.
        EXPECT_LT(worse(albedo_integral(GetParam(), {1e-9 * r * r, r}), value), 1e-7) << r;
    }
}

// At alpha = 1 the half vectors of GGX have the density 2 x / pi, x = v.h: B = 2 * integral of
// (1 - x)^5 x = 1 / 21.
TEST(AlbedoIntegral, GrazingIncidenceOnTheRoughest) {
    EXPECT_NEAR(albedo_integral(kGgx, {0, 1}).y, 1.0 / 21, 1e-10);
}

TEST_P(Lobe, TheMirrorIsExactAndItsLimit) {
    for (const double mu : {0.0, 0.05, 0.3, 0.8, 1.0}) {
        const DVec2 mirror(1 - std::pow(1 - mu, 5), std::pow(1 - mu, 5));
        EXPECT_LT(worse(albedo_integral(GetParam(), {mu, 0}), mirror), 1e-15);
        if (mu == 0) continue;
        // The distance is that of a lobe of width alpha = 1e-4 seen under mu: (alpha / mu)^2.
        EXPECT_LT(worse(albedo_integral(GetParam(), {mu, 0.01}), mirror),
                  6 * std::pow(1e-4 / mu, 2));
        EXPECT_LT(worse(albedo_integral(GetParam(), {mu, 1e-9}), mirror), 2e-9);
    }
}

TEST_P(Lobe, AgreesWithTheIntegralOverSlopes) {
    double worst = 0, worst_float = 0;
    std::vector<DVec2> points;
    for (const double mu : {1e-9, 1e-6, 1e-4, 1e-3, 0.004, 0.05, 0.3, 0.7, 0.95, 1.0}) {
        for (const double r : {1e-3, 0.01, 0.045, 0.1, 0.2, 0.5, 0.8, 1.0})
            points.emplace_back(mu, r);
    }
    const std::vector<DVec2> floats = albedo_integrals(GetParam(), points);
    for (std::size_t i = 0; i < points.size(); ++i) {
        const DVec2 expected = over_slopes(GetParam(), points[i].x, points[i].y);
        worst = std::max(worst, worse(albedo_integral(GetParam(), points[i]), expected));
        worst_float = std::max(worst_float, worse(floats[i], expected));
    }
    EXPECT_LT(worst, 1.5e-8);  // 5e-9 measured
    EXPECT_LT(worst_float, 1e-6);
}

TEST_P(Lobe, IsAnAlbedoEverywhere) {
    std::vector<DVec2> points;
    for (const double mu : {0.0, 1e-12, 1e-6, 1e-3, 0.1, 0.5, 0.999, 1.0}) {
        for (const double r : {0.0, 1e-9, 1e-6, 1e-3, 0.03, 0.3, 1.0}) points.emplace_back(mu, r);
    }
    for (const DVec2& value : albedo_integrals(GetParam(), points)) {
        EXPECT_GE(value.x, 0);
        EXPECT_GE(value.y, 0);
        EXPECT_LE(sum(value), 1 + 1e-6);
    }
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

TEST(AlbedoIntegral, MatchesTheDefinition) {
    for (const auto& [mu, r] : {std::pair{0.9, 0.4}, {0.5, 0.6}, {0.2, 0.8}, {0.1, 1.0}}) {
        const DVec2 expected = by_definition(mu, r), value = albedo_integral(kGgx, {mu, r});
        // The midpoint rule's error, measured by halving both counts: below 1e-6.
        EXPECT_NEAR(value.x, expected.x, 2e-6) << mu << ' ' << r;
        EXPECT_NEAR(value.y, expected.y, 2e-6) << mu << ' ' << r;
    }
}

using TableParam = std::tuple<TableAxes, Distribution>;
class Table : public testing::TestWithParam<TableParam> {
  protected:
    static TableAxes axes() { return std::get<0>(GetParam()); }
    static Distribution distribution() { return std::get<1>(GetParam()); }
    static BrdfTable bake(int size) {
        return bake_brdf_table({.size = size, .axes = axes(), .distribution = distribution()});
    }
    /// Positions written out: what the metadata promises, not what the code computes.
    static double n_dot_v(double column, int size) {
        return axes() == TableAxes::RootsEndPoints ? std::pow(column / (size - 1), 4)
                                                   : (column + 0.5) / size;
    }
    static double roughness(double row, int size) {
        return axes() == TableAxes::RootsEndPoints ? std::pow(row / (size - 1), 2)
                                                   : (row + 0.5) / size;
    }
};
INSTANTIATE_TEST_SUITE_P(AxesAndLobes, Table,
                         testing::Combine(testing::Values(TableAxes::RootsEndPoints,
                                                          TableAxes::LinearCentres),
                                          testing::Values(kGgx, kBeckmann)));

TEST_P(Table, EveryTexelIsTrueAndAnAlbedo) {
    for (const int size : {2, 3, 21}) {
        const BrdfTable table = bake(size);
        ASSERT_EQ(table.size, size);
        ASSERT_EQ(table.texels.size(), static_cast<std::size_t>(size * size));
        double worst = 0;
        for (int row = 0; row < size; ++row) {
            for (int column = 0; column < size; ++column) {
                const Vec2 texel = table.texels[static_cast<std::size_t>(row * size + column)];
                const DVec2 truth =
                    truth_at(distribution(), n_dot_v(column, size), roughness(row, size));
                worst = std::max(worst, worse(DVec2(texel), truth));
                EXPECT_GE(texel.x, 0);
                EXPECT_GE(texel.y, 0);
                EXPECT_LE(sum(texel), 1);
            }
        }
        EXPECT_LT(worst, 1e-6) << size;  // 6.7e-7 measured over all of 128 x 128
        // A sample cannot exceed the whole; 32 of so few texels come near it.
        EXPECT_LE(table.texel_error, worst + 1e-7);
        EXPECT_GT(table.texel_error, 0);
    }
}

// Over everything that a look-up meets: nine points a cell, and none beyond what is stated.
TEST_P(Table, LookUpErrorIsMeasuredNotFlattered) {
    constexpr int kSize = 32;
    const BrdfTable table = bake(kSize);
    std::vector<DVec2> points, found;
    for (int row = 0; row + 1 < kSize; ++row) {
        for (int column = 0; column + 1 < kSize; ++column) {
            for (int k = 0; k < 9; ++k) {
                const double x = (1 + k % 3) / 4.0, y = (1 + k / 3) / 4.0;
                points.emplace_back(n_dot_v(column + x, kSize), roughness(row + y, kSize));
                DVec2 value(0);
                for (const int below : {0, 1}) {
                    for (const int right : {0, 1}) {
                        const auto i =
                            static_cast<std::size_t>((row + below) * kSize + column + right);
                        value += (below ? y : 1 - y) * (right ? x : 1 - x) * DVec2(table.texels[i]);
                    }
                }
                found.push_back(value);
            }
        }
    }
    const std::vector<DVec2> truth = albedo_integrals(distribution(), points);
    double worst = 0, sharp = 0, square_sum = 0, weight_sum = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const double error = worse(found[i], truth[i]);
        if (points[i].y < kSharpestRoughness) {
            sharp = std::max(sharp, error);
            continue;
        }
        worst = std::max(worst, error);
        // The size of the cell in (n.v, r): x^4, x^2 have the slopes 4 x^3, 2 x.
        const double weight = axes() == TableAxes::RootsEndPoints
                                  ? std::pow(points[i].x, 0.75) * std::sqrt(points[i].y)
                                  : 1;
        square_sum += weight * error * error;
        weight_sum += weight;
    }
    EXPECT_GE(table.lookup_error, 0.99 * worst);
    EXPECT_GE(table.sharp_lookup_error, 0.7 * sharp);
    const double rms = std::sqrt(square_sum / weight_sum);
    EXPECT_GT(table.lookup_error_rms, 0.7 * rms);
    // Beyond the outermost centres a look-up is clamped: no cell, and the largest errors.
    if (axes() == TableAxes::RootsEndPoints) {
        EXPECT_LT(table.lookup_error_rms, 1.6 * rms);
    }
}

TEST_P(Table, SameBitsOnAnyNumberOfThreads) {
    BrdfTable one;
    {
        const ThreadLimit limit(1);
        one = bake(37);
    }
    const ThreadLimit limit(2);
    const BrdfTable two = bake(37);
    ASSERT_EQ(one.texels.size(), two.texels.size());
    EXPECT_EQ(std::memcmp(one.texels.data(), two.texels.data(), one.texels.size() * sizeof(Vec2)),
              0);
    EXPECT_EQ(one.average_albedo, two.average_albedo);
    EXPECT_EQ(one.texel_error, two.texel_error);
    EXPECT_EQ(one.lookup_error, two.lookup_error);
    EXPECT_EQ(one.lookup_error_rms, two.lookup_error_rms);
    EXPECT_EQ(one.sharp_lookup_error, two.sharp_lookup_error);
}

// E_avg of the true E by a plain rule, midpoints in x = sqrt(n.v): its own error is 1e-6 at most.
TEST_P(Table, AverageAlbedo) {
    constexpr int kSize = 7, kPoints = 400;
    const BrdfTable table = bake(kSize);
    ASSERT_EQ(table.average_albedo.size(), static_cast<std::size_t>(kSize));
    for (int row = 0; row < kSize; ++row) {
        std::vector<DVec2> points;
        for (int i = 0; i < kPoints; ++i) {
            points.emplace_back(std::pow((i + 0.5) / kPoints, 2), roughness(row, kSize));
        }
        const std::vector<DVec2> albedo = exact_albedo_integrals(distribution(), points, 24);
        double average = 0;
        for (std::size_t i = 0; i < points.size(); ++i) {
            average += 4 * std::pow(points[i].x, 1.5) * sum(albedo[i]) / kPoints;
        }
        // The rule's own 1 is 1 - 1 / (2 kPoints^2), E' at n.v = 1 is small: take that out.
        average += sum(albedo.back()) / (2.0 * kPoints * kPoints);
        EXPECT_NEAR(static_cast<double>(table.average_albedo[static_cast<std::size_t>(row)]),
                    average, 2e-6)
            << row;
    }
    if (axes() == TableAxes::RootsEndPoints) {
        EXPECT_EQ(table.average_albedo.front(), 1);  // a mirror
        if (distribution() == kGgx) {
            EXPECT_NEAR(static_cast<double>(table.average_albedo.back()),
                        4.0 / 3 * (1 - std::numbers::ln2), 3e-7);
        }
    }
}

TEST_P(Table, HalvesAreAlbedosToo) {
    const BrdfTable table = bake(64);
    const std::vector<std::uint16_t> halves = half_texels(table);
    ASSERT_EQ(halves.size(), 2 * table.texels.size());
    double worst = 0;
    for (std::size_t i = 0; i < table.texels.size(); ++i) {
        const DVec2 half(runtime::half_to_float(halves[2 * i]),
                         runtime::half_to_float(halves[2 * i + 1]));
        EXPECT_LE(sum(half), 1);
        worst = std::max(worst, worse(half, DVec2(table.texels[i])));
    }
    EXPECT_LE(worst, 0x1p-11);
    EXPECT_GT(worst, 1e-5);
}

// The claim of the default axes: 1e-3 at 128 x 128 for every roughness a renderer uses.
TEST(DefaultAxes, LookUpWithin1e3) {
    for (const Distribution distribution : {kGgx, kBeckmann}) {
        const BrdfTable table = bake_brdf_table({.size = 128, .distribution = distribution});
        EXPECT_LT(table.lookup_error, 1e-3);
        EXPECT_LT(table.lookup_error_rms, 6e-5);
        EXPECT_LT(table.texel_error, 1e-6);
        const BrdfTable linear = bake_brdf_table(
            {.size = 128, .axes = TableAxes::LinearCentres, .distribution = distribution});
        EXPECT_LT(table.lookup_error, 0.02 * linear.lookup_error);
        EXPECT_LT(table.lookup_error_rms, 0.2 * linear.lookup_error_rms);
    }
}

}  // namespace
}  // namespace envbake
