// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace envbake::runtime {

/// How the texels of a BRDF table lie over (n.v, perceptual roughness).
enum class TableAxes {
    SqrtEndPoints,  ///< coordinates sqrt(n.v), sqrt(r); texel i at i / (size - 1)
    LinearCentres,  ///< coordinates n.v, r; texel i at (i + 1/2) / size
};

}  // namespace envbake::runtime
