// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/environment.h"
#include "baker/math/vector.h"

#include <cstddef>
#include <numbers>
#include <vector>

namespace envbake {

/// What makes a source worth a shadow map of its own. Both are over 0.
struct DominantLightsJob {
    /// Small: the largest angular radius, radians. A point in the place of a source of radius r is
    /// wrong by l (l + 1) r^2 / 8 in band l of SH: at 5 degrees by 1.9 % in the last of five bands,
    /// and by 0.2 % in the irradiance of a surface that faces it.
    double max_angular_radius = 5 * std::numbers::pi / 180;
    /// Dominant: the least share of the map's energy. A share s adds 4 s of the mean irradiance of
    /// all orientations to a surface that faces it: from 5 % on, its shadow takes a sixth of the
    /// light or more. Of six photographs, the weakest that is a light has 66 %, the strongest
    /// that is none (sky between the beams of a roof) 1.3 %.
    double min_share = 0.05;
};

/// A small source, as the directional light that an engine gives a shadow map. All of it is what
/// the source adds to its surroundings: radiance above theirs, channel by channel.
struct DominantLight {
    DVec3 direction{0};   ///< towards it, unit, glTF world space; mean, weighted by luminance
    DVec3 irradiance{0};  ///< RGB, W m^-2: integral of the radiance, without a cosine. That of a
                          ///< surface facing the light is less by angular_radius^2 / 4, <= 0.2 %.
    double angular_radius = 0;  ///< radians; of the uniform disc with the same mean cosine to its
                                ///< direction: cos(radius) = 2 mean - 1
    double solid_angle = 0;  ///< sr, (integral of L)^2 / integral of L^2 in luminance: exact for a
                             ///< uniform source, and little moved by faint fringes. irradiance
                             ///< / solid_angle is the radiance to draw it with.
    double share = 0;        ///< luminance of `irradiance`, over that of the whole map's flux
    double direction_error = 0;  ///< radians; half the diagonal of its brightest texel: the map
                                 ///< does not say where in a texel its light comes from. The mean
                                 ///< of many texels is better, about ten times.
};

/// Texels first .. first + count - 1 of Environment::radiance, a light, and what surrounds it.
struct LightTexels {
    std::size_t first = 0;
    std::size_t count = 0;
    Vec3 surroundings{0};  ///< mean radiance of the texels around
};

/// "environment/lights". Luminance is 0.2126 R + 0.7152 G + 0.0722 B throughout.
struct DominantLights {
    std::vector<DominantLight> lights;  ///< strongest luminance first
    std::vector<LightTexels> texels;    ///< of all of them, none twice
    /// Why there are so few, for the plan. Of the strongest small source, taken or not; 0 when none
    /// has a sixteenth of min_share: what is bright is large, or does not stand out.
    double strongest_share = 0;
    double peak_over_mean = 0;  ///< luminance of the brightest texel over the map's mean; 0: black
};

/// Finds the sources that are small, distinct and dominant. A light is a connected set of texels
/// above one level of luminance, the lowest of a ladder of factors of sqrt(2) at which the set
///
///   - is small: its angular radius is at most the job's, and no texel is further than twice that;
///   - is distinct: its mean radiance, weighted by itself, is over twice that of the texels around;
///
/// so that a lamp is taken and the wall it lights is not, a sun is taken with the small part of its
/// aureole, and a window, a large softbox or an overcast sky never are. Sets that lie within the
/// largest angular radius of a stronger one become one light with it: one shadow map serves them.
/// What is dominant is kept. Connected means on the sphere: the seam, the poles, the edges and the
/// corners of a cube do not cut a light.
///
/// Exact: all integrals are those of the piecewise-constant map, in double, over exact solid angles
/// and exact mean directions of texels. A texel too wide to be small is no light: maps of fewer
/// than 21 rows have none away from the poles.
///
/// Cost: one pass over the map, and one over the lines that hold texels bright enough; about a
/// hundred bytes a row and column, and 40 a run of bright texels. Deterministic: tiles are fixed,
/// sums ordered.
DominantLights find_dominant_lights(const DominantLightsJob& job, const Environment& environment);

/// Leaves the lights out of the environment they were found in, in place: a texel keeps, channel by
/// channel, the smaller of its own radiance and that of the surroundings. Never negative, and
/// lights and remainder are the original to the rounding of a double:
///
///     SH before - SH after = sum of irradiance Y(direction), to l (l + 1) angular_radius^2 / 8
///
/// for a round light (twice that for any shape; channels of different mean directions add the
/// angle between those). Exact in band 0. Cost: the texels of the lights.
void remove_lights(const DominantLights& lights, Environment& environment);

}  // namespace envbake
