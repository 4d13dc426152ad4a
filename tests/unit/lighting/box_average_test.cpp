// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/box_average.h"

#include "baker/core/parallel.h"
#include "tests/support/environments.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace envbake::lighting {
namespace {

using std::numbers::pi;
using test::slot;
using Grid = std::variant<LatLongGrid, CubeGrid>;

constexpr MipLayout kLayouts[] = {MipLayout::CubeFaces, MipLayout::LatLong};

std::vector<Grid> odd_grids() {
    return {
        test::lat_long_grid(1, 1),  test::lat_long_grid(2, 2),   test::lat_long_grid(3, 5),
        test::lat_long_grid(10, 4), test::lat_long_grid(256, 2), test::uneven_lat_long_grid(13, 7),
        test::cube_grid(1),         test::cube_grid(3),          test::uneven_cube_grid(6)};
}

/// The texels of the output, in its order.
std::vector<test::Texel> output_texels(MipLayout layout, int size) {
    return layout == MipLayout::CubeFaces
               ? test::texels_of(test::cube_grid(size))
               : test::texels_of(test::lat_long_grid(4 * size, 2 * size));
}

double solid_angle(const test::Texel& t) {
    return t.face < 0
               ? 2 * std::sin((t.a0 + t.a1) / 2) * std::sin((t.a1 - t.a0) / 2) * (t.b1 - t.b0)
               : cube::solid_angle(t.b0, t.b1, t.a0, t.a1);
}

std::string named(const Grid& grid, MipLayout layout, int size) {
    return std::to_string(test::texels_of(grid).size()) + " texels to " +
           (layout == MipLayout::CubeFaces ? "faces of " : "lat-long of ") + std::to_string(size);
}

Environment noise(const Grid& grid, std::uint64_t seed = 3) {
    return test::environment(grid, [&](auto&, std::size_t i) {
        RandomStream random(seed, 4, i);
        return DVec3{1 + random.next(), random.next(), 1};
    });
}

/// Flux of one channel, radiance times steradian.
double flux_of(const std::vector<float>& texels, MipLayout layout, int size, std::size_t channel,
               std::size_t channels = 3) {
    double sum = 0;
    const auto places = output_texels(layout, size);
    for (std::size_t i = 0; i < places.size(); ++i) {
        sum += static_cast<double>(texels[i * channels + channel]) * solid_angle(places[i]);
    }
    return sum;
}

TEST(BoxAverage, MatchesALatticeOfPoints) {
    // Against 2048 points of a two-dimensional lattice a texel.
    for (const Grid& grid : odd_grids()) {
        const Environment environment = noise(grid);
        for (const MipLayout layout : kLayouts) {
            for (const int size : {1, 3, 4}) {
                const auto texels = box_average(environment, layout, size, 3);
                const auto places = output_texels(layout, size);
                ASSERT_EQ(texels.size(), 3 * places.size());
                for (std::size_t i = 0; i < places.size(); i += 5) {
                    const test::Texel& t = places[i];
                    constexpr int kPoints = 2048;
                    DVec3 sum{0};
                    double omega = 0;
                    for (int p = 0; p < kPoints; ++p) {
                        double whole = 0;
                        const double a =
                            t.a0 + (t.a1 - t.a0) * std::modf(0.5 + p * 0.7548776662466927, &whole);
                        const double b =
                            t.b0 + (t.b1 - t.b0) * std::modf(0.5 + p * 0.5698402909980532, &whole);
                        const double weight = t.density(a, b);
                        sum += weight * DVec3(radiance_towards(environment, t.towards(a, b)));
                        omega += weight;
                    }
                    for (int k = 0; k < 3; ++k) {
                        ASSERT_NEAR(static_cast<double>(texels[3 * i + slot(k)]), sum[k] / omega,
                                    1e-2)
                            << "texel " << i << ", " << named(grid, layout, size);
                    }
                }
            }
        }
    }
}

TEST(BoxAverage, LatLongAndFacesAreEachOthersTranspose) {
    // Averages are what the grids share: the integral of a product does not mind which of the two
    // maps is averaged over the texels of the other.
    for (const int size : {1, 2, 3, 8, 17}) {
        for (const Grid& faces :
             {Grid(test::cube_grid(1)), Grid(test::cube_grid(6)), Grid(test::cube_grid(31))}) {
            const Environment f = noise(faces, 8);
            const Environment g = noise(test::lat_long_grid(4 * size, 2 * size), 9);
            const int face_size = std::get<CubeGrid>(faces).size;
            const auto f_averages = box_average(f, MipLayout::LatLong, size, 3);
            const auto g_averages = box_average(g, MipLayout::CubeFaces, face_size, 3);
            const auto g_places = output_texels(MipLayout::LatLong, size);
            const auto f_places = output_texels(MipLayout::CubeFaces, face_size);
            for (int k = 0; k < 3; ++k) {
                double over_g = 0, over_f = 0;
                for (std::size_t i = 0; i < g_places.size(); ++i) {
                    over_g += solid_angle(g_places[i]) * static_cast<double>(g.radiance[i][k]) *
                              static_cast<double>(f_averages[3 * i + slot(k)]);
                }
                for (std::size_t i = 0; i < f_places.size(); ++i) {
                    over_f += solid_angle(f_places[i]) * static_cast<double>(f.radiance[i][k]) *
                              static_cast<double>(g_averages[3 * i + slot(k)]);
                }
                EXPECT_NEAR(over_g / over_f, 1, 1e-7) << size << ", " << face_size;
            }
        }
    }
}

TEST(BoxAverage, KeepsTheEnergyOfALoneTexel) {
    // Texels at the poles, at the seam, on edges and corners of faces, and nowhere in particular.
    for (const Grid& grid :
         {Grid(test::lat_long_grid(200, 101)), Grid(test::lat_long_grid(128, 64)),
          Grid(test::uneven_lat_long_grid(64, 33)), Grid(test::lat_long_grid(7, 500)),
          Grid(test::cube_grid(48)), Grid(test::uneven_cube_grid(31))}) {
        const auto texels = test::texels_of(grid);
        std::vector<std::size_t> places{0, texels.size() / 3, texels.size() / 2, texels.size() - 1};
        if (texels.size() == 128 * 64) places = {5, 127 + 128 * 20, 16 + 128 * 32, 16 + 128 * 19};
        for (const std::size_t hot : places) {
            for (const double peak : {1e5, 1e30}) {
                const auto environment = test::environment(grid, [&](auto&, std::size_t i) {
                    return DVec3(i == hot ? peak : 0.0, 0.25 + (i == hot ? peak : 0.0), 0);
                });
                const double red =
                    static_cast<double>(environment.radiance[hot].r) * solid_angle(texels[hot]);
                const double green = red + pi;
                for (const MipLayout layout : kLayouts) {
                    for (const int size : {1, 5, 16, 32}) {
                        const auto out = box_average(environment, layout, size, 3);
                        EXPECT_NEAR(flux_of(out, layout, size, 0) / red, 1, 2e-7)
                            << hot << ", " << named(grid, layout, size);
                        EXPECT_NEAR(flux_of(out, layout, size, 1) / green, 1, 2e-7)
                            << hot << ", " << named(grid, layout, size);
                        EXPECT_EQ(flux_of(out, layout, size, 2), 0);
                    }
                }
            }
        }
    }
}

TEST(BoxAverage, ATexelGetsLightOnlyFromWhatItOverlaps) {
    // One texel of 1e30: outside of its surroundings, nothing at all.
    const Grid grid = test::lat_long_grid(64, 32);
    const auto places = test::texels_of(grid);
    for (const std::size_t hot :
         {slot(3), slot(63 + 64 * 9), slot(8 + 64 * 16), slot(64 * 32 - 5)}) {
        const auto environment = test::environment(
            grid, [&](auto&, std::size_t i) { return DVec3(i == hot ? 1e30 : 0.0); });
        for (const MipLayout layout : kLayouts) {
            const auto out = box_average(environment, layout, 16, 1);
            const auto texels = output_texels(layout, 16);
            for (std::size_t i = 0; i < texels.size(); ++i) {
                const double apart = glm::distance(texels[i].middle(), places[hot].middle());
                if (apart > 0.3) {
                    ASSERT_EQ(out[i], 0) << "texel " << i;
                }
            }
        }
    }
}

TEST(BoxAverage, TurnedAndMirroredMapsGiveTheSameBits) {
    const int width = 64, height = 33, size = 16;
    const Environment map = noise(test::lat_long_grid(width, height));
    Environment turned = map, mirrored = map;
    for (int r = 0; r < height; ++r) {
        for (int c = 0; c < width; ++c) {
            const auto at = [&](int column) { return slot(r * width + column); };
            turned.radiance[at((c + width / 4) % width)] = map.radiance[at(c)];
            mirrored.radiance[at(width - 1 - c)] = map.radiance[at(c)];
        }
    }
    const auto a = box_average(map, MipLayout::CubeFaces, size, 3);
    const auto b = box_average(turned, MipLayout::CubeFaces, size, 3);
    const auto c = box_average(mirrored, MipLayout::CubeFaces, size, 3);
    const std::size_t face = slot(3 * size * size);
    const auto begins = [&](const std::vector<float>& v, cube::Face f) {
        return v.begin() + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(f) * face);
    };
    // A quarter turn takes +X to +Z.
    EXPECT_TRUE(std::equal(begins(a, cube::Face::PositiveX), begins(a, cube::Face::NegativeX),
                           begins(b, cube::Face::PositiveZ)));
    for (int row = 0; row < size; ++row) {  // z to -z mirrors +X left to right
        for (int column = 0; column < size; ++column) {
            for (int k = 0; k < 3; ++k) {
                ASSERT_EQ(a[slot((row * size + column) * 3 + k)],
                          c[slot((row * size + size - 1 - column) * 3 + k)]);
            }
        }
    }
}

TEST(BoxAverage, OfTheOutputsOwnGridIsACopy) {
    for (const auto& [grid, layout, size] :
         {std::tuple{Grid(test::cube_grid(24)), MipLayout::CubeFaces, 24},
          {Grid(test::lat_long_grid(52, 26)), MipLayout::LatLong, 13}}) {
        const Environment environment = test::sun_and_sky(grid);
        const auto out = box_average(environment, layout, size, 3);
        const auto red = box_average(environment, layout, size, 1);
        ASSERT_EQ(out.size(), 3 * environment.radiance.size());
        ASSERT_EQ(red.size(), environment.radiance.size());
        for (std::size_t i = 0; i < environment.radiance.size(); ++i) {
            for (std::size_t k = 0; k < 3; ++k) {
                ASSERT_EQ(out[3 * i + k], environment.radiance[i][static_cast<int>(k)]);
            }
            ASSERT_EQ(red[i], environment.radiance[i].r);
        }
    }
}

TEST(BoxAverage, OneChannelIsRed) {
    for (const Grid& grid : odd_grids()) {
        const Environment environment = noise(grid);
        for (const MipLayout layout : kLayouts) {
            const auto all = box_average(environment, layout, 5, 3);
            const auto red = box_average(environment, layout, 5, 1);
            ASSERT_EQ(all.size(), 3 * red.size());
            for (std::size_t i = 0; i < red.size(); ++i) ASSERT_FLOAT_EQ(red[i], all[3 * i]);
        }
    }
}

TEST(BoxAverage, StaysBetweenTheLeastAndTheGreatest) {
    constexpr float kMax = std::numeric_limits<float>::max();
    for (const Grid& grid : odd_grids()) {
        for (const auto& [dark, bright] :
             {std::pair{0.1f, 0.1f}, {0.0f, 1e-44f}, {0.0f, kMax}, {kMax, kMax}, {3.0f, 1e5f}}) {
            const auto environment =
                test::environment(grid, [&, d = dark, b = bright](auto&, std::size_t i) {
                    return DVec3(static_cast<double>(i % 2 == 0 ? b : d));
                });
            for (const MipLayout layout : kLayouts) {
                for (const int size : {1, 2, 7}) {
                    for (const float v : box_average(environment, layout, size, 3)) {
                        ASSERT_GE(v, dark) << named(grid, layout, size);
                        ASSERT_LE(v, bright) << named(grid, layout, size);
                    }
                }
            }
        }
    }
}

TEST(BoxAverage, SameBitsOnAnyNumberOfThreads) {
    for (const Grid& grid : {Grid(test::lat_long_grid(128, 64)), Grid(test::lat_long_grid(37, 18)),
                             Grid(test::cube_grid(40)), Grid(test::uneven_cube_grid(33))}) {
        const Environment environment = noise(grid);
        for (const MipLayout layout : kLayouts) {
            const ThreadLimit one(1);
            const auto single = box_average(environment, layout, 20, 3);
            const ThreadLimit many(8);
            EXPECT_EQ(single, box_average(environment, layout, 20, 3));
        }
    }
}

}  // namespace
}  // namespace envbake::lighting
