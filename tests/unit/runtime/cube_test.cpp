// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/cube.h"

#include "envbake/runtime/lat_long.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>

namespace envbake {
namespace {

using cube::Face;
using std::numbers::pi;
using Direction = std::array<double, 3>;

void expect_equal(const Direction& a, const Direction& b, double tolerance) {
    for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(a[i], b[i], tolerance) << "component " << i;
}

/// The table of the OpenGL specification, section "Cube Map Texture Selection": sc, tc and ma.
Direction from_specification(Face face, double sc, double tc) {
    switch (face) {
        case Face::PositiveX:
            return {1, -tc, -sc};  // sc = -rz, tc = -ry
        case Face::NegativeX:
            return {-1, -tc, sc};  // sc = +rz, tc = -ry
        case Face::PositiveY:
            return {sc, 1, tc};  // sc = +rx, tc = +rz
        case Face::NegativeY:
            return {sc, -1, -tc};  // sc = +rx, tc = -rz
        case Face::PositiveZ:
            return {sc, -tc, 1};  // sc = +rx, tc = -ry
        case Face::NegativeZ:
            return {-sc, -tc, -1};  // sc = -rx, tc = -ry
    }
    return {};
}

TEST(Cube, FacesFollowOpenGl) {
    for (int f = 0; f < cube::kFaceCount; ++f) {
        const auto face = static_cast<Face>(f);
        expect_equal(cube::point(face, 0.25, -0.75), from_specification(face, 0.25, -0.75), 0);
    }
    // In words: looking along +X in a right-handed world with +Y up, the image's right is -Z.
    expect_equal(cube::direction(Face::PositiveX, 1.0, 0.0), {std::sqrt(0.5), 0, -std::sqrt(0.5)},
                 1e-15);
    EXPECT_GT(cube::direction(Face::PositiveZ, 0.0, -0.5)[1], 0);  // v = -1 is the upper edge
}

TEST(Cube, ProjectionInvertsDirection) {
    for (int f = 0; f < cube::kFaceCount; ++f) {
        const auto face = static_cast<Face>(f);
        for (const double u : {-0.99, -0.3, 0.0, 0.7}) {
            for (const double v : {-0.9, 0.1, 0.99}) {
                const auto p = cube::project(cube::direction(face, u, v));
                EXPECT_EQ(p.face, face);
                EXPECT_NEAR(p.u, u, 1e-15);
                EXPECT_NEAR(p.v, v, 1e-15);
            }
        }
    }
}

TEST(Cube, SolidAnglesCoverTheSphere) {  // row B1
    double sum = 0;
    for (int row = 0; row < 16; ++row) {
        for (int column = 0; column < 16; ++column) {
            sum += 6 * cube::texel_solid_angle(row, column, 16);
        }
    }
    EXPECT_NEAR(sum, 12.5663706144, 1e-10);
    EXPECT_NEAR(sum, 4 * pi, 1e-13);
    EXPECT_NEAR(cube::texel_solid_angle(0, 0, 1), 4 * pi / 6, 1e-14);
}

TEST(Cube, SolidAngleOfSmallTexels) {  // rows B1b and B1c
    const double centre = cube::texel_solid_angle(128, 128, 256);
    const double corner = cube::texel_solid_angle(0, 0, 256);
    EXPECT_NEAR(centre / 6.1031431225e-05, 1, 1e-10);
    EXPECT_NEAR(corner / 1.18384482489e-05, 1, 1e-10);
    // 1 / (3 sqrt 3) in the limit; for 2^20 texels the texel at the corner is 2^-20 away from it.
    EXPECT_NEAR(
        cube::texel_solid_angle(0, 0, 1 << 20) / cube::texel_solid_angle(1 << 19, 1 << 19, 1 << 20),
        0.19245008973, 1e-6);
}

TEST(Cube, SolidAngleOfRectangles) {
    // Against the difference of four corner terms atan2(u v, sqrt(1 + u^2 + v^2)).
    const auto corner = [](double u, double v) {
        return std::atan2(u * v, std::sqrt(1 + u * u + v * v));
    };
    const double u0 = -0.3, u1 = 0.8, v0 = 0.1, v1 = 0.25;
    EXPECT_NEAR(cube::solid_angle(u0, u1, v0, v1),
                corner(u1, v1) - corner(u0, v1) - corner(u1, v0) + corner(u0, v0), 1e-15);
    // A rectangle of 1e-9: the density at its middle times its area.
    const double density = std::pow(1 + 0.25 + 0.04, -1.5);
    EXPECT_NEAR(cube::solid_angle(0.5, 0.5 + 1e-9, -0.2, -0.2 + 1e-9) / (density * 1e-18), 1, 1e-6);
}

TEST(LatLong, LandmarksOfTheImage) {
    expect_equal(lat_long::direction(0.5, 0.5), {1, 0, 0}, 1e-15);   // the centre looks along +X
    expect_equal(lat_long::direction(0.25, 0.0), {0, 1, 0}, 1e-15);  // the first row is +Y
    expect_equal(lat_long::direction(0.75, 0.5), {0, 0, 1}, 1e-15);  // right of the centre is +Z
    expect_equal(lat_long::direction(0.0, 0.5), {-1, 0, 0}, 1e-15);
}

TEST(LatLong, ProjectionInvertsDirection) {
    for (const double u : {0.01, 0.2, 0.5, 0.99}) {
        for (const double v : {1e-9, 0.1, 0.5, 0.93}) {
            const auto p = lat_long::project(lat_long::direction(u, v));
            EXPECT_NEAR(p.u, u, 1e-14);
            EXPECT_NEAR(p.v / v, 1, 1e-14);
        }
    }
    EXPECT_EQ(lat_long::project(Direction{0, 1, 0}).v, 0);
}

}  // namespace
}  // namespace envbake
