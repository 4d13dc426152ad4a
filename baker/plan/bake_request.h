// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/trace/tracer.h"

#include "envbake/runtime/brdf.h"
#include "envbake/runtime/mip_layout.h"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace envbake {

/// Perceptual roughness, 0 <= min <= max <= 1.
struct RoughnessRange {
    double min = 0;
    double max = 1;
};

enum class GlossyChoice {
    None,
    WhereItShows,  ///< materials whose lobe SH can show and that reflect enough by it
    All,           ///< every material with a lobe
};

/// Whether wavelets are baked.
enum class WaveletUse {
    Never,
    WhereNeeded,  ///< where SH lose more than the tolerance of hard shadows
    Always
};

/// How "mesh/I/diffuse" is stored.
enum class Encoding {
    F32,
    F16,
    Unorm16,
    Unorm8,
    Clustered,  ///< clustered PCA of all meshes together
    Auto        ///< the smallest that keeps to the tolerance
};

/// One of `count` parts of a bake's work.
struct Shard {
    int index = 1;  ///< 1 .. count
    int count = 1;  ///< 1 .. kMaxShards

    friend bool operator==(const Shard&, const Shard&) = default;
};
inline constexpr int kMaxShards = 100'000;

/// What a person asked for. Nothing here depends on what the inputs turn out to be.
struct BakeRequest {
    std::filesystem::path scene;        ///< empty: lighting only
    std::filesystem::path environment;  ///< empty: transport only
    std::filesystem::path output;
    std::optional<Shard> shard;  ///< the output is this part of the bake, for `envbake merge`

    double tolerance = 1e-2;  ///< relative error of transport and of mips
    int bands = 5;            ///< SH bands, 1 .. 10

    bool extract_lights = false;  ///< dominant lights are left out of every other lighting array
    bool irradiance = false;      ///< also bake "environment/irradiance"
    bool window = false;          ///< damp SH lighting until irradiance is nowhere negative

    std::vector<runtime::Distribution> distributions{runtime::Distribution::Ggx};
    int mip_size = 256;    ///< face edge of mip 0, texels
    int mip_count = 5;     ///< mip k of n holds roughness k / (n - 1)
    bool certify = false;  ///< mips whose error is proved, not estimated
    runtime::MipLayout mip_layout = runtime::MipLayout::CubeFaces;
    std::optional<RoughnessRange> roughness_range;  ///< of the mips; empty: what the scene has
    int table_size = 64;                            ///< texels along each axis of the BRDF tables
    runtime::TableAxes table_axes = runtime::TableAxes::RootsEndPoints;
    bool half_tables = false;  ///< store them as f16

    std::vector<std::string>
        not_receiving;                     ///< "mesh/I", or names of nodes or meshes: no transport
    std::vector<std::string> not_casting;  ///< the same: block no light

    int bounces = 0;  ///< between surfaces; kAllBounces: until they are too faint
    GlossyChoice glossy = GlossyChoice::None;  ///< "mesh/I/glossy"
    int glossy_bands = 5;                      ///< of exit radiance, 1 .. 5
    bool unshadowed = false;                   ///< also bake "mesh/I/unshadowed"
    WaveletUse wavelet = WaveletUse::Never;
    int wavelet_size = 64;  ///< texels along a face of the basis, wavelet::is_face_size
    Encoding encoding = Encoding::F32;
    int rays_per_vertex = 0;  ///< 0: as many as the tolerance needs
    double time_budget = 0;   ///< of the whole bake, wall seconds; 0: none
    Isa isa = Isa::Best;      ///< of the rays
    std::uint64_t seed = 0;
    std::size_t memory_bytes = std::size_t{256} << 20;  ///< of transport in memory at once
    bool strict = false;                                ///< refuse what would be repaired
    bool area_weighted_normals = false;  ///< where the file has no normals; else angle-weighted
    bool compress = false;               ///< store arrays with zstd where that is smaller
};

}  // namespace envbake
