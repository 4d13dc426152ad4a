// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/grid_overlap.h"

#include "tests/support/environments.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>
#include <vector>

namespace envbake::lighting {
namespace {

using std::numbers::pi;
using test::slot;

std::vector<LatLongGrid> grids() {
    return {
        test::lat_long_grid(1, 1),   test::lat_long_grid(3, 5),   test::lat_long_grid(8, 4),
        test::lat_long_grid(10, 3),  test::lat_long_grid(64, 33), test::uneven_lat_long_grid(13, 7),
        test::lat_long_grid(4, 300), test::lat_long_grid(301, 2), test::lat_long_grid(4096, 512)};
}

std::size_t texel_of(const LatLongGrid& grid, const GridPart& part, const Overlap::Run& run,
                     int i) {
    const int row = part.first_row + part.row_step * run.row;
    const int column = part.first_column + part.column_step * (run.column + i);
    const int wrapped = ((column % grid.width) + grid.width) % grid.width;
    return slot(row) * slot(grid.width) + slot(wrapped);
}

/// The area of a rectangle of the side face, or of the polar one. By the corner terms of
/// atan(u v / sqrt(1 + u^2 + v^2)): not the formula of the baker.
double solid_angle(double u0, double u1, double v0, double v1) {
    const auto corner = [](double u, double v) {
        return std::atan(u * v / std::sqrt(1 + u * u + v * v));
    };
    return corner(u1, v1) - corner(u0, v1) - corner(u1, v0) + corner(u0, v0);
}

TEST(GridOverlap, AllPartsAddUpToEveryTexel) {
    // Rectangles of uneven sizes that fill the octants of the sides and the halved quarters of the
    // polar faces: what each texel shares with all of them is its own solid angle.
    for (const LatLongGrid& grid : grids()) {
        for (const int n : {1, 3, 16}) {
            std::vector<double> edges;
            for (int i = 0; i <= n; ++i) edges.push_back((i + 0.2 * std::sin(pi * i / n)) / n);
            std::vector<double> shared(slot(grid.width) * slot(grid.height), 0.0);
            std::size_t part_count = 0;
            for (const GridParts& group : parts_of(grid)) {
                OverlapFinder finder(group, 1.2 / n);
                part_count += group.parts.size();
                for (int i = 0; i < n; ++i) {
                    for (int j = 0; j < n; ++j) {
                        const double i0 = edges[slot(i)], i1 = edges[slot(i + 1)];
                        const double j0 = edges[slot(j)], j1 = edges[slot(j + 1)];
                        for (const bool polar : {false, true}) {
                            Overlap overlap;
                            if (polar) {
                                finder.add_polar(i0, i1, j0, j1, overlap);
                            } else {
                                finder.add_side(i0, i1, j0, j1, overlap);
                            }
                            const double area = solid_angle(i0, i1, j0, j1);
                            ASSERT_NEAR(overlap.total, area, 1e-15 + 1e-12 * area);
                            for (const GridPart& part : group.parts) {
                                if (polar && part.mirrored) continue;  // the same quarter
                                for (const Overlap::Run& run : overlap.runs) {
                                    for (int k = 0; k < run.count; ++k) {
                                        const double s = overlap.solid_angles[run.first + slot(k)];
                                        ASSERT_GE(s, 0);
                                        shared[texel_of(grid, part, run, k)] += s;
                                    }
                                }
                            }
                        }
                    }
                }
            }
            ASSERT_EQ(part_count, 16u);
            for (std::size_t t = 0; t < shared.size(); ++t) {
                const std::size_t r = t / slot(grid.width), c = t % slot(grid.width);
                const double t0 = grid.theta_edges[r], t1 = grid.theta_edges[r + 1];
                const double omega = 2 * std::sin((t0 + t1) / 2) * std::sin((t1 - t0) / 2) *
                                     (grid.phi_edges[c + 1] - grid.phi_edges[c]);
                ASSERT_NEAR(shared[t] / omega, 1, 1e-12)
                    << grid.width << " x " << grid.height << ", n=" << n << ", texel " << t;
            }
        }
    }
}

TEST(GridOverlap, MatchesIntegrationAlongMeridians) {
    // A rectangle cuts every meridian in one stretch: its ends by clipping, not by edges.
    constexpr int kSteps = 20000;
    RandomStream random(5, 6, 7);
    for (const LatLongGrid& grid : grids()) {
        if (grid.width > 1000) continue;
        const GridParts group = parts_of(grid).front();
        for (int trial = 0; trial < 20; ++trial) {
            const bool polar = trial % 2 == 1;
            double a0 = random.next(), a1 = random.next(), b0 = random.next(), b1 = random.next();
            if (a0 > a1) std::swap(a0, a1);
            if (b0 > b1) std::swap(b0, b1);
            if (trial >= 16) a0 = 0, b0 = trial >= 18 ? 0 : b0;
            Overlap overlap;
            OverlapFinder finder(group, 1);
            if (polar) {
                finder.add_polar(a0, a1, b0, b1, overlap);  // X, Z
            } else {
                finder.add_side(a0, a1, b0, b1, overlap);  // Z, Y
            }
            const std::size_t columns = group.tangents.size() - 1;
            std::vector<double> expected((group.depths.size() - 1) * columns, 0.0),
                found = expected;
            for (const Overlap::Run& run : overlap.runs) {
                for (int k = 0; k < run.count; ++k) {
                    found[slot(run.row) * columns + slot(run.column + k)] +=
                        overlap.solid_angles[run.first + slot(k)];
                }
            }
            for (int step = 0; step < kSteps; ++step) {
                const double phi = (step + 0.5) * (pi / 2) / kSteps;
                const double cosine = std::cos(phi), sine = std::sin(phi);
                double near = 0, far = 0;  // tan theta
                if (polar) {
                    near = std::max(a0 / cosine, b0 / sine);
                    far = std::min(a1 / cosine, b1 / sine);
                } else if (sine / cosine >= a0 && sine / cosine <= a1) {
                    near = 1 / (cosine * b1);
                    far = 1 / (cosine * b0);
                }
                if (near >= far) continue;
                const double y1 = 1 / std::sqrt(1 + near * near), y0 = 1 / std::sqrt(1 + far * far);
                std::size_t column = 0;
                while (group.tangents[column + 1] < sine / cosine) ++column;
                for (std::size_t row = 0; row + 1 < group.depths.size(); ++row) {
                    const double top = std::min(y1, 1 - group.depths[row]);
                    const double bottom = std::max(y0, 1 - group.depths[row + 1]);
                    if (top > bottom) {
                        expected[row * columns + column] += (top - bottom) * (pi / 2) / kSteps;
                    }
                }
            }
            for (std::size_t i = 0; i < expected.size(); ++i) {
                // A stretch begins or ends within a step of where the sum sees it.
                ASSERT_NEAR(found[i], expected[i], 1e-4)
                    << grid.width << " x " << grid.height << ", trial " << trial;
            }
        }
    }
}

TEST(GridOverlap, EvenGridsAreOneGroup) {
    for (const auto& [width, height] :
         {std::pair{4, 1}, {1024, 512}, {8192, 4096}, {1000, 333}, {20000, 3}}) {
        EXPECT_EQ(parts_of(make_lat_long_grid(width, height)).size(), 1u) << width;
    }
    EXPECT_EQ(parts_of(make_lat_long_grid(10, 5)).size(), 2u);
}

}  // namespace
}  // namespace envbake::lighting
