// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/vector.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace envbake {

/// A rendered view, linear Rec. 709 radiance; rows from the top.
struct Picture {
    int width = 0;
    int height = 0;
    std::vector<Vec3> radiance;  ///< width * height
    std::vector<float> surface;  ///< width * height, 0 .. 1: share that is scene, not background

    /// A pixel that counts as scene and not as sky when pictures are measured.
    bool is_surface(std::size_t pixel) const { return surface[pixel] > 0.999f; }
};

/// A picture for the eye: sRGB-encoded, 8 bits a channel, rows from the top.
struct DisplayPicture {
    int width = 0;
    int height = 0;
    std::vector<std::uint8_t> rgb;  ///< 3 * width * height
};

}  // namespace envbake
