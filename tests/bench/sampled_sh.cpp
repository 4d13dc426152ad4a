// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/sampled_sh.h"

#include "baker/core/parallel.h"
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

}  // namespace

std::vector<DVec3> sampled_sh(const Environment& environment, int bands) {
    const auto& grid = std::get<LatLongGrid>(environment.grid);
    const auto width = static_cast<std::size_t>(grid.width);
    const auto height = static_cast<std::size_t>(grid.height);
    const auto coeffs = static_cast<std::size_t>(sh::coeff_count(bands));
    std::vector<DVec3> rows(height * coeffs, DVec3(0));
    parallel_for(height, [&](std::size_t row) {
        std::array<double, sh::coeff_count(sh::kMaxBundleBands)> y;
        const double theta = (grid.theta_edges[row] + grid.theta_edges[row + 1]) / 2;
        for (std::size_t column = 0; column < width; ++column) {
            const double phi = (grid.phi_edges[column] + grid.phi_edges[column + 1]) / 2;
            const auto w = lat_long::direction_at_angles(theta, phi);
            sh::evaluate(bands, w[0], w[1], w[2], y.data());
            const double omega =
                ring_height(grid, row) * (grid.phi_edges[column + 1] - grid.phi_edges[column]);
            const DVec3 flux = omega * DVec3(environment.radiance[row * width + column]);
            for (std::size_t k = 0; k < coeffs; ++k) rows[row * coeffs + k] += y[k] * flux;
        }
    });
    std::vector<DVec3> sum(coeffs, DVec3(0));
    for (std::size_t i = 0; i < rows.size(); ++i) sum[i % coeffs] += rows[i];
    return sum;
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
