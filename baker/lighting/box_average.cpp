// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/box_average.h"

#include "baker/core/parallel.h"
#include "baker/math/quadrature.h"
#include "envbake/runtime/cube.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace envbake::lighting {
namespace {

using std::numbers::pi;

std::size_t index(int i) {
    return static_cast<std::size_t>(i);
}

DVec3 lowest(const Environment& environment) {
    DVec3 low(environment.radiance[0]);
    for (const Vec3& L : environment.radiance) low = glm::min(low, DVec3(L));
    return low;
}
DVec3 highest(const Environment& environment) {
    DVec3 high(environment.radiance[0]);
    for (const Vec3& L : environment.radiance) high = glm::max(high, DVec3(L));
    return high;
}

/// Which interval of rising edges holds x.
int interval_of(const std::vector<double>& edges, double x) {
    const auto next = std::upper_bound(edges.begin() + 1, edges.end() - 1, x);
    return static_cast<int>(next - edges.begin()) - 1;
}

/// A straight edge at height h of the cube's surface, seen from above: with t along it from the
/// foot of the perpendicular, rho^2 = D^2 + t^2, phi = foot_phi + atan(t / D), y = h / sqrt(h^2 +
/// rho^2).
struct Edge {
    double h, distance, foot_phi, t0, t1;
};

/// Integrals of C dphi along edges. Radiance is that above the floor.
class ContourIntegrals {
  public:
    ContourIntegrals(const Environment& environment, const LatLongGrid& grid, const DVec3& floor,
                     const Quadrature& rule)
        : environment_(environment), grid_(grid), floor_(floor), rule_(rule) {
        for (const double theta : grid.theta_edges) heights_.push_back(std::cos(theta));
        heights_.front() = 1;
        heights_.back() = -1;
        // Sums down to every row would be as large as the map in double: a large map keeps fewer.
        step_ = std::max(1, grid.height / 1024);
        const int kept = grid.height / step_ + 1;
        sums_.assign(index(kept) * index(grid.width), DVec3{0});
        totals_.assign(index(grid.width), DVec3{0});
        constexpr int kColumnsPerTask = 64;
        const int tasks = (grid.width + kColumnsPerTask - 1) / kColumnsPerTask;
        parallel_for(index(tasks), [&](std::size_t task) {
            const int first = static_cast<int>(task) * kColumnsPerTask;
            const int last = std::min(first + kColumnsPerTask, grid.width);
            for (int r = 0; r < grid.height; ++r) {
                for (int c = first; c < last; ++c) {
                    DVec3& total = totals_[index(c)];
                    if (r % step_ == 0)
                        sums_[index(r / step_) * index(grid.width) + index(c)] = total;
                    total += excess(r, c) * drop(r);
                }
            }
        });
    }

    /// From (x0, z0) to (x1, z1) at height h, C summed from the north pole, or (as a positive
    /// number) from the south.
    DVec3 along(double x0, double z0, double x1, double z1, double h, bool south) const {
        const double cross = x0 * z1 - z0 * x1;
        if (cross == 0) return DVec3{0};  // straight to the pole: dphi = 0
        if (cross < 0) return -along(x1, z1, x0, z0, h, south);
        const double dx = x1 - x0, dz = z1 - z0, length = std::hypot(dx, dz);
        Edge edge{h, cross / length, std::atan2(-dx, dz), (x0 * dx + z0 * dz) / length,
                  (x1 * dx + z1 * dz) / length};
        return whole(edge, south);
    }

  private:
    double drop(int row) const { return heights_[index(row)] - heights_[index(row + 1)]; }
    DVec3 excess(int row, int column) const {
        return DVec3(environment_.radiance[index(row) * index(grid_.width) + index(column)]) -
               floor_;
    }
    /// Sum of L dy over the rows above `row`.
    DVec3 above(int row, int column) const {
        if (row == grid_.height) return totals_[index(column)];
        const int kept = row / step_;
        DVec3 sum = sums_[index(kept) * index(grid_.width) + index(column)];
        for (int r = kept * step_; r < row; ++r) sum += excess(r, column) * drop(r);
        return sum;
    }

    int row_of(double y) const {
        const auto next = std::lower_bound(heights_.begin() + 1, heights_.end() - 1, y,
                                           [](double edge, double value) { return edge > value; });
        return static_cast<int>(next - heights_.begin()) - 1;
    }

    DVec3 whole(Edge edge, bool south) const {
        const double first_edge = grid_.phi_edges.front();
        double phi0 = edge.foot_phi + std::atan(edge.t0 / edge.distance);
        const double phi1 = edge.foot_phi + std::atan(edge.t1 / edge.distance);
        const double turn = -2 * pi * std::floor((phi0 - first_edge) / (2 * pi));
        int column = interval_of(grid_.phi_edges, phi0 + turn);
        double offset = -turn;  // phi of the edge = phi of the grid + offset
        double t = edge.t0;
        DVec3 sum{0};
        while (true) {
            const double next_phi = grid_.phi_edges[index(column + 1)] + offset;
            const bool last = next_phi >= phi1;
            const double end_phi = last ? phi1 : std::max(next_phi, phi0);
            const double end =
                last ? edge.t1
                     : std::clamp(edge.distance * std::tan(end_phi - edge.foot_phi), t, edge.t1);
            sum += in_column(edge, column, t, end, phi0, end_phi, south);
            if (last) return sum;
            t = end;
            phi0 = end_phi;
            if (++column == grid_.width) {
                column = 0;
                offset += 2 * pi;
            }
        }
    }

    DVec3 in_column(const Edge& e, int column, double t0, double t1, double phi0, double phi1,
                    bool south) const {
        if (t0 < 0 && t1 > 0) {  // y turns round at the foot
            return in_column(e, column, t0, 0, phi0, e.foot_phi, south) +
                   in_column(e, column, 0, t1, e.foot_phi, phi1, south);
        }
        const bool inwards = t1 <= 0;
        const bool rising = inwards == (e.h > 0);  // y along the way
        int row = row_of(height_at(e, t0));
        DVec3 sum{0};
        while (true) {
            const int crossed = rising ? row : row + 1;
            const double y = heights_[index(crossed)];
            double end = t1, end_phi = phi1;
            bool last = true;
            if (crossed > 0 && crossed < grid_.height && y * e.h > 0) {
                const double t2 = e.h * e.h * (1 / (y * y) - 1) - e.distance * e.distance;
                const double t = t2 >= 0 ? (inwards ? -std::sqrt(t2) : std::sqrt(t2)) : t1;
                if (t2 >= 0 && t < t1) {
                    last = false;
                    end = std::max(t, t0);
                    end_phi = std::clamp(e.foot_phi + std::atan(end / e.distance), phi0, phi1);
                }
            }
            sum += in_texel(e, row, column, t0, end, end_phi - phi0, south);
            if (last) return sum;
            t0 = end;
            phi0 = end_phi;
            row += rising ? -1 : 1;
        }
    }

    static double height_at(const Edge& e, double t) {
        return e.h / std::sqrt(e.h * e.h + e.distance * e.distance + t * t);
    }

    DVec3 in_texel(const Edge& e, int row, int column, double t0, double t1, double d_phi,
                   bool south) const {
        // Integral of (1 - |y|) dphi = D dt / (R (R + |h|)), R^2 = h^2 + D^2 + t^2: smooth at a
        // pole.
        const double half = (t1 - t0) / 2, middle = t0 + half;
        const double h = std::abs(e.h);
        double cap = 0;
        for (std::size_t i = 0; i < rule_.nodes.size(); ++i) {
            const double t = middle + half * rule_.nodes[i];
            const double r = std::sqrt(h * h + e.distance * e.distance + t * t);
            cap += rule_.weights[i] / (r * (r + h));
        }
        cap *= half * e.distance;
        const DVec3 L = excess(row, column);
        // 1 - y from the north, 1 + y from the south; the far hemisphere has 2 - (1 - |y|).
        if ((e.h < 0) != south) cap = 2 * d_phi - cap;
        if (south) {
            const DVec3 below = totals_[index(column)] - above(row + 1, column);
            return (below - L * (1 + heights_[index(row + 1)])) * d_phi + L * cap;
        }
        return (above(row, column) - L * (1 - heights_[index(row)])) * d_phi + L * cap;
    }

    const Environment& environment_;
    const LatLongGrid& grid_;
    DVec3 floor_;
    const Quadrature& rule_;
    std::vector<double> heights_;  ///< cos theta of the edges of rows, falling
    int step_ = 1;
    std::vector<DVec3> sums_, totals_;
};

std::vector<Vec3> average_lat_long(const Environment& environment, const LatLongGrid& grid,
                                   int size) {
    const DVec3 low = lowest(environment), high = highest(environment);
    const Quadrature rule = gauss_legendre(gauss_count_for_singularity(1.0, 1.0 / size));
    const ContourIntegrals contour(environment, grid, low, rule);
    const std::size_t n = index(size);
    std::vector<Vec3> texels(index(cube::kFaceCount) * n * n);
    const auto at = [&](int i) { return 2.0 * i / size - 1; };

    parallel_for(index(cube::kFaceCount) * n, [&](std::size_t task) {
        const auto face = static_cast<cube::Face>(task / n);
        const int row = static_cast<int>(task % n);
        const bool polar = face == cube::Face::PositiveY || face == cube::Face::NegativeY;
        const bool south = face == cube::Face::NegativeY;
        const auto integral = [&](int c0, int r0, int c1, int r1) {
            const auto p = cube::point(face, at(c0), at(r0)), q = cube::point(face, at(c1), at(r1));
            return contour.along(p[0], p[2], q[0], q[2], p[1], south);
        };
        // Seen in (x, z), u to v turns the same way as x to z on +Y, the other way on -Y; on the
        // side faces phi falls with u. Only dphi counts, so upright edges of side faces add
        // nothing.
        const double sign = face == cube::Face::PositiveY ? 1 : -1;
        DVec3 upright = polar ? integral(0, row, 0, row + 1) : DVec3{0};
        for (int column = 0; column < size; ++column) {
            const DVec3 top = integral(column, row, column + 1, row);
            const DVec3 bottom = integral(column, row + 1, column + 1, row + 1);
            DVec3 flux = polar ? top - bottom : bottom - top;
            if (polar) {
                const DVec3 next = integral(column + 1, row, column + 1, row + 1);
                flux += next - upright;
                upright = next;
            }
            const DVec3 value = low + sign * flux / cube::texel_solid_angle(row, column, size);
            texels[task * n + index(column)] = Vec3(glm::clamp(value, low, high));
        }
    });
    return texels;
}

std::vector<Vec3> average_cube(const Environment& environment, const CubeGrid& grid, int size) {
    const DVec3 low = lowest(environment), high = highest(environment);
    const std::size_t n = index(size), source = index(grid.size);
    std::vector<Vec3> texels(index(cube::kFaceCount) * n * n);
    parallel_for(index(cube::kFaceCount) * n, [&](std::size_t task) {
        const std::size_t face = task / n;
        const int row = static_cast<int>(task % n);
        const double v0 = 2.0 * row / size - 1, v1 = 2.0 * (row + 1) / size - 1;
        for (int column = 0; column < size; ++column) {
            const double u0 = 2.0 * column / size - 1, u1 = 2.0 * (column + 1) / size - 1;
            DVec3 flux{0};
            for (int r = interval_of(grid.edges, v0); r < grid.size && grid.edges[index(r)] < v1;
                 ++r) {
                const double top = std::max(v0, grid.edges[index(r)]);
                const double bottom = std::min(v1, grid.edges[index(r + 1)]);
                for (int c = interval_of(grid.edges, u0);
                     c < grid.size && grid.edges[index(c)] < u1; ++c) {
                    const double left = std::max(u0, grid.edges[index(c)]);
                    const double right = std::min(u1, grid.edges[index(c + 1)]);
                    if (right <= left || bottom <= top) continue;
                    const DVec3 L(
                        environment.radiance[(face * source + index(r)) * source + index(c)]);
                    flux += (L - low) * cube::solid_angle(left, right, top, bottom);
                }
            }
            const DVec3 value = low + flux / cube::texel_solid_angle(row, column, size);
            texels[task * n + index(column)] = Vec3(glm::clamp(value, low, high));
        }
    });
    return texels;
}

}  // namespace

std::vector<Vec3> box_average(const Environment& environment, int face_size) {
    if (const auto* grid = std::get_if<LatLongGrid>(&environment.grid)) {
        return average_lat_long(environment, *grid, face_size);
    }
    return average_cube(environment, std::get<CubeGrid>(environment.grid), face_size);
}

}  // namespace envbake::lighting
