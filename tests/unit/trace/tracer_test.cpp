// SPDX-License-Identifier: Apache-2.0
#include "baker/trace/tracer.h"

#include "baker/core/parallel.h"
#include "baker/input/sample_texture.h"
#include "baker/trace/half_space_tree.h"
#include "baker/trace/occluders.h"
#include "tests/unit/trace/shapes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
#include <random>

namespace envbake {
namespace {

Tracer build(const Scene& scene) {
    auto tracer = Tracer::build(scene);
    EXPECT_TRUE(tracer) << tracer.error();
    return std::move(tracer).value();
}

/// Every triangle in turn, in double. Source: [MollerTrumbore97].
struct BruteHit {
    double distance = std::numeric_limits<double>::infinity();
    std::size_t triangle = 0;
    double margin = 0;  ///< how far inside the triangle, barycentric
};
std::optional<BruteHit> brute_closest(const Mesh& mesh, const DVec3& o, const DVec3& d,
                                      double& nearest_miss) {
    std::optional<BruteHit> best;
    nearest_miss = 1;
    for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
        const Triangle t = triangle_of(mesh, i);
        const DVec3 e1 = DVec3(t.b) - DVec3(t.a), e2 = DVec3(t.c) - DVec3(t.a);
        const DVec3 p = glm::cross(d, e2), s = o - DVec3(t.a);
        const double det = glm::dot(e1, p);
        const double u = glm::dot(s, p) / det;
        const DVec3 q = glm::cross(s, e1);
        const double v = glm::dot(d, q) / det, distance = glm::dot(e2, q) / det;
        const double margin = std::min({u, v, 1 - u - v});
        if (distance <= 0) continue;
        if (margin < 0) {
            nearest_miss = std::min(nearest_miss, -margin);
            continue;
        }
        if (!best || distance < best->distance) best = BruteHit{distance, i, margin};
    }
    return best;
}

std::vector<DVec3> random_directions(int count, unsigned seed) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    std::vector<DVec3> directions;
    for (int i = 0; i < count; ++i) {
        const double x = normal(random), y = normal(random);
        directions.push_back(glm::normalize(DVec3(x, y, normal(random))));
    }
    return directions;
}

TEST(Tracer, AgreesWithEveryTriangleTestedInDouble) {
    const Scene scene = test::scene_of({test::triangle_soup(400, 0.15f, 1)});
    const Tracer tracer = build(scene);
    std::mt19937 random(2);
    std::uniform_real_distribution<double> uniform(-1, 1);
    int hits = 0, misses = 0;
    for (const DVec3& d : random_directions(4000, 3)) {
        const double x = uniform(random), y = uniform(random);
        const DVec3 o(Vec3(DVec3(x, y, uniform(random))));
        double nearest_miss = 0;
        const auto truth = brute_closest(scene.meshes[0], o, d, nearest_miss);
        // Within a float's reach of an edge either answer is right.
        if (nearest_miss < 1e-4 || (truth && truth->margin < 1e-4)) continue;
        const auto hit = tracer.closest(o, d);
        ASSERT_EQ(hit.has_value(), truth.has_value());
        ASSERT_EQ(tracer.occluded(o, d), truth.has_value());
        ++(truth ? hits : misses);
        if (!truth) continue;
        EXPECT_EQ(hit->triangle, truth->triangle);
        EXPECT_NEAR(hit->distance, truth->distance, 1e-5 + 1e-4 * truth->distance);
        const DVec3 normal = glm::normalize(triangle_of(scene.meshes[0], truth->triangle).cross());
        EXPECT_GT(glm::dot(normal, DVec3(hit->geometric_normal)), 1 - 1e-6);
        const Triangle t = triangle_of(scene.meshes[0], truth->triangle);
        const DVec3 at = DVec3(t.a) * double(1 - hit->u - hit->v) + DVec3(t.b) * double(hit->u) +
                         DVec3(t.c) * double(hit->v);
        EXPECT_LT(glm::distance(at, o + d * truth->distance), 1e-4);
    }
    EXPECT_GT(hits, 1000);
    EXPECT_GT(misses, 500);
}

TEST(Tracer, PacketsSayWhatSingleRaysSay) {
    const Scene scene = test::scene_of({test::triangle_soup(400, 0.15f, 4)});
    const Tracer tracer = build(scene);
    const std::vector<DVec3> directions = random_directions(16 * 64, 5);
    int blocked = 0;
    for (std::size_t p = 0; p < 64; ++p) {
        DirectionPacket packet;
        for (std::size_t i = 0; i < 16; ++i) {
            const Vec3 d = directions[16 * p + i];
            packet.x[i] = d.x;
            packet.y[i] = d.y;
            packet.z[i] = d.z;
        }
        const std::uint32_t active = p % 2 == 0 ? 0xffff : 0xa5c3;
        const std::uint32_t mask = tracer.occluded16(DVec3(0), packet, active);
        EXPECT_EQ(mask & ~active, 0u);
        for (std::size_t i = 0; i < 16; ++i) {
            if ((active >> i & 1) == 0) continue;
            const bool single = tracer.occluded(DVec3(0), Vec3(directions[16 * p + i]));
            EXPECT_EQ((mask >> i & 1) != 0, single);
            blocked += single;
        }
    }
    EXPECT_GT(blocked, 100);
    EXPECT_LT(blocked, 700);
}

/// A closed room of many triangles: a ray that finds a seam would leave.
TEST(Tracer, LosesNoRayBetweenTriangles) {
    const Scene scene = test::scene_of({test::skewed(test::box({-1, -1, -1}, {1, 2, 3}, 16, -1))});
    const Tracer tracer = build(scene);
    int escaped = 0;
    for (const DVec3& d : random_directions(100000, 6))
        escaped += !tracer.occluded(DVec3(0.1, 0.2, 0.3), d);
    // And straight at the seams. (At a corner exactly, where the sides of all its triangles are
    // decided by rounding alone, some rays do get through: no random ray comes that near.)
    const Mesh& room = scene.meshes[0];
    for (std::size_t i = 0; i < room.triangles.size(); ++i) {
        const std::size_t next = i % 3 == 2 ? i - 2 : i + 1;
        const DVec3 a = room.positions[room.triangles[i]], b = room.positions[room.triangles[next]];
        for (const double t : {0.1, 0.5, 0.7})
            escaped +=
                !tracer.occluded(DVec3(0.1, 0.2, 0.3), a + (b - a) * t - DVec3(0.1, 0.2, 0.3));
    }
    EXPECT_EQ(escaped, 0);
}

TEST(Tracer, DistancesAreInWorldUnitsAndInUnitsOfTheDirection) {
    for (const float scale : {1e-6f, 1.0f, 3e6f}) {
        const Scene scene = test::scene_of(
            {test::moved(test::quad({-1, -1, 2}, {2, 0, 0}, {0, 2, 0}), scale, Vec3(0))});
        const auto hit = build(scene).closest(DVec3(0), DVec3(0, 0, 0.5));
        ASSERT_TRUE(hit);
        EXPECT_NEAR(hit->distance / scale, 4, 1e-6);
        EXPECT_EQ(hit->geometric_normal, Vec3(0, 0, 1));
    }
}

/// 1e5 from the origin floats are 8e-3 apart; the tracer's own space keeps the gap of 2e-3 open.
TEST(Tracer, TracesFarFromTheOriginAsAtHome) {
    const Vec3 offset(100000, 0, 0);
    const Scene scene =
        test::scene_of({test::moved(test::quad({0, -1, -1}, {0, 2, 0}, {0, 0, 2}), 1, offset),
                        test::moved(test::quad({1, -1, -1}, {0, 2, 0}, {0, 0, 2}), 1, offset)});
    const Tracer tracer = build(scene);
    EXPECT_TRUE(tracer.occluded(DVec3(offset) - DVec3(0.002, 0, 0), DVec3(1, 0, 0)));
    EXPECT_EQ(tracer.closest(DVec3(offset) + DVec3(0.002, 0, 0), DVec3(1, 0, 0))->mesh, 1u);
    EXPECT_NEAR(tracer.closest(DVec3(offset) + DVec3(0.002, 0, 0), DVec3(1, 0, 0))->distance, 0.998,
                1e-6);
}

TEST(Tracer, BlendedTrianglesAreSeenButThrowNoShadow) {
    Scene scene = test::scene_of({test::quad({-1, -1, 1}, {2, 0, 0}, {0, 2, 0})});
    scene.materials[0].alpha_mode = AlphaMode::Blend;
    const Tracer tracer = build(scene);
    EXPECT_FALSE(tracer.occluded(DVec3(0), DVec3(0, 0, 1)));
    EXPECT_TRUE(tracer.closest(DVec3(0), DVec3(0, 0, 1)));
}

/// The left half of the texture is clear, the right half is solid.
Scene masked_scene() {
    Mesh mesh = test::quad({-1, -1, 1}, {2, 0, 0}, {0, 2, 0});
    mesh.uv0 = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    Scene scene = test::scene_of({mesh, test::quad({-3, -3, 3}, {6, 0, 0}, {0, 6, 0})});
    scene.materials.resize(2);
    scene.meshes[1].material = 1;
    Image image{.name = "half", .width = 8, .height = 8, .rgba = {}};
    for (int row = 0; row < 8; ++row)
        for (int column = 0; column < 8; ++column)
            image.rgba.insert(image.rgba.end(),
                              {255, 255, 255, static_cast<std::uint8_t>(column < 4 ? 0 : 255)});
    scene.images.push_back(image);
    scene.materials[0].alpha_mode = AlphaMode::Mask;
    scene.materials[0].base_color_texture = Texture{};
    return scene;
}

TEST(Tracer, RaysGoThroughTheHolesOfAMask) {
    const Scene scene = masked_scene();
    const Tracer tracer = build(scene);
    EXPECT_EQ(tracer.closest(DVec3(0), DVec3(-0.5, 0.1, 1))->mesh, 1u);
    EXPECT_EQ(tracer.closest(DVec3(0), DVec3(0.5, 0.1, 1))->mesh, 0u);
    const DVec3 beyond(0, 0, 2);  // looking back at the mask alone
    EXPECT_FALSE(tracer.occluded(beyond, DVec3(-0.5, 0.1, -1)));
    EXPECT_TRUE(tracer.occluded(beyond, DVec3(0.5, 0.1, -1)));
    DirectionPacket packet;
    for (std::size_t i = 0; i < 16; ++i) {
        packet.x[i] = (static_cast<float>(i) - 7.5f) / 10;
        packet.y[i] = 0.1f;
        packet.z[i] = -1;
    }
    EXPECT_EQ(tracer.occluded16(beyond, packet), 0xff00u);
}

/// As if it were not there for light, holes included for those who look.
TEST(Tracer, WhatIsMarkedAsCastingNothingIsOnlySeen) {
    Scene scene = masked_scene();
    scene.meshes[0].casts = false;
    const Tracer tracer = build(scene);
    const DVec3 beyond(0, 0, 2);
    for (const double x : {-0.5, 0.5}) {
        EXPECT_FALSE(tracer.occluded(beyond, DVec3(x, 0.1, -1)));
        EXPECT_TRUE(tracer.occluded(DVec3(0), DVec3(x, 0.1, 1)));  // by the wall behind it
    }
    EXPECT_EQ(tracer.closest(DVec3(0), DVec3(-0.5, 0.1, 1))->mesh, 1u);
    EXPECT_EQ(tracer.closest(DVec3(0), DVec3(0.5, 0.1, 1))->mesh, 0u);
    EXPECT_FALSE(tracer.half_spaces().any_above(DVec3(0, 0, 4), DVec3(0, 0, 1)));
    EXPECT_FALSE(tracer.half_spaces().any_above(DVec3(0, 0, 0.5), DVec3(0, 0, -1)));
}

/// Every triangle in turn, and the texture at every hit, whatever was decided beforehand.
TEST(Tracer, MasksAgreeWithEveryHitLookedUp) {
    Mesh mesh = test::triangle_soup(300, 0.3f, 21);
    std::mt19937 random(22);
    std::uniform_real_distribution<float> uniform(-1, 1);
    for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
        const float u = uniform(random);
        mesh.uv0.push_back({u, uniform(random)});
        mesh.uv0.back() *= v / 3 % 3 == 0 ? 1.5f : 0.2f;
    }
    Scene scene = masked_scene();
    scene.meshes = {mesh};
    int gone = 0, there = 0;
    const Tracer tracer = build(scene);
    for (const DVec3& d : random_directions(3000, 23)) {
        const Vec3 from(uniform(random), uniform(random), uniform(random));
        double nearest = std::numeric_limits<double>::infinity();
        bool clear_cut = true;  // of every triangle that is met or nearly so
        for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
            Mesh alone = mesh;
            alone.triangles.assign(mesh.triangles.begin() + static_cast<std::ptrdiff_t>(3 * i),
                                   mesh.triangles.begin() + static_cast<std::ptrdiff_t>(3 * i + 3));
            double nearest_miss = 0;
            const auto hit = brute_closest(alone, from, d, nearest_miss);
            if (nearest_miss < 1e-4 || (hit && hit->margin < 1e-4)) clear_cut = false;
            if (!hit) continue;
            const Triangle t = triangle_of(mesh, i);
            const DVec3 p = DVec3(from) + d * hit->distance, cross = t.cross();
            const auto weight = [&](const Vec3& a, const Vec3& b) {
                return static_cast<float>(
                    glm::dot(glm::cross(DVec3(b) - DVec3(a), p - DVec3(a)), cross) /
                    glm::dot(cross, cross));
            };
            const Vec3 weights(weight(t.b, t.c), weight(t.c, t.a), weight(t.a, t.b));
            const float alpha = surface_material(scene, mesh, i, weights).alpha;
            if (std::abs(alpha - 0.5f) < 1e-3f) clear_cut = false;
            ++(alpha < 0.5f ? gone : there);
            if (alpha >= 0.5f) nearest = std::min(nearest, hit->distance);
        }
        if (!clear_cut) continue;
        EXPECT_EQ(tracer.occluded(from, d), std::isfinite(nearest));
        const auto hit = tracer.closest(from, d);
        ASSERT_EQ(hit.has_value(), std::isfinite(nearest));
        if (hit) {
            EXPECT_NEAR(hit->distance, nearest, 1e-5 + 1e-4 * nearest);
        }
    }
    EXPECT_GT(gone, 1000);
    EXPECT_GT(there, 1000);
}

/// A wall that viewers see from its front alone blocks from its back, too.
TEST(Tracer, BothFacesBlock) {
    for (const bool double_sided : {false, true}) {
        Scene scene = test::scene_of({test::quad({-1, -1, 0}, {2, 0, 0}, {0, 2, 0})});
        scene.materials[0].double_sided = double_sided;
        const Tracer tracer = build(scene);
        for (const double side : {-1.0, 1.0}) {
            EXPECT_TRUE(tracer.occluded(DVec3(0.1, 0.2, side), DVec3(0, 0, -side)));
            EXPECT_EQ(tracer.closest(DVec3(0.1, 0.2, side), DVec3(0, 0, -side))->geometric_normal,
                      Vec3(0, 0, 1));
        }
    }
}

TEST(Tracer, AMaskWithoutTextureIsAllOrNothing) {
    Scene scene = test::scene_of({test::quad({-1, -1, 1}, {2, 0, 0}, {0, 2, 0})});
    scene.materials[0].alpha_mode = AlphaMode::Mask;
    scene.materials[0].alpha = 0.4f;
    EXPECT_FALSE(build(scene).closest(DVec3(0), DVec3(0, 0, 1)));
    scene.materials[0].alpha = 0.5f;
    EXPECT_TRUE(build(scene).occluded(DVec3(0), DVec3(0, 0, 1)));
}

TEST(Tracer, TrianglesWithoutAreaAreLeftOutAndTheOthersKeepTheirNumber) {
    Mesh mesh = test::quad({-1, -1, 1}, {2, 0, 0}, {0, 2, 0});
    mesh.triangles.insert(mesh.triangles.begin(), {0, 0, 1, 2, 1, 2});
    const Tracer tracer = build(test::scene_of({mesh}));
    EXPECT_EQ(tracer.closest(DVec3(0), DVec3(0.5, -0.2, 1))->triangle, 2u);
    EXPECT_EQ(tracer.closest(DVec3(0), DVec3(-0.5, 0.2, 1))->triangle, 3u);
}

TEST(Tracer, NamesTheVertexThatIsNotFinite) {
    Scene scene = test::scene_of({Mesh{}, test::quad({-1, -1, 1}, {2, 0, 0}, {0, 2, 0})});
    for (const float bad :
         {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
        scene.meshes[1].positions[2].y = bad;
        const auto tracer = Tracer::build(scene);
        ASSERT_FALSE(tracer);
        EXPECT_EQ(tracer.error().code, Errc::InvalidInput);
        EXPECT_NE(tracer.error().message.find("mesh/1: vertex 2"), std::string::npos)
            << tracer.error();
    }
    scene.meshes[1].positions[2].y = 1;
    scene.meshes[1].triangles[4] = 4;
    const auto tracer = Tracer::build(scene);
    ASSERT_FALSE(tracer);
    EXPECT_EQ(tracer.error().code, Errc::InvalidInput);
}

TEST(Tracer, ASceneWithoutTrianglesIsOpenSky) {
    EXPECT_FALSE(build(test::scene_of({})).occluded(DVec3(0), DVec3(0, 0, 1)));
    EXPECT_FALSE(build(test::scene_of({Mesh{}})).closest(DVec3(0), DVec3(0, 0, 1)));
}

/// Beyond 1.8e19 Embree drops what it is given; here it is given the scene at the scale of 1.
TEST(Tracer, SizesAtTheEndsOfTheFloatRangeAreTraced) {
    for (const float scale : {1e-30f, 1e30f}) {
        const Scene scene =
            test::scene_of({test::moved(test::sphere({0, 0, 0}, 1, 2), scale, Vec3(0))});
        const Tracer tracer = build(scene);
        for (const DVec3& d : random_directions(100, 7)) EXPECT_TRUE(tracer.occluded(DVec3(0), d));
    }
}

TEST(Tracer, TheSameHitsWhateverTheNumberOfThreads) {
    const Scene scene =
        test::scene_of({test::sphere({0, 0, 0}, 1, 4), test::triangle_soup(20000, 0.05f, 8)});
    const auto run = [&](int threads) {
        const ThreadLimit limit(threads);
        const Tracer tracer = build(scene);
        std::vector<std::uint32_t> hits;
        for (const DVec3& d : random_directions(20000, 9)) {
            const auto hit = tracer.closest(DVec3(0, 0, 0.1), d);
            hits.insert(hits.end(),
                        {hit->mesh, hit->triangle, std::bit_cast<std::uint32_t>(hit->distance)});
        }
        return hits;
    };
    EXPECT_EQ(run(1), run(2));
}

/// p - c must be exact for every p, or two vertices could fall together.
TEST(TraceSpace, MovesAndScalesWithoutLosingABit) {
    std::mt19937 random(10);
    for (const double base : {1e5, -3e7, 2.0}) {
        std::uniform_real_distribution<double> uniform(std::abs(base), 2 * std::abs(base));
        Mesh mesh;
        for (std::uint32_t i = 0; i < 3000; ++i) {
            const double sign = base < 0 ? -1 : 1;
            const double x = sign * uniform(random), y = sign * uniform(random);
            mesh.positions.push_back(Vec3(DVec3(x, y, 1e-3 * uniform(random))));
            mesh.triangles.push_back(i);
        }
        mesh.normals.assign(3000, Vec3(0, 0, 1));
        const TraceSpace space(test::scene_of({mesh}));
        const DVec3 first = mesh.positions[0];
        double largest = 0;
        for (const Vec3& p : mesh.positions) {
            const DVec3 moved = DVec3(space.to_local(p)) - DVec3(space.to_local(first));
            EXPECT_EQ(moved, (DVec3(p) - first) * space.scale());
            for (int axis = 0; axis < 3; ++axis)
                largest = std::max(largest, std::abs(double{space.to_local(p)[axis]}));
        }
        EXPECT_GE(largest, 0.5);
        EXPECT_LE(largest, 2);
    }
}

}  // namespace
}  // namespace envbake
