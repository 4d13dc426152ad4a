// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/render/picture.h"

#include <cstddef>

namespace envbake {

/// How far picture `a` is from the truth `b`, over the pixels that are surface in both.
struct Comparison {
    /// sqrt(sum |a - b|^2 / sum |b|^2), over pixels and channels; 0 when both are black, infinite
    /// when only `b` is.
    double relative_rmse = 0;
    /// sum (a - b) / sum b, over pixels and channels: what `a` adds (+) or loses (-) overall.
    double relative_mean_difference = 0;
    std::size_t pixel_count = 0;
};

/// Both pictures must have the same size.
Comparison compare(const Picture& a, const Picture& b);

/// a - b in false colour, by luminance: white where equal, red where `a` is brighter, blue where it
/// is darker; full colour at `full_scale` times the rms luminance of `b`. Background is grey.
DisplayPicture difference_picture(const Picture& a, const Picture& b, double full_scale = 0.25);

}  // namespace envbake
