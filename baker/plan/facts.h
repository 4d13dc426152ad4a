// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/environment.h"
#include "baker/input/scene.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace envbake {

struct EnvironmentFacts {
    bool constant = false;  ///< every texel equals every other to 1e-6 of the largest
    double mean = 0;        ///< solid-angle mean over the sphere and the three channels
    double peak = 0;        ///< largest channel of any texel
};

/// Extremes over a material's factors, textures and vertex colours.
struct MaterialFacts {
    std::string name;
    float min_roughness = 0;  ///< perceptual
    float max_roughness = 0;
    float max_r0 = 0;              ///< 0: no specular lobe at all
    float max_diffuse_albedo = 0;  ///< 0: metal or black
};

struct MeshFacts {
    std::uint64_t vertex_count = 0;
    std::uint64_t triangle_count = 0;
    std::uint64_t free_vertex_count = 0;  ///< nothing of the scene above their tangent plane
    std::size_t material = 0;
};

/// What the plan is made from. Collected from the inputs; no ray is cast.
struct BakeFacts {
    std::optional<EnvironmentFacts> environment;
    bool has_scene = false;
    std::vector<MaterialFacts> materials;
    std::vector<MeshFacts> meshes;
};

EnvironmentFacts collect_facts(const Environment& environment);
std::vector<MaterialFacts> collect_material_facts(const Scene& scene);

}  // namespace envbake
