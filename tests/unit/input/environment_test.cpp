// SPDX-License-Identifier: Apache-2.0
#include "baker/input/environment.h"

#include "baker/core/random.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <utility>

namespace envbake {
namespace {

constexpr double kPi = std::numbers::pi;

/// Every texel holds its own number.
Environment numbered_environment(std::variant<LatLongGrid, CubeGrid> grid, int texels) {
    Environment environment;
    environment.grid = std::move(grid);
    for (int i = 0; i < texels; ++i) environment.radiance.emplace_back(static_cast<float>(i));
    return environment;
}

DVec3 random_direction(RandomStream& random) {
    const double y = 2 * random.next() - 1, phi = 2 * kPi * random.next();
    const double r = std::sqrt(1 - y * y);
    return {r * std::cos(phi), y, r * std::sin(phi)};
}

/// The definition, one texel after another; phi is tried with and without a turn.
int texel_by_search(const LatLongGrid& grid, const DVec3& w) {
    const double theta = std::acos(w.y), phi = std::atan2(w.z, w.x);
    int found = -1;
    for (int row = 0; row < grid.height; ++row) {
        for (int column = 0; column < grid.width; ++column) {
            const auto r = static_cast<std::size_t>(row), c = static_cast<std::size_t>(column);
            if (theta < grid.theta_edges[r] || theta >= grid.theta_edges[r + 1]) continue;
            for (const double turn : {-2 * kPi, 0.0, 2 * kPi}) {
                if (phi + turn < grid.phi_edges[c] || phi + turn >= grid.phi_edges[c + 1]) continue;
                found = row * grid.width + column;
            }
        }
    }
    return found;
}

TEST(Environment, GridsSpanTheSphereExactly) {
    for (const int n : {1, 2, 3, 7, 1024}) {
        const LatLongGrid grid = make_lat_long_grid(n, n + 1);
        ASSERT_EQ(grid.phi_edges.size(), static_cast<std::size_t>(n) + 1);
        ASSERT_EQ(grid.theta_edges.size(), static_cast<std::size_t>(n) + 2);
        EXPECT_EQ(grid.phi_edges.front(), -kPi);
        EXPECT_EQ(grid.phi_edges.back(), kPi);
        EXPECT_EQ(grid.theta_edges.front(), 0);
        EXPECT_EQ(grid.theta_edges.back(), kPi);
        const CubeGrid cube = make_cube_grid(n);
        ASSERT_EQ(cube.edges.size(), static_cast<std::size_t>(n) + 1);
        EXPECT_EQ(cube.edges.front(), -1);
        EXPECT_EQ(cube.edges.back(), 1);
        for (std::size_t i = 0; i < static_cast<std::size_t>(n); ++i) {
            EXPECT_NEAR(grid.phi_edges[i + 1] - grid.phi_edges[i], 2 * kPi / n, 1e-14);
            EXPECT_NEAR(cube.edges[i + 1] - cube.edges[i], 2.0 / n, 1e-15);
        }
    }
}

TEST(Environment, LatLongLookupAgreesWithSearch) {
    LatLongGrid uneven = make_lat_long_grid(5, 3);
    uneven.theta_edges = {0, 0.3, 2.9, kPi};
    uneven.phi_edges = {-kPi / 2, -1.5, 0.1, 3, 3.5, 1.5 * kPi};  // starts elsewhere, uneven
    for (const LatLongGrid& grid : {make_lat_long_grid(8, 4), make_lat_long_grid(1, 1), uneven}) {
        const Environment environment = numbered_environment(grid, grid.width * grid.height);
        RandomStream random(1, 2, 3);
        for (int i = 0; i < 20000; ++i) {
            const DVec3 w = random_direction(random);
            const int expected = texel_by_search(grid, w);
            ASSERT_GE(expected, 0);
            ASSERT_EQ(radiance_towards(environment, w).x, static_cast<float>(expected))
                << w.x << ' ' << w.y << ' ' << w.z;
        }
    }
}

TEST(Environment, LatLongLookupHoldsAtPolesAndSeam) {
    const Environment environment = numbered_environment(make_lat_long_grid(8, 4), 32);
    EXPECT_LT(radiance_towards(environment, {0, 1, 0}).x, 8);
    EXPECT_GE(radiance_towards(environment, {0, -1, 0}).x, 24);
    EXPECT_EQ(radiance_towards(environment, {-1, 1e-9, 1e-300}).x, 8);  // phi = pi is phi = -pi
    EXPECT_EQ(radiance_towards(environment, {-1, 1e-9, -0.0}).x, 8);    // phi = -pi
    EXPECT_EQ(radiance_towards(environment, {1, 1e-9, 1e-9}).x, 12);    // the centre is +X
}

// The table of OpenGL 4.6, section 8.13: the axis of a face, s to the right, t downwards.
TEST(Environment, CubeLookupFollowsTheOpenGlTable) {
    struct Axes {
        DVec3 axis, right, down;
    };
    constexpr int kSize = 3;
    const Axes faces[] = {
        {{1, 0, 0}, {0, 0, -1}, {0, -1, 0}}, {{-1, 0, 0}, {0, 0, 1}, {0, -1, 0}},
        {{0, 1, 0}, {1, 0, 0}, {0, 0, 1}},   {{0, -1, 0}, {1, 0, 0}, {0, 0, -1}},
        {{0, 0, 1}, {1, 0, 0}, {0, -1, 0}},  {{0, 0, -1}, {-1, 0, 0}, {0, -1, 0}}};
    CubeGrid uneven{.size = kSize, .edges = {-1, -0.9, 0.2, 1}};
    for (const CubeGrid& grid : {make_cube_grid(kSize), uneven}) {
        const Environment environment = numbered_environment(grid, 6 * kSize * kSize);
        int texel = 0;
        for (const Axes& face : faces) {
            for (std::size_t row = 0; row < kSize; ++row) {
                for (std::size_t column = 0; column < kSize; ++column, ++texel) {
                    const double u = (grid.edges[column] + grid.edges[column + 1]) / 2;
                    const double v = (grid.edges[row] + grid.edges[row + 1]) / 2;
                    const DVec3 w = glm::normalize(face.axis + u * face.right + v * face.down);
                    EXPECT_EQ(radiance_towards(environment, w).x, static_cast<float>(texel));
                }
            }
        }
    }
}

}  // namespace
}  // namespace envbake
