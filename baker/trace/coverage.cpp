// SPDX-License-Identifier: Apache-2.0
#include "baker/trace/coverage.h"

#include "baker/core/parallel.h"
#include "baker/math/vector.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

namespace envbake {

namespace {

/// Of alpha; empty while nothing has been added.
struct Range {
    float low = std::numeric_limits<float>::infinity();
    float high = -std::numeric_limits<float>::infinity();

    void add(float alpha) {
        low = std::min(low, alpha);
        high = std::max(high, alpha);
    }
    /// Of products; alpha is never negative. Rounding keeps order, so bounds stay bounds.
    Range operator*(const Range& other) const { return {low * other.low, high * other.high}; }
};

Coverage coverage(const Range& alpha, float cutoff) {
    if (alpha.low >= cutoff) return Coverage::Solid;
    return alpha.high < cutoff ? Coverage::Clear : Coverage::Holed;
}

/// Of the alpha of texels. Bytes, because there are many to look at.
struct TexelRange {
    std::uint8_t low = 255;
    std::uint8_t high = 0;

    void add(std::uint8_t alpha) {
        low = std::min(low, alpha);
        high = std::max(high, alpha);
    }
    /// The division is that of the look-up: texels equal to the cut-off are so to the bit.
    Range alpha() const {
        return {static_cast<float>(low) / 255.0f, static_cast<float>(high) / 255.0f};
    }
};

Range whole_image(const Image& image) {
    TexelRange range;
    for (std::size_t i = 3; i < image.rgba.size(); i += 4) range.add(image.rgba[i]);
    return range.alpha();
}

/// Where texel `n` of a row that goes on for ever stands in an image of that size.
std::int64_t wrapped(std::int64_t n, std::int64_t size, Wrap wrap) {
    if (wrap == Wrap::ClampToEdge) return std::clamp<std::int64_t>(n, 0, size - 1);
    const std::int64_t period = wrap == Wrap::Repeat ? size : 2 * size;
    const std::int64_t m = (n % period + period) % period;
    return m < size ? m : period - 1 - m;
}

/// Texel centres stand on the integers here: a bilinear look-up at x reads floor(x) and the next.
using TexelTriangle = std::array<DVec2, 3>;

/// A look-up's own error: floats in the coordinates, and barycentric weights a little outside.
double look_up_error(const TexelTriangle& t) {
    double largest = 0;
    for (const DVec2& p : t) largest = std::max({largest, std::abs(p.x), std::abs(p.y)});
    return 1.0 / 16 + 1e-5 * largest;
}

/// The columns of the part of the triangle that lies between two rows.
struct Span {
    double left = std::numeric_limits<double>::infinity();
    double right = -std::numeric_limits<double>::infinity();
};
Span columns_between(const TexelTriangle& t, double top, double bottom) {
    Span span;
    for (std::size_t i = 0; i < 3; ++i) {
        const DVec2 a = t[i], b = t[(i + 1) % 3];
        if (std::max(a.y, b.y) < top || std::min(a.y, b.y) > bottom) continue;
        for (const double row : {std::clamp(a.y, top, bottom), std::clamp(b.y, top, bottom)}) {
            const double along = a.y == b.y ? 0 : (row - a.y) / (b.y - a.y);
            const double x = a.x + (b.x - a.x) * along;
            span.left = std::min(span.left, x);
            span.right = std::max(span.right, x);
        }
        if (a.y == b.y) {
            span.left = std::min(span.left, b.x);
            span.right = std::max(span.right, b.x);
        }
    }
    return span;
}

/// What `decide` makes of the alpha of every texel that a look-up on the triangle can touch: a
/// texel is read from less than one texel away. Holed as soon as it is, and where there are too
/// many texels to look at.
template <class Decide>
Coverage coverage_of_texels(const TexelTriangle& t, const Image& image, const Texture& texture,
                            const Decide& decide) {
    constexpr std::int64_t kMaxTexels = 1 << 16;
    for (const DVec2& p : t)  // NaN, too
        if (!(std::abs(p.x) < 1e9 && std::abs(p.y) < 1e9)) return Coverage::Holed;
    const auto [top, bottom] = std::minmax({t[0].y, t[1].y, t[2].y});
    if (bottom - top > kMaxTexels) return Coverage::Holed;

    const double error = look_up_error(t);
    const auto first = [&](double x) { return static_cast<std::int64_t>(std::floor(x - error)); };
    const auto last = [&](double x) {
        return static_cast<std::int64_t>(std::floor(x + error)) + 1;
    };
    TexelRange range;
    std::int64_t count = 0;
    for (std::int64_t row = first(top); row <= last(bottom); ++row) {
        const auto r = static_cast<double>(row);
        const Span columns = columns_between(t, r - 1 - error, r + 1 + error);
        if (columns.left > columns.right) continue;
        const std::int64_t begin = first(columns.left), end = last(columns.right) + 1;
        count += end - begin;
        if (count > kMaxTexels) return Coverage::Holed;
        const std::uint8_t* const alpha =
            image.rgba.data() + 4 * wrapped(row, image.height, texture.wrap_v) * image.width + 3;
        const std::int64_t inside = wrapped(begin, image.width, Wrap::Repeat);
        if (texture.wrap_u == Wrap::Repeat && inside + (end - begin) <= image.width) {
            for (std::int64_t i = inside; i < inside + (end - begin); ++i) range.add(alpha[4 * i]);
        } else {
            for (std::int64_t column = begin; column < end; ++column)
                range.add(alpha[4 * wrapped(column, image.width, texture.wrap_u)]);
        }
        if (decide(range.alpha()) == Coverage::Holed) return Coverage::Holed;
    }
    return decide(range.alpha());
}

TexelTriangle texel_triangle(const Mesh& mesh, std::size_t triangle, const Image& image,
                             const Texture& texture) {
    const std::vector<Vec2>& set = texture.uv_set == 1 ? mesh.uv1 : mesh.uv0;
    const auto& m = texture.uv_matrix;
    TexelTriangle t;
    for (std::size_t k = 0; k < 3; ++k) {
        const DVec2 uv = set.empty() ? DVec2(0) : DVec2(set[mesh.triangles[3 * triangle + k]]);
        t[k] = {(double{m[0]} * uv.x + double{m[1]} * uv.y + double{m[2]}) * image.width - 0.5,
                (double{m[3]} * uv.x + double{m[4]} * uv.y + double{m[5]}) * image.height - 0.5};
    }
    return t;
}

/// `image_range` is of the texture's whole image; null without a texture, or without its image.
MeshCoverage coverage_of(const Scene& scene, const Mesh& mesh, const Range* image_range) {
    const Material& material = scene.materials[static_cast<std::size_t>(mesh.material)];
    const Range factor{material.alpha, material.alpha};
    const auto corner_alpha = [&](std::size_t triangle) {
        Range range;
        for (std::size_t k = 0; k < 3; ++k)
            range.add(mesh.colors.empty() ? 1 : mesh.colors[mesh.triangles[3 * triangle + k]].a);
        return range;
    };
    const Range anywhere = image_range != nullptr ? factor * *image_range : factor;
    if (mesh.colors.empty())
        if (const Coverage all = coverage(anywhere, material.alpha_cutoff); all != Coverage::Holed)
            return {all, {}};

    MeshCoverage result{Coverage::Holed, std::vector<Coverage>(mesh.triangle_count())};
    constexpr std::size_t kBlock = 256;
    parallel_for((mesh.triangle_count() + kBlock - 1) / kBlock, [&](std::size_t block) {
        const std::size_t end = std::min((block + 1) * kBlock, mesh.triangle_count());
        for (std::size_t i = block * kBlock; i < end; ++i) {
            const Range corners = corner_alpha(i);
            Coverage& decided = result.triangles[i];
            decided = coverage(anywhere * corners, material.alpha_cutoff);
            if (decided != Coverage::Holed || image_range == nullptr) continue;
            const Texture& texture = *material.base_color_texture;
            const Image& image = scene.images[static_cast<std::size_t>(texture.image)];
            decided = coverage_of_texels(
                texel_triangle(mesh, i, image, texture), image, texture, [&](const Range& texels) {
                    return coverage(factor * texels * corners, material.alpha_cutoff);
                });
        }
    });
    return result;
}

}  // namespace

std::vector<MeshCoverage> coverage_of(const Scene& scene) {
    std::vector<std::optional<Range>> images(scene.images.size());  // looked at once
    std::vector<MeshCoverage> result;
    for (const Mesh& mesh : scene.meshes) {
        const Material& material = scene.materials[static_cast<std::size_t>(mesh.material)];
        if (material.alpha_mode != AlphaMode::Mask) {
            result.emplace_back();
            continue;
        }
        const Range* image_range = nullptr;
        if (material.base_color_texture) {
            const auto index = static_cast<std::size_t>(material.base_color_texture->image);
            if (!scene.images[index].rgba.empty()) {
                if (!images[index]) images[index] = whole_image(scene.images[index]);
                image_range = &*images[index];
            }
        }
        result.push_back(coverage_of(scene, mesh, image_range));
    }
    return result;
}

}  // namespace envbake
