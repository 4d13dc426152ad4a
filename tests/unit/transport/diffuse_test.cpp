// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/diffuse.h"

#include "baker/core/parallel.h"
#include "baker/transport/free_vertices.h"
#include "baker/transport/ray_origin.h"
#include "baker/transport/ray_set.h"
#include "baker/transport/visible_transport.h"
#include "envbake/runtime/sh.h"
#include "tests/unit/trace/shapes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

namespace envbake {
namespace {

using std::numbers::pi;

struct Baked {
    DiffuseReport report;
    std::vector<float> rows;
    std::size_t coeffs = 25;
    std::span<const float> row(std::size_t v) const {
        return std::span(rows).subspan(v * coeffs, coeffs);
    }
};

Baked bake(const Scene& scene, const DiffuseJob& job = {}, std::size_t mesh = 0) {
    const auto tracer = Tracer::build(scene);
    EXPECT_TRUE(tracer) << tracer.error();
    Baked baked;
    baked.coeffs = static_cast<std::size_t>(job.bands * job.bands);
    Progress progress;
    const auto report = bake_diffuse(
        job, scene, mesh, *tracer,
        [&](std::span<const float> rows) -> Expected<void> {
            baked.rows.insert(baked.rows.end(), rows.begin(), rows.end());
            return {};
        },
        progress);
    EXPECT_TRUE(report) << report.error();
    baked.report = *report;
    EXPECT_EQ(baked.rows.size(), scene.meshes[mesh].vertex_count() * baked.coeffs);
    EXPECT_EQ(progress.done(), scene.meshes[mesh].vertex_count());
    EXPECT_EQ(report->vertex_count, report->unreferenced_count + report->merged_count +
                                        report->free_count + report->traced_count);
    const auto all = static_cast<std::uint64_t>(report->rays_per_vertex);
    EXPECT_EQ(report->ray_count, (report->traced_count - report->solved_count) * all +
                                     report->solved_count * (all / 64 * 16));
    if (job.rays_per_vertex > 0) {
        EXPECT_EQ(report->solved_count, 0u);
    }
    for (const float t : baked.rows) EXPECT_TRUE(std::isfinite(t));
    return baked;
}

std::vector<float> analytic(const Vec3& normal, int bands = 5) {
    std::vector<double> exact(static_cast<std::size_t>(bands * bands));
    unoccluded_transport(bands, glm::normalize(DVec3(normal)), exact);
    return {exact.begin(), exact.end()};
}
double norm(std::span<const float> row) {
    double sum = 0;
    for (const float t : row) sum += double{t} * double{t};
    return std::sqrt(sum);
}
double distance(std::span<const float> a, std::span<const float> b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += std::pow(double{a[i]} - double{b[i]}, 2);
    return std::sqrt(sum);
}
double relative_distance(std::span<const float> a, std::span<const float> b) {
    return distance(a, b) /
           norm(analytic({0, 0, 1}, static_cast<int>(std::lround(std::sqrt(double(a.size()))))));
}

/// A plane with a ball and a wall on it: a bit of everything.
Scene small_scene() {
    Mesh mesh = test::grid({-2, -2, 0}, {4, 0, 0}, {0, 4, 0}, 20);
    test::append(mesh, test::sphere({0.3f, 0.2f, 0.9f}, 0.7f, 3));
    test::append(mesh, test::quad({-2, 1.5f, 0}, {4, 0, 0}, {0, 0, 1.5f}));
    return test::scene_of({mesh});
}

TEST(Diffuse, UnoccludedTransportIsTheConvolvedCosine) {
    // Against a sum over the sphere: Gauss would be exact, a fine midpoint rule is simpler.
    const DVec3 n = glm::normalize(DVec3(0.3, -0.5, 0.8));
    std::vector<double> sum(25, 0), y(25), exact(25);
    constexpr int kRings = 400;
    for (int i = 0; i < kRings; ++i) {
        const double z = -1 + 2 * (i + 0.5) / kRings, r = std::sqrt(1 - z * z);
        for (int j = 0; j < 2 * kRings; ++j) {
            const double phi = pi * (j + 0.5) / kRings;
            const DVec3 w(r * std::cos(phi), r * std::sin(phi), z);
            sh::evaluate(5, w.x, w.y, w.z, y.data());
            const double weight = std::max(0.0, glm::dot(n, w)) * 2 / kRings * pi / kRings / pi;
            for (std::size_t c = 0; c < 25; ++c) sum[c] += weight * y[c];
        }
    }
    unoccluded_transport(5, n, exact);
    // The rule's error is 4 / kRings^2 at the kink of the cosine: 2.5e-5.
    for (std::size_t c = 0; c < 25; ++c) EXPECT_NEAR(exact[c], sum[c], 2.5e-5) << c;
}

TEST(Diffuse, ConvexMeshesAreAnalyticToTheBitWithoutARay) {
    for (const Mesh& mesh :
         {test::sphere({1, 2, 3}, 2, 4), test::skewed(test::box({-1, -2, -3}, {1, 2, 3}, 8, 1)),
          test::skewed(test::grid({0, 0, 0}, {100, 0, 0}, {0, 100, 0}, 30))}) {
        const Baked baked = bake(test::scene_of({mesh}));
        EXPECT_EQ(baked.report.traced_count, 0u);
        EXPECT_EQ(baked.report.ray_count + baked.report.check_ray_count, 0u);
        EXPECT_EQ(baked.report.error_rms, 0);
        for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
            const auto exact = analytic(mesh.normals[v]);
            ASSERT_TRUE(std::equal(exact.begin(), exact.end(), baked.row(v).begin()));
        }
    }
}

TEST(Diffuse, UnshadowedIsAnalyticEverywhere) {
    const Scene scene = small_scene();
    const Baked baked = bake(scene, {.bands = 7, .shadowed = false});
    EXPECT_EQ(baked.report.ray_count + baked.report.check_ray_count, 0u);
    for (std::size_t v = 0; v < scene.meshes[0].vertex_count(); ++v) {
        const auto exact = analytic(scene.meshes[0].normals[v], 7);
        ASSERT_TRUE(std::equal(exact.begin(), exact.end(), baked.row(v).begin()));
    }
}

/// Seen from inside, no ray of any vertex may find a way out, on any edge, in any corner.
TEST(Diffuse, AClosedRoomIsExactlyBlack) {
    const Mesh room = test::box({-1, -1, -1}, {2, 3, 5}, 8, -1);
    Mesh smooth_corners = test::box({-1, -1, -1}, {2, 3, 5}, 8, -1);
    for (std::size_t v = 0; v < smooth_corners.vertex_count(); ++v)
        smooth_corners.normals[v] = glm::normalize(Vec3(0.5f, 1, 2) - smooth_corners.positions[v]);
    Mesh inside_out = test::sphere({0, 0, 0}, 1, 3);
    for (Vec3& n : inside_out.normals) n = -n;  // wound against its normals
    const Mesh crack = test::skewed(test::box({-1, -1, -1}, {2, 3, -0.997f}, 2, -1));
    Mesh twice = test::skewed(room);  // every wall twice, in the same place, the second reversed
    test::append(twice, test::skewed(room));
    for (std::size_t i = twice.triangles.size() / 2; i < twice.triangles.size(); i += 3)
        std::swap(twice.triangles[i], twice.triangles[i + 1]);
    std::uint64_t rays = 0;
    for (const Mesh& shape :
         {room, test::skewed(room), test::skewed(smooth_corners), inside_out, crack, twice}) {
        for (const float scale : {1e-6f, 1.0f, 1e6f}) {
            for (const float offset : {0.0f, 1000.0f}) {
                const Mesh mesh = test::moved(test::moved(shape, 1, Vec3(offset)), scale, Vec3(0));
                const Baked baked = bake(test::scene_of({mesh}), {.rays_per_vertex = 1024});
                rays += baked.report.ray_count;
                const auto lit = std::count_if(baked.rows.begin(), baked.rows.end(),
                                               [](float t) { return t != 0; });
                EXPECT_EQ(lit, 0) << "scale " << scale << ", offset " << offset;
            }
        }
    }
    EXPECT_GT(rays, 10'000'000u);
}

TEST(Diffuse, OpenVerticesAreExactEvenWhenTheyAreTraced) {
    // The ball rises above the plane's tangent plane, but the far side of a wall hides it.
    const Scene scene = test::scene_of(
        {test::quad({-100, 0, 0}, {1, 0, 0}, {0, 1, 0}), test::sphere({1000, 0, 3}, 0.001f, 1)});
    const Baked baked = bake(scene);
    EXPECT_EQ(baked.report.traced_count, 4u);
    for (std::size_t v = 0; v < 4; ++v) {
        const auto exact = analytic({0, 0, 1});
        EXPECT_TRUE(std::equal(exact.begin(), exact.end(), baked.row(v).begin()));
    }
    EXPECT_GT(baked.report.error_rms, 0);  // what rays may have missed is still stated
}

TEST(Diffuse, TheSameBytesOnAnyNumberOfThreads) {
    const Scene scene = small_scene();
    const auto run = [&](int threads) {
        const ThreadLimit limit(threads);
        return bake(scene, {.tolerance = 2e-2});
    };
    const Baked one = run(1), two = run(2);
    EXPECT_EQ(one.rows, two.rows);
    EXPECT_EQ(one.report.error_rms, two.report.error_rms);
    EXPECT_EQ(one.report.error_p999, two.report.error_p999);
    EXPECT_EQ(one.report.rays_per_vertex, two.report.rays_per_vertex);
    EXPECT_NE(one.rows, bake(scene, {.tolerance = 2e-2, .seed = 1}).rows);
}

/// Sizes are powers of two and places exact: not one bit may change.
TEST(Diffuse, SizeAndPlaceDoNotMatter) {
    const Scene home = small_scene();
    const Baked at_home = bake(home, {.rays_per_vertex = 448});
    for (const float scale : {0x1p-20f, 0x1p20f}) {
        const Scene scaled = test::scene_of({test::moved(home.meshes[0], scale, Vec3(0))});
        EXPECT_EQ(bake(scaled, {.rays_per_vertex = 448}).rows, at_home.rows);
    }
    // Others round the vertices, and another position means another turn of the rays: two
    // independent errors, no more.
    const Baked finely = bake(home, {.rays_per_vertex = 8192});
    const auto far_from_home = [&](float scale, const Vec3& offset) {
        const Scene scene = test::scene_of({test::moved(home.meshes[0], scale, offset)});
        const Baked moved = bake(scene, {.rays_per_vertex = 8192});
        double sum = 0;
        for (std::size_t v = 0; v < home.meshes[0].vertex_count(); ++v)
            sum += std::pow(relative_distance(moved.row(v), finely.row(v)), 2);
        return std::sqrt(sum / static_cast<double>(home.meshes[0].vertex_count()));
    };
    const double two_errors = 2 * finely.report.error_rms;
    EXPECT_LT(two_errors, 6e-3);
    EXPECT_LT(far_from_home(1e-6f, Vec3(0)), two_errors);
    EXPECT_LT(far_from_home(1e6f, Vec3(0)), two_errors);
    // At 1e5 floats are 1/128 apart, a twenty-fifth of an edge of the grid: the shape itself
    // changes by that much.
    EXPECT_LT(far_from_home(1, Vec3(1e5f, -1e5f, 1e5f)), 3e-2);
    EXPECT_LT(far_from_home(100, Vec3(1e5f, -1e5f, 1e5f)), two_errors);
}

/// Of vertices, of triangles, of their corners and of meshes: not one bit may change.
TEST(Diffuse, TheOrderOfTheInputOnlyMovesRows) {
    const Scene scene = small_scene();
    const Mesh& mesh = scene.meshes[0];
    std::vector<std::uint32_t> order(mesh.vertex_count());  // new to old
    for (std::uint32_t v = 0; v < order.size(); ++v) order[v] = v;
    std::shuffle(order.begin(), order.end(), std::mt19937(3));
    Mesh shuffled = mesh;
    std::vector<std::uint32_t> place(order.size());
    for (std::uint32_t v = 0; v < order.size(); ++v) {
        shuffled.positions[v] = mesh.positions[order[v]];
        shuffled.normals[v] = mesh.normals[order[v]];
        place[order[v]] = v;
    }
    for (std::uint32_t& index : shuffled.triangles) index = place[index];
    std::vector<std::size_t> triangles(mesh.triangle_count());
    for (std::size_t i = 0; i < triangles.size(); ++i) triangles[i] = i;
    std::shuffle(triangles.begin(), triangles.end(), std::mt19937(4));
    const std::vector<std::uint32_t> indices = shuffled.triangles;
    for (std::size_t i = 0; i < triangles.size(); ++i)
        for (std::size_t corner = 0; corner < 3; ++corner)
            shuffled.triangles[3 * i + corner] = indices[3 * triangles[i] + (corner + i) % 3];
    const Mesh other = test::quad({-3, -3, 4}, {1, 0, 0}, {0, 1, 0});
    for (const int rays : {0, 1024}) {
        const Baked before = bake(test::scene_of({mesh, other}), {.rays_per_vertex = rays});
        const Baked after = bake(test::scene_of({other, shuffled}), {.rays_per_vertex = rays}, 1);
        EXPECT_EQ(before.report.free_count, after.report.free_count);
        EXPECT_EQ(before.report.ray_count, after.report.ray_count);
        EXPECT_EQ(before.report.error_rms, after.report.error_rms);
        EXPECT_EQ(before.report.error_p999, after.report.error_p999);
        EXPECT_GT(before.report.traced_count, 300u);
        for (std::size_t v = 0; v < order.size(); ++v)
            ASSERT_TRUE(
                std::equal(after.row(v).begin(), after.row(v).end(), before.row(order[v]).begin()))
                << v;
    }
}

/// Most of a cellar's vertices see nothing but its walls, the few under the hatch some sky. Those
/// that are stopped must be exactly black, and the others must be what they are without a stop.
TEST(Diffuse, StopsWhereAPilotSolvesTheVertexAndNowhereElse) {
    Mesh mesh = test::grid({-5, -5, 0}, {10, 0, 0}, {0, 10, 0}, 30);  // the floor
    const std::size_t floor_count = mesh.vertex_count();
    test::append(mesh, test::grid({-5, -5, 2}, {0, 10, 0}, {9.5f, 0, 0}, 8));  // a hatch at x > 4.5
    test::append(mesh, test::quad({-5, -5, 0}, {0, 10, 0}, {0, 0, 2}));
    test::append(mesh, test::quad({5, -5, 0}, {0, 0, 2}, {0, 10, 0}));
    test::append(mesh, test::quad({-5, -5, 0}, {0, 0, 2}, {10, 0, 0}));
    test::append(mesh, test::quad({-5, 5, 0}, {10, 0, 0}, {0, 0, 2}));
    const Scene scene = test::scene_of({mesh});
    const Baked baked = bake(scene, {.tolerance = 5e-3});
    const Baked whole =
        bake(scene, {.tolerance = 5e-3, .rays_per_vertex = baked.report.rays_per_vertex});
    ASSERT_EQ(whole.report.rays_per_vertex, baked.report.rays_per_vertex);
    {
        const ThreadLimit limit(1);
        EXPECT_EQ(bake(scene, {.tolerance = 5e-3}).rows, baked.rows);
    }
    EXPECT_GT(baked.report.solved_count, floor_count / 4);
    EXPECT_LT(baked.report.solved_count, floor_count);
    EXPECT_GT(baked.report.error_rms, 0);
    std::size_t different = 0;
    double sum = 0;
    for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
        const double change = relative_distance(baked.row(v), whole.row(v));
        if (change < 1e-6) continue;  // the same rays in another order
        ++different;
        sum += change * change / double(mesh.vertex_count());
        const auto exact = analytic(mesh.normals[v]);
        const bool open = std::equal(exact.begin(), exact.end(), baked.row(v).begin());
        EXPECT_TRUE(open || norm(baked.row(v)) == 0) << v;
    }
    EXPECT_LE(different, baked.report.solved_count);
    EXPECT_LT(std::sqrt(sum), baked.report.error_rms);
    // Without many solved vertices there is no pilot.
    EXPECT_EQ(bake(test::scene_of({test::bowl(8, 24)})).report.solved_count, 0u);
}

TEST(Diffuse, CopiesAreBakedOnceAndUnseenVerticesNotAtAll) {
    Scene scene = small_scene();
    Mesh& mesh = scene.meshes[0];
    const std::size_t count = mesh.vertex_count();
    const Mesh again = mesh;
    test::append(mesh, again);             // the same surface twice: coplanar double walls, too
    mesh.positions.push_back({0, 0, 50});  // in no triangle
    mesh.normals.push_back({0, 0, 1});
    mesh.normals[7] = mesh.normals[count + 7] = Vec3(0);
    const Baked baked = bake(scene, {.rays_per_vertex = 448});
    const Baked single = bake(small_scene(), {.rays_per_vertex = 448});
    EXPECT_EQ(baked.report.unreferenced_count, 3u);
    EXPECT_EQ(baked.report.merged_count, count - 1 + single.report.merged_count);
    EXPECT_EQ(
        baked.report.ray_count,
        single.report.ray_count - (single.report.traced_count - baked.report.traced_count) * 448);
    for (std::size_t v = 0; v < count; ++v) {
        EXPECT_EQ(distance(baked.row(v), baked.row(count + v)), 0);
        if (v == 7) continue;
        EXPECT_LT(relative_distance(baked.row(v), single.row(v)), 1e-2);
    }
    EXPECT_EQ(norm(baked.row(7)) + norm(baked.row(2 * count)), 0);
}

/// More than one hand-over: a copy may follow its original by any distance.
TEST(Diffuse, CopiesFollowTheirOriginalAcrossHandOvers) {
    const Mesh plane = test::grid({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, 200);  // 40,401 vertices
    Mesh mesh = plane;
    test::append(mesh, plane);
    for (Vec3& n : mesh.normals) n = glm::normalize(Vec3(0.1f, 0.2f, 1));
    const Baked baked = bake(test::scene_of({mesh}), {.bands = 2, .shadowed = false});
    EXPECT_EQ(baked.report.merged_count, plane.vertex_count());
    const auto exact = analytic({0.1f, 0.2f, 1}, 2);
    for (std::size_t v = 0; v < mesh.vertex_count(); ++v)
        ASSERT_LT(distance(baked.row(v), exact), 1e-6) << v;
}

/// Copies whose row found no room are baked again.
TEST(Diffuse, TheBudgetDoesNotChangeABit) {
    Scene scene = small_scene();
    Mesh& mesh = scene.meshes[0];
    const Mesh again = mesh;
    test::append(mesh, again);
    test::append(mesh, again);
    const Baked rich = bake(scene, {.rays_per_vertex = 96});
    const Baked poor = bake(scene, {.rays_per_vertex = 96, .memory_bytes = 30'000});
    const Baked poorest = bake(scene, {.rays_per_vertex = 96, .memory_bytes = 0});
    EXPECT_EQ(rich.rows, poor.rows);
    EXPECT_EQ(rich.rows, poorest.rows);
    EXPECT_EQ(rich.report.ray_count, poorest.report.ray_count);
    EXPECT_EQ(rich.report.repeated_ray_count, 0u);
    EXPECT_GT(poor.report.repeated_ray_count, 0u);
    EXPECT_LT(poor.report.repeated_ray_count, poorest.report.repeated_ray_count);
    EXPECT_LE(poorest.report.repeated_ray_count, 2 * rich.report.ray_count);  // two copies of each
}

TEST(Diffuse, BothSidesOfAThinWallAreToldApart) {
    // A lid 1e-5 above the floor, one unit wide: under it nothing, on it everything.
    Mesh floor = test::grid({-0.5f, -0.5f, 0}, {1, 0, 0}, {0, 1, 0}, 4);
    const Mesh lid = test::grid({-0.5f, -0.5f, 1e-5f}, {1, 0, 0}, {0, 1, 0}, 4);
    const std::size_t count = floor.vertex_count();
    test::append(floor, lid);
    const Baked baked = bake(test::scene_of({floor}));
    const auto exact = analytic({0, 0, 1});
    for (std::size_t v = 0; v < count; ++v) {
        EXPECT_EQ(distance(baked.row(count + v), exact), 0);
        const std::size_t i = v % 5, j = v / 5;
        if (i % 4 == 0 || j % 4 == 0) continue;
        EXPECT_EQ(norm(baked.row(v)), 0);
    }
}

/// A crate stands on the floor: its vertices lie exactly in the floor's plane and the floor's
/// vertices exactly in the crate's walls.
TEST(Diffuse, AVertexOnAnotherSurfaceIsDecidedOnItsOwnSide) {
    Mesh mesh = test::grid({-2, -2, 0}, {4, 0, 0}, {0, 4, 0}, 4);
    const auto first = static_cast<std::uint32_t>(mesh.vertex_count());
    test::append(mesh, test::box({-1, -1, 0}, {1, 1, 2}, 1, 1));
    const Baked baked = bake(test::scene_of({mesh}), {.rays_per_vertex = 4096});
    // Under the crate: the middle of the floor.
    EXPECT_EQ(norm(baked.row(12)), 0);
    for (std::size_t v = first; v < mesh.vertex_count(); ++v) {
        const double sky = double{baked.row(v)[0]} * std::sqrt(4 * pi);
        if (mesh.normals[v].z != 0) continue;
        // A wall's vertex sees the upper half where it stands on the floor (which reaches 1 to 2
        // beyond it), more where it is at the top.
        EXPECT_GT(sky, 0.5 - 1e-3) << v;
        EXPECT_LT(sky, mesh.positions[v].z > 1 ? 1.0 : 0.75) << v;
    }
}

TEST(Diffuse, RaysGoThroughHolesInAMask) {
    Mesh lid = test::quad({-50, -50, 1}, {100, 0, 0}, {0, 100, 0});
    lid.uv0 = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    Scene scene = test::scene_of({test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}), lid});
    scene.materials.resize(2);
    scene.meshes[1].material = 1;
    scene.materials[1].alpha_mode = AlphaMode::Mask;
    scene.materials[1].base_color_texture = Texture{};
    scene.images.push_back({.name = "", .width = 2, .height = 1, .rgba = {}});
    const auto sky = [&](std::uint8_t left, std::uint8_t right) {
        scene.images[0].rgba = {0, 0, 0, left, 0, 0, 0, right};
        return double{bake(scene, {.rays_per_vertex = 1024}).row(0)[0]} * std::sqrt(4 * pi);
    };
    EXPECT_NEAR(sky(0, 0), 1, 1e-6);
    EXPECT_LT(sky(255, 255), 2e-3);  // the horizon beyond the lid: sin^2 of about 1/50
    EXPECT_NEAR(sky(0, 255), 0.5, 2e-2);
}

/// The truth here: four turns of 4,096 rays, another set and other turns than those of the bake.
TEST(Diffuse, MeetsTheToleranceAndDoesNotFlatter) {
    const Scene scene = small_scene();
    const auto tracer = Tracer::build(scene);
    ASSERT_TRUE(tracer) << tracer.error();
    const SurfacePoints points(scene.meshes[0]);
    for (const int bands : {3, 5, 10}) {
        const auto coeffs = static_cast<std::size_t>(bands * bands);
        const RaySet set = make_ray_set(4096, bands);
        std::vector<float> truth(points.size() * coeffs, 0), row(coeffs);
        for (std::uint32_t v = 0; v < points.size(); ++v) {
            const std::uint32_t place = points.representative(v);
            const RayOrigin origin = points.origin(place, tracer->space());
            for (int turn = 0; turn < 4; ++turn) {
                visible_transport(set, *tracer, origin, v + turn * pi / 2, row);
                for (std::size_t c = 0; c < coeffs; ++c) truth[v * coeffs + c] += row[c] / 4;
            }
        }
        for (const double tolerance : {3e-2, 1e-2}) {
            const Baked baked = bake(scene, {.bands = bands, .tolerance = tolerance});
            std::vector<double> errors;
            double sum = 0;
            for (std::size_t v = 0; v < points.size(); ++v) {
                errors.push_back(
                    relative_distance(baked.row(v), std::span(truth).subspan(v * coeffs, coeffs)));
                sum += errors.back() * errors.back();
            }
            const double rms = std::sqrt(sum / double(errors.size()));
            std::sort(errors.begin(), errors.end());
            const double p999 = errors[static_cast<std::size_t>(0.999 * double(errors.size()))];
            EXPECT_LT(rms, tolerance) << bands << " bands";
            EXPECT_GT(baked.report.error_rms, rms / 1.1) << bands << " bands, " << tolerance;
            EXPECT_LT(baked.report.error_rms, 1.5 * rms) << bands << " bands, " << tolerance;
            EXPECT_GT(baked.report.error_p999, p999 / 1.3) << bands << " bands, " << tolerance;
        }
    }
}

TEST(Diffuse, ExpectedRaysFollowToleranceAndBands) {
    EXPECT_EQ(expected_rays_per_vertex({.rays_per_vertex = 77}), 77);
    const int five = expected_rays_per_vertex({.bands = 5, .tolerance = 1e-2});
    EXPECT_GT(five, 300);
    EXPECT_LT(five, 700);
    EXPECT_GT(expected_rays_per_vertex({.bands = 5, .tolerance = 1e-3}), 8 * five);
    EXPECT_GT(expected_rays_per_vertex({.bands = 10, .tolerance = 1e-2}), five);
    EXPECT_LE(expected_rays_per_vertex({.bands = 5, .tolerance = 1e-9}), 1 << 18);
}

TEST(Diffuse, RefusesWhatMakesNoSense) {
    const Scene scene = small_scene();
    const auto tracer = Tracer::build(scene);
    ASSERT_TRUE(tracer) << tracer.error();
    Progress progress;
    const auto sink = [](std::span<const float>) -> Expected<void> { return {}; };
    for (const DiffuseJob& job :
         {DiffuseJob{.bands = 0}, DiffuseJob{.bands = 11}, DiffuseJob{.tolerance = 0},
          DiffuseJob{.tolerance = std::nan("")}, DiffuseJob{.rays_per_vertex = -1}}) {
        const auto report = bake_diffuse(job, scene, 0, *tracer, sink, progress);
        ASSERT_FALSE(report);
        EXPECT_EQ(report.error().code, Errc::Usage);
    }
    const auto full = [](std::span<const float>) -> Expected<void> {
        return Error{Errc::Failed, "disk full"};
    };
    const auto report = bake_diffuse({.shadowed = false}, scene, 0, *tracer, full, progress);
    ASSERT_FALSE(report);
    EXPECT_EQ(report.error().message, "disk full");
}

TEST(Diffuse, AnEmptyMeshHasNoRows) {
    const Baked baked = bake(test::scene_of({Mesh{}}));
    EXPECT_EQ(baked.report.vertex_count, 0u);
}

TEST(Diffuse, OneTriangleAndOneVertex) {
    Mesh triangle = test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
    triangle.triangles.resize(3);  // the fourth vertex is in none
    const Baked baked = bake(test::scene_of({triangle}));
    EXPECT_EQ(baked.report.free_count, 3u);
    EXPECT_EQ(baked.report.unreferenced_count, 1u);
    EXPECT_EQ(distance(baked.row(0), analytic({0, 0, 1})), 0);
    EXPECT_EQ(norm(baked.row(3)), 0);

    Mesh point;  // no triangle at all, under a roof
    point.positions = {{0.5f, 0.5f, -1}};
    point.normals = {{0, 0, 1}};
    const Baked lone = bake(test::scene_of({triangle, point}), {}, 1);
    EXPECT_EQ(lone.report.unreferenced_count, 1u);
    EXPECT_EQ(norm(lone.row(0)), 0);

    Mesh needle = triangle;  // nothing but a triangle without area
    needle.positions[2] = {2, 0, 0};
    const Baked none = bake(test::scene_of({needle}));
    EXPECT_EQ(none.report.unreferenced_count, 4u);
}

/// Triangles without area, triangles listed twice, and vertices that no triangle names and that
/// are nowhere: the others do not notice, to the bit.
TEST(Diffuse, WhatIsNoSurfaceChangesNothing) {
    const Scene clean = small_scene();
    Scene dirty = clean;
    Mesh& mesh = dirty.meshes[0];
    const std::size_t count = mesh.vertex_count();
    const float nan = std::numeric_limits<float>::quiet_NaN();
    mesh.positions.insert(mesh.positions.end(), {{nan, 0, 0}, {1e30f, 0, 0}, {0, 0, 1}});
    mesh.normals.insert(mesh.normals.end(), {{0, 0, 1}, {0, 0, 1}, {nan, 0, 0}});
    mesh.triangles.insert(mesh.triangles.begin(), {5, 5, 5, 7, 8, 7, 0, 1, 2});  // 0, 1, 2: a line
    std::vector<std::uint32_t> again(mesh.triangles.begin() + 900, mesh.triangles.begin() + 1200);
    const Baked expected = bake(clean, {.rays_per_vertex = 448});
    const Baked baked = bake(dirty, {.rays_per_vertex = 448});
    EXPECT_EQ(baked.report.unreferenced_count, expected.report.unreferenced_count + 3);
    EXPECT_TRUE(std::equal(expected.rows.begin(), expected.rows.end(), baked.rows.begin()));
    for (std::size_t v = count; v < count + 3; ++v) EXPECT_EQ(norm(baked.row(v)), 0);

    // Twice the weight in the mean of normals moves an origin a little: a ray or two.
    mesh.triangles.insert(mesh.triangles.end(), again.begin(), again.end());
    const Baked doubled = bake(dirty, {.rays_per_vertex = 448});
    for (std::size_t v = 0; v < count; ++v)
        EXPECT_LT(relative_distance(doubled.row(v), expected.row(v)), 2e-2) << v;
}

/// The middle of a mesh of fins: more than two triangles at an edge, and both sides of each.
TEST(Diffuse, FinsThatShareAnEdge) {
    Mesh fins;
    fins.positions = {{0, 0, 0}, {0, 0, 1}};
    for (int k = 0; k < 3; ++k) {
        const double phi = 2 * pi * k / 3;
        fins.positions.push_back(Vec3(DVec3(20 * std::cos(phi), 20 * std::sin(phi), 0)));
        fins.positions.push_back(Vec3(DVec3(20 * std::cos(phi), 20 * std::sin(phi), 1)));
        const auto at = static_cast<std::uint32_t>(2 + 2 * k);
        fins.triangles.insert(fins.triangles.end(), {0, at, at + 1, 0, at + 1, 1});
    }
    fins.normals.assign(fins.positions.size(), Vec3(0, 0, 1));
    const Baked baked = bake(test::scene_of({fins}), {.rays_per_vertex = 4096});
    // Half way up all three walls, which are as good as endless: nothing is above the upper end,
    // and at the lower end the sky is in no one's way but theirs.
    EXPECT_EQ(distance(baked.row(1), analytic({0, 0, 1})), 0);
    const double sky = double{baked.row(0)[0]} * std::sqrt(4 * pi);
    EXPECT_GE(sky, 0);
    EXPECT_LE(sky, 1);
    for (int k = 0; k < 3; ++k)  // alike by symmetry, but for the rays
        EXPECT_NEAR(baked.row(2)[0], baked.row(static_cast<std::size_t>(2 + 2 * k))[0], 2e-2);
}

TEST(Diffuse, InsideASolidItIsDark) {
    const Mesh crate = test::skewed(test::box({-1, -1, -1}, {1, 1, 1}, 4, 1));
    Mesh buried = test::sphere({0.1f, 0.2f, 0.1f}, 0.3f, 2);
    const Baked baked = bake(test::scene_of({buried, crate}));
    EXPECT_EQ(baked.report.traced_count, buried.vertex_count());
    for (const float t : baked.rows) EXPECT_EQ(t, 0);
}

/// Readers make normals unit; a caller need not have.
TEST(Diffuse, TheLengthOfANormalDoesNotMatter) {
    Scene scene = small_scene();
    const Baked unit = bake(scene, {.rays_per_vertex = 4096});
    for (Vec3& n : scene.meshes[0].normals) n *= 0.03f;
    const Baked shortened = bake(scene, {.rays_per_vertex = 4096});
    EXPECT_EQ(unit.report.traced_count, shortened.report.traced_count);
    double sum = 0;
    for (std::size_t v = 0; v < scene.meshes[0].vertex_count(); ++v)
        sum += std::pow(relative_distance(unit.row(v), shortened.row(v)), 2);
    const double rms = std::sqrt(sum / static_cast<double>(scene.meshes[0].vertex_count()));
    EXPECT_LT(rms, 2 * unit.report.error_rms);  // other bits, other turns: independent errors
}

/// A shading normal turned away from the face stands for the face's other side.
TEST(Diffuse, AnOpposedNormalLooksAtTheOtherSide) {
    Mesh floor = test::grid({-1, -1, 0}, {2, 0, 0}, {0, 2, 0}, 4);
    for (Vec3& n : floor.normals) n = -n;
    const Mesh roof = test::quad({-50, -50, 0.1f}, {100, 0, 0}, {0, 100, 0});
    const Baked under = bake(test::scene_of({floor, roof}));
    for (std::size_t v = 0; v < floor.vertex_count(); ++v)
        EXPECT_EQ(distance(under.row(v), analytic({0, 0, -1})), 0);
}

TEST(FreeVertices, AreThoseThatTheBakeDoesNotTrace) {
    Scene scene = small_scene();
    scene.meshes.push_back(test::sphere({100, 0, 0}, 1, 3));
    scene.meshes.push_back(test::bowl(8, 24));
    const auto counts = count_free_vertices(scene);
    ASSERT_EQ(counts.size(), 3u);
    for (std::size_t m = 0; m < 3; ++m) {
        const Baked baked = bake(scene, {.rays_per_vertex = 96}, m);
        // A mesh's copies are counted with their original, the report counts them apart.
        EXPECT_GE(counts[m], baked.report.free_count);
        EXPECT_LE(counts[m], baked.report.free_count + baked.report.merged_count);
    }
    EXPECT_LT(counts[0], scene.meshes[0].vertex_count());
    // The half that looks away, less a few degrees: the others are 4 wide at a distance of 100.
    EXPECT_GT(counts[1], scene.meshes[1].vertex_count() * 45 / 100);
    EXPECT_LT(counts[1], scene.meshes[1].vertex_count() / 2);
    EXPECT_EQ(counts[2], 0u);
}

}  // namespace
}  // namespace envbake
