// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/ray_origin.h"

#include "tests/unit/trace/shapes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

namespace envbake {
namespace {

/// Height of the origin of `vertex` above the plane of each triangle that has the vertex, least.
double least_height(const Mesh& mesh, const SurfacePoints& points, std::uint32_t vertex,
                    const TraceSpace& space) {
    // As it will be traced: rounded to the floats of the trace space.
    const DVec3 at = DVec3(space.to_local(points.origin(vertex, space).position));
    double least = 1e30;
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
        if (points.representative(mesh.triangles[i]) != vertex) continue;
        const Triangle t = triangle_of(mesh, i / 3);
        const DVec3 local = DVec3(space.to_local(t.a));
        least = std::min(least, glm::dot(glm::normalize(t.cross()), at - local));
    }
    return least;
}

TEST(SurfacePoints, OriginsStandAboveEveryTriangleOfTheirVertex) {
    const Mesh shapes[] = {test::sphere({0, 0, 0}, 1, 4), test::bowl(20, 60),
                           test::skewed(test::box({-1, -1, -1}, {2, 3, 5}, 9, 1)),
                           test::skewed(test::box({-1, -1, -1}, {2, 3, 5}, 9, -1)),
                           test::skewed(test::grid({0, 0, 0}, {100, 0, 0}, {0, 100, 0}, 40))};
    for (const Mesh& shape : shapes) {
        for (const float offset : {0.0f, 1000.0f}) {
            const Mesh mesh = test::moved(shape, 1, {offset, -2 * offset, offset});
            const Scene scene = test::scene_of({mesh});
            const TraceSpace space(scene);
            const SurfacePoints points(scene.meshes[0]);
            for (std::uint32_t v = 0; v < mesh.vertex_count(); v += 7) {
                if (points.representative(v) != v) continue;
                // Of four float spacings, rounding the origin may take one or so back.
                const double spacing = space.resolution_at(mesh.positions[v]) * space.scale();
                ASSERT_GT(least_height(mesh, points, v, space), 2 * spacing) << "vertex " << v;
            }
        }
    }
}

/// In the corner of a room a floor vertex must leave the planes of both walls, to its own side.
TEST(SurfacePoints, OriginsLeaveThePlanesOfNeighbouringWalls) {
    const Scene scene = test::scene_of({test::box({0, 0, 0}, {2, 3, 5}, 4, -1)});
    const SurfacePoints points(scene.meshes[0]);
    const TraceSpace space(scene);
    for (std::uint32_t v = 0; v < points.size(); ++v) {
        const DVec3 o = points.origin(points.representative(v), space).position;
        for (int axis = 0; axis < 3; ++axis) {
            EXPECT_GT(o[axis], 1e-7);
            EXPECT_LT(o[axis], double(Vec3(2, 3, 5)[axis]) - 1e-7);
        }
        EXPECT_LT(glm::distance(o, DVec3(scene.meshes[0].positions[v])), 5e-4);
    }
}

TEST(SurfacePoints, EqualVerticesAreOnePlace) {
    Mesh mesh = test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
    test::append(mesh, test::quad({1, 0, -0.0f}, {1, 0, 0}, {0, 1, 0}));
    mesh.normals[7].x = -0.0f;
    const SurfacePoints points(mesh);
    EXPECT_EQ(points.representative(0), 0u);
    EXPECT_EQ(points.representative(4), 1u);  // (1, 0, 0)
    EXPECT_EQ(points.representative(7), 2u);  // (1, 1, 0)
    EXPECT_EQ(points.representative(5), 5u);
    mesh.normals[4] = {0, 1, 0};  // the same place seen differently
    EXPECT_EQ(SurfacePoints(mesh).representative(4), 4u);
}

TEST(SurfacePoints, WhatNobodyCanSeeIsNoPlace) {
    Mesh mesh = test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
    for (int i = 0; i < 4; ++i) {
        mesh.positions.push_back({5, float(i), 0});
        mesh.normals.push_back({0, 0, 1});
    }
    mesh.triangles.insert(mesh.triangles.end(), {4, 5, 6});  // on one line; 7 is in none
    mesh.normals[0] = {0, 0, 0};
    mesh.normals[1].y = std::numeric_limits<float>::quiet_NaN();
    const SurfacePoints points(mesh);
    for (const std::uint32_t v : {0u, 1u, 4u, 5u, 6u, 7u})
        EXPECT_EQ(points.representative(v), SurfacePoints::kNone) << v;
    EXPECT_EQ(points.representative(2), 2u);
    EXPECT_EQ(points.representative(3), 3u);
}

/// A copy that no triangle uses is still a copy of a vertex that one does.
TEST(SurfacePoints, AnUnusedCopyIsOnTheSurface) {
    Mesh mesh = test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
    mesh.positions.insert(mesh.positions.begin(), mesh.positions[0]);
    mesh.normals.insert(mesh.normals.begin(), mesh.normals[0]);
    for (std::uint32_t& index : mesh.triangles) ++index;
    EXPECT_EQ(SurfacePoints(mesh).representative(1), 0u);
}

/// Wound against the shading normal, the origin goes to the side of the shading normal.
TEST(SurfacePoints, TheShadingNormalSaysWhichSide) {
    Mesh mesh = test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
    mesh.normals.assign(4, Vec3(0, 0, -1));
    const Scene scene = test::scene_of({mesh});
    const SurfacePoints points(scene.meshes[0]);
    EXPECT_LT(points.origin(0, TraceSpace(scene)).position.z, 0);
    EXPECT_EQ(points.origin(0, TraceSpace(scene)).normal, DVec3(0, 0, -1));
}

}  // namespace
}  // namespace envbake
