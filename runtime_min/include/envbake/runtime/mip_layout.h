// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace envbake::runtime {

/// How the directions of a prefiltered environment are laid out.
enum class MipLayout {
    CubeFaces,  ///< six square faces, orientation of cube.h
    LatLong,    ///< one image twice as wide as high, directions of lat_long.h
};

}  // namespace envbake::runtime
