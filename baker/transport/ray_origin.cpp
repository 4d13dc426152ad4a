// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/ray_origin.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

namespace envbake {

namespace {

using Key = std::array<std::uint32_t, 6>;

Key key_of(const Mesh& mesh, std::size_t vertex) {
    const Vec3 &p = mesh.positions[vertex], &n = mesh.normals[vertex];
    const auto bits = [](float x) { return std::bit_cast<std::uint32_t>(x + 0.0f); };  // -0 to 0
    return {bits(p.x), bits(p.y), bits(p.z), bits(n.x), bits(n.y), bits(n.z)};
}

std::uint64_t hash(const Key& key) {
    std::uint64_t h = 0;
    for (const std::uint32_t word : key) {
        h = (h ^ word) * 0x9e3779b97f4a7c15u;
        h ^= h >> 29;
    }
    return h;
}

bool has_normal(const Vec3& n) {
    const double square = glm::dot(DVec3(n), DVec3(n));
    return square > 1e-12 && std::isfinite(square);
}

/// The normal of a thinner triangle is noise: its height is below 1e-6 of its longest edge.
constexpr double kThinnest = 1e-6;

}  // namespace

SurfacePoints::SurfacePoints(const Mesh& mesh) : mesh_(mesh) {
    weld();
    collect_triangles();
}

/// Open addressing over vertex indices, half full at most.
void SurfacePoints::weld() {
    const std::size_t count = mesh_.vertex_count();
    representative_.assign(count, kNone);
    const std::size_t slot_count = std::bit_ceil(2 * count + 1);
    std::vector<std::uint32_t> slots(slot_count, kNone);
    for (std::uint32_t vertex = 0; vertex < count; ++vertex) {
        if (!has_normal(mesh_.normals[vertex])) continue;
        const Key key = key_of(mesh_, vertex);
        std::size_t slot = hash(key) & (slot_count - 1);
        while (slots[slot] != kNone && key_of(mesh_, slots[slot]) != key)
            slot = (slot + 1) & (slot_count - 1);
        if (slots[slot] == kNone) slots[slot] = vertex;
        representative_[vertex] = slots[slot];
    }
}

/// Which triangles meet at each representative, by counting first and filling then. A vertex that
/// no triangle with an area uses, nor any vertex equal to it, is taken off the surface.
void SurfacePoints::collect_triangles() {
    const std::size_t count = mesh_.vertex_count();
    first_.assign(count + 1, 0);
    const auto for_each_corner = [&](const auto& visit) {
        for (std::uint32_t i = 0; i < mesh_.triangle_count(); ++i) {
            if (!has_area(triangle_of(mesh_, i))) continue;
            std::array<std::uint32_t, 3> at;
            for (std::size_t corner = 0; corner < 3; ++corner)
                at[corner] = representative_[mesh_.triangles[3 * std::size_t{i} + corner]];
            for (const std::uint32_t place : at)
                if (place != kNone) visit(place, i);
        }
    };
    for_each_corner([&](std::uint32_t place, std::uint32_t) { ++first_[place + 1]; });
    for (std::size_t i = 0; i < count; ++i) first_[i + 1] += first_[i];
    triangles_.resize(first_.back());
    std::vector<std::uint32_t> next(first_.begin(), first_.end() - 1);
    for_each_corner(
        [&](std::uint32_t place, std::uint32_t triangle) { triangles_[next[place]++] = triangle; });
    for (std::uint32_t& place : representative_)
        if (place != kNone && triangles_at(place).empty()) place = kNone;
}

std::span<const std::uint32_t> SurfacePoints::triangles_at(std::uint32_t representative) const {
    return std::span(triangles_)
        .subspan(first_[representative], first_[representative + 1] - first_[representative]);
}

RayOrigin SurfacePoints::origin(std::uint32_t representative, const TraceSpace& space) const {
    const DVec3 p = mesh_.positions[representative];
    const DVec3 n = glm::normalize(DVec3(mesh_.normals[representative]));

    DVec3 normal_sum(0), centroid_sum(0);  // weighted by area; centroids from p
    double area_sum = 0, extent = 0;
    for (const std::uint32_t i : triangles_at(representative)) {
        const Triangle t = triangle_of(mesh_, i);
        const DVec3 a = DVec3(t.a) - p, b = DVec3(t.b) - p, c = DVec3(t.c) - p;
        const DVec3 cross = t.cross();
        const double area = glm::length(cross);
        normal_sum += cross;
        centroid_sum += (a + b + c) / 3.0 * area;
        area_sum += area;
        extent = std::max({extent, glm::length(a), glm::length(b), glm::length(c)});
    }
    // Triangles wound against the shading normal are seen from their back.
    const double side = glm::dot(normal_sum, n) < 0 ? -1 : 1;
    const double normal_length = glm::length(normal_sum);
    const DVec3 g = normal_length > 1e-6 * area_sum ? normal_sum * (side / normal_length) : n;

    const double lift = std::max(4 * space.resolution_at(p), 1e-6 * extent);
    const double inset = std::min(std::max(1e-4 * extent, 64 * lift), extent / 4);
    DVec3 inwards = centroid_sum / area_sum;
    inwards -= g * glm::dot(g, inwards);
    DVec3 moved = inwards * (inset / extent);

    double up = lift;
    for (const std::uint32_t i : triangles_at(representative)) {
        const Triangle t = triangle_of(mesh_, i);
        const DVec3 cross = t.cross();
        const double area = glm::length(cross);
        const DVec3 a = t.a, b = t.b, c = t.c;
        const double edge =
            std::max({glm::distance(a, b), glm::distance(b, c), glm::distance(c, a)});
        if (area <= kThinnest * edge * edge) continue;
        const DVec3 n_f = cross * (side / area);
        const double rise = glm::dot(n_f, g);
        if (rise > 0.05) up = std::max(up, (lift - glm::dot(n_f, moved)) / rise);
    }
    return {p + moved + g * up, n};
}

}  // namespace envbake
