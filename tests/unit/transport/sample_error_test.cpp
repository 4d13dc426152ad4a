// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/sample_error.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace envbake {
namespace {

TEST(SampleError, ACompleteSampleIsTakenAsItIs) {
    const std::vector<double> errors{3, 4, 0, 0};
    const ErrorEstimate e = estimate_error(errors, 4, 4);
    EXPECT_DOUBLE_EQ(e.rms_sample, 2.5);
    EXPECT_DOUBLE_EQ(e.rms_traced, 2.5);
    EXPECT_DOUBLE_EQ(e.rms_all, 2.5);
    EXPECT_DOUBLE_EQ(e.p999_all, 4);
    // As many again without an error: the mean square halves.
    EXPECT_DOUBLE_EQ(estimate_error(errors, 4, 8).rms_all, 2.5 / std::sqrt(2));
    // Four among a million are beyond the 99.9th percentile.
    EXPECT_DOUBLE_EQ(estimate_error(errors, 4, 1'000'000).p999_all, 0);
}

TEST(SampleError, NoTracedVerticesNoError) {
    EXPECT_EQ(estimate_error({}, 0, 10).rms_all, 0);
    EXPECT_EQ(estimate_error({}, 0, 0).p999_all, 0);
}

/// Squared errors of 0 and 1 by halves: mean 1/2, standard deviation 1/2, of 100 a standard error
/// of 1/20.
TEST(SampleError, APartOfTheVerticesGetsOneStandardErrorAdded) {
    std::vector<double> errors;
    for (int i = 0; i < 100; ++i) errors.push_back(i % 2);
    const ErrorEstimate e = estimate_error(errors, 10'000, 10'000);
    EXPECT_NEAR(e.rms_sample, std::sqrt(0.5), 1e-12);
    EXPECT_NEAR(e.rms_traced, std::sqrt(0.55), 1e-12);
}

/// Of exponential errors with mean 1 the 99.9th percentile is ln 1000 = 6.9. Samples of 32 to 512
/// may say less in about one case in six, as one standard error goes.
TEST(SampleError, TheTailIsNotFlattered) {
    std::mt19937 random(1);
    std::exponential_distribution<double> exponential;
    for (const std::size_t size : {32u, 128u, 512u}) {
        int low = 0, high = 0;
        for (int trial = 0; trial < 400; ++trial) {
            std::vector<double> errors(size);
            for (double& error : errors) error = exponential(random);
            const double p999 = estimate_error(errors, 1'000'000, 1'000'000).p999_all;
            low += p999 < std::log(1000) / 1.1;
            high += p999 > std::log(1000) * 2;
        }
        EXPECT_LT(low, 400 / 5) << size;
        EXPECT_LT(high, 400 / 8) << size;
    }
}

}  // namespace
}  // namespace envbake
