// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/source_patch.h"

#include "baker/math/quadrature.h"
#include "envbake/runtime/cube.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace envbake::lighting {
namespace {

DVec3 vector(const std::array<double, 3>& w) {
    return {w[0], w[1], w[2]};
}

/// An angle by its sine and cosine.
struct Angle {
    double sine, cosine;

    /// Of an angle in [0, pi].
    Angle halved() const {
        if (cosine < 0) {
            const double s = std::sqrt((1 - cosine) / 2);
            return {s, sine / (2 * s)};
        }
        const double c = std::sqrt((1 + cosine) / 2);
        return {sine / (2 * c), c};
    }
    friend Angle operator+(const Angle& a, const Angle& b) {
        return {a.sine * b.cosine + a.cosine * b.sine, a.cosine * b.cosine - a.sine * b.sine};
    }
    friend Angle operator-(const Angle& a, const Angle& b) { return a + Angle{-b.sine, b.cosine}; }
};

ThetaTerms theta_terms_of(double half_rad, const Angle& middle, const Angle& half) {
    // Integral of sin^2 as that of the middle and a remainder: no digits are lost next to a pole.
    const double integral = 2 * middle.sine * half.sine;
    const double sin_two_half = 2 * half.sine * half.cosine;
    const double of_sin2 = middle.sine * middle.sine * sin_two_half + (half_rad - sin_two_half / 2);
    const Angle first = middle - half, last = middle + half;
    const double widest = last.cosine >= 0 ? last.sine : first.cosine <= 0 ? first.sine : 1;
    return {.half = half_rad,
            .sine = middle.sine,
            .cosine = middle.cosine,
            .sin_half = half.sine,
            .cos_half = half.cosine,
            .integral = integral,
            .ring = of_sin2 / integral,
            .height = middle.cosine * half.cosine,
            .widest = widest,
            .taper = std::abs(middle.cosine * half.sine) / (middle.sine * half.cosine)};
}

PhiTerms phi_terms_of(double half_rad, const Angle& middle, const Angle& half) {
    return {half_rad, middle.sine, middle.cosine, half.sine, half.cosine, half.sine / half_rad};
}

/// What follows from the sides of a patch.
void finish(double side_a, double side_b, SourcePatch& patch) {
    patch.extent = std::max(side_a, side_b);
    patch.aspect = patch.extent / std::min(side_a, side_b);
    // 1 - |c|^2 has no digits left for a tiny patch; its sides have.
    patch.variance =
        patch.extent < 1e-3
            ? (glm::dot(patch.half_a, patch.half_a) + glm::dot(patch.half_b, patch.half_b)) / 6
            : (1 - glm::dot(patch.centre, patch.centre)) / 2;
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
    const double quarter = std::numbers::pi / 2;
    return {a1 - a0, (b1 - b0) * std::sin(std::clamp(quarter, a0, a1))};
}

ThetaTerms theta_terms(double theta0, double theta1) {
    const double middle = (theta0 + theta1) / 2, half = (theta1 - theta0) / 2;
    return theta_terms_of(half, {std::sin(middle), std::cos(middle)},
                          {std::sin(half), std::cos(half)});
}

PhiTerms phi_terms(double phi0, double phi1) {
    const double middle = (phi0 + phi1) / 2, half = (phi1 - phi0) / 2;
    return phi_terms_of(half, {std::sin(middle), std::cos(middle)},
                        {std::sin(half), std::cos(half)});
}

DVec2 TexelPart::sides() const {
    if (rect_.face >= 0) return rect_.sides();
    return {2 * theta_.half, 2 * phi_.half * theta_.widest};
}

std::array<TexelPart, 2> TexelPart::halves_along_a() const {
    if (rect_.face >= 0) {
        std::array parts{*this, *this};
        parts[0].rect_.a1 = parts[1].rect_.a0 = (rect_.a0 + rect_.a1) / 2;
        return parts;
    }
    const Angle middle{theta_.sine, theta_.cosine};
    const Angle quarter = Angle{theta_.sin_half, theta_.cos_half}.halved();
    return {TexelPart(theta_terms_of(theta_.half / 2, middle - quarter, quarter), phi_),
            TexelPart(theta_terms_of(theta_.half / 2, middle + quarter, quarter), phi_)};
}

std::array<TexelPart, 2> TexelPart::halves_along_b() const {
    if (rect_.face >= 0) {
        std::array parts{*this, *this};
        parts[0].rect_.b1 = parts[1].rect_.b0 = (rect_.b0 + rect_.b1) / 2;
        return parts;
    }
    const Angle middle{phi_.sine, phi_.cosine};
    const Angle quarter = Angle{phi_.sin_half, phi_.cos_half}.halved();
    return {TexelPart(theta_, phi_terms_of(phi_.half / 2, middle - quarter, quarter)),
            TexelPart(theta_, phi_terms_of(phi_.half / 2, middle + quarter, quarter))};
}

SourcePatch make_patch(const ThetaTerms& theta, const PhiTerms& phi) {
    const double ring = theta.ring * phi.shortening;
    SourcePatch patch;
    patch.omega = theta.integral * 2 * phi.half;
    patch.centre = {ring * phi.cosine, theta.height, ring * phi.sine};
    patch.half_a =
        theta.half * DVec3{theta.cosine * phi.cosine, -theta.sine, theta.cosine * phi.sine};
    patch.half_b = phi.half * theta.sine * DVec3{-phi.sine, 0, phi.cosine};
    patch.bend = 2 * phi.half * std::abs(theta.cosine);
    patch.taper = theta.taper;
    finish(2 * theta.half, 2 * phi.half * theta.widest, patch);
    return patch;
}

SourcePatch make_patch(const SourceRect& rect) {
    if (rect.face < 0) {
        return make_patch(theta_terms(rect.a0, rect.a1), phi_terms(rect.b0, rect.b1));
    }
    SourcePatch patch = cube_patch(rect);
    const DVec2 sides = rect.sides();
    finish(sides.x, sides.y, patch);
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
