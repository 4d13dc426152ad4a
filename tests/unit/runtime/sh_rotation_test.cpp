// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/sh_rotation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

namespace envbake::sh {
namespace {

using std::numbers::pi;
using Vector = std::array<double, 3>;

constexpr Matrix3 kIdentity{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};

Matrix3 operator*(const Matrix3& a, const Matrix3& b) {
    Matrix3 c{};
    for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t j = 0; j < 3; ++j) {
            for (std::size_t k = 0; k < 3; ++k) c[i][j] += a[i][k] * b[k][j];
        }
    }
    return c;
}
Vector operator*(const Matrix3& a, const Vector& v) {
    Vector w{};
    for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t k = 0; k < 3; ++k) w[i] += a[i][k] * v[k];
    }
    return w;
}

/// By `angle` about axis 0 .. 2, right-handed.
Matrix3 about(std::size_t axis, double angle) {
    Matrix3 m = kIdentity;
    const std::size_t a = (axis + 1) % 3, b = (axis + 2) % 3;
    m[a][a] = m[b][b] = std::cos(angle);
    m[a][b] = -std::sin(angle);
    m[b][a] = std::sin(angle);
    return m;
}

std::vector<double> basis(const Vector& w, int bands = kMaxBundleBands) {
    std::vector<double> y(static_cast<std::size_t>(coeff_count(bands)));
    evaluate(bands, w[0], w[1], w[2], y.data());
    return y;
}

std::vector<Vector> random_directions(int count) {
    std::mt19937 random(11);
    std::normal_distribution<double> normal;
    std::vector<Vector> w;
    for (int i = 0; i < count; ++i) {
        const double x = normal(random), y = normal(random), z = normal(random);
        const double r = std::sqrt(x * x + y * y + z * z);
        w.push_back({x / r, y / r, z / r});
    }
    return w;
}

/// None, quarter and half turns, tiny ones, both gimbal locks of every order of Euler angles, and
/// some of no symmetry; then the same with a mirror.
std::vector<Matrix3> all_turns() {
    std::vector<Matrix3> turns{kIdentity};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        for (const double angle : {1e-9, -1e-9, pi / 2, pi, pi - 1e-9, 1.0}) {
            turns.push_back(about(axis, angle));
        }
        for (const double lock : {pi / 2, -pi / 2, pi / 2 - 1e-9}) {
            turns.push_back(about(axis, 0.3) * about((axis + 1) % 3, lock) * about(axis, 1.1));
            turns.push_back(about(axis, 0.3) * about((axis + 1) % 3, lock) *
                            about((axis + 2) % 3, 1.1));
        }
    }
    for (int i = 0; i < 10; ++i) {
        turns.push_back(about(0, 2.1 * i) * about(1, 0.7 + i) * about(2, 1.3 * i * i));
    }
    const std::size_t count = turns.size();
    for (std::size_t i = 0; i < count; ++i) {
        Matrix3 mirrored = turns[i];
        for (auto& row : mirrored) row[i % 3] = -row[i % 3];
        turns.push_back(mirrored);
    }
    return turns;
}

Rotation rotation(const Matrix3& m) {
    const auto made = Rotation::from_matrix(m);
    EXPECT_TRUE(made);
    return made.value_or(Rotation());
}

double worst_difference(const Rotation& a, const Rotation& b) {
    double worst = 0;
    for (int l = 0; l < kMaxBundleBands; ++l) {
        for (int m = -l; m <= l; ++m) {
            for (int k = -l; k <= l; ++k) {
                worst = std::max(worst, std::abs(a.element(l, m, k) - b.element(l, m, k)));
            }
        }
    }
    return worst;
}

TEST(ShRotation, IdentityIsExact) {
    for (const Rotation& none : {Rotation(), rotation(kIdentity), *Rotation::from_quaternion({})}) {
        for (int l = 0; l < kMaxBundleBands; ++l) {
            for (int m = -l; m <= l; ++m) {
                for (int k = -l; k <= l; ++k) {
                    EXPECT_EQ(none.element(l, m, k), m == k ? 1 : 0) << l << " " << m << " " << k;
                }
            }
        }
    }
}

TEST(ShRotation, TurnsTheBasisWithTheDirection) {
    // Y(M w) = R Y(w) at more directions than a band has functions: only the right R can do it.
    // A lamp at w has the coefficients Y(w), so this is also "turn the lamp" = "turn the light".
    for (const Matrix3& m : all_turns()) {
        const Rotation r = rotation(m);
        double worst = 0;
        for (const Vector& w : random_directions(25)) {
            const auto from = basis(w), expected = basis(m * w);
            std::vector<double> to(from.size());
            ASSERT_TRUE(r.apply(from, to));
            for (std::size_t i = 0; i < to.size(); ++i) {
                worst = std::max(worst, std::abs(to[i] - expected[i]));
            }
        }
        EXPECT_LT(worst, 1e-13) << m[0][0] << " " << m[0][1] << " " << m[1][0];
    }
}

TEST(ShRotation, AboutThePolarAxisHasClosedForm) {
    // cos m (phi + a) and sin m (phi + a), expanded.
    for (const double angle : {1e-9, 0.5, pi / 2, pi, 4.0}) {
        const Rotation r = rotation(about(2, angle));
        for (int l = 0; l < kMaxBundleBands; ++l) {
            for (int m = -l; m <= l; ++m) {
                for (int k = -l; k <= l; ++k) {
                    const double expected = k == m    ? std::cos(m * angle)
                                            : k == -m ? -std::sin(m * angle)
                                                      : 0;
                    EXPECT_NEAR(r.element(l, m, k), expected, 1e-14);
                }
            }
        }
        // A turn of 1e-9 is not lost in the 1 beside it.
        EXPECT_NEAR(r.element(9, 9, -9) / -std::sin(9 * angle), 1, angle == pi ? 1 : 1e-13);
    }
}

TEST(ShRotation, IsOrthogonal) {
    double worst = 0;
    for (const Matrix3& m : all_turns()) {
        const Rotation r = rotation(m);
        for (int l = 0; l < kMaxBundleBands; ++l) {
            for (int a = -l; a <= l; ++a) {
                for (int b = -l; b <= l; ++b) {
                    double dot = a == b ? -1 : 0;
                    for (int k = -l; k <= l; ++k) dot += r.element(l, a, k) * r.element(l, b, k);
                    worst = std::max(worst, std::abs(dot));
                }
            }
        }
    }
    EXPECT_LT(worst, 1e-14);
}

TEST(ShRotation, FirstThenSecondIsTheProduct) {
    const auto turns = all_turns();
    for (std::size_t i = 0; i + 1 < turns.size(); ++i) {
        const Rotation first = rotation(turns[i]), second = rotation(turns[i + 1]);
        const Rotation both = rotation(turns[i + 1] * turns[i]);
        for (const Vector& w : random_directions(3)) {
            const auto from = basis(w);
            std::vector<double> twice(from.size()), once(from.size());
            ASSERT_TRUE(first.apply(from, twice));
            ASSERT_TRUE(second.apply(twice, twice));
            ASSERT_TRUE(both.apply(from, once));
            for (std::size_t k = 0; k < once.size(); ++k) EXPECT_NEAR(twice[k], once[k], 1e-13);
        }
    }
}

TEST(ShRotation, QuaternionsTurnAsMatricesDo) {
    const double half = 0.35;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        Vector v{};
        v[axis] = std::sin(half);
        for (const double length : {1.0, -3.0, 1e-90, 1e90}) {
            const auto r = Rotation::from_quaternion(
                {length * v[0], length * v[1], length * v[2], length * std::cos(half)});
            ASSERT_TRUE(r);
            EXPECT_LT(worst_difference(*r, rotation(about(axis, 2 * half))), 1e-14);
        }
    }
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const double infinity = std::numeric_limits<double>::infinity();
    EXPECT_FALSE(Rotation::from_quaternion({0, 0, 0, 0}));
    EXPECT_FALSE(Rotation::from_quaternion({0, nan, 0, 1}));
    EXPECT_FALSE(Rotation::from_quaternion({0, infinity, 0, 1}));
}

TEST(ShRotation, MirrorAtTheOriginFlipsOddBands) {
    const Rotation r = rotation({{{-1, 0, 0}, {0, -1, 0}, {0, 0, -1}}});
    for (int l = 0; l < kMaxBundleBands; ++l) {
        for (int m = -l; m <= l; ++m) {
            for (int k = -l; k <= l; ++k) {
                EXPECT_EQ(r.element(l, m, k), m != k ? 0 : l % 2 == 0 ? 1 : -1);
            }
        }
    }
}

TEST(ShRotation, NearlyOrthogonalIsRepairedAndTheRestRefused) {
    const Matrix3 m = about(0, 0.4) * about(1, 1.2) * about(2, 2.5);
    // M S with S symmetric and positive has M as its polar factor.
    const Matrix3 stretch{{{1 + 4e-5, 1e-5, -2e-5}, {1e-5, 1 - 3e-5, 1e-5}, {-2e-5, 1e-5, 1}}};
    EXPECT_LT(worst_difference(rotation(m * stretch), rotation(m)), 1e-13);

    Matrix3 rounded = m;
    for (auto& row : rounded) {
        for (double& x : row) x = static_cast<double>(static_cast<float>(x));
    }
    EXPECT_LT(worst_difference(rotation(rounded), rotation(m)), 1e-6);

    Matrix3 scaled = m, sheared = m, no_number = m, flat = m;
    for (auto& row : scaled) row[1] *= 1.001;
    for (auto& row : sheared) row[0] += 1e-3 * row[2];
    for (auto& row : flat) row[2] = 0;
    no_number[1][2] = std::numeric_limits<double>::quiet_NaN();
    for (const Matrix3& bad : {scaled, sheared, flat, no_number, Matrix3{}}) {
        EXPECT_FALSE(Rotation::from_matrix(bad));
    }
}

TEST(ShRotation, RebuiltTenThousandTimesKeepsItsNorm) {
    // One whole turn about a skew axis in steps, the matrix multiplied on and rebuilt every time.
    const Matrix3 tilt = about(0, 0.6) * about(1, 0.9), back = about(1, -0.9) * about(0, -0.6);
    constexpr int kSteps = 10000;
    const Matrix3 step = tilt * about(2, 2 * pi / kSteps) * back;
    const auto from = basis(random_directions(1)[0]);
    const double norm = kMaxBundleBands / std::sqrt(4 * pi);  // Unsoeld
    std::vector<double> to(from.size());
    Matrix3 m = kIdentity;
    double worst = 0;
    for (int i = 0; i < kSteps; ++i) {
        m = step * m;
        ASSERT_TRUE(rotation(m).apply(from, to));
        double sum = 0;
        for (const double c : to) sum += c * c;
        worst = std::max(worst, std::abs(std::sqrt(sum) / norm - 1));
    }
    EXPECT_LT(worst, 1e-14);
    // The matrix itself has drifted by 10,000 roundings; measured 7e-13.
    for (std::size_t i = 0; i < to.size(); ++i) EXPECT_NEAR(to[i], from[i], 2e-11);
}

TEST(ShRotation, FloatsAreRoundedOnce) {
    for (const Matrix3& m : all_turns()) {
        const Rotation r = rotation(m);
        for (const Vector& w : random_directions(5)) {
            std::vector<float> from;
            for (const double y : basis(w)) from.push_back(static_cast<float>(y));
            std::vector<double> exact(from.begin(), from.end());
            std::vector<float> to(from.size());
            ASSERT_TRUE(r.apply(from, to));
            ASSERT_TRUE(r.apply(exact, exact));
            for (std::size_t i = 0; i < to.size(); ++i) {
                EXPECT_EQ(to[i], static_cast<float>(exact[i]));
            }
        }
    }
}

TEST(ShRotation, ChannelsTurnTogetherAndInPlace) {
    const Rotation r = rotation(about(0, 1.0) * about(2, 0.5));
    const auto w = random_directions(3);
    for (const int bands : {1, 3, 10}) {
        const auto count = static_cast<std::size_t>(coeff_count(bands));
        std::vector<double> rgb(3 * count);
        for (std::size_t c = 0; c < 3; ++c) {
            const auto y = basis(w[c], bands);
            for (std::size_t i = 0; i < count; ++i) rgb[3 * i + c] = y[i];
        }
        ASSERT_TRUE(r.apply(rgb, rgb, 3));
        for (std::size_t c = 0; c < 3; ++c) {
            auto y = basis(w[c], bands);
            ASSERT_TRUE(r.apply(y, y));
            for (std::size_t i = 0; i < count; ++i) EXPECT_EQ(rgb[3 * i + c], y[i]);
        }
    }
}

TEST(ShRotation, ShapesThatDoNotFitAreRefusedUntouched) {
    const auto small = Rotation::from_matrix(about(0, 1), 3);
    ASSERT_TRUE(small);
    EXPECT_EQ(small->bands(), 3);
    std::vector<double> from(27, 1), to(27, 7);
    const auto refused = [&](std::size_t a, std::size_t b, int channels) {
        return !small->apply(std::span<const double>(from).first(a), std::span(to).first(b),
                             channels);
    };
    EXPECT_TRUE(refused(16, 16, 1));  // more bands than were built
    EXPECT_TRUE(refused(8, 8, 1));
    EXPECT_TRUE(refused(9, 4, 1));
    EXPECT_TRUE(refused(9, 9, 3));
    EXPECT_TRUE(refused(9, 9, 0));
    EXPECT_TRUE(refused(9, 9, -1));
    EXPECT_EQ(to, std::vector<double>(27, 7));
    EXPECT_FALSE(refused(0, 0, 3));  // no lighting turns into none
    EXPECT_FALSE(refused(27, 27, 3));
    // Built for fewer bands, the lower ones are the same.
    const Rotation whole = rotation(about(0, 1));
    EXPECT_EQ(small->element(2, 1, -2), whole.element(2, 1, -2));
}

}  // namespace
}  // namespace envbake::sh
