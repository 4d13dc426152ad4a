// SPDX-License-Identifier: Apache-2.0
#pragma once

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

template <class S, int kChannels, class Add>
inline void for_each_group(const std::vector<Lanes<S>>& x, const std::vector<Lanes<S>>& y,
                           const std::vector<Lanes<S>>& z, Sums<S, kChannels>& sums,
                           const Add& add) {
    for (std::size_t g = 0; g < x.size(); ++g) {
        Lanes<S> sum[kChannels];
        for (std::size_t k = 0; k < kChannels; ++k) sum[k] = sums.channel[k][g];
        add(x[g], y[g], z[g], sum);
        for (std::size_t k = 0; k < kChannels; ++k) sums.channel[k][g] = sum[k];
    }
}

/// Adds what all the sources give to every point.
template <class S, int kChannels, class Weight>
void add_all(const Weight& weight, const Sources<S>& sources, const Points<S>& points,
             Sums<S, kChannels>& sums) {
    const auto add_clusters = [&](const auto& clusters, auto horizon) {
        for (const ClusterMoments<float>* stored : clusters) {
            const auto m = in_precision<S>(*stored);
            for_each_group(points.x, points.y, points.z, sums,
                           [&](const auto& x, const auto& y, const auto& z, Lanes<S>* s) {
                               add_cluster<horizon, kChannels>(weight, m, x, y, z, s);
                           });
        }
    };
    const auto add_patches = [&](const auto& patches, auto horizon) {
        for (const PatchMoments<S>& m : patches) {
            for_each_group(points.from_x, points.from_y, points.from_z, sums,
                           [&](const auto& x, const auto& y, const auto& z, Lanes<S>* s) {
                               add_patch<horizon, kChannels>(weight, m, x, y, z, s);
                           });
        }
    };
    add_clusters(sources.clusters, std::false_type{});
    add_clusters(sources.horizon_clusters, std::true_type{});
    add_patches(sources.patches, std::false_type{});
    add_patches(sources.horizon_patches, std::true_type{});
}

/// Lagrange interpolation from 8 Chebyshev points of [-1, 1].
class ChebyshevBasis {
  public:
    static constexpr std::size_t kCount = 8;

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

    double node(std::size_t b) const { return nodes_[b]; }

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

    /// Adds to `sums` at places (x, y) what `values` at the nodes, [y node][x node], interpolate
    /// to.
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
