// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/ray_origin.h"
#include "baker/transport/ray_set.h"
#include "baker/transport/visible_transport.h"
#include "envbake/runtime/sh.h"
#include "tests/unit/trace/shapes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

/// Transport against exact answers. Every T here is what the formula gives, divided by pi.
namespace envbake {
namespace {

using std::numbers::pi;

/// Mean over `turns` turns of one set at a vertex of mesh 0: what is left is the bias, and noise
/// below 1e-4.
std::vector<double> transport_at(const Scene& scene, std::uint32_t vertex, int bands = 5,
                                 int turns = 128) {
    const auto tracer = Tracer::build(scene);
    EXPECT_TRUE(tracer) << tracer.error();
    const SurfacePoints points(scene.meshes[0]);
    const RayOrigin origin = points.origin(points.representative(vertex), tracer->space());
    const RaySet set = make_ray_set(2048, bands);
    std::vector<float> row(static_cast<std::size_t>(bands * bands));
    std::vector<double> mean(row.size(), 0);
    for (int i = 0; i < turns; ++i) {
        visible_transport(set, *tracer, origin, 2 * pi * i / turns, row);
        for (std::size_t c = 0; c < row.size(); ++c) mean[c] += double{row[c]} / turns;
    }
    return mean;
}
double at(const std::vector<double>& t, int l, int m) {
    return t[static_cast<std::size_t>(sh::index(l, m))];
}
/// Share of a constant sky that arrives: T_00 / Y_00.
double sky_fraction(const std::vector<double>& t) {
    return t[0] * std::sqrt(4 * pi);
}

constexpr double kTolerance = 2e-4;

/// A unit square of floor at z = 0 whose vertex 0 is the origin.
Mesh floor_at_origin() {
    Mesh mesh = test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
    return mesh;
}

/// The wall fills x < 0: V = 1 for x > 0. The vertex stands exactly at its foot.
TEST(ClosedForms, FloorAtTheFootOfAWall) {
    const Scene scene =
        test::scene_of({floor_at_origin(), test::quad({0, -1e4f, -1}, {0, 2e4f, 0}, {0, 0, 1e4f})});
    const auto t = transport_at(scene, 0);
    EXPECT_NEAR(at(t, 0, 0), 0.443113462726 / pi, kTolerance);
    EXPECT_NEAR(at(t, 1, -1), 0, kTolerance);
    EXPECT_NEAR(at(t, 1, 0), 0.511663353973 / pi, kTolerance);
    EXPECT_NEAR(at(t, 1, 1), 0.325735007935 / pi, kTolerance);
    EXPECT_NEAR(at(t, 2, 0), std::sqrt(5 / (16 * pi)) / 4, kTolerance);
    EXPECT_NEAR(at(t, 2, 1), std::sqrt(15 / (4 * pi)) / 8, kTolerance);
    EXPECT_NEAR(at(t, 2, 2), 0, kTolerance);
}

/// Two planes that meet at an angle: the same share of sky from everywhere, the edge included.
TEST(ClosedForms, Wedge) {
    for (const double angle_deg : {20.0, 60.0, 90.0, 135.0}) {
        const double angle = angle_deg * pi / 180;
        const Vec3 up(DVec3(1e5 * std::cos(angle), 0, 1e5 * std::sin(angle)));
        const Scene scene =
            test::scene_of({floor_at_origin(), test::quad({0, -1e5f, 0}, {0, 2e5f, 0}, up)});
        for (const std::uint32_t vertex : {0u, 1u})
            EXPECT_NEAR(sky_fraction(transport_at(scene, vertex)), (1 - std::cos(angle)) / 2,
                        2 * kTolerance)
                << angle_deg << " degrees, vertex " << vertex;
    }
}

/// A unit sphere straight above blocks the cap sin a = 1 / d, rotationally symmetric:
/// 1/pi * integral over the cap of cos Y_l0, by the antiderivatives in c = cos a.
TEST(ClosedForms, SphereOverhead) {
    for (const double d : {1.5, 2.0, 4.0}) {
        // The facets lie inside the sphere; on average at this radius it is seen as large.
        const Mesh ball = test::sphere({0, 0, static_cast<float>(d)}, 1.00012f, 5);
        const auto t = transport_at(test::scene_of({floor_at_origin(), ball}), 0);
        const double c2 = 1 - 1 / (d * d);  // the sky is left where cos^2 < c2
        const double c3 = std::pow(c2, 1.5);
        EXPECT_NEAR(at(t, 0, 0), c2 * std::sqrt(1 / (4 * pi)), kTolerance);
        EXPECT_NEAR(at(t, 1, 0), 2 * c3 / 3 * std::sqrt(3 / (4 * pi)), kTolerance);
        EXPECT_NEAR(at(t, 2, 0), (3 * c2 * c2 / 4 - c2 / 2) * 2 * std::sqrt(5 / (16 * pi)),
                    kTolerance);
    }
    // The tabulated values, from the same integrals done elsewhere.
    const double c2 = 1 - 1 / (1.5 * 1.5);
    EXPECT_NEAR(c2 * std::sqrt(1 / (4 * pi)), 0.492348291918 / pi, 1e-12);
    EXPECT_NEAR((3 * c2 * c2 / 4 - c2 / 2) * 2 * std::sqrt(5 / (16 * pi)), -0.0917436874446 / pi,
                1e-12);
}

/// A sphere of half-angle 20 degrees at zenith angle 50: what it blocks of the cosine and of the
/// vector w (w.n).
TEST(ClosedForms, SphereAslant) {
    const double zenith = 50 * pi / 180, half_angle = 20 * pi / 180, distance = 3;
    const Vec3 centre(DVec3(std::sin(zenith), 0, std::cos(zenith)) * distance);
    const auto radius = static_cast<float>(distance * std::sin(half_angle) * 1.00012);
    const auto t =
        transport_at(test::scene_of({floor_at_origin(), test::sphere(centre, radius, 5)}), 0);
    EXPECT_NEAR(pi * (1 - sky_fraction(t)), 0.23622221569, 5e-4);
    const double y1 = std::sqrt(3 / (4 * pi));
    EXPECT_NEAR(2 * pi / 3 - pi * at(t, 1, 0) / y1, 0.153879818619, 5e-4);
    EXPECT_NEAR(-pi * at(t, 1, 1) / y1, 0.170043690397, 5e-4);
    EXPECT_NEAR(at(t, 1, -1), 0, kTolerance);
}

/// Lambert's polygon formula for the rectangle [-.5, .7] x [-.3, .6] at z = 1.
TEST(ClosedForms, RectangleOverhead) {
    const Scene scene = test::scene_of(
        {floor_at_origin(), test::quad({-0.5f, -0.3f, 1}, {0, 0.9f, 0}, {1.2f, 0, 0})});
    EXPECT_NEAR(pi * (1 - sky_fraction(transport_at(scene, 0))), 0.761142602683, 1e-3);
}

/// From everywhere in a hemispherical bowl half the sky is seen.
TEST(ClosedForms, Bowl) {
    constexpr int kRings = 45, kSectors = 180;
    const Scene scene = test::scene_of({test::bowl(kRings, kSectors)});
    for (const int ring : {0, 20, 40}) {
        const auto vertex = static_cast<std::uint32_t>(ring == 0 ? 0 : 1 + (ring - 1) * kSectors);
        // The rim is a polygon inside the circle: 2e-4 of the opening; the facets are flat.
        EXPECT_NEAR(sky_fraction(transport_at(scene, vertex)), 0.5, 1e-3) << "ring " << ring;
    }
    const auto pole = transport_at(scene, 0);
    EXPECT_NEAR(at(pole, 0, 0), 0.443113462726 / pi, kTolerance);
    EXPECT_NEAR(at(pole, 1, 0), 0.661526080667 / pi, kTolerance);
    EXPECT_NEAR(at(pole, 2, 0), 0.619269890251 / pi, kTolerance);
}

/// The centre of a plate under a parallel coaxial unit disc at height 1 sees half the sky.
TEST(ClosedForms, PlateUnderADisc) {
    const Scene scene = test::scene_of({floor_at_origin(), test::disc(1, 1, 400)});
    EXPECT_NEAR(sky_fraction(transport_at(scene, 0)), 0.5, 5e-4);
}

/// Ten bands: the same cap, against the integral of cos Y_l0 by a fine midpoint rule in double.
TEST(ClosedForms, TenBandsUnderASphere) {
    const double d = 2;
    const auto t = transport_at(
        test::scene_of({floor_at_origin(), test::sphere({0, 0, 2}, 1.00012f, 5)}), 0, 10);
    const double top = std::sqrt(1 - 1 / (d * d));
    constexpr int kSteps = 20000;
    for (int l = 0; l < 10; ++l) {
        double integral = 0;
        for (int i = 0; i < kSteps; ++i) {
            const double z = top * (i + 0.5) / kSteps;
            integral += 2 * z * std::sqrt((2 * l + 1) / (4 * pi)) *
                        std::legendre(static_cast<unsigned>(l), z) * top / kSteps;
        }
        EXPECT_NEAR(at(t, l, 0), integral, 3e-4) << "degree " << l;
    }
}

/// A closed room with a block inside, everything emitting Le = 1 with albedo 1/2: from any point
/// all one sees is surface, so the radiosity over pi is Le / (1 - rho) = 2 everywhere. Gathered
/// from triangle to triangle along traced rays; one that escapes, or meets what is not there,
/// shows.
TEST(ClosedForms, EmissionInAClosedRoom) {
    const Scene scene = test::scene_of({test::skewed(test::box({-1, -1, -1}, {2, 3, 5}, 3, -1)),
                                        test::skewed(test::box({0, 0, 1}, {0.5f, 1, 2}, 2, 1))});
    const auto tracer = Tracer::build(scene);
    ASSERT_TRUE(tracer) << tracer.error();
    constexpr int kRays = 64, kBounces = 24;
    std::vector<std::size_t> first_of_mesh;
    std::vector<std::size_t> seen;  // [triangle, ray]: the triangle that the ray meets
    std::size_t triangle_count = 0;
    for (const Mesh& mesh : scene.meshes) {
        first_of_mesh.push_back(triangle_count);
        triangle_count += mesh.triangle_count();
    }
    for (const Mesh& mesh : scene.meshes) {
        for (std::size_t t = 0; t < mesh.triangle_count(); ++t) {
            const auto corner = [&](std::size_t k) {
                return DVec3(mesh.positions[mesh.triangles[3 * t + k]]);
            };
            const DVec3 edge = glm::normalize(corner(1) - corner(0));
            const DVec3 n = glm::normalize(glm::cross(edge, corner(2) - corner(0)));
            const DVec3 origin = (corner(0) + corner(1) + corner(2)) / 3.0 + 1e-5 * n;
            for (int i = 0; i < kRays; ++i) {  // cosine-weighted, a Fibonacci spiral
                const double r = std::sqrt((i + 0.5) / kRays), phi = i * pi * (3 - std::sqrt(5.0));
                const DVec3 w = r * std::cos(phi) * edge + r * std::sin(phi) * glm::cross(n, edge) +
                                std::sqrt(1 - r * r) * n;
                const auto hit = tracer->closest(origin, Vec3(w));
                ASSERT_TRUE(hit) << "a ray left the room";
                seen.push_back(first_of_mesh[hit->mesh] + hit->triangle);
            }
        }
    }
    std::vector<double> radiosity(triangle_count, 1);  // over pi
    for (int bounce = 0; bounce < kBounces; ++bounce) {
        std::vector<double> next(triangle_count, 1);
        for (std::size_t i = 0; i < seen.size(); ++i)
            next[i / kRays] += 0.5 * radiosity[seen[i]] / kRays;
        radiosity = std::move(next);
    }
    for (const double b : radiosity) EXPECT_NEAR(b, 2, 2 * std::pow(0.5, kBounces));
}

}  // namespace
}  // namespace envbake
