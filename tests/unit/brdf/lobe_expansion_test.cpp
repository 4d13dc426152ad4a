// SPDX-License-Identifier: Apache-2.0
#include "baker/brdf/lobe_expansion.h"

#include "baker/brdf/albedo_integral.h"
#include "baker/math/quadrature.h"
#include "envbake/runtime/lobe.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

namespace envbake {
namespace {

using runtime::Distribution;
using std::numbers::pi;

/// One part of the first row, of m = 0: [j][k].
double element(const std::vector<float>& row, const LobeExpansionJob& job, int bands, int part,
               int m, int j, int k) {
    const std::size_t size = runtime::lobe_size(job.exit_bands, bands);
    return double{row[static_cast<std::size_t>(part) * size +
                      runtime::lobe_slot(job.exit_bands, bands, m, j, k)]};
}

/// Y_l0 by Bonnet's recurrence.
double zonal(int l, double z) {
    double before = 1, p = l == 0 ? 1 : z;
    for (int k = 2; k <= l; ++k) {
        const double next = ((2 * k - 1) * z * p - (k - 1) * before) / k;
        before = p;
        p = next;
    }
    return std::sqrt((2 * l + 1) / (4 * pi)) * p;
}

/// What leaves under uniform light is the albedo, direction by direction and in all.
TEST(LobeExpansion, AWhiteFurnaceKeepsItsEnergy) {
    const Quadrature rule = gauss_legendre(24);
    for (const Distribution distribution : {Distribution::Ggx, Distribution::Beckmann}) {
        for (const double r : {1.0, 0.5}) {
            const LobeExpansionJob job{.distribution = distribution, .roughness = {r, r}};
            const LobeExpansion lobe = expand_lobe(job);
            for (const double r0 : {1.0, 0.04}) {
                double sent = 0, exact = 0;  // integral of L(o) o.z do, L_i = 1
                for (std::size_t q = 0; q < rule.nodes.size(); ++q) {
                    const double x = (1 + rule.nodes[q]) / 2, z = x * x;
                    double radiance = 0;
                    for (int j = 0; j < 5; ++j)
                        radiance += std::sqrt(4 * pi) * zonal(j, z) *
                                    (r0 * element(lobe.unoccluded, job, 5, 0, 0, j, 0) +
                                     element(lobe.unoccluded, job, 5, 1, 0, j, 0));
                    const DVec2 albedo = albedo_integral(distribution, {z, r});
                    const double weight = 2 * pi * rule.weights[q] * x * z;
                    sent += weight * radiance;
                    exact += weight * (r0 * albedo.x + albedo.y);
                    if (z > 0.2) {
                        EXPECT_NEAR(radiance, r0 * albedo.x + albedo.y, 0.03);
                    }
                }
                EXPECT_NEAR(sent, exact, 1e-3 * pi) << "roughness " << r << ", R0 " << r0;
            }
        }
    }
}

/// Light from w that leaves towards o is light from o that leaves towards w: weighted by both
/// cosines the expanded lobe is symmetric, within what weighs the horizon (1e-2).
TEST(LobeExpansion, Reciprocity) {
    const Quadrature rule = gauss_legendre(16);
    const auto cosine_gram = [&](int j, int k) {
        double sum = 0;
        for (std::size_t q = 0; q < rule.nodes.size(); ++q) {
            const double z = (1 + rule.nodes[q]) / 2;
            sum += pi * rule.weights[q] * z * zonal(j, z) * zonal(k, z);
        }
        return sum;
    };
    for (const double r : {1.0, 0.7, 0.5}) {
        const LobeExpansionJob job{.roughness = {r, r}};
        const LobeExpansion lobe = expand_lobe(job);
        std::array<std::array<double, 5>, 5> both{};  // [exit][light]
        double largest = 0;
        for (int j = 0; j < 5; ++j) {
            for (int i = 0; i < 5; ++i) {
                for (int k = 0; k < 5; ++k)
                    both[static_cast<std::size_t>(j)][static_cast<std::size_t>(i)] +=
                        cosine_gram(j, k) * (element(lobe.unoccluded, job, 5, 0, 0, k, i) +
                                             element(lobe.unoccluded, job, 5, 1, 0, k, i));
                largest = std::max(
                    largest,
                    std::abs(both[static_cast<std::size_t>(j)][static_cast<std::size_t>(i)]));
            }
        }
        for (std::size_t j = 0; j < 5; ++j)
            for (std::size_t i = 0; i < j; ++i)
                EXPECT_NEAR(both[j][i], both[i][j], 0.02 * largest)
                    << "roughness " << r << ": " << j << ", " << i;
    }
}

/// A mirror sends Y_im back turned by half a turn about the normal, (-1)^m Y_im above the horizon,
/// and a + b loses nothing.
TEST(LobeExpansion, AMirrorReflectsEveryBand) {
    for (const Distribution distribution : {Distribution::Ggx, Distribution::Beckmann}) {
        const LobeExpansionJob job{.distribution = distribution, .roughness = {0, 0}};
        const LobeExpansion lobe = expand_lobe(job);
        for (int m = 0; m < 5; ++m) {
            for (int i = m; i < 5; ++i) {
                // What is even in z is the same below as its mirror image: its coefficients are
                // exact; what is odd is bent at the horizon.
                if ((i + m) % 2 != 0) continue;
                for (int j = m; j < 5; ++j) {
                    const double t = element(lobe.unoccluded, job, 5, 0, m, j, i) +
                                     element(lobe.unoccluded, job, 5, 1, m, j, i);
                    EXPECT_NEAR(t, i == j ? (m % 2 == 0 ? 1 : -1) : 0, 1e-5);
                }
            }
        }
    }
}

/// Rows between others are interpolated: 1/32 in roughness, against those that are computed.
/// Errors of light from surfaces become those of exit radiance by the kernel.
TEST(LobeExpansion, LightThatIsOffComesThroughTheLobe) {
    const LobeExpansionJob job{.exit_bands = 4, .light_bands = 3, .roughness = {0.6, 0.6}};
    const LobeExpansion lobe = expand_lobe(job);
    const double r0 = 0.3;
    std::vector<double> x(49);
    for (std::size_t k = 0; k < x.size(); ++k) x[k] = std::sin(1.7 * static_cast<double>(k) + 1);
    const auto of_m = [&](const std::vector<float>& row, int bands, int m, int j, int k, double a) {
        return a * element(row, job, bands, 0, std::abs(m), j, k) +
               element(row, job, bands, 1, std::abs(m), j, k);
    };
    double sum = 0, white = 0;
    for (int m = -3; m <= 3; ++m) {
        for (int j = std::abs(m); j < 4; ++j) {
            double exit = 0;
            for (int k = std::abs(m); k < 7; ++k)
                exit +=
                    of_m(lobe.kernel, 7, m, j, k, r0) * x[static_cast<std::size_t>(k * k + k + m)];
            sum += exit * exit;
            for (int i = std::abs(m); i < 3; ++i)
                white += std::pow(of_m(lobe.unoccluded, 3, m, j, i, 1), 2);
        }
    }
    EXPECT_NEAR(lobe_errors(job, 0.6, r0).of_reflected(x), sum / white, 1e-5 * sum / white);
}

TEST(LobeExpansion, RowsLieCloseEnough) {
    LobeExpansionJob job{.roughness = {0.4, 1}};
    const LobeExpansion table = expand_lobe(job);
    ASSERT_EQ(table.rows, 21);
    const std::size_t size = 2 * runtime::lobe_size(5, 5);
    for (const std::size_t row : {0u, 5u, 12u, 19u}) {
        const double r = 0.4 + 0.6 * (static_cast<double>(row) + 0.5) / 20;
        job.roughness[0] = job.roughness[1] = r;
        const LobeExpansion exact = expand_lobe(job);
        ASSERT_EQ(exact.rows, 1);
        double difference = 0, norm = 0;
        for (std::size_t i = 0; i < size; ++i) {
            const double between = (double{table.unoccluded[row * size + i]} +
                                    double{table.unoccluded[(row + 1) * size + i]}) /
                                   2;
            difference += std::pow(between - double{exact.unoccluded[i]}, 2);
            norm += std::pow(double{exact.unoccluded[i]}, 2);
        }
        EXPECT_LT(std::sqrt(difference / norm), 2e-3) << "roughness " << r;
    }
}

TEST(LobeExpansion, SharperLobesLoseMore) {
    double before = 0;
    for (const double r : {0.8, 0.6, 0.4, 0.2}) {
        const LobeErrors errors = lobe_errors({}, r, 1);
        EXPECT_GT(errors.lost, before) << r;
        before = errors.lost;
    }
    EXPECT_LT(lobe_errors({}, 1, 1).lost, 0.1);
    EXPECT_GT(before, 0.9);
    EXPECT_GT(lobe_errors({.exit_bands = 3}, 0.6, 1).lost, lobe_errors({}, 0.6, 1).lost);
}

}  // namespace
}  // namespace envbake
