// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/lamps.h"

#include "baker/input/sample_texture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace envbake {

namespace {

using Corners = std::array<DVec3, 3>;

/// 1/pi integral of max(0, n.w) over a triangle seen from 0, the part of it above the horizon:
///
///     1/2pi sum over edges of angle * n.cross / |cross|
///
/// Source: Lambert 1760; the derivation in [Arvo95], section 2.
double form_factor(const Corners& triangle, const DVec3& n) {
    std::array<DVec3, 4> above;
    std::size_t count = 0;
    for (std::size_t i = 0; i < 3; ++i) {
        const DVec3 &a = triangle[i], &b = triangle[(i + 1) % 3];
        const double height_a = glm::dot(a, n), height_b = glm::dot(b, n);
        if (height_a > 0) above[count++] = a;
        if (height_a * height_b < 0)
            above[count++] = a + (b - a) * (height_a / (height_a - height_b));
    }
    double sum = 0;
    for (std::size_t i = 0; i < count; ++i) {
        const DVec3 &a = above[i], &b = above[(i + 1) % count];
        const DVec3 cross = glm::cross(a, b);
        const double length = glm::length(cross);
        if (length > 0) sum += std::atan2(length, glm::dot(a, b)) * glm::dot(cross, n) / length;
    }
    return std::abs(sum) / (2 * std::numbers::pi);
}

/// Uniform over a triangle's barycentric coordinates. Source: [Heitz19], "A Low-Distortion Map
/// Between Triangle and Square".
Vec3 barycentric(double x, double y) {
    if (y > x) {
        x /= 2;
        y -= x;
    } else {
        y /= 2;
        x -= y;
    }
    return {static_cast<float>(1 - x - y), static_cast<float>(x), static_cast<float>(y)};
}

}  // namespace

Lamps::Lamps(const Scene& scene) {
    for (std::uint32_t m = 0; m < scene.meshes.size(); ++m) {
        const Mesh& mesh = scene.meshes[m];
        if (scene.materials[static_cast<std::size_t>(mesh.material)].emission == Vec3(0)) continue;
        for (std::uint32_t t = 0; t < mesh.triangle_count(); ++t) {
            if (triangles_.size() == kMostTriangles) {
                triangles_.clear();
                return;
            }
            triangles_.push_back({m, t});
        }
    }
}

Vec3 Lamps::light(const Scene& scene, const Tracer& tracer, const RayOrigin& origin,
                  RandomStream& random) const {
    DVec3 sum(0);
    for (const Triangle& lamp : triangles_) {
        const Mesh& mesh = scene.meshes[lamp.mesh];
        Corners corners;
        for (std::size_t k = 0; k < 3; ++k)
            corners[k] = DVec3(mesh.positions[mesh.triangles[3 * std::size_t{lamp.triangle} + k]]) -
                         origin.position;
        const double shift_x = random.next(), shift_y = random.next();
        const DVec3 normal = glm::cross(corners[1] - corners[0], corners[2] - corners[0]);
        const bool from_front = glm::dot(normal, corners[0]) < 0;
        if (!from_front && !scene.materials[static_cast<std::size_t>(mesh.material)].double_sided)
            continue;
        const double factor = form_factor(corners, origin.normal);
        if (!(factor > 1e-9)) continue;

        DVec3 sent(0);
        double weights = 0;
        int seen = 0, asked = 0;
        const auto ask_sixteen = [&] {
            DirectionPacket towards;
            std::array<Vec3, 16> at;
            for (std::size_t i = 0; i < 16; ++i) {
                // The R2 sequence, [Roberts18].
                const double k = asked + static_cast<double>(i);
                at[i] = barycentric(std::fmod(shift_x + k * 0.75487766624669276, 1.0),
                                    std::fmod(shift_y + k * 0.56984029099805327, 1.0));
                DVec3 w(0);
                for (int c = 0; c < 3; ++c)
                    w += static_cast<double>(at[i][c]) * corners[static_cast<std::size_t>(c)];
                towards.x[i] = static_cast<float>(w.x);
                towards.y[i] = static_cast<float>(w.y);
                towards.z[i] = static_cast<float>(w.z);
            }
            HitPacket hits;
            const std::uint32_t met = tracer.closest16(origin.position, towards, hits);
            for (std::size_t i = 0; i < 16; ++i) {
                const DVec3 w(towards.x[i], towards.y[i], towards.z[i]);
                const double r2 = glm::dot(w, w);
                const double weight = std::max(0.0, glm::dot(w, origin.normal)) *
                                      std::abs(glm::dot(w, normal)) / (r2 * r2);
                weights += weight;
                const bool visible = (met >> i & 1) != 0 && hits.mesh[i] == lamp.mesh &&
                                     hits.triangle[i] == lamp.triangle;
                if (!visible) continue;
                ++seen;
                sent +=
                    weight * DVec3(surface_material(scene, mesh, lamp.triangle, at[i]).emission);
            }
            asked += 16;
        };
        ask_sixteen();
        if (seen != 0 && seen != asked)
            for (int more = 0; more < 3; ++more) ask_sixteen();
        if (weights > 0) sum += factor / weights * sent;
    }
    return Vec3(sum);
}

}  // namespace envbake
