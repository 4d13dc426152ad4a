// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/lighting/prefilter_kernel.h"
#include "baker/lighting/source_walk.h"
#include "baker/math/simd.h"
#include "baker/math/vector.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

namespace envbake::lighting {

inline constexpr std::size_t kLanes = kFloatLanes;

/// Values at points in groups of 16 lanes; the last group repeats its last point.
inline std::vector<Float16> in_groups(const std::vector<double>& values) {
    std::vector<Float16> groups((values.size() + kLanes - 1) / kLanes);
    for (std::size_t i = 0; i < groups.size() * kLanes; ++i) {
        groups[i / kLanes][i % kLanes] = static_cast<float>(values[std::min(i, values.size() - 1)]);
    }
    return groups;
}

/// Directions to evaluate.
struct Points {
    std::vector<Float16> x, y, z;
    std::size_t groups() const { return x.size(); }

    explicit Points(const std::vector<DVec3>& directions) {
        const auto component = [&](int axis) {
            std::vector<double> values;
            values.reserve(directions.size());
            for (const DVec3& d : directions) values.push_back(d[axis]);
            return in_groups(values);
        };
        x = component(0);
        y = component(1);
        z = component(2);
    }
};

/// Sums at points: [channel][group].
template <int kChannels>
struct Sums {
    std::array<std::vector<Float16>, kChannels> channel;

    explicit Sums(std::size_t groups) {
        for (auto& c : channel) c.assign(groups, Float16{});
    }
    /// Channels that are not there are those of the last one.
    DVec3 at(std::size_t point) const {
        DVec3 sum;
        for (int k = 0; k < 3; ++k) {
            const auto& c = channel[static_cast<std::size_t>(std::min(k, kChannels - 1))];
            sum[k] = static_cast<double>(c[point / kLanes][point % kLanes]);
        }
        return sum;
    }
};

template <int kChannels, class Add>
inline void for_each_group(const Points& points, Sums<kChannels>& sums, const Add& add) {
    for (std::size_t g = 0; g < points.groups(); ++g) {
        Float16 sum[kChannels];
        for (std::size_t k = 0; k < kChannels; ++k) sum[k] = sums.channel[k][g];
        add(points.x[g], points.y[g], points.z[g], sum);
        for (std::size_t k = 0; k < kChannels; ++k) sums.channel[k][g] = sum[k];
    }
}

template <bool kHorizon, int kChannels, class Weight>
inline void add_cluster_at(const Weight& weight, const ClusterMoments<float>& m,
                           const Points& points, Sums<kChannels>& sums) {
    for_each_group(points, sums, [&](const auto& x, const auto& y, const auto& z, Float16* s) {
        add_cluster<kHorizon, kChannels>(weight, m, x, y, z, s);
    });
}

/// Adds what all the sources give to every point.
template <int kChannels, class Weight>
void add_all(const ClusterTree& tree, const Weight& weight, const Sources<float>& sources,
             const Points& points, Sums<kChannels>& sums) {
    for (const std::uint32_t i : sources.clusters) {
        add_cluster_at<false>(weight, tree.moments(i), points, sums);
    }
    for (const std::uint32_t i : sources.horizon_clusters) {
        add_cluster_at<true>(weight, tree.moments(i), points, sums);
    }
    for (const auto& m : sources.patches) {
        for_each_group(points, sums, [&](const auto& x, const auto& y, const auto& z, Float16* s) {
            add_patch<false, kChannels>(weight, m, x, y, z, s);
        });
    }
    for (const auto& m : sources.horizon_patches) {
        for_each_group(points, sums, [&](const auto& x, const auto& y, const auto& z, Float16* s) {
            add_patch<true, kChannels>(weight, m, x, y, z, s);
        });
    }
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
    void add_interpolated(const Sums<kChannels>& values, const std::vector<Float16>& x,
                          const std::vector<Float16>& y, Sums<kChannels>& sums) const {
        for (std::size_t g = 0; g < x.size(); ++g) {
            const auto along_x = at(x[g]), along_y = at(y[g]);
            for (std::size_t k = 0; k < kChannels; ++k) {
                Float16 total{};
                for (std::size_t a = 0; a < kCount; ++a) {
                    Float16 line{};
                    for (std::size_t b = 0; b < kCount; ++b) {
                        const std::size_t i = a * kCount + b;
                        line += along_x[b] * values.channel[k][i / kLanes][i % kLanes];
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
