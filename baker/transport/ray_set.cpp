// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/ray_set.h"

#include "envbake/runtime/sh.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <span>

namespace envbake {

namespace {

using std::numbers::pi;

constexpr int kPilotStride = 4;
constexpr double kSmallSet = 320;  ///< rays

/// Number k of the spiral, 0 <= k < count.
DVec3 fibonacci_cosine_direction(int k, int count) {
    const double golden_angle = pi * (3 - std::sqrt(5.0));
    const double r2 = (k + 0.5) / count;
    const double r = std::sqrt(r2), phi = golden_angle * k;
    return {r * std::cos(phi), r * std::sin(phi), std::sqrt(1 - r2)};
}

/// Halves the set across its longer side, in the plane of the disc, and the halves again: like a Z
/// curve, but with equal counts and no strips. Cuts fall between packets of 16 while there are any,
/// so that a packet is a patch. Against a Z curve: 3 to 4 % off the time of Embree.
void sort_into_patches(std::span<DVec3> directions) {
    const std::size_t count = directions.size();
    if (count < 2) return;
    DVec3 low = directions[0], high = directions[0];
    for (const DVec3& d : directions) {
        low = glm::min(low, d);
        high = glm::max(high, d);
    }
    const int axis = high.x - low.x >= high.y - low.y ? 0 : 1;
    const std::size_t half = count > 16 ? count / 32 * 16 : count / 2;
    std::nth_element(directions.begin(), directions.begin() + static_cast<std::ptrdiff_t>(half),
                     directions.end(),
                     [axis](const DVec3& a, const DVec3& b) { return a[axis] < b[axis]; });
    sort_into_patches(directions.first(half));
    sort_into_patches(directions.subspan(half));
}

std::vector<DVec3> ordered_directions(int count, int pilot_count) {
    const int quarter = (count + kPilotStride - 1) / kPilotStride;
    // Where the count is no multiple of four packets, the pilot leaves one out now and then.
    const auto is_pilot = [&](int k) {
        return k % kPilotStride == 0 && (k / kPilotStride + 1) * pilot_count / quarter !=
                                            k / kPilotStride * pilot_count / quarter;
    };
    std::vector<DVec3> directions;
    for (const bool pilot : {true, false})
        for (int k = 0; k < count; ++k)
            if (is_pilot(k) == pilot) directions.push_back(fibonacci_cosine_direction(k, count));
    const auto pilot = static_cast<std::size_t>(pilot_count);
    sort_into_patches(std::span(directions).first(pilot));
    sort_into_patches(std::span(directions).subspan(pilot));
    return directions;
}

/// Cholesky factor of a symmetric positive definite matrix, in its lower triangle, and solution.
class Cholesky {
  public:
    Cholesky(std::vector<double> matrix, std::size_t size) : l_(std::move(matrix)), size_(size) {
        for (std::size_t j = 0; j < size_; ++j) {
            for (std::size_t i = j; i < size_; ++i) {
                double sum = at(i, j);
                for (std::size_t k = 0; k < j; ++k) sum -= at(i, k) * at(j, k);
                at(i, j) = i == j ? std::sqrt(sum) : sum / at(j, j);
            }
        }
    }
    void solve(std::vector<double>& x) {
        for (std::size_t i = 0; i < size_; ++i) {
            for (std::size_t k = 0; k < i; ++k) x[i] -= at(i, k) * x[k];
            x[i] /= at(i, i);
        }
        for (std::size_t i = size_; i-- > 0;) {
            for (std::size_t k = i + 1; k < size_; ++k) x[i] -= at(k, i) * x[k];
            x[i] /= at(i, i);
        }
    }

  private:
    double& at(std::size_t row, std::size_t column) { return l_[row * size_ + column]; }
    std::vector<double> l_;
    std::size_t size_;
};

/// The weights nearest to 1 / N that integrate the cosine against every basis function exactly:
/// w = w_0 + B^T (B B^T)^-1 (target - B w_0), with B one row a coefficient.
///
/// Over a hemisphere the basis is nearly dependent, and with it B B^T nearly singular. A ridge of
/// 1e-13 of its trace keeps the factor real; what it leaves out, two rounds of refinement put in.
std::vector<double> exact_weights(const std::vector<DVec3>& directions, int bands) {
    const auto coeffs = static_cast<std::size_t>(sh::coeff_count(bands));
    const std::size_t count = directions.size();
    std::vector<double> basis(count * coeffs);  // one row a ray
    for (std::size_t k = 0; k < count; ++k)
        sh::evaluate(bands, directions[k].x, directions[k].y, directions[k].z, &basis[k * coeffs]);

    std::vector<double> gram(coeffs * coeffs, 0);
    for (std::size_t k = 0; k < count; ++k) {
        const double* row = &basis[k * coeffs];
        for (std::size_t i = 0; i < coeffs; ++i)
            for (std::size_t j = 0; j <= i; ++j) gram[i * coeffs + j] += row[i] * row[j];
    }
    double trace = 0;
    for (std::size_t i = 0; i < coeffs; ++i) trace += gram[i * coeffs + i];
    for (std::size_t i = 0; i < coeffs; ++i) gram[i * coeffs + i] += 1e-13 * trace;
    Cholesky factor(std::move(gram), coeffs);

    std::vector<double> weights(count, 1.0 / static_cast<double>(count));
    for (int round = 0; round < 3; ++round) {
        std::vector<double> missing(coeffs, 0);
        for (int l = 0; l < bands; ++l)
            missing[static_cast<std::size_t>(sh::index(l, 0))] =
                sh::clamped_cosine(l) / pi * std::sqrt((2 * l + 1) / (4 * pi));
        for (std::size_t k = 0; k < count; ++k)
            for (std::size_t i = 0; i < coeffs; ++i)
                missing[i] -= weights[k] * basis[k * coeffs + i];
        factor.solve(missing);
        for (std::size_t k = 0; k < count; ++k)
            for (std::size_t i = 0; i < coeffs; ++i)
                weights[k] += missing[i] * basis[k * coeffs + i];
    }
    return weights;
}

}  // namespace

RaySet make_ray_set(int ray_count, int bands, bool with_pilot) {
    double wanted = ray_count;
    for (;; wanted *= 1.25) {
        // A pilot of few rays cannot spare one.
        const int multiple = with_pilot && wanted <= kSmallSet ? 16 * kPilotStride : 16;
        const int count = std::max(1, static_cast<int>(std::ceil(wanted / multiple))) * multiple;
        if (count < sh::coeff_count(bands)) continue;
        const int pilot_count = with_pilot ? count / (16 * kPilotStride) * 16 : 0;
        const std::vector<DVec3> directions = ordered_directions(count, pilot_count);
        const std::vector<double> weights = exact_weights(directions, bands);
        const double smallest = *std::min_element(weights.begin(), weights.end());
        if (!(smallest >= 0)) continue;

        RaySet set;
        set.bands = bands;
        set.ray_count = count;
        set.pilot_packets = static_cast<std::size_t>(pilot_count / 16);
        set.smallest_relative_weight = smallest * count;
        set.directions.resize(directions.size() / 16);
        set.weights.resize(directions.size() / 16);
        for (std::size_t k = 0; k < directions.size(); ++k) {
            DirectionPacket& packet = set.directions[k / 16];
            packet.x[k % 16] = static_cast<float>(directions[k].x);
            packet.y[k % 16] = static_cast<float>(directions[k].y);
            packet.z[k % 16] = static_cast<float>(directions[k].z);
            set.weights[k / 16][k % 16] = static_cast<float>(weights[k]);
        }
        return set;
    }
}

}  // namespace envbake
