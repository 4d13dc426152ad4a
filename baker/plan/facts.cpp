// SPDX-License-Identifier: Apache-2.0
#include "baker/plan/facts.h"

#include "baker/core/parallel.h"
#include "envbake/runtime/cube.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <span>
#include <variant>

namespace envbake {

namespace {

float largest(const Vec3& v) {
    return std::max({v.x, v.y, v.z});
}

/// What a part of the map adds to its facts.
struct PartFacts {
    Vec3 low{std::numeric_limits<float>::max()};
    Vec3 high{0};
    DVec3 sum{0};  ///< radiance times solid angle
    bool grey = true;

    void append(const PartFacts& other) {
        low = glm::min(low, other.low);
        high = glm::max(high, other.high);
        sum += other.sum;
        grey = grey && other.grey;
    }
};

/// A row of texels, and the solid angle of each, up to a factor of the whole row, once for each of
/// its channels.
PartFacts row_facts(std::span<const Vec3> texels, std::span<const double> channel_weights) {
    // Sixteen texels side by side: whole vectors of any width, whose lanes keep to their channel.
    constexpr std::size_t kLanes = 3 * 16;
    std::array<float, kLanes> low, high;
    std::array<double, kLanes> sum{};
    low.fill(std::numeric_limits<float>::max());
    high.fill(0);
    const auto add = [&](std::size_t first, std::size_t lanes) {
        const float* const L = &texels.front().x + first;
        const double* const weight = channel_weights.data() + first;
        for (std::size_t k = 0; k < lanes; ++k) {
            low[k] = std::min(low[k], L[k]);
            high[k] = std::max(high[k], L[k]);
            sum[k] += weight[k] * static_cast<double>(L[k]);
        }
    };
    const std::size_t values = 3 * texels.size(), whole = values / kLanes * kLanes;
    for (std::size_t i = 0; i < whole; i += kLanes) add(i, kLanes);
    add(whole, values - whole);

    PartFacts facts;
    for (std::size_t k = 0; k < kLanes; k += 3) {
        facts.append({.low = {low[k], low[k + 1], low[k + 2]},
                      .high = {high[k], high[k + 1], high[k + 2]},
                      .sum = {sum[k], sum[k + 1], sum[k + 2]}});
    }
    facts.grey = std::all_of(texels.begin(), texels.end(),
                             [](const Vec3& L) { return L.x == L.y && L.y == L.z; });
    return facts;
}

/// One part for each row.
std::vector<PartFacts> part_facts(const LatLongGrid& grid, std::span<const Vec3> radiance) {
    const auto width = static_cast<std::size_t>(grid.width);
    std::vector<double> widths(3 * width);
    for (std::size_t i = 0; i < widths.size(); ++i)
        widths[i] = grid.phi_edges[i / 3 + 1] - grid.phi_edges[i / 3];
    std::vector<PartFacts> parts(static_cast<std::size_t>(grid.height));
    parallel_for(parts.size(), [&](std::size_t row) {
        parts[row] = row_facts(radiance.subspan(row * width, width), widths);
        parts[row].sum *= std::cos(grid.theta_edges[row]) - std::cos(grid.theta_edges[row + 1]);
    });
    return parts;
}

/// One part for each row of all six faces: their texels have the same solid angles.
std::vector<PartFacts> part_facts(const CubeGrid& grid, std::span<const Vec3> radiance) {
    const auto size = static_cast<std::size_t>(grid.size);
    std::vector<PartFacts> parts(size);
    parallel_for(size, [&](std::size_t row) {
        std::vector<double> d_omega(3 * size);
        for (std::size_t column = 0; column < size; ++column) {
            std::fill_n(d_omega.begin() + static_cast<std::ptrdiff_t>(3 * column), 3,
                        cube::solid_angle(grid.edges[column], grid.edges[column + 1],
                                          grid.edges[row], grid.edges[row + 1]));
        }
        for (std::size_t face = 0; face < cube::kFaceCount; ++face) {
            parts[row].append(
                row_facts(radiance.subspan((face * size + row) * size, size), d_omega));
        }
    });
    return parts;
}

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

bool is_grey(const Scene& scene, const std::optional<Texture>& texture) {
    if (!texture) return true;
    const std::vector<std::uint8_t>& rgba =
        scene.images[static_cast<std::size_t>(texture->image)].rgba;
    for (std::size_t at = 0; at + 2 < rgba.size(); at += 4)
        if (rgba[at] != rgba[at + 1] || rgba[at] != rgba[at + 2]) return false;
    return !rgba.empty();
}

/// Every product of factor, texture and vertex colour is.
bool has_grey_albedo(const Scene& scene, std::size_t index) {
    const Material& material = scene.materials[index];
    const auto grey = [](const auto& c) { return c.x == c.y && c.y == c.z; };
    if (!grey(material.base_color) || !is_grey(scene, material.base_color_texture)) return false;
    return std::all_of(scene.meshes.begin(), scene.meshes.end(), [&](const Mesh& mesh) {
        return static_cast<std::size_t>(mesh.material) != index ||
               std::all_of(mesh.colors.begin(), mesh.colors.end(), grey);
    });
}

}  // namespace

EnvironmentFacts collect_facts(const Environment& environment) {
    const std::vector<PartFacts> parts = std::visit(
        [&](const auto& grid) { return part_facts(grid, environment.radiance); }, environment.grid);
    PartFacts whole;
    for (const PartFacts& part : parts) whole.append(part);

    const DVec3 mean = whole.sum / (4 * std::numbers::pi);
    EnvironmentFacts facts;
    facts.grey = whole.grey;
    facts.mean = (mean.x + mean.y + mean.z) / 3;
    facts.peak = largest(whole.high);
    for (int c = 0; c < 3; ++c) {
        const double low = whole.low[c], difference = static_cast<double>(whole.high[c]) - low;
        if (difference > 0)
            facts.contrast = std::max(facts.contrast, difference / (low + 1e-3 * mean[c]));
    }
    return facts;
}

std::vector<MaterialFacts> collect_material_facts(const Scene& scene) {
    std::vector<MaterialFacts> facts;
    for (std::size_t i = 0; i < scene.materials.size(); ++i) {
        const Material& material = scene.materials[i];
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
        f.grey_albedo = f.max_diffuse_albedo <= 0 || has_grey_albedo(scene, i);
        f.max_emission = largest(material.emission);
        facts.push_back(f);
    }
    return facts;
}

}  // namespace envbake
