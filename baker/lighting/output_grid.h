// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/lighting/mip_layout.h"
#include "baker/math/vector.h"
#include "envbake/runtime/cube.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace envbake::lighting {

/// Some of a mip's texels, all within a rectangle of one cube face.
struct OutputTile {
    cube::Face face;
    double u0, u1, v0, v1;              ///< the rectangle about their centres, face coordinates
    std::vector<std::uint32_t> texels;  ///< where they lie in the mip
    std::vector<DVec3> directions;      ///< of their centres
    std::vector<double> x, y;           ///< where in the rectangle, each in [-1, 1]

    void reserve(std::size_t count);
    /// The direction at (x, y) of the rectangle.
    DVec3 towards(double at_x, double at_y) const;
    /// rows x columns directions that span the rectangle, its corners among them.
    std::vector<DVec3> lattice(int rows, int columns) const;
};

/// The texels of a mip and a way to cut them into tiles that are small and nearly square wherever
/// they lie: a square grid of tiles a cube face. A lat-long mip is cut by the same faces, each
/// texel belonging to the tile it looks at, so that neither its poles nor its seam are special.
class OutputGrid {
  public:
    /// `size` is the n of MipLayout, `tile_size` the edge of a tile in texels of a cube face.
    OutputGrid(MipLayout layout, int size, int tile_size);

    int faces() const { return layout_ == MipLayout::CubeFaces ? cube::kFaceCount : 1; }
    int width() const { return layout_ == MipLayout::CubeFaces ? size_ : 4 * size_; }
    int height() const { return layout_ == MipLayout::CubeFaces ? size_ : 2 * size_; }
    std::size_t texel_count() const;
    std::size_t tile_count() const;
    /// Tiles of a lat-long mip may be empty.
    OutputTile tile(std::size_t i) const;

  private:
    struct Angle {
        double sine, cosine;
    };
    DVec3 lat_long_direction(std::size_t texel) const;

    MipLayout layout_;
    int size_, tile_size_, across_;
    // Lat-long: angles of rows and columns, and the texels in order of their tiles.
    std::vector<Angle> theta_, phi_;
    std::vector<std::uint32_t> texels_, first_of_tile_;
};

}  // namespace envbake::lighting
