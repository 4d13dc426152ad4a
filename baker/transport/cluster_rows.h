// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace envbake {

struct ClusterJob {
    std::size_t row_size = 25;  ///< D, numbers a row
    double tolerance = 6e-3;    ///< rms over rows of |T - T'|_2 that is accepted
    bool half_basis = true;     ///< basis rows will be stored as f16, and are rounded to that
    std::uint64_t seed = 0;
};

/// T'_v = basis[c_v][0] + sum over k of q_vk basis[c_v][1 + k].
struct ClusteredRows {
    std::size_t weight_count = 0;         ///< n, 1 .. 32
    std::vector<std::uint16_t> clusters;  ///< c, [rows]
    std::vector<std::uint8_t> weights;    ///< q, [rows, n]
    std::vector<float> basis;             ///< [clusters, 1 + n, D]
    bool half_basis = true;
    double error_rms = 0;  ///< over rows of |T - T'|_2

    std::size_t cluster_count(std::size_t row_size) const {
        return basis.size() / ((1 + weight_count) * row_size);
    }
    /// What it takes in a bundle.
    std::uint64_t bytes(const ClusterJob& job) const;
    /// T' of one row.
    void decode(std::size_t row, std::span<float> out) const;
};

/// Clustered principal component analysis: rows are split into clusters, each with a mean and n
/// directions of its own, such that n is the least (with as many clusters as take the fewest
/// bytes) that keeps to the tolerance. Where no n to 32 does, the error says so. Lloyd's iteration
/// with the distance to a cluster's affine subspace, from a k-means++ start, on a sample of the
/// rows; weights are of 8 bits over the range that they have in their cluster.
///
/// Fewer distinct rows than clusters are as many clusters; rows of a lower rank than n have
/// directions of 0. `parts` are the rows in their order. Deterministic for any number of threads.
///
/// Source: [Sloan03].
ClusteredRows cluster_rows(const ClusterJob& job, std::span<const std::span<const float>> parts);

}  // namespace envbake
