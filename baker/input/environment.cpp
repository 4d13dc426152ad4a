// SPDX-License-Identifier: Apache-2.0
#include "baker/input/environment.h"

#include "envbake/runtime/cube.h"
#include "envbake/runtime/lat_long.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace envbake {
namespace {

constexpr double kPi = std::numbers::pi;

/// count + 1 edges from `first` to `last`; the ends are exact.
std::vector<double> even_edges(int count, double first, double last) {
    std::vector<double> edges(static_cast<std::size_t>(count) + 1);
    for (int i = 0; i <= count; ++i) {
        const double t = static_cast<double>(i) / count;
        edges[static_cast<std::size_t>(i)] = first * (1 - t) + last * t;
    }
    return edges;
}

/// The interval of `edges` that holds x; the nearest one for x outside.
std::size_t interval(const std::vector<double>& edges, double x) {
    const auto inner_end = edges.end() - 1;
    const auto above = std::upper_bound(edges.begin() + 1, inner_end, x);
    return static_cast<std::size_t>(above - edges.begin()) - 1;
}

std::size_t texel_towards(const LatLongGrid& grid, const DVec3& w) {
    const double theta = std::atan2(std::hypot(w.x, w.z), w.y);
    double phi = std::atan2(w.z, w.x);
    while (phi < grid.phi_edges.front()) phi += 2 * kPi;
    while (phi >= grid.phi_edges.back()) phi -= 2 * kPi;
    return interval(grid.theta_edges, theta) * static_cast<std::size_t>(grid.width) +
           interval(grid.phi_edges, phi);
}

std::size_t texel_towards(const CubeGrid& grid, const DVec3& w) {
    const auto p = cube::project(std::array<double, 3>{w.x, w.y, w.z});
    const auto size = static_cast<std::size_t>(grid.size);
    return (static_cast<std::size_t>(p.face) * size + interval(grid.edges, p.v)) * size +
           interval(grid.edges, p.u);
}

}  // namespace

Vec3 radiance_towards(const Environment& environment, const DVec3& w) {
    return environment.radiance[std::visit([&](const auto& grid) { return texel_towards(grid, w); },
                                           environment.grid)];
}

LatLongGrid make_lat_long_grid(int width, int height) {
    return {.width = width,
            .height = height,
            .theta_edges = even_edges(height, 0, kPi),
            .phi_edges = even_edges(width, -kPi, kPi)};
}

CubeGrid make_cube_grid(int size) {
    return {.size = size, .edges = even_edges(size, -1, 1)};
}

}  // namespace envbake
