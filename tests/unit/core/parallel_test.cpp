// SPDX-License-Identifier: Apache-2.0
#include "baker/core/parallel.h"
#include "baker/core/random.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <vector>

namespace envbake {
namespace {

TEST(ParallelFor, CallsEveryIndexOnce) {
    for (const int threads : {1, 2, 7}) {
        const ThreadLimit limit(threads);
        EXPECT_EQ(thread_count(), threads);
        std::vector<std::atomic<int>> calls(1000);
        parallel_for(calls.size(), [&](std::size_t i) { ++calls[i]; });
        for (const auto& count : calls) EXPECT_EQ(count, 1);
    }
}

TEST(ParallelFor, AcceptsNothingToDo) {
    parallel_for(0, [](std::size_t) { FAIL(); });
}

TEST(RandomStream, DependsOnSeedStageAndElementOnly) {
    EXPECT_EQ(RandomStream(1, 2, 3).next(), RandomStream(1, 2, 3).next());
    EXPECT_NE(RandomStream(1, 2, 3).next(), RandomStream(1, 2, 4).next());
    EXPECT_NE(RandomStream(1, 2, 3).next(), RandomStream(1, 3, 3).next());
    EXPECT_NE(RandomStream(1, 2, 3).next(), RandomStream(2, 2, 3).next());
}

// The mean of n uniform numbers has standard deviation 1 / sqrt(12 n); 5 of them are allowed.
TEST(RandomStream, IsUniform) {
    RandomStream random(0, 0, 0);
    constexpr int kCount = 100000;
    double sum = 0, lowest = 1, highest = 0;
    for (int i = 0; i < kCount; ++i) {
        const double u = random.next();
        sum += u;
        lowest = std::min(lowest, u);
        highest = std::max(highest, u);
    }
    EXPECT_NEAR(sum / kCount, 0.5, 5 / std::sqrt(12.0 * kCount));
    EXPECT_GE(lowest, 0);
    EXPECT_LT(highest, 1);
    EXPECT_GT(highest, 0.9999);
}

}  // namespace
}  // namespace envbake
