// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/environment.h"
#include "baker/input/scene.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace envbake {

struct LightFacts {
    std::size_t count = 0;
    double share = 0;            ///< of the environment's energy, all of them
    double strongest_share = 0;  ///< of the strongest small source, light or not; 0: there is none
};

struct EnvironmentFacts {
    double mean = 0;  ///< solid-angle mean over the sphere and the three channels
    double peak = 0;  ///< largest channel of any texel
    /// (largest - least) / (least + 1e-3 mean) of a channel, the worst of them: what any one value
    /// between them gets wrong at most in place of the map, in the norm of MipsJob::tolerance.
    double contrast = 0;
    /// Red, green and blue are the same float in every texel. Nothing less will do: each stage
    /// works on the channels alike and apart, so equal ones give equal bits, and two of them can be
    /// left out at any tolerance.
    bool grey = false;
    LightFacts lights;
    double sh_shadow_loss = 0;        ///< of the bands asked for, lighting/wavelet_lighting.h
    std::vector<double> band_energy;  ///< of the SH bands asked for: sum of squares a band
};

/// Extremes over a material's factors, textures and vertex colours.
struct MaterialFacts {
    std::string name;
    float min_roughness = 0;  ///< perceptual
    float max_roughness = 0;
    float max_r0 = 0;              ///< 0: no specular lobe at all
    float max_diffuse_albedo = 0;  ///< 0: metal or black
    bool grey_albedo = true;       ///< red, green and blue are the same everywhere
    float max_emission = 0;        ///< W sr^-1 m^-2
};

struct MeshFacts {
    std::uint64_t vertex_count = 0;
    std::uint64_t triangle_count = 0;
    std::uint64_t free_vertex_count = 0;  ///< nothing of the scene above their tangent plane
    std::size_t material = 0;
    bool receives = true;  ///< as Mesh has it
    bool casts = true;
};

/// What the plan is made from. Collected from the inputs; no ray is cast.
struct BakeFacts {
    std::optional<EnvironmentFacts> environment;
    bool has_scene = false;
    std::vector<MaterialFacts> materials;
    std::vector<MeshFacts> meshes;
};

/// Everything but lights and SH. One pass over the map; the same bits on any number of threads.
EnvironmentFacts collect_facts(const Environment& environment);
std::vector<MaterialFacts> collect_material_facts(const Scene& scene);

}  // namespace envbake
