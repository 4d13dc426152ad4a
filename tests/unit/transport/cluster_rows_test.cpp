// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/cluster_rows.h"

#include "baker/core/parallel.h"
#include "baker/core/random.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace envbake {
namespace {

constexpr std::size_t kRowSize = 25;

std::vector<float> random_rows(std::size_t count, std::size_t rank, std::uint64_t seed) {
    RandomStream random(seed, 1, 2);
    std::vector<double> directions(rank * kRowSize);
    for (double& x : directions) x = random.next() - 0.5;
    std::vector<float> rows;
    for (std::size_t v = 0; v < count; ++v) {
        std::vector<double> row(kRowSize, 0.25);
        for (std::size_t k = 0; k < rank; ++k) {
            const double weight = random.next() - 0.5;
            for (std::size_t i = 0; i < kRowSize; ++i)
                row[i] += weight * directions[k * kRowSize + i];
        }
        for (const double x : row) rows.push_back(static_cast<float>(x));
    }
    return rows;
}

ClusteredRows cluster(std::span<const float> rows, double tolerance, bool half = false) {
    return cluster_rows({.row_size = kRowSize, .tolerance = tolerance, .half_basis = half},
                        std::vector{rows});
}

/// Errors by the words of docs/format.md, apart from decode().
std::vector<double> errors(const ClusteredRows& c, std::span<const float> rows) {
    std::vector<double> result;
    for (std::size_t v = 0; v < rows.size() / kRowSize; ++v) {
        double square = 0;
        for (std::size_t i = 0; i < kRowSize; ++i) {
            const auto basis = [&](std::size_t row) {
                return double{c.basis[(c.clusters[v] * (1 + c.weight_count) + row) * kRowSize + i]};
            };
            double value = basis(0);
            for (std::size_t k = 0; k < c.weight_count; ++k)
                value += c.weights[v * c.weight_count + k] * basis(1 + k);
            square += std::pow(value - double{rows[v * kRowSize + i]}, 2);
        }
        result.push_back(std::sqrt(square));
    }
    return result;
}

double rms(const std::vector<double>& values) {
    double sum = 0;
    for (const double x : values) sum += x * x;
    return std::sqrt(sum / static_cast<double>(values.size()));
}

double worst(const std::vector<double>& values) {
    return *std::max_element(values.begin(), values.end());
}

TEST(ClusterRows, OneRowIsExact) {
    const std::vector<float> row = random_rows(1, 3, 5);
    const ClusteredRows c = cluster(row, 1e-2);
    EXPECT_EQ(c.cluster_count(kRowSize), 1u);
    EXPECT_EQ(c.weight_count, 1u);
    EXPECT_LT(worst(errors(c, row)), 1e-7);
    // Padded with zeros: there is no direction.
    for (std::size_t i = 0; i < kRowSize; ++i) EXPECT_EQ(c.basis[kRowSize + i], 0);
}

TEST(ClusterRows, IdenticalRowsAreExact) {
    std::vector<float> rows;
    const std::vector<float> row = random_rows(1, 3, 5);
    for (int v = 0; v < 1000; ++v) rows.insert(rows.end(), row.begin(), row.end());
    const ClusteredRows c = cluster(rows, 1e-2);
    EXPECT_EQ(c.cluster_count(kRowSize), 1u);
    EXPECT_LT(worst(errors(c, rows)), 1e-6);
}

// As many clusters as could be used are more than there are rows.
TEST(ClusterRows, FewerRowsThanClusters) {
    const std::vector<float> rows = random_rows(5, 20, 6);
    for (const double tolerance : {1e-1, 1e-3}) {
        const ClusteredRows c = cluster(rows, tolerance);
        EXPECT_LE(c.cluster_count(kRowSize), 5u);
        EXPECT_LE(c.error_rms, tolerance);
        EXPECT_NEAR(c.error_rms, rms(errors(c, rows)), 1e-7);
    }
}

// Rows of rank 2 need two directions and one cluster; asked for more than 8 bits can give, the
// other directions are 0 and the error is that of the weights' rounding.
TEST(ClusterRows, ALowRankIsFound) {
    const std::vector<float> rows = random_rows(3000, 2, 7);
    const ClusteredRows c = cluster(rows, 5e-3);
    EXPECT_EQ(c.weight_count, 2u);
    EXPECT_EQ(c.cluster_count(kRowSize), 1u);
    EXPECT_LE(rms(errors(c, rows)), 5e-3);

    const ClusteredRows exact = cluster(rows, 1e-9);
    const std::vector<double> all = errors(exact, rows);
    EXPECT_TRUE(std::isfinite(rms(all)));
    EXPECT_LT(rms(all), 5e-3);
}

TEST(ClusterRows, RowsThatAreAllZeroOrNoneAreFine) {
    const std::vector<float> rows(40 * kRowSize, 0.0f);
    const ClusteredRows c = cluster(rows, 1e-3);
    EXPECT_EQ(worst(errors(c, rows)), 0);
    EXPECT_TRUE(cluster({}, 1e-3).clusters.empty());
}

TEST(ClusterRows, KeepsToTheToleranceAndStatesWhatItReached) {
    // Eight bundles of low rank: what clusters are for.
    std::vector<float> rows;
    for (std::uint64_t k = 0; k < 8; ++k) {
        const std::vector<float> part = random_rows(200, 3, 20 + k);
        rows.insert(rows.end(), part.begin(), part.end());
    }
    for (const bool half : {false, true}) {
        const ClusteredRows c = cluster(rows, 5e-3, half);
        EXPECT_LE(c.error_rms, 5e-3);
        EXPECT_NEAR(c.error_rms, rms(errors(c, rows)), 1e-7);
        EXPECT_GT(c.cluster_count(kRowSize), 1u);
        EXPECT_LT(c.weight_count, 12u);
    }
}

TEST(ClusterRows, SaysWhereItFallsShort) {
    const std::vector<float> rows = random_rows(300, 25, 9);
    const ClusteredRows c = cluster(rows, 1e-7);
    EXPECT_GT(c.error_rms, 1e-7);
    EXPECT_NEAR(c.error_rms, rms(errors(c, rows)), 1e-7);
}

TEST(ClusterRows, DoesNotDependOnThreadsOrOnTheSplit) {
    const std::vector<float> rows = random_rows(9000, 6, 10);  // more than the sample
    const auto run = [&](int threads, std::size_t split) {
        const ThreadLimit limit(threads);
        const auto all = std::span<const float>(rows);
        return cluster_rows(
            {.row_size = kRowSize, .tolerance = 2e-1},
            std::vector{all.first(split * kRowSize), all.subspan(split * kRowSize)});
    };
    const ClusteredRows one = run(1, 9000), two = run(2, 77);
    EXPECT_EQ(one.clusters, two.clusters);
    EXPECT_EQ(one.weights, two.weights);
    EXPECT_EQ(one.basis, two.basis);
}

}  // namespace
}  // namespace envbake
