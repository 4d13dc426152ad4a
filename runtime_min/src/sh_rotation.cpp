// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/sh_rotation.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace envbake::sh {
namespace {

/// cofactor(M): M^-T times det M.
Matrix3 cofactors(const Matrix3& m) noexcept {
    Matrix3 c{};
    for (std::size_t i = 0; i < 3; ++i) {
        const std::size_t i1 = (i + 1) % 3, i2 = (i + 2) % 3;
        for (std::size_t j = 0; j < 3; ++j) {
            const std::size_t j1 = (j + 1) % 3, j2 = (j + 2) % 3;
            c[i][j] = m[i1][j1] * m[i2][j2] - m[i1][j2] * m[i2][j1];
        }
    }
    return c;
}

bool is_nearly_orthogonal(const Matrix3& m) noexcept {
    for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t j = 0; j < 3; ++j) {
            const double dot = m[0][i] * m[0][j] + m[1][i] * m[1][j] + m[2][i] * m[2][j];
            // Said this way round, NaN fails.
            if (!(std::abs(dot - (i == j ? 1 : 0)) <= Rotation::kTolerance)) return false;
        }
    }
    return true;
}

/// Newton's iteration for the polar factor, M <- (M + M^-T) / 2. The error is squared each time:
/// 1e-4, 1e-8, 1e-16. Leaves matrices of 0 and +-1, the identity and the quarter turns, as they
/// are.
Matrix3 nearest_orthogonal(Matrix3 m) noexcept {
    for (int step = 0; step < 3; ++step) {
        const Matrix3 c = cofactors(m);
        const double det = m[0][0] * c[0][0] + m[0][1] * c[0][1] + m[0][2] * c[0][2];
        for (std::size_t i = 0; i < 3; ++i) {
            for (std::size_t j = 0; j < 3; ++j) m[i][j] = (m[i][j] + c[i][j] / det) / 2;
        }
    }
    return m;
}

/// Side of the square n * n that makes up `size` with `channels`; -1 if there is none.
int bands_of(std::size_t size, int channels, int most) noexcept {
    for (int n = 0; n <= most; ++n) {
        if (channels > 0 &&
            size == static_cast<std::size_t>(n * n) * static_cast<std::size_t>(channels))
            return n;
    }
    return -1;
}

}  // namespace

Rotation::Rotation() noexcept {
    build({{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}, kMaxBundleBands);
}

std::optional<Rotation> Rotation::from_matrix(const Matrix3& matrix, int bands) noexcept {
    if (!is_nearly_orthogonal(matrix)) return std::nullopt;
    std::optional<Rotation> rotation(std::in_place);
    rotation->build(nearest_orthogonal(matrix), bands);
    return rotation;
}

std::optional<Rotation> Rotation::from_quaternion(const Quaternion& q, int bands) noexcept {
    const double largest = std::max({std::abs(q.x), std::abs(q.y), std::abs(q.z), std::abs(q.w)});
    if (!(largest >= 1e-100) || !std::isfinite(q.x + q.y + q.z + q.w)) return std::nullopt;
    const double x = q.x / largest, y = q.y / largest, z = q.z / largest, w = q.w / largest;
    const double s = 2 / (x * x + y * y + z * z + w * w);
    return from_matrix({{{1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)},
                         {s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)},
                         {s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)}}},
                       bands);
}

/// [Ivanic96] table 1 and 2 as [Ivanic98] corrects them, R^l from R^1 and R^(l-1):
///
///     R^l_mn = u U + v V + w W
///
/// with the paper's letters. It follows from Y_1 Y_(l-1) as a sum of Y_l and Y_(l-2), which turns
/// like its factors.
void Rotation::build(const Matrix3& orthogonal, int bands) noexcept {
    bands_ = std::clamp(bands, 1, kMaxBundleBands);
    elements_[slot(0, 0, 0)] = 1;
    if (bands_ == 1) return;
    constexpr std::size_t kAxis[] = {1, 2, 0};  // Y_1 = sqrt(3 / 4 pi) (y, z, x)
    for (int m = -1; m <= 1; ++m) {
        for (int n = -1; n <= 1; ++n) {
            elements_[slot(1, m, n)] = orthogonal[kAxis[m + 1]][kAxis[n + 1]];
        }
    }
    for (int l = 2; l < bands_; ++l) {
        for (int n = -l; n <= l; ++n) {
            const auto P = [&](int i, int m) {
                if (n == l) {
                    return element(1, i, 1) * element(l - 1, m, l - 1) -
                           element(1, i, -1) * element(l - 1, m, 1 - l);
                }
                if (n == -l) {
                    return element(1, i, 1) * element(l - 1, m, 1 - l) +
                           element(1, i, -1) * element(l - 1, m, l - 1);
                }
                return element(1, i, 0) * element(l - 1, m, n);
            };
            const double denominator =
                std::abs(n) == l ? 2.0 * l * (2 * l - 1) : 1.0 * (l + n) * (l - n);
            for (int m = -l; m <= l; ++m) {
                const int a = std::abs(m);
                double sum = 0;
                if (a < l) sum += std::sqrt((l + m) * (l - m) / denominator) * P(0, m);
                // v V. At |m| = 1 one of the two products is of m = 0, which weighs sqrt 2.
                const double v = std::sqrt((l + a - 1) * (l + a) / denominator) / 2;
                if (m == 0) {
                    sum -= std::numbers::sqrt2 * v * (P(1, 1) + P(-1, -1));
                } else if (a == 1) {
                    sum += std::numbers::sqrt2 * v * P(m, 0);
                } else if (m > 0) {
                    sum += v * (P(1, m - 1) - P(-1, 1 - m));
                } else {
                    sum += v * (P(1, m + 1) + P(-1, -m - 1));
                }
                if (m != 0 && a < l - 1) {
                    const double w = -std::sqrt((l - a - 1) * (l - a) / denominator) / 2;
                    sum += w * (m > 0 ? P(1, m + 1) + P(-1, -m - 1) : P(1, m - 1) - P(-1, 1 - m));
                }
                elements_[slot(l, m, n)] = sum;
            }
        }
    }
}

namespace {

template <class Real>
bool apply_to(const Rotation& rotation, std::span<const Real> from, std::span<Real> to,
              int channels) noexcept {
    const int bands = bands_of(from.size(), channels, rotation.bands());
    if (bands < 0 || from.size() != to.size()) return false;
    const auto at = [&](int l, int m, int channel) {
        return static_cast<std::size_t>(index(l, m) * channels + channel);
    };
    for (int l = 0; l < bands; ++l) {
        for (int channel = 0; channel < channels; ++channel) {
            std::array<double, 2 * kMaxBundleBands> band;  // so that `to` may be `from`
            for (int k = -l; k <= l; ++k) {
                band[static_cast<std::size_t>(k + l)] =
                    static_cast<double>(from[at(l, k, channel)]);
            }
            for (int m = -l; m <= l; ++m) {
                double sum = 0;
                for (int k = -l; k <= l; ++k) {
                    sum += rotation.element(l, m, k) * band[static_cast<std::size_t>(k + l)];
                }
                to[at(l, m, channel)] = static_cast<Real>(sum);
            }
        }
    }
    return true;
}

}  // namespace

bool Rotation::apply(std::span<const float> from, std::span<float> to,
                     int channels) const noexcept {
    return apply_to(*this, from, to, channels);
}

bool Rotation::apply(std::span<const double> from, std::span<double> to,
                     int channels) const noexcept {
    return apply_to(*this, from, to, channels);
}

}  // namespace envbake::sh
