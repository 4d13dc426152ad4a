// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/wavelet.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

namespace envbake::wavelet {
namespace {

using std::numbers::pi;

std::vector<double> noise(std::size_t count, unsigned seed) {
    std::mt19937 random(seed);
    std::vector<double> values(count);
    for (double& v : values) v = static_cast<double>(random()) / 0x1p32;
    return values;
}

std::vector<double> decomposed(int n, std::vector<double> texels) {
    std::vector<double> coeffs(texels.size(), NAN);
    forward(n, texels.data(), coeffs.data());
    return coeffs;
}

double dot(const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
    return sum;
}

TEST(Wavelet, DotProductsStay) {  // Parseval
    for (const int n : {1, 2, 16, 64, 128}) {
        const auto count = static_cast<std::size_t>(n * n);
        const std::vector<double> x = noise(count, 1), y = noise(count, 2);
        EXPECT_NEAR(dot(decomposed(n, x), decomposed(n, y)) / dot(x, y), 1, 1e-14) << n;
    }
}

TEST(Wavelet, ConstantFaceIsOneCoefficient) {
    std::vector<double> coeffs = decomposed(64, std::vector<double>(64 * 64, 1.0));
    EXPECT_EQ(coeffs[0], 64);
    coeffs[0] = 0;
    EXPECT_EQ(dot(coeffs, coeffs), 0);
}

TEST(Wavelet, LoneTexelIsThreeDetailsALevel) {
    std::vector<double> texels(64 * 64, 0.0);
    texels[37 * 64 + 11] = 1;
    const std::vector<double> coeffs = decomposed(64, texels);
    EXPECT_EQ(std::count_if(coeffs.begin(), coeffs.end(), [](double c) { return c != 0; }), 19);
    EXPECT_EQ(dot(coeffs, coeffs), 1);
    EXPECT_EQ(coeffs[0], 1.0 / 64);
    // 37 odd, 11 odd: of the finest square it is the lower right texel.
    EXPECT_EQ(coeffs[(0 + 18) * 64 + 32 + 5], -0.5);  // across
    EXPECT_EQ(coeffs[(32 + 18) * 64 + 0 + 5], -0.5);  // down
    EXPECT_EQ(coeffs[(32 + 18) * 64 + 32 + 5], 0.5);  // diagonal
    // Of the next it is in the square of row 18, column 5: upper right.
    EXPECT_EQ(coeffs[(0 + 9) * 64 + 16 + 2], -0.25);
    EXPECT_EQ(coeffs[(16 + 9) * 64 + 0 + 2], 0.25);
}

/// Every coefficient by the definition of its wavelet, and not by the recurrence.
TEST(Wavelet, CoefficientsAreThoseOfTheDefinition) {
    constexpr int n = 16;
    const std::vector<double> texels = noise(n * n, 3);
    const std::vector<double> coeffs = decomposed(n, texels);
    for (int row = 0; row < n; ++row) {
        for (int column = 0; column < n; ++column) {
            int s = 1;
            while (2 * s <= std::max(row, column)) s *= 2;
            const bool down = row >= s, across = column >= s, mean = row + column == 0;
            const int size = mean ? n : n / s;
            const int top = (down ? row - s : row) * size,
                      left = (across ? column - s : column) * size;
            double sum = 0;
            for (int r = 0; r < size; ++r)
                for (int c = 0; c < size; ++c) {
                    const double sign =
                        (down && 2 * r >= size ? -1 : 1) * (across && 2 * c >= size ? -1 : 1);
                    sum += sign * texels[static_cast<std::size_t>((top + r) * n + left + c)];
                }
            EXPECT_NEAR(coeffs[static_cast<std::size_t>(row * n + column)], sum / size, 1e-14)
                << row << ' ' << column;
        }
    }
}

TEST(Wavelet, InverseGivesTheTexelsBack) {
    for (const int n : {1, 2, 16, 128}) {
        const std::vector<double> texels = noise(static_cast<std::size_t>(n * n), 4);
        const std::vector<double> coeffs = decomposed(n, texels);
        std::vector<double> back(texels.size(), NAN);
        inverse(n, coeffs.data(), back.data());
        for (std::size_t i = 0; i < texels.size(); ++i) EXPECT_NEAR(back[i], texels[i], 1e-14);
    }
}

std::vector<Rgb> coefficients_of(int map_size, const std::vector<Rgb>& map, int n) {
    std::vector<Rgb> coeffs(coeff_count(n));
    std::vector<double> scratch(light_scratch_size(n));
    light_coefficients(map_size, map, n, coeffs, scratch);
    return coeffs;
}

std::vector<Rgb> noise_map(int size, unsigned seed) {
    const std::vector<double> values = noise(3 * coeff_count(size), seed);
    std::vector<Rgb> map(coeff_count(size));
    for (std::size_t i = 0; i < values.size(); ++i)
        map[i / 3][i % 3] = static_cast<float>(values[i]);
    return map;
}

/// Dot product with a transport that is constant over the texels of the basis, against the sum over
/// the texels of the map: full noise on both sides, for sizes that divide each other and not.
TEST(WaveletLight, DotProductIsTheIntegral) {
    constexpr int n = 16;
    const std::vector<double> transport = noise(coeff_count(n), 5);
    std::vector<double> t;
    for (int face = 0; face < 6; ++face) {
        const auto first = transport.begin() + face * n * n;
        const std::vector<double> of_face = decomposed(n, {first, first + n * n});
        t.insert(t.end(), of_face.begin(), of_face.end());
    }
    for (const int m : {1, 8, 16, 32, 24, 50}) {
        const std::vector<Rgb> map = noise_map(m, 6);
        const std::vector<Rgb> light = coefficients_of(m, map, n);
        const int fine = 16 * m;  // every edge of both grids is one of these
        for (std::size_t channel = 0; channel < 3; ++channel) {
            double dot_product = 0, integral = 0;
            for (std::size_t i = 0; i < t.size(); ++i)
                dot_product += t[i] * static_cast<double>(light[i][channel]);
            for (int face = 0; face < 6; ++face)
                for (int r = 0; r < fine; ++r)
                    for (int c = 0; c < fine; ++c) {
                        const auto at = [&](int size) {
                            return static_cast<std::size_t>((face * size + r * size / fine) * size +
                                                            c * size / fine);
                        };
                        integral += cube::texel_solid_angle(r, c, fine) *
                                    static_cast<double>(map[at(m)][channel]) * transport[at(n)];
                    }
            EXPECT_NEAR(dot_product / integral, 1, 1e-6) << m << ' ' << channel;
        }
    }
}

TEST(WaveletLight, ConstantLightIsTheSphere) {
    const std::vector<Rgb> light = coefficients_of(8, std::vector<Rgb>(6 * 64, {1, 2, 0}), 32);
    double flux = 0;
    for (std::size_t face = 0; face < 6; ++face)
        flux += 32 * static_cast<double>(light[face * 32 * 32][0]);
    EXPECT_NEAR(flux, 4 * pi, 1e-5);
    for (const Rgb& c : light) EXPECT_EQ(2 * c[0], c[1]);
    for (const Rgb& c : light) EXPECT_EQ(c[2], 0);
}

TEST(WaveletLight, LoneTexelKeepsItsFlux) {
    std::vector<Rgb> map(coeff_count(64));
    map[(2 * 64 + 20) * 64 + 41] = {1e5f, 0, 3e4f};
    const std::vector<Rgb> light = coefficients_of(64, map, 64);
    const double flux = 1e5 * cube::texel_solid_angle(20, 41, 64);
    double square = 0;
    int terms = 0;
    for (const Rgb& c : light) {
        square += static_cast<double>(c[0]) * static_cast<double>(c[0]);
        terms += c[0] != 0;
    }
    EXPECT_EQ(terms, 19);
    EXPECT_NEAR(std::sqrt(square) / flux, 1, 1e-6);
}

TEST(SelectTerms, WeightsDecideAndOrderIsByIndex) {
    const auto terms = [] {
        return std::vector<Term>{{0, {1, 0, 0}}, {1, {0, -3, 0}}, {2, {2, 2, 2}}, {3, {0, 0, 5}}};
    };
    std::vector<Term> list = terms();
    ASSERT_EQ(select_terms(list, {}, 2), 2u);
    EXPECT_EQ(list[0].index, 2u);
    EXPECT_EQ(list[1].index, 3u);

    list = terms();
    const std::vector<float> weights{10, 2, 0, 1};  // 10, 6, 0, 5
    ASSERT_EQ(select_terms(list, weights, 2), 2u);
    EXPECT_EQ(list[0].index, 0u);
    EXPECT_EQ(list[1].index, 1u);
    EXPECT_EQ(list[1].value[1], -3);

    list = terms();
    EXPECT_EQ(select_terms(list, weights, 9), 4u);
    for (std::uint32_t i = 0; i < 4; ++i) EXPECT_EQ(list[i].index, i);
}

}  // namespace
}  // namespace envbake::wavelet
