// SPDX-License-Identifier: Apache-2.0
#include "baker/render/camera.h"

#include "tests/unit/render/test_scenes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>

namespace envbake {
namespace {

struct Extent {
    DVec2 low{1e30}, high{-1e30};
    bool all_in_front = true;
};

Extent projected(const Scene& scene, const Camera& camera) {
    const CameraRays rays(camera);
    Extent extent;
    for (const Mesh& mesh : scene.meshes) {
        for (const Vec3& p : mesh.positions) {
            DVec2 pixel(0);
            if (!rays.project(DVec3(p), pixel)) extent.all_in_front = false;
            extent.low = glm::min(extent.low, pixel);
            extent.high = glm::max(extent.high, pixel);
        }
    }
    return extent;
}

Camera framed(const Scene& scene, int width, int height, std::optional<double> fov_deg = {}) {
    const auto tracer = Tracer::build(scene);
    EXPECT_TRUE(tracer) << tracer.error();
    return frame_scene(scene, *tracer, width, height, fov_deg);
}

void expect_well_framed(const Scene& scene, int width, int height,
                        std::optional<double> fov_deg = {}) {
    const Extent extent = projected(scene, framed(scene, width, height, fov_deg));
    EXPECT_TRUE(extent.all_in_front);
    EXPECT_GE(extent.low.x, 0);
    EXPECT_GE(extent.low.y, 0);
    EXPECT_LE(extent.high.x, width);
    EXPECT_LE(extent.high.y, height);
    // As near as can be: along one axis the scene fills the picture up to the margins of 4 %.
    const double filled =
        std::max((extent.high.x - extent.low.x) / width, (extent.high.y - extent.low.y) / height);
    EXPECT_NEAR(filled, 0.92, 0.01);
}

TEST(Camera, TowardsAndProjectAreInverse) {
    const Camera camera{{1, 2, 3}, {-4, 0.5, 2}, 40, 320, 200};
    const CameraRays rays(camera);
    for (const double x : {0.0, 100.25, 319.0}) {
        for (const double y : {0.5, 99.0, 200.0}) {
            const DVec3 w = rays.towards(x, y);
            EXPECT_NEAR(glm::length(w), 1, 1e-14);
            DVec2 pixel(0);
            ASSERT_TRUE(rays.project(camera.position + 7.0 * w, pixel));
            EXPECT_NEAR(pixel.x, x, 1e-9);
            EXPECT_NEAR(pixel.y, y, 1e-9);
        }
    }
    // The target is the middle; up is up; the vertical angle is the one asked for.
    const DVec3 forward = glm::normalize(camera.target - camera.position);
    EXPECT_NEAR(glm::dot(rays.towards(160, 100), forward), 1, 1e-14);
    EXPECT_GT(rays.towards(160, 0).y, rays.towards(160, 200).y);
    const double cosine = glm::dot(rays.towards(160, 0), rays.towards(160, 200));
    EXPECT_NEAR(std::acos(cosine) * 180 / 3.14159265358979, 40, 1e-9);
}

TEST(Camera, LooksStraightDownWithoutNan) {
    const Camera camera{{0, 5, 0}, {0, 0, 0}, 40, 64, 64};
    const DVec3 w = CameraRays(camera).towards(32, 0);
    EXPECT_LT(w.z, 0);  // -Z is up in the picture
    EXPECT_NEAR(w.x, 0, 1e-14);
}

TEST(Camera, FramesObjectsOfAnyShapeAndSize) {
    for (const float scale : {1e-3f, 1.0f, 1e3f}) {
        for (const Vec3& half : {Vec3(1), Vec3(5, 0.1f, 5), Vec3(0.05f, 4, 0.05f), Vec3(9, 1, 1)}) {
            Scene scene = test::scene_of(test::diffuse_material(1));
            test::add_box(scene, Vec3(3, -2, 10) * scale, half * scale);
            expect_well_framed(scene, 320, 180);
            expect_well_framed(scene, 180, 320);
        }
    }
}

TEST(Camera, FramesAFloorWithASphere) {
    Scene scene = test::scene_of(test::diffuse_material(1));
    test::add_floor(scene, 4);
    test::add_sphere(scene, Vec3(1, 1, 0), 1, 24);
    expect_well_framed(scene, 640, 360);
    EXPECT_GT(framed(scene, 640, 360).position.y, 1);
}

TEST(Camera, FramesWithTheFieldOfViewAskedFor) {
    Scene scene = test::scene_of(test::diffuse_material(1));
    test::add_box(scene, Vec3(3, -2, 10), Vec3(2, 1, 1));
    double distance = 1e30;
    for (const double fov_deg : {10.0, 35.0, 90.0}) {
        expect_well_framed(scene, 320, 180, fov_deg);
        const Camera camera = framed(scene, 320, 180, fov_deg);
        EXPECT_EQ(camera.vertical_fov_deg, fov_deg);
        EXPECT_LT(glm::length(camera.position - DVec3(3, -2, 10)), distance);
        distance = glm::length(camera.position - DVec3(3, -2, 10));
    }
    EXPECT_EQ(framed(scene, 320, 180).vertical_fov_deg, 35);

    Scene room = test::scene_of(test::diffuse_material(1));
    test::add_box(room, Vec3(0, 1.5f, 0), Vec3(2, 1.5f, 6), true);
    EXPECT_EQ(framed(room, 320, 180, 70).vertical_fov_deg, 70);
    EXPECT_EQ(framed(room, 320, 180).vertical_fov_deg, 55);
}

// From above its back alone is seen, as of a room, but there is nothing to see from inside.
TEST(Camera, AFloorThatFacesDownIsSeenFromOutside) {
    Scene scene = test::scene_of(test::diffuse_material(1));
    Mesh mesh;
    mesh.positions = {Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 0, 1)};
    mesh.normals.assign(3, Vec3(0, -1, 0));
    mesh.triangles = {0, 1, 2};
    scene.meshes.push_back(mesh);
    const Camera camera = framed(scene, 320, 180);
    EXPECT_GT(glm::length(camera.target - camera.position), 0.1);
    EXPECT_NEAR(glm::length(CameraRays(camera).towards(10, 10)), 1, 1e-14);
    expect_well_framed(scene, 320, 180);
}

TEST(Camera, StandsInsideARoom) {
    Scene scene = test::scene_of(test::diffuse_material(1));
    test::add_box(scene, Vec3(0, 1.5f, 0), Vec3(2, 1.5f, 6), true);
    const Camera camera = framed(scene, 320, 180);
    EXPECT_LT(std::abs(camera.position.x), 2);
    EXPECT_GT(camera.position.y, 0);
    EXPECT_LT(camera.position.y, 3);
    EXPECT_LT(std::abs(camera.position.z), 6);
    // It looks along the room, not across it.
    const DVec3 forward = glm::normalize(camera.target - camera.position);
    EXPECT_GT(std::abs(forward.z), 0.9);
    EXPECT_GT(glm::length(camera.target - camera.position), 9);
}

TEST(Camera, AnEmptySceneStillGivesACamera) {
    const Scene scene = test::scene_of(test::diffuse_material(1));
    const Camera camera = framed(scene, 320, 180);
    EXPECT_TRUE(std::isfinite(CameraRays(camera).towards(0, 0).x));
    EXPECT_EQ(camera.width, 320);
}

TEST(Camera, AScenewithoutExtentIsFinite) {
    Scene scene = test::scene_of(test::diffuse_material(1));
    test::add_quad(scene, Vec3(1, 1, 1), Vec3(1e-12f, 0, 0), Vec3(0, 0, 1e-12f));
    const Camera camera = framed(scene, 320, 180);
    EXPECT_TRUE(std::isfinite(CameraRays(camera).towards(10, 10).x));
}

}  // namespace
}  // namespace envbake
