// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/crossing_error.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace envbake {
namespace {

std::vector<std::uint64_t> histogram_of(const std::vector<int>& crossings) {
    std::vector<std::uint64_t> histogram(
        1 + static_cast<std::size_t>(*std::max_element(crossings.begin(), crossings.end())), 0);
    for (const int c : crossings) ++histogram[static_cast<std::size_t>(c)];
    return histogram;
}

TEST(CrossingError, NoVertexNoError) {
    const CrossingError e = CrossingError::expected(512, false, 5);
    EXPECT_EQ(estimate_error(e, std::vector<std::uint64_t>(4, 0), 10).rms, 0);
    EXPECT_EQ(estimate_error(e, std::vector<std::uint64_t>(4, 0), 0).p999, 0);
}

TEST(CrossingError, VerticesThatMetNoEdgeStillCountForSomething) {
    const CrossingError e = CrossingError::expected(512, false, 5);
    const double one = estimate_error(e, std::vector<std::uint64_t>{0, 1000}, 1000).rms;
    EXPECT_DOUBLE_EQ(estimate_error(e, std::vector<std::uint64_t>{1000, 0}, 1000).rms, one);
    // A pilot of a quarter of the rays overlooks more.
    const CrossingError stopped = CrossingError::expected(512, true, 5);
    EXPECT_GT(estimate_error(stopped, std::vector<std::uint64_t>{1000}, 1000).rms, 3.5 * one);
}

TEST(CrossingError, FallsWithTheRaysAsTheLawOfTheOutlineSays) {
    const CrossingError e = CrossingError::expected(512, true, 5);
    const CrossingError four_times = e.scaled(512, 2048);
    EXPECT_NEAR(four_times.per_crossing, CrossingError::expected(2048, true, 5).per_crossing,
                1e-12 * e.per_crossing);
    EXPECT_NEAR(four_times.solved, CrossingError::expected(2048, true, 5).solved, 1e-12 * e.solved);
    EXPECT_LT(four_times.per_crossing, e.per_crossing / 16);
}

/// The same mesh of gamma-distributed errors, seen through samples of 8 to 512 of its vertices: the
/// truth must hardly ever be a tenth above what is stated, and the statement no idle one.
TEST(CrossingError, TruthIsWithinTheStatedOne) {
    std::mt19937 random(1);
    std::exponential_distribution<double> exponential;
    std::geometric_distribution<int> length(0.05);
    const CrossingError expected = CrossingError::expected(512, false, 5);
    // c of a mesh differs from the expected one by a quarter.
    for (const double scale : {0.75, 1.0, 1.3}) {
        for (const std::size_t samples : {8u, 32u, 512u}) {
            int low = 0, low_tail = 0;
            double excess = 0;
            constexpr int kTrials = 200;
            for (int trial = 0; trial < kTrials; ++trial) {
                constexpr std::size_t kVertices = 4000;
                std::vector<int> crossings;
                std::vector<double> squares;
                for (std::size_t v = 0; v < kVertices; ++v) {
                    crossings.push_back(1 + length(random));
                    squares.push_back(scale * expected.per_crossing * crossings.back() *
                                      (exponential(random) + exponential(random)) / 2);
                }
                std::vector<BakedTwice> sample;
                for (std::size_t v = 0; v < samples; ++v)
                    sample.push_back({crossings[v], squares[v]});
                const ErrorEstimate stated =
                    estimate_error(fit_error(expected, sample), histogram_of(crossings), kVertices);
                double sum = 0;
                for (const double s : squares) sum += s / kVertices;
                std::nth_element(squares.begin(), squares.end() - 4, squares.end());
                low += std::sqrt(sum) > 1.1 * stated.rms;
                low_tail += std::sqrt(*(squares.end() - 4)) > 1.3 * stated.p999;
                excess += stated.rms / std::sqrt(sum) / kTrials;
            }
            EXPECT_LE(low, kTrials / 25) << scale << ", " << samples;
            EXPECT_LE(low_tail, kTrials / 25) << scale << ", " << samples;
            EXPECT_LT(excess, samples == 512 ? 1.08 : 1.4) << scale << ", " << samples;
        }
    }
}

/// One in ten of the solved vertices misses the same square: the percentile must see it.
TEST(CrossingError, TheTailOfWhatAPilotOverlooksIsStated) {
    std::vector<BakedTwice> sample;
    for (int i = 0; i < 500; ++i) sample.push_back({0, i % 10 == 0 ? 1e-4 : 0.0});
    const CrossingError fit = fit_error(CrossingError::expected(2048, true, 5), sample);
    const ErrorEstimate stated = estimate_error(fit, std::vector<std::uint64_t>{5000}, 5000);
    EXPECT_NEAR(stated.rms, std::sqrt(1e-5), 0.3 * std::sqrt(1e-5));
    EXPECT_GT(stated.p999, 1e-2);
    EXPECT_LT(stated.p999, 3e-2);
}

}  // namespace
}  // namespace envbake
