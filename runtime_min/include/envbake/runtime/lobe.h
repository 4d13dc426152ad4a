// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace envbake::runtime {

// How "brdf/ggx_lobe/..." lie in memory. A lobe that is isotropic about +Z maps coefficients of
// order m to such of the same m, and +m and -m alike: its matrix is blocks of m = 0, 1, ..., one
// after the other, each [exit degree m .. exit_bands - 1, degree m .. bands - 1].

/// Most bands of lighting and of exit radiance that glossy transport has.
inline constexpr int kMaxGlossyBands = 5;
/// In so many bands the lobe is expanded towards the light that the scene blocks.
inline constexpr int kLobeBands = 7;
/// Bands of "mesh/I/glossy" beyond those of the lighting: the degrees of a product add.
inline constexpr int kExtraVisibilityBands = kLobeBands - 1;

/// Most bands in which "mesh/I/reflected" has light that surfaces send.
inline constexpr int kMaxReflectedBands = 4;

/// Numbers before the block of `m`; before the end for m = least of both bands.
constexpr std::size_t lobe_block(int exit_bands, int bands, int m) {
    std::size_t before = 0;
    for (int i = 0; i < m; ++i)
        before += static_cast<std::size_t>(exit_bands - i) * static_cast<std::size_t>(bands - i);
    return before;
}
/// Numbers of one matrix.
constexpr std::size_t lobe_size(int exit_bands, int bands) {
    return lobe_block(exit_bands, bands, exit_bands < bands ? exit_bands : bands);
}
/// Where the element of degrees j (exit) and k stands, both of order +-m.
constexpr std::size_t lobe_slot(int exit_bands, int bands, int m, int j, int k) {
    return lobe_block(exit_bands, bands, m) +
           static_cast<std::size_t>(j - m) * static_cast<std::size_t>(bands - m) +
           static_cast<std::size_t>(k - m);
}

}  // namespace envbake::runtime
