// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"
#include "baker/input/environment.h"

#include <filesystem>

namespace envbake {

struct ReadEnvironmentOptions {
    bool strict = false;  ///< refuse non-finite and negative texels instead of repairing them
};

/// Reads a .hdr or .exr image as an environment; the content decides which of the two it is. What
/// is read of a file stands at decode_float_image (image_worker.h). The first line that fits
/// decides the shape, s being any whole number:
///
///     EXR envmap LatLong   OpenEXR's own convention: the centre looks along +Z, +X is on its left;
///                          the first and the last column lie on one meridian, the first and the
///                          last row on the poles, so that these texels have half the size
///     EXR envmap Cube      s x 6s, OpenEXR's own convention: faces stacked, each as seen from
///                          inside; the outer texels of a face have their centres on its edges
///     6s x s, s x 6s       a strip of faces +X -X +Y -Y +Z -Z, each as OpenGL and KTX have it
///     4s x 3s              a cross, if every texel of its six unused cells is 0:   . Y  .  .
///                                                                                  x Z  X  z
///                                                                                  . y  .  .
///     3s x 4s              likewise:   . Y .     X is +X, x is -X; faces as OpenGL and KTX have
///                                      x Z X     them, the vertical cross's z turned by half a
///                                      . y .     turn: neighbours in the cross are neighbours
///                                      . z .     on the cube
///     everything else      equirectangular, of any size (runtime/lat_long.h)
///
/// An EXR file with `chromaticities` other than those of Rec. 709 is converted; a white point other
/// than D65 is adapted (Bradford); what falls outside Rec. 709 then counts as repaired. Without an
/// envmap attribute, the data window must be the display window: a cropped image is not an
/// environment.
///
/// Errors:  InvalidInput  not readable as an image, no pixels, or texels refused by `strict`
///          Failed        the file cannot be opened, or the image worker cannot be started
Expected<Environment> read_environment(const std::filesystem::path& file,
                                       const ReadEnvironmentOptions& options = {});

}  // namespace envbake
