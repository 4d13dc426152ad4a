// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"
#include "baker/core/progress.h"
#include "baker/input/scene.h"
#include "baker/trace/tracer.h"

#include <cstdint>
#include <functional>
#include <span>

namespace envbake {

struct DiffuseJob {
    int bands = 5;             ///< 1 .. 10
    bool shadowed = true;      ///< false: the analytic unoccluded answer, no rays
    double tolerance = 1e-2;   ///< rms over vertices of |T - T_true|_2 / |T_unoccluded|_2
    int rays_per_vertex = 0;   ///< 0: chosen from the tolerance
    std::uint64_t seed = 0;
};

struct DiffuseReport {
    std::uint64_t vertex_count = 0;
    std::uint64_t unreferenced_count = 0;  ///< no triangle or no normal: T = 0, no rays
    std::uint64_t merged_count = 0;        ///< equal to another vertex in position and normal: copied
    std::uint64_t free_count = 0;          ///< nothing above the tangent plane: analytic, no rays
    std::uint64_t traced_count = 0;
    std::uint64_t ray_count = 0;           ///< without those of the error check
    std::uint64_t check_ray_count = 0;
    int rays_per_vertex = 0;               ///< of the traced ones
    double error_rms = 0;     ///< relative, over all vertices; measured on a sample against 4 x the rays
    double error_p999 = 0;    ///< 99.9th percentile over vertices, from the same sample
};

/// Bakes "mesh/I/diffuse", [vertices, bands^2] f32:
///
///     T_i = 1/pi * integral of V(w) max(0, n.w) Y_i(w) dw
///
/// Rows are handed to `sink` in vertex order, block by block; no more than a block is in memory.
/// Deterministic for any number of threads.
Expected<DiffuseReport> bake_diffuse(const DiffuseJob& job, const Scene& scene, std::size_t mesh,
                                     const Tracer& tracer,
                                     const std::function<Expected<void>(std::span<const float>)>& sink,
                                     Progress& progress);

}  // namespace envbake
