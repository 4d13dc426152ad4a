// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/environment.h"
#include "baker/math/vector.h"

#include <vector>

namespace envbake::lighting {

/// The average of the environment over the solid angle of every texel of six faces: faces in order,
/// rows from the top. Exact but for rounding (double inside, float out), so energy is kept: a lone
/// bright texel of the source gives all its flux, and no more.
///
/// Lat-long: the edges of a texel are all there is. With C(phi, y) the radiance of a column summed
/// from the pole down to height y = cos theta, Green's theorem gives
///
///     integral of L dw = integral of L dy dphi = contour integral of C dphi
///
/// and an edge, cut where it leaves a source texel, has C linear in y: a closed form but for the
/// integral of y dphi, which is smooth. Cube: overlaps of rectangles of the same face.
///
/// Cost: O(source texels + output texels). Threads: rows in parallel, the same bits on any number.
std::vector<Vec3> box_average(const Environment& environment, int face_size);

}  // namespace envbake::lighting
