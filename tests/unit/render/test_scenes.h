// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/environment.h"
#include "baker/input/scene.h"

#include <cmath>
#include <cstddef>
#include <functional>
#include <numbers>
#include <vector>

namespace envbake::test {

inline Material diffuse_material(float albedo) {
    Material material;
    material.base_color = Vec3(albedo);
    material.metallic = 0;
    material.dielectric_r0 = Vec3(0);
    return material;
}

inline Scene scene_of(const Material& material) {
    Scene scene;
    scene.materials.push_back(material);
    return scene;
}

/// A flat quad, centre + s * across + t * along with s, t in [-1, 1]; its normal is across x along.
inline void add_quad(Scene& scene, const Vec3& centre, const Vec3& across, const Vec3& along,
                     int material = 0) {
    Mesh mesh;
    mesh.material = material;
    mesh.positions = {centre - across - along, centre + across - along, centre + across + along,
                      centre - across + along};
    mesh.normals.assign(4, glm::normalize(glm::cross(across, along)));
    mesh.triangles = {0, 1, 2, 0, 2, 3};
    scene.meshes.push_back(mesh);
}

/// The floor y = 0, half_size in each direction, facing up.
inline void add_floor(Scene& scene, float half_size, int material = 0) {
    add_quad(scene, Vec3(0), Vec3(0, 0, half_size), Vec3(half_size, 0, 0), material);
}

/// A sphere of triangles whose vertices lie on it.
inline void add_sphere(Scene& scene, const Vec3& centre, float radius, int segments,
                       int material = 0) {
    Mesh mesh;
    mesh.material = material;
    const int rows = segments / 2;
    for (int i = 0; i <= rows; ++i) {
        for (int j = 0; j < segments; ++j) {
            const double theta = std::numbers::pi * i / rows;
            const double phi = 2 * std::numbers::pi * j / segments;
            const Vec3 n(DVec3(std::sin(theta) * std::cos(phi), std::cos(theta),
                               std::sin(theta) * std::sin(phi)));
            mesh.positions.push_back(centre + radius * n);
            mesh.normals.push_back(n);
        }
    }
    const auto vertex = [segments](int i, int j) {
        return static_cast<std::uint32_t>(i * segments + j % segments);
    };
    for (int i = 0; i < rows; ++i) {
        for (int j = 0; j < segments; ++j) {
            if (i > 0)
                mesh.triangles.insert(mesh.triangles.end(),
                                      {vertex(i, j), vertex(i, j + 1), vertex(i + 1, j + 1)});
            if (i < rows - 1)
                mesh.triangles.insert(mesh.triangles.end(),
                                      {vertex(i, j), vertex(i + 1, j + 1), vertex(i + 1, j)});
        }
    }
    scene.meshes.push_back(mesh);
}

/// An axis-aligned box; `inwards` turns every face to the inside.
inline void add_box(Scene& scene, const Vec3& centre, const Vec3& half, bool inwards = false,
                    int material = 0) {
    const float side = inwards ? -1.0f : 1.0f;
    for (int axis = 0; axis < 3; ++axis) {
        for (const float sign : {-1.0f, 1.0f}) {
            Vec3 offset(0), across(0), along(0);
            offset[axis] = sign * half[axis];
            across[(axis + 1) % 3] = sign * side * half[(axis + 1) % 3];
            along[(axis + 2) % 3] = half[(axis + 2) % 3];
            add_quad(scene, centre + offset, across, along, material);
        }
    }
}

/// A lat-long environment with radiance(row, column).
inline Environment lat_long_environment(int width, int height,
                                        const std::function<Vec3(int, int)>& radiance) {
    Environment environment;
    environment.grid = make_lat_long_grid(width, height);
    for (int row = 0; row < height; ++row)
        for (int column = 0; column < width; ++column)
            environment.radiance.push_back(radiance(row, column));
    return environment;
}

inline Environment constant_environment(float radiance) {
    return lat_long_environment(4, 2, [radiance](int, int) { return Vec3(radiance); });
}

}  // namespace envbake::test
