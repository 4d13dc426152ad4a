// SPDX-License-Identifier: Apache-2.0
#include "baker/render/reference.h"

#include "baker/core/parallel.h"
#include "baker/render/sight.h"
#include "envbake/runtime/sh.h"
#include "tests/unit/render/test_scenes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <numbers>
#include <string>
#include <vector>

namespace envbake {
namespace {

constexpr double kPi = std::numbers::pi;

Tracer traced(const Scene& scene) {
    auto tracer = Tracer::build(scene);
    EXPECT_TRUE(tracer) << tracer.error();
    return std::move(*tracer);
}

Reference render(const Scene& scene, const Environment& environment, const Camera& camera,
                 const ReferenceOptions& options) {
    const Tracer tracer = traced(scene);
    Progress progress;
    return render_reference(scene, tracer, environment, camera, options, progress);
}

DVec3 mean(const Picture& picture) {
    DVec3 sum(0);
    for (const Vec3& p : picture.radiance) sum += DVec3(p);
    return sum / static_cast<double>(picture.radiance.size());
}

/// A camera that sees next to nothing but `target`: every pixel shows the same point.
Camera at_point(const DVec3& position, const DVec3& target) {
    return {position, target, 0.02, 8, 8};
}

Scene floor_scene(const Material& material) {
    Scene scene = test::scene_of(material);
    test::add_floor(scene, 100);
    return scene;
}

// White, unoccluded, constant light 1: exit radiance 1 in every pixel.
TEST(Reference, WhiteFloorUnderConstantLightIsOne) {
    const Reference r =
        render(floor_scene(test::diffuse_material(1)), test::constant_environment(1),
               at_point({0, 3, 1}, {0, 0, 0}), {.samples_per_pixel = 1024});
    // Cosine and sphere sampling under MIS: measured 0.3 % rms a pixel.
    for (std::size_t i = 0; i < r.picture.radiance.size(); ++i) {
        EXPECT_NEAR(r.picture.radiance[i].y, 1, 0.02);
        EXPECT_TRUE(r.picture.is_surface(i));
    }
    EXPECT_NEAR(mean(r.picture).y, 1, 1e-3);
}

// One texel of radiance L: exit radiance = L / pi * integral of cos over the texel, in closed form
// L / pi * dphi (sin^2 theta_1 - sin^2 theta_0) / 2 for a floor.
TEST(Reference, OneBrightTexel) {
    const int width = 64, height = 32, lit_row = 6;
    const Environment environment = test::lat_long_environment(
        width, height,
        [&](int row, int column) { return Vec3(row == lit_row && column == 11 ? 1e5f : 0.0f); });
    const double s0 = std::sin(kPi * lit_row / height), s1 = std::sin(kPi * (lit_row + 1) / height);
    const double expected = 1e5 / kPi * (2 * kPi / width) * (s1 * s1 - s0 * s0) / 2 * 0.5;
    const Reference r = render(floor_scene(test::diffuse_material(0.5f)), environment,
                               at_point({0, 3, 1}, {0, 0, 0}), {.samples_per_pixel = 256});
    EXPECT_NEAR(mean(r.picture).x / expected, 1, 1e-3);
}

// A disc of radius 1 at height 1 above the point hides half of the cosine-weighted sky.
TEST(Reference, FloorUnderADisc) {
    Scene scene = floor_scene(test::diffuse_material(1));
    Mesh disc;
    disc.positions.push_back(Vec3(0, 1, 0));
    constexpr int kSegments = 512;
    for (int i = 0; i < kSegments; ++i) {
        const double phi = 2 * kPi * i / kSegments;
        disc.positions.push_back(Vec3(DVec3(std::cos(phi), 1, std::sin(phi))));
        const auto a = static_cast<std::uint32_t>(i + 1);
        const auto b = static_cast<std::uint32_t>((i + 1) % kSegments + 1);
        disc.triangles.insert(disc.triangles.end(), {0u, b, a});
    }
    disc.normals.assign(disc.positions.size(), Vec3(0, 1, 0));
    scene.meshes.push_back(disc);
    // 512 chords miss 2.5e-5 of the disc.
    const Reference r = render(scene, test::constant_environment(1),
                               at_point({0.6, 0.5, 0.3}, {0, 0, 0}), {.samples_per_pixel = 4096});
    EXPECT_NEAR(mean(r.picture).y, 0.5, 1e-3);
}

// A sphere seen under a half-angle a, its centre at the angle t from the normal, all of it above
// the horizon, hides sin^2 a cos t of the cosine-weighted sky.
TEST(Reference, FloorBesideASphere) {
    Scene scene = floor_scene(test::diffuse_material(1));
    const double a = 20 * kPi / 180, t = 50 * kPi / 180, distance = 3;
    test::add_sphere(scene, Vec3(DVec3(std::sin(t), std::cos(t), 0) * distance),
                     static_cast<float>(distance * std::sin(a)), 256);
    const Reference r = render(scene, test::constant_environment(1),
                               at_point({-1, 1, 0}, {0, 0, 0}), {.samples_per_pixel = 4096});
    EXPECT_NEAR(mean(r.picture).y, 1 - std::sin(a) * std::sin(a) * std::cos(t), 1e-3);
}

// Specular albedo against the closed form 1 - mu ln(1 + 1 / mu) for alpha = 1, and against
// converged values of the split sum's two integrals, R0 A + B.
TEST(Reference, SpecularFurnace) {
    struct Case {
        double n_dot_v;
        float roughness, r0;
        double expected;
    };
    const double mu = 0.5;
    const Case cases[] = {
        {mu, 1.0f, 1.0f, 1 - mu * std::log(1 + 1 / mu)},
        {0.3, 0.5f, 0.04f, 0.04 * 0.772535514677 + 0.0653702498986},
        {0.7, 0.5f, 1.0f, 0.880774731731 + 0.00456102027694},
        {0.05, 0.2f, 0.5f, 0.5 * 0.357711119721 + 0.533256993048},
    };
    for (const Case& c : cases) {
        Material mirror = test::diffuse_material(0);
        mirror.perceptual_roughness = c.roughness;
        mirror.dielectric_r0 = Vec3(c.r0);
        const DVec3 v(std::sqrt(1 - c.n_dot_v * c.n_dot_v), c.n_dot_v, 0);
        const Reference r = render(floor_scene(mirror), test::constant_environment(1),
                                   at_point(3.0 * v, {0, 0, 0}), {.samples_per_pixel = 4096});
        EXPECT_NEAR(mean(r.picture).y / c.expected, 1, 4e-3)
            << "n.v " << c.n_dot_v << " roughness " << c.roughness;
    }
}

Environment sky_with_sun() {
    return test::lat_long_environment(64, 32, [](int row, int column) {
        if (row == 8 && column == 20) return Vec3(200, 180, 150);
        return row < 16 ? Vec3(0.5f, 0.7f, 1.0f) : Vec3(0.1f);
    });
}

Scene boxes_scene() {
    Material glossy = test::diffuse_material(0.6f);
    glossy.dielectric_r0 = Vec3(0.04f);
    glossy.perceptual_roughness = 0.4f;
    Scene scene = test::scene_of(glossy);
    test::add_floor(scene, 4);
    test::add_box(scene, Vec3(0, 0.5f, 0), Vec3(0.5f));
    test::add_sphere(scene, Vec3(1.5f, 0.6f, 0.2f), 0.6f, 48);
    return scene;
}

const Camera kBoxesCamera{{3, 3, 4}, {0.5, 0.3, 0}, 35, 24, 16};

TEST(Reference, StrategiesAgree) {
    const Scene scene = boxes_scene();
    const Environment environment = sky_with_sun();
    const auto with = [&](LightSampling sampling) {
        return render(scene, environment, kBoxesCamera,
                      {.samples_per_pixel = 4096, .sampling = sampling});
    };
    const Reference mis = with(LightSampling::Mis);
    const Reference from_environment = with(LightSampling::EnvironmentOnly);
    const Reference from_bsdf = with(LightSampling::BsdfOnly);
    const auto rms_difference = [](const Reference& a, const Reference& b) {
        double difference = 0, signal = 0;
        for (std::size_t i = 0; i < a.picture.radiance.size(); ++i) {
            if (!a.picture.is_surface(i)) continue;
            const DVec3 d = DVec3(a.picture.radiance[i]) - DVec3(b.picture.radiance[i]);
            const DVec3 s(b.picture.radiance[i]);
            difference += glm::dot(d, d);
            signal += glm::dot(s, s);
        }
        return std::sqrt(difference / signal);
    };
    // Each pair differs by no more than the noise that both state, together.
    EXPECT_LT(rms_difference(mis, from_environment),
              1.5 * std::hypot(mis.noise_rms, from_environment.noise_rms));
    EXPECT_LT(rms_difference(mis, from_bsdf), 1.5 * std::hypot(mis.noise_rms, from_bsdf.noise_rms));
    // And that noise is small enough for the sentence to mean something.
    EXPECT_LT(mis.noise_rms, 0.01);
    EXPECT_LT(from_environment.noise_rms, 0.02);
    EXPECT_LT(from_bsdf.noise_rms, 0.15);
    EXPECT_NEAR(mean(mis.picture).y / mean(from_environment.picture).y, 1, 3e-3);
}

TEST(Reference, StatedNoiseIsTheError) {
    const Scene scene = boxes_scene();
    const Environment environment = sky_with_sun();
    const Reference coarse =
        render(scene, environment, kBoxesCamera, {.samples_per_pixel = 64, .seed = 1});
    const Reference fine =
        render(scene, environment, kBoxesCamera, {.samples_per_pixel = 8192, .seed = 2});
    double error = 0, signal = 0;
    for (std::size_t i = 0; i < fine.picture.radiance.size(); ++i) {
        if (!fine.picture.is_surface(i)) continue;
        const DVec3 d = DVec3(coarse.picture.radiance[i]) - DVec3(fine.picture.radiance[i]);
        error += glm::dot(d, d);
        signal += glm::dot(DVec3(fine.picture.radiance[i]), DVec3(fine.picture.radiance[i]));
    }
    const double true_rms = std::sqrt(error / signal);
    EXPECT_GT(coarse.noise_rms, 0.7 * true_rms);
    EXPECT_LT(coarse.noise_rms, 1.4 * true_rms);
}

// l_00 = 2 sqrt(pi) is constant light 1. l_1-1 alone on a floor (n = +Y) gives
// 1 / pi * 2 pi / 3 * Y_1-1(+Y) = 2 / 3 sqrt(3 / 4 pi).
TEST(Reference, TruncatedLightOnAFloor) {
    std::vector<Vec3> light(9, Vec3(0));
    light[0] = Vec3(static_cast<float>(2 * std::sqrt(kPi)), 0, 0);
    light[static_cast<std::size_t>(sh::index(1, -1))] = Vec3(0, 1, 0);
    const Reference r = render(
        floor_scene(test::diffuse_material(0.3f)), sky_with_sun(), at_point({0, 3, 1}, {0, 0, 0}),
        {.samples_per_pixel = 4096, .white_lambert = true, .truncated_light = light});
    ASSERT_TRUE(r.truncated.has_value());
    EXPECT_NEAR(mean(*r.truncated).x, 1, 1e-6);
    EXPECT_NEAR(mean(*r.truncated).y, 2.0 / 3 * std::sqrt(3 / (4 * kPi)), 1e-6);
    EXPECT_EQ(r.truncated_noise_rms, 0);  // nothing is blocked, so nothing is left to chance
}

// At the foot of an infinite wall that hides x < 0 half of the floor's sky is left: T_00 = Y_00 /
// 2, T_1-1 = sqrt(3 / 4 pi) / 3, and T_11 = sqrt(3 / 4 pi) / pi * integral of x y over the quarter
// sphere, which is 2/3.
TEST(Reference, TruncatedLightAtTheFootOfAWall) {
    Scene scene = floor_scene(test::diffuse_material(1));
    test::add_quad(scene, Vec3(-1e-3f, 0, 0), Vec3(0, 50, 0), Vec3(0, 0, 50));
    std::vector<Vec3> light(4, Vec3(0));
    light[0].x = light[1].y = light[3].z = 1;
    const Reference r =
        render(scene, sky_with_sun(), at_point({1, 1, 0}, {0, 0, 0}),
               {.samples_per_pixel = 4096, .white_lambert = true, .truncated_light = light});
    ASSERT_TRUE(r.truncated.has_value());
    const double y1 = std::sqrt(3 / (4 * kPi));
    EXPECT_NEAR(mean(*r.truncated).x, 1 / (4 * std::sqrt(kPi)), 1e-3);
    EXPECT_NEAR(mean(*r.truncated).y, y1 / 3, 1e-3);
    EXPECT_NEAR(mean(*r.truncated).z, 2 * y1 / (3 * kPi), 1e-3);
    EXPECT_GT(r.truncated_noise_rms, 0);
    EXPECT_LT(r.truncated_noise_rms, 0.02);
}

TEST(Reference, WhiteModeIgnoresMaterials) {
    Material metal;
    metal.base_color = Vec3(0.9f, 0.1f, 0.1f);
    metal.emission = Vec3(5);
    const Reference r =
        render(floor_scene(metal), test::constant_environment(1), at_point({0, 3, 1}, {0, 0, 0}),
               {.samples_per_pixel = 1024, .white_lambert = true});
    EXPECT_NEAR(mean(r.picture).x, 1, 1e-3);
    EXPECT_NEAR(mean(r.picture).z, 1, 1e-3);
}

TEST(Reference, EmissionAndBlendAndBackground) {
    // A black, half transparent pane that glows with 4, before a sky of 2: 0.5 * 4 + 0.5 * 2.
    Material pane = test::diffuse_material(0);
    pane.emission = Vec3(4);
    pane.alpha = 0.5f;
    pane.alpha_mode = AlphaMode::Blend;
    Scene scene = test::scene_of(pane);
    test::add_quad(scene, Vec3(0), Vec3(1, 0, 0), Vec3(0, 1, 0));
    const Reference r = render(scene, test::constant_environment(2), at_point({0, 0, 3}, {0, 0, 0}),
                               {.samples_per_pixel = 16});
    EXPECT_NEAR(mean(r.picture).y, 3, 1e-5);
    EXPECT_NEAR(r.picture.surface[0], 0.5, 1e-6);
    EXPECT_FALSE(r.picture.is_surface(0));
}

TEST(Sight, HidesBacksOfSingleSidedSurfacesOnly) {
    Scene scene = test::scene_of(test::diffuse_material(1));
    test::add_quad(scene, Vec3(0), Vec3(1, 0, 0), Vec3(0, 1, 0));  // faces +Z
    Sight sight;
    look_along(scene, traced(scene), {0.1, 0.1, -3}, {0, 0, 1}, sight);
    EXPECT_TRUE(sight.layers.empty());
    EXPECT_EQ(sight.background, 1);
    look_along(scene, traced(scene), {0.1, 0.1, 3}, {0, 0, -1}, sight);
    EXPECT_EQ(sight.layers.size(), 1u);

    scene.materials[0].double_sided = true;
    look_along(scene, traced(scene), {0.1, 0.1, -3}, {0, 0, 1}, sight);
    ASSERT_EQ(sight.layers.size(), 1u);
    EXPECT_LT(sight.layers[0].point.normal.z, -0.99);  // turned to the viewer
    EXPECT_LT(sight.layers[0].point.light_origin.z, 0);
}

// Panes one behind the other at any distance from the origin: each is met exactly once.
TEST(Sight, PassesEachPaneOnce) {
    for (const float offset : {0.0f, 1000.0f, 100000.0f}) {
        Material pane = test::diffuse_material(1);
        pane.alpha = 0.25f;
        pane.alpha_mode = AlphaMode::Blend;
        Scene scene = test::scene_of(pane);
        for (int i = 0; i < 5; ++i) {
            test::add_quad(scene, Vec3(offset, offset, offset - static_cast<float>(i)),
                           Vec3(4, 0, 0), Vec3(0, 4, 0));
        }
        Sight sight;
        look_along(scene, traced(scene), DVec3(offset) + DVec3(0.3, 0.2, 3),
                   glm::normalize(DVec3(0.1, 0.05, -1)), sight);
        ASSERT_EQ(sight.layers.size(), 5u) << offset;
        EXPECT_NEAR(sight.layers[2].weight, 0.25 * 0.75 * 0.75, 1e-6);
        EXPECT_NEAR(sight.background, std::pow(0.75, 5), 1e-6);
    }
}

TEST(Reference, SameBytesOnAnyNumberOfThreads) {
    const Scene scene = boxes_scene();
    const auto on = [&](int threads) {
        const ThreadLimit limit(threads);
        return render(scene, sky_with_sun(), kBoxesCamera, {.samples_per_pixel = 32});
    };
    const Reference one = on(1), four = on(4);
    EXPECT_EQ(0, std::memcmp(one.picture.radiance.data(), four.picture.radiance.data(),
                             one.picture.radiance.size() * sizeof(Vec3)));
    EXPECT_EQ(one.noise_rms, four.noise_rms);
}

}  // namespace
}  // namespace envbake
