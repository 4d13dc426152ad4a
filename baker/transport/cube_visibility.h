// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/trace/tracer.h"
#include "baker/transport/ray_origin.h"

#include <cstdint>
#include <span>
#include <vector>

namespace envbake {

/// The texels of a cube map of n x n faces as a vertex looks at them: points at their corners (some
/// fifth of a texel beside them), which are rays, and their mean directions. The same for every
/// vertex.
///
/// Corners that faces share are one point. Blocks of `coarsest` x `coarsest` texels are where
/// looking begins.
struct CubeTexels {
    explicit CubeTexels(int face_size);

    int face_size = 0;
    int coarsest = 0;                   ///< texels along the edge of a block, a power of two
    std::vector<std::uint32_t> points;  ///< [6, n + 1, n + 1]: at the corners, into `directions`
    std::vector<Vec3> directions;       ///< of the points, unit
    std::vector<Vec3> corners;          ///< [6, n + 1, n + 1]: of the corners themselves, unit
    std::vector<float> mean_x;          ///< [3 axes, 6, n, n]: 1 / d_omega * integral of w dw
    float widest = 0;                   ///< no two directions of a texel are further apart
    /// Blocks of the coarsest size, near each other one after the other: their first texel.
    struct Block {
        std::uint16_t face = 0, row = 0, column = 0;
    };
    std::vector<Block> blocks;
};

/// How a vertex looks.
enum class Look {
    AtOutlines,  ///< coarsely, and closely only where corners of a block differ
    Everywhere,  ///< at every corner above the horizon: the slow way, to compare with
};

/// Transport of one place over the texels:
///
///     T_t = 1 / (pi d_omega_t) * integral over t of V(w) max(0, n.w) dw
///
/// V is the mean over the four points of a texel. A block all of whose known points agree is taken
/// as open, or blocked, as a whole; one where they differ is split into four, down to texels, and
/// so is a block on whose edge a neighbour has found another point. What stands inside of a
/// coarsest block and reaches none of its corners is overlooked. Below the horizon there are no
/// rays; of texels that it crosses the part above counts.
///
///   texels  [6, n, n]
///   return  rays traced
///
/// Threads: pure.
int texel_transport(const CubeTexels& cube, const Tracer& tracer, const RayOrigin& origin,
                    std::span<float> texels, Look look = Look::AtOutlines);

/// The same where nothing stands above the place: no rays.
///   normal  unit
void open_texel_transport(const CubeTexels& cube, const DVec3& normal, std::span<float> texels);

}  // namespace envbake
