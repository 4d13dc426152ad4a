// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/scene.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

/// Meshes with known visibility, built by hand. All have material 0 of scene_of(): opaque.
namespace envbake::test {

inline Scene scene_of(std::vector<Mesh> meshes) {
    Scene scene;
    scene.file_name = "by hand";
    scene.meshes = std::move(meshes);
    scene.materials.resize(1);
    return scene;
}

/// A parallelogram, two triangles; the normal is u x v.
inline Mesh quad(const Vec3& corner, const Vec3& u, const Vec3& v) {
    Mesh mesh;
    mesh.positions = {corner, corner + u, corner + u + v, corner + v};
    mesh.normals.assign(4, glm::normalize(glm::cross(u, v)));
    mesh.triangles = {0, 1, 2, 0, 2, 3};
    return mesh;
}

/// n * n squares over the parallelogram; vertex (i, j) is j * (n + 1) + i.
inline Mesh grid(const Vec3& corner, const Vec3& u, const Vec3& v, int n) {
    Mesh mesh;
    const Vec3 normal = glm::normalize(glm::cross(u, v));
    const auto at = [&](int i, int j) { return static_cast<std::uint32_t>(j * (n + 1) + i); };
    for (int j = 0; j <= n; ++j) {
        for (int i = 0; i <= n; ++i) {
            mesh.positions.push_back(corner + u * (float(i) / float(n)) +
                                     v * (float(j) / float(n)));
            mesh.normals.push_back(normal);
        }
    }
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i)
            for (const std::uint32_t corner_index : {at(i, j), at(i + 1, j), at(i + 1, j + 1),
                                                     at(i, j), at(i + 1, j + 1), at(i, j + 1)})
                mesh.triangles.push_back(corner_index);
    return mesh;
}

inline void append(Mesh& to, const Mesh& more) {
    const auto base = static_cast<std::uint32_t>(to.positions.size());
    to.positions.insert(to.positions.end(), more.positions.begin(), more.positions.end());
    to.normals.insert(to.normals.end(), more.normals.begin(), more.normals.end());
    for (const std::uint32_t index : more.triangles) to.triangles.push_back(base + index);
}

/// Six grids about [low, high]; `side` +1: seen from outside, -1: a room seen from inside.
inline Mesh box(const Vec3& low, const Vec3& high, int n, int side) {
    Mesh mesh;
    const Vec3 size = high - low;
    for (int axis = 0; axis < 3; ++axis) {
        Vec3 u(0), v(0), w(0);
        u[(axis + 1) % 3] = size[(axis + 1) % 3];
        v[(axis + 2) % 3] = size[(axis + 2) % 3];
        w[axis] = size[axis];
        append(mesh, side > 0 ? grid(low, v, u, n) : grid(low, u, v, n));
        append(mesh, side > 0 ? grid(low + w, u, v, n) : grid(low + w, v, u, n));
    }
    return mesh;
}

/// An icosahedron, each triangle cut in four `levels` times; all vertices on the sphere.
inline Mesh sphere(const Vec3& centre, float radius, int levels) {
    const float g = (1 + std::sqrt(5.0f)) / 2;
    std::vector<Vec3> p = {{-1, g, 0}, {1, g, 0}, {-1, -g, 0}, {1, -g, 0},
                           {0, -1, g}, {0, 1, g}, {0, -1, -g}, {0, 1, -g},
                           {g, 0, -1}, {g, 0, 1}, {-g, 0, -1}, {-g, 0, 1}};
    std::vector<std::uint32_t> t = {0, 11, 5, 0, 5,  1,  0,  1,  7,  0,  7, 10, 0, 10, 11,
                                    1, 5,  9, 5, 11, 4,  11, 10, 2,  10, 7, 6,  7, 1,  8,
                                    3, 9,  4, 3, 4,  2,  3,  2,  6,  3,  6, 8,  3, 8,  9,
                                    4, 9,  5, 2, 4,  11, 6,  2,  10, 8,  6, 7,  9, 8,  1};
    for (int level = 0; level < levels; ++level) {
        std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
        const auto middle = [&](std::uint32_t a, std::uint32_t b) {
            const auto [at, fresh] =
                middles.try_emplace(std::minmax(a, b), static_cast<std::uint32_t>(p.size()));
            if (fresh) p.push_back(glm::normalize(p[a]) + glm::normalize(p[b]));
            return at->second;
        };
        std::vector<std::uint32_t> finer;
        for (std::size_t i = 0; i < t.size(); i += 3) {
            const std::uint32_t a = t[i], b = t[i + 1], c = t[i + 2];
            const std::uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
            for (const std::uint32_t index : {a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca})
                finer.push_back(index);
        }
        t = std::move(finer);
    }
    Mesh mesh;
    for (const Vec3& direction : p) {
        mesh.normals.push_back(glm::normalize(direction));
        mesh.positions.push_back(centre + radius * mesh.normals.back());
    }
    mesh.triangles = std::move(t);
    return mesh;
}

/// The lower half of the unit sphere seen from inside: normals towards the centre, the rim at z =
/// 0. Vertex 0 is the pole; ring r (1 .. rings) is `sectors` vertices at polar angle r * 90 /
/// rings.
inline Mesh bowl(int rings, int sectors) {
    Mesh mesh;
    mesh.positions.push_back({0, 0, -1});
    for (int r = 1; r <= rings; ++r) {
        const double polar = std::numbers::pi / 2 * r / rings;
        for (int s = 0; s < sectors; ++s) {
            const double phi = 2 * std::numbers::pi * s / sectors;
            mesh.positions.push_back(
                Vec3(DVec3(std::sin(polar) * std::cos(phi), std::sin(polar) * std::sin(phi),
                           -std::cos(polar))));
        }
    }
    for (const Vec3& p : mesh.positions) mesh.normals.push_back(-glm::normalize(p));
    const auto at = [&](int r, int s) {
        return static_cast<std::uint32_t>(r == 0 ? 0 : 1 + (r - 1) * sectors + s % sectors);
    };
    for (int r = 0; r < rings; ++r) {
        for (int s = 0; s < sectors; ++s) {
            for (const std::uint32_t index : {at(r, s), at(r + 1, s), at(r + 1, s + 1)})
                mesh.triangles.push_back(index);
            if (r == 0) continue;
            for (const std::uint32_t index : {at(r, s), at(r + 1, s + 1), at(r, s + 1)})
                mesh.triangles.push_back(index);
        }
    }
    return mesh;
}

/// A fan of triangles about the z axis at height z, seen from below.
inline Mesh disc(float radius, float z, int sectors) {
    Mesh mesh;
    mesh.positions.push_back({0, 0, z});
    for (int s = 0; s < sectors; ++s) {
        const double phi = 2 * std::numbers::pi * s / sectors;
        mesh.positions.push_back(Vec3(DVec3(radius * std::cos(phi), radius * std::sin(phi), z)));
        mesh.triangles.insert(mesh.triangles.end(),
                              {0, static_cast<std::uint32_t>((s + 1) % sectors + 1),
                               static_cast<std::uint32_t>(s + 1)});
    }
    mesh.normals.assign(mesh.positions.size(), Vec3(0, 0, -1));
    return mesh;
}

/// Loose triangles in [-1, 1]^3, no two alike.
inline Mesh triangle_soup(int count, float size, unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> uniform(-1, 1);
    const auto point = [&] {
        const float x = uniform(random), y = uniform(random);
        return Vec3(x, y, uniform(random));
    };
    Mesh mesh;
    for (int i = 0; i < count; ++i) {
        const Vec3 centre = point();
        for (int corner = 0; corner < 3; ++corner) {
            mesh.triangles.push_back(static_cast<std::uint32_t>(mesh.positions.size()));
            mesh.positions.push_back(centre + size * point());
        }
        const Vec3* p = &mesh.positions[mesh.positions.size() - 3];
        mesh.normals.insert(mesh.normals.end(), 3,
                            glm::normalize(glm::cross(p[1] - p[0], p[2] - p[0])));
    }
    return mesh;
}

inline Mesh moved(Mesh mesh, float scale, const Vec3& offset) {
    for (Vec3& p : mesh.positions) p = p * scale + offset;
    return mesh;
}

/// Turned by a fixed rotation about a skew axis, so that no face is along an axis.
inline Mesh skewed(Mesh mesh) {
    const DVec3 axis = glm::normalize(DVec3(1, 2, -3));
    const double c = std::cos(0.7), s = std::sin(0.7);
    const auto turn = [&](const Vec3& v) {
        const DVec3 d = v;
        return Vec3(d * c + glm::cross(axis, d) * s + axis * (glm::dot(axis, d) * (1 - c)));
    };
    for (Vec3& p : mesh.positions) p = turn(p);
    for (Vec3& n : mesh.normals) n = glm::normalize(turn(n));
    return mesh;
}

}  // namespace envbake::test
