// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/environment.h"
#include "baker/lighting/mip_layout.h"

#include <vector>

namespace envbake::lighting {

/// The average of the environment over the solid angle of every texel of a mip of `face_size`:
/// [faces, height, width, channels], rows from the top, of six faces or one image (mip_layout.h).
///
///   channels  3, or 1: the map is grey, and red stands for all
///
/// An average of source texels, each by the solid angle that it shares with the output's: between a
/// lat-long grid and cube faces that of grid_overlap.h, between grids of a kind products and
/// rectangles. Exact to 1e-12, then rounded to float; so energy is kept: a lone bright texel of the
/// source gives all its flux and no more, results lie between the least and the greatest radiance,
/// a constant map stays constant, and a grid that agrees with the source is a copy, bit for bit.
///
/// Cost: O(source texels + output texels); memory: the output's, in double where the source is a
/// cube and the output is not. Threads: the same bits on any number.
std::vector<float> box_average(const Environment& environment, MipLayout layout, int face_size,
                               int channels);

}  // namespace envbake::lighting
