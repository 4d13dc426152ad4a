// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/scene.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace envbake {

/// What alpha mode MASK makes of a triangle: where alpha (surface_alpha) is under the cut-off there
/// is nothing.
enum class Coverage : std::uint8_t {
    Solid,  ///< every point is there; any triangle of another alpha mode
    Holed,  ///< some points may be there and some not: a hit must ask
    Clear,  ///< no point is there
};

/// Of every triangle of one mesh; a mesh that is the same all over is one value.
struct MeshCoverage {
    Coverage all = Coverage::Solid;
    std::vector<Coverage> triangles;  ///< empty: `all` holds for each

    Coverage operator[](std::size_t triangle) const {
        return triangles.empty() ? all : triangles[triangle];
    }
};

/// One for each mesh of the scene. Solid and Clear are proved, from the least and the largest of
/// the texels that the triangle's bilinear look-ups can touch, times those of its corners' alpha;
/// everything else is Holed, a triangle that lies on more than 2^16 texels included, unless the
/// whole image decides.
///
/// O(texels under the triangles), on every core; the same for any number of threads.
std::vector<MeshCoverage> coverage_of(const Scene& scene);

}  // namespace envbake
