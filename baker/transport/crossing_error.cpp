// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/crossing_error.h"

#include "envbake/runtime/sh.h"

#include <cmath>
#include <numbers>

namespace envbake {

namespace {

using std::numbers::pi;

/// c N^2 for 5 bands and 512 rays, the middle of what was measured on eight meshes, and how it
/// falls.
constexpr double kCells = 0.9, kCellsFrom = 512, kCellsExponent = -0.1;
/// Between meshes c differs by a quarter, within one single vertices by 0.85: one mesh's sample of
/// this many is worth as much as what the others say.
constexpr double kScatter = 0.85, kPriorSamples = 10;
/// Of vertices without a crossing most have no error at all, and one in so many all of it.
/// Measured: 99th percentile of the square 10 to 30 times the mean.
constexpr double kSolvedPerMissed = 10;
/// Standard errors that are added.
constexpr double kMargin = 2;

/// bands^2 / |T_unoccluded|^2, up to a constant.
double norm_of_a_ray(int bands) {
    double unoccluded = 0;
    for (int l = 0; l < bands; ++l) {
        const double a = sh::clamped_cosine(l) / pi;
        unoccluded += a * a * (2 * l + 1);
    }
    return bands * bands / unoccluded;
}

double expected_per_crossing(double rays, int bands) {
    return kCells * std::pow(rays / kCellsFrom, kCellsExponent) / (rays * rays) *
           norm_of_a_ray(bands) / norm_of_a_ray(5);
}

}  // namespace

CrossingError CrossingError::expected(int ray_count, bool with_pilot, int bands) {
    // A quarter of the rays and the rest, each in its own order, cross an outline
    // sqrt(1/4) + sqrt(3/4) times as often as all of them in one.
    const double orders = with_pilot ? 0.5 + std::sqrt(0.75) : 1;
    return {.per_crossing = expected_per_crossing(ray_count, bands) / orders,
            .solved = expected_per_crossing(with_pilot ? ray_count / 4.0 : ray_count, bands),
            .samples = kPriorSamples};
}

CrossingError CrossingError::scaled(int from_rays, int to_rays) const {
    const double factor = std::pow(static_cast<double>(to_rays) / from_rays, kCellsExponent - 2);
    return {per_crossing * factor, solved * factor, samples};
}

CrossingError fit_error(const CrossingError& expected, std::span<const BakedTwice> sample) {
    double crossings = 0, crossed_count = 0, crossed_square = 0, solved_count = 0,
           solved_square = 0;
    for (const BakedTwice& baked : sample) {
        const bool solved = baked.crossings == 0;
        crossings += baked.crossings;
        (solved ? solved_count : crossed_count) += 1;
        (solved ? solved_square : crossed_square) += baked.square;
    }
    CrossingError fit = expected;
    if (crossings > 0) {
        const double prior = kPriorSamples * crossings / crossed_count;
        fit.per_crossing = (crossed_square + prior * expected.per_crossing) / (crossings + prior);
    }
    fit.solved = (solved_square + kPriorSamples * expected.solved) / (solved_count + kPriorSamples);
    fit.samples = kPriorSamples + crossed_count;
    return fit;
}

double fit_row_error(double expected, std::span<const BakedTwice> sample) {
    double square = 0, row_square = 0;
    for (const BakedTwice& baked : sample) {
        square += baked.square;
        row_square += baked.row_square;
    }
    if (square == 0) return expected;
    const double prior = kPriorSamples * square / static_cast<double>(sample.size());
    return std::sqrt((row_square + prior * expected * expected) / (square + prior));
}

double standard_error_factor(double samples, double vertices) {
    return 1 + kMargin * kScatter * std::sqrt(1 / samples + 1 / vertices);
}

ErrorEstimate estimate_error(const CrossingError& error, std::span<const std::uint64_t> histogram,
                             std::uint64_t all) {
    double sum = 0, vertices = 0;
    const auto square_at = [&](std::size_t crossings) {
        return crossings == 0 ? error.solved : error.per_crossing * static_cast<double>(crossings);
    };
    for (std::size_t c = 0; c < histogram.size(); ++c) {
        sum += square_at(c) * static_cast<double>(histogram[c]);
        vertices += static_cast<double>(histogram[c]);
    }
    ErrorEstimate estimate;
    if (sum == 0) return estimate;
    const double factor = standard_error_factor(error.samples, vertices);
    estimate.rms = std::sqrt(sum / static_cast<double>(all) * factor);

    // The share of vertices whose squared error is beyond x: a gamma variable of mean m and shape 2
    // is so with probability (1 + 2x/m) exp(-2x/m), an exponential one with exp(-x/m).
    const auto share_beyond = [&](double x) {
        double beyond = static_cast<double>(histogram[0]) / kSolvedPerMissed *
                        std::exp(-x / (kSolvedPerMissed * error.solved * factor));
        for (std::size_t c = 1; c < histogram.size(); ++c) {
            const double t = 2 * x / (square_at(c) * factor);
            beyond += static_cast<double>(histogram[c]) * (1 + t) * std::exp(-t);
        }
        return beyond / static_cast<double>(all);
    };
    double low = 0, high = 40 * (square_at(histogram.size() - 1) + kSolvedPerMissed * error.solved);
    for (int step = 0; step < 60; ++step) {
        const double middle = (low + high) / 2;
        (share_beyond(middle) > 1e-3 ? low : high) = middle;
    }
    estimate.p999 = std::sqrt(high);
    return estimate;
}

}  // namespace envbake
