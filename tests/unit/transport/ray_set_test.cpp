// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/ray_set.h"

#include "envbake/runtime/sh.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

namespace envbake {
namespace {

using std::numbers::pi;

struct Case {
    int rays;
    int bands;
};
class RaySets : public testing::TestWithParam<Case> {};

/// 1/pi * integral of max(0, z) Y_l0 dw = 2 sqrt((2l + 1) / 4 pi) * integral over [0, 1] of z P_l.
double unoccluded(int l) {
    // Simpson's rule is exact for the cubic and converges as h^4: 1e-14 here.
    constexpr int kSteps = 4000;
    double sum = 0;
    for (int i = 0; i <= kSteps; ++i) {
        const double z = double(i) / kSteps;
        const double weight = i == 0 || i == kSteps ? 1 : i % 2 == 1 ? 4 : 2;
        sum += weight * z * std::legendre(static_cast<unsigned>(l), z) / (3.0 * kSteps);
    }
    return 2 * std::sqrt((2 * l + 1) / (4 * pi)) * sum;
}

TEST_P(RaySets, IntegrateTheUnoccludedTransferExactly) {
    const auto [rays, bands] = GetParam();
    const RaySet set = make_ray_set(rays, bands);
    ASSERT_GE(set.ray_count, rays);
    ASSERT_EQ(set.ray_count % 16, 0);
    ASSERT_EQ(set.directions.size() * 16, static_cast<std::size_t>(set.ray_count));
    std::vector<double> sum(static_cast<std::size_t>(bands * bands), 0), y(sum.size());
    for (std::size_t p = 0; p < set.directions.size(); ++p) {
        for (std::size_t i = 0; i < 16; ++i) {
            const DirectionPacket& d = set.directions[p];
            EXPECT_NEAR(d.x[i] * d.x[i] + d.y[i] * d.y[i] + d.z[i] * d.z[i], 1, 1e-6);
            EXPECT_GT(d.z[i], 0);
            EXPECT_GE(set.weights[p][i], 0);
            sh::evaluate(bands, double{d.x[i]}, double{d.y[i]}, double{d.z[i]}, y.data());
            for (std::size_t c = 0; c < y.size(); ++c) sum[c] += double{set.weights[p][i]} * y[c];
        }
    }
    for (int l = 0; l < bands; ++l)
        for (int m = -l; m <= l; ++m)
            EXPECT_NEAR(sum[static_cast<std::size_t>(sh::index(l, m))], m == 0 ? unoccluded(l) : 0,
                        5e-7)  // directions and weights are rounded to float
                << l << ", " << m;
}

INSTANTIATE_TEST_SUITE_P(Sizes, RaySets,
                         testing::Values(Case{16, 1}, Case{16, 3}, Case{1, 5}, Case{96, 5},
                                         Case{448, 5}, Case{1600, 5}, Case{100, 10}, Case{2048, 10},
                                         Case{8192, 10}));

/// Measured: .70 at 256 rays and .90 at 1600; equal weights would be 1.
TEST(RaySet, WeightsStayNearEqual) {
    EXPECT_GT(make_ray_set(256, 5).smallest_relative_weight, 0.6);
    EXPECT_GT(make_ray_set(1600, 5).smallest_relative_weight, 0.85);
}

/// The same rays with the same weights, and a quarter of them first that covers the hemisphere: no
/// disc of a sixteenth of its area may lie between them.
TEST(RaySet, APilotIsAQuarterOfTheSetAndSeesAllOfTheHemisphere) {
    for (const int rays : {192, 208, 336, 448, 1616}) {
        const RaySet set = make_ray_set(rays, 5, true);
        ASSERT_EQ(set.pilot_packets, set.directions.size() / 4);
        const RaySet plain = make_ray_set(set.ray_count, 5);
        ASSERT_EQ(plain.ray_count, set.ray_count);
        const auto listed = [](const RaySet& s) {
            std::vector<std::array<float, 4>> list;
            for (std::size_t k = 0; k < 16 * s.directions.size(); ++k) {
                const DirectionPacket& d = s.directions[k / 16];
                list.push_back({d.x[k % 16], d.y[k % 16], d.z[k % 16], s.weights[k / 16][k % 16]});
            }
            std::sort(list.begin(), list.end());
            return list;
        };
        const auto expected = listed(plain), got = listed(set);
        for (std::size_t k = 0; k < got.size(); ++k)
            for (std::size_t i = 0; i < 4; ++i) ASSERT_NEAR(got[k][i], expected[k][i], 1e-7);
        double widest = 0;
        for (int i = 0; i < 2000; ++i) {
            const double r = std::sqrt((i + 0.5) / 2000), phi = i * 2.399963;
            double nearest = 2;
            for (std::size_t k = 0; k < 16 * set.pilot_packets; ++k)
                nearest = std::min(
                    nearest, std::hypot(set.directions[k / 16].x[k % 16] - r * std::cos(phi),
                                        set.directions[k / 16].y[k % 16] - r * std::sin(phi)));
            widest = std::max(widest, nearest);
        }
        EXPECT_LT(widest, std::sqrt(1.0 / 16)) << rays;
        if (rays == 1616) {
            EXPECT_LT(widest, std::sqrt(1.0 / 100));
        }
    }
}

/// A packet must be a patch, or its rays share nothing in the tree.
TEST(RaySet, PacketsArePatches) {
    const RaySet set = make_ray_set(1024, 5);
    double mean_extent = 0;
    for (const DirectionPacket& d : set.directions) {
        const auto [x0, x1] = std::minmax_element(d.x.begin(), d.x.end());
        const auto [y0, y1] = std::minmax_element(d.y.begin(), d.y.end());
        mean_extent += std::max(*x1 - *x0, *y1 - *y0) / double(set.directions.size());
    }
    // Sixteen of 1024 points on the unit disc, as a square: an edge of sqrt(16 pi / 1024) = 0.22.
    EXPECT_LT(mean_extent, 0.45);
}

}  // namespace
}  // namespace envbake
