// SPDX-License-Identifier: Apache-2.0
#include "baker/trace/half_space_tree.h"

#include "baker/trace/occluders.h"
#include "tests/unit/trace/shapes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace envbake {
namespace {

/// The highest vertex decides, where it is not within a hair of the plane.
TEST(HalfSpaceTree, AgreesWithEveryVertexTested) {
    std::mt19937 random(1);
    std::normal_distribution<double> normal;
    for (const int count : {1, 3, 4, 5, 37, 1000}) {
        const Scene scene = test::scene_of({test::triangle_soup(count, 0.2f, unsigned(count))});
        const HalfSpaceTree tree(scene);
        int free = 0, blocked = 0;
        for (int i = 0; i < 500; ++i) {
            const double x = normal(random), y = normal(random);
            const DVec3 n = glm::normalize(DVec3(x, y, normal(random)));
            const DVec3 o = n * (1.2 + 0.4 * normal(random));
            double height = -1e30;
            for (const Vec3& p : scene.meshes[0].positions)
                height = std::max(height, glm::dot(n, DVec3(p) - o));
            if (std::abs(height) < 1e-4) continue;
            EXPECT_EQ(tree.any_above(o, n), height > 0);
            ++(height > 0 ? blocked : free);
        }
        EXPECT_GT(free, 50);
        EXPECT_GT(blocked, 10);
    }
}

/// A triangle may pass right over a point while each of its vertices is far and hardly higher.
TEST(HalfSpaceTree, SeesALargeTriangleCloseOverhead) {
    Mesh mesh = test::quad({-1000, -1000, 0.001f}, {2000, 0, 0}, {0, 2000, 0});
    EXPECT_TRUE(HalfSpaceTree(test::scene_of({mesh})).any_above(DVec3(1, 2, 0), DVec3(0, 0, 1)));
    // The same at the same slope but to one side only: nothing that matters.
    mesh = test::quad({1000, -1000, 0.001f}, {2000, 0, 0}, {0, 2000, 0});
    EXPECT_FALSE(HalfSpaceTree(test::scene_of({mesh})).any_above(DVec3(1, 2, 0), DVec3(0, 0, 1)));
}

TEST(HalfSpaceTree, WhatThrowsNoShadowDoesNotCount) {
    Scene scene = test::scene_of({test::quad({-1, -1, 1}, {2, 0, 0}, {0, 2, 0})});
    EXPECT_TRUE(HalfSpaceTree(scene).any_above(DVec3(0), DVec3(0, 0, 1)));
    scene.materials[0].alpha_mode = AlphaMode::Blend;
    EXPECT_FALSE(HalfSpaceTree(scene).any_above(DVec3(0), DVec3(0, 0, 1)));
    scene.materials[0].alpha_mode = AlphaMode::Mask;
    EXPECT_TRUE(HalfSpaceTree(scene).any_above(DVec3(0), DVec3(0, 0, 1)));
    scene.materials[0].alpha = 0.4f;
    EXPECT_FALSE(HalfSpaceTree(scene).any_above(DVec3(0), DVec3(0, 0, 1)));
    EXPECT_FALSE(HalfSpaceTree(Scene{}).any_above(DVec3(0), DVec3(0, 0, 1)));
    EXPECT_FALSE(HalfSpaceTree().any_above(DVec3(0), DVec3(0, 0, 1)));
}

}  // namespace
}  // namespace envbake
