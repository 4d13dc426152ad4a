// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/interreflection.h"

#include "baker/core/parallel.h"
#include "baker/input/read_scene.h"
#include "baker/math/frame.h"
#include "baker/transport/diffuse.h"
#include "baker/transport/ray_origin.h"
#include "envbake/runtime/sh.h"
#include "tests/support/test_data.h"
#include "tests/unit/trace/shapes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

/// Light between surfaces against exact answers; ANALYTIC values are divided by pi, as T is.
namespace envbake {
namespace {

using std::numbers::pi;
const double kY00 = 1 / std::sqrt(4 * pi);

struct Lit {
    std::vector<MeshTransport> direct, transport;
    BounceReport report;
    std::size_t coeffs = 25, channels = 3;

    double at(std::size_t vertex, std::size_t coeff, std::size_t channel = 0,
              std::size_t mesh = 0) const {
        return transport[mesh].rows[(vertex * coeffs + coeff) * channels + channel];
    }
    /// Exit radiance of a white vertex under a sky of 1.
    double sky(std::size_t vertex, std::size_t channel = 0, std::size_t mesh = 0) const {
        return at(vertex, 0, channel, mesh) / kY00;
    }
    double direct_at(std::size_t vertex, std::size_t coeff, std::size_t mesh = 0) const {
        return direct[mesh].rows[(vertex * coeffs + coeff) * channels];
    }
};

Lit light(const Scene& scene, BounceJob job, double direct_tolerance = 2e-3) {
    Lit lit;
    lit.coeffs = static_cast<std::size_t>(job.bands * job.bands);
    lit.channels = static_cast<std::size_t>(job.channels);
    const auto tracer = Tracer::build(scene);
    EXPECT_TRUE(tracer) << tracer.error();
    Progress progress;
    std::vector<BlockedRays> blocked(scene.meshes.size());
    for (std::size_t m = 0; m < scene.meshes.size(); ++m) {
        MeshTransport mesh;
        const auto sink = [&](std::span<const float> rows) -> Expected<void> {
            for (const float value : rows) mesh.rows.insert(mesh.rows.end(), lit.channels, value);
            return {};
        };
        EXPECT_TRUE(bake_diffuse({.bands = job.bands, .tolerance = direct_tolerance}, scene, m,
                                 *tracer, sink, progress, &blocked[m]));
        if (job.emission) mesh.emitted.assign(3 * scene.meshes[m].vertex_count(), 0);
        lit.direct.push_back(std::move(mesh));
    }
    lit.transport = lit.direct;
    lit.report = add_bounces(job, scene, *tracer, blocked, lit.transport, progress);
    EXPECT_EQ(progress.done(), progress.total());
    return lit;
}

Scene with_albedo(Scene scene, const Vec3& albedo) {
    for (Material& material : scene.materials) {
        material.base_color = albedo;
        material.metallic = 0;
    }
    return scene;
}

/// A room without a ceiling, and a block that hangs in it.
Scene open_room() {
    Mesh room = test::grid({-2, -2, 0}, {4, 0, 0}, {0, 4, 0}, 12);
    test::append(room, test::grid({-2, -2, 0}, {0, 4, 0}, {0, 0, 3}, 9));
    test::append(room, test::grid({2, -2, 0}, {0, 0, 3}, {0, 4, 0}, 9));
    test::append(room, test::grid({-2, -2, 0}, {0, 0, 3}, {4, 0, 0}, 9));
    test::append(room, test::grid({-2, 2, 0}, {4, 0, 0}, {0, 0, 3}, 9));
    Mesh block = test::box({-0.5f, -0.6f, 0.4f}, {0.6f, 0.4f, 1.2f}, 5, 1);
    return test::scene_of({room, block});
}

/// From any point of a sphere every other one has the same form factor: under a constant sky a bowl
/// that is the share f = 1/2 of a sphere has (1 - f) / (1 - rho f) everywhere, and bounce k of any
/// coefficient is (rho / 2)^k / 2 of the clamped cosine about the axis. Rows E8, E9.
TEST(Interreflection, Bowl) {
    const Mesh bowl = test::bowl(32, 96);
    const std::size_t rim = bowl.vertex_count() - 96;
    for (const double rho : {0.5, 0.9}) {
        const Scene scene =
            with_albedo(test::scene_of({bowl}), Vec3(static_cast<float>(rho), 0.25f, 0));
        const Lit lit = light(scene, {.tolerance = 2e-3});
        double worst = 0;
        for (std::size_t v = 0; v < rim; ++v) {
            worst = std::max(worst, std::abs(lit.sky(v) - 0.5 / (1 - rho / 2)));
            worst = std::max(worst, std::abs(lit.sky(v, 1) - 0.5 / (1 - 0.125)));
            // Black surfaces add nothing, to the bit.
            for (std::size_t i = 0; i < 25; ++i)
                ASSERT_EQ(lit.at(v, i, 2), lit.direct_at(v, i)) << v;
        }
        EXPECT_LT(worst, 6e-3) << rho;  // of the direct part, and that 96 sectors are no circle
        const Lit once = light(scene, {.bounces = 1, .tolerance = 2e-3});
        EXPECT_EQ(once.report.bounces, 1);
        const double exact[3] = {0.443113462726 / pi, 0.511663353973 / pi, 0.2477079561 / pi};
        const std::size_t coeffs[3] = {0, 2, 6};
        for (int k = 0; k < 3; ++k) {
            double mean = 0;
            for (std::size_t v = 0; v < rim; ++v)
                mean += (once.at(v, coeffs[k]) - once.direct_at(v, coeffs[k])) /
                        static_cast<double>(rim);
            EXPECT_NEAR(mean, rho / 2 * exact[k], 1e-3 * rho) << "coefficient " << coeffs[k];
        }
    }
}

/// Lambert's formula for a polygon above the plane z = 0, seen from 0.
double lambert(const std::vector<DVec3>& polygon) {
    double sum = 0;
    for (std::size_t i = 0; i < polygon.size(); ++i) {
        const DVec3 a = glm::normalize(polygon[i]),
                    b = glm::normalize(polygon[(i + 1) % polygon.size()]);
        sum += std::acos(glm::dot(a, b)) * glm::normalize(glm::cross(a, b)).z;
    }
    return std::abs(sum) / (2 * pi);
}

/// A lamp of 2 x 2 cm two metres above a floor, which one ray in 10^5 meets; whole, half behind a
/// plate, and from behind.
TEST(Interreflection, ASmallLampIsNotMissed) {
    const auto lamp_at = [](float x, float width) {
        return std::vector<DVec3>{
            {x, -0.01, 2}, {x, 0.01, 2}, {x + width, 0.01, 2}, {x + width, -0.01, 2}};
    };
    const auto lit = [](std::vector<Mesh> meshes, bool double_sided) {
        Scene scene = with_albedo(test::scene_of(std::move(meshes)), Vec3(0));
        Material lamp;
        lamp.emission = {100, 50, 0};
        lamp.double_sided = double_sided;
        scene.materials.push_back(lamp);
        scene.meshes[1].material = 1;
        return light(scene, {.emission = true}).transport[0].emitted;
    };
    const Mesh floor = test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
    const Mesh facing = test::quad({-0.01f, -0.01f, 2}, {0, 0.02f, 0}, {0.02f, 0, 0});
    const Mesh turned = test::quad({-0.01f, -0.01f, 2}, {0.02f, 0, 0}, {0, 0.02f, 0});
    const double whole = 100 * lambert(lamp_at(-0.01f, 0.02f));
    std::vector<float> emitted = lit({floor, facing}, false);
    EXPECT_NEAR(emitted[0], whole, 2e-4 * whole);
    EXPECT_NEAR(emitted[1], whole / 2, 1e-4 * whole);
    EXPECT_EQ(emitted[2], 0);
    EXPECT_EQ(lit({floor, turned}, false)[0], 0);
    EXPECT_NEAR(lit({floor, turned}, true)[0], whole, 2e-4 * whole);

    // The plate hides x > 0 from the floor's corner at 0.
    const Mesh plate = test::quad({0, -1, 1}, {0, 2, 0}, {2, 0, 0});
    emitted = lit({floor, facing, plate}, false);
    EXPECT_NEAR(emitted[0], whole / 2, 0.03 * whole);
}

/// Row E11: what a disc that shines with 1 sends to another of its size is the form factor of the
/// two, as a lamp of few triangles and, of many, by the rays of the hemisphere. So is the blocked
/// share of the other's sky.
TEST(Interreflection, CoaxialDiscs) {
    constexpr int kReceivers = 64;  // each stands for as much of the lower disc's area
    Mesh receivers;
    for (int k = 0; k < kReceivers; ++k) {
        const double r = std::sqrt((k + 0.5) / kReceivers), phi = 2.4 * k;
        const Vec3 at(DVec3(r * std::cos(phi), r * std::sin(phi), 0));
        for (const Vec3& offset : {Vec3(0), Vec3(1e-3f, 0, 0), Vec3(0, 1e-3f, 0)}) {
            receivers.triangles.push_back(static_cast<std::uint32_t>(receivers.positions.size()));
            receivers.positions.push_back(at + offset);
            receivers.normals.push_back({0, 0, 1});
        }
    }
    for (const auto& [gap, form_factor] :
         {std::pair{0.5f, 0.609611796798}, {1.0f, 0.38196601125}, {2.0f, 0.171572875254}}) {
        for (const int sectors : {60, 400}) {
            Scene scene =
                with_albedo(test::scene_of({receivers, test::disc(1, gap, sectors)}), Vec3(0));
            Material shining;
            shining.emission = Vec3(1);
            scene.materials.push_back(shining);
            scene.meshes[1].material = 1;
            const Lit lit = light(scene, {.channels = 1, .emission = true});
            double sent = 0, blocked = 0;
            for (std::size_t k = 0; k < kReceivers; ++k) {
                sent += double{lit.transport[0].emitted[9 * k]} / kReceivers;
                blocked += (1 - lit.sky(3 * k)) / kReceivers;
            }
            // A polygon has the area of its circle times sin(x) / x.
            const double x = 2 * pi / sectors, expected = form_factor * std::sin(x) / x;
            EXPECT_NEAR(sent, expected, 2e-3 * expected) << gap << ' ' << sectors;
            EXPECT_NEAR(blocked, expected, 2e-3 * expected) << gap << ' ' << sectors;
        }
    }
}

/// With albedo 1 under a constant sky every vertex from which light escapes ends with 1, partial
/// sums grow, and none is above 1.
TEST(Interreflection, WhiteFurnace) {
    const Scene scene = with_albedo(open_room(), Vec3(1));
    std::vector<Lit> steps;
    for (const int bounces : {1, 2, 5, kAllBounces})
        steps.push_back(light(scene, {.channels = 1, .bounces = bounces, .tolerance = 2e-3}, 1e-2));
    std::size_t counted = 0;
    for (std::size_t m = 0; m < 2; ++m) {
        for (std::size_t v = 0; v < scene.meshes[m].vertex_count(); ++v) {
            double before = steps[0].direct_at(v, 0, m) / kY00;
            ++counted;
            for (const Lit& lit : steps) {
                EXPECT_GE(lit.sky(v, 0, m), before - 1e-5);
                EXPECT_LE(lit.sky(v, 0, m), 1 + 1e-4);
                before = lit.sky(v, 0, m);
            }
            EXPECT_NEAR(before, 1, 1e-4) << "mesh " << m << ", vertex " << v;
        }
    }
    EXPECT_GT(counted, 600u);
    EXPECT_GT(steps.back().report.bounces, 10);
}

/// Row E10: in a closed box that shines with 1 everywhere, 1 / (1 - rho) arrives everywhere. No
/// light of the sky does.
TEST(Interreflection, ClosedBoxThatShines) {
    for (const float rho : {0.0f, 0.5f, 0.9f}) {
        Scene scene =
            with_albedo(test::scene_of({test::box({-1, -2, -3}, {1, 2, 3}, 4, -1)}), Vec3(rho));
        scene.materials[0].emission = Vec3(1, 2, 0);
        for (const int channels : {1, 3}) {
            const Lit lit =
                light(scene, {.channels = channels, .emission = true, .tolerance = 1e-3}, 1e-2);
            for (const float t : lit.transport[0].rows) ASSERT_EQ(t, 0);
            const std::vector<float>& emitted = lit.transport[0].emitted;
            for (std::size_t v = 0; v < emitted.size(); v += 3) {
                const double expected = 1 / (1 - static_cast<double>(rho));
                ASSERT_NEAR(emitted[v], expected, 2e-4 * expected) << v / 3;
                ASSERT_NEAR(emitted[v + 1], 2 * expected, 4e-4 * expected) << v / 3;
                ASSERT_EQ(emitted[v + 2], 0);
            }
        }
    }
}

TEST(Interreflection, ConvexMeshesStayAsTheyAre) {
    const Scene scene = with_albedo(test::scene_of({test::sphere({1, 2, 3}, 2, 3)}), Vec3(0.9f));
    const Lit lit = light(scene, {});
    EXPECT_EQ(lit.transport[0].rows, lit.direct[0].rows);
    EXPECT_EQ(lit.report.point_count, 0u);
}

/// A roof over a floor. What is seen of it is its underside: of a single-sided roof that faces the
/// sky it is the back.
TEST(Interreflection, BacksReflectWhereTheMaterialIsDoubleSided) {
    const Mesh floor = test::grid({-1, -1, 0}, {2, 0, 0}, {0, 2, 0}, 4);
    const Mesh roof = test::grid({-1, -1, 1}, {2, 0, 0}, {0, 2, 0}, 4);
    for (const bool double_sided : {false, true}) {
        Scene scene = with_albedo(test::scene_of({floor, roof}), Vec3(0.5f));
        scene.materials[0].double_sided = double_sided;
        const Lit lit = light(scene, {});
        double gained = 0;
        for (std::size_t v = 0; v < floor.vertex_count(); ++v)
            gained += lit.sky(v) - lit.direct_at(v, 0) / kY00;
        if (double_sided)
            EXPECT_GT(gained / double(floor.vertex_count()), 0.05);
        else
            EXPECT_EQ(gained, 0);
        EXPECT_EQ(lit.report.black_back_count > 0, !double_sided);
    }
}

TEST(Interreflection, OneChannelIsOneOfThree) {
    Scene scene = with_albedo(open_room(), Vec3(0.6f));
    scene.materials[0].emission = Vec3(0.5f);
    const Lit grey = light(scene, {.channels = 1, .emission = true});
    const Lit rgb = light(scene, {.channels = 3, .emission = true});
    for (std::size_t m = 0; m < 2; ++m) {
        EXPECT_EQ(grey.transport[m].emitted, rgb.transport[m].emitted);
        const std::vector<float>& one = grey.transport[m].rows;
        for (std::size_t i = 0; i < one.size(); ++i)
            for (std::size_t c = 0; c < 3; ++c)
                ASSERT_EQ(rgb.transport[m].rows[3 * i + c], one[i]) << i << ' ' << c;
    }
}

TEST(Interreflection, TheSameBytesOnAnyNumberOfThreads) {
    const Scene scene = with_albedo(open_room(), Vec3(0.8f, 0.5f, 0.2f));
    const auto run = [&](int threads) {
        const ThreadLimit limit(threads);
        return light(scene, {});
    };
    const Lit one = run(1), two = run(2);
    for (std::size_t m = 0; m < 2; ++m) EXPECT_EQ(one.transport[m].rows, two.transport[m].rows);
    EXPECT_EQ(one.report.error_rms, two.report.error_rms);
    EXPECT_EQ(one.report.left_out, two.report.left_out);
}

double rms_difference(const Lit& a, const Lit& b) {
    double sum = 0, count = 0;
    for (std::size_t m = 0; m < a.transport.size(); ++m) {
        const std::vector<float>&x = a.transport[m].rows, &y = b.transport[m].rows;
        for (std::size_t i = 0; i < x.size(); ++i)
            sum += std::pow(static_cast<double>(x[i]) - static_cast<double>(y[i]), 2);
        count += static_cast<double>(x.size() / a.coeffs);
    }
    return std::sqrt(sum / count) / unoccluded_norm(5);
}

/// What is left out is bounded, and the bound is not idle.
TEST(Interreflection, LeftOutBouncesAreBounded) {
    const Scene scene = with_albedo(open_room(), Vec3(0.7f));
    const Lit all = light(scene, {.channels = 1, .tolerance = 1e-4, .stride = 4});
    EXPECT_LT(all.report.shrink, 0.7001);
    for (const int bounces : {2, 4, 8}) {
        const Lit some =
            light(scene, {.channels = 1, .bounces = bounces, .tolerance = 1e-4, .stride = 4});
        const double missing = rms_difference(some, all);
        EXPECT_LT(missing, some.report.left_out) << bounces;
        EXPECT_LT(some.report.left_out, 20 * missing) << bounces;
    }
}

/// The stated error of the few rays against many rays.
TEST(Interreflection, TheStatedErrorIsTheTrueOne) {
    const Scene scene = with_albedo(open_room(), Vec3(0.8f, 0.5f, 0.2f));
    const Lit truth = light(scene, {.tolerance = 1e-3, .stride = 1});
    for (const double tolerance : {3e-2, 1e-2, 3e-3}) {
        const Lit lit = light(scene, {.tolerance = tolerance});
        const double error = rms_difference(lit, truth);
        EXPECT_LT(error, 0.55 * tolerance);
        EXPECT_LT(error, 1.1 * (lit.report.error_rms + lit.report.left_out)) << tolerance;
        RecordProperty("true_" + std::to_string(tolerance), std::to_string(error));
        RecordProperty("stated_" + std::to_string(tolerance), std::to_string(lit.report.error_rms));
    }
}

/// Walks from vertex to vertex, a ray at a time, without any of the code above: where a ray ends on
/// a triangle, the walk goes on from one of its corners, by its weight. The expected light is what
/// the vertices of the mesh exchange.
TEST(Interreflection, WalksOnAScan) {
    ENVBAKE_REQUIRE_DATA("meshes/stanford_bunny.glb");
    auto scene = read_scene(test::data("meshes/stanford_bunny.glb"));
    ASSERT_TRUE(scene) << scene.error();
    const double rho = 0.8;
    for (Material& material : scene->materials) {
        material.base_color = Vec3(0.8f);
        material.metallic = 0;
    }
    const Lit lit = light(*scene, {.channels = 1}, 1e-2);
    EXPECT_LT(lit.report.error_rms, 5e-3);

    const Mesh& mesh = scene->meshes[0];
    const auto tracer = Tracer::build(*scene);
    const SurfacePoints points(mesh);
    std::mt19937 random(7);
    std::uniform_real_distribution<double> uniform(0, 1);
    const double sky_gradient = 0.5;  // L = 1 + y / 2
    const auto walk = [&](std::uint32_t vertex, bool bounces) {
        double weight = 1;
        for (;;) {
            const RayOrigin origin = points.origin(points.representative(vertex), tracer->space());
            const double r2 = uniform(random), phi = 2 * pi * uniform(random);
            const DVec3 w = frame_about(origin.normal)
                                .to_world({std::sqrt(r2) * std::cos(phi),
                                           std::sqrt(r2) * std::sin(phi), std::sqrt(1 - r2)});
            const auto hit = tracer->closest(origin.position, w);
            if (!hit) return weight * (1 + sky_gradient * w.y);
            weight *= rho;
            const bool back = glm::dot(DVec3(hit->geometric_normal), w) > 0;
            if (!bounces || (back && !scene->materials[0].double_sided) || weight < 1e-3)
                return 0.0;
            const double pick = uniform(random);
            const double u = static_cast<double>(hit->u), v = static_cast<double>(hit->v);
            const std::size_t corner = pick < u ? 1 : pick < u + v ? 2 : 0;
            vertex = mesh.triangles[3 * std::size_t{hit->triangle} + corner];
        }
    };
    double walked_sum = 0, baked_sum = 0, gained_sum = 0;
    constexpr int kWalks = 10'000;
    for (std::uint32_t vertex = 17; vertex < points.size(); vertex += 1200) {
        if (points.representative(vertex) == SurfacePoints::kNone) continue;
        double sum = 0, square = 0;
        for (int i = 0; i < kWalks; ++i) {
            const double value = walk(vertex, true);
            sum += value;
            square += value * value;
        }
        const double walked = sum / kWalks;
        const double deviation = std::sqrt((square / kWalks - walked * walked) / kWalks);
        // L = 1 has l_00 = 2 sqrt(pi), L = y has l_1-1 = sqrt(4 pi / 3).
        const auto exit_radiance = [&](double t00, double t1) {
            return t00 / kY00 + sky_gradient * t1 * std::sqrt(4 * pi / 3);
        };
        const double baked = exit_radiance(lit.at(vertex, 0), lit.at(vertex, 1));
        EXPECT_NEAR(walked, baked, 4 * deviation + 0.02) << vertex;
        walked_sum += walked;
        baked_sum += baked;
        gained_sum += baked - exit_radiance(lit.direct_at(vertex, 0), lit.direct_at(vertex, 1));
    }
    EXPECT_NEAR(walked_sum / baked_sum, 1, 3e-3);
    EXPECT_GT(gained_sum, 0.05 * baked_sum);
}

}  // namespace
}  // namespace envbake
