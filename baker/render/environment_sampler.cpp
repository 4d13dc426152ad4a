// SPDX-License-Identifier: Apache-2.0
#include "baker/render/environment_sampler.h"

#include "envbake/runtime/cube.h"
#include "envbake/runtime/lat_long.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <variant>

namespace envbake {
namespace {

/// The interval [edges[i], edges[i + 1]) that holds `value`, which is cut to the range of edges.
std::size_t interval_of(const double* edges, std::size_t count, double value) {
    const double* const above = std::upper_bound(edges + 1, edges + count, value);
    return static_cast<std::size_t>(above - (edges + 1));
}

double lerp(double a, double b, double t) {
    return a + t * (b - a);
}

}  // namespace

EnvironmentSampler::EnvironmentSampler(const Environment& environment, const LightTurn& turn)
    : environment_(environment), turn_(turn) {
    if (const auto* lat_long = std::get_if<LatLongGrid>(&environment.grid)) {
        rows_ = static_cast<std::size_t>(lat_long->height);
        columns_ = static_cast<std::size_t>(lat_long->width);
    } else {
        columns_ = static_cast<std::size_t>(std::get<CubeGrid>(environment.grid).size);
        rows_ = 6 * columns_;
    }
    row_cdf_.reserve(rows_ + 1);
    column_cdf_.reserve(rows_ * (columns_ + 1));
    row_cdf_.push_back(0);
    for (std::size_t row = 0; row < rows_; ++row) {
        double sum = 0;
        column_cdf_.push_back(0);
        for (std::size_t column = 0; column < columns_; ++column) {
            sum += luminance(DVec3(environment.radiance[row * columns_ + column])) *
                   solid_angle({row, column});
            column_cdf_.push_back(sum);
        }
        total_ += sum;
        row_cdf_.push_back(total_);
    }
}

double EnvironmentSampler::solid_angle(const Texel& texel) const {
    if (const auto* grid = std::get_if<LatLongGrid>(&environment_.grid)) {
        return (grid->phi_edges[texel.column + 1] - grid->phi_edges[texel.column]) *
               (std::cos(grid->theta_edges[texel.row]) -
                std::cos(grid->theta_edges[texel.row + 1]));
    }
    const auto& edges = std::get<CubeGrid>(environment_.grid).edges;
    const std::size_t row = texel.row % columns_;
    return cube::solid_angle(edges[texel.column], edges[texel.column + 1], edges[row],
                             edges[row + 1]);
}

EnvironmentSampler::Texel EnvironmentSampler::texel_of(const DVec3& w) const {
    constexpr double kTurn = 2 * std::numbers::pi;
    if (const auto* grid = std::get_if<LatLongGrid>(&environment_.grid)) {
        const double theta = std::atan2(std::hypot(w.x, w.z), w.y);
        const double first = grid->phi_edges.front();
        double phi = std::atan2(w.z, w.x) - first;
        phi = first + (phi - kTurn * std::floor(phi / kTurn));
        return {interval_of(grid->theta_edges.data(), rows_, theta),
                interval_of(grid->phi_edges.data(), columns_, phi)};
    }
    const auto& edges = std::get<CubeGrid>(environment_.grid).edges;
    const auto at = cube::project(std::array<double, 3>{w.x, w.y, w.z});
    return {
        static_cast<std::size_t>(at.face) * columns_ + interval_of(edges.data(), columns_, at.v),
        interval_of(edges.data(), columns_, at.u)};
}

// A texel of weight luminance * dOmega is picked with probability weight / total. Over a lat-long
// texel the direction is spread evenly in solid angle: the density is luminance / total. Over a
// cube texel it is spread evenly in (u, v), where dw = du dv / (1 + u^2 + v^2)^(3/2).
double EnvironmentSampler::pdf(const Texel& texel, const DVec3& w) const {
    if (!(total_ > 0)) return 0;
    const double even =
        luminance(DVec3(environment_.radiance[texel.row * columns_ + texel.column])) / total_;
    if (std::holds_alternative<LatLongGrid>(environment_.grid)) return even;
    const auto& edges = std::get<CubeGrid>(environment_.grid).edges;
    const std::size_t row = texel.row % columns_;
    const double area =
        (edges[texel.column + 1] - edges[texel.column]) * (edges[row + 1] - edges[row]);
    const double largest = std::max({std::abs(w.x), std::abs(w.y), std::abs(w.z)});
    const double uv_per_steradian = 1 / (largest * largest * largest);  // |(u, v, 1)| = 1 / largest
    return even * solid_angle(texel) / area * uv_per_steradian;
}

EnvironmentSampler::Light EnvironmentSampler::sample(double u0, double u1) const {
    if (!(total_ > 0)) return {};
    // Invert a cumulative array; what is left of u is the position inside the interval.
    const auto invert = [](const double* cdf, std::size_t count, double u, double& rest) {
        const double target = u * cdf[count];
        std::size_t i = interval_of(cdf, count, target);
        while (i > 0 && !(cdf[i + 1] > cdf[i])) --i;  // rounding must not pick a black texel
        rest = std::clamp((target - cdf[i]) / (cdf[i + 1] - cdf[i]), 0.0, 1.0);
        return i;
    };
    double v_rest = 0, u_rest = 0;
    const std::size_t row = invert(row_cdf_.data(), rows_, u0, v_rest);
    const std::size_t column =
        invert(column_cdf_.data() + row * (columns_ + 1), columns_, u1, u_rest);
    Light light;
    if (const auto* grid = std::get_if<LatLongGrid>(&environment_.grid)) {
        const double cos_theta =
            lerp(std::cos(grid->theta_edges[row]), std::cos(grid->theta_edges[row + 1]), v_rest);
        const double sin_theta = std::sqrt(std::max(0.0, 1 - cos_theta * cos_theta));
        const double phi = lerp(grid->phi_edges[column], grid->phi_edges[column + 1], u_rest);
        light.direction = {sin_theta * std::cos(phi), cos_theta, sin_theta * std::sin(phi)};
    } else {
        const auto& edges = std::get<CubeGrid>(environment_.grid).edges;
        const std::size_t face_row = row % columns_;
        const auto w = cube::direction(static_cast<cube::Face>(row / columns_),
                                       lerp(edges[column], edges[column + 1], u_rest),
                                       lerp(edges[face_row], edges[face_row + 1], v_rest));
        light.direction = {w[0], w[1], w[2]};
    }
    light.radiance = environment_.radiance[row * columns_ + column];
    light.pdf = pdf({row, column}, light.direction);
    light.direction = turn_.turned(light.direction);
    return light;
}

EnvironmentSampler::Light EnvironmentSampler::towards(const DVec3& w) const {
    const DVec3 baked = turn_.back(w);
    const Texel texel = texel_of(baked);
    return {w, environment_.radiance[texel.row * columns_ + texel.column], pdf(texel, baked)};
}

}  // namespace envbake
