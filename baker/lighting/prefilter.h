// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/progress.h"
#include "baker/lighting/cluster_tree.h"
#include "baker/lighting/mip_layout.h"
#include "envbake/runtime/brdf.h"

#include <vector>

namespace envbake::lighting {

/// How far sources are opened. Estimates are relative to a texel's value plus 1e-3 of the mean,
/// like MipsJob::tolerance, and are of one source; a texel has some hundreds of them.
struct PrefilterAccuracy {
    double cluster = 3e-5;        ///< largest error from the curvature of the weight
    double horizon = 2e-4;        ///< largest error of a source that the horizon cuts
    double extent2 = 0.2;         ///< largest (extent / l)^2, l the lobe's scale there
    double interpolation = 5e-4;  ///< largest error of interpolation within a tile
    double negligible = 1e-6;     ///< largest source left out, where the lobe's tail ends
    /// 0: estimates decide. Otherwise bounds do, so that their sum stays below this, relative to
    /// every texel; nothing is interpolated, and sums are in double.
    double proved = 0;
};

struct PrefilterJob {
    runtime::Distribution distribution = runtime::Distribution::Ggx;
    double alpha = 1;  ///< (0, 1]
    MipLayout layout = MipLayout::CubeFaces;
    int size = 1;      ///< the n of MipLayout
    int channels = 3;  ///< 1: only red is looked at
    PrefilterAccuracy accuracy;
};

struct Prefiltered {
    std::vector<float> texels;  ///< [faces, height, width, channels]
    double error_estimate = 0;  ///< of the worst tile: calibrated sums of its sources' estimates
    double error_bound = 0;     ///< of the worst texel, sums of error_bound.h; 0 where not proved
};

/// Extent of the smallest block of texels that a lobe of this width asks of the tree, radians.
double base_extent_for(double alpha);

/// Prefiltered radiance at the centre of every texel, straight from the source.
///
/// For each tile of texels the tree is walked once. A source is accepted as soon as its estimated
/// error is below the tolerance, relative to what arrives: the sun is opened to parts of texels
/// where its image is sharp, and is one cluster elsewhere. Lanes are output points, sources are
/// broadcast. A tile no wider than the lobe is judged as a whole, by its darkest part and its
/// nearest point; for sharp lobes on large faces its sources are evaluated at 8 x 8 Chebyshev
/// points, the far ones at 4 x 4, and interpolated, but for those too close or too bright for that.
/// Where texels are further apart than the lobe is wide, tiles are 4 x 4 and every texel is judged
/// by itself; below roughness 0.02 in double.
///
/// Threads: tiles in parallel; a tile's sum has one order, so the same bits on any number.
Prefiltered prefilter(const ClusterTree& tree, const PrefilterJob& job, Progress& progress);

}  // namespace envbake::lighting
