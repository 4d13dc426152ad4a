// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/random.h"
#include "baker/input/environment.h"
#include "envbake/runtime/cube.h"

#include <cmath>
#include <cstddef>
#include <functional>
#include <numbers>
#include <ostream>
#include <utility>
#include <variant>
#include <vector>

/// Environments made by hand: edges and texels without any reader.
namespace envbake::test {

inline std::size_t slot(int i) {
    return static_cast<std::size_t>(i);
}

inline LatLongGrid lat_long_grid(int width, int height) {
    LatLongGrid grid{width, height, {}, {}};
    for (int r = 0; r <= height; ++r) grid.theta_edges.push_back(std::numbers::pi * r / height);
    for (int c = 0; c <= width; ++c) {
        grid.phi_edges.push_back(2 * std::numbers::pi * (static_cast<double>(c) / width - 0.5));
    }
    return grid;
}

/// Uneven edges, a seam that is not at pi, and texels of half the size at both ends.
inline LatLongGrid uneven_lat_long_grid(int width, int height) {
    LatLongGrid grid{width, height, {0}, {}};
    for (int r = 1; r < height; ++r) {
        const double wobble = 0.3 * std::sin(9.0 * r);
        grid.theta_edges.push_back(std::numbers::pi * (r - 0.5 + wobble) / (height - 1));
    }
    grid.theta_edges.push_back(std::numbers::pi);
    const double first = -2.9;
    grid.phi_edges.push_back(first);
    for (int c = 1; c < width; ++c) {
        const double wobble = 0.3 * std::sin(7.0 * c);
        grid.phi_edges.push_back(first + 2 * std::numbers::pi * (c - 0.5 + wobble) / (width - 1));
    }
    if (width == 1) grid.phi_edges.resize(1);
    grid.phi_edges.push_back(first + 2 * std::numbers::pi);
    return grid;
}

inline CubeGrid cube_grid(int size) {
    CubeGrid grid{size, {}};
    for (int i = 0; i <= size; ++i) grid.edges.push_back(2.0 * i / size - 1);
    return grid;
}

inline CubeGrid uneven_cube_grid(int size) {
    CubeGrid grid{size, {-1}};
    for (int i = 1; i < size; ++i) {
        grid.edges.push_back(2 * (i + 0.3 * std::sin(5.0 * i)) / size - 1);
    }
    grid.edges.push_back(1);
    return grid;
}

/// A grid as the parameter of a test.
struct NamedGrid {
    const char* name;
    std::variant<LatLongGrid, CubeGrid> grid;
    friend std::ostream& operator<<(std::ostream& out, const NamedGrid& g) { return out << g.name; }
};

/// One texel of a grid: a rectangle in (theta, phi), or in (u, v) of a face.
struct Texel {
    int face = -1;          ///< -1: lat-long
    double a0 = 0, a1 = 0;  ///< theta or v
    double b0 = 0, b1 = 0;  ///< phi or u
    DVec3 towards(double a, double b) const {
        if (face < 0) {
            return {std::sin(a) * std::cos(b), std::cos(a), std::sin(a) * std::sin(b)};
        }
        const auto w = cube::direction(static_cast<cube::Face>(face), b, a);
        return {w[0], w[1], w[2]};
    }
    /// d omega / (da db)
    double density(double a, double b) const {
        return face < 0 ? std::sin(a) : std::pow(1 + a * a + b * b, -1.5);
    }
    DVec3 middle() const { return towards((a0 + a1) / 2, (b0 + b1) / 2); }
};

/// Every texel, in the order of Environment::radiance.
inline std::vector<Texel> texels_of(const std::variant<LatLongGrid, CubeGrid>& grid) {
    std::vector<Texel> texels;
    if (const auto* g = std::get_if<LatLongGrid>(&grid)) {
        for (std::size_t r = 0; r + 1 < g->theta_edges.size(); ++r) {
            for (std::size_t c = 0; c + 1 < g->phi_edges.size(); ++c) {
                texels.push_back({-1, g->theta_edges[r], g->theta_edges[r + 1], g->phi_edges[c],
                                  g->phi_edges[c + 1]});
            }
        }
        return texels;
    }
    const auto& g = std::get<CubeGrid>(grid);
    for (int face = 0; face < cube::kFaceCount; ++face) {
        for (std::size_t r = 0; r + 1 < g.edges.size(); ++r) {
            for (std::size_t c = 0; c + 1 < g.edges.size(); ++c) {
                texels.push_back({face, g.edges[r], g.edges[r + 1], g.edges[c], g.edges[c + 1]});
            }
        }
    }
    return texels;
}

inline Environment environment(std::variant<LatLongGrid, CubeGrid> grid,
                               const std::function<DVec3(const Texel&, std::size_t)>& radiance) {
    Environment made{"made by hand", std::move(grid), {}, {}};
    std::size_t i = 0;
    for (const Texel& texel : texels_of(made.grid)) {
        made.radiance.push_back(Vec3(radiance(texel, i++)));
    }
    return made;
}

/// A texel's average of f, by a Gauss rule of 4 x 4 nodes.
inline double average(const Texel& t, const std::function<double(const DVec3&)>& f) {
    constexpr double kNode[] = {-0.8611363115940526, -0.3399810435848563, 0.3399810435848563,
                                0.8611363115940526};
    constexpr double kWeight[] = {0.3478548451374538, 0.6521451548625461, 0.6521451548625461,
                                  0.3478548451374538};
    double total = 0, omega = 0;
    for (int i = 0; i < 4; ++i) {
        for (int j = 0; j < 4; ++j) {
            const double a = t.a0 + (t.a1 - t.a0) * (1 + kNode[i]) / 2;
            const double b = t.b0 + (t.b1 - t.b0) * (1 + kNode[j]) / 2;
            const double weight = kWeight[i] * kWeight[j] * t.density(a, b);
            total += weight * f(t.towards(a, b));
            omega += weight;
        }
    }
    return total / omega;
}

/// A bright sky over dark ground with coloured texture and a sun of 1e5 of half a degree: a
/// stand-in for an outdoor photograph.
inline Environment sun_and_sky(std::variant<LatLongGrid, CubeGrid> grid,
                               const DVec3& sun = glm::normalize(DVec3{0.5, 0.6, -0.3})) {
    return environment(std::move(grid), [&](const Texel& t, std::size_t i) {
        const DVec3 w = t.middle();
        RandomStream random(1, 2, i);
        const double grain = 0.8 + 0.4 * random.next();
        DVec3 L = w.y > 0 ? DVec3{0.4, 0.7, 1.3} * (1.2 - w.y) : DVec3{0.12, 0.1, 0.06};
        L *= grain * (1 + 0.5 * std::sin(23 * w.x) * std::cos(17 * w.z));
        if (glm::dot(w, sun) > std::cos(0.265 * std::numbers::pi / 180)) {
            L += DVec3{1.1e5, 1e5, 0.8e5};
        }
        return L;
    });
}

}  // namespace envbake::test
