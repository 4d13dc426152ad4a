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
#include <numbers>
#include <type_traits>
#include <vector>

namespace envbake::lighting {
namespace {

constexpr int kInterpolatedTile = 16;  // texels a side
constexpr int kDirectTile = 8;
constexpr int kSharpTile = 4;
constexpr std::size_t kTilesAtATime = 8;  // neighbours: what one has opened serves the next

/// From here on float has too few digits for the position and the powers of a lobe's width.
constexpr double kLeastAlphaInFloat = 3.9e-4;

enum class Method {
    Interpolated,  ///< tiles of 16 x 16 texels, as wide as the lobe at most
    Direct,        ///< of 8 x 8, likewise; of 4 x 4 on the smallest faces
    Sharp,         ///< of 4 x 4, each texel judged by itself
};

struct Tiling {
    Method method;
    int tile_size;
};

Tiling tiling_for(double core, int size, const PrefilterAccuracy& accuracy) {
    const double texel = std::numbers::pi / 2 / size;
    // What 8 points miss falls with the eighth power of the tile's width.
    const double widest =
        1.6 * core * std::pow(std::min(1.0, accuracy.interpolation / 5e-4), 0.125);
    if (accuracy.proved > 0) return {Method::Sharp, kSharpTile};
    if (core < 0.8 && size >= 2 * kInterpolatedTile && kInterpolatedTile * texel <= widest) {
        return {Method::Interpolated, kInterpolatedTile};
    }
    if (kDirectTile * texel <= std::min(1.6 * core, 0.6)) return {Method::Direct, kDirectTile};
    if (core >= 0.8) return {Method::Direct, kSharpTile};
    // Far apart, texels have no list of sources in common.
    return {Method::Sharp, kSharpTile};
}

/// The lobe is GgxWeight or BeckmannWeight, the numbers float or double, the channels 1 or 3.
template <template <class> class Lobe, class S, int kChannels>
class Prefilter {
  public:
    Prefilter(const ClusterTree& tree, const PrefilterJob& job)
        : tree_(tree),
          job_(job),
          weight_(Lobe<S>::of(job.alpha)),
          tiling_(tiling_for(weight_.core(), job.size, job.accuracy)),
          grid_(job.layout, job.size, tiling_.tile_size) {}

    Prefiltered run(Progress& progress) const {
        return tiling_.method == Method::Sharp ? run_from<FromPoints<S>>(progress)
                                               : run_from<FromDisc<S>>(progress);
    }

  private:
    template <class View>
    Prefiltered run_from(Progress& progress) const {
        Prefiltered result;
        result.texels.resize(grid_.texel_count() * kChannels);
        const std::size_t tiles = grid_.tile_count();
        std::vector<double> estimates((tiles + kTilesAtATime - 1) / kTilesAtATime);
        std::vector<double> bounds(estimates.size());
        parallel_for(estimates.size(), [&](std::size_t i) {
            SourceWalk<Lobe, S, View> walk(tree_, weight_, kChannels, job_.accuracy);
            const std::size_t end = std::min((i + 1) * kTilesAtATime, tiles);
            for (std::size_t t = i * kTilesAtATime; t < end; ++t) {
                const OutputTile tile = grid_.tile(t);
                if (tile.texels.empty()) continue;
                const std::vector<DVec3> received = bake(tile, walk, result.texels);
                estimates[i] = std::max(estimates[i], walk.error_estimate(received));
                if constexpr (std::is_same_v<View, FromPoints<S>>) {
                    bounds[i] = std::max(bounds[i], walk.error_bound(received));
                }
                progress.add(tile.texels.size());
            }
        });
        result.error_estimate = *std::max_element(estimates.begin(), estimates.end());
        result.error_bound = *std::max_element(bounds.begin(), bounds.end());
        return result;
    }

    void write(std::size_t texel, const DVec3& sum, std::vector<float>& texels) const {
        const DVec3 value = glm::clamp(tree_.floor() + sum * (inverse_norm() / tree_.scale()),
                                       tree_.floor(), tree_.ceiling());
        for (int k = 0; k < kChannels; ++k) {
            texels[texel * kChannels + static_cast<std::size_t>(k)] = static_cast<float>(value[k]);
        }
    }

    DVec3 received(const DVec3& sum) const {
        return tree_.floor() * tree_.scale() + glm::max(sum, DVec3{0}) * inverse_norm();
    }
    double inverse_norm() const { return static_cast<double>(weight_.inverse_norm); }

    /// Returns what the texels receive.
    template <class View>
    std::vector<DVec3> bake(const OutputTile& tile, SourceWalk<Lobe, S, View>& walk,
                            std::vector<float>& texels) const {
        const bool interpolate = tiling_.method == Method::Interpolated;
        const DVec3 middle = tile.towards(0, 0);
        double radius = 0;
        for (const DVec3& d : tile.lattice(2, 2))
            radius = std::max(radius, glm::length(d - middle));
        const Points<S> points(tile.directions, middle);
        constexpr bool kSharp = std::is_same_v<View, FromPoints<S>>;
        const View view = [&] {
            if constexpr (kSharp) {
                return View(points);
            } else {
                return View(middle, radius);
            }
        }();
        walk.begin(middle, radius, radius / std::numbers::sqrt2, view);

        const Points<S> coarse_points = kSharp ? points : Points<S>(tile.lattice(4, 4), middle);
        Sums<S, kChannels> coarse(coarse_points.groups());
        walk.front([&](Places, const Sources<S>& sources) {
            add_all(weight_, sources, coarse_points, coarse);
        });
        std::vector<DVec3> arriving;
        for (std::size_t p = 0; p < coarse_points.groups() * kLanes<S>; ++p) {
            arriving.push_back(received(coarse.at(p)));
        }
        if (!kSharp) {
            for (const DVec3& one : arriving) arriving[0] = glm::min(arriving[0], one);
            arriving.resize(1);
        }

        Sums<S, kChannels> sums(points.groups());
        if constexpr (std::is_same_v<S, float> && !kSharp) {
            if (interpolate) {
                const Points<S> fine_nodes(fine_.nodes_of(tile), middle);
                const Points<S> coarse_nodes(coarse_.nodes_of(tile), middle);
                Sums<S, kChannels> at_fine(fine_nodes.groups()), at_coarse(coarse_nodes.groups());
                walk.refine(arriving, true, [&](Places places, const Sources<S>& sources) {
                    if (places == Places::Texels) add_all(weight_, sources, points, sums);
                    if (places == Places::FineNodes) add_all(weight_, sources, fine_nodes, at_fine);
                    if (places == Places::CoarseNodes)
                        add_all(weight_, sources, coarse_nodes, at_coarse);
                });
                const auto x = in_groups<S>(tile.x), y = in_groups<S>(tile.y);
                fine_.add_interpolated(at_fine, x, y, sums);
                coarse_.add_interpolated(at_coarse, x, y, sums);
            }
        }
        if (!interpolate) {
            walk.refine(arriving, false, [&](Places, const Sources<S>& sources) {
                add_all(weight_, sources, points, sums);
            });
        }
        arriving.clear();
        for (std::size_t p = 0; p < tile.texels.size(); ++p) {
            write(tile.texels[p], sums.at(p), texels);
            arriving.push_back(received(sums.at(p)));
        }
        return arriving;
    }

    const ClusterTree& tree_;
    const PrefilterJob& job_;
    Lobe<S> weight_;
    Tiling tiling_;
    OutputGrid grid_;
    ChebyshevBasis<8> fine_;
    ChebyshevBasis<4> coarse_;
};

template <template <class> class Lobe, class S>
Prefiltered prefilter_in(const ClusterTree& tree, const PrefilterJob& job, Progress& progress) {
    return job.channels == 1 ? Prefilter<Lobe, S, 1>(tree, job).run(progress)
                             : Prefilter<Lobe, S, 3>(tree, job).run(progress);
}

template <template <class> class Lobe>
Prefiltered prefilter_with(const ClusterTree& tree, const PrefilterJob& job, Progress& progress) {
    const bool in_double = job.alpha < kLeastAlphaInFloat || job.accuracy.proved > 0;
    return in_double ? prefilter_in<Lobe, double>(tree, job, progress)
                     : prefilter_in<Lobe, float>(tree, job, progress);
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
