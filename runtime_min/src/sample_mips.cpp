// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/cube.h"
#include "envbake/runtime/lat_long.h"
#include "envbake/runtime/shade.h"

#include <algorithm>
#include <cmath>

namespace envbake::runtime {
namespace {

/// The bounds also catch NaN, which takes the lower one.
float clamp(float x, float low, float high) {
    return x > low ? (x < high ? x : high) : low;
}

/// In this form a constant stays exactly what it is.
Rgb mix(const Rgb& a, const Rgb& b, float t) {
    return {a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t, a[2] + (b[2] - a[2]) * t};
}

/// Texel `index` of a level, counted through faces and rows.
Rgb texel_of(const MipLevel& level, std::uint64_t index) {
    if (level.channels == 1) {
        const float grey = level.texels[index];
        return {grey, grey, grey};
    }
    return {level.texels[3 * index], level.texels[3 * index + 1], level.texels[3 * index + 2]};
}

/// Bilinear at (x, y) in texels; `at(row, column)` may be asked for one step outside the image.
template <class At>
Rgb bilinear(float x, float y, const At& at) {
    const int column = static_cast<int>(std::floor(x)), row = static_cast<int>(std::floor(y));
    const float fx = x - static_cast<float>(column), fy = y - static_cast<float>(row);
    const Rgb upper = mix(at(row, column), at(row, column + 1), fx);
    const Rgb lower = mix(at(row + 1, column), at(row + 1, column + 1), fx);
    return mix(upper, lower, fy);
}

struct Texel {
    cube::Face face;
    int row, column;
};

/// The texel of the adjoining face for one that is a single step outside across one edge. The
/// outside half texel is folded over the edge: its centre ends up on the adjoining face, at the
/// same place along the edge.
Texel fold(const Texel& outside, int size) {
    const float scale = 1 / static_cast<float>(size);
    const float u = static_cast<float>(2 * outside.column + 1 - size) * scale;
    const float v = static_cast<float>(2 * outside.row + 1 - size) * scale;
    // Moving along u or v changes one component of the point, the distance from the centre another.
    const auto centre = cube::point(outside.face, 0.0f, 0.0f);
    auto folded = cube::point(outside.face, clamp(u, -1, 1), clamp(v, -1, 1));
    for (std::size_t axis = 0; axis < 3; ++axis) folded[axis] -= centre[axis] * scale;
    const auto p = cube::project(folded);
    const auto to_index = [&](float t) {
        const int index = static_cast<int>((t + 1) / 2 * static_cast<float>(size));
        return std::clamp(index, 0, size - 1);
    };
    return {p.face, to_index(p.v), to_index(p.u)};
}

class CubeLevel {
  public:
    explicit CubeLevel(const MipLevel& level) : level_(level), size_(level.width) {}

    Rgb sample(const cube::FacePoint<float>& p) const {
        const float x = texel_coordinate(p.u), y = texel_coordinate(p.v);
        const float last = static_cast<float>(size_ - 1);
        if (x >= 0 && y >= 0 && x < last && y < last) {
            return bilinear(x, y, [&](int row, int column) {
                return inner({p.face, row, column});
            });
        }
        return bilinear(x, y, [&](int row, int column) { return at({p.face, row, column}); });
    }

  private:
    float texel_coordinate(float u) const {
        return (clamp(u, -1, 1) + 1) / 2 * static_cast<float>(size_) - 0.5f;
    }

    Rgb inner(const Texel& t) const {
        const auto size = static_cast<std::uint64_t>(size_);
        return texel_of(
            level_,
            (static_cast<std::uint64_t>(t.face) * size + static_cast<std::uint64_t>(t.row)) * size +
                static_cast<std::uint64_t>(t.column));
    }

    /// A texel at most one step outside of its face.
    Rgb at(const Texel& t) const {
        const Texel nearest{t.face, std::clamp(t.row, 0, size_ - 1),
                            std::clamp(t.column, 0, size_ - 1)};
        const bool beyond_row = t.row != nearest.row, beyond_column = t.column != nearest.column;
        if (!beyond_row && !beyond_column) return inner(t);
        if (!beyond_row || !beyond_column) return inner(fold(t, size_));
        const Rgb a = inner(nearest), b = inner(fold({t.face, t.row, nearest.column}, size_)),
                  c = inner(fold({t.face, nearest.row, t.column}, size_));
        return {(a[0] + b[0] + c[0]) / 3, (a[1] + b[1] + c[1]) / 3, (a[2] + b[2] + c[2]) / 3};
    }

    const MipLevel& level_;
    int size_;
};

Rgb sample_lat_long(const MipLevel& level, const lat_long::ImagePoint<float>& p) {
    const int width = level.width, height = level.height;
    return bilinear(clamp(p.u, 0, 1) * static_cast<float>(width) - 0.5f,
                    clamp(p.v, 0, 1) * static_cast<float>(height) - 0.5f, [&](int row, int column) {
                        const bool beyond_pole = row < 0 || row >= height;
                        const int turned = column + (beyond_pole ? width / 2 : 0);
                        const int c = (turned + width) % width;
                        const int r = std::clamp(row, 0, height - 1);
                        return texel_of(level, static_cast<std::uint64_t>(r) *
                                                       static_cast<std::uint64_t>(width) +
                                                   static_cast<std::uint64_t>(c));
                    });
}

}  // namespace

Rgb sample_mips(const MipsView& mips, const Vec3& direction, float perceptual_roughness) noexcept {
    if (mips.level_count == 0) return {};
    const float position = clamp(perceptual_roughness * static_cast<float>(mips.level_count - 1),
                                 static_cast<float>(mips.first), static_cast<float>(mips.last));
    const int below = static_cast<int>(position);
    const float fraction = position - static_cast<float>(below);
    const auto between_levels = [&](const auto& sample) {
        const auto at = [&](int k) { return sample(mips.levels[static_cast<std::size_t>(k)]); };
        return fraction > 0 ? mix(at(below), at(below + 1), fraction) : at(below);
    };
    if (mips.layout == MipLayout::LatLong) {
        const auto p = lat_long::project(direction);
        return between_levels([&](const MipLevel& level) { return sample_lat_long(level, p); });
    }
    const auto p = cube::project(direction);
    return between_levels([&](const MipLevel& level) { return CubeLevel(level).sample(p); });
}

}  // namespace envbake::runtime
