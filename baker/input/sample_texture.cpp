// SPDX-License-Identifier: Apache-2.0
#include "baker/input/sample_texture.h"

#include <glm/common.hpp>

#include <algorithm>
#include <array>
#include <cmath>

namespace envbake {

namespace {

using Decode = std::array<float, 256>;

const Decode& as_stored() {
    static const Decode table = [] {
        Decode t{};
        for (std::size_t i = 0; i < t.size(); ++i) t[i] = static_cast<float>(i) / 255.0f;
        return t;
    }();
    return table;
}

/// Source: IEC 61966-2-1, the inverse of the sRGB transfer function.
const Decode& from_srgb() {
    static const Decode table = [] {
        Decode t{};
        for (std::size_t i = 0; i < t.size(); ++i) {
            const double c = static_cast<double>(i) / 255.0;
            t[i] =
                static_cast<float>(c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4));
        }
        return t;
    }();
    return table;
}

/// The two texels beside a coordinate, and the weight of the second.
struct Tap {
    int first;
    int second;
    float weight;
};

Tap tap(double u, int size, Wrap wrap) {
    if (!std::isfinite(u)) u = 0;
    if (wrap == Wrap::Repeat) u -= std::floor(u);
    if (wrap == Wrap::MirroredRepeat) {
        u -= 2 * std::floor(u / 2);
        u = u > 1 ? 2 - u : u;
    }
    u = std::clamp(u, 0.0, 1.0);
    const double x = u * size - 0.5;
    const double floor = std::floor(x);
    const int i = static_cast<int>(floor);
    // Within one period, a mirrored neighbour outside the image is the edge texel itself.
    const auto inside = [&](int n) {
        return wrap == Wrap::Repeat ? (n + size) % size : std::clamp(n, 0, size - 1);
    };
    return {inside(i), inside(i + 1), static_cast<float>(x - floor)};
}

/// Filters what `read` makes of the four bytes of a texel.
template <class Read>
auto filtered(const Image& image, const Texture& texture, Vec2 uv, const Read& read) {
    const auto& m = texture.uv_matrix;
    const double u = double{m[0]} * uv.x + double{m[1]} * uv.y + m[2];
    const double v = double{m[3]} * uv.x + double{m[4]} * uv.y + m[5];
    const Tap columns = tap(u, image.width, texture.wrap_u);
    const Tap rows = tap(v, image.height, texture.wrap_v);
    const auto texel = [&](int column, int row) {
        const std::size_t pixel =
            static_cast<std::size_t>(row) * static_cast<std::size_t>(image.width) +
            static_cast<std::size_t>(column);
        return read(image.rgba.data() + 4 * pixel);
    };
    const auto top = glm::mix(texel(columns.first, rows.first), texel(columns.second, rows.first),
                              columns.weight);
    const auto bottom = glm::mix(texel(columns.first, rows.second),
                                 texel(columns.second, rows.second), columns.weight);
    return glm::mix(top, bottom, rows.weight);
}

/// Colour channels are decoded before they are filtered, as graphics hardware does.
Vec4 sample(const Scene& scene, const Texture& texture, Vec2 uv, const Decode& color) {
    const Image& image = scene.images[static_cast<std::size_t>(texture.image)];
    if (image.rgba.empty()) return Vec4(1);
    return filtered(image, texture, uv, [&](const std::uint8_t* c) {
        return Vec4(color[c[0]], color[c[1]], color[c[2]], as_stored()[c[3]]);
    });
}

/// Of one value a vertex, at a point of a triangle.
template <class T>
T interpolated(const std::vector<T>& values, const std::uint32_t* corner, const Vec3& barycentric) {
    return values[corner[0]] * barycentric.x + values[corner[1]] * barycentric.y +
           values[corner[2]] * barycentric.z;
}

Vec2 coordinates(const Texture& texture, const Mesh& mesh, const std::uint32_t* corner,
                 const Vec3& barycentric) {
    const std::vector<Vec2>& set = texture.uv_set == 1 ? mesh.uv1 : mesh.uv0;
    return set.empty() ? Vec2(0) : interpolated(set, corner, barycentric);
}

}  // namespace

Vec4 sample_texture(const Scene& scene, const Texture& texture, Vec2 uv) {
    return sample(scene, texture, uv, as_stored());
}

SurfaceMaterial surface_material(const Scene& scene, const Mesh& mesh, std::size_t triangle,
                                 const Vec3& barycentric) {
    const Material& material = scene.materials[static_cast<std::size_t>(mesh.material)];
    const std::uint32_t* corner = mesh.triangles.data() + 3 * triangle;
    const auto sampled = [&](const Texture& texture, const Decode& color) {
        return sample(scene, texture, coordinates(texture, mesh, corner, barycentric), color);
    };

    Vec4 base(material.base_color, material.alpha);
    if (material.base_color_texture) base *= sampled(*material.base_color_texture, from_srgb());
    if (!mesh.colors.empty()) base *= interpolated(mesh.colors, corner, barycentric);

    SurfaceMaterial out;
    out.base_color = Vec3(base);
    out.alpha = base.a;
    out.metallic = material.metallic;
    out.perceptual_roughness = material.perceptual_roughness;
    if (material.metallic_roughness_texture) {
        const Vec4 texel = sampled(*material.metallic_roughness_texture, as_stored());
        out.perceptual_roughness *= texel.g;
        out.metallic *= texel.b;
    }
    out.r0 = glm::mix(material.dielectric_r0, out.base_color, out.metallic);
    out.emission = material.emission;
    if (material.emission_texture)
        out.emission *= Vec3(sampled(*material.emission_texture, from_srgb()));
    return out;
}

float surface_alpha(const Scene& scene, const Mesh& mesh, std::size_t triangle,
                    const Vec3& barycentric) {
    const Material& material = scene.materials[static_cast<std::size_t>(mesh.material)];
    const std::uint32_t* corner = mesh.triangles.data() + 3 * triangle;
    float alpha = material.alpha;
    if (const auto& texture = material.base_color_texture) {
        const Image& image = scene.images[static_cast<std::size_t>(texture->image)];
        if (!image.rgba.empty())
            alpha *= filtered(image, *texture, coordinates(*texture, mesh, corner, barycentric),
                              [](const std::uint8_t* c) { return as_stored()[c[3]]; });
    }
    if (!mesh.colors.empty()) {
        const auto a = [&](std::size_t k) { return mesh.colors[corner[k]].a; };
        alpha *= a(0) * barycentric.x + a(1) * barycentric.y + a(2) * barycentric.z;
    }
    return alpha;
}

}  // namespace envbake
