// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/sampled_transport.h"

#include "envbake/runtime/sh.h"

#include <cmath>
#include <numbers>
#include <random>

namespace envbake::bench {

std::vector<float> sampled_transport(Samples samples, int grid, int bands, const RayOrigin& origin,
                                     const Tracer& tracer, std::uint64_t seed) {
    std::minstd_rand random(static_cast<std::minstd_rand::result_type>(seed + 1));
    std::uniform_real_distribution<float> uniform;
    const auto coeffs = static_cast<std::size_t>(sh::coeff_count(bands));
    std::vector<float> basis(coeffs);
    std::vector<double> sum(coeffs, 0);
    const auto n = Vec3(origin.normal);
    for (int i = 0; i < grid; ++i) {
        for (int j = 0; j < grid; ++j) {
            const float u = uniform(random), v = uniform(random);
            const bool jittered = samples == Samples::Jittered;
            const auto edge = static_cast<float>(grid);
            const float z = 1 - 2 * (jittered ? (static_cast<float>(i) + u) / edge : u);
            const float phi =
                2 * std::numbers::pi_v<float> * (jittered ? (static_cast<float>(j) + v) / edge : v);
            const float r = std::sqrt(std::max(0.0f, 1 - z * z));
            const Vec3 w(r * std::cos(phi), r * std::sin(phi), z);
            const float cosine = glm::dot(w, n);
            if (cosine <= 0 || tracer.occluded(origin.position, w)) continue;
            sh::evaluate(bands, w.x, w.y, w.z, basis.data());
            for (std::size_t c = 0; c < coeffs; ++c)
                sum[c] += static_cast<double>(cosine * basis[c]);
        }
    }
    std::vector<float> row(coeffs);
    for (std::size_t c = 0; c < coeffs; ++c)  // 1/pi, and 4 pi of sphere for all the samples
        row[c] = static_cast<float>(4 * sum[c] / grid / grid);
    return row;
}

}  // namespace envbake::bench
