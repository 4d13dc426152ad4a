// SPDX-License-Identifier: Apache-2.0
#include "shapes.h"

#include <algorithm>
#include <cstddef>
#include <numbers>

namespace envbake::sample {
namespace {

constexpr double kPi = std::numbers::pi;

double radians(double degrees) {
    return degrees * (kPi / 180);
}

std::array<float, 3> to_float(Vec3 v) {
    return {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
}

Vec3 to_double(const std::array<float, 3>& v) {
    return {v[0], v[1], v[2]};
}

void add_triangle(Mesh& mesh, std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    const Vec3 pa = to_double(mesh.positions[a]);
    const Vec3 ab = to_double(mesh.positions[b]) - pa, ac = to_double(mesh.positions[c]) - pa;
    const Vec3 area = cross(ab, ac);
    if (length(area) <= 1e-9 * (dot(ab, ab) + dot(ac, ac))) return;
    const Vec3 normal =
        to_double(mesh.normals[a]) + to_double(mesh.normals[b]) + to_double(mesh.normals[c]);
    if (dot(area, normal) < 0) std::swap(b, c);
    mesh.triangles.insert(mesh.triangles.end(), {a, b, c});
}

}  // namespace

void add_patch(Mesh& mesh, int rows, int columns, bool closed,
               const std::function<SurfaceSample(int, int)>& at) {
    const auto first = static_cast<std::uint32_t>(mesh.positions.size());
    const int stored = closed ? columns : columns + 1;
    for (int i = 0; i <= rows; ++i) {
        for (int j = 0; j < stored; ++j) {
            const SurfaceSample sample = at(i, j);
            mesh.positions.push_back(to_float(sample.position));
            mesh.normals.push_back(to_float(sample.normal));
        }
    }
    const auto vertex = [&](int i, int j) {
        return first + static_cast<std::uint32_t>(i * stored + j % stored);
    };
    for (int i = 0; i < rows; ++i) {
        for (int j = 0; j < columns; ++j) {
            add_triangle(mesh, vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1));
            add_triangle(mesh, vertex(i, j), vertex(i + 1, j + 1), vertex(i, j + 1));
        }
    }
}

Profile line(Vec3 a, Vec3 b, double step) {
    const Vec3 along = b - a;
    const double span = length(along);
    const int steps = std::max(1, static_cast<int>(std::ceil(span / step)));
    Profile profile;
    for (int i = 0; i <= steps; ++i) {
        const Vec3 p = a + (static_cast<double>(i) / steps) * along;
        profile.push_back({p.x, p.y, along.y / span, -along.x / span});
    }
    return profile;
}

Profile arc(Vec3 centre, double circle_radius, double from_deg, double to_deg, int steps,
            bool hollow) {
    Profile profile;
    for (int i = 0; i <= steps; ++i) {
        const double angle = radians(from_deg + (to_deg - from_deg) * i / steps);
        const double c = std::cos(angle), s = std::sin(angle), side = hollow ? -1 : 1;
        profile.push_back({std::max(0.0, centre.x + circle_radius * c),
                           centre.y + circle_radius * s, side * c, side * s});
    }
    return profile;
}

void add_lathe(Mesh& mesh, const Profile& profile, int segments, double from_deg, double to_deg) {
    const bool closed = to_deg - from_deg >= 360;
    add_patch(mesh, static_cast<int>(profile.size()) - 1, segments, closed, [&](int i, int j) {
        const ProfilePoint& p = profile[static_cast<std::size_t>(i)];
        const double phi = radians(from_deg + (to_deg - from_deg) * j / segments);
        const double c = std::cos(phi), s = std::sin(phi);
        return SurfaceSample{{p.radius * c, p.y, p.radius * s},
                             {p.normal_radius * c, p.normal_y, p.normal_radius * s}};
    });
}

Mesh make_sphere(double radius, int segments) {
    Mesh mesh;
    add_lathe(mesh, arc({0, 0, 0}, radius, -90, 90, segments / 2), segments);
    return mesh;
}

Mesh make_torus(double major, double minor, int segments, int sides) {
    Mesh mesh;
    add_lathe(mesh, arc({major, 0, 0}, minor, 0, 360, sides), segments);
    return mesh;
}

Mesh make_torus_knot(int p, int q, double major, double minor, double tube, int segments,
                     int sides) {
    // The knot runs on a torus about +Z; its frame leans on the torus's own normal, which turns
    // smoothly along the knot and meets itself again at the end.
    struct Frame {
        Vec3 centre, normal, binormal;
    };
    const auto frame = [&](int j) {
        const double t = 2 * kPi * j / segments;
        const double around = p * t, through = q * t;
        const double c = std::cos(around), s = std::sin(around);
        const double radius = major + minor * std::cos(through);
        const double d_radius = -minor * q * std::sin(through);
        const Vec3 tangent =
            normalize({d_radius * c - radius * p * s, d_radius * s + radius * p * c,
                       minor * q * std::cos(through)});
        const Vec3 torus_normal{std::cos(through) * c, std::cos(through) * s, std::sin(through)};
        const Vec3 normal = normalize(torus_normal - dot(torus_normal, tangent) * tangent);
        return Frame{
            {radius * c, radius * s, minor * std::sin(through)}, normal, cross(tangent, normal)};
    };
    Mesh mesh;
    // Rows go round the tube so that the closed direction of the patch is the knot itself.
    add_patch(mesh, sides, segments, true, [&](int i, int j) {
        const double angle = 2 * kPi * i / sides;
        const Frame f = frame(j);
        const Vec3 outwards = std::cos(angle) * f.normal + std::sin(angle) * f.binormal;
        return SurfaceSample{f.centre + tube * outwards, outwards};
    });
    return mesh;
}

Mesh make_rounded_box(Vec3 size, double edge_radius, int flat_steps, int round_steps) {
    // Where a face's grid leaves the inner box, the vector from the inner box to the grid point is
    // shortened to the edge radius; tan spacing makes equal angles of it.
    const auto coordinates = [&](double extent) {
        const double inner = extent / 2 - edge_radius;
        std::vector<double> at;
        for (int i = 0; i < round_steps; ++i)
            at.push_back(-inner -
                         edge_radius * std::tan(kPi / 4 * (round_steps - i) / round_steps));
        for (int i = 0; i <= flat_steps; ++i) at.push_back(inner * (2.0 * i / flat_steps - 1));
        for (int i = 1; i <= round_steps; ++i)
            at.push_back(inner + edge_radius * std::tan(kPi / 4 * i / round_steps));
        return at;
    };
    const std::vector<double> xs = coordinates(size.x), ys = coordinates(size.y),
                              zs = coordinates(size.z);
    const Vec3 inner{size.x / 2 - edge_radius, size.y / 2 - edge_radius, size.z / 2 - edge_radius};
    const auto rounded = [&](Vec3 p) {
        const Vec3 core{std::clamp(p.x, -inner.x, inner.x), std::clamp(p.y, -inner.y, inner.y),
                        std::clamp(p.z, -inner.z, inner.z)};
        const Vec3 outwards = normalize(p - core);
        return SurfaceSample{core + edge_radius * outwards, outwards};
    };
    const int steps = flat_steps + 2 * round_steps;
    const auto at = [](const std::vector<double>& v, int i) {
        return v[static_cast<std::size_t>(i)];
    };
    Mesh mesh;
    for (const double side : {-0.5, 0.5}) {
        add_patch(mesh, steps, steps, false, [&](int i, int j) {
            return rounded({side * size.x, at(ys, i), at(zs, j)});
        });
        add_patch(mesh, steps, steps, false, [&](int i, int j) {
            return rounded({at(xs, i), side * size.y, at(zs, j)});
        });
        add_patch(mesh, steps, steps, false, [&](int i, int j) {
            return rounded({at(xs, i), at(ys, j), side * size.z});
        });
    }
    return mesh;
}

}  // namespace envbake::sample
