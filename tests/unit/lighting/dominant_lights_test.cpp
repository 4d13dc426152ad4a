// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/dominant_lights.h"

#include "baker/core/parallel.h"
#include "baker/input/read_environment.h"
#include "baker/lighting/sh_projection.h"
#include "envbake/runtime/sh.h"
#include "tests/support/environments.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <ostream>
#include <string>
#include <vector>

namespace envbake {
namespace {

using std::numbers::pi;
using test::slot;
using test::Texel;

constexpr double kDegree = pi / 180;

DominantLights find(const Environment& environment) {
    return find_dominant_lights({}, environment);
}

double luminance(const DVec3& rgb) {
    return 0.2126 * rgb.r + 0.7152 * rgb.g + 0.0722 * rgb.b;
}

double angle(const DVec3& a, const DVec3& b) {
    return std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b));
}

double solid_angle_of(const Texel& t) {
    if (t.face < 0) return (std::cos(t.a0) - std::cos(t.a1)) * (t.b1 - t.b0);
    const auto corner = [](double u, double v) {
        return std::atan2(u * v, std::sqrt(1 + u * u + v * v));
    };
    return corner(t.b1, t.a1) - corner(t.b0, t.a1) - corner(t.b1, t.a0) + corner(t.b0, t.a0);
}

/// The flux of the map, by a code that knows nothing of lights.
DVec3 flux_of(const Environment& environment) {
    return project_sh({.bands = 1}, environment).coeffs[0] * std::sqrt(4 * pi);
}

/// Radiance 1 within `radius` of `centre`, by the share of the texel that it covers.
double disc(const Texel& t, const DVec3& centre, double radius) {
    if (angle(t.middle(), centre) > radius + 0.2) return 0;
    constexpr int kParts = 8;
    int inside = 0;
    for (int i = 0; i < kParts; ++i) {
        for (int j = 0; j < kParts; ++j) {
            const DVec3 w = t.towards(t.a0 + (t.a1 - t.a0) * (i + 0.5) / kParts,
                                      t.b0 + (t.b1 - t.b0) * (j + 0.5) / kParts);
            inside += angle(w, centre) < radius;
        }
    }
    return inside / static_cast<double>(kParts * kParts);
}

/// exp(k (cos - 1)), k = 1 / sigma^2: over the sphere 2 pi sigma^2 (1 - exp(-2 k)).
double lobe(const Texel& t, const DVec3& centre, double sigma) {
    if (angle(t.middle(), centre) > 0.2 + 8 * sigma) return 0;
    return test::average(
        t, [&](const DVec3& w) { return std::exp((glm::dot(w, centre) - 1) / (sigma * sigma)); });
}

/// What has been taken is what the lights carry; nothing grows, nothing falls below 0, nothing
/// outside of the lights changes; and SH lighting changes as if by lights without extent.
/// `colour_shift`: how far apart the mean directions of the channels may be, radians.
void expect_conserved(const Environment& before, const DominantLights& found, double colour_shift) {
    Environment after = before;
    const Vec3* where = after.radiance.data();
    remove_lights(found, after);
    ASSERT_EQ(after.radiance.data(), where);

    std::vector<bool> of_a_light(before.radiance.size());
    for (const LightTexels& run : found.texels) {
        for (std::size_t i = run.first; i < run.first + run.count; ++i) {
            EXPECT_FALSE(of_a_light[i]) << "texel " << i << " belongs to two lights";
            of_a_light[i] = true;
        }
    }
    for (std::size_t i = 0; i < of_a_light.size(); ++i) {
        if (of_a_light[i]) {
            for (int k = 0; k < 3; ++k) {
                ASSERT_GE(after.radiance[i][k], 0) << i;
                ASSERT_LE(after.radiance[i][k], before.radiance[i][k]) << i;
            }
        } else {
            ASSERT_EQ(after.radiance[i], before.radiance[i]) << i;
        }
    }

    constexpr int kBands = 5;
    const auto all = project_sh({.bands = kBands}, before), rest = project_sh({kBands}, after);
    const double whole = luminance(flux_of(before));
    std::vector<DVec3> lights(all.coeffs.size(), DVec3{0});
    std::vector<double> bound(slot(kBands), 0.0);
    double share = 0;
    for (const DominantLight& light : found.lights) {
        const DVec3& d = light.direction;
        EXPECT_NEAR(glm::length(d), 1, 1e-15);
        EXPECT_NEAR(luminance(light.irradiance) / whole, light.share, 1e-12);
        share += light.share;
        std::vector<double> y(lights.size());
        sh::evaluate(kBands, d.x, d.y, d.z, y.data());
        for (std::size_t i = 0; i < y.size(); ++i) lights[i] += light.irradiance * y[i];
        // Twice what it is for a disc holds for every shape of that mean cosine.
        const double r2 = light.angular_radius * light.angular_radius;
        for (int l = 0; l < kBands; ++l) {
            const double E = std::max({light.irradiance.r, light.irradiance.g, light.irradiance.b});
            const double highest = std::sqrt((2 * l + 1) / (4 * pi));
            bound[slot(l)] +=
                E * highest * (l * (l + 1) * r2 / 4 + std::sqrt(l * (l + 1)) * colour_shift);
        }
    }
    EXPECT_LE(share, 1 + 1e-12);
    for (int l = 0; l < kBands; ++l) {
        for (int m = -l; m <= l; ++m) {
            const auto i = slot(sh::index(l, m));
            const DVec3 taken = all.coeffs[i] - rest.coeffs[i];
            for (int k = 0; k < 3; ++k) {
                EXPECT_NEAR(taken[k], lights[i][k], bound[slot(l)] + 1e-11 * whole)
                    << l << " " << m << " channel " << k;
            }
        }
    }
}

// ---- one texel ---------------------------------------------------------------------------------

class OneTexel : public testing::TestWithParam<test::NamedGrid> {};

TEST_P(OneTexel, IsTheLight) {
    const auto texels = test::texels_of(GetParam().grid);
    std::vector<std::size_t> sites;
    for (const DVec3& w :
         {DVec3{0.3, 0.5, -0.7}, DVec3{0, 1, 0}, DVec3{0, -1, 0}, DVec3{-1, 0.2, 1e-5},
          DVec3{-1, 0.2, -1e-5}, DVec3{1, 1, 1}, DVec3{-1, -1, 0.999}, DVec3{0.4, 1, -1}}) {
        const auto nearer = [&](const Texel& a, const Texel& b) {
            return glm::dot(a.middle(), w) < glm::dot(b.middle(), w);
        };
        sites.push_back(slot(static_cast<int>(
            std::max_element(texels.begin(), texels.end(), nearer) - texels.begin())));
    }
    for (const std::size_t site : sites) {
        const Texel& t = texels[site];
        const double omega = solid_angle_of(t);
        for (const double L : {1e5, 65504.0, 1e30}) {
            auto environment = test::environment(GetParam().grid, [&](const Texel&, std::size_t i) {
                return i == site ? DVec3{L, L / 2, L / 4} : DVec3{0};
            });
            const auto found = find(environment);
            ASSERT_EQ(found.lights.size(), 1u) << "texel " << site;
            const DominantLight& light = found.lights[0];
            EXPECT_NEAR(light.irradiance.r / (omega * static_cast<double>(static_cast<float>(L))),
                        1, 1e-10)
                << L;
            EXPECT_NEAR(light.irradiance.g * 2 / light.irradiance.r, 1, 1e-14);
            EXPECT_NEAR(light.irradiance.b * 4 / light.irradiance.r, 1, 1e-14);
            EXPECT_NEAR(light.solid_angle / omega, 1, 1e-10);
            EXPECT_NEAR(light.share, 1, 1e-12);
            EXPECT_NEAR(found.strongest_share, 1, 1e-12);
            EXPECT_NEAR(found.peak_over_mean * omega / (4 * pi), 1, 1e-10);
            EXPECT_LT(angle(light.direction, t.middle()), light.direction_error);
            EXPECT_LT(light.direction_error, 0.08);
            // Between the disc of the same solid angle and the circle around the texel.
            EXPECT_GT(light.angular_radius, 0.99 * std::sqrt(omega / pi));
            EXPECT_LT(light.angular_radius, angle(t.middle(), t.towards(t.a1, t.b1)) + 0.08);
            if (L < 1e30) expect_conserved(environment, found, 0);
            remove_lights(found, environment);
            for (const Vec3& left : environment.radiance) ASSERT_EQ(left, Vec3(0));
        }
    }
}

INSTANTIATE_TEST_SUITE_P(
    Grids, OneTexel,
    testing::Values(test::NamedGrid{"lat-long", test::lat_long_grid(128, 64)},
                    test::NamedGrid{"uneven lat-long", test::uneven_lat_long_grid(111, 60)},
                    test::NamedGrid{"cube", test::cube_grid(32)},
                    test::NamedGrid{"uneven cube", test::uneven_cube_grid(35)}));

// ---- suns --------------------------------------------------------------------------------------

struct Place {
    test::NamedGrid on;
    DVec3 sun;
    friend std::ostream& operator<<(std::ostream& out, const Place& p) {
        return out << p.on << " towards " << p.sun.x << " " << p.sun.y << " " << p.sun.z;
    }
};
class Sun : public testing::TestWithParam<Place> {};

// Wherever it stands, the same light: closed forms of a sun with a bell's profile.
TEST_P(Sun, IsOneLightWherever) {
    constexpr double kSigma = 1 * kDegree, kPeak = 1e4;
    const double expected = kPeak * 2 * pi * kSigma * kSigma;
    const DVec3 sun = glm::normalize(GetParam().sun);
    const auto environment =
        test::environment(GetParam().on.grid, [&](const Texel& t, std::size_t) {
            return DVec3{0.8, 1, 1.5} + kPeak * lobe(t, sun, kSigma) * DVec3{1, 0.9, 0.7};
        });
    const auto found = find(environment);
    ASSERT_EQ(found.lights.size(), 1u);
    const DominantLight& light = found.lights[0];
    // The fringe below the level is 0.2 % to 0.5 %; texels are up to 2.2 degrees wide.
    EXPECT_NEAR(light.irradiance.r / expected, 1, 0.01);
    EXPECT_NEAR(light.irradiance.g / light.irradiance.r, 0.9, 0.002);
    // A tenth of a texel: what a texel does not say is where within it the light comes from.
    EXPECT_LT(angle(light.direction, sun), 0.2 * kDegree);
    EXPECT_GT(light.direction_error, 0.2 * kDegree);
    // 1 - mean cosine = sigma^2; and the texels' own size.
    EXPECT_GT(light.angular_radius, 1.9 * kDegree);
    EXPECT_LT(light.angular_radius, 2.5 * kDegree);
    EXPECT_NEAR(light.solid_angle, 4 * pi * kSigma * kSigma, 0.3 * 4 * pi * kSigma * kSigma);
    EXPECT_NEAR(light.share, 0.583, 0.01);
    expect_conserved(environment, found, 0.001 * kDegree);

    auto rest = environment;
    remove_lights(found, rest);
    EXPECT_TRUE(find(rest).lights.empty());
    // The texels are what is around them, not black, and not a hole in the sky.
    for (const LightTexels& run : found.texels) {
        EXPECT_GT(rest.radiance[run.first].g, 0.9);
        EXPECT_LT(rest.radiance[run.first].g, 15);
    }
}

std::vector<Place> places() {
    const test::NamedGrid image{"lat-long", test::lat_long_grid(256, 128)};
    const test::NamedGrid uneven{"uneven lat-long", test::uneven_lat_long_grid(256, 128)};
    const test::NamedGrid cube{"cube", test::cube_grid(64)};
    const test::NamedGrid uneven_cube{"uneven cube", test::uneven_cube_grid(63)};
    std::vector<Place> all;
    for (const test::NamedGrid& grid : {image, uneven}) {
        all.push_back({grid, {0.5, 0.6, -0.3}});
        all.push_back({grid, {-1, 0.2, 0}});                           // the seam
        all.push_back({grid, {std::cos(-2.9), 0.1, std::sin(-2.9)}});  // the uneven one's
        all.push_back({grid, {0, 1, 0}});                              // the poles
        all.push_back({grid, {0, -1, 0}});
        all.push_back({grid, {-0.02, 1, 0}});  // pole and seam
    }
    for (const test::NamedGrid& grid : {cube, uneven_cube}) {
        all.push_back({grid, {0.5, 0.6, -0.3}});
        for (const double x : {-1, 0, 1}) {
            for (const double y : {-1, 0, 1}) {
                for (const double z : {-1, 0, 1}) {
                    const bool more_than_a_face = std::abs(x) + std::abs(y) + std::abs(z) > 1;
                    if (more_than_a_face) all.push_back({grid, {x, y, z}});
                }
            }
        }
    }
    return all;
}
INSTANTIATE_TEST_SUITE_P(Places, Sun, testing::ValuesIn(places()));

TEST(DominantLights, HalfADegreeInABrightAureole) {
    const DVec3 sun = glm::normalize(DVec3{-0.4, 0.8, 0.3});
    const auto environment =
        test::environment(test::lat_long_grid(512, 256), [&](const Texel& t, std::size_t) {
            const double away = angle(t.middle(), sun);
            return DVec3{0.5, 0.7, 1} * (1 + 40 * std::exp(-away / (4 * kDegree))) +
                   5e4 * disc(t, sun, 0.265 * kDegree);
        });
    const auto found = find(environment);
    ASSERT_EQ(found.lights.size(), 1u);
    const DominantLight& light = found.lights[0];
    const double expected = 5e4 * pi * std::pow(0.265 * kDegree, 2);
    // The whole aureole has a quarter of the sun's flux; what is bright and small of it comes
    // along.
    EXPECT_GT(light.irradiance.g, expected * 0.99);
    EXPECT_LT(light.irradiance.g, expected * 1.1);
    EXPECT_LT(angle(light.direction, sun), 0.1 * kDegree);
    EXPECT_LT(light.angular_radius, 1.2 * kDegree);  // a texel is 0.7 degrees wide
    EXPECT_LT(light.solid_angle, pi * std::pow(0.7 * kDegree, 2));
    expect_conserved(environment, found, 0.05 * kDegree);
}

TEST(DominantLights, TwoSunsStrongestFirst) {
    const DVec3 weak = glm::normalize(DVec3{1, 0.3, 0.2}), strong{0, 0, -1};
    const auto environment = test::environment(test::cube_grid(128), [&](const Texel& t,
                                                                         std::size_t) {
        return DVec3(0.2 + 2e3 * disc(t, weak, 1 * kDegree) + 5e3 * disc(t, strong, 1 * kDegree));
    });
    const auto found = find(environment);
    ASSERT_EQ(found.lights.size(), 2u);
    EXPECT_LT(angle(found.lights[0].direction, strong), 0.1 * kDegree);
    EXPECT_LT(angle(found.lights[1].direction, weak), 0.1 * kDegree);
    EXPECT_NEAR(found.lights[1].share / found.lights[0].share, 0.4, 0.02);
    EXPECT_EQ(found.strongest_share, found.lights[0].share);
    EXPECT_NEAR(found.lights[0].irradiance.r / found.lights[0].irradiance.b, 1, 1e-14);  // grey
    expect_conserved(environment, found, 0);
}

TEST(DominantLights, ARedLampUnderABlueSkyIsRed) {
    const DVec3 lamp = glm::normalize(DVec3{0.2, 0.5, 0.4});
    const auto environment =
        test::environment(test::lat_long_grid(256, 128), [&](const Texel& t, std::size_t) {
            return angle(t.middle(), lamp) < 2 * kDegree ? DVec3{4e3, 0.1, 0} : DVec3{0.1, 0.2, 2};
        });
    const auto found = find(environment);
    ASSERT_EQ(found.lights.size(), 1u);
    EXPECT_GT(found.lights[0].irradiance.r, 10);
    EXPECT_EQ(found.lights[0].irradiance.g, 0);
    EXPECT_EQ(found.lights[0].irradiance.b, 0);
    auto rest = environment;
    remove_lights(found, rest);
    EXPECT_EQ(radiance_towards(rest, lamp), Vec3(0.1f, 0.1f, 0));
    expect_conserved(environment, found, 0);
}

TEST(DominantLights, NeighboursAreOneLight) {
    // None of three lamps is dominant by itself; together, within 3 degrees, they are.
    const DVec3 lamps[] = {glm::normalize(DVec3{1, 0, 0}), glm::normalize(DVec3{1, 0.06, 0}),
                           glm::normalize(DVec3{1, 0, 0.06})};
    const double each = 0.025 * 4 * pi / 0.925 / (pi * std::pow(0.8 * kDegree, 2));
    const auto environment =
        test::environment(test::lat_long_grid(512, 256), [&](const Texel& t, std::size_t) {
            double L = 1;
            for (const DVec3& lamp : lamps) L += each * disc(t, lamp, 0.8 * kDegree);
            L += 0.3 * each * disc(t, lamps[0], 0.8 * kDegree);  // the one in the middle leads
            return DVec3(L);
        });
    const auto found = find(environment);
    ASSERT_EQ(found.lights.size(), 1u);
    EXPECT_NEAR(found.lights[0].share, 0.082, 0.005);
    const DVec3 middle = glm::normalize(1.3 * lamps[0] + lamps[1] + lamps[2]);
    EXPECT_LT(angle(found.lights[0].direction, middle), 0.1 * kDegree);
    expect_conserved(environment, found, 0);
}

// ---- what is none ------------------------------------------------------------------------------

TEST(DominantLights, SmallIsUnderTheRadius) {
    const DVec3 centre = glm::normalize(DVec3{0.3, 0.4, 0.9});
    for (const double degrees : {2.0, 4.0, 4.8, 5.3, 6.0, 12.0, 30.0}) {
        const auto environment =
            test::environment(test::lat_long_grid(512, 256), [&](const Texel& t, std::size_t) {
                return DVec3(0.1 + 300 * disc(t, centre, degrees * kDegree));
            });
        const auto found = find(environment);
        if (degrees > 5) {
            EXPECT_TRUE(found.lights.empty()) << degrees;
            EXPECT_EQ(found.strongest_share, 0) << degrees;
            EXPECT_GT(found.peak_over_mean, 1);
            continue;
        }
        ASSERT_EQ(found.lights.size(), 1u) << degrees;
        const DominantLight& light = found.lights[0];
        const double omega = 2 * pi * (1 - std::cos(degrees * kDegree));
        EXPECT_NEAR(light.solid_angle / omega, 1, 0.3 / degrees);  // texels partly covered
        EXPECT_NEAR(light.irradiance.g / (300 * omega), 1, 0.02);
        EXPECT_NEAR(light.angular_radius, degrees * kDegree, 0.1 * kDegree);
        EXPECT_LT(angle(light.direction, centre), 0.05 * kDegree);
    }
}

TEST(DominantLights, DominantIsOverTheShare) {
    const DVec3 lamp = glm::normalize(DVec3{0.3, -0.4, 0.9});
    for (const double share : {0.001, 0.03, 0.047, 0.053, 0.2}) {
        const double omega = 2 * pi * (1 - std::cos(1 * kDegree));
        const double L = share / (1 - share) * 4 * pi / omega;
        const auto environment =
            test::environment(test::cube_grid(128), [&](const Texel& t, std::size_t) {
                return DVec3{1, 1, 1} + L * disc(t, lamp, 1 * kDegree);
            });
        const auto found = find(environment);
        EXPECT_EQ(found.lights.size(), share > 0.05 ? 1u : 0u) << share;
        if (share < 0.002) {
            EXPECT_EQ(found.strongest_share, 0);
        } else {
            EXPECT_NEAR(found.strongest_share / share, 1, 0.03) << share;
        }
    }
}

TEST(DominantLights, ALampIsTakenAndTheGlowAroundItIsNot) {
    const DVec3 lamp = glm::normalize(DVec3{1, 0.4, 0.9});
    const auto environment =
        test::environment(test::lat_long_grid(256, 128), [&](const Texel& t, std::size_t) {
            return DVec3(0.1 + 8 * disc(t, lamp, 25 * kDegree) + 1000 * disc(t, lamp, 2 * kDegree));
        });
    const auto found = find(environment);
    ASSERT_EQ(found.lights.size(), 1u);
    EXPECT_NEAR(found.lights[0].angular_radius, 2 * kDegree, 0.4 * kDegree);  // texels: 1.4
    auto rest = environment;
    remove_lights(found, rest);
    EXPECT_NEAR(radiance_towards(rest, lamp).g, 8.1, 0.01);
}

// What stands out of the top of a glow of 13 degrees (between half maxima) is small, and an eighth
// of it; but the glow goes on around it.
TEST(DominantLights, TheTopOfAGlowIsNotDistinct) {
    for (const double sigma : {5.5, 8.0, 15.0}) {
        const DVec3 middle = glm::normalize(DVec3{1, 0.4, 0.9});
        const auto environment =
            test::environment(test::lat_long_grid(256, 128), [&](const Texel& t, std::size_t) {
                return DVec3(0.01 + 50 * lobe(t, middle, sigma * kDegree));
            });
        EXPECT_TRUE(find(environment).lights.empty()) << sigma;
    }
}

TEST(DominantLights, ALampIsTakenAndALongStreakIsNot) {
    const DVec3 lamp{1, 0, 0};
    const auto environment =
        test::environment(test::lat_long_grid(512, 256), [&](const Texel& t, std::size_t) {
            const DVec3 w = t.middle();
            const bool streak = w.x > 0 && std::abs(w.y) < 0.008 && std::abs(w.z) < 0.25;
            return DVec3(1 + (streak ? 15 : 0) + 5e3 * disc(t, lamp, 1 * kDegree));
        });
    const auto found = find(environment);
    ASSERT_EQ(found.lights.size(), 1u);
    EXPECT_LT(found.lights[0].angular_radius, 1.3 * kDegree);
    auto rest = environment;
    remove_lights(found, rest);
    for (const double z : {-0.22, -0.1, 0.1, 0.22}) {
        EXPECT_EQ(radiance_towards(rest, glm::normalize(DVec3{1, 0.001, z})), Vec3(16));
    }
    EXPECT_LT(radiance_towards(rest, lamp).r, 17);
}

TEST(DominantLights, NoneInMapsWithoutSmallSources) {
    const auto none = [](const char* name, const Environment& environment) {
        const auto found = find(environment);
        EXPECT_TRUE(found.lights.empty()) << name;
        EXPECT_TRUE(found.texels.empty()) << name;
        EXPECT_EQ(found.strongest_share, 0) << name;
        EXPECT_TRUE(std::isfinite(found.peak_over_mean)) << name;
        auto rest = environment;
        remove_lights(found, rest);
        EXPECT_EQ(rest.radiance, environment.radiance) << name;
    };
    const auto constant = [](double L) {
        return [=](const Texel&, std::size_t) { return DVec3(L); };
    };
    const auto noise = [](const Texel&, std::size_t i) {
        return DVec3(RandomStream(5, 6, i).next());
    };
    const auto board = [](const Texel&, std::size_t i) {
        return DVec3((i / 64 + i) % 2 == 0 ? 1e4 : 1e-4);
    };
    const auto last = [](const Texel& t, std::size_t) { return DVec3(t.a1 > 3.1 ? 1e30 : 0); };
    const auto sky = [](const Texel& t, std::size_t) { return DVec3(1.2 + t.middle().y); };
    none("black", test::environment(test::lat_long_grid(64, 32), constant(0)));
    none("black cube", test::environment(test::cube_grid(16), constant(0)));
    none("constant", test::environment(test::lat_long_grid(64, 32), constant(7)));
    none("constant cube", test::environment(test::uneven_cube_grid(16), constant(1e30)));
    none("noise", test::environment(test::lat_long_grid(256, 128), noise));
    none("noise cube", test::environment(test::cube_grid(64), noise));
    none("checkerboard", test::environment(test::lat_long_grid(64, 32), board));
    none("checkerboard cube", test::environment(test::cube_grid(64), board));
    none("sky", test::environment(test::lat_long_grid(128, 64), sky));
    none("1 x 1", test::environment(test::lat_long_grid(1, 1), constant(1e5)));
    none("3 x 5", test::environment(test::lat_long_grid(3, 5), noise));
    none("3 x 5, lowest row", test::environment(test::lat_long_grid(3, 5), last));
    none("4096 x 2", test::environment(test::lat_long_grid(4096, 2), noise));
    none("4096 x 2, one bright",
         test::environment(test::lat_long_grid(4096, 2), [](const Texel&, std::size_t i) {
             return DVec3(i == 5000 ? 1e30 : 0);
         }));
    none("six texels", test::environment(test::cube_grid(1), noise));
}

// ---- and besides -------------------------------------------------------------------------------

class Threads : public testing::TestWithParam<test::NamedGrid> {};

TEST_P(Threads, AnyNumberGivesTheSameBytes) {
    const DVec3 sun = glm::normalize(DVec3{0.5, 0.6, -0.3});
    const auto environment = test::environment(GetParam().grid, [&](const Texel& t, std::size_t i) {
        return DVec3(RandomStream(1, 2, i).next()) + DVec3{9e3, 8e3, 6e3} * disc(t, sun, kDegree);
    });
    const auto found = [&](int threads) {
        const ThreadLimit limit(threads);
        return find(environment);
    };
    const auto one = found(1), four = found(4);
    ASSERT_EQ(one.lights.size(), 1u);
    ASSERT_EQ(four.lights.size(), 1u);
    EXPECT_EQ(std::memcmp(one.lights.data(), four.lights.data(), sizeof(DominantLight)), 0);
    EXPECT_EQ(one.peak_over_mean, four.peak_over_mean);
    ASSERT_EQ(one.texels.size(), four.texels.size());
    for (std::size_t i = 0; i < one.texels.size(); ++i) {
        EXPECT_EQ(one.texels[i].first, four.texels[i].first);
        EXPECT_EQ(one.texels[i].count, four.texels[i].count);
        EXPECT_EQ(one.texels[i].surroundings, four.texels[i].surroundings);
    }
}
INSTANTIATE_TEST_SUITE_P(Grids, Threads,
                         testing::Values(test::NamedGrid{"lat-long", test::lat_long_grid(512, 256)},
                                         test::NamedGrid{"cube", test::cube_grid(128)}));

struct Photograph {
    const char* file;
    int lights;
    double least_share, most_share;  ///< of the strongest small source
    friend std::ostream& operator<<(std::ostream& out, const Photograph& p) {
        return out << p.file;
    }
};
class DominantLightsOf : public testing::TestWithParam<Photograph> {};

// Judged by eye: a sun; a bare lamp beside an umbrella of 45 degrees; stars, and lamps behind the
// horizon; a room with a window; a roofed yard; an overcast sky.
TEST_P(DominantLightsOf, Photographs) {
    const std::string file = std::string("environments/") + GetParam().file;
    ENVBAKE_REQUIRE_DATA(file.c_str());
    const auto environment = read_environment(test::data(file.c_str()));
    ASSERT_TRUE(environment) << environment.error();
    const auto found = find(*environment);
    ASSERT_EQ(static_cast<int>(found.lights.size()), GetParam().lights);
    EXPECT_GE(found.strongest_share, GetParam().least_share);
    EXPECT_LE(found.strongest_share, GetParam().most_share);
    // Where the colours of a light lie apart is not in its one direction.
    expect_conserved(*environment, found, 0.05 * kDegree);
    if (found.lights.empty()) return;

    const auto texels = test::texels_of(environment->grid);
    std::size_t brightest = 0;
    for (std::size_t i = 0; i < texels.size(); ++i) {
        if (environment->radiance[i].g > environment->radiance[brightest].g) brightest = i;
    }
    const DominantLight& light = found.lights[0];
    EXPECT_LT(angle(light.direction, texels[brightest].middle()), light.angular_radius);
    EXPECT_LT(light.angular_radius, 5 * kDegree);
    EXPECT_EQ(light.solid_angle > 1e-3, light.angular_radius > 1 * kDegree);
}

INSTANTIATE_TEST_SUITE_P(Maps, DominantLightsOf,
                         testing::Values(Photograph{"kloppenheim_05_1k.hdr", 1, 0.6, 0.7},
                                         Photograph{"studio_small_03_1k.hdr", 1, 0.68, 0.75},
                                         Photograph{"dikhololo_night_1k.hdr", 0, 0, 0.01},
                                         Photograph{"lebombo_1k.hdr", 0, 0, 0.01},
                                         Photograph{"courtyard_1k.exr", 0, 0, 0.02},
                                         Photograph{"potsdamer_platz_1k.hdr", 0, 0, 0}));

}  // namespace
}  // namespace envbake
