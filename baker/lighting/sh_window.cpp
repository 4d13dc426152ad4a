// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/sh_window.h"

#include "baker/core/parallel.h"
#include "envbake/runtime/cube.h"
#include "envbake/runtime/sh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>

namespace envbake {
namespace {

std::size_t index(int i) {
    return static_cast<std::size_t>(i);
}

std::vector<double> window_factors(int bands, double lambda) {
    std::vector<double> factors;
    for (int l = 0; l < bands; ++l) {
        factors.push_back(1 / (1 + lambda * std::pow(l * (l + 1.0), 2)));
    }
    return factors;
}

/// The irradiance of every band, E_l(n), over a grid of directions: three faces of a cube, for
/// E_l(-n) = (-1)^l E_l(n). Bands that irradiance does not have (odd, above 1) are left out.
class BandIrradiance {
  public:
    explicit BandIrradiance(const ShLighting& irradiance) {
        for (int l = 0; l < irradiance.bands; ++l) {
            if (sh::clamped_cosine(l) != 0) degrees_.push_back(l);
        }
        values_.resize(index(3 * kFaceSize * kFaceSize) * degrees_.size());
        constexpr std::array kFaces{cube::Face::PositiveX, cube::Face::PositiveY,
                                    cube::Face::PositiveZ};
        parallel_for(index(3 * kFaceSize), [&](std::size_t line) {
            const auto face = kFaces[line / kFaceSize];
            std::array<double, sh::coeff_count(sh::kMaxBundleBands)> y;
            DVec3* to = values_.data() + line * kFaceSize * degrees_.size();
            for (int column = 0; column < kFaceSize; ++column) {
                const auto w = cube::texel_direction<double>(
                    face, static_cast<int>(line % kFaceSize), column, kFaceSize);
                sh::evaluate(irradiance.bands, w[0], w[1], w[2], y.data());
                for (const int l : degrees_) {
                    DVec3 sum(0);
                    for (int m = -l; m <= l; ++m) {
                        const std::size_t k = index(sh::index(l, m));
                        sum += y[k] * irradiance.coeffs[k];
                    }
                    *to++ = sum;
                }
            }
        });
        for (std::size_t b = 0; b < degrees_.size(); ++b) {
            DVec3 largest(0);
            for (std::size_t i = b; i < values_.size(); i += degrees_.size()) {
                for (int c = 0; c < 3; ++c)
                    largest[c] = std::max(largest[c], std::abs(values_[i][c]));
            }
            // Between the points, again by Bernstein.
            const double rise = kRadius * kRadius / 2 * degrees_[b] * degrees_[b];
            largest_.push_back(largest / (1 - rise));
        }
    }

    struct Range {
        DVec3 low{std::numeric_limits<double>::max()};
        DVec3 high{std::numeric_limits<double>::lowest()};
    };
    /// Over the grid, under a window.
    Range range(const std::vector<double>& factors) const {
        Range range;
        for (std::size_t i = 0; i < values_.size(); i += degrees_.size()) {
            DVec3 even(0), odd(0);
            for (std::size_t b = 0; b < degrees_.size(); ++b) {
                const int l = degrees_[b];
                (l % 2 == 0 ? even : odd) += factors[index(l)] * values_[i + b];
            }
            for (int c = 0; c < 3; ++c) {
                const double spread = std::abs(odd[c]);
                range.low[c] = std::min(range.low[c], even[c] - spread);
                range.high[c] = std::max(range.high[c], even[c] + spread);
            }
        }
        return range;
    }

    /// True only where E >= 0 everywhere.
    bool is_nonnegative(const std::vector<double>& factors) const {
        DVec3 curvature(0);
        for (std::size_t b = 0; b < degrees_.size(); ++b) {
            const int l = degrees_[b];
            curvature += factors[index(l)] * l * l * largest_[b];
        }
        const DVec3 low = range(factors).low - kRadius * kRadius / 2 * curvature;
        return low.x >= 0 && low.y >= 0 && low.z >= 0;
    }

  private:
    static constexpr int kFaceSize = 160;
    /// No direction is further from the grid: half the diagonal of the texel in a face's middle.
    static constexpr double kRadius = std::numbers::sqrt2 / kFaceSize;

    std::vector<int> degrees_;
    std::vector<DVec3> values_;   ///< [direction][degree]
    std::vector<DVec3> largest_;  ///< max |E_l|, by degree
};

double norm(const std::vector<DVec3>& coeffs, int channel) {
    double sum = 0;
    for (const DVec3& c : coeffs) sum += c[channel] * c[channel];
    return std::sqrt(sum);
}

}  // namespace

ShLighting windowed(const ShLighting& lighting, const ShWindow& window) {
    ShLighting result = lighting;
    for (int l = 0; l < lighting.bands; ++l) {
        for (int m = -l; m <= l; ++m) {
            result.coeffs[index(sh::index(l, m))] *= window.factors[index(l)];
        }
    }
    return result;
}

ShWindow nonnegative_window(const ShLighting& lighting) {
    const int bands = lighting.bands;
    ShLighting irradiance = to_irradiance(lighting);
    // In units of the mean, so that no square overflows; a black channel stays 0.
    for (int c = 0; c < 3; ++c) {
        const double mean = irradiance.coeffs[0][c];
        for (DVec3& coeff : irradiance.coeffs) coeff[c] = mean > 0 ? coeff[c] / mean : 0;
    }
    const BandIrradiance by_band(irradiance);

    ShWindow window{.lambda = 0, .factors = window_factors(bands, 0)};
    if (by_band.is_nonnegative(window.factors)) return window;
    double too_small = 0, enough = 1;
    while (!by_band.is_nonnegative(window_factors(bands, enough))) too_small = enough, enough *= 2;
    for (int step = 0; step < 40 && enough - too_small > 1e-6 * enough; ++step) {
        const double middle = (too_small + enough) / 2;
        (by_band.is_nonnegative(window_factors(bands, middle)) ? enough : too_small) = middle;
    }
    const auto before = by_band.range(window.factors);
    window.lambda = enough;
    window.factors = window_factors(bands, enough);
    const auto after = by_band.range(window.factors);

    std::vector<DVec3> lost = windowed(irradiance, window).coeffs;
    for (std::size_t i = 0; i < lost.size(); ++i) lost[i] -= irradiance.coeffs[i];
    for (int c = 0; c < 3; ++c) {
        if (!(irradiance.coeffs[0][c] > 0)) continue;
        window.rms_loss = std::max(window.rms_loss, norm(lost, c) / norm(irradiance.coeffs, c));
        window.peak_kept = std::min(window.peak_kept, after.high[c] / before.high[c]);
    }
    return window;
}

}  // namespace envbake
