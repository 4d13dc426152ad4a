// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/wavelet_lighting.h"

#include "tests/support/environments.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace envbake {
namespace {

using wavelet::Rgb;
using wavelet::Term;

constexpr int n = 16;

std::vector<float> decomposed(std::vector<float> texels) {
    std::vector<float> coeffs(texels.size());
    for (std::size_t face = 0; face < 6; ++face)
        wavelet::forward(n, &texels[face * n * n], &coeffs[face * n * n]);
    return coeffs;
}

/// Cosine lobes, cut off by a plane: 1/pi max(0, n.w) for edge.w > 0, by texels.
std::vector<std::vector<float>> shadowed_rows(int count) {
    std::mt19937 random(7);
    const auto direction = [&] {
        for (;;) {
            DVec3 w;
            for (int i = 0; i < 3; ++i) w[i] = static_cast<double>(random()) / 0x1p31 - 1;
            if (glm::length(w) < 1 && glm::length(w) > 0.1) return glm::normalize(w);
        }
    };
    std::vector<std::vector<float>> rows;
    for (int k = 0; k < count; ++k) {
        const DVec3 normal = direction(), edge = direction();
        std::vector<float> texels;
        for (const test::Texel& t : test::texels_of(test::cube_grid(n))) {
            const DVec3 w = t.middle();
            texels.push_back(static_cast<float>(
                glm::dot(edge, w) > 0 ? std::max(0.0, glm::dot(normal, w)) / std::numbers::pi : 0));
        }
        rows.push_back(decomposed(texels));
    }
    return rows;
}

std::vector<float> rms_of(const std::vector<std::vector<float>>& rows) {
    std::vector<float> weights(rows[0].size());
    for (std::size_t i = 0; i < weights.size(); ++i) {
        double sum = 0;
        for (const auto& row : rows) sum += static_cast<double>(row[i] * row[i]);
        weights[i] = static_cast<float>(std::sqrt(sum / static_cast<double>(rows.size())));
    }
    return weights;
}

double channel(const Rgb& rgb, int c) {
    return static_cast<double>(rgb[static_cast<std::size_t>(c)]);
}

/// Relative rms of what is missing, from first principles: the sums with and without.
double error_of(const std::vector<Term>& terms, const std::vector<Rgb>& coeffs,
                const std::vector<std::vector<float>>& rows) {
    double wrong = 0, all = 0;
    for (const auto& row : rows)
        for (int c = 0; c < 3; ++c) {
            double exact = 0, part = 0;
            for (std::size_t i = 0; i < coeffs.size(); ++i)
                exact += channel(coeffs[i], c) * static_cast<double>(row[i]);
            for (const Term& term : terms)
                part += channel(term.value, c) * static_cast<double>(row[term.index]);
            wrong += (part - exact) * (part - exact);
            all += exact * exact;
        }
    return std::sqrt(wrong / all);
}

/// Every cell of a lat-long map shares its radiance out by solid angle, so its flux stays.
TEST(WaveletLighting, TotalFluxIsThatOfTheMap) {
    const Environment sky = test::sun_and_sky(test::lat_long_grid(64, 32));
    DVec3 flux(0);
    const auto texels = test::texels_of(sky.grid);
    for (std::size_t i = 0; i < texels.size(); ++i)
        flux += DVec3(sky.radiance[i]) * (std::cos(texels[i].a0) - std::cos(texels[i].a1)) *
                (texels[i].b1 - texels[i].b0);
    const std::vector<Rgb> coeffs = project_wavelet(sky, n, 3);
    for (int c = 0; c < 3; ++c) {
        double sum = 0;
        for (std::size_t face = 0; face < 6; ++face) sum += n * channel(coeffs[face * n * n], c);
        EXPECT_NEAR(sum / flux[c], 1, 1e-6);
    }
    for (const Rgb& rgb : project_wavelet(sky, n, 1)) EXPECT_EQ(rgb[0], rgb[2]);
}

TEST(ChooseTerms, AsFewAsKeepTheErrorAndInOrder) {
    const Environment sky = test::sun_and_sky(test::cube_grid(32));
    const std::vector<Rgb> coeffs = project_wavelet(sky, n, 3);
    const auto rows = shadowed_rows(40);
    const std::vector<float> weights = rms_of(rows);
    for (const double tolerance : {0.1, 0.01, 1e-3}) {
        const ChosenTerms chosen = choose_terms(coeffs, weights, rows, tolerance);
        EXPECT_TRUE(std::is_sorted(chosen.terms.begin(), chosen.terms.end(),
                                   [](const Term& a, const Term& b) { return a.index < b.index; }));
        EXPECT_NEAR(chosen.error, error_of(chosen.terms, coeffs, rows), 1e-6);
        EXPECT_LE(chosen.error, tolerance);
        std::vector<Term> fewer;
        for (std::uint32_t i = 0; i < coeffs.size(); ++i) fewer.push_back({i, coeffs[i]});
        fewer.resize(wavelet::select_terms(fewer, weights, chosen.terms.size() - 1));
        EXPECT_GT(error_of(fewer, coeffs, rows), tolerance);
    }
}

/// Of noise all coefficients are alike in size, and only the coarse ones can be told from a vertex.
TEST(ChooseTerms, TransportDecidesBetterThanSize) {
    const Environment noise = test::environment(
        test::cube_grid(n),
        [](const test::Texel&, std::size_t i) { return DVec3(RandomStream(3, 4, i).next()); });
    const std::vector<Rgb> coeffs = project_wavelet(noise, n, 3);
    const auto rows = shadowed_rows(40);
    const std::vector<float> weights = rms_of(rows);
    const auto error_with = [&](std::span<const float> by) {
        std::vector<Term> terms;
        for (std::uint32_t i = 0; i < coeffs.size(); ++i) terms.push_back({i, coeffs[i]});
        terms.resize(wavelet::select_terms(terms, by, 64));
        return error_of(terms, coeffs, rows);
    };
    EXPECT_LT(error_with(weights), 0.7 * error_with({}));
}

TEST(ChooseTerms, BlackNeedsNoneAndConstantLightSix) {
    const auto rows = shadowed_rows(20);
    const std::vector<float> weights = rms_of(rows);
    const auto constant = [&](double level) {
        const Environment map = test::environment(
            test::cube_grid(n), [&](const test::Texel&, std::size_t) { return DVec3(level); });
        return choose_terms(project_wavelet(map, n, 3), weights, rows, 0.1);
    };
    EXPECT_TRUE(constant(0).terms.empty());
    EXPECT_EQ(constant(0).error, 0);
    EXPECT_GE(constant(2).terms.size(), 6u);
    EXPECT_LE(constant(2).terms.size(), 18u);  // and the fall of solid angle towards the corners
}

TEST(ShShadowLoss, ASunLosesMuchAndMoreBandsLessAndConstantLightNothing) {
    const auto loss = [](double sun, int bands) {
        const Environment map =
            test::environment(test::cube_grid(n), [&](const test::Texel&, std::size_t i) {
                return DVec3(i == 2 * n * n + 5 * n + 7 ? sun : 1);
            });
        return sh_shadow_loss(map, bands);
    };
    EXPECT_LT(loss(1, 5), 0.02);
    EXPECT_GT(loss(1e5, 5), 0.25);
    EXPECT_LT(loss(1e5, 10), loss(1e5, 5));
    EXPECT_GT(loss(1e5, 10), 0.1);
    EXPECT_GT(loss(1e5, 2), 0.4);
    const Environment black = test::environment(
        test::cube_grid(n), [](const test::Texel&, std::size_t) { return DVec3(0); });
    EXPECT_EQ(sh_shadow_loss(black, 5), 0);
}

}  // namespace
}  // namespace envbake
