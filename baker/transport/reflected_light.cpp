// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/reflected_light.h"

#include "envbake/runtime/sh.h"

#include <algorithm>
#include <cmath>

namespace envbake {

namespace {

/// Symmetric positive definite, the lower triangle row by row: Cholesky's factor in its place.
void factorize(std::vector<double>& a, std::size_t size) {
    const auto at = [&](std::size_t i, std::size_t k) -> double& { return a[i * (i + 1) / 2 + k]; };
    for (std::size_t j = 0; j < size; ++j) {
        for (std::size_t i = j; i < size; ++i) {
            double sum = at(i, j);
            for (std::size_t k = 0; k < j; ++k) sum -= at(i, k) * at(j, k);
            at(i, j) = i == j ? std::sqrt(sum) : sum / at(j, j);
        }
    }
}

/// x of (factor factor^T) x = x, for every column of x, [size, columns].
void solve(const std::vector<double>& factor, std::size_t size, std::vector<float>& x) {
    const std::size_t columns = x.size() / size;
    const auto at = [&](std::size_t i, std::size_t k) {
        return static_cast<float>(factor[i * (i + 1) / 2 + k]);
    };
    const auto subtract = [&](std::size_t to, float scale, std::size_t from) {
        for (std::size_t c = 0; c < columns; ++c)
            x[to * columns + c] -= scale * x[from * columns + c];
    };
    const auto divide = [&](std::size_t row) {
        for (std::size_t c = 0; c < columns; ++c) x[row * columns + c] /= at(row, row);
    };
    for (std::size_t i = 0; i < size; ++i) {
        for (std::size_t k = 0; k < i; ++k) subtract(i, at(i, k), k);
        divide(i);
    }
    for (std::size_t i = size; i-- > 0;) {
        for (std::size_t k = i + 1; k < size; ++k) subtract(i, at(k, i), k);
        divide(i);
    }
}

}  // namespace

ReflectedLight::ReflectedLight(const Job& job, const SeenSurfaces& seen, std::size_t row,
                               const Frame& frame)
    : share_(seen.share(row)),
      functions_(static_cast<std::size_t>(sh::coeff_count(job.bands))),
      columns_(job.columns),
      products_(functions_ * (functions_ + 1) / 2),
      first_(columns_),
      beyond_first_(functions_ * columns_) {
    const auto channels = static_cast<std::size_t>(job.channels);
    std::vector<double> basis(functions_);
    std::vector<float> light(columns_);
    seen.for_each_point(row, [&](const SeenSurfaces::SeenPoint& point) {
        const DVec3 w = frame.to_world(DVec3(point.direction));
        sh::evaluate(job.bands, w.x, w.y, w.z, basis.data());
        double* product = products_.data();
        for (std::size_t q = 0; q < functions_; ++q)
            for (std::size_t k = 0; k <= q; ++k) *product++ += basis[q] * basis[k];

        if (point.corners == nullptr) {
            std::fill(light.begin(), light.end(), 0.0f);  // black
        } else {
            const float* corner[3];
            for (std::size_t k = 0; k < 3; ++k) corner[k] = job.row_of((*point.corners)[k]);
            const Vec3& weight = point.weights;
            for (std::size_t i = 0; i < columns_; ++i)
                light[i] =
                    weight.x * corner[0][i] + weight.y * corner[1][i] + weight.z * corner[2][i];
            for (std::size_t i = 0; i < columns_; ++i)
                light[i] *= point.albedo[static_cast<int>(i % channels)];
        }
        if (count_ == 0) first_ = light;
        count_ += 1;
        for (std::size_t i = 0; i < columns_; ++i) light[i] -= first_[i];
        for (std::size_t q = 0; q < functions_; ++q) {
            const auto y = static_cast<float>(basis[q]);
            for (std::size_t i = 0; i < columns_; ++i)
                beyond_first_[q * columns_ + i] += y * light[i];
        }
    });
}

std::vector<float> ReflectedLight::variation(int bands) const {
    const auto size = static_cast<std::size_t>(sh::coeff_count(bands)) - 1;
    std::vector<float> r(size * columns_, 0.0f);
    if (count_ == 0 || size == 0) return r;
    // Centred sums; that of Y_q is one of Y_q Y_0.
    std::vector<double> covariance;
    for (std::size_t q = 1; q <= size; ++q) {
        const double mean = basis_product(q, 0) / (kY0 * count_);
        for (std::size_t k = 1; k <= q; ++k)
            covariance.push_back(basis_product(q, k) - mean * basis_product(k, 0) / kY0);
        covariance.back() += kY0 * kY0;  // the mean square of Y_q over the sphere
        for (std::size_t i = 0; i < columns_; ++i)
            r[(q - 1) * columns_ + i] =
                beyond_first_[q * columns_ + i] - static_cast<float>(mean / kY0) * beyond_first_[i];
    }
    factorize(covariance, size);
    solve(covariance, size, r);
    return r;
}

std::vector<double> ReflectedLight::met() const {
    std::vector<double> met(functions_ * columns_, 0.0);
    for (std::size_t k = 0; k < functions_ && count_ > 0; ++k)
        for (std::size_t i = 0; i < columns_; ++i)
            met[k * columns_ + i] = share_ * light(k, i) / count_;
    return met;
}

std::vector<double> ReflectedLight::met(const ReflectedLight& other, int bands) const {
    std::vector<double> met(functions_ * columns_, 0.0);
    if (count_ == 0 || other.count_ == 0) return met;
    const std::vector<float> r = other.variation(bands);
    const std::size_t size = r.size() / columns_;
    for (std::size_t k = 0; k < functions_; ++k) {
        const double of_mean = share_ * basis_product(k, 0) / (kY0 * count_);
        for (std::size_t i = 0; i < columns_; ++i)
            met[k * columns_ + i] = of_mean * other.light(0, i) / (kY0 * other.count_);
        for (std::size_t q = 1; q <= size; ++q) {
            const double of_q = share_ * basis_product(q, k) / count_ -
                                basis_product(q, 0) / (kY0 * count_) * of_mean;
            for (std::size_t i = 0; i < columns_; ++i)
                met[k * columns_ + i] += of_q * static_cast<double>(r[(q - 1) * columns_ + i]);
        }
    }
    return met;
}

}  // namespace envbake
