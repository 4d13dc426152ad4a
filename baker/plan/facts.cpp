// SPDX-License-Identifier: Apache-2.0
#include "baker/plan/facts.h"

#include "baker/core/parallel.h"
#include "envbake/runtime/cube.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>

namespace envbake {

namespace {

float largest(const Vec3& v) {
    return std::max({v.x, v.y, v.z});
}

/// The solid angles of the texels of one row, of the image or of any face.
std::vector<double> solid_angles(const std::variant<LatLongGrid, CubeGrid>& any_grid,
                                 std::size_t row) {
    std::vector<double> omegas;
    if (const auto* grid = std::get_if<LatLongGrid>(&any_grid)) {
        // cos upper - cos lower without its cancellation.
        const double upper = grid->theta_edges[row], lower = grid->theta_edges[row + 1];
        const double height = 2 * std::sin((lower + upper) / 2) * std::sin((lower - upper) / 2);
        for (std::size_t c = 0; c + 1 < grid->phi_edges.size(); ++c)
            omegas.push_back(height * (grid->phi_edges[c + 1] - grid->phi_edges[c]));
        return omegas;
    }
    const std::vector<double>& edges = std::get<CubeGrid>(any_grid).edges;
    for (std::size_t c = 0; c + 1 < edges.size(); ++c)
        omegas.push_back(cube::solid_angle(edges[c], edges[c + 1], edges[row], edges[row + 1]));
    return omegas;
}

struct RowFacts {
    Vec3 low, high;
    DVec3 flux{0};  ///< radiance times solid angle
    bool grey = true;

    explicit RowFacts(const Vec3& texel) : low(texel), high(texel) {}

    void add(const Vec3* texels, const std::vector<double>& omegas) {
        for (std::size_t column = 0; column < omegas.size(); ++column) {
            const Vec3& L = texels[column];
            low = glm::min(low, L);
            high = glm::max(high, L);
            flux += omegas[column] * DVec3(L);
            grey = grey && L.x == L.y && L.y == L.z;
        }
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
    const auto* grid = std::get_if<LatLongGrid>(&environment.grid);
    const auto rows =
        static_cast<std::size_t>(grid ? grid->height : std::get<CubeGrid>(environment.grid).size);
    const std::size_t faces = grid ? 1 : cube::kFaceCount;
    const Vec3& first = environment.radiance.front();
    std::vector<RowFacts> by_row(rows, RowFacts(first));
    parallel_for(rows, [&](std::size_t row) {
        const std::vector<double> omegas = solid_angles(environment.grid, row);
        for (std::size_t face = 0; face < faces; ++face)
            by_row[row].add(&environment.radiance[(face * rows + row) * omegas.size()], omegas);
    });

    EnvironmentFacts facts;
    facts.grey = true;
    Vec3 low = first, high = first;
    DVec3 flux(0);
    for (const RowFacts& row : by_row) {
        low = glm::min(low, row.low);
        high = glm::max(high, row.high);
        flux += row.flux;
        facts.grey = facts.grey && row.grey;
    }
    const DVec3 mean = flux / (4 * std::numbers::pi);
    facts.mean = (mean.x + mean.y + mean.z) / 3;
    facts.peak = largest(high);
    for (int c = 0; c < 3; ++c) {
        const double difference = static_cast<double>(high[c]) - static_cast<double>(low[c]);
        if (difference > 0) {
            facts.contrast = std::max(facts.contrast,
                                      difference / (static_cast<double>(low[c]) + 1e-3 * mean[c]));
        }
    }
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
