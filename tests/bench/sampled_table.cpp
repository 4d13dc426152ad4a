// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/sampled_table.h"

#include "baker/core/parallel.h"
#include "envbake/runtime/brdf.h"
#include "tests/bench/hammersley.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace envbake::bench {
namespace {

/// cos(phi) and the first coordinate of every point: the same for all texels.
struct Point {
    float u, cos_phi;
};

Vec2 integrate(float n_dot_v, float alpha, const std::vector<Point>& points) {
    const float sin_v = std::sqrt(1 - n_dot_v * n_dot_v), a2 = alpha * alpha;
    double a = 0, b = 0;
    for (const Point& p : points) {
        const float cos2 = (1 - p.u) / (1 + (a2 - 1) * p.u);
        const float cos_h = std::sqrt(cos2), sin_h = std::sqrt(std::max(0.0f, 1 - cos2));
        const float v_dot_h = sin_v * sin_h * p.cos_phi + n_dot_v * cos_h;
        const float n_dot_l = 2 * v_dot_h * cos_h - n_dot_v;
        if (n_dot_l <= 0 || v_dot_h <= 0) continue;
        const float visible =
            4 * runtime::ggx_visibility(n_dot_l, n_dot_v, alpha) * n_dot_l * v_dot_h / cos_h;
        const float fresnel = runtime::schlick_weight(v_dot_h);
        a += static_cast<double>((1 - fresnel) * visible);
        b += static_cast<double>(fresnel * visible);
    }
    const auto count = static_cast<double>(points.size());
    return Vec2(DVec2(a, b) / count);
}

}  // namespace

std::vector<Vec2> sampled_table(int size, int sample_count) {
    std::vector<Point> points;
    for (int i = 0; i < sample_count; ++i) {
        const DVec2 u = hammersley(i, sample_count);
        points.push_back(
            {static_cast<float>(u.x), static_cast<float>(std::cos(2 * std::numbers::pi * u.y))});
    }
    const auto n = static_cast<std::size_t>(size);
    std::vector<Vec2> table(n * n);
    parallel_for(n, [&](std::size_t row) {
        const float r = (static_cast<float>(row) + 0.5f) / static_cast<float>(size);
        for (std::size_t column = 0; column < n; ++column) {
            const float n_dot_v = (static_cast<float>(column) + 0.5f) / static_cast<float>(size);
            table[row * n + column] = integrate(n_dot_v, r * r, points);
        }
    });
    return table;
}

}  // namespace envbake::bench
