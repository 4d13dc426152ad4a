// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/lighting/output_grid.h"
#include "baker/lighting/points.h"
#include "baker/lighting/prefilter_kernel.h"
#include "baker/lighting/source_walk.h"
#include "baker/math/simd.h"
#include "baker/math/vector.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <type_traits>
#include <vector>

namespace envbake::lighting {

/// Sums at points: [channel][group].
template <class S, int kChannels>
struct Sums {
    std::array<std::vector<Lanes<S>>, kChannels> channel;

    explicit Sums(std::size_t groups) {
        for (auto& c : channel) c.assign(groups, Lanes<S>{});
    }
    /// Channels that are not there are those of the last one.
    DVec3 at(std::size_t point) const {
        DVec3 sum;
        for (int k = 0; k < 3; ++k) {
            const auto& c = channel[static_cast<std::size_t>(std::min(k, kChannels - 1))];
            sum[k] = static_cast<double>(c[point / kLanes<S>][point % kLanes<S>]);
        }
        return sum;
    }
};

/// Moments lie anywhere in the tree.
inline void prefetch(const ClusterMoments<float>* moments) {
    const char* bytes = reinterpret_cast<const char*>(moments);
    for (std::size_t at = 0; at < sizeof *moments; at += 64) __builtin_prefetch(bytes + at);
}

/// Adds what all of `sources` give to every point, add(source, x, y, z, sum). What belongs to a
/// point stays in registers, and some sources at a time in the nearest cache.
template <class S, int kChannels, class Source, class Add>
inline void add_each(const std::vector<Source>& sources, const std::vector<Lanes<S>>& x,
                     const std::vector<Lanes<S>>& y, const std::vector<Lanes<S>>& z,
                     Sums<S, kChannels>& sums, const Add& add) {
    constexpr std::size_t kAtATime = 64;
    for (std::size_t first = 0; first < sources.size(); first += kAtATime) {
        const std::size_t end = std::min(first + kAtATime, sources.size());
        for (std::size_t g = 0; g < x.size(); ++g) {
            Lanes<S> sum[kChannels];
            for (std::size_t k = 0; k < kChannels; ++k) sum[k] = sums.channel[k][g];
            const Lanes<S> gx = x[g], gy = y[g], gz = z[g];
            for (std::size_t i = first; i < end; ++i) {
                if constexpr (std::is_pointer_v<Source>)
                    prefetch(sources[std::min(i + 4, end - 1)]);
                add(sources[i], gx, gy, gz, sum);
            }
            for (std::size_t k = 0; k < kChannels; ++k) sums.channel[k][g] = sum[k];
        }
    }
}

/// Adds what all the sources give to every point.
template <class S, int kChannels, class Weight>
void add_all(const Weight& weight, const Sources<S>& sources, const Points<S>& points,
             Sums<S, kChannels>& sums) {
    const auto add_clusters = [&](const auto& clusters, auto horizon) {
        add_each(clusters, points.x, points.y, points.z, sums,
                 [&](const ClusterMoments<float>* m, const auto& x, const auto& y, const auto& z,
                     Lanes<S>* sum) {
                     add_cluster<horizon, kChannels>(weight, in_precision<S>(*m), x, y, z, sum);
                 });
    };
    const auto add_patches = [&](const auto& patches, auto horizon) {
        add_each(patches, points.from_x, points.from_y, points.from_z, sums,
                 [&](const PatchMoments<S>& m, const auto& x, const auto& y, const auto& z,
                     Lanes<S>* sum) { add_patch<horizon, kChannels>(weight, m, x, y, z, sum); });
    };
    add_clusters(sources.clusters, std::false_type{});
    add_clusters(sources.horizon_clusters, std::true_type{});
    add_patches(sources.patches, std::false_type{});
    add_patches(sources.horizon_patches, std::true_type{});
}

/// Lagrange interpolation from Chebyshev points of [-1, 1].
template <std::size_t kCount>
class ChebyshevBasis {
  public:
    ChebyshevBasis() {
        for (std::size_t b = 0; b < kCount; ++b) {
            nodes_[b] = -std::cos(std::numbers::pi * (static_cast<double>(b) + 0.5) / kCount);
        }
        for (std::size_t b = 0; b < kCount; ++b) {
            double product = 1;
            for (std::size_t o = 0; o < kCount; ++o) {
                if (o != b) product *= nodes_[b] - nodes_[o];
            }
            scale_[b] = static_cast<float>(1 / product);
        }
    }

    /// The nodes of a tile, [y][x].
    std::vector<DVec3> nodes_of(const OutputTile& tile) const {
        std::vector<DVec3> nodes;
        nodes.reserve(kCount * kCount);
        for (const double y : nodes_) {
            for (const double x : nodes_) nodes.push_back(tile.towards(x, y));
        }
        return nodes;
    }

    /// The basis at x: basis[b] is 1 at node b and 0 at the others.
    std::array<Float16, kCount> at(const Float16& x) const {
        std::array<Float16, kCount> basis;
        Float16 before = Float16{} + 1.0f, after = before;
        for (std::size_t b = 0; b < kCount; ++b) {
            basis[b] = before * scale_[b];
            before *= x - static_cast<float>(nodes_[b]);
        }
        for (std::size_t b = kCount; b-- > 0;) {
            basis[b] *= after;
            after *= x - static_cast<float>(nodes_[b]);
        }
        return basis;
    }

    /// Adds to `sums` at places (x, y) what `values` at the nodes interpolate to.
    template <int kChannels>
    void add_interpolated(const Sums<float, kChannels>& values, const std::vector<Float16>& x,
                          const std::vector<Float16>& y, Sums<float, kChannels>& sums) const {
        for (std::size_t g = 0; g < x.size(); ++g) {
            const auto along_x = at(x[g]), along_y = at(y[g]);
            for (std::size_t k = 0; k < kChannels; ++k) {
                Float16 total{};
                for (std::size_t a = 0; a < kCount; ++a) {
                    Float16 line{};
                    for (std::size_t b = 0; b < kCount; ++b) {
                        const std::size_t i = a * kCount + b;
                        line += along_x[b] * values.channel[k][i / kFloatLanes][i % kFloatLanes];
                    }
                    total += along_y[a] * line;
                }
                sums.channel[k][g] += total;
            }
        }
    }

  private:
    std::array<double, kCount> nodes_{};
    std::array<float, kCount> scale_{};
};

}  // namespace envbake::lighting
