// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/sh_projection.h"

#include "baker/core/parallel.h"
#include "envbake/runtime/sh.h"
#include "envbake/runtime/sh_rotation.h"
#include "tests/support/environments.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace envbake {
namespace {

using std::numbers::pi;
using test::slot;
using Grid = std::variant<LatLongGrid, CubeGrid>;

ShLighting project(int bands, const Environment& environment) {
    return project_sh({.bands = bands}, environment);
}

double irradiance(const ShLighting& sh, const DVec3& n) {
    std::vector<double> y(slot(sh::coeff_count(sh.bands)));
    sh::evaluate(sh.bands, n.x, n.y, n.z, y.data());
    double sum = 0;
    for (int l = 0; l < sh.bands; ++l) {
        for (int m = -l; m <= l; ++m) {
            const auto i = slot(sh::index(l, m));
            sum += sh::clamped_cosine(l) * sh.coeffs[i].r * y[i];
        }
    }
    return sum;
}

/// The same integrals by midpoints of parts of every texel, `refinement` times as many as it takes
/// to have parts of 0.025: no closed form, no Gauss rule, no other frame. The error falls as 1 /
/// refinement^2, so that two of them can be extrapolated.
std::vector<DVec3> by_midpoints(int bands, const Environment& environment, int refinement) {
    std::vector<DVec3> sum(slot(sh::coeff_count(bands)), DVec3{0});
    std::vector<double> y(sum.size());
    const auto texels = test::texels_of(environment.grid);
    const auto parts_of = [&](double length) {
        return refinement * static_cast<int>(std::ceil(length / 0.025));
    };
    for (std::size_t i = 0; i < texels.size(); ++i) {
        const auto& t = texels[i];
        const int rows = parts_of(t.a1 - t.a0), columns = parts_of(t.b1 - t.b0);
        for (int p = 0; p < rows; ++p) {
            for (int q = 0; q < columns; ++q) {
                const double a = t.a0 + (t.a1 - t.a0) * (p + 0.5) / rows;
                const double b = t.b0 + (t.b1 - t.b0) * (q + 0.5) / columns;
                const DVec3 w = t.towards(a, b);
                sh::evaluate(bands, w.x, w.y, w.z, y.data());
                const double weight =
                    t.density(a, b) * (t.a1 - t.a0) * (t.b1 - t.b0) / (rows * columns);
                for (std::size_t k = 0; k < y.size(); ++k) {
                    sum[k] += weight * y[k] * DVec3(environment.radiance[i]);
                }
            }
        }
    }
    return sum;
}

double worst_difference(const std::vector<DVec3>& a, const std::vector<DVec3>& b) {
    double worst = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        for (int k = 0; k < 3; ++k) worst = std::max(worst, std::abs(a[i][k] - b[i][k]));
    }
    return worst;
}

std::vector<Grid> all_grids() {
    return {test::lat_long_grid(1, 1),
            test::lat_long_grid(2, 2),
            test::lat_long_grid(3, 5),
            test::lat_long_grid(64, 32),
            test::uneven_lat_long_grid(13, 7),
            test::lat_long_grid(512, 2),
            test::uneven_lat_long_grid(30, 45),
            test::cube_grid(1),
            test::cube_grid(2),
            test::cube_grid(5),
            test::cube_grid(32),
            test::uneven_cube_grid(6)};
}

TEST(ShProjection, ConstantHasOnlyTheFirstCoefficient) {  // rows A2 and B
    for (const Grid& grid : all_grids()) {
        const auto sh = project(10, test::environment(grid, [](auto&, auto) {
                                    return DVec3{1, 7, 0};
                                }));
        EXPECT_NEAR(sh.coeffs[0].r, 3.54490770181, 1e-11);
        EXPECT_NEAR(sh.coeffs[0].g, 7 * 2 * std::sqrt(pi), 1e-12);
        EXPECT_EQ(sh.coeffs[0].b, 0);
        for (std::size_t i = 1; i < sh.coeffs.size(); ++i) {
            EXPECT_NEAR(sh.coeffs[i].g, 0, 7e-12) << i << " grid " << grid.index();
        }
    }
}

TEST(ShProjection, EveryGridMatchesMidpoints) {
    for (const Grid& grid : all_grids()) {
        const Environment environment = test::environment(grid, [](auto&, std::size_t i) {
            RandomStream random(3, 4, i);
            return DVec3{random.next(), 4 * random.next(), i % 3 == 0 ? 1.0 : 0.0};
        });
        const auto coarse = by_midpoints(10, environment, 1);
        auto fine = by_midpoints(10, environment, 2);
        for (std::size_t i = 0; i < fine.size(); ++i) fine[i] += (fine[i] - coarse[i]) / 3.0;
        // What the extrapolation leaves is of fourth order, (10 * 0.025)^4 / 2880 of a coefficient.
        EXPECT_LT(worst_difference(project(10, environment).coeffs, fine), 5e-6)
            << environment.radiance.size() << " texels";
    }
}

TEST(ShProjection, ConvergedRuleOnOneTexelAFace) {
    // A 1 x 1 face asks for the most nodes. Split into 8 x 8 equal texels it is another rule.
    const auto face_value = [](int face) {
        return DVec3{1.0 + face, face * face, 1.0 / (1 + face)};
    };
    const auto coarse = test::environment(
        test::cube_grid(1), [&](const test::Texel& t, auto) { return face_value(t.face); });
    const auto fine = test::environment(
        test::cube_grid(8), [&](const test::Texel& t, auto) { return face_value(t.face); });
    EXPECT_LT(worst_difference(project(10, coarse).coeffs, project(10, fine).coeffs), 2e-11);

    const auto two = test::environment(test::lat_long_grid(2, 2),
                                       [](auto&, std::size_t i) { return DVec3(double(i)); });
    const auto many =
        test::environment(test::lat_long_grid(128, 64), [](const test::Texel& t, auto) {
            return DVec3((t.middle().y < 0 ? 2 : 0) + (t.middle().z > 0 ? 1 : 0));
        });
    EXPECT_LT(worst_difference(project(10, two).coeffs, project(10, many).coeffs), 2e-12);
}

TEST(ShProjection, ZonalCapHasClosedForm) {  // row A4, about +Y, so that the poles must be turned
    const double edge = 45.0 * pi / 180;
    LatLongGrid grid = test::lat_long_grid(8, 4);
    grid.theta_edges = {0, edge, 1.5, 2.5, pi};
    const auto cap = test::environment(
        grid, [&](const test::Texel& t, auto) { return DVec3(t.a0 < edge / 2 ? 1.0 : 0.0); });
    const auto sh = project(6, cap);
    const double moments[] = {1.84030236902,  1.57079632679,  1.11072073454,
                              0.589048622548, 0.138840091817, -0.147262155637};
    std::vector<double> y(36);
    sh::evaluate(6, 0.0, 1.0, 0.0, y.data());
    for (int l = 0; l < 6; ++l) {
        // l_lm = 2 pi integral P_l * Y_lm(axis)
        for (int m = -l; m <= l; ++m) {
            const auto i = slot(sh::index(l, m));
            EXPECT_NEAR(sh.coeffs[i].r, moments[l] * y[i], 1e-11) << "l=" << l << " m=" << m;
        }
    }
}

TEST(ShProjection, HemisphereSkyIsExactInTwoBands) {  // row A8
    const auto sky = test::environment(test::lat_long_grid(16, 8), [](const test::Texel& t, auto) {
        return DVec3(t.middle().y > 0 ? 1.0 : 0.0);
    });
    const double tilt = 70 * pi / 180;
    const DVec3 n{std::sin(tilt), std::cos(tilt), 0};
    EXPECT_NEAR(irradiance(project(2, sky), n), 2.10804031162, 1e-11);
}

TEST(ShProjection, DiscLightIrradiance) {  // row A9: pi sin^2 a cos t, to what 10 bands can hold
    const double edge = 20 * pi / 180, tilt = 49.9 * pi / 180;
    LatLongGrid grid = test::lat_long_grid(4, 2);
    grid.theta_edges = {0, edge, pi};
    const auto disc = test::environment(
        grid, [&](const test::Texel& t, auto) { return DVec3(t.a0 == 0 ? 1.0 : 0.0); });
    const auto sh = project(10, disc);
    // Truncated at l = 9 the series of this disc is off by at most sum_{l=10,12..} |A_l c_l|: 4e-3.
    EXPECT_NEAR(irradiance(sh, {std::sin(tilt), std::cos(tilt), 0}), 0.236485093141, 4e-3);
}

TEST(ShProjection, OneHotTexelKeepsItsEnergy) {
    for (const double peak : {1e5, 65504.0, 1e30}) {
        for (const Grid& grid : {Grid(test::lat_long_grid(64, 32)), Grid(test::cube_grid(16))}) {
            const auto texels = test::texels_of(grid);
            for (const std::size_t hot : {std::size_t{0}, texels.size() / 2, texels.size() - 1}) {
                const auto sun = test::environment(grid, [&](const test::Texel&, std::size_t i) {
                    return i == hot ? DVec3(peak) : DVec3(0);
                });
                const auto& t = texels[hot];
                const double omega = t.face < 0 ? (std::cos(t.a0) - std::cos(t.a1)) * (t.b1 - t.b0)
                                                : cube::solid_angle(t.b0, t.b1, t.a0, t.a1);
                const double flux = static_cast<double>(sun.radiance[hot].r) * omega;
                const auto sh = project(10, sun);
                EXPECT_NEAR(sh.coeffs[0].r / (flux / (2 * std::sqrt(pi))), 1, 1e-12);
                for (const auto& c : sh.coeffs) EXPECT_TRUE(std::isfinite(c.r));
            }
        }
    }
}

TEST(ShProjection, OneTexelOfManyIsRightWhereverItIs) {
    // One bright texel is the worst case of summing rows before they are weighed: nothing averages
    // out. Rows from pole to pole, at ends and in the middle of a block; the last block is short.
    const Grid grids[] = {test::lat_long_grid(320, 333), test::uneven_lat_long_grid(321, 300)};
    for (const Grid& grid : grids) {
        const int height = std::get<LatLongGrid>(grid).height,
                  width = std::get<LatLongGrid>(grid).width;
        const auto texels = test::texels_of(grid);
        for (const int row : {0, 1, 15, 16, 31, 32, 47, height / 2, height - 5, height - 1}) {
            const auto hot = slot(row * width + 7);
            const auto sh = project(10, test::environment(grid, [&](auto&, std::size_t i) {
                                        return DVec3(i == hot ? 3.0 : 0.0);
                                    }));
            const auto& t = texels[hot];
            // cos a0 - cos a1, without the cancellation.
            const double flux =
                3 * 2 * std::sin((t.a0 + t.a1) / 2) * std::sin((t.a1 - t.a0) / 2) * (t.b1 - t.b0);
            for (std::size_t k = 0; k < sh.coeffs.size(); ++k) {
                const double expected = flux * test::average(t, [&](const DVec3& w) {
                                            std::vector<double> y(sh.coeffs.size());
                                            sh::evaluate(10, w.x, w.y, w.z, y.data());
                                            return y[k];
                                        });
                // The Gauss rule of the reference is better than 1e-14 on these texels.
                EXPECT_NEAR(sh.coeffs[k].r, expected, 1e-12 * sh.coeffs[0].r)
                    << "row " << row << ", " << k;
            }
        }
    }
}

TEST(ShProjection, ManyRowsAreAsExactAsFew) {
    // 512 rows in blocks of 32 against 8 rows in one block: the same light, other nodes.
    const auto value = [](int row, int column) {
        RandomStream random(5, 6, slot(16 * row + column));
        return DVec3{random.next(), row == 3 && column == 0 ? 1e5 : 0.0, 1.0};
    };
    const auto few = test::environment(test::lat_long_grid(16, 8), [&](auto&, std::size_t i) {
        return value(static_cast<int>(i) / 16, static_cast<int>(i) % 16);
    });
    const auto many = test::environment(test::lat_long_grid(112, 512), [&](auto&, std::size_t i) {
        return value(static_cast<int>(i) / 112 / 64, static_cast<int>(i) % 112 / 7);
    });
    const auto a = project(10, few), b = project(10, many);
    for (std::size_t i = 0; i < a.coeffs.size(); ++i) {
        for (int k = 0; k < 3; ++k) {
            EXPECT_NEAR(a.coeffs[i][k], b.coeffs[i][k], 1e-12 * a.coeffs[0][k]);
        }
    }
}

TEST(ShProjection, GreyMapsAreReadFromRed) {
    auto grids = all_grids();
    grids.push_back(test::lat_long_grid(200, 100));
    for (const Grid& grid : grids) {
        const auto environment = test::environment(grid, [](auto&, std::size_t i) {
            RandomStream random(7, 8, i);
            return DVec3{random.next(), 9, 11};
        });
        const auto colour = project(10, environment);
        const auto grey = project_sh({.bands = 10, .channels = 1}, environment);
        ASSERT_EQ(grey.coeffs.size(), colour.coeffs.size());
        for (std::size_t i = 0; i < grey.coeffs.size(); ++i) {
            EXPECT_NEAR(grey.coeffs[i].r, colour.coeffs[i].r, 1e-14 * colour.coeffs[0].r);
            EXPECT_EQ(grey.coeffs[i], DVec3{grey.coeffs[i].r});
        }
    }
}

std::vector<DVec3> turned(const ShLighting& sh, const sh::Matrix3& matrix) {
    std::vector<double> c;
    for (const DVec3& v : sh.coeffs) c.insert(c.end(), {v.x, v.y, v.z});
    EXPECT_TRUE(sh::Rotation::from_matrix(matrix).value().apply(c, c, 3));
    std::vector<DVec3> out(sh.coeffs.size());
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = {c[3 * i], c[3 * i + 1], c[3 * i + 2]};
    return out;
}

/// Azimuth atan2(z, x) grows by `angle`.
sh::Matrix3 about_y(double angle) {
    const double c = std::cos(angle), s = std::sin(angle);
    return {{{c, 0, -s}, {0, 1, 0}, {s, 0, c}}};
}

TEST(ShProjection, TurnedMapHasTurnedCoefficients) {
    // A sun in a pole row, in the columns beside the seam and elsewhere, over noise.
    constexpr int kWidth = 36, kHeight = 18;
    const auto map = [&](int shift) {
        return test::environment(test::lat_long_grid(kWidth, kHeight), [&](auto&, std::size_t i) {
            const int row = static_cast<int>(i) / kWidth;
            const int column = (static_cast<int>(i) % kWidth - shift + kWidth) % kWidth;
            RandomStream random(9, 10, slot(row * kWidth + column));
            const bool sun = (row == 0 && column == 3) || (row == 9 && column == 0) ||
                             (row == 12 && column == kWidth - 1);
            return DVec3{random.next(), sun ? 65504.0 : 0.0, random.next() + (sun ? 1e30 : 0)};
        });
    };
    const auto still = project(10, map(0));
    for (const int shift : {1, 7, 18, 35}) {
        const auto a = project(10, map(shift)).coeffs;
        const auto b = turned(still, about_y(2 * pi * shift / kWidth));
        for (std::size_t i = 0; i < a.size(); ++i) {
            for (int k = 0; k < 3; ++k) EXPECT_NEAR(a[i][k], b[i][k], 1e-13 * still.coeffs[0][k]);
        }
    }
}

TEST(ShProjection, SunOnACubesEdgesAndCornersTurnsFromFaceToFace) {
    constexpr int kSize = 6;
    const Grid grid = test::cube_grid(kSize);
    const auto texels = test::texels_of(grid);
    const sh::Matrix3 quarter{{{0, 0, -1}, {1, 0, 0}, {0, -1, 0}}};  // two quarter turns in one
    const auto back = [](const DVec3& w) { return DVec3{w.y, -w.z, -w.x}; };
    for (const int column : {0, 2, kSize - 1}) {
        for (const int row : {0, kSize - 1}) {
            for (int face = 0; face < cube::kFaceCount; ++face) {
                const auto& sun = texels[slot((face * kSize + row) * kSize + column)];
                const auto lit = [&](const DVec3& w) {
                    return DVec3(glm::distance(w, sun.middle()) < 1e-6 ? 1e5 : 0.0);
                };
                const auto still = project(
                    10, test::environment(
                            grid, [&](const test::Texel& t, auto) { return lit(t.middle()); }));
                const auto moved =
                    project(10, test::environment(grid, [&](const test::Texel& t, auto) {
                                return lit(back(t.middle()));
                            }));
                ASSERT_GT(still.coeffs[0].r, 0);
                EXPECT_LT(worst_difference(moved.coeffs, turned(still, quarter)),
                          1e-12 * still.coeffs[0].r);
            }
        }
    }
}

TEST(ShProjection, TurnedFunctionHasTurnedCoefficients) {
    // A general turn cannot keep texels. Averages over texels of size h are off by O(h^2): what is
    // left must fall fourfold when h halves, and does. Measured 7.2e-4 and 1.8e-4.
    const sh::Matrix3 matrix{{{0.36, 0.48, -0.8}, {-0.8, 0.6, 0}, {0.48, 0.64, 0.6}}};
    const DVec3 rows[] = {{0.36, 0.48, -0.8}, {-0.8, 0.6, 0}, {0.48, 0.64, 0.6}};
    const auto f = [](const DVec3& w) {
        return std::exp(2 * (0.6 * w.x - 0.8 * w.z)) + w.y * w.y * w.x;
    };
    const auto f_turned = [&](const DVec3& w) {  // f(M^-1 w), M^-1 = M^T
        return f(w.x * rows[0] + w.y * rows[1] + w.z * rows[2]);
    };
    double error[2] = {};
    for (int i = 0; i < 2; ++i) {
        const auto grid = test::lat_long_grid(64 << i, 32 << i);
        const auto still = project(10, test::environment(grid, [&](const test::Texel& t, auto) {
                                       return DVec3(test::average(t, f));
                                   }));
        const auto moved = project(10, test::environment(grid, [&](const test::Texel& t, auto) {
                                       return DVec3(test::average(t, f_turned));
                                   }));
        error[i] = worst_difference(moved.coeffs, turned(still, matrix)) / still.coeffs[0].r;
    }
    EXPECT_LT(error[0], 1e-3);
    EXPECT_LT(error[1], error[0] / 3.5);
}

TEST(ShProjection, CheckerboardOfHugeContrastAddsUpToGrey) {
    // Turned by one column it is its own negative: both together are constant.
    for (const auto& [width, height] : {std::pair{64, 32}, {4096, 2}, {2, 70}}) {
        const auto map = test::environment(
            test::lat_long_grid(width, height), [&, w = width](auto&, std::size_t i) {
                const bool light = (i / slot(w) + i % slot(w)) % 2 == 0;
                return DVec3{light ? 1e30 : 0, light ? 1e5 : 1e-5, light ? 65504 : 1};
            });
        const auto sh = project(10, map);
        const auto other = turned(sh, about_y(2 * pi / width));
        for (std::size_t i = 0; i < other.size(); ++i) {
            const DVec3 both = sh.coeffs[i] + other[i];
            const DVec3 expected =
                i == 0 ? 2 * std::sqrt(pi) * DVec3{1e30, 1e5 + 1e-5, 65505} : DVec3(0);
            // Radiance is stored in float.
            for (int k = 0; k < 3; ++k) {
                EXPECT_NEAR(both[k], expected[k], (i == 0 ? 1e-7 : 1e-12) * sh.coeffs[0][k]);
            }
        }
    }
}

TEST(ShProjection, BlackIsZero) {
    const auto sh = project(
        10, test::environment(test::lat_long_grid(3, 5), [](auto&, auto) { return DVec3(0); }));
    for (const auto& c : sh.coeffs) EXPECT_EQ(c, DVec3(0));
}

TEST(ShProjection, SameBitsOnAnyNumberOfThreads) {
    for (const Grid& grid : {Grid(test::lat_long_grid(128, 64)), Grid(test::cube_grid(32))}) {
        const auto environment = test::sun_and_sky(grid);
        const ThreadLimit one(1);
        const auto single = project(5, environment).coeffs;
        {
            const ThreadLimit many(8);
            EXPECT_EQ(project(5, environment).coeffs, single);
        }
    }
}

}  // namespace
}  // namespace envbake
