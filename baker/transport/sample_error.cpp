// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/sample_error.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

namespace envbake {

ErrorEstimate estimate_error(std::span<const double> sample, std::uint64_t traced,
                             std::uint64_t all) {
    ErrorEstimate estimate;
    if (sample.empty() || traced == 0) return estimate;
    const auto count = static_cast<double>(sample.size());
    const double share = static_cast<double>(traced) / static_cast<double>(all);
    const bool complete = sample.size() >= traced;

    double sum = 0, sum_of_squares = 0;
    for (const double e : sample) {
        sum += e * e;
        sum_of_squares += e * e * e * e;
    }
    const double mean = sum / count;
    const double variance = std::max(0.0, sum_of_squares / count - mean * mean);
    const double mean_square = mean + (complete ? 0 : std::sqrt(variance / count));
    estimate.rms_sample = std::sqrt(mean);
    estimate.rms_traced = std::sqrt(mean_square);
    estimate.rms_all = std::sqrt(share * mean_square);

    const double exceeding = 0.001 / share;  // of the traced ones, above the percentile
    if (exceeding >= 1) return estimate;
    std::vector<double> falling(sample.begin(), sample.end());
    std::sort(falling.begin(), falling.end(), std::greater<>());
    estimate.p999_all = falling[static_cast<std::size_t>(exceeding * count)];
    // At least 16 values tell a scale; with fewer than 32 it is the upper half.
    const std::size_t tail =
        std::max(falling.size() / 10, std::min<std::size_t>(falling.size() / 2, 16));
    const double tail_share = static_cast<double>(tail) / count;
    if (complete || tail == 0 || exceeding >= tail_share) return estimate;
    double excess = 0;
    for (std::size_t i = 0; i < tail; ++i)
        excess += (falling[i] - falling[tail]) / static_cast<double>(tail);
    excess *= 1 + 1 / std::sqrt(static_cast<double>(tail));  // one standard error of an exponential
    estimate.p999_all =
        std::max(estimate.p999_all, falling[tail] + excess * std::log(tail_share / exceeding));
    return estimate;
}

}  // namespace envbake
