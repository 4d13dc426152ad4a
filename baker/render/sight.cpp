// SPDX-License-Identifier: Apache-2.0
#include "baker/render/sight.h"

#include "baker/core/random.h"
#include "baker/trace/occluders.h"

#include <algorithm>
#include <cmath>

namespace envbake {
namespace {

constexpr int kMaxLayers = 32;
constexpr int kMaxSteps = 256;  // surfaces passed, hidden back faces included
constexpr std::uint64_t kPixelStream = 0x7069786c;
constexpr double kLeastCosine = 1e-3;

double largest(const DVec3& v) {
    return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
}

/// How far from a triangle a ray must start so as not to meet it again: 4 spacings of the floats
/// that its origin is rounded to, or 1e-6 of the triangle's size, since the error of a distance
/// to its plane grows with that.
double clearance(const Triangle& t, const DVec3& position, const TraceSpace& space) {
    const double size =
        std::max(largest(DVec3(t.b) - DVec3(t.a)), largest(DVec3(t.c) - DVec3(t.a)));
    return std::max(4 * space.resolution_at(position), 1e-6 * size);
}

DVec3 interpolated_normal(const Mesh& mesh, std::size_t triangle, const DVec3& weights,
                          const DVec3& face_normal) {
    DVec3 sum(0);
    for (std::size_t k = 0; k < 3; ++k) {
        sum += weights[static_cast<int>(k)] * DVec3(mesh.normals[mesh.triangles[3 * triangle + k]]);
    }
    const double length = glm::length(sum);
    return length > 1e-6 ? sum / length : face_normal;
}

}  // namespace

SurfaceMaterial white_material(const SurfaceMaterial& material) {
    SurfaceMaterial white;
    white.alpha = material.alpha;
    white.base_color = Vec3(1);
    white.metallic = 0;
    white.r0 = Vec3(0);
    white.emission = Vec3(0);
    return white;
}

void look_along(const Scene& scene, const Tracer& tracer, const DVec3& origin,
                const DVec3& direction, Sight& sight) {
    sight.layers.clear();
    sight.background = 1;
    DVec3 from = origin;
    for (int step = 0; step < kMaxSteps; ++step) {
        const auto hit = tracer.closest(from, direction);
        if (!hit) return;
        const Mesh& mesh = scene.meshes[hit->mesh];
        const Material& material = scene.materials[static_cast<std::size_t>(mesh.material)];
        const Triangle triangle = triangle_of(mesh, hit->triangle);
        const double u = static_cast<double>(hit->u), v = static_cast<double>(hit->v);
        const DVec3 weights(1 - u - v, u, v);
        const DVec3 position = weights.x * DVec3(triangle.a) + weights.y * DVec3(triangle.b) +
                               weights.z * DVec3(triangle.c);
        const double gap = clearance(triangle, position, tracer.space());
        DVec3 face_normal(hit->geometric_normal);
        const bool from_behind = glm::dot(face_normal, direction) > 0;
        if (from_behind) face_normal = -face_normal;
        from = position - gap * face_normal;  // beyond this triangle, should the ray go on
        if (from_behind && !material.double_sided) continue;

        Layer layer;
        SurfacePoint& point = layer.point;
        point.material = surface_material(scene, mesh, hit->triangle, Vec3(weights));
        const float alpha = material.alpha_mode == AlphaMode::Blend ? point.material.alpha : 1.0f;
        if (alpha <= 0) continue;
        point.mesh = hit->mesh;
        point.triangle = hit->triangle;
        point.barycentric = Vec3(weights);
        point.to_viewer = -direction;
        point.normal = interpolated_normal(mesh, hit->triangle, weights,
                                           from_behind ? -face_normal : face_normal);
        if (from_behind) point.normal = -point.normal;
        point.specular_normal = point.normal;
        const double cosine = glm::dot(point.normal, point.to_viewer);
        if (cosine < kLeastCosine) {
            point.specular_normal =
                glm::normalize(point.normal + (kLeastCosine - cosine) * point.to_viewer);
        }
        point.light_origin = position + gap * face_normal;
        layer.weight = sight.background * alpha;
        sight.layers.push_back(layer);
        sight.background *= 1 - alpha;
        if (sight.background <= 1e-4f || sight.layers.size() == kMaxLayers) {
            sight.background = 0;
            return;
        }
    }
    sight.background = 0;
}

void pixel_points(const Camera& camera, int x, int y, int per_axis, std::vector<DVec2>& points) {
    const auto pixel = static_cast<std::uint64_t>(y) * static_cast<std::uint64_t>(camera.width) +
                       static_cast<std::uint64_t>(x);
    RandomStream random(0, kPixelStream, pixel);
    points.clear();
    for (int j = 0; j < per_axis; ++j) {
        for (int i = 0; i < per_axis; ++i) {
            const double dx = random.next(), dy = random.next();
            points.emplace_back(x + (i + dx) / per_axis, y + (j + dy) / per_axis);
        }
    }
}

}  // namespace envbake
