// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/ray_origin.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <tuple>

namespace envbake {

namespace {

using Key = std::array<std::uint32_t, 6>;

Key key_of(const Vec3& p, const Vec3& n) {
    const auto bits = [](float x) { return std::bit_cast<std::uint32_t>(x + 0.0f); };  // -0 to 0
    return {bits(p.x), bits(p.y), bits(p.z), bits(n.x), bits(n.y), bits(n.z)};
}

Key key_of(const Mesh& mesh, std::size_t vertex) {
    return key_of(mesh.positions[vertex], mesh.normals[vertex]);
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

/// A triangle as seen from one of its corners.
struct Corner {
    DVec3 cross;           ///< along the normal by winding, twice the area long
    double area;           ///< twice the area
    DVec3 bisector;        ///< unit, from the corner into the triangle
    double angle_rad;      ///< at the corner
    double longest_edge;   ///< of the two that leave the corner
    double opposite_edge;  ///< length

    /// An order of their own for sums: two that are equal here are equal in all that is summed.
    bool operator<(const Corner& o) const {
        const auto key = [](const Corner& c) {
            return std::tie(c.cross.x, c.cross.y, c.cross.z, c.bisector.x, c.bisector.y,
                            c.bisector.z, c.longest_edge, c.opposite_edge, c.angle_rad);
        };
        return key(*this) < key(o);
    }
};

Corner corner_at(const Triangle& t, const DVec3& p) {
    DVec3 a = t.a, b = t.b, c = t.c;  // turned until a is the corner
    for (int i = 0; i < 2 && a != p; ++i) {
        const DVec3 first = a;
        a = b;
        b = c;
        c = first;
    }
    const double ab = glm::distance(a, b), ac = glm::distance(a, c);
    const DVec3 along_b = (b - a) / ab, along_c = (c - a) / ac;
    Corner corner;
    corner.cross = glm::cross(b - a, c - a);
    corner.area = glm::length(corner.cross);
    corner.angle_rad = std::atan2(corner.area, glm::dot(b - a, c - a));
    const DVec3 sum = along_b + along_c;
    corner.bisector = sum / std::max(glm::length(sum), 1e-30);
    corner.longest_edge = std::max(ab, ac);
    corner.opposite_edge = glm::distance(b, c);
    return corner;
}

/// The normal of such a triangle is noise: its height is below 1e-6 of its longest edge.
bool is_thin(const Corner& corner) {
    const double edge = std::max(corner.longest_edge, corner.opposite_edge);
    return corner.area <= 1e-6 * edge * edge;
}

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

    thread_local std::vector<Corner> corners;
    corners.clear();
    for (const std::uint32_t i : triangles_at(representative))
        corners.push_back(corner_at(triangle_of(mesh_, i), p));
    std::sort(corners.begin(), corners.end());

    DVec3 normal_sum(0);   // weighted by area
    DVec3 inwards_sum(0);  // integral of the unit directions over the angles at p
    double area_sum = 0, angle_sum = 0, extent = 0;
    double room = std::numeric_limits<double>::infinity();  // from p to the nearest opposite edge
    for (const Corner& corner : corners) {
        normal_sum += corner.cross;
        area_sum += corner.area;
        inwards_sum += corner.bisector * (2 * std::sin(corner.angle_rad / 2));
        angle_sum += corner.angle_rad;
        extent = std::max(extent, corner.longest_edge);
        if (!is_thin(corner)) room = std::min(room, corner.area / corner.opposite_edge);
    }
    // Triangles wound against the shading normal are seen from their back.
    const double side = glm::dot(normal_sum, n) < 0 ? -1 : 1;
    const double normal_length = glm::length(normal_sum);
    const DVec3 g = normal_length > 1e-6 * area_sum ? normal_sum * (side / normal_length) : n;

    const double lift = std::max(4 * space.resolution_at(p), 1e-6 * extent);
    const double inset = std::min(std::max(1e-4 * extent, 64 * lift), room / 4);
    DVec3 moved = angle_sum > 0 ? inwards_sum * (std::min(inset, extent) / angle_sum) : DVec3(0);
    moved -= g * glm::dot(g, moved);

    double up = lift;
    for (const Corner& corner : corners) {
        if (is_thin(corner)) continue;
        const DVec3 n_f = corner.cross * (side / corner.area);
        const double rise = glm::dot(n_f, g);
        if (rise > 0.05) up = std::max(up, (lift - glm::dot(n_f, moved)) / rise);
    }
    return {p + moved + g * up, n};
}

std::uint64_t SurfacePoints::stream(std::uint32_t representative, const TraceSpace& space) const {
    return hash(
        key_of(space.to_local(mesh_.positions[representative]), mesh_.normals[representative]));
}

}  // namespace envbake
