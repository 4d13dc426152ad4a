// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/shade.h"

#include "envbake/runtime/cube.h"
#include "envbake/runtime/sh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace envbake::runtime {
namespace {

constexpr std::size_t kMaxCoeffs = static_cast<std::size_t>(sh::coeff_count(sh::kMaxBundleBands));

/// The bounds also catch NaN, which takes the lower one.
float clamp(float x, float low, float high) {
    return x > low ? (x < high ? x : high) : low;
}

/// In this form a constant stays exactly what it is.
Rgb mix(const Rgb& a, const Rgb& b, float t) {
    return {a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t, a[2] + (b[2] - a[2]) * t};
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

class Level {
  public:
    explicit Level(const MipLevel& level) : texels_(level.texels), size_(level.face_size) {}

    Rgb sample(const cube::FacePoint<float>& p) const {
        const float x = texel_coordinate(p.u), y = texel_coordinate(p.v);
        const int column = static_cast<int>(std::floor(x)), row = static_cast<int>(std::floor(y));
        const bool inside = column >= 0 && row >= 0 && column + 1 < size_ && row + 1 < size_;
        const auto at = [&](int r, int c) {
            return inside ? inner({p.face, r, c}) : outer({p.face, r, c});
        };
        const Rgb upper = mix(at(row, column), at(row, column + 1), x - static_cast<float>(column));
        const Rgb lower =
            mix(at(row + 1, column), at(row + 1, column + 1), x - static_cast<float>(column));
        return mix(upper, lower, y - static_cast<float>(row));
    }

  private:
    float texel_coordinate(float u) const {
        return (clamp(u, -1, 1) + 1) / 2 * static_cast<float>(size_) - 0.5f;
    }

    Rgb inner(const Texel& t) const {
        const auto size = static_cast<std::uint64_t>(size_);
        const std::uint64_t i =
            3 * ((static_cast<std::uint64_t>(t.face) * size + static_cast<std::uint64_t>(t.row)) *
                     size +
                 static_cast<std::uint64_t>(t.column));
        return {texels_[i], texels_[i + 1], texels_[i + 2]};
    }

    /// A texel at most one step outside of its face.
    Rgb outer(const Texel& t) const {
        const Texel nearest{t.face, std::clamp(t.row, 0, size_ - 1),
                            std::clamp(t.column, 0, size_ - 1)};
        const bool beyond_row = t.row != nearest.row, beyond_column = t.column != nearest.column;
        if (!beyond_row && !beyond_column) return inner(t);
        if (!beyond_row || !beyond_column) return inner(fold(t, size_));
        const Rgb a = inner(nearest), b = inner(fold({t.face, t.row, nearest.column}, size_)),
                  c = inner(fold({t.face, nearest.row, t.column}, size_));
        return {(a[0] + b[0] + c[0]) / 3, (a[1] + b[1] + c[1]) / 3, (a[2] + b[2] + c[2]) / 3};
    }

    FloatView texels_;
    int size_;
};

}  // namespace

Rgb irradiance(const ShLightingView& lighting, const Vec3& n) noexcept {
    std::array<float, kMaxCoeffs> basis;
    sh::evaluate(lighting.bands, n[0], n[1], n[2], basis.data());
    std::array<double, 3> sum{};
    for (int l = 0; l < lighting.bands; ++l) {
        const double convolution = sh::clamped_cosine(l);
        if (convolution == 0) continue;
        for (int m = -l; m <= l; ++m) {
            const auto i = static_cast<std::size_t>(sh::index(l, m));
            const double weight = convolution * static_cast<double>(basis[i]);
            for (std::size_t c = 0; c < 3; ++c) {
                sum[c] += weight * static_cast<double>(lighting.coeffs[3 * i + c]);
            }
        }
    }
    return {static_cast<float>(sum[0]), static_cast<float>(sum[1]), static_cast<float>(sum[2])};
}

Rgb diffuse_exit(std::span<const float> row, const ShLightingView& lighting) noexcept {
    const std::size_t count = std::min(row.size(), lighting.coeffs.size() / 3);
    const float* light = lighting.coeffs.data();
    // Two sums a channel: the additions of one do not wait for each other.
    float even[3] = {}, odd[3] = {};
    std::size_t i = 0;
    for (; i + 1 < count; i += 2) {
        for (std::size_t c = 0; c < 3; ++c) {
            even[c] += row[i] * light[3 * i + c];
            odd[c] += row[i + 1] * light[3 * i + 3 + c];
        }
    }
    if (i < count) {
        for (std::size_t c = 0; c < 3; ++c) even[c] += row[i] * light[3 * i + c];
    }
    return {even[0] + odd[0], even[1] + odd[1], even[2] + odd[2]};
}

void diffuse_exit(const TransportView& transport, const ShLightingView& lighting,
                  std::uint64_t first, std::span<Rgb> out) noexcept {
    const auto coeff_count = static_cast<std::size_t>(sh::coeff_count(transport.bands));
    const auto channels = static_cast<std::size_t>(transport.channels);
    const std::size_t row_size = coeff_count * channels;
    const std::size_t shared = std::min(coeff_count, lighting.coeffs.size() / 3);

    for (std::size_t k = 0; k < out.size(); ++k) {
        out[k] = {};
        if (transport.bands == 0 || k >= transport.vertex_count ||
            first >= transport.vertex_count - k) {
            continue;
        }
        const std::uint64_t begin = (first + k) * row_size;
        if (channels == 1 && !transport.values.is_half) {
            const float* values = static_cast<const float*>(transport.values.data);
            out[k] = diffuse_exit(std::span(values + begin, coeff_count), lighting);
            continue;
        }
        for (std::size_t i = 0; i < shared; ++i) {
            for (std::size_t c = 0; c < 3; ++c) {
                const std::size_t slot = channels == 3 ? 3 * i + c : i;
                out[k][c] += transport.values[begin + slot] * lighting.coeffs[3 * i + c];
            }
        }
    }
}

Rgb sample_mips(const MipsView& mips, const Vec3& direction, float perceptual_roughness) noexcept {
    if (mips.level_count == 0) return {};
    const float position = clamp(perceptual_roughness * static_cast<float>(mips.level_count - 1),
                                 static_cast<float>(mips.first), static_cast<float>(mips.last));
    const int level = static_cast<int>(position);
    const float fraction = position - static_cast<float>(level);
    const cube::FacePoint<float> p = cube::project(direction);
    const auto at = [&](int k) {
        return Level(mips.levels[static_cast<std::size_t>(k)]).sample(p);
    };
    return fraction > 0 ? mix(at(level), at(level + 1), fraction) : at(level);
}

SpecularAlbedo lookup_brdf(const BrdfTableView& table, float n_dot_v,
                           float perceptual_roughness) noexcept {
    if (table.rows == 0) return {};
    const float x = table_position(table.axes, clamp(n_dot_v, 0, 1), table.columns);
    const float y = table_position(table.axes, clamp(perceptual_roughness, 0, 1), table.rows);
    const int column = std::min(static_cast<int>(x), table.columns - 2);
    const int row = std::min(static_cast<int>(y), table.rows - 2);
    const float fx = x - static_cast<float>(column), fy = y - static_cast<float>(row);

    const auto columns = static_cast<std::uint64_t>(table.columns);
    const std::uint64_t first =
        2 * (static_cast<std::uint64_t>(row) * columns + static_cast<std::uint64_t>(column));
    const auto value = [&](std::uint64_t channel) {
        const std::uint64_t i = first + channel, j = i + 2 * columns;
        const float upper = table.texels[i] * (1 - fx) + table.texels[i + 2] * fx;
        const float lower = table.texels[j] * (1 - fx) + table.texels[j + 2] * fx;
        return upper * (1 - fy) + lower * fy;
    };
    return {value(0), value(1)};
}

Rgb specular(const Bundle& bundle, const Vec3& n, const Vec3& v, float perceptual_roughness,
             const Rgb& r0) noexcept {
    const float n_dot_v = n[0] * v[0] + n[1] * v[1] + n[2] * v[2];
    const Vec3 mirrored{2 * n_dot_v * n[0] - v[0], 2 * n_dot_v * n[1] - v[1],
                        2 * n_dot_v * n[2] - v[2]};
    const Rgb radiance = sample_mips(bundle.mips(), mirrored, perceptual_roughness);
    const SpecularAlbedo albedo = lookup_brdf(bundle.brdf(), n_dot_v, perceptual_roughness);
    return {radiance[0] * (r0[0] * albedo.a + albedo.b),
            radiance[1] * (r0[1] * albedo.a + albedo.b),
            radiance[2] * (r0[2] * albedo.a + albedo.b)};
}

}  // namespace envbake::runtime
