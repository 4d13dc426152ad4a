// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/glossy.h"

#include "envbake/runtime/sh.h"
#include "envbake/runtime/sh_rotation.h"
#include "tests/unit/runtime/bundle_builder.h"
#include "tests/unit/runtime/vector_code_test.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

namespace envbake::runtime {
namespace {

using std::numbers::pi;

const GlossyMatrices& expander() {
    static const GlossyMatrices once;
    return once;
}

/// A lobe and one vertex in memory of their own.
struct Content {
    int exit_bands = 5, light_bands = 5, rows = 1;
    std::vector<float> unoccluded, kernel, visibility, normal{0, 0, 1};

    Content(int exit, int light, int row_count = 1)
        : exit_bands(exit),
          light_bands(light),
          rows(row_count),
          unoccluded(static_cast<std::size_t>(2 * row_count) * lobe_size(exit, light), 0),
          kernel(static_cast<std::size_t>(2 * row_count) * lobe_size(exit, kLobeBands), 0) {
        see_everything();
    }
    int visibility_bands() const { return light_bands + kExtraVisibilityBands; }

    /// 1/pi of the clamped cosine's coefficients, turned to the normal.
    void see_everything() {
        visibility.resize(static_cast<std::size_t>(sh::coeff_count(visibility_bands())));
        std::vector<double> basis(visibility.size());
        sh::evaluate(visibility_bands(), double{normal[0]}, double{normal[1]}, double{normal[2]},
                     basis.data());
        for (int l = 0; l < visibility_bands(); ++l)
            for (int m = -l; m <= l; ++m) {
                const auto i = static_cast<std::size_t>(sh::index(l, m));
                visibility[i] = static_cast<float>(basis[i] * sh::clamped_cosine(l) / pi);
            }
    }
    void randomise(unsigned seed) {
        std::mt19937 random(seed);
        std::normal_distribution<float> gauss;
        for (std::vector<float>* list : {&unoccluded, &kernel, &normal})
            for (float& x : *list) x = gauss(random);
        const float length =
            std::sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
        for (float& x : normal) x /= length;
        see_everything();
        for (float& x : visibility) x += 0.1f * gauss(random);
    }
    LobeView lobe() const {
        return {rows,
                exit_bands,
                light_bands,
                0.25f,
                rows > 1 ? 0.75f : 0.25f,
                {unoccluded.data(), unoccluded.size()},
                {kernel.data(), kernel.size()}};
    }
    GlossyView transport() const {
        return {
            1, light_bands, {visibility.data(), visibility.size()}, {normal.data(), normal.size()}};
    }
    Mesh mesh() const {
        Mesh mesh;
        mesh.vertex_count = 1;
        mesh.glossy = transport();
        return mesh;
    }
    /// [exit][light][a, b]
    std::vector<float> matrices(float roughness = 0.25f) const {
        std::vector<float> t(static_cast<std::size_t>(2 * sh::coeff_count(exit_bands) *
                                                      sh::coeff_count(light_bands)));
        EXPECT_TRUE(expander().expand(lobe(), transport(), 0, roughness, t));
        return t;
    }
};

std::vector<float> random_light(int bands, unsigned seed) {
    std::mt19937 random(seed);
    std::normal_distribution<float> gauss;
    std::vector<float> light(static_cast<std::size_t>(3 * sh::coeff_count(bands)));
    for (float& x : light) x = gauss(random);
    return light;
}

/// Integrals of three basis functions about +Z: where only Y_m is blocked and the kernel takes k to
/// the exit's constant alone, t is one of them.
double gaunt(int i, int k_degree, int k_order, int m) {
    Content c(5, 5);
    c.kernel[lobe_slot(5, kLobeBands, std::abs(k_order), std::abs(k_order), k_degree)] = 1;
    c.visibility[static_cast<std::size_t>(m)] -= 1;
    const std::vector<float> t = c.matrices();
    const auto exit = static_cast<std::size_t>(sh::index(std::abs(k_order), k_order));
    return -double{t[(exit * 25 + static_cast<std::size_t>(i)) * 2]};
}

class Glossy : public VectorCodeTest {};

TEST_F(Glossy, GauntIntegrals) {
    const int z = sh::index(1, 0), x = sh::index(1, 1), y = sh::index(1, -1);
    EXPECT_NEAR(gaunt(z, 1, 0, 0), 1 / (2 * std::sqrt(pi)), 1e-6);
    EXPECT_NEAR(gaunt(z, 1, 0, sh::index(2, 0)), 1 / std::sqrt(5 * pi), 1e-6);
    EXPECT_NEAR(gaunt(x, 1, -1, sh::index(2, -2)), std::sqrt(3 / (20 * pi)), 1e-6);
    EXPECT_NEAR(gaunt(y, 1, 1, sh::index(2, -2)), std::sqrt(3 / (20 * pi)), 1e-6);
    EXPECT_NEAR(gaunt(x, 1, 0, sh::index(2, 0)), 0, 1e-6);
    // The last of every sum: degrees 4, 6 and 10.
    EXPECT_GT(std::abs(gaunt(sh::index(4, 0), 6, 0, sh::index(10, 0))), 0.1);
}

/// Of a hemisphere, weighted by its cosine: integral of z Y_i Y_k over z > 0 by antiderivatives.
TEST_F(Glossy, MatrixOfTheVisibleHemisphere) {
    Content c(5, 5);
    std::fill(c.visibility.begin(), c.visibility.end(), 0.0f);  // all of it is blocked
    for (int k = 0; k < 2; ++k) c.kernel[lobe_slot(5, kLobeBands, 0, 0, k)] = 1;
    const std::vector<float> t = c.matrices();
    const auto at = [&](int i) { return -double{t[static_cast<std::size_t>(2 * i)]} * pi; };
    const double c00 = 1 / (4 * pi), c01 = std::sqrt(3.0) / (4 * pi), c11 = 3 / (4 * pi);
    // k sums Y_00 and Y_10; over the half-sphere z, z^2 and z^3 integrate to pi, 2 pi/3 and pi/2.
    EXPECT_NEAR(at(0), c00 * pi + c01 * 2 * pi / 3, 1e-5);
    EXPECT_NEAR(at(sh::index(1, 0)), c01 * 2 * pi / 3 + c11 * pi / 2, 1e-5);
}

TEST_F(Glossy, ReflectedLightIsTheMatricesTimesIt) {
    for (const auto& [exit, light] : {std::pair{5, 5}, {3, 5}, {5, 3}, {4, 4}, {1, 1}}) {
        Content c(exit, light);
        c.randomise(static_cast<unsigned>(10 * exit + light));
        const std::vector<float> coeffs = random_light(light, 7);
        const GlossyLight lighting({light, coeffs}, light);
        const Rgb r0{0.9f, 0.5f, 0.04f};
        const GlossyExit out = reflect(c.lobe(), lighting.transfer(c.mesh(), 0), 0.25f, r0);
        ASSERT_EQ(out.bands, exit);
        const std::vector<float> t = c.matrices();
        std::mt19937 random(3);
        std::normal_distribution<double> gauss;
        for (int trial = 0; trial < 8; ++trial) {
            double v[3] = {gauss(random), gauss(random), gauss(random)};
            const double length = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
            double n_dot_v = 0;
            for (int a = 0; a < 3; ++a)
                n_dot_v += (v[a] /= length) * double{c.normal[static_cast<std::size_t>(a)]};
            const double sign = n_dot_v < 0 ? -1 : 1;
            std::vector<double> basis(static_cast<std::size_t>(sh::coeff_count(exit)));
            sh::evaluate(exit, sign * v[0], sign * v[1], sign * v[2], basis.data());
            const Rgb L =
                out.radiance({static_cast<float>(sign * v[0]), static_cast<float>(sign * v[1]),
                              static_cast<float>(sign * v[2])});
            const std::size_t lights = coeffs.size() / 3;
            for (std::size_t channel = 0; channel < 3; ++channel) {
                double sum = 0, scale = 0;
                for (std::size_t j = 0; j < basis.size(); ++j)
                    for (std::size_t i = 0; i < lights; ++i) {
                        const float* ab = &t[(j * lights + i) * 2];
                        const double term = basis[j] * double{coeffs[3 * i + channel]} *
                                            (double{r0[channel]} * double{ab[0]} + double{ab[1]});
                        sum += term;
                        scale += std::abs(term);
                    }
                EXPECT_NEAR(L[channel], sum, 1e-5 * scale + 1e-6);
            }
        }
    }
}

/// Row F1: a Phong lobe about the mirrored view multiplies degree l by its moment, and a mirror
/// about the normal negates odd orders. The reflected light is the lobe's integral over the light
/// itself.
TEST_F(Glossy, PhongLobeReflectsByItsMoments) {
    constexpr int kBands = 5;
    const std::vector<std::pair<int, std::vector<double>>> table{
        {1, {1, 0.666666666667, 0.25, 0, -0.0416666666667}},
        {8, {1, 0.9, 0.727272727273, 0.525, 0.335664335664}},
        {32, {1, 0.970588235294, 0.914285714286, 0.835784313725, 0.741312741313}}};
    for (const auto& [exponent, moments] : table) {
        Content c(kBands, kBands);
        c.normal = {0.48f, -0.6f, 0.64f};
        c.see_everything();
        for (int l = 0; l < kBands; ++l)
            for (int m = 0; m <= l; ++m)
                c.unoccluded[lobe_slot(kBands, kBands, m, l, l)] = static_cast<float>(
                    (m % 2 == 0 ? 1 : -1) * moments[static_cast<std::size_t>(l)]);
        const std::vector<float> coeffs = random_light(kBands, 4);
        const GlossyLight lighting({kBands, coeffs}, kBands);
        const GlossyExit out = reflect(c.lobe(), lighting.transfer(c.mesh(), 0), 0.25f, {1, 1, 1});
        for (const Vec3& v : {Vec3{0.48f, -0.6f, 0.64f}, Vec3{0, 0, 1}, Vec3{0.8f, 0, 0.6f}}) {
            // The mirrored view and two directions across it.
            double n_dot_v = 0, r[3], t[3], b[3];
            for (std::size_t a = 0; a < 3; ++a) n_dot_v += double{c.normal[a]} * double{v[a]};
            for (std::size_t a = 0; a < 3; ++a)
                r[a] = 2 * n_dot_v * double{c.normal[a]} - double{v[a]};
            const double across = std::hypot(r[0], r[1]);
            if (across > 0) {
                t[0] = -r[1] / across, t[1] = r[0] / across, t[2] = 0;
            } else {
                t[0] = 1, t[1] = t[2] = 0;
            }
            for (std::size_t a = 0; a < 3; ++a)
                b[a] = r[(a + 1) % 3] * t[(a + 2) % 3] - r[(a + 2) % 3] * t[(a + 1) % 3];
            double expected = 0;
            constexpr int kRings = 4000, kOnRing = 12;
            for (int i = 0; i < kRings; ++i) {
                const double z = (i + 0.5) / kRings, s = std::sqrt(1 - z * z);
                const double weight =
                    (exponent + 1) / (2 * pi) * std::pow(z, exponent) * 2 * pi / (kRings * kOnRing);
                for (int k = 0; k < kOnRing; ++k) {
                    const double x = s * std::cos(2 * pi * k / kOnRing),
                                 y = s * std::sin(2 * pi * k / kOnRing);
                    double basis[kBands * kBands];
                    sh::evaluate(kBands, x * t[0] + y * b[0] + z * r[0],
                                 x * t[1] + y * b[1] + z * r[1], x * t[2] + y * b[2] + z * r[2],
                                 basis);
                    for (std::size_t j = 0; j < kBands * kBands; ++j)
                        expected += weight * basis[j] * double{coeffs[3 * j]};
                }
            }
            EXPECT_NEAR(out.radiance(v)[0], expected, 1e-4) << exponent;
        }
    }
}

/// Turn vertex, light and eye alike: nothing changes. Ten bands can be turned, so four of lighting.
TEST_F(Glossy, NothingDependsOnTheFrame) {
    Content c(5, 4);
    c.randomise(5);
    const std::vector<float> coeffs = random_light(4, 9);
    const GlossyLight lighting({4, coeffs}, 4);
    const auto rotation = sh::Rotation::from_quaternion({0.3, -0.5, 0.2, 0.8});
    ASSERT_TRUE(rotation);
    const auto turned = [&](const Vec3& v) {
        // Y_1 = sqrt(3 / 4 pi) (y, z, x)
        std::array<double, 4> y{0, v[1], v[2], v[0]};
        EXPECT_TRUE(rotation->apply(std::span<const double>(y), y));
        return Vec3{static_cast<float>(y[3]), static_cast<float>(y[1]), static_cast<float>(y[2])};
    };
    Content other = c;
    std::vector<float> other_coeffs(coeffs.size());
    ASSERT_TRUE(rotation->apply(coeffs, other_coeffs, 3));
    ASSERT_TRUE(rotation->apply(c.visibility, other.visibility));
    const Vec3 normal{c.normal[0], c.normal[1], c.normal[2]};
    const Vec3 other_normal = turned(normal);
    other.normal.assign(other_normal.begin(), other_normal.end());
    const GlossyLight other_lighting({4, other_coeffs}, 4);
    const GlossyExit a = reflect(c.lobe(), lighting.transfer(c.mesh(), 0), 0.25f, {1, 1, 1});
    const GlossyExit b =
        reflect(other.lobe(), other_lighting.transfer(other.mesh(), 0), 0.25f, {1, 1, 1});
    for (const Vec3& v : {normal, Vec3{1, 0, 0}, Vec3{0, 0.6f, 0.8f}, Vec3{0, 0, -1}}) {
        const Rgb first = a.radiance(v), second = b.radiance(turned(v));
        for (std::size_t i = 0; i < 3; ++i)
            EXPECT_NEAR(first[i], second[i], 2e-4 * (1 + std::abs(first[i])));
    }
}

/// A white furnace, R0 = 1 or not: what the scene blocks shines like the sky, and the lobe shows
/// neither. Emission does the same as light that was reflected.
TEST_F(Glossy, LightFromSurfacesFillsWhatTheyBlock) {
    Content c(5, 5);
    c.randomise(8);
    std::vector<float> constant(75, 0.0f);
    for (std::size_t i = 0; i < 3; ++i) constant[i] = 2 * std::sqrt(std::numbers::pi_v<float>);
    const GlossyLight light({5, constant}, 5);
    Content open = c;
    open.see_everything();
    const GlossyExit expected =
        reflect(c.lobe(), light.transfer(open.mesh(), 0), 0.25f, {1, 0.5f, 0});

    c.visibility[0] = 0.6f * open.visibility[0];
    std::vector<float> diffuse(3 * 16);  // four bands of three channels
    for (std::size_t i = 0; i < diffuse.size(); ++i) diffuse[i] = c.visibility[i / 3];
    for (std::size_t i = 0; i < 3; ++i) diffuse[i] = open.visibility[0];
    Mesh mesh = c.mesh();
    mesh.diffuse.vertex_count = 1;
    mesh.diffuse.bands = 4;
    mesh.diffuse.channels = 3;
    mesh.diffuse.values = {diffuse.data(), diffuse.size()};
    const GlossyExit reflected = reflect(c.lobe(), light.transfer(mesh, 0), 0.25f, {1, 0.5f, 0});

    for (std::size_t i = 0; i < 3; ++i) diffuse[i] = c.visibility[0];  // what the sky sends alone
    const std::vector<float> emitted(3, 0.4f);  // of albedo 1: 0.4 of the sky is blocked, by 1
    mesh.diffuse.emitted = {emitted.data(), 3};
    const GlossyExit shining = reflect(c.lobe(), light.transfer(mesh, 0), 0.25f, {1, 0.5f, 0});
    mesh.diffuse.emitted = {};
    const GlossyExit dark = reflect(c.lobe(), light.transfer(mesh, 0), 0.25f, {1, 0.5f, 0});
    const GlossyExit direct = reflect(c.lobe(), light.transfer(c.mesh(), 0), 0.25f, {1, 0.5f, 0});
    for (std::size_t j = 0; j < 25; ++j)
        for (std::size_t i = 0; i < 3; ++i) {
            EXPECT_NEAR(reflected.coeffs[j][i], expected.coeffs[j][i], 1e-3);
            EXPECT_NEAR(shining.coeffs[j][i], expected.coeffs[j][i], 1e-3);
            EXPECT_NEAR(dark.coeffs[j][i], direct.coeffs[j][i], 1e-4);
        }
}

TEST_F(Glossy, RowsAreInterpolatedAndTheLastHolds) {
    Content c(2, 2, 3);
    for (std::size_t i = 0; i < c.unoccluded.size(); ++i)
        c.unoccluded[i] = static_cast<float>(i / (c.unoccluded.size() / 3));  // 0, 1, 2
    const auto first = [&](float roughness) { return double{c.matrices(roughness)[0]}; };
    EXPECT_DOUBLE_EQ(first(0.25f), 0);
    EXPECT_NEAR(first(0.375f), 0.5, 1e-6);
    EXPECT_NEAR(first(0.625f), 1.5, 1e-6);
    EXPECT_DOUBLE_EQ(first(0.75f), 2);
    EXPECT_DOUBLE_EQ(first(1), 2);
    EXPECT_DOUBLE_EQ(first(0), 0);
    EXPECT_DOUBLE_EQ(first(NAN), 0);
}

TEST_F(Glossy, WhatIsAbsentReflectsNothing) {
    Content c(3, 3);
    c.randomise(1);
    const std::vector<float> coeffs = random_light(3, 2);
    const GlossyLight lighting({3, coeffs}, 3);
    std::vector<float> t(9 * 9 * 2, 7.0f);
    EXPECT_EQ(lighting.transfer(c.mesh(), 1).bands, 0);
    EXPECT_FALSE(expander().expand(c.lobe(), c.transport(), 1, 0.5f, t));
    EXPECT_EQ(lighting.transfer({}, 0).bands, 0);
    EXPECT_EQ(GlossyLight({3, coeffs}, 2).transfer(c.mesh(), 0).bands, 0);
    EXPECT_EQ(reflect({}, lighting.transfer(c.mesh(), 0), 0.5f, {1, 1, 1}).bands, 0);
    EXPECT_EQ(GlossyExit{}.radiance({0, 0, 1}), Rgb{});
    EXPECT_FALSE(expander().expand({}, c.transport(), 0, 0.5f, t));
    EXPECT_FALSE(expander().expand(c.lobe(), c.transport(), 0, 0.5f, std::span(t).first(8)));
    c.normal = {0, 0, 0};
    EXPECT_EQ(lighting.transfer(c.mesh(), 0).bands, 0);
    EXPECT_FALSE(expander().expand(c.lobe(), c.transport(), 0, 0.5f, t));
    EXPECT_EQ(t, std::vector<float>(t.size(), 7.0f));
}

/// From below one sees what grazing shows; more lighting bands than transport has are left out.
TEST_F(Glossy, ViewsFromBelowGraze) {
    Content c(4, 2);
    c.randomise(4);
    c.normal = {0, 0, 1};
    const std::vector<float> coeffs = random_light(5, 2);
    const GlossyLight lighting({5, coeffs}, 2);
    const GlossyLight fewer({2, std::span(coeffs).first(12)}, 2);
    const auto exit = [&](const GlossyLight& light) {
        return reflect(c.lobe(), light.transfer(c.mesh(), 0), 0.25f, {1, 1, 1});
    };
    const Rgb below = exit(lighting).radiance({0.6f, 0, -0.8f});
    EXPECT_EQ(below, exit(fewer).radiance({1, 0, 0}));
    EXPECT_TRUE(std::isfinite(exit(lighting).radiance({0, 0, -1})[0]));
}

/// A bundle of one mesh of two vertices, three bands of lighting and two of exit radiance.
test::BundleBuilder& fill(test::BundleBuilder& builder, const std::string& facts,
                          std::uint64_t columns = 81, std::uint64_t kernel_columns = 14 + 6,
                          bool with_normal = true) {
    const auto zeros = [](std::uint64_t count) { return std::vector<float>(count, 0.0f); };
    builder.add<float>("brdf/ggx_lobe/unoccluded", {2, 2, 6 + 2}, zeros(32));
    builder.add<float>("brdf/ggx_lobe/kernel", {2, 2, kernel_columns}, zeros(4 * kernel_columns));
    builder.add<float>("mesh/0/glossy", {2, columns}, zeros(2 * columns), format::Codec::Zstd);
    if (with_normal) builder.add<float>("mesh/0/normal", {2, 3}, {0, 0, 1, 0, 1, 0});
    return builder.metadata(R"({"brdf":{"ggx_lobe":)" + facts +
                            R"(},"meshes":[{"node":0,"mesh":0,"primitive":0,"vertex_count":2}]})");
}
constexpr const char* kFacts = R"({"exit_bands":2,"light_bands":3,"roughness":[0.5,1]})";

TEST_F(Glossy, ABundleHandsItOut) {
    test::BundleBuilder builder;
    const auto bundle = Bundle::open(fill(builder, kFacts).finish().c_str());
    ASSERT_TRUE(bundle) << format::to_string(bundle.error());
    const LobeView& lobe = bundle->glossy_lobe();
    EXPECT_EQ(lobe.rows, 2);
    EXPECT_EQ(lobe.exit_bands, 2);
    EXPECT_EQ(lobe.light_bands, 3);
    EXPECT_EQ(lobe.min_roughness, 0.5f);
    EXPECT_EQ(lobe.max_roughness, 1.0f);
    EXPECT_EQ(bundle->glossy_lobe(Distribution::Beckmann).rows, 0);
    const GlossyView& transport = bundle->meshes()[0].glossy;
    EXPECT_EQ(transport.vertex_count, 2u);
    EXPECT_EQ(transport.light_bands, 3);
    EXPECT_EQ(transport.normals[5], 0.0f);
    EXPECT_EQ(transport.normals[4], 1.0f);
}

TEST_F(Glossy, ABundleThatIsNotSoIsRefused) {
    using format::Errc;
    const auto refusal = [](const char* facts, std::uint64_t columns = 81,
                            std::uint64_t kernel = 20, bool with_normal = true) {
        test::BundleBuilder builder;
        const auto bundle =
            Bundle::open(fill(builder, facts, columns, kernel, with_normal).finish().c_str());
        return bundle ? Errc::None : bundle.error().code;
    };
    EXPECT_EQ(refusal(kFacts), Errc::None);
    EXPECT_EQ(refusal(kFacts, 80), Errc::ArrayShape);
    EXPECT_EQ(refusal(kFacts, 36), Errc::ArrayShape);
    EXPECT_EQ(refusal(kFacts, 81, 21), Errc::ArrayShape);
    EXPECT_EQ(refusal(kFacts, 81, 20, false), Errc::ArrayMissing);
    EXPECT_EQ(refusal("{}"), Errc::Metadata);
    EXPECT_EQ(refusal(R"({"exit_bands":0,"light_bands":3,"roughness":[0.5,1]})"), Errc::Metadata);
    EXPECT_EQ(refusal(R"({"exit_bands":2,"light_bands":6,"roughness":[0.5,1]})"), Errc::Metadata);
    EXPECT_EQ(refusal(R"({"exit_bands":2,"light_bands":3,"roughness":[1,0.5]})"), Errc::Metadata);
    EXPECT_EQ(refusal(R"({"exit_bands":2,"light_bands":3,"roughness":[0.5]})"), Errc::Metadata);
    EXPECT_EQ(refusal(R"({"exit_bands":2,"light_bands":3,"roughness":[0.5,1,1]})"), Errc::Metadata);
    EXPECT_EQ(refusal(R"({"exit_bands":2,"light_bands":3,"roughness":[0.5,0.5]})"),
              Errc::ArrayShape);
    EXPECT_EQ(refusal(R"({"exit_bands":2,"light_bands":2,"roughness":[0.5,1]})"), Errc::ArrayShape);
}

}  // namespace
}  // namespace envbake::runtime
