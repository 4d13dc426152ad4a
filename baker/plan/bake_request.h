// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/runtime/brdf.h"

#include <cstdint>
#include <filesystem>

namespace envbake {

/// What a person asked for. Nothing here depends on what the inputs turn out to be.
struct BakeRequest {
    std::filesystem::path scene;        ///< empty: lighting only
    std::filesystem::path environment;  ///< empty: transport only
    std::filesystem::path output;

    double tolerance = 1e-2;  ///< relative error of transport and of mips
    int bands = 5;            ///< SH bands, 1 .. 10
    int mip_size = 256;       ///< face edge of mip 0, texels
    int mip_count = 5;        ///< mip k of n holds roughness k / (n - 1)
    int table_size = 64;      ///< texels along each axis of the BRDF table
    runtime::TableAxes table_axes = runtime::TableAxes::RootsEndPoints;
    bool unshadowed = false;  ///< also bake "mesh/I/unshadowed"
    int rays_per_vertex = 0;  ///< 0: as many as the tolerance needs
    std::uint64_t seed = 0;
    bool strict = false;                 ///< refuse what would be repaired
    bool area_weighted_normals = false;  ///< where the file has no normals; else angle-weighted
    bool compress = false;               ///< store arrays with zstd where that is smaller
};

}  // namespace envbake
