// SPDX-License-Identifier: Apache-2.0
#include "baker/brdf/table.h"

#include "baker/brdf/albedo_integral.h"
#include "baker/core/parallel.h"
#include "baker/core/random.h"
#include "baker/math/quadrature.h"
#include "envbake/runtime/half.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace envbake {
namespace {

using runtime::TableAxis;

/// Rounds to float and keeps A + B <= 1, which the rule's error of 1e-7 may miss.
Vec2 to_texel(DVec2 value) {
    const float a = static_cast<float>(std::clamp(value.x, 0.0, 1.0));
    const double rest = 1 - static_cast<double>(a);
    float b = static_cast<float>(std::clamp(value.y, 0.0, rest));
    if (static_cast<double>(b) > rest) b = std::nextafter(b, 0.0f);
    return {a, b};
}

double worse(DVec2 a, DVec2 b) {
    return std::max(std::abs(a.x - b.x), std::abs(a.y - b.y));
}

/// Texel coordinates to (n.v, r): the places of texels at whole numbers.
DVec2 point_at(const BrdfTableJob& job, double column, double row) {
    return {runtime::table_value<double>(job.axes, TableAxis::NDotV, column, job.size),
            runtime::table_value<double>(job.axes, TableAxis::Roughness, row, job.size)};
}

/// E_avg of every row. n.v = x^2 makes the integrand 4 x^3 E(x^2), smooth at 0: 18 nodes leave
/// 3e-7 of either lobe at any roughness, 16 leave 9e-7 (measured against 100).
std::vector<float> average_albedos(const BrdfTableJob& job) {
    const Quadrature rule = gauss_legendre(18);
    std::vector<DVec2> points;
    for (int row = 0; row < job.size; ++row) {
        for (const double node : rule.nodes) {
            const double x = (1 + node) / 2;
            points.emplace_back(x * x, point_at(job, 0, row).y);
        }
    }
    const std::vector<DVec2> values = albedo_integrals(job.distribution, points);
    std::vector<float> averages;
    std::size_t at = 0;
    for (int row = 0; row < job.size; ++row) {
        double sum = 0;
        for (std::size_t i = 0; i < rule.nodes.size(); ++i, ++at) {
            const double x = (1 + rule.nodes[i]) / 2;
            sum += rule.weights[i] / 2 * 4 * x * x * x * (values[at].x + values[at].y);
        }
        averages.push_back(static_cast<float>(std::min(sum, 1.0)));
    }
    return averages;
}

DVec2 look_up(const BrdfTable& table, runtime::TableAxes axes, DVec2 point) {
    const auto locate = [&](TableAxis axis, double value) {
        const double position = runtime::table_position(axes, axis, value, table.size);
        const int index = std::min(static_cast<int>(position), table.size - 2);
        return std::pair(static_cast<std::size_t>(index), position - index);
    };
    const auto [column, x] = locate(TableAxis::NDotV, point.x);
    const auto [row, y] = locate(TableAxis::Roughness, point.y);
    const std::size_t first = row * static_cast<std::size_t>(table.size) + column;
    const std::size_t second = first + static_cast<std::size_t>(table.size);
    const DVec2 low = glm::mix(DVec2(table.texels[first]), DVec2(table.texels[first + 1]), x);
    const DVec2 high = glm::mix(DVec2(table.texels[second]), DVec2(table.texels[second + 1]), x);
    return glm::mix(low, high, y);
}

void measure_texels(const BrdfTableJob& job, BrdfTable& table) {
    // Half of the sample favours the texels that are hardest, those of small n.v and roughness.
    constexpr std::size_t kSamples = 32;
    std::vector<DVec2> points, stored;
    RandomStream random(0, 0, 0);
    for (std::size_t i = 0; i < kSamples; ++i) {
        double x = random.next(), y = random.next();
        if (i % 2 == 0) {
            x = x * x * x;
            y = y * y;
        }
        const int column = std::min(static_cast<int>(x * job.size), job.size - 1);
        const int row = std::min(static_cast<int>(y * job.size), job.size - 1);
        points.push_back(point_at(job, column, row));
        stored.emplace_back(table.texels[static_cast<std::size_t>(row * job.size + column)]);
    }
    // The reference's own error is a twentieth of the float rule's.
    const std::vector<DVec2> truth = exact_albedo_integrals(job.distribution, points, 32);
    for (std::size_t i = 0; i < kSamples; ++i) {
        table.texel_error = std::max(table.texel_error, worse(truth[i], stored[i]));
    }
}

void measure_look_up(const BrdfTableJob& job, BrdfTable& table) {
    constexpr std::size_t kRandom = 1024;
    std::vector<DVec2> points;
    RandomStream random(0, 1, 0);
    for (std::size_t i = 0; i < kRandom; ++i) {
        const double n_dot_v = random.next();
        points.emplace_back(n_dot_v, random.next());
    }
    // A look-up is worst in the middle of cells, and at the least roughness: over 9 points in every
    // cell of 128 x 128 nothing exceeded the middles of the first rows (measured). n.v = 0 is worst
    // where texels lie at centres.
    std::vector<double> rows;
    const int first = static_cast<int>(
        runtime::table_position(job.axes, TableAxis::Roughness, kSharpestRoughness, job.size));
    for (int i = 0; i < 4; ++i) {
        rows.push_back(point_at(job, 0, std::min(i, job.size - 2) + 0.5).y);
        rows.push_back(point_at(job, 0, std::min(first + i, job.size - 2) + 0.5).y);
    }
    rows.push_back(kSharpestRoughness);
    for (const double r : rows) {
        points.emplace_back(0, r);
        for (int column = 0; column + 1 < job.size; ++column) {
            points.emplace_back(point_at(job, column + 0.5, 0).x, r);
        }
    }
    const std::vector<DVec2> truth = albedo_integrals(job.distribution, points);
    double square_sum = 0;
    std::size_t count = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const double error = worse(look_up(table, job.axes, points[i]), truth[i]);
        if (points[i].y < kSharpestRoughness) {
            table.sharp_lookup_error = std::max(table.sharp_lookup_error, error);
            continue;
        }
        table.lookup_error = std::max(table.lookup_error, error);
        if (i >= kRandom) continue;
        square_sum += error * error;
        ++count;
    }
    table.lookup_error_rms = std::sqrt(square_sum / static_cast<double>(count));
}

}  // namespace

BrdfTable bake_brdf_table(const BrdfTableJob& job) {
    std::vector<DVec2> points;
    for (int row = 0; row < job.size; ++row) {
        for (int column = 0; column < job.size; ++column) {
            points.push_back(point_at(job, column, row));
        }
    }
    BrdfTable table;
    table.size = job.size;
    for (const DVec2& value : albedo_integrals(job.distribution, points)) {
        table.texels.push_back(to_texel(value));
    }
    table.average_albedo = average_albedos(job);
    measure_texels(job, table);
    measure_look_up(job, table);
    return table;
}

std::vector<std::uint16_t> half_texels(const BrdfTable& table) {
    std::vector<std::uint16_t> halves;
    halves.reserve(2 * table.texels.size());
    for (const Vec2& texel : table.texels) {
        const std::uint16_t a = runtime::float_to_half(texel.x);
        std::uint16_t b = runtime::float_to_half(texel.y);
        // Halves of the same sign are ordered like their bits.
        const auto value = [](std::uint16_t half) {
            return static_cast<double>(runtime::half_to_float(half));
        };
        while (value(a) + value(b) > 1) --b;
        halves.push_back(a);
        halves.push_back(b);
    }
    return halves;
}

}  // namespace envbake
