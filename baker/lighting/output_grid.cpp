// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/output_grid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace envbake::lighting {
namespace {

std::size_t index(int i) {
    return static_cast<std::size_t>(i);
}

/// Face coordinate of the centre of texel i of `size`.
double centre(int i, int size) {
    return (2.0 * i + 1) / size - 1;
}

/// x in low .. high as -1 .. 1.
double place(double x, double low, double high) {
    return high > low ? std::clamp((2 * x - low - high) / (high - low), -1.0, 1.0) : 0.0;
}

}  // namespace

DVec3 OutputTile::towards(double at_x, double at_y) const {
    const auto w =
        cube::direction(face, (u0 + u1 + at_x * (u1 - u0)) / 2, (v0 + v1 + at_y * (v1 - v0)) / 2);
    return {w[0], w[1], w[2]};
}

void OutputTile::reserve(std::size_t count) {
    texels.reserve(count);
    directions.reserve(count);
    x.reserve(count);
    y.reserve(count);
}

std::vector<DVec3> OutputTile::lattice(int rows, int columns) const {
    std::vector<DVec3> points;
    points.reserve(index(rows * columns));
    for (int r = 0; r < rows; ++r) {
        for (int c = 0; c < columns; ++c) {
            points.push_back(towards(2.0 * c / (columns - 1) - 1, 2.0 * r / (rows - 1) - 1));
        }
    }
    return points;
}

OutputGrid::OutputGrid(MipLayout layout, int size, int tile_size)
    : layout_(layout),
      size_(size),
      tile_size_(tile_size),
      across_((size + tile_size - 1) / tile_size) {
    if (layout == MipLayout::CubeFaces) return;
    using std::numbers::pi;
    const auto angle = [](double radians) { return Angle{std::sin(radians), std::cos(radians)}; };
    for (int r = 0; r < height(); ++r) theta_.push_back(angle(pi * (r + 0.5) / height()));
    for (int c = 0; c < width(); ++c) phi_.push_back(angle(2 * pi * (c + 0.5) / width() - pi));

    // Sorted by tile: how many each has, where each begins, then one by one.
    std::vector<std::uint32_t> tile_of(texel_count());
    first_of_tile_.assign(tile_count() + 1, 0);
    for (std::size_t i = 0; i < tile_of.size(); ++i) {
        const DVec3 w = lat_long_direction(i);
        const auto p = cube::project(std::array<double, 3>{w.x, w.y, w.z});
        const auto along = [&](double x) {
            return std::clamp(static_cast<int>((x + 1) / 2 * size_ / tile_size_), 0, across_ - 1);
        };
        const int tile = (static_cast<int>(p.face) * across_ + along(p.v)) * across_ + along(p.u);
        tile_of[i] = static_cast<std::uint32_t>(tile);
        ++first_of_tile_[index(tile) + 1];
    }
    for (std::size_t t = 0; t < tile_count(); ++t) first_of_tile_[t + 1] += first_of_tile_[t];
    std::vector<std::uint32_t> next = first_of_tile_;
    texels_.resize(tile_of.size());
    for (std::size_t i = 0; i < tile_of.size(); ++i) {
        texels_[next[tile_of[i]]++] = static_cast<std::uint32_t>(i);
    }
}

std::size_t OutputGrid::texel_count() const {
    return index(faces()) * index(height()) * index(width());
}

std::size_t OutputGrid::tile_count() const {
    return index(cube::kFaceCount) * index(across_) * index(across_);
}

DVec3 OutputGrid::lat_long_direction(std::size_t texel) const {
    const Angle& theta = theta_[texel / index(width())];
    const Angle& phi = phi_[texel % index(width())];
    return {theta.sine * phi.cosine, theta.cosine, theta.sine * phi.sine};
}

OutputTile OutputGrid::tile(std::size_t i) const {
    const std::size_t a_face = index(across_) * index(across_);
    OutputTile tile;
    tile.face = static_cast<cube::Face>(i / a_face);

    if (layout_ == MipLayout::CubeFaces) {
        const int row = static_cast<int>(i % a_face) / across_ * tile_size_;
        const int column = static_cast<int>(i % a_face) % across_ * tile_size_;
        const int rows = std::min(tile_size_, size_ - row);
        const int columns = std::min(tile_size_, size_ - column);
        tile.u0 = centre(column, size_);
        tile.u1 = centre(column + columns - 1, size_);
        tile.v0 = centre(row, size_);
        tile.v1 = centre(row + rows - 1, size_);
        const std::size_t first = i / a_face * index(size_) * index(size_);
        tile.reserve(index(rows * columns));
        for (int r = row; r < row + rows; ++r) {
            for (int c = column; c < column + columns; ++c) {
                const double u = centre(c, size_), v = centre(r, size_);
                const auto w = cube::direction(tile.face, u, v);
                tile.texels.push_back(
                    static_cast<std::uint32_t>(first + index(r) * index(size_) + index(c)));
                tile.directions.emplace_back(w[0], w[1], w[2]);
                tile.x.push_back(place(u, tile.u0, tile.u1));
                tile.y.push_back(place(v, tile.v0, tile.v1));
            }
        }
        return tile;
    }
    std::vector<DVec2> points;
    tile.reserve(first_of_tile_[i + 1] - first_of_tile_[i]);
    tile.u0 = tile.v0 = 1;
    tile.u1 = tile.v1 = -1;
    for (std::uint32_t t = first_of_tile_[i]; t < first_of_tile_[i + 1]; ++t) {
        const DVec3 w = lat_long_direction(texels_[t]);
        const auto p = cube::project(std::array<double, 3>{w.x, w.y, w.z});
        tile.texels.push_back(texels_[t]);
        tile.directions.push_back(w);
        points.emplace_back(p.u, p.v);
        tile.u0 = std::min(tile.u0, p.u);
        tile.u1 = std::max(tile.u1, p.u);
        tile.v0 = std::min(tile.v0, p.v);
        tile.v1 = std::max(tile.v1, p.v);
    }
    for (const DVec2& p : points) {
        tile.x.push_back(place(p.x, tile.u0, tile.u1));
        tile.y.push_back(place(p.y, tile.v0, tile.v1));
    }
    return tile;
}

}  // namespace envbake::lighting
