// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/environment.h"
#include "baker/lighting/mips.h"

#include <vector>

namespace envbake::bench {

/// A cube map of `size` and everything smaller, each mip the mean of 2 x 2 texels of the one above.
struct CubeChain {
    struct Level {
        int size = 0;
        std::vector<Vec3> texels;  ///< [6, size, size]
    };
    std::vector<Level> levels;
};

CubeChain make_cube_chain(const Environment& environment, int size);

/// The textbook specular prefilter that most tools have, as a baseline: importance sampling of GGX
/// with N = V = R.
///
///     sum of L(l) n.l / sum of n.l,  l = reflect(-n, h), h from D(h) n.h by a Hammersley set
///
/// L is read bilinearly within a face. `filtered` reads each sample from the mip whose texel has
/// the sample's solid angle 1 / (N pdf), a quarter of it in texels more, as [Krivanek08] does;
/// otherwise from the largest.
std::vector<Vec3> sampled_prefilter(const CubeChain& source, double perceptual_roughness, int size,
                                    int sample_count, bool filtered);

}  // namespace envbake::bench
