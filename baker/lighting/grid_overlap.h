// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/environment.h"
#include "baker/math/quadrature.h"

#include <array>
#include <cstddef>
#include <vector>

/// The solid angles that rectangles of cube faces share with the texels of a lat-long grid.
///
/// Twelve planes and axes cut both into sixteen congruent parts: two hemispheres, four turns about
/// Y, and a mirror image of each. All of them are worked out in the coordinates of one part, where
/// X and Z are at right angles, Y points to the pole, and phi = atan2(Z, X): the side face X = 1
/// with 0 <= Z, Y <= 1, and the polar face Y = 1 with 0 <= X, Z <= 1. Where edges of the grid agree
/// in several parts, overlaps are worked out once for all of them.
namespace envbake::lighting {

/// Where a part lies on the sphere and in the grid: row i of the part is row first_row + i row_step
/// of the grid, column j is column first_column + j column_step, wrapped.
struct GridPart {
    int turn = 0;           ///< X lies at azimuth turn * 90 degrees
    bool mirrored = false;  ///< azimuth falls as phi rises: Z lies 90 degrees before X, not after
    bool south = false;     ///< Y points down
    int first_row = 0;
    int row_step = 1;
    int first_column = 0;
    int column_step = 1;

    /// A point of the part, in world space.
    template <class Real>
    std::array<Real, 3> to_world(Real x, Real y, Real z) const {
        const Real side = mirrored ? -z : z;
        const std::array<Real, 4> cosine{1, 0, -1, 0}, sine{0, 1, 0, -1};
        const auto k = static_cast<std::size_t>(turn);
        return {x * cosine[k] - side * sine[k], south ? -y : y, x * sine[k] + side * cosine[k]};
    }
};

/// The grid's edges inside of parts that see the same ones.
struct GridParts {
    /// 1 - cos of the angle from the pole, rising from 0 to 1 at the equator; without loss of
    /// digits near the pole.
    std::vector<double> depths;
    std::vector<double> tan2;      ///< tan^2 of those angles
    std::vector<double> tangents;  ///< tan of the columns' edges, from phi = 0 to 90 degrees
    std::vector<double> cotangents;
    std::vector<GridPart> parts;
};

/// All sixteen parts of a grid, grouped. An evenly spaced grid whose width is a multiple of 4 makes
/// one group.
std::vector<GridParts> parts_of(const LatLongGrid& grid);

/// Texels of a part that a rectangle overlaps, row by row.
struct Overlap {
    struct Run {
        int row = 0;
        int column = 0;
        int count = 0;
        std::size_t first = 0;  ///< in solid_angles
    };
    std::vector<Run> runs;
    std::vector<double> solid_angles;  ///< steradian
    double total = 0;                  ///< their sum

    void clear();
};

/// Works out overlaps. The areas are bounded by edges of rectangles and of texels; with the height
/// y = cos theta, by Green's theorem,
///
///     shared area poleward of an edge, in row r = integral of clamp(y_r - y(phi), 0, y_r - y_r+1)
///                                                 dphi
///
/// summed over the edges with the sign of the side that the rectangle lies on. An edge is straight,
/// so with t along it from the foot of the perpendicular from the axis, at distance d and height h,
///
///     phi = atan(t / d),   y = h / R,   R^2 = h^2 + d^2 + t^2,
///     integral of (1 - y) dphi = integral of d / (R (R + h)) dt
///
/// which is smooth, also at the pole: Gauss-Legendre with as many nodes as the widest rectangle
/// asks for. Errors: 1e-14 of a texel's own solid angle or of the rectangle's, the larger; what an
/// edge takes from one rectangle it gives to its neighbour, so that the overlaps of a texel with
/// all rectangles add up to its solid angle to rounding.
class OverlapFinder {
  public:
    /// `widest`: the longest edge of any rectangle. `parts` must outlive this object.
    OverlapFinder(const GridParts& parts, double widest);

    /// Adds z0 .. z1 (along Z), y0 .. y1 of the side face X = 1; 0 <= both <= 1.
    void add_side(double z0, double z1, double y0, double y1, Overlap& to);
    /// Adds x0 .. x1, z0 .. z1 of the polar face Y = 1; 0 <= both <= 1.
    void add_polar(double x0, double x1, double z0, double z1, Overlap& to);

  private:
    struct Edge;
    void begin(double depth0, double depth1, double tan0, double tan1);
    void add_edge(const Edge& edge, double sign);
    void end(Overlap& to);
    double& area(int row, int column);

    const GridParts& parts_;
    Quadrature rule_;
    // The rows and columns of the texels that the rectangle may touch, inclusive, and their areas.
    int row0_ = 0, row1_ = 0, column0_ = 0, column1_ = 0;
    std::vector<double> areas_;
};

}  // namespace envbake::lighting
