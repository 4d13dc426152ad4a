// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/brdf/lobe_expansion.h"
#include "baker/brdf/table.h"
#include "baker/core/error.h"
#include "baker/lighting/mips.h"
#include "baker/plan/bake_request.h"
#include "baker/plan/facts.h"
#include "baker/transport/diffuse.h"
#include "baker/transport/interreflection.h"
#include "baker/transport/wavelet_transport.h"

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace envbake {

/// The lights that the facts list.
struct PlannedLights {
    std::size_t count = 0;
};

/// "environment/sh", or "environment/irradiance", of the coefficients that the facts were made of.
struct PlannedSh {
    int bands = 5;     ///< the first bands of those asked for
    int channels = 3;  ///< 1: the map is grey
    bool irradiance = false;
    bool window = false;
};

/// One mip chain; a constant environment is one texel a level.
struct PlannedMips {
    MipsJob job;
    int level_count = 5;
    double contrast = 0;  ///< error of one texel a level in place of a map that is almost constant
};

struct PlannedTable {
    BrdfTableJob job;
    bool half = false;  ///< stored as f16
};

/// "brdf/ggx_lobe/unoccluded" and "brdf/ggx_lobe/kernel", or those of Beckmann.
struct PlannedLobe {
    LobeExpansionJob job;
};

/// "mesh/I/glossy" and "mesh/I/normal". Before the mesh's diffuse transport: both are of its rays.
struct PlannedGlossy {
    DiffuseJob job;
    std::size_t mesh = 0;  ///< index into Scene::meshes
    int light_bands = 5;
    bool with_diffuse = false;  ///< the first bands of the rows wait for PlannedDiffuse, in memory
    bool bounces = false;       ///< what the rays met waits for PlannedBounces
    LobeErrors errors;          ///< of the material's lobe, the worst of its roughness
};

struct PlannedDiffuse {
    DiffuseJob job;
    std::size_t mesh = 0;      ///< index into Scene::meshes
    bool from_glossy = false;  ///< PlannedGlossy has baked it
    bool bounces = false;      ///< it waits for PlannedBounces, in memory
};

/// Adds bounces to all the transport that waits, and writes it.
struct PlannedBounces {
    BounceJob job;
};

/// "mesh/I/emitted", a by-product of the bounces.
struct PlannedEmitted {
    std::size_t mesh = 0;
};

/// "mesh/I/wavelet/blocks" and "/offsets".
struct PlannedWavelet {
    WaveletJob job;
    std::size_t mesh = 0;
};

/// "wavelet/weight": how much transport each coefficient meets.
struct PlannedWaveletWeights {
    WaveletJob job;
};

/// "environment/wavelet/index" and "/value".
struct PlannedWaveletLight {
    int channels = 3;  ///< 1: the map is grey
};

/// Stores all the shadowed transport, which waits for it, otherwise than as f32.
struct PlannedEncoding {
    Encoding encoding = Encoding::Auto;
    double tolerance = 6e-3;  ///< what it may add, rms over vertices, relative as the bake's
    int bands = 5;
};

using Job =
    std::variant<PlannedLights, PlannedSh, PlannedMips, PlannedTable, PlannedLobe, PlannedGlossy,
                 PlannedDiffuse, PlannedBounces, PlannedEmitted, PlannedEncoding, PlannedWavelet,
                 PlannedWaveletWeights, PlannedWaveletLight>;

/// Below this roughness five bands miss so much of a GGX lobe that prefiltered mips are the better
/// picture, shadows or not: docs/accuracy.md has the curve.
inline constexpr double kLeastGlossyRoughness = 0.4;

struct PlannedStage {
    std::string output;      ///< array name or prefix: "environment/mips"; or "bounces"
    std::string reason;      ///< one sentence
    std::optional<Job> job;  ///< empty when the stage is skipped
};

/// Data: printable, comparable in a test, finished before the first ray.
struct BakePlan {
    std::vector<PlannedStage> stages;  ///< execution order
    std::uint64_t ray_count = 0;       ///< expected, error check excluded
    std::uint64_t output_bytes = 0;    ///< of the arrays, uncompressed
};

/// Decides what a bake does. Pure: the same request and facts give the same plan.
///
/// Errors:  Usage  an option is out of its range, or there is neither scene nor environment
Expected<BakePlan> make_plan(const BakeRequest& request, const BakeFacts& facts);

}  // namespace envbake
