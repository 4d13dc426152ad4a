// SPDX-License-Identifier: Apache-2.0
#include "baker/brdf/albedo_integral.h"
#include "baker/brdf/table.h"
#include "baker/math/quadrature.h"
#include "envbake/runtime/multiple_scattering.h"
#include "envbake/runtime/shade.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

namespace envbake {
namespace {

using runtime::Distribution;

constexpr std::array kRoughness{0.0, 1e-3, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0};
constexpr std::array kNDotV{0.0, 1e-3, 0.05, 0.3, 0.7, 1.0};
constexpr std::array kR0{0.0, 0.04, 0.5, 0.9, 1.0};

class WhiteFurnace : public testing::TestWithParam<Distribution> {};
INSTANTIATE_TEST_SUITE_P(Distributions, WhiteFurnace,
                         testing::Values(Distribution::Ggx, Distribution::Beckmann));

/// Nodes over n.v = x^2 and weights that make a mean over the hemisphere, 2 n.v d(n.v).
struct Hemisphere {
    std::vector<double> n_dot_l, weights;
    Hemisphere() {
        const Quadrature rule = gauss_legendre(32);
        for (std::size_t i = 0; i < rule.nodes.size(); ++i) {
            const double x = (1 + rule.nodes[i]) / 2;
            n_dot_l.push_back(x * x);
            weights.push_back(rule.weights[i] / 2 * 4 * x * x * x);
        }
    }
};

// With the exact albedo, at every roughness: white reflects all, nothing reflects more.
TEST_P(WhiteFurnace, OfTheExactAlbedo) {
    const Hemisphere hemisphere;
    for (const double r : kRoughness) {
        std::vector<DVec2> points;
        for (const double c : hemisphere.n_dot_l) points.emplace_back(c, r);
        for (const double c : kNDotV) points.emplace_back(c, r);
        const std::vector<DVec2> values = exact_albedo_integrals(GetParam(), points, 32);
        const std::size_t count = hemisphere.n_dot_l.size();
        double average = 0;
        for (std::size_t i = 0; i < count; ++i) {
            average += hemisphere.weights[i] * (values[i].x + values[i].y);
        }
        average = std::min(average, 1.0);
        for (std::size_t v = 0; v < kNDotV.size(); ++v) {
            const auto [a, b] = std::pair(values[count + v].x, values[count + v].y);
            const double albedo = a + b;
            // The lobe itself, light by light.
            double returned = 0;
            for (std::size_t i = 0; i < count; ++i) {
                returned +=
                    hemisphere.weights[i] * std::numbers::pi *
                    runtime::multiple_scattering_lobe(values[i].x + values[i].y, albedo, average);
            }
            for (const double r0 : kR0) {
                const double lobe = runtime::multiple_scattering_fresnel(r0, average) * returned;
                const double scaled = (r0 * a + b) * runtime::multiple_scattering_scale(r0, albedo);
                const auto weights = runtime::environment_weights(r0, a, b);
                const std::array reflected{r0 * a + b + lobe, scaled,
                                           weights.single + weights.multiple};
                for (const double whole : reflected) {
                    EXPECT_LE(whole, 1 + 1e-6) << r << ' ' << kNDotV[v] << ' ' << r0;
                    EXPECT_GE(whole, r0 * a + b - 1e-12);
                    if (r0 < 1) continue;
                    EXPECT_NEAR(whole, 1, 1e-6) << r << ' ' << kNDotV[v];
                }
            }
        }
    }
}

// Through the table, as a renderer does it.
TEST_P(WhiteFurnace, OfTheLookedUpAlbedo) {
    constexpr int kSize = 128;
    const BrdfTable table = bake_brdf_table({.size = kSize, .distribution = GetParam()});
    runtime::BrdfTableView view;
    view.rows = view.columns = kSize;
    view.axes = runtime::TableAxes::RootsEndPoints;
    view.texels = {&table.texels[0].x, 2 * table.texels.size(), false};
    view.average_albedo = {table.average_albedo.data(), table.average_albedo.size(), false};

    const Hemisphere hemisphere;
    for (const double roughness : kRoughness) {
        const auto r = static_cast<float>(roughness);
        const float average = runtime::lookup_average_albedo(view, r);
        EXPECT_LE(average, 1);
        const auto albedo = [&](double c) {
            const runtime::SpecularAlbedo e = runtime::lookup_brdf(view, static_cast<float>(c), r);
            return e.a + e.b;
        };
        for (const double c : kNDotV) {
            const runtime::SpecularAlbedo e = runtime::lookup_brdf(view, static_cast<float>(c), r);
            const float whole = e.a + e.b;
            EXPECT_LE(whole, 1 + 1e-6f);
            // These two take E as it comes: exact whatever its error.
            EXPECT_NEAR(whole * runtime::multiple_scattering_scale(1.0f, whole), 1, 1e-6);
            const auto weights = runtime::environment_weights(1.0f, e.a, e.b);
            EXPECT_NEAR(weights.single + weights.multiple, 1, 1e-6);
            // This one asks that E and its average agree.
            double returned = 0;
            for (std::size_t i = 0; i < hemisphere.n_dot_l.size(); ++i) {
                returned += hemisphere.weights[i] * std::numbers::pi *
                            static_cast<double>(runtime::multiple_scattering_lobe(
                                albedo(hemisphere.n_dot_l[i]), whole, average));
            }
            returned *= static_cast<double>(runtime::multiple_scattering_fresnel(1.0f, average));
            EXPECT_NEAR(static_cast<double>(whole) + returned, 1, 1e-3) << r << ' ' << c;
        }
    }
}

}  // namespace
}  // namespace envbake
