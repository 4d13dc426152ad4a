// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/prefilter.h"

#include "baker/core/parallel.h"
#include "baker/lighting/output_grid.h"
#include "baker/lighting/prefilter_kernel.h"
#include "baker/lighting/source_walk.h"
#include "baker/lighting/tile_evaluation.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>

namespace envbake::lighting {
namespace {

constexpr int kInterpolatedTile = 16;  // texels a side
constexpr int kDirectTile = 8;

enum class Method {
    Interpolated,  ///< tiles of 16 x 16 texels
    Direct,        ///< tiles of 8 x 8 texels or fewer
    Singly,        ///< texel by texel, in double
};

struct Tiling {
    Method method;
    int tile_size;
};

/// A tile should not be much wider than the lobe's core.
Tiling tiling_for(double core, int size) {
    const double texel = std::numbers::pi / 2 / size;
    if (core < texel) return {Method::Singly, kDirectTile};
    if (core < 0.8 && size >= 2 * kInterpolatedTile && kInterpolatedTile * texel <= 1.6 * core) {
        return {Method::Interpolated, kInterpolatedTile};
    }
    int tile = kDirectTile;
    while (tile > 1 && tile * texel > std::min(1.6 * core, 0.6)) tile /= 2;
    return {Method::Direct, tile};
}

/// The lobe is GgxWeight or BeckmannWeight, the channels are 1 or 3.
template <template <class> class Lobe, int kChannels>
class Prefilter {
  public:
    Prefilter(const ClusterTree& tree, const PrefilterJob& job)
        : tree_(tree),
          job_(job),
          weight_(Lobe<double>::of(job.alpha)),
          weight_f_(Lobe<float>::of(job.alpha)),
          tiling_(tiling_for(weight_.core(), job.size)),
          grid_(job.layout, job.size, tiling_.tile_size) {}

    Prefiltered run(Progress& progress) const {
        Prefiltered result;
        result.texels.resize(grid_.texel_count() * kChannels);
        std::vector<TileEstimate> sums(grid_.tile_count());
        parallel_for(sums.size(), [&](std::size_t i) {
            const OutputTile tile = grid_.tile(i);
            if (tile.texels.empty()) return;
            sums[i] = tiling_.method == Method::Singly ? bake_singly(tile, result.texels)
                                                       : bake(tile, result.texels);
            progress.add(tile.texels.size());
        });
        for (const TileEstimate& s : sums) {
            result.error_estimate = std::max(result.error_estimate, s.error());
        }
        return result;
    }

  private:
    void write(std::size_t texel, const DVec3& sum, std::vector<float>& texels) const {
        const DVec3 value = glm::clamp(tree_.floor() + sum * (weight_.inverse_norm / tree_.scale()),
                                       tree_.floor(), tree_.ceiling());
        for (int k = 0; k < kChannels; ++k) {
            texels[texel * kChannels + static_cast<std::size_t>(k)] = static_cast<float>(value[k]);
        }
    }

    DVec3 received(const DVec3& sum) const {
        return tree_.floor() * tree_.scale() + glm::max(sum, DVec3{0}) * weight_.inverse_norm;
    }

    TileEstimate bake(const OutputTile& tile, std::vector<float>& texels) const {
        const bool interpolate = tiling_.method == Method::Interpolated;
        const DVec3 middle = tile.towards(0, 0);
        double radius = 0;
        for (const DVec3& d : tile.lattice(2, 2))
            radius = std::max(radius, glm::length(d - middle));

        SourceWalk<Lobe, float> walk(tree_, weight_f_, kChannels, job_.accuracy);
        walk.begin(middle, radius, radius / std::numbers::sqrt2);
        const Points coarse_points(tile.lattice(4, 4));
        Sums<kChannels> coarse(coarse_points.groups());
        for (const std::uint32_t i : walk.front()) {
            const auto& n = tree_.node(i);
            const auto& m = tree_.moments(i);
            if (walk.straddles(n.centre, static_cast<double>(n.radius))) {
                add_cluster_at<true>(weight_f_, m, coarse_points, coarse);
            } else {
                add_cluster_at<false>(weight_f_, m, coarse_points, coarse);
            }
        }
        DVec3 darkest(std::numeric_limits<double>::max());
        for (std::size_t p = 0; p < kLanes; ++p) {
            darkest = glm::min(darkest, received(coarse.at(p)));
        }
        walk.refine(darkest, interpolate);

        const Points points(tile.directions);
        Sums<kChannels> sums(points.groups());
        add_all(tree_, weight_f_, walk.near_sources(), points, sums);
        if (interpolate) {
            Sums<kChannels> at_nodes(nodes_per_tile());
            add_all(tree_, weight_f_, walk.far_sources(), Points(nodes_of(tile)), at_nodes);
            basis_.add_interpolated(at_nodes, in_groups(tile.x), in_groups(tile.y), sums);
        } else {
            add_all(tree_, weight_f_, walk.far_sources(), points, sums);
        }
        for (std::size_t p = 0; p < tile.texels.size(); ++p) {
            write(tile.texels[p], sums.at(p), texels);
        }
        return walk.estimated();
    }

    static constexpr std::size_t nodes_per_tile() {
        return ChebyshevBasis::kCount * ChebyshevBasis::kCount / kLanes;
    }
    std::vector<DVec3> nodes_of(const OutputTile& tile) const {
        std::vector<DVec3> nodes;
        for (std::size_t a = 0; a < ChebyshevBasis::kCount; ++a) {
            for (std::size_t b = 0; b < ChebyshevBasis::kCount; ++b) {
                nodes.push_back(tile.towards(basis_.node(b), basis_.node(a)));
            }
        }
        return nodes;
    }

    /// Lobes narrower than an output texel: neighbours share nothing, and float has too few digits.
    TileEstimate bake_singly(const OutputTile& tile, std::vector<float>& texels) const {
        SourceWalk<Lobe, double> walk(tree_, weight_, kChannels, job_.accuracy);
        TileEstimate worst;
        for (std::size_t p = 0; p < tile.texels.size(); ++p) {
            const DVec3& d = tile.directions[p];
            walk.begin(d, 0, 0);
            DVec3 coarse{0};
            for (const std::uint32_t i : walk.front()) add(i, d, &coarse.x);
            walk.refine(received(coarse), false);
            DVec3 sum{0};
            const Sources<double>& sources = walk.far_sources();
            for (const std::uint32_t i : sources.clusters) add(i, d, &sum.x);
            for (const std::uint32_t i : sources.horizon_clusters) add(i, d, &sum.x);
            for (const auto& m : sources.patches) {
                add_patch<false, kChannels>(weight_, m, d.x, d.y, d.z, &sum.x);
            }
            for (const auto& m : sources.horizon_patches) {
                add_patch<true, kChannels>(weight_, m, d.x, d.y, d.z, &sum.x);
            }
            write(tile.texels[p], sum, texels);
            worst.keep_largest(walk.estimated());
        }
        return worst;
    }

    void add(std::uint32_t i, const DVec3& d, double* sum) const {
        const ClusterMoments<float>& f = tree_.moments(i);
        ClusterMoments<double> m;
        for (int a = 0; a < 3; ++a) {
            m.centre[a] = static_cast<double>(f.centre[a]);
            m.flux[a] = static_cast<double>(f.flux[a]);
            for (int b = 0; b < 3; ++b) m.first[a][b] = static_cast<double>(f.first[a][b]);
            for (int b = 0; b < 6; ++b) m.second[a][b] = static_cast<double>(f.second[a][b]);
        }
        m.variance = static_cast<double>(f.variance);
        add_cluster<true, kChannels>(weight_, m, d.x, d.y, d.z, sum);
    }

    const ClusterTree& tree_;
    const PrefilterJob& job_;
    Lobe<double> weight_;
    Lobe<float> weight_f_;
    Tiling tiling_;
    OutputGrid grid_;
    ChebyshevBasis basis_;
};

template <template <class> class Lobe>
Prefiltered prefilter_with(const ClusterTree& tree, const PrefilterJob& job, Progress& progress) {
    return job.channels == 1 ? Prefilter<Lobe, 1>(tree, job).run(progress)
                             : Prefilter<Lobe, 3>(tree, job).run(progress);
}

}  // namespace

double base_extent_for(double alpha) {
    return std::clamp(0.4 * alpha, 1e-6, 0.025);
}

Prefiltered prefilter(const ClusterTree& tree, const PrefilterJob& job, Progress& progress) {
    return job.distribution == runtime::Distribution::Ggx
               ? prefilter_with<GgxWeight>(tree, job, progress)
               : prefilter_with<BeckmannWeight>(tree, job, progress);
}

}  // namespace envbake::lighting
