// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/shade.h"

#include "envbake/runtime/sh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace envbake::runtime {
namespace {

constexpr std::size_t kMaxCoeffs = static_cast<std::size_t>(sh::coeff_count(sh::kMaxBundleBands));

/// The bounds also catch NaN, which takes the lower one.
float clamp(float x, float low, float high) {
    return x > low ? (x < high ? x : high) : low;
}

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

SpecularAlbedo lookup_brdf(const BrdfTableView& table, float n_dot_v,
                           float perceptual_roughness) noexcept {
    if (table.rows == 0) return {};
    const float x =
        table_position(table.axes, TableAxis::NDotV, clamp(n_dot_v, 0, 1), table.columns);
    const float y = table_position(table.axes, TableAxis::Roughness,
                                   clamp(perceptual_roughness, 0, 1), table.rows);
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

float lookup_average_albedo(const BrdfTableView& table, float perceptual_roughness) noexcept {
    if (table.average_albedo.count == 0) return 0;
    const float y = table_position(table.axes, TableAxis::Roughness,
                                   clamp(perceptual_roughness, 0, 1), table.rows);
    const int row = std::min(static_cast<int>(y), table.rows - 2);
    const float fy = y - static_cast<float>(row);
    const auto i = static_cast<std::uint64_t>(row);
    return table.average_albedo[i] * (1 - fy) + table.average_albedo[i + 1] * fy;
}

Rgb specular(const Bundle& bundle, Distribution distribution, const Vec3& n, const Vec3& v,
             float perceptual_roughness, const Rgb& r0) noexcept {
    const float n_dot_v = n[0] * v[0] + n[1] * v[1] + n[2] * v[2];
    const Vec3 mirrored{2 * n_dot_v * n[0] - v[0], 2 * n_dot_v * n[1] - v[1],
                        2 * n_dot_v * n[2] - v[2]};
    const Rgb radiance = sample_mips(bundle.mips(distribution), mirrored, perceptual_roughness);
    const SpecularAlbedo albedo =
        lookup_brdf(bundle.brdf(distribution), n_dot_v, perceptual_roughness);
    return {radiance[0] * (r0[0] * albedo.a + albedo.b),
            radiance[1] * (r0[1] * albedo.a + albedo.b),
            radiance[2] * (r0[2] * albedo.a + albedo.b)};
}

Rgb specular(const Bundle& bundle, const Vec3& n, const Vec3& v, float perceptual_roughness,
             const Rgb& r0) noexcept {
    return specular(bundle, bundle.distribution(), n, v, perceptual_roughness, r0);
}

Rgb reflect_light(const DominantLight& light, const Surface& surface, const Vec3& v) noexcept {
    const Vec3& n = surface.normal;
    const Vec3& l = light.direction;
    const auto dot = [](const Vec3& a, const Vec3& b) {
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    };
    const float n_dot_l = dot(n, l);
    if (!(n_dot_l > 0)) return {};
    const Vec3 sum{l[0] + v[0], l[1] + v[1], l[2] + v[2]};
    const float length = std::sqrt(dot(sum, sum));
    float specular_lobe = 0, fresnel = 0;
    if (length > 0 && surface.r0 != Rgb{}) {
        const float alpha =
            clamp(surface.perceptual_roughness, 0, 1) * clamp(surface.perceptual_roughness, 0, 1);
        const float spread = light.angular_radius / 2;
        const float widened = clamp(std::sqrt(alpha * alpha + spread * spread), 1e-3f, 1);
        const float n_dot_h = clamp(dot(n, sum) / length, 0, 1);
        const float v_dot_h = clamp(dot(v, sum) / length, 0, 1);
        const float n_dot_v = clamp(dot(n, v), 1e-4f, 1);
        const float l_cosine = clamp(n_dot_l, 0, 1);
        specular_lobe =
            surface.distribution == Distribution::Ggx
                ? ggx_d(n_dot_h, widened) * ggx_visibility(l_cosine, n_dot_v, widened)
                : beckmann_d(n_dot_h, widened) * beckmann_visibility(l_cosine, n_dot_v, widened);
        fresnel = schlick_weight(v_dot_h);
    }
    Rgb L;
    for (std::size_t c = 0; c < 3; ++c) {
        const float f = surface.albedo[c] * std::numbers::inv_pi_v<float> +
                        specular_lobe * (surface.r0[c] + (1 - surface.r0[c]) * fresnel);
        L[c] = light.irradiance[c] * n_dot_l * f;
    }
    return L;
}

}  // namespace envbake::runtime
