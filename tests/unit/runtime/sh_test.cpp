// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/sh.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <random>
#include <vector>

namespace envbake::sh {
namespace {

using std::numbers::pi;

std::vector<double> basis(int bands, double x, double y, double z) {
    std::vector<double> out(static_cast<std::size_t>(coeff_count(bands)));
    evaluate(bands, x, y, z, out.data());
    return out;
}

/// P_l^m(z) / sin^m theta times the full normalisation, by the explicit sum over powers of z in
/// long double: sound to about l = 12, and shares nothing with the recurrence.
double explicit_basis(int l, int m, double x, double y, double z) {
    const int order = std::abs(m);
    const auto factorial = [](int n) { return std::tgamma(static_cast<long double>(n) + 1); };
    long double sum = 0;  // d^(l + m) / dz^(l + m) (z^2 - 1)^l / (2^l l!)
    for (int k = 0; 2 * k <= l - order; ++k) {
        const long double term = factorial(2 * l - 2 * k) /
                                 (factorial(k) * factorial(l - k) * factorial(l - order - 2 * k)) *
                                 std::pow(static_cast<long double>(z), l - order - 2 * k);
        sum += k % 2 == 0 ? term : -term;
    }
    sum /= std::pow(2.0L, l);
    const long double norm =
        std::sqrt((2.0L * l + 1) / (4 * std::numbers::pi_v<long double>)*factorial(l - order) /
                  factorial(l + order));
    const double phi = std::atan2(y, x);
    const double azimuth = m == 0  ? 1
                           : m > 0 ? std::numbers::sqrt2 * std::cos(m * phi)
                                   : std::numbers::sqrt2 * std::sin(order * phi);
    return static_cast<double>(norm * sum) * std::pow(std::hypot(x, y), order) * azimuth;
}

std::vector<std::vector<double>> random_directions(int count) {
    std::mt19937 random(7);
    std::normal_distribution<double> normal;
    std::vector<std::vector<double>> w;
    for (int i = 0; i < count; ++i) {
        const double x = normal(random), y = normal(random), z = normal(random);
        const double r = std::sqrt(x * x + y * y + z * z);
        w.push_back({x / r, y / r, z / r});
    }
    return w;
}

TEST(ShBasis, FirstBandIsYZX) {  // row A0b
    const double k = 0.488602511903;
    EXPECT_NEAR(basis(2, 0, 1, 0)[1], k, 1e-12);
    EXPECT_NEAR(basis(2, 0, 0, 1)[2], k, 1e-12);
    EXPECT_NEAR(basis(2, 1, 0, 0)[3], k, 1e-12);
    EXPECT_NEAR(basis(2, 1, 0, 0)[1], 0, 1e-15);
}

TEST(ShBasis, MatchesTheExplicitPolynomials) {
    for (const auto& w : random_directions(50)) {
        const auto y = basis(10, w[0], w[1], w[2]);
        for (int l = 0; l < 10; ++l) {
            for (int m = -l; m <= l; ++m) {
                EXPECT_NEAR(y[static_cast<std::size_t>(index(l, m))],
                            explicit_basis(l, m, w[0], w[1], w[2]), 2e-13)
                    << "l=" << l << " m=" << m;
            }
        }
    }
}

/// Orthonormality, by Gauss-Chebyshev-free means: the trapezoid rule in phi and in theta (Clenshaw-
/// Curtis weights by their cosine series), exact for the polynomials in question.
double worst_departure_from_identity(int bands) {
    const int azimuths = 2 * bands, panels = 4 * bands;
    const int count = coeff_count(bands);
    std::vector<double> gram(static_cast<std::size_t>(count) * static_cast<std::size_t>(count));
    for (int i = 1; i < panels; ++i) {
        const double theta = pi * i / panels;
        double weight = 0;
        for (int k = 1; k <= panels / 2; ++k) {
            weight += std::sin((2 * k - 1) * theta) / (2 * k - 1);
        }
        weight *= 4 * std::sin(theta) / panels;
        for (int j = 0; j < azimuths; ++j) {
            const double phi = 2 * pi * j / azimuths;
            const auto y = basis(bands, std::sin(theta) * std::cos(phi),
                                 std::sin(theta) * std::sin(phi), std::cos(theta));
            for (int a = 0; a < count; ++a) {
                for (int b = a; b < count; ++b) {
                    gram[static_cast<std::size_t>(a * count + b)] +=
                        weight * 2 * pi / azimuths * y[static_cast<std::size_t>(a)] *
                        y[static_cast<std::size_t>(b)];
                }
            }
        }
    }
    double worst = 0;
    for (int a = 0; a < count; ++a) {
        for (int b = a; b < count; ++b) {
            worst = std::max(
                worst, std::abs(gram[static_cast<std::size_t>(a * count + b)] - (a == b ? 1 : 0)));
        }
    }
    return worst;
}

TEST(ShBasis, IsOrthonormal) {  // row A0
    EXPECT_LT(worst_departure_from_identity(11), 1e-13);
}

TEST(ShBasis, UnsoldSumIsConstantToEightyBands) {  // row A0c, and stability
    for (const int bands : {1, 5, 11, 40, 80}) {
        const double expected = bands * bands / (4 * pi);
        for (const auto& w : random_directions(20)) {
            double sum = 0;
            for (const double v : basis(bands, w[0], w[1], w[2])) sum += v * v;
            EXPECT_NEAR(sum / expected, 1, 1e-12) << bands;
        }
        double sum = 0;
        for (const double v : basis(bands, 0, 0, -1)) sum += v * v;
        EXPECT_NEAR(sum / expected, 1, 1e-12) << "pole, " << bands;
    }
    EXPECT_NEAR(11 * 11 / (4 * pi), 9.62887405706, 1e-11);
}

TEST(ShBasis, FloatFollowsDouble) {
    // Measured worst: 1.9e-6 at 10 bands, 1.5e-4 at 80.
    const std::pair<int, double> limits[] = {{10, 5e-6}, {80, 6e-4}};
    for (const auto& [bands, limit] : limits) {
        double worst = 0;
        for (const auto& w : random_directions(300)) {
            const float x = static_cast<float>(w[0]), y = static_cast<float>(w[1]),
                        z = static_cast<float>(w[2]);
            std::vector<float> f(static_cast<std::size_t>(coeff_count(bands)));
            evaluate(bands, x, y, z, f.data());
            const auto d = basis(bands, static_cast<double>(x), static_cast<double>(y),
                                 static_cast<double>(z));
            for (std::size_t i = 0; i < f.size(); ++i) {
                worst = std::max(worst, std::abs(static_cast<double>(f[i]) - d[i]));
            }
        }
        EXPECT_LT(worst, limit) << bands;
    }
}

TEST(ShBasis, VectorLanesEqualScalars) {
    using Lanes = float __attribute__((vector_size(64)));
    const auto w = random_directions(16);
    Lanes x{}, y{}, z{};
    for (int i = 0; i < 16; ++i) {
        x[i] = static_cast<float>(w[static_cast<std::size_t>(i)][0]);
        y[i] = static_cast<float>(w[static_cast<std::size_t>(i)][1]);
        z[i] = static_cast<float>(w[static_cast<std::size_t>(i)][2]);
    }
    std::vector<Lanes> many(36);
    evaluate(6, x, y, z, many.data());
    for (int i = 0; i < 16; ++i) {
        std::vector<float> one(36);
        evaluate(6, float{x[i]}, float{y[i]}, float{z[i]}, one.data());
        for (std::size_t k = 0; k < 36; ++k) EXPECT_NEAR(many[k][i], one[k], 1e-6f);
    }
}

TEST(ShBasis, ClampedCosineMatchesTheTable) {  // row A1
    const double expected[] = {3.14159265359,    2.09439510239,
                               0.785398163397,   0,
                               -0.1308996939,    0,
                               0.0490873852123,  0,
                               -0.0245436926062, 0,
                               0.0143171540203};
    for (int l = 0; l <= 10; ++l) EXPECT_NEAR(clamped_cosine(l), expected[l], 1e-11) << l;
}

TEST(ShBasis, TripleProductsOfLowBands) {  // row A7: signs of x, y, z together
    double zz0 = 0, zz20 = 0, xy = 0;
    const int n = 64;
    for (int i = 0; i < n; ++i) {
        // Midpoints in z: error C / n^2 for these polynomials, C = 1/12 (b - a)^3 f''.
        const double z = -1 + (2 * i + 1.0) / n, r = std::sqrt(1 - z * z);
        for (int j = 0; j < 16; ++j) {
            const double phi = 2 * pi * j / 16;
            const auto y = basis(3, r * std::cos(phi), r * std::sin(phi), z);
            const double weight = 2.0 / n * 2 * pi / 16;
            zz0 += weight * y[2] * y[2] * y[0];
            zz20 += weight * y[2] * y[2] * y[6];
            xy += weight * y[3] * y[1] * y[4];
        }
    }
    EXPECT_NEAR(zz0, 0.282094791774, 1e-3);
    EXPECT_NEAR(zz20, 0.252313252202, 1e-3);
    EXPECT_NEAR(xy, 0.218509686118, 1e-3);
}

}  // namespace
}  // namespace envbake::sh
