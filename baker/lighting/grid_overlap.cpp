// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/grid_overlap.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace envbake::lighting {
namespace {

using std::numbers::pi;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
/// Angles of edges are good to a few roundings of 2 pi.
constexpr double kSameAngle = 1e-14;

std::size_t index(int i) {
    return static_cast<std::size_t>(i);
}
int count_of(const std::vector<double>& edges) {
    return static_cast<int>(edges.size()) - 1;
}

/// The last interval of rising edges that begins at x or before.
int interval_of(const std::vector<double>& edges, double x) {
    const auto next = std::upper_bound(edges.begin() + 1, edges.end() - 1, x);
    return static_cast<int>(next - edges.begin()) - 1;
}

/// `phi` turned into the grid's own turn.
double wrapped(const LatLongGrid& grid, double phi) {
    const double first = grid.phi_edges.front();
    return phi - 2 * pi * std::floor((phi - first) / (2 * pi));
}

/// Angles from the part's pole of the edges of its rows, from 0 to the equator.
std::vector<double> row_edges(const LatLongGrid& grid, const GridPart& part) {
    std::vector<double> edges{0};
    for (int i = 1; i < grid.height; ++i) {
        const double theta =
            part.south ? pi - grid.theta_edges[index(grid.height - i)] : grid.theta_edges[index(i)];
        if (theta >= pi / 2 - kSameAngle) break;
        edges.push_back(theta);
    }
    edges.push_back(pi / 2);
    return edges;
}

/// Angles from the part's X of the edges of columns, from 0 to 90 degrees.
std::vector<double> column_edges(const LatLongGrid& grid, const GridPart& part) {
    std::vector<double> edges{0};
    for (int i = 0; i < grid.width; ++i) {
        double phi = grid.phi_edges[index(i)] - part.turn * pi / 2;
        if (part.mirrored) phi = -phi;
        phi -= 2 * pi * std::floor(phi / (2 * pi));
        if (phi > kSameAngle && phi < pi / 2 - kSameAngle) edges.push_back(phi);
    }
    edges.push_back(pi / 2);
    std::sort(edges.begin(), edges.end());
    return edges;
}

bool same(const std::vector<double>& a, const std::vector<double>& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                      [](double x, double y) { return std::abs(x - y) <= kSameAngle; });
}

GridParts with_edges(const std::vector<double>& theta, const std::vector<double>& phi) {
    GridParts parts;
    for (const double t : theta) {
        const double half = std::sin(t / 2);
        parts.depths.push_back(2 * half * half);
        parts.tan2.push_back(std::tan(t) * std::tan(t));
    }
    for (const double p : phi) {
        parts.tangents.push_back(std::tan(p));
        parts.cotangents.push_back(1 / std::tan(p));
    }
    parts.depths.back() = 1;
    parts.tan2.back() = parts.tangents.back() = parts.cotangents.front() = kInfinity;
    parts.cotangents.back() = 0;
    return parts;
}

/// atan(to / distance) - atan(from / distance), 0 <= from <= to, without a difference of angles
/// where they are close.
double turn(double distance, double from, double to) {
    const double x = distance * (to - from) / (distance * distance + from * to);
    const double x2 = x * x;
    if (x2 > 1e-2) return std::atan(to / distance) - std::atan(from / distance);
    // The rest of the series is below 1e-17 of the sum.
    return x *
           (1 - x2 * (1.0 / 3 -
                      x2 * (1.0 / 5 -
                            x2 * (1.0 / 7 -
                                  x2 * (1.0 / 9 - x2 * (1.0 / 11 - x2 * (1.0 / 13 - x2 / 15)))))));
}

}  // namespace

std::vector<GridParts> parts_of(const LatLongGrid& grid) {
    struct Edges {
        std::vector<double> theta, phi;
    };
    std::vector<Edges> edges;
    std::vector<GridParts> groups;
    for (const bool south : {false, true}) {
        for (const bool mirrored : {false, true}) {
            for (int turn = 0; turn < 4; ++turn) {
                GridPart part{.turn = turn, .mirrored = mirrored, .south = south};
                const std::vector<double> theta = row_edges(grid, part);
                const std::vector<double> phi = column_edges(grid, part);
                const double inside = (phi[0] + phi[1]) / 2;
                part.first_column = interval_of(
                    grid.phi_edges, wrapped(grid, turn * pi / 2 + (mirrored ? -inside : inside)));
                part.column_step = mirrored ? -1 : 1;
                part.first_row = south ? grid.height - 1 : 0;
                part.row_step = south ? -1 : 1;
                std::size_t group = 0;
                while (group < edges.size() &&
                       !(same(edges[group].theta, theta) && same(edges[group].phi, phi))) {
                    ++group;
                }
                if (group == edges.size()) {
                    edges.push_back({theta, phi});
                    groups.push_back(with_edges(theta, phi));
                }
                groups[group].parts.push_back(part);
            }
        }
    }
    return groups;
}

void Overlap::clear() {
    runs.clear();
    solid_angles.clear();
    total = 0;
}

/// A stretch of an edge, t rising. phi rises with t, or, for edges along X, 90 degrees - phi.
struct OverlapFinder::Edge {
    double h, d, t0, t1;
    bool along_x;

    double depth(double t) const {
        const double rho2 = d * d + t * t, r2 = h * h + rho2;
        return rho2 / (r2 + h * std::sqrt(r2));
    }
};

OverlapFinder::OverlapFinder(const GridParts& parts, double widest)
    // Singular where R = 0, at a distance of sqrt(h^2 + d^2) >= 1.
    : parts_(parts), rule_(gauss_legendre(gauss_count_for_singularity(1.0, widest / 2))) {}

double& OverlapFinder::area(int row, int column) {
    return areas_[index(row - row0_) * index(column1_ - column0_ + 1) + index(column - column0_)];
}

void OverlapFinder::begin(double depth0, double depth1, double tan0, double tan1) {
    row0_ = interval_of(parts_.depths, depth0);
    row1_ = row0_;
    while (row1_ + 1 < count_of(parts_.depths) && parts_.depths[index(row1_ + 1)] < depth1) ++row1_;
    column0_ = interval_of(parts_.tangents, tan0);
    column1_ = column0_;
    while (column1_ + 1 < count_of(parts_.tangents) && parts_.tangents[index(column1_ + 1)] < tan1)
        ++column1_;
    areas_.assign(index(row1_ - row0_ + 1) * index(column1_ - column0_ + 1), 0.0);
}

void OverlapFinder::add_edge(const Edge& e, double sign) {
    if (e.d <= 0 || e.t1 <= e.t0) return;  // straight to the pole: no dphi
    // Where the edge leaves a column.
    const auto column_end = [&](int column) {
        return e.d *
               (e.along_x ? parts_.cotangents[index(column)] : parts_.tangents[index(column + 1)]);
    };
    const int step = e.along_x ? -1 : 1, last_column = e.along_x ? column0_ : column1_;
    int column = e.along_x ? column1_ : column0_;
    while (column != last_column && column_end(column) <= e.t0) column += step;
    int row = row0_;
    const double depth0 = e.depth(e.t0);
    while (row < row1_ && parts_.depths[index(row + 1)] <= depth0) ++row;

    const auto row_end = [&](int r) {
        if (r == row1_) return e.t1;
        const double t2 = e.h * e.h * parts_.tan2[index(r + 1)] - e.d * e.d;
        return t2 > 0 ? std::sqrt(t2) : 0.0;
    };
    double t = e.t0;
    double end_of_row = row_end(row),
           end_of_column = column == last_column ? e.t1 : column_end(column);
    while (true) {
        const double end = std::max(t, std::min({end_of_row, end_of_column, e.t1}));
        const double half = (end - t) / 2, middle = t + half;
        double integral = 0;
        for (std::size_t i = 0; i < rule_.nodes.size(); ++i) {
            const double at = middle + half * rule_.nodes[i];
            const double r2 = e.h * e.h + e.d * e.d + at * at;
            integral += rule_.weights[i] / (r2 + e.h * std::sqrt(r2));
        }
        const double d_phi = turn(e.d, t, end);
        area(row, column) += sign * (integral * half * e.d - parts_.depths[index(row)] * d_phi);
        for (int r = row0_; r < row; ++r) {
            area(r, column) +=
                sign * d_phi * (parts_.depths[index(r + 1)] - parts_.depths[index(r)]);
        }
        t = end;
        if (t >= e.t1) return;
        if (end_of_row <= t && row < row1_) {
            end_of_row = row_end(++row);
        } else {
            column += step;
            end_of_column = column == last_column ? e.t1 : column_end(column);
        }
    }
}

void OverlapFinder::end(Overlap& to) {
    // Areas poleward of two edges cancel but for rounding, of either sign.
    constexpr double kNothing = 1e-14;
    const int columns = column1_ - column0_ + 1;
    double largest = 0;
    for (const double a : areas_) largest = std::max(largest, a);
    for (int row = row0_; row <= row1_; ++row) {
        const double* const a = &area(row, column0_);
        int first = 0, last = columns;
        while (first < last && a[first] <= kNothing * largest) ++first;
        while (first < last && a[last - 1] <= kNothing * largest) --last;
        if (first == last) continue;
        to.runs.push_back({row, column0_ + first, last - first, to.solid_angles.size()});
        for (int i = first; i < last; ++i) {
            to.solid_angles.push_back(std::max(a[i], 0.0));
            to.total += to.solid_angles.back();
        }
    }
}

void OverlapFinder::add_side(double z0, double z1, double y0, double y1, Overlap& to) {
    const Edge lower{y0, 1, z0, z1, false}, upper{y1, 1, z0, z1, false};
    begin(upper.depth(z0), lower.depth(z1), z0, z1);
    add_edge(lower, 1);
    add_edge(upper, -1);
    end(to);
}

void OverlapFinder::add_polar(double x0, double x1, double z0, double z1, Overlap& to) {
    const Edge far_x{1, x1, z0, z1, false}, near_x{1, x0, z0, z1, false};
    const Edge far_z{1, z1, x0, x1, true}, near_z{1, z0, x0, x1, true};
    begin(near_x.depth(z0), far_x.depth(z1), z0 / x1, x0 > 0 ? z1 / x0 : kInfinity);
    add_edge(far_x, 1);
    add_edge(far_z, 1);
    add_edge(near_x, -1);
    add_edge(near_z, -1);
    end(to);
}

}  // namespace envbake::lighting
