// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/sampled_sh.h"

#include "baker/core/parallel.h"
#include "baker/math/quadrature.h"
#include "envbake/runtime/lat_long.h"
#include "envbake/runtime/sh.h"

#include <array>
#include <cmath>
#include <cstddef>

namespace envbake::bench {
namespace {

double ring_height(const LatLongGrid& grid, std::size_t row) {
    return std::cos(grid.theta_edges[row]) - std::cos(grid.theta_edges[row + 1]);
}

/// Sum of L Y density(row, theta) over the points of `rule` in every texel, either way.
template <class Density>
std::vector<DVec3> sum_over_texels(const Environment& environment, int bands,
                                   const Quadrature& rule, const Density& density) {
    const auto& grid = std::get<LatLongGrid>(environment.grid);
    const auto width = static_cast<std::size_t>(grid.width);
    const auto height = static_cast<std::size_t>(grid.height);
    const auto coeffs = static_cast<std::size_t>(sh::coeff_count(bands));
    std::vector<DVec3> rows(height * coeffs, DVec3(0));
    parallel_for(height, [&](std::size_t row) {
        std::array<double, sh::coeff_count(sh::kMaxBundleBands)> y;
        const auto point = [](const std::vector<double>& edges, std::size_t i, double node) {
            return edges[i] + (edges[i + 1] - edges[i]) * (1 + node) / 2;
        };
        for (std::size_t column = 0; column < width; ++column) {
            const double area = (grid.theta_edges[row + 1] - grid.theta_edges[row]) *
                                (grid.phi_edges[column + 1] - grid.phi_edges[column]) / 4;
            const DVec3 L(environment.radiance[row * width + column]);
            for (std::size_t i = 0; i < rule.nodes.size(); ++i) {
                const double theta = point(grid.theta_edges, row, rule.nodes[i]);
                for (std::size_t j = 0; j < rule.nodes.size(); ++j) {
                    const double phi = point(grid.phi_edges, column, rule.nodes[j]);
                    const auto w = lat_long::direction_at_angles(theta, phi);
                    sh::evaluate(bands, w[0], w[1], w[2], y.data());
                    const double weight =
                        rule.weights[i] * rule.weights[j] * area * density(row, theta);
                    for (std::size_t k = 0; k < coeffs; ++k)
                        rows[row * coeffs + k] += weight * y[k] * L;
                }
            }
        }
    });
    std::vector<DVec3> sum(coeffs, DVec3(0));
    for (std::size_t i = 0; i < rows.size(); ++i) sum[i % coeffs] += rows[i];
    return sum;
}

}  // namespace

std::vector<DVec3> sampled_sh(const Environment& environment, int bands) {
    // One point a texel, but the solid angle exact.
    const auto& grid = std::get<LatLongGrid>(environment.grid);
    return sum_over_texels(environment, bands, {{0}, {2}}, [&](std::size_t row, double) {
        return ring_height(grid, row) / (grid.theta_edges[row + 1] - grid.theta_edges[row]);
    });
}

std::vector<DVec3> integrated_sh(const Environment& environment, int bands) {
    return sum_over_texels(environment, bands, gauss_legendre(4),
                           [](std::size_t, double theta) { return std::sin(theta); });
}

Environment halved(const Environment& environment) {
    const auto& fine = std::get<LatLongGrid>(environment.grid);
    Environment coarse;
    coarse.grid = make_lat_long_grid(fine.width / 2, fine.height / 2);
    const auto width = static_cast<std::size_t>(fine.width);
    for (std::size_t row = 0; row + 1 < static_cast<std::size_t>(fine.height); row += 2) {
        const double upper = ring_height(fine, row), lower = ring_height(fine, row + 1);
        for (std::size_t column = 0; column + 1 < width; column += 2) {
            const Vec3* above = &environment.radiance[row * width + column];
            const Vec3* below = above + width;
            coarse.radiance.push_back(
                Vec3((upper * DVec3(above[0] + above[1]) + lower * DVec3(below[0] + below[1])) /
                     (2 * (upper + lower))));
        }
    }
    return coarse;
}

}  // namespace envbake::bench
