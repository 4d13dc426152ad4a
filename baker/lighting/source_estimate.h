// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/lighting/source_view.h"

namespace envbake::lighting {

/// What one source adds to the error of a texel, relative to what the texel receives, or the
/// darkest of the disc.
template <class Real>
struct SourceEstimate {
    Real core;           ///< share times (extent / l)^6
    Real curvature;      ///< of the Taylor series
    Real kink;           ///< of the horizon across it
    Real interpolation;  ///< within the tile, where it is interpolated
    bool accepted;
    bool direct;  ///< too sharp to be interpolated
};

/// Smooth content errs with one sign, so those are summed; the others err either way.
template <class Real>
struct EstimateSums {
    Real core{}, curvature{}, kink2{}, interpolation2{}, dropped{};
    Real bound[3] = {};  ///< sums of bounds by channel, where they decide

    template <class S>
    [[gnu::always_inline]] void add(const SourceEstimate<Real>& e, S part) {
        core += e.core * part;
        curvature += e.curvature * part;
        kink2 += e.kink * e.kink * (part * part);
        if (!e.direct) interpolation2 += e.interpolation * e.interpolation * (part * part);
    }
    /// Calibrated against brute force, factor by factor, on photographs, synthetic skies and noise.
    template <class Lobe>
    Real error(float of_curvature) const {
        return core * Lobe::kCoreSum + curvature * (Lobe::kCurvatureSum * of_curvature) +
               square_root(kink2) * 0.3f + square_root(interpolation2) * Lobe::kMissedSum + dropped;
    }
};

}  // namespace envbake::lighting
