// SPDX-License-Identifier: Apache-2.0
#include "baker/plan/facts.h"

#include "envbake/runtime/cube.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace envbake {

namespace {

float largest(const Vec3& v) {
    return std::max({v.x, v.y, v.z});
}

/// Steradians of a texel, exact for both grids.
struct TexelSolidAngle {
    const Environment& environment;

    double operator()(std::size_t texel) const {
        if (const auto* grid = std::get_if<LatLongGrid>(&environment.grid)) {
            const std::size_t row = texel / static_cast<std::size_t>(grid->width);
            const std::size_t column = texel % static_cast<std::size_t>(grid->width);
            return (std::cos(grid->theta_edges[row]) - std::cos(grid->theta_edges[row + 1])) *
                   (grid->phi_edges[column + 1] - grid->phi_edges[column]);
        }
        const auto& cube_grid = std::get<CubeGrid>(environment.grid);
        const auto size = static_cast<std::size_t>(cube_grid.size);
        const std::size_t row = texel % (size * size) / size;
        const std::size_t column = texel % size;
        return cube::solid_angle(cube_grid.edges[column], cube_grid.edges[column + 1],
                                 cube_grid.edges[row], cube_grid.edges[row + 1]);
    }
};

/// Smallest and largest value of one channel of a decoded image, 0 .. 1; 1 without an image.
std::pair<float, float> channel_range(const Scene& scene, const std::optional<Texture>& texture,
                                      int channel) {
    if (!texture) return {1.0f, 1.0f};
    const Image& image = scene.images[static_cast<std::size_t>(texture->image)];
    if (image.rgba.empty()) return {0.0f, 1.0f};
    std::uint8_t low = 255, high = 0;
    for (std::size_t at = static_cast<std::size_t>(channel); at < image.rgba.size(); at += 4) {
        low = std::min(low, image.rgba[at]);
        high = std::max(high, image.rgba[at]);
    }
    return {static_cast<float>(low) / 255.0f, static_cast<float>(high) / 255.0f};
}

float largest_base_color(const Scene& scene, const Material& material) {
    float strongest = 0;
    for (int channel = 0; channel < 3; ++channel)
        strongest = std::max(strongest,
                             material.base_color[channel] *
                                 channel_range(scene, material.base_color_texture, channel).second);
    return strongest;
}

}  // namespace

EnvironmentFacts collect_facts(const Environment& environment) {
    EnvironmentFacts facts;
    const TexelSolidAngle solid_angle{environment};
    Vec3 low = environment.radiance.front(), high = low;
    double sum = 0;
    for (std::size_t i = 0; i < environment.radiance.size(); ++i) {
        const Vec3& L = environment.radiance[i];
        for (int c = 0; c < 3; ++c) {
            low[c] = std::min(low[c], L[c]);
            high[c] = std::max(high[c], L[c]);
        }
        sum += solid_angle(i) * (static_cast<double>(L.x) + L.y + L.z) / 3;
    }
    facts.mean = sum / (4 * std::numbers::pi);
    facts.peak = largest(high);
    facts.constant = largest(high - low) <= 1e-6f * largest(high);
    return facts;
}

std::vector<MaterialFacts> collect_material_facts(const Scene& scene) {
    std::vector<MaterialFacts> facts;
    for (const Material& material : scene.materials) {
        const auto [low_g, high_g] = channel_range(scene, material.metallic_roughness_texture, 1);
        const auto [low_b, high_b] = channel_range(scene, material.metallic_roughness_texture, 2);
        const float max_metallic = material.metallic * high_b;
        const float base_color = largest_base_color(scene, material);
        MaterialFacts f;
        f.name = material.name;
        f.min_roughness = material.perceptual_roughness * low_g;
        f.max_roughness = material.perceptual_roughness * high_g;
        f.max_r0 = std::max(
            largest(material.dielectric_r0) * (material.metallic * low_b < 1 ? 1.0f : 0.0f),
            base_color * max_metallic);
        f.max_diffuse_albedo = base_color * (1 - material.metallic * low_b);
        facts.push_back(f);
    }
    return facts;
}

}  // namespace envbake
