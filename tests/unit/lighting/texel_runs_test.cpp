// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/texel_runs.h"

#include "baker/core/random.h"
#include "tests/support/environments.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <set>
#include <variant>
#include <vector>

namespace envbake::lighting {
namespace {

using std::numbers::pi;
using test::slot;
using Grid = std::variant<LatLongGrid, CubeGrid>;

/// The texels that meet at each corner of a texel, by looking a hair's breadth around it.
std::vector<std::set<std::size_t>> meetings(const Grid& grid) {
    const auto numbered = test::environment(
        grid, [](const test::Texel&, std::size_t i) { return DVec3(static_cast<double>(i)); });
    std::vector<std::set<std::size_t>> found;
    for (const test::Texel& t : test::texels_of(grid)) {
        for (const double a : {t.a0, t.a1}) {
            for (const double b : {t.b0, t.b1}) {
                const DVec3 corner = t.towards(a, b);
                const DVec3 aside = std::abs(corner.x) < 0.7 ? DVec3{1, 0, 0} : DVec3{0, 1, 0};
                const DVec3 x = glm::normalize(glm::cross(corner, aside));
                const DVec3 y = glm::cross(corner, x);
                std::set<std::size_t> here;
                constexpr int kAround = 96;  // more than the texels around a pole
                for (int i = 0; i < kAround; ++i) {
                    const double phi = 2 * pi * (i + 0.5) / kAround;
                    const DVec3 w = corner + 1e-6 * (std::cos(phi) * x + std::sin(phi) * y);
                    const Vec3 texel = radiance_towards(numbered, glm::normalize(w));
                    here.insert(static_cast<std::size_t>(texel.x));
                }
                found.push_back(here);
            }
        }
    }
    return found;
}

/// Labels by spreading the lowest number until nothing changes.
std::vector<std::size_t> spread(const std::vector<std::set<std::size_t>>& meetings,
                                const std::vector<bool>& bright) {
    std::vector<std::size_t> label(bright.size());
    std::iota(label.begin(), label.end(), std::size_t{0});
    for (bool changed = true; changed;) {
        changed = false;
        for (const auto& here : meetings) {
            std::size_t lowest = bright.size();
            for (const std::size_t i : here) {
                if (bright[i]) lowest = std::min(lowest, label[i]);
            }
            for (const std::size_t i : here) {
                if (!bright[i] || label[i] == lowest) continue;
                label[i] = lowest;
                changed = true;
            }
        }
    }
    return label;
}

class Connected : public testing::TestWithParam<test::NamedGrid> {};

TEST_P(Connected, AsOnTheSphere) {
    const Grid& grid = GetParam().grid;
    const TexelLines lines(grid);
    const auto around = meetings(grid);
    const auto count = slot(lines.count()) * slot(lines.width());
    for (std::uint64_t trial = 0; trial < 30; ++trial) {
        const double density = 0.04 + 0.02 * static_cast<double>(trial % 15);
        RandomStream random(3, trial, 0);
        std::vector<bool> bright(count);
        for (std::size_t i = 0; i < count; ++i) bright[i] = random.next() < density;

        std::vector<TexelRun> runs;
        std::vector<std::size_t> first;
        for (int line = 0; line < lines.count(); ++line) {
            const auto at = [&](int c) { return slot(line) * slot(lines.width()) + slot(c); };
            for (int c = 0; c < lines.width(); ++c) {
                if (!bright[at(c)]) continue;
                if (c == 0 || !bright[at(c - 1)]) {
                    runs.push_back({line, c, c});
                    first.push_back(at(c));
                }
                runs.back().end = c + 1;
            }
        }
        const ConnectedRuns connected = connect(lines, runs);
        const auto expected = spread(around, bright);
        int sets = 0;
        for (std::size_t i = 0; i < count; ++i) sets += bright[i] && expected[i] == i;
        ASSERT_EQ(connected.count, sets) << trial;
        for (std::size_t i = 0; i < runs.size(); ++i) {
            for (std::size_t j = 0; j < i; ++j) {
                ASSERT_EQ(connected.label[i] == connected.label[j],
                          expected[first[i]] == expected[first[j]])
                    << "trial " << trial << ", runs that begin at " << first[j] << " and "
                    << first[i];
            }
        }
    }
}

INSTANTIATE_TEST_SUITE_P(
    Grids, Connected,
    testing::Values(test::NamedGrid{"16 x 8", test::lat_long_grid(16, 8)},
                    test::NamedGrid{"uneven 13 x 9", test::uneven_lat_long_grid(13, 9)},
                    test::NamedGrid{"3 x 5", test::lat_long_grid(3, 5)},
                    test::NamedGrid{"1 x 1", test::lat_long_grid(1, 1)},
                    test::NamedGrid{"2 x 6", test::lat_long_grid(2, 6)},
                    test::NamedGrid{"1 x 7", test::lat_long_grid(1, 7)},
                    test::NamedGrid{"cube 1", test::cube_grid(1)},
                    test::NamedGrid{"cube 2", test::cube_grid(2)},
                    test::NamedGrid{"cube 6", test::cube_grid(6)},
                    test::NamedGrid{"uneven cube 7", test::uneven_cube_grid(7)}));

TEST(TexelLines, SolidAnglesFillTheSphere) {
    for (const Grid& grid :
         {Grid(test::uneven_lat_long_grid(13, 9)), Grid(test::uneven_cube_grid(7))}) {
        const TexelLines lines(grid);
        double sum = 0;
        for (int line = 0; line < lines.count(); ++line) {
            for (int c = 0; c < lines.width(); ++c) {
                sum += lines.solid_angle(line, c);
                EXPECT_NEAR(lines.solid_angle(line, c) / lines.patch(line, c).omega, 1, 1e-13);
            }
        }
        EXPECT_NEAR(sum, 4 * pi, 1e-12);
    }
}

}  // namespace
}  // namespace envbake::lighting
