// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/mips.h"

#include "baker/core/parallel.h"
#include "baker/lighting/prefilter_kernel.h"
#include "envbake/runtime/cube.h"
#include "envbake/runtime/sh.h"
#include "tests/support/baked_mip.h"
#include "tests/support/environments.h"
#include "tests/support/prefilter_reference.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

namespace envbake {
namespace {

using std::numbers::pi;
using test::average_of;
using test::bake_one;
using test::direction_of;
using test::slot;
using test::texel_count;
using test::texel_of;
using test::worst_error;
using Grid = std::variant<LatLongGrid, CubeGrid>;

void expect_sane(const Mip& mip, const DVec3& low, const DVec3& high) {
    for (std::size_t i = 0; i < texel_count(mip); ++i) {
        const DVec3 t = texel_of(mip, i);
        for (int k = 0; k < 3; ++k) {
            ASSERT_TRUE(std::isfinite(t[k]));
            ASSERT_GE(t[k], low[k]);
            ASSERT_LE(t[k], high[k]);
        }
    }
    ASSERT_TRUE(std::isfinite(mip.error_estimate));
}

/// Radiance 1 outside of `edge` of +Y, or 1 inside.
Environment cap(double edge, bool inside) {
    LatLongGrid grid = test::lat_long_grid(8, 2);
    grid.theta_edges = {0, edge, pi};
    return test::environment(
        grid, [&](const test::Texel& t, auto) { return DVec3((t.a0 == 0) == inside ? 1.0 : 0.0); });
}

/// The texel that looks straight up: the middle of face +Y.
double straight_up(const Mip& mip) {
    const std::size_t n = slot(mip.width);
    return texel_of(mip, 2 * n * n + n * n / 2).r;
}

std::vector<Grid> odd_grids() {
    return {
        test::lat_long_grid(1, 1),   test::lat_long_grid(2, 2),         test::lat_long_grid(3, 5),
        test::lat_long_grid(256, 2), test::uneven_lat_long_grid(13, 7), test::cube_grid(1),
        test::cube_grid(3),          test::uneven_cube_grid(6)};
}

TEST(MipKernel, MassMatchesClosedForm) {  // row C1
    const std::pair<double, double> rows[] = {{1.0 / 7, 0.994505113027},
                                              {2.0 / 7, 0.948296075667},
                                              {3.0 / 7, 0.83768499521},
                                              {0.5, 0.762301701192},
                                              {1.0, 0.25}};
    for (const auto& [r, mass] : rows) {
        const double alpha = r * r;
        const auto weight = lighting::GgxWeight<double>::of(alpha);
        // D = t^2 / (pi A), and K = D mu / 4
        EXPECT_NEAR(1 / (4 * pi * alpha * alpha * weight.inverse_norm), mass, 2e-12) << r;
    }
}

TEST(MipKernel, NormIsSmoothInRoughness) {
    // Against quadrature, on both sides of where the series takes over, and where alpha is tiny.
    for (const double alpha : {1e-6, 1e-4, 0.01, 0.3, 0.98, 0.9899, 0.9903, 0.999, 1.0}) {
        const auto weight = lighting::GgxWeight<double>::of(alpha);
        // The reference's weight is t^2 mu / (pi A).
        const double norm = 1 / (pi * alpha * alpha * weight.inverse_norm);
        EXPECT_NEAR(norm / test::PrefilterReference::norm(alpha), 1, 1e-8) << alpha;
    }
}

TEST(Mips, DiscLightStraightAhead) {  // row C2
    struct Row {
        float r;
        double degrees, value;
    };
    const Row rows[] = {{1.0f / 7, 0.265, 0.0127476411721},
                        {1.0f / 7, 5, 0.824474359289},
                        {1.0f / 7, 30, 0.996295270365},
                        {0.5f, 0.265, 0.000112238447661},
                        {0.5f, 5, 0.0387535772839},
                        {0.5f, 30, 0.665054213084},
                        {1.0f, 0.265, 2.13916057692e-05},
                        {1.0f, 5, 0.0075961234939},
                        {1.0f, 30, 0.25}};
    for (const Row& row : rows) {
        const Mip mip = bake_one(cap(row.degrees * pi / 180, true), row.r, 5);
        EXPECT_NEAR(straight_up(mip) / row.value, 1, 1e-3) << row.r << ", " << row.degrees;
    }
}

TEST(Mips, TailOfTheLobe) {  // row C5
    struct Row {
        float r;
        double beyond[3];
    };
    const Row rows[] = {{1.0f / 7, {0.0480487867759, 0.00370472963505, 0.000256533562753}},
                        {2.0f / 7, {0.439489824127, 0.0562293932709, 0.00418581653017}},
                        {0.5f, {0.857920786512, 0.334945786916, 0.0387228919408}}};
    const double degrees[] = {10, 30, 60};
    for (const Row& row : rows) {
        for (int i = 0; i < 3; ++i) {
            const Mip mip = bake_one(cap(degrees[i] * pi / 180, false), row.r, 5);
            // The norm allows 1e-3 of the mean beside 1e-3 of the value.
            EXPECT_NEAR(straight_up(mip), row.beyond[i], 1e-3 * (row.beyond[i] + 1e-3))
                << row.r << ", " << degrees[i];
        }
    }
}

TEST(Mips, HarmonicsAreEigenfunctions) {  // row C4, every texel at once
    struct Row {
        float r;
        double eigenvalue[9];  // of l = 0 .. 4 and 8
    };
    const Row rows[] = {
        {1.0f / 7,
         {1, 0.995722450229, 0.987784330282, 0.977072034419, 0.964350852144, 0, 0, 0,
          0.90100346664}},
        {3.0f / 7,
         {1, 0.904210107717, 0.749951264643, 0.585774716354, 0.443825450165, 0, 0, 0,
          0.131117244447}},
        {0.5f,
         {1, 0.867395662812, 0.662405687279, 0.460387585347, 0.305538297757, 0, 0, 0,
          0.0529217688494}},
        {1.0f, {1, 0.666666666667, 0.25, 0, -0.0416666666667, 0, 0, 0, -0.0078125}}};
    const std::pair<int, int> harmonics[] = {{1, -1}, {1, 0}, {1, 1},  {2, 1},
                                             {3, -2}, {4, 3}, {8, -5}, {8, 0}};
    for (const Grid& grid : {Grid(test::lat_long_grid(256, 128)), Grid(test::cube_grid(64))}) {
        // Three harmonics at a time, one a channel.
        for (std::size_t first = 0; first < std::size(harmonics); first += 3) {
            const std::size_t count = std::min<std::size_t>(3, std::size(harmonics) - first);
            const auto basis = [&](std::size_t k, const DVec3& w) {
                double y[81];
                sh::evaluate(9, w.x, w.y, w.z, y);
                const auto [l, m] = harmonics[first + k];
                return y[sh::index(l, m)];
            };
            const auto environment = test::environment(grid, [&](const test::Texel& t, auto) {
                DVec3 L{0};
                for (std::size_t k = 0; k < count; ++k) {
                    L[static_cast<int>(k)] =
                        1.5 + test::average(t, [&](const DVec3& w) { return basis(k, w); });
                }
                return L;
            });
            for (const Row& row : rows) {
                const Mip mip = bake_one(environment, row.r, 6);
                for (std::size_t k = 0; k < count; ++k) {
                    const int l = harmonics[first + k].first;
                    double worst = 0;
                    for (std::size_t i = 0; i < texel_count(mip); ++i) {
                        const double expected =
                            1.5 + row.eigenvalue[l] * basis(k, direction_of(mip, i));
                        worst = std::max(
                            worst, std::abs(texel_of(mip, i)[static_cast<int>(k)] - expected));
                    }
                    // Averaging over texels of 0.0245 (0.035) takes l (l + 1) 0.0245^2 / 24 off Y.
                    EXPECT_LT(worst, 1.5e-3 + 4e-5 * l * (l + 1)) << "l=" << l << " r=" << row.r;
                }
            }
        }
    }
}

TEST(Mips, MatchBruteForceOnEveryGrid) {
    for (const Grid& grid : odd_grids()) {
        const Environment environment = test::environment(grid, [](auto&, std::size_t i) {
            RandomStream random(3, 4, i);
            return DVec3{random.next(), 50 * random.next() * random.next(), i % 3 == 0 ? 1.0 : 0.0};
        });
        const test::PrefilterReference reference(environment);
        for (const float r : {0.05f, 0.25f, 0.5f, 1.0f}) {
            const Mip mip = bake_one(environment, r, 5);
            // Texels of up to 360 degrees: measured up to 1.35e-3, on 3 x 5 texels at r = 0.5.
            EXPECT_LT(worst_error(mip, reference, 4), 1.5e-3)
                << "r=" << r << " texels " << environment.radiance.size();
        }
    }
}

TEST(Mips, MatchBruteForceUnderSunAndSky) {
    for (const Grid& grid : {Grid(test::lat_long_grid(192, 96)), Grid(test::cube_grid(40)),
                             Grid(test::uneven_lat_long_grid(101, 50))}) {
        const Environment environment = test::sun_and_sky(grid);
        const test::PrefilterReference reference(environment);
        // Sizes that tile unevenly; interpolated tiles at (r = 1/4, 100).
        const std::pair<float, int> levels[] = {
            {0.03f, 13}, {0.1f, 40}, {0.25f, 100}, {0.5f, 37}, {1.0f, 11}};
        for (const auto& [r, size] : levels) {
            for (const double tolerance : {1e-4, 1e-3, 1e-2}) {
                const Mip mip = bake_one(environment, r, size, tolerance);
                const double worst = worst_error(mip, reference, 4);
                EXPECT_LT(worst, tolerance) << "r=" << r;
                EXPECT_LE(worst, mip.error_estimate) << "r=" << r;
            }
        }
    }
}

TEST(Mips, LampsInTheNight) {
    // Blocks with a lamp in one corner are as skew as blocks get; all else is dark.
    const Environment environment =
        test::environment(test::lat_long_grid(128, 64), [](auto&, std::size_t i) {
            RandomStream random(8, 15, i);
            const double dark = 0.01 * (0.5 + random.next());
            const double lamp = random.next() < 2e-3 ? 100 * random.next() : 0;
            return DVec3{dark + lamp, dark + 0.5 * lamp, dark};
        });
    const test::PrefilterReference reference(environment);
    for (const auto& [r, size] : {std::pair{0.05f, 12}, {0.1f, 16}, {0.15f, 24}, {0.25f, 48}}) {
        const Mip mip = bake_one(environment, r, size);
        const double worst = worst_error(mip, reference, 40);
        EXPECT_LT(worst, 1e-3) << "r=" << r;
        EXPECT_LE(worst, mip.error_estimate) << "r=" << r;
    }
}

TEST(Mips, OneHotTexelAnywhere) {
    // At a pole, on the seam, at the edge and the corner of faces, and nowhere in particular; the
    // horizon of such a map is all kink. Every texel of the mip is checked.
    LatLongGrid grid = test::lat_long_grid(128, 64);
    const std::size_t places[] = {
        0, 127 + 128 * 20, 128 * 64 - 7, 40 + 128 * 31, 16 + 128 * 19, 77 + 128 * 45};
    for (const double peak : {1e5, 65504.0, 1e30}) {
        for (const std::size_t place : places) {
            const auto environment = test::environment(grid, [&](auto&, std::size_t i) {
                return i == place ? DVec3(peak, peak, 0) : DVec3(0);
            });
            const test::PrefilterReference reference(environment);
            for (const float r : {0.25f, 0.5f, 1.0f}) {
                const Mip mip = bake_one(environment, r, 8);
                expect_sane(mip, DVec3(0), {peak * 1.0001, peak * 1.0001, 0});
                EXPECT_LT(worst_error(mip, reference, 0), 1e-3)
                    << "texel " << place << " r=" << r << " peak " << peak;
            }
            if (peak < 1e5 || peak > 1e6) break;  // one place is enough for the other peaks
        }
    }
}

TEST(Mips, NoSeamsBetweenFaces) {
    // Across each of the twelve edges, texel by texel: what lies between two neighbours' values is
    // what lies between the true ones, so an edge shows no more than any line of texels does.
    const Environment environment = test::sun_and_sky(test::lat_long_grid(96, 48));
    const test::PrefilterReference reference(environment);
    for (const float r : {0.25f, 0.6f}) {
        constexpr int n = 12;
        const Mip mip = bake_one(environment, r, n);
        int pairs = 0;
        for (std::size_t i = 0; i < texel_count(mip); ++i) {
            const int row = static_cast<int>(i) / n % n, column = static_cast<int>(i) % n;
            const auto face = static_cast<cube::Face>(i / slot(n * n));
            const double u = 2 * (column + 0.5) / n - 1, v = 2 * (row + 0.5) / n - 1;
            // The texel beyond the edge: half a texel on, in the plane of this face.
            const double over = 1 + 1.0 / n;
            std::vector<std::pair<double, double>> beyond;
            if (column == 0) beyond.emplace_back(-over, v);
            if (column == n - 1) beyond.emplace_back(over, v);
            if (row == 0) beyond.emplace_back(u, -over);
            if (row == n - 1) beyond.emplace_back(u, over);
            for (const auto& [bu, bv] : beyond) {
                const auto to = cube::project(cube::direction(face, bu, bv));
                ASSERT_NE(to.face, face);
                const auto at = [](double x) {
                    return std::clamp(static_cast<int>((x + 1) / 2 * n), 0, n - 1);
                };
                const std::size_t j =
                    slot(static_cast<int>(to.face) * n * n + at(to.v) * n + at(to.u));
                if (j < i) continue;  // once a pair
                ++pairs;
                if (pairs % 9 != 0) continue;
                const DVec3 step = texel_of(mip, i) - texel_of(mip, j);
                const DVec3 a = reference.value(direction_of(mip, i), static_cast<double>(r));
                const DVec3 b = reference.value(direction_of(mip, j), static_cast<double>(r));
                for (int k = 0; k < 3; ++k) {
                    EXPECT_NEAR(step[k], a[k] - b[k], 1e-3 * (a[k] + b[k])) << i << " " << j;
                }
            }
        }
        EXPECT_EQ(pairs, 12 * n);
    }
}

TEST(Mips, BrightnessFallsWithTheAngleFromALoneSun) {
    const auto environment = test::sun_and_sky(test::lat_long_grid(256, 128));
    Environment sun = environment;
    std::size_t hottest = 0;
    for (std::size_t i = 0; i < sun.radiance.size(); ++i) {
        if (sun.radiance[i].g > sun.radiance[hottest].g) hottest = i;
    }
    for (std::size_t i = 0; i < sun.radiance.size(); ++i) {
        if (i != hottest) sun.radiance[i] = Vec3(0);
    }
    const DVec3 towards = test::texels_of(sun.grid)[hottest].middle();
    for (const float r : {0.3f, 1.0f}) {
        const Mip mip = bake_one(sun, r, 16);
        std::vector<std::pair<double, double>> by_angle;
        for (std::size_t i = 0; i < texel_count(mip); ++i) {
            by_angle.emplace_back(glm::dot(towards, direction_of(mip, i)), texel_of(mip, i).g);
        }
        std::sort(by_angle.begin(), by_angle.end());
        for (std::size_t i = 1; i < by_angle.size(); ++i) {
            // Two texels at the same angle from the centre of a square sun differ by its shape.
            EXPECT_GE(by_angle[i].second, by_angle[i - 1].second * (1 - 2e-3) - 1e-6) << i;
        }
    }
}

TEST(Mips, ConstantStaysConstant) {
    for (const Grid& grid : odd_grids()) {
        const DVec3 c{0.7, 123.456, 1e-3};
        const auto environment = test::environment(grid, [&](auto&, auto) { return c; });
        for (const float r : {0.0f, 1e-3f, 0.1f, 0.5f, 1.0f}) {
            const Mip mip = bake_one(environment, r, 7);
            for (std::size_t i = 0; i < texel_count(mip); ++i) {
                for (int k = 0; k < 3; ++k) {
                    ASSERT_NEAR(texel_of(mip, i)[k] / c[k], 1, 1e-6) << "r=" << r;
                }
            }
        }
    }
}

TEST(Mips, BlackStaysBlack) {
    for (const Grid& grid : odd_grids()) {
        const auto environment = test::environment(grid, [](auto&, auto) { return DVec3(0); });
        for (const float r : {0.0f, 1e-3f, 0.25f, 1.0f}) {
            const Mip mip = bake_one(environment, r, 4);
            for (const float t : mip.texels) ASSERT_EQ(t, 0);
        }
    }
}

TEST(Mips, HostileContentStaysFiniteAndBounded) {
    const auto noise = [](const test::Texel&, std::size_t i) {
        RandomStream random(9, 9, i);
        return DVec3{random.next(), std::exp(20 * random.next()), std::exp(-80 * random.next())};
    };
    const auto checkerboard = [](const test::Texel&, std::size_t i) {
        return DVec3((i + i / 33) % 2 == 0 ? 1e4 : 1.0);
    };
    const auto largest = [](const test::Texel&, std::size_t i) {
        return DVec3(i % 5 == 0 ? static_cast<double>(std::numeric_limits<float>::max()) : 0.0);
    };
    const auto smallest = [](const test::Texel&, std::size_t i) {
        return DVec3(i % 2 == 0 ? 1e-44 : 0.0);
    };
    std::vector<Grid> grids = odd_grids();
    grids.emplace_back(test::lat_long_grid(33, 17));
    for (const Grid& grid : grids) {
        for (int kind = 0; kind < 4; ++kind) {
            const auto environment = kind == 0   ? test::environment(grid, noise)
                                     : kind == 1 ? test::environment(grid, checkerboard)
                                     : kind == 2 ? test::environment(grid, largest)
                                                 : test::environment(grid, smallest);
            DVec3 low(environment.radiance[0]), high = low;
            for (const Vec3& L : environment.radiance) {
                low = glm::min(low, DVec3(L));
                high = glm::max(high, DVec3(L));
            }
            for (const float r : {0.0f, 1e-3f, 1e-2f, 0.25f, 1.0f}) {
                expect_sane(bake_one(environment, r, 3, 1e-2), low, high);
            }
        }
    }
}

TEST(Mips, TinyRoughnessIsTheSourceItself) {
    // Continuous down to r = 1e-3: there the lobe (1e-6 rad) lies within one source texel.
    const auto environment = test::sun_and_sky(test::lat_long_grid(64, 32));
    const test::PrefilterReference reference(environment);
    for (const float r : {1e-3f, 5e-3f, 0.02f, 0.06f}) {
        const Mip mip = bake_one(environment, r, 6);
        EXPECT_LT(worst_error(mip, reference, 10), 1e-3) << r;
    }
    const Mip sharp = bake_one(environment, 1e-3f, 6);
    const auto texels = test::texels_of(environment.grid);
    int checked = 0;
    for (std::size_t i = 0; i < texel_count(sharp); ++i) {
        const DVec3 d = direction_of(sharp, i);
        const double theta = std::acos(d.y), phi = std::atan2(d.z, d.x);
        for (std::size_t k = 0; k < texels.size(); ++k) {
            const auto& t = texels[k];
            const double margin = 0.01;
            if (theta > t.a0 + margin && theta < t.a1 - margin && phi > t.b0 + margin &&
                phi < t.b1 - margin && std::sin(theta) > 0.3) {
                // 1e-6 rad beside a margin of 3e-3: the tail outside the texel is below 1e-6 of it,
                // but the sun is 1e6 times brighter than the ground.
                EXPECT_NEAR(texel_of(sharp, i).g / static_cast<double>(environment.radiance[k].g),
                            1, 2e-3);
                ++checked;
            }
        }
    }
    EXPECT_GT(checked, 50);
}

TEST(Mips, RoughMipsKeepTheEnergy) {
    // The weight depends on the angle alone, so that the average over all directions is the map's.
    const auto environment = test::sun_and_sky(test::lat_long_grid(128, 64));
    const DVec3 mean = test::PrefilterReference(environment).mean();
    for (const float r : {0.5f, 1.0f}) {
        const DVec3 kept = average_of(bake_one(environment, r, 32));
        for (int k = 0; k < 3; ++k) EXPECT_NEAR(kept[k] / mean[k], 1, 3e-3) << r;
    }
}

TEST(Mips, LevelsAndSizesAreThoseOfTheJob) {
    const auto environment = test::sun_and_sky(test::lat_long_grid(64, 32));
    Progress progress;
    const auto mips = bake_mips({.face_size = 10,
                                 .perceptual_roughness = {0, 0.5f, 1},
                                 .levels = {0, 2, 5},
                                 .tolerance = 1e-2},
                                environment, progress);
    ASSERT_EQ(mips.size(), 3u);
    const int sizes[] = {10, 2, 1};
    for (std::size_t i = 0; i < 3; ++i) {
        EXPECT_EQ(mips[i].width, sizes[i]);
        EXPECT_EQ(mips[i].height, sizes[i]);
        EXPECT_EQ(mips[i].texels.size(), slot(18 * sizes[i] * sizes[i]));
    }
    EXPECT_EQ(mips[1].level, 2);
    EXPECT_EQ(mips[2].perceptual_roughness, 1);
    EXPECT_EQ(progress.done(), progress.total());
}

TEST(Mips, SameBitsOnAnyNumberOfThreads) {
    const auto environment = test::sun_and_sky(test::lat_long_grid(128, 64));
    for (const float r : {0.0f, 0.04f, 0.25f, 1.0f}) {
        const ThreadLimit one(1);
        const Mip single = bake_one(environment, r, 32, 1e-2);
        const ThreadLimit many(8);
        const Mip parallel = bake_one(environment, r, 32, 1e-2);
        EXPECT_EQ(single.texels, parallel.texels) << r;
        EXPECT_EQ(single.error_estimate, parallel.error_estimate) << r;
    }
}

}  // namespace
}  // namespace envbake
