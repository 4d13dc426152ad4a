// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/box_average.h"

#include "baker/core/parallel.h"
#include "baker/math/quadrature.h"
#include "envbake/runtime/cube.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>

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

/// The same, many times: even buckets say where to begin, a step or two end it.
class IntervalFinder {
  public:
    explicit IntervalFinder(std::vector<double> edges) : edges_(std::move(edges)) {
        const std::size_t buckets = 4 * edges_.size();
        const double width = (edges_.back() - edges_.front()) / static_cast<double>(buckets);
        per_unit_ = 1 / width;
        for (std::size_t i = 0; i < buckets; ++i) {
            first_.push_back(interval_of(edges_, edges_.front() + static_cast<double>(i) * width));
        }
    }
    int operator()(double x) const {
        const double bucket = std::clamp((x - edges_.front()) * per_unit_, 0.0,
                                         static_cast<double>(first_.size() - 1));
        int i = first_[static_cast<std::size_t>(bucket)];
        const int last = static_cast<int>(edges_.size()) - 2;
        while (i < last && x >= edges_[index(i + 1)]) ++i;
        while (i > 0 && x < edges_[index(i)]) --i;
        return i;
    }

  private:
    std::vector<double> edges_;
    std::vector<int> first_;
    double per_unit_ = 0;
};

std::vector<double> depths(const LatLongGrid& grid) {
    std::vector<double> rising;
    for (const double theta : grid.theta_edges) rising.push_back(-std::cos(theta));
    return rising;
}

/// A straight edge at height h of the cube's surface, seen from above: with t along it from the
/// foot of the perpendicular from the axis, phi = foot_phi + atan(t / D), rho^2 = D^2 + t^2, y = h
/// / sqrt(h^2 + rho^2). phi rises with t.
struct Edge {
    double h, distance, cos_foot, sin_foot, t0, t1;

    double y(double t) const { return h / std::sqrt(h * h + distance * distance + t * t); }
    /// The angle between two places, without a difference of angles.
    double turn(double from, double to) const {
        const double x = distance * (to - from) / (distance * distance + from * to);
        const double x2 = x * x;
        if (x2 < 1e-4 && x2 >= 0 && distance * distance + from * to > 0) {
            return x * (1 - x2 * (1.0 / 3 - x2 * (1.0 / 5 - x2 * (1.0 / 7 - x2 / 9))));
        }
        return std::atan(to / distance) - std::atan(from / distance);
    }
};

/// Integrals of C dphi along edges. Radiance is that above the floor.
class ContourIntegrals {
  public:
    ContourIntegrals(const Environment& environment, const LatLongGrid& grid, const DVec3& floor,
                     const Quadrature& rule)
        : environment_(environment),
          grid_(grid),
          floor_(floor),
          rule_(rule),
          row_of_depth_(depths(grid)),
          column_of_(grid.phi_edges) {
        for (const double theta : grid.theta_edges) heights_.push_back(std::cos(theta));
        for (const double phi : grid.phi_edges) rays_.push_back({std::cos(phi), std::sin(phi)});
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
        const Edge edge{h,
                        cross / length,
                        dz / length,
                        -dx / length,
                        (x0 * dx + z0 * dz) / length,
                        (x1 * dx + z1 * dz) / length};
        // The column that the edge starts in; a start on a boundary may be put on either side of
        // it.
        double phi = std::atan2(z0, x0);
        phi -= 2 * pi * std::floor((phi - grid_.phi_edges.front()) / (2 * pi));
        int column = column_of_(phi);
        double t = edge.t0;
        DVec3 sum{0};
        for (int crossed = 0;; ++crossed) {
            const Ray& ray = rays_[index(column + 1)];
            const double ahead = ray.cosine * edge.cos_foot + ray.sine * edge.sin_foot;
            const double aside = ray.sine * edge.cos_foot - ray.cosine * edge.sin_foot;
            const double crossing = ahead > 0 ? edge.distance * aside / ahead : edge.t1;
            // A ray behind the start is the same column's far side, more than half a turn away.
            const bool last =
                crossed == grid_.width || crossing >= edge.t1 || crossing < edge.t0 - kSlack;
            const double end = last ? edge.t1 : std::max(crossing, t);
            sum += in_column(edge, column, t, end, south);
            if (last) return sum;
            t = end;
            if (++column == grid_.width) column = 0;
        }
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

    DVec3 in_column(const Edge& e, int column, double t0, double t1, bool south) const {
        if (t0 < 0 && t1 > 0) {  // y turns round at the foot
            return in_column(e, column, t0, 0, south) + in_column(e, column, 0, t1, south);
        }
        const bool inwards = t1 <= 0;
        const bool rising = inwards == (e.h > 0);  // y along the way
        int row = row_of_depth_(-e.y(t0));
        DVec3 sum{0};
        while (true) {
            const int crossed = rising ? row : row + 1;
            const double y = heights_[index(crossed)];
            double end = t1;
            bool last = true;
            if (crossed > 0 && crossed < grid_.height && y * e.h > 0) {
                const double t2 = e.h * e.h * (1 / (y * y) - 1) - e.distance * e.distance;
                const double t = inwards ? -std::sqrt(t2) : std::sqrt(t2);
                if (t2 >= 0 && t < t1) {
                    last = false;
                    end = std::max(t, t0);
                }
            }
            sum += in_texel(e, row, column, t0, end, south);
            if (last) return sum;
            t0 = end;
            row += rising ? -1 : 1;
        }
    }

    DVec3 in_texel(const Edge& e, int row, int column, double t0, double t1, bool south) const {
        // Integral of (1 - |y|) dphi = D dt / (R (R + |h|)), R^2 = h^2 + D^2 + t^2: smooth at a
        // pole.
        const double half = (t1 - t0) / 2, middle = t0 + half;
        const double h = std::abs(e.h);
        double cap = 0;
        for (std::size_t i = 0; i < rule_.nodes.size(); ++i) {
            const double t = middle + half * rule_.nodes[i];
            const double r2 = h * h + e.distance * e.distance + t * t;
            cap += rule_.weights[i] / (r2 + std::sqrt(r2) * h);
        }
        cap *= half * e.distance;
        const double d_phi = e.turn(t0, t1);
        const DVec3 L = excess(row, column);
        // 1 - y from the north, 1 + y from the south; the far hemisphere has 2 - (1 - |y|).
        if ((e.h < 0) != south) cap = 2 * d_phi - cap;
        if (south) {
            const DVec3 below = totals_[index(column)] - above(row + 1, column);
            return (below - L * (1 + heights_[index(row + 1)])) * d_phi + L * cap;
        }
        return (above(row, column) - L * (1 - heights_[index(row)])) * d_phi + L * cap;
    }

    struct Ray {
        double cosine, sine;
    };
    static constexpr double kSlack = 1e-9;

    const Environment& environment_;
    const LatLongGrid& grid_;
    DVec3 floor_;
    const Quadrature& rule_;
    IntervalFinder row_of_depth_, column_of_;
    std::vector<double> heights_;  ///< cos theta of the edges of rows, falling
    std::vector<Ray> rays_;        ///< directions of the edges of columns
    int step_ = 1;
    std::vector<DVec3> sums_, totals_;
};

std::vector<Vec3> average_lat_long(const Environment& environment, const LatLongGrid& grid,
                                   int size) {
    const DVec3 low = lowest(environment), high = highest(environment);
    const Quadrature rule = gauss_legendre(gauss_count_for_singularity(1.0, 1.0 / size, 1e-11));
    const ContourIntegrals contour(environment, grid, low, rule);
    const std::size_t n = index(size);
    std::vector<Vec3> texels(index(cube::kFaceCount) * n * n);
    const auto at = [&](int i) { return 2.0 * i / size - 1; };

    constexpr int kRowsPerTask = 16;  // the edge between two rows of a task is integrated once
    const std::size_t tasks_per_face = (n + kRowsPerTask - 1) / kRowsPerTask;
    parallel_for(index(cube::kFaceCount) * tasks_per_face, [&](std::size_t task) {
        const auto face = static_cast<cube::Face>(task / tasks_per_face);
        const int first = static_cast<int>(task % tasks_per_face) * kRowsPerTask;
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
        std::vector<DVec3> top(n), bottom(n);
        const auto integrate_row_edge = [&](int row, std::vector<DVec3>& out) {
            for (int column = 0; column < size; ++column) {
                out[index(column)] = integral(column, row, column + 1, row);
            }
        };
        integrate_row_edge(first, bottom);
        for (int row = first; row < std::min(first + kRowsPerTask, size); ++row) {
            std::swap(top, bottom);
            integrate_row_edge(row + 1, bottom);
            DVec3 left = polar ? integral(0, row, 0, row + 1) : DVec3{0};
            Vec3* out = texels.data() + (index(static_cast<int>(face)) * n + index(row)) * n;
            for (int column = 0; column < size; ++column) {
                const std::size_t c = index(column);
                DVec3 flux = polar ? top[c] - bottom[c] : bottom[c] - top[c];
                if (polar) {
                    const DVec3 right = integral(column + 1, row, column + 1, row + 1);
                    flux += right - left;
                    left = right;
                }
                const DVec3 value = low + sign * flux / cube::texel_solid_angle(row, column, size);
                out[c] = Vec3(glm::clamp(value, low, high));
            }
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
