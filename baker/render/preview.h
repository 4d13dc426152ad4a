// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"
#include "baker/core/progress.h"
#include "baker/input/scene.h"
#include "baker/render/camera.h"
#include "baker/render/light_turn.h"
#include "baker/render/picture.h"
#include "baker/trace/tracer.h"
#include "envbake/runtime/bundle.h"

namespace envbake {

struct PreviewOptions {
    int sights_per_axis = 2;     ///< lines of sight through a pixel, along each axis
    bool white_lambert = false;  ///< albedo 1 and no specular in place of every material
    bool split_sum = false;      ///< even where there is glossy transport
    LightTurn light_turn{};      ///< since the bake
    bool wavelets = false;       ///< diffuse light by wavelets in place of SH, where there are some
};

/// What an engine shows that shades from the bundle, through runtime/shade.h and nothing else:
///
///     Lo(v) = Le + albedo * (sum_i l_i T_i, at the vertices, interpolated)
///                + prefiltered(reflect(v), roughness) * (R0 A + B)
///
/// or, where a mesh has glossy transport and the bundle a lobe for the roughness, in place of the
/// last line the radiance of that transport (glossy.h): at the vertices, for the point's own view,
/// interpolated.
///
/// Lights that were extracted from the environment are added with shadows, traced in place of an
/// engine's shadow map, and stand in the background as discs.
///
/// The two reflections are added as they are, as in reference.h; the split sum has no shadows.
/// A mesh without transport is lit by the irradiance of its normals, without shadows; with
/// `white_lambert`, which is there to measure transport, it does not count as surface. Behind the
/// scene stands the sharpest mip of the bundle, or, without mips, its SH lighting.
///
/// With `wavelets` the first sum is over mesh/I/wavelet. Coefficients do not turn with the light: a
/// turned light is the sharpest mip, turned, and decomposed as an engine would, with as many terms.
///
/// Light that the SH basis makes negative is cut at 0 after shading, except with `white_lambert`,
/// where it stays: there the picture is measured against the same truncated light.
///
/// Not shown: the backs of double-sided surfaces have the light of their fronts.
///
/// Errors:  InvalidBundle  baked from another scene (the number of meshes or of vertices differs),
///                         or without any light; or without the arrays that `wavelets` need
Expected<Picture> render_preview(const Scene& scene, const Tracer& tracer,
                                 const runtime::Bundle& bundle, const Camera& camera,
                                 const PreviewOptions& options, Progress& progress);

}  // namespace envbake
