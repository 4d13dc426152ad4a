// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/progress.h"
#include "baker/input/environment.h"
#include "baker/input/scene.h"
#include "baker/render/camera.h"
#include "baker/render/light_turn.h"
#include "baker/render/picture.h"
#include "baker/trace/tracer.h"

#include <cstdint>
#include <optional>
#include <span>

namespace envbake {

/// How directions to the light are picked. Only Mis is meant for use; the other two exist because
/// all three must agree.
enum class LightSampling { Mis, EnvironmentOnly, BsdfOnly };

struct ReferenceOptions {
    int samples_per_pixel = 256;  ///< light samples, shared out to the lines of sight
    int sights_per_axis =
        2;  ///< lines of sight through a pixel, along each axis; as in the preview
    bool white_lambert = false;  ///< albedo 1 and no specular in place of every material
    std::uint64_t seed = 0;
    LightSampling sampling = LightSampling::Mis;
    LightTurn light_turn{};  ///< of the environment
    /// If given, n^2 coefficients, n <= 10: a second picture is rendered by the light
    /// sum_i l_i Y_i(w), turned already, from the same rays. Against it a preview shows the error
    /// of transport and interpolation alone. Only with white_lambert.
    std::span<const Vec3> truncated_light = {};
};

struct Reference {
    Picture picture;
    double noise_rms = 0;  ///< relative: rms of the picture's own error over rms of the picture
    std::optional<Picture> truncated;
    double truncated_noise_rms = 0;
};

/// Ground truth for a view: light from the environment itself, every texel of it, with shadows by
/// ray tracing. One bounce only, as in the transport of a bundle: surfaces do not light each other.
///
///     Lo(v) = Le + integral of [albedo / pi + D V F(v.h)] L(l) V(l) max(0, n.l) dl
///
/// with GGX and height-correlated Smith as in runtime/brdf.h. Perceptual roughness under 0.03 is
/// taken as 0.03. Directions come from the environment's luminance and from the BRDF (cosine, or
/// visible GGX normals), weighted by the balance heuristic.
///
/// The two halves of the samples are independent; their difference is the stated noise, over
/// surface pixels. Deterministic: every pixel has its own random stream.
/// Source: [Veach95] balance heuristic; [Heitz18]; the points of a pixel are those of [Roberts18],
/// shifted at random.
Reference render_reference(const Scene& scene, const Tracer& tracer, const Environment& environment,
                           const Camera& camera, const ReferenceOptions& options,
                           Progress& progress);

}  // namespace envbake
