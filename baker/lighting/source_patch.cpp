// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/source_patch.h"

#include "baker/math/quadrature.h"
#include "envbake/runtime/cube.h"

#include <algorithm>
#include <cmath>

namespace envbake::lighting {
namespace {

DVec3 vector(const std::array<double, 3>& w) {
    return {w[0], w[1], w[2]};
}

/// sin(x) / x
double sinc(double x) {
    return std::abs(x) < 1e-6 ? 1 - x * x / 6 : std::sin(x) / x;
}

SourcePatch lat_long_patch(const SourceRect& rect) {
    const double theta = (rect.a0 + rect.a1) / 2, half_theta = (rect.a1 - rect.a0) / 2;
    const double phi = (rect.b0 + rect.b1) / 2, half_phi = (rect.b1 - rect.b0) / 2;
    const double sin_theta = std::sin(theta), cos_theta = std::cos(theta);
    const double sin_phi = std::sin(phi), cos_phi = std::cos(phi);
    // Over the row: integral of sin, of sin^2 (as sin^2 of the middle and a remainder: no digits
    // are lost next to a pole), and of sin cos.
    const double sin_half = std::sin(half_theta), sin_two_half = std::sin(2 * half_theta);
    const double row_1 = 2 * sin_theta * sin_half;
    const double row_s = sin_theta * sin_theta * sin_two_half + (half_theta - sin_two_half / 2);
    const double row_c = sin_theta * cos_theta * sin_two_half;
    const double ring = row_s / row_1 * sinc(half_phi);

    SourcePatch patch;
    patch.omega = row_1 * 2 * half_phi;
    patch.centre = {ring * cos_phi, row_c / row_1, ring * sin_phi};
    patch.half_a = half_theta * DVec3{cos_theta * cos_phi, -sin_theta, cos_theta * sin_phi};
    patch.half_b = half_phi * sin_theta * DVec3{-sin_phi, 0, cos_phi};
    patch.bend = 2 * half_phi * std::abs(cos_theta);
    patch.taper = std::abs(cos_theta * sin_half) / (sin_theta * std::cos(half_theta));
    return patch;
}

SourcePatch cube_patch(const SourceRect& rect) {
    const auto face = static_cast<cube::Face>(rect.face);
    const double half_v = (rect.a1 - rect.a0) / 2, half_u = (rect.b1 - rect.b0) / 2;
    const double v = rect.a0 + half_v, u = rect.b0 + half_u;
    static const Quadrature kSmall = gauss_legendre(3), kLarge = gauss_legendre(12);
    const Quadrature& rule = std::max(half_u, half_v) < 0.1 ? kSmall : kLarge;

    SourcePatch patch;
    patch.omega = cube::solid_angle(rect.b0, rect.b1, rect.a0, rect.a1);
    double omega = 0;
    for (std::size_t i = 0; i < rule.nodes.size(); ++i) {
        for (std::size_t j = 0; j < rule.nodes.size(); ++j) {
            const double ui = u + half_u * rule.nodes[i], vj = v + half_v * rule.nodes[j];
            const double r2 = 1 + ui * ui + vj * vj;
            const double weight = rule.weights[i] * rule.weights[j] / (r2 * std::sqrt(r2));
            patch.centre += weight / std::sqrt(r2) * vector(cube::point(face, ui, vj));
            omega += weight;
        }
    }
    patch.centre /= omega;
    // d/du of p / |p|, p = point(u, v): (p' - w (w . p')) / |p|.
    const DVec3 w = vector(cube::direction(face, u, v));
    const DVec3 origin = vector(cube::point(face, 0.0, 0.0));
    const DVec3 along_u = vector(cube::point(face, 1.0, 0.0)) - origin;
    const DVec3 along_v = vector(cube::point(face, 0.0, 1.0)) - origin;
    const double inverse = 1 / std::sqrt(1 + u * u + v * v);
    patch.half_a = half_v * inverse * (along_v - w * glm::dot(w, along_v));
    patch.half_b = half_u * inverse * (along_u - w * glm::dot(w, along_u));
    patch.taper = (std::abs(u) * half_u + std::abs(v) * half_v) / (1 + u * u + v * v);
    return patch;
}

}  // namespace

DVec3 SourceRect::towards(double s, double t) const {
    const double a = a0 + s * (a1 - a0), b = b0 + t * (b1 - b0);
    if (face >= 0) return vector(cube::direction(static_cast<cube::Face>(face), b, a));
    return {std::sin(a) * std::cos(b), std::cos(a), std::sin(a) * std::sin(b)};
}

DVec2 SourceRect::sides() const {
    if (face >= 0) {
        const double u = std::clamp(0.0, b0, b1), v = std::clamp(0.0, a0, a1);
        const double r2 = 1 + u * u + v * v;
        return {(a1 - a0) * std::sqrt(1 + u * u) / r2, (b1 - b0) * std::sqrt(1 + v * v) / r2};
    }
    const double half_pi = std::acos(0.0);
    return {a1 - a0, (b1 - b0) * std::sin(std::clamp(half_pi, a0, a1))};
}

SourcePatch make_patch(const SourceRect& rect) {
    SourcePatch patch = rect.face < 0 ? lat_long_patch(rect) : cube_patch(rect);
    const DVec2 sides = rect.sides();
    patch.extent = std::max(sides.x, sides.y);
    patch.aspect = patch.extent / std::min(sides.x, sides.y);
    // 1 - |c|^2 has no digits left for a tiny patch; its sides have.
    patch.variance =
        patch.extent < 1e-3
            ? (glm::dot(patch.half_a, patch.half_a) + glm::dot(patch.half_b, patch.half_b)) / 6
            : (1 - glm::dot(patch.centre, patch.centre)) / 2;
    return patch;
}

SourceRect block_rect(const LatLongGrid& grid, int row0, int row1, int column0, int column1) {
    const auto at = [](const std::vector<double>& edges, int i) {
        return edges[static_cast<std::size_t>(i)];
    };
    return {-1, at(grid.theta_edges, row0), at(grid.theta_edges, row1), at(grid.phi_edges, column0),
            at(grid.phi_edges, column1)};
}

SourceRect block_rect(const CubeGrid& grid, int face, int row0, int row1, int column0,
                      int column1) {
    const auto at = [&](int i) { return grid.edges[static_cast<std::size_t>(i)]; };
    return {face, at(row0), at(row1), at(column0), at(column1)};
}

}  // namespace envbake::lighting
