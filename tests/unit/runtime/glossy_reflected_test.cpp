// SPDX-License-Identifier: Apache-2.0
// Light that surfaces send into a lobe, against its definition in docs/format.md: integrals over
// the sphere by their values at nodes, in double.
#include "envbake/runtime/glossy.h"
#include "envbake/runtime/half.h"
#include "envbake/runtime/sh.h"
#include "tests/unit/runtime/vector_code_test.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

namespace envbake::runtime {
namespace {

using std::numbers::pi;
using DRgb = std::array<double, 3>;
using Direction = std::array<double, 3>;

std::size_t square(int bands) {
    return static_cast<std::size_t>(sh::coeff_count(bands));
}

/// A lobe of two roughnesses, 0.25 and 1, and a mesh of two vertices: all of it random numbers, but
/// a share of what the second vertex sees is blocked. The first vertex is another one.
struct Content {
    int exit_bands = 5, light_bands = 5;
    int diffuse_bands = 5, diffuse_channels = 3;
    int reflected_bands = 4, reflected_channels = 3;  // 1: there is no such array
    std::vector<float> unoccluded{}, kernel{}, visibility{}, normals{}, diffuse{}, emitted{};
    std::vector<std::uint16_t> reflected{};

    static constexpr std::uint64_t kVertex = 1;
    static constexpr double kLeastRoughness = 0.25;

    Content& randomise(unsigned seed, double blocked_share = 0.4) {
        std::mt19937 random(seed);
        const auto fill = [&](std::vector<float>& list, std::size_t size, float scale) {
            std::normal_distribution<float> gauss(0, scale);
            list.resize(size);
            for (float& x : list) x = gauss(random);
        };
        fill(unoccluded, 4 * lobe_size(exit_bands, light_bands), 1);
        fill(kernel, 4 * lobe_size(exit_bands, kLobeBands), 1);
        fill(normals, 6, 1);
        const float length = std::hypot(normals[3], normals[4], normals[5]);
        for (float& x : normals) x /= length;
        fill(visibility, 2 * visibility_size(), 0.1f);
        const std::vector<double> open = of_an_open_place();
        for (std::size_t m = 0; m < open.size(); ++m)
            visibility[visibility_size() + m] += static_cast<float>(open[m]);
        block(blocked_share);
        fill(diffuse, 2 * diffuse_row_size(), 0.3f);
        std::vector<float> r;
        fill(r, 2 * reflected_row_size(), 0.2f);
        reflected.clear();
        for (const float x : r) reflected.push_back(float_to_half(x));
        return *this;
    }
    /// What the vertex cannot see, of the cosine's weight: B_0 sqrt(4 pi).
    void block(double share) {
        visibility[visibility_size()] =
            static_cast<float>(of_an_open_place()[0] - share / std::sqrt(4 * pi));
    }
    std::size_t visibility_size() const { return square(light_bands + kExtraVisibilityBands); }
    std::size_t diffuse_row_size() const {
        return square(diffuse_bands) * static_cast<std::size_t>(diffuse_channels);
    }
    std::size_t reflected_row_size() const {
        return (square(reflected_bands) - 1) * square(light_bands) *
               static_cast<std::size_t>(reflected_channels);
    }
    /// [m]: A_l / pi Y_m(normal)
    std::vector<double> of_an_open_place() const {
        std::vector<double> row(visibility_size());
        sh::evaluate(light_bands + kExtraVisibilityBands, double{normals[3]}, double{normals[4]},
                     double{normals[5]}, row.data());
        for (int l = 0; l < light_bands + kExtraVisibilityBands; ++l)
            for (int m = -l; m <= l; ++m)
                row[static_cast<std::size_t>(sh::index(l, m))] *= sh::clamped_cosine(l) / pi;
        return row;
    }

    LobeView lobe() const {
        return {2,
                exit_bands,
                light_bands,
                static_cast<float>(kLeastRoughness),
                1,
                {unoccluded.data(), unoccluded.size()},
                {kernel.data(), kernel.size()}};
    }
    Mesh mesh() const {
        Mesh mesh;
        mesh.vertex_count = 2;
        mesh.glossy = {2,
                       light_bands,
                       {visibility.data(), visibility.size()},
                       {normals.data(), normals.size()},
                       reflected_bands,
                       reflected_channels,
                       {reflected.data(), reflected.size(), true}};
        mesh.diffuse.vertex_count = 2;
        mesh.diffuse.bands = diffuse_bands;
        mesh.diffuse.channels = diffuse_channels;
        mesh.diffuse.values = {diffuse.data(), diffuse.size()};
        mesh.diffuse.emitted = {emitted.data(), emitted.size()};
        return mesh;
    }
    /// The same, as if light were sent to all directions alike.
    Mesh without_reflected() const {
        Mesh other = mesh();
        other.glossy.reflected_bands = other.glossy.reflected_channels = 1;
        other.glossy.reflected = {};
        return other;
    }
    TransferredLight transfer(const GlossyLight& light) const {
        return light.transfer(mesh(), kVertex);
    }
};

/// One of the frames about a normal, which comes last.
std::array<Direction, 3> some_frame(const Direction& n) {
    const auto cross = [](const Direction& a, const Direction& b) {
        return Direction{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                         a[0] * b[1] - a[1] * b[0]};
    };
    Direction t = cross(n, {0.3, -0.8, 0.5});
    const double length = std::hypot(t[0], t[1], t[2]);
    for (double& x : t) x /= length;
    return {t, cross(n, t), n};
}
Direction in_frame(const std::array<Direction, 3>& frame, const Direction& w) {
    Direction local{};
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t a = 0; a < 3; ++a) local[i] += frame[i][a] * w[a];
    return local;
}
std::vector<double> basis(int bands, const Direction& w) {
    std::vector<double> values(square(bands));
    sh::evaluate(bands, w[0], w[1], w[2], values.data());
    return values;
}

/// Directions and their weights, for polynomials up to degree 23: rows by Fejer's first rule, 24
/// columns. What is integrated here is of degree 20 at most.
struct Nodes {
    std::vector<Direction> w;
    std::vector<double> weight;

    Nodes() {
        constexpr int kCount = 24;
        for (int i = 0; i < kCount; ++i) {
            const double theta = pi * (i + 0.5) / kCount;
            double row = 1;
            for (int k = 1; k <= kCount / 2; ++k)
                row -= 2 * std::cos(2 * k * theta) / (4.0 * k * k - 1);
            for (int j = 0; j < kCount; ++j) {
                const double phi = 2 * pi * j / kCount;
                w.push_back({std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi),
                             std::cos(theta)});
                weight.push_back(2.0 / kCount * row * 2 * pi / kCount);
            }
        }
    }
};

/// Exit radiance of the second vertex, by section "Glossy transport" of docs/format.md.
///   lighting  [bands^2, 3]
class Definition {
  public:
    Definition(const Content& c, const std::vector<float>& lighting)
        : content_(c),
          frame_(some_frame({double{c.normals[3]}, double{c.normals[4]}, double{c.normals[5]}})) {
        const std::vector<double> open = c.of_an_open_place();
        const std::size_t light_count = std::min(lighting.size() / 3, square(c.light_bands));
        const auto l = [&](std::size_t i, std::size_t channel) {
            return double{lighting[3 * i + channel]};
        };
        // At the nodes: the part of the cosine's weight that is blocked, B; and the light.
        std::vector<std::vector<double>> Y;
        std::vector<double> B(nodes_.w.size(), 0);
        std::vector<DRgb> L(nodes_.w.size(), DRgb{});
        for (std::size_t at = 0; at < nodes_.w.size(); ++at) {
            Y.push_back(basis(c.light_bands + kExtraVisibilityBands, nodes_.w[at]));
            for (std::size_t m = 0; m < open.size(); ++m)
                B[at] += (open[m] - double{c.visibility[open.size() + m]}) * Y[at][m];
            for (std::size_t i = 0; i < light_count; ++i)
                for (std::size_t a = 0; a < 3; ++a) L[at][a] += l(i, a) * Y[at][i];
        }
        const auto integral_of_blocked = [&](auto&& of_node) {
            double sum = 0;
            for (std::size_t at = 0; at < nodes_.w.size(); ++at)
                sum += nodes_.weight[at] * B[at] * of_node(at);
            return sum;
        };
        const double share = integral_of_blocked([](std::size_t) { return 1.0; });

        // S: the mean, and what differs from it.
        std::vector<DRgb> S(nodes_.w.size(), DRgb{});
        const std::size_t shared = std::min(light_count, square(c.diffuse_bands));
        const auto of_channel = [](int channels, std::size_t a) {
            return channels == 1 ? std::size_t{0} : a;
        };
        for (std::size_t a = 0; a < 3 && share > 1e-3; ++a) {
            double mean = c.emitted.empty() ? 0 : double{c.emitted[3 + a]};
            for (std::size_t i = 0; i < shared; ++i)
                mean +=
                    l(i, a) * (double{c.diffuse[c.diffuse_row_size() +
                                                i * static_cast<std::size_t>(c.diffuse_channels) +
                                                of_channel(c.diffuse_channels, a)]} -
                               double{c.visibility[open.size() + i]});
            for (DRgb& sent : S) sent[a] = mean / share;
            for (std::size_t q = 1; q < square(c.reflected_bands); ++q) {
                double of_q = 0;
                for (std::size_t i = 0; i < light_count; ++i)
                    of_q += l(i, a) *
                            double{half_to_float(
                                c.reflected[c.reflected_row_size() +
                                            ((q - 1) * square(c.light_bands) + i) *
                                                static_cast<std::size_t>(c.reflected_channels) +
                                            of_channel(c.reflected_channels, a)])};
                const double mean_of_basis =
                    integral_of_blocked([&](std::size_t at) { return Y[at][q]; }) / share;
                for (std::size_t at = 0; at < S.size(); ++at)
                    S[at][a] += of_q * (Y[at][q] - mean_of_basis);
            }
        }

        // Moments about the normal.
        light_.resize(square(c.light_bands));
        blocked_.resize(square(kLobeBands));
        for (std::size_t at = 0; at < nodes_.w.size(); ++at) {
            const std::vector<double> turned = basis(kLobeBands, in_frame(frame_, nodes_.w[at]));
            for (std::size_t a = 0; a < 3; ++a) {
                const double weight = nodes_.weight[at];
                for (std::size_t k = 0; k < light_.size(); ++k)
                    light_[k][a] += weight * L[at][a] * turned[k];
                for (std::size_t k = 0; k < blocked_.size(); ++k)
                    blocked_[k][a] += weight * B[at] * (L[at][a] - S[at][a]) * turned[k];
            }
        }
    }

    DRgb radiance(const Direction& v, double roughness, const Rgb& r0) const {
        std::vector<DRgb> exit(square(content_.exit_bands), DRgb{});
        const double part = (roughness - Content::kLeastRoughness) / (1 - Content::kLeastRoughness);
        const auto add = [&](const std::vector<float>& table, int bands,
                             const std::vector<DRgb>& moments, double sign) {
            const std::size_t size = table.size() / 4;  // a and b of the first row, of the second
            const auto element = [&](std::size_t at, std::size_t of_b) {
                return (1 - part) * double{table[of_b * size + at]} +
                       part * double{table[(2 + of_b) * size + at]};
            };
            std::size_t at = 0;
            for (int m = 0; m < std::min(bands, content_.exit_bands); ++m)
                for (int j = m; j < content_.exit_bands; ++j)
                    for (int k = m; k < bands; ++k, ++at)
                        for (int order = -m; order <= m; order += std::max(1, 2 * m)) {
                            const auto to = static_cast<std::size_t>(sh::index(j, order)),
                                       from = static_cast<std::size_t>(sh::index(k, order));
                            for (std::size_t a = 0; a < 3; ++a)
                                exit[to][a] += sign *
                                               (double{r0[a]} * element(at, 0) + element(at, 1)) *
                                               moments[from][a];
                        }
        };
        add(content_.unoccluded, content_.light_bands, light_, 1);
        add(content_.kernel, kLobeBands, blocked_, -1);
        const std::vector<double> Y = basis(content_.exit_bands, in_frame(frame_, v));
        DRgb sum{};
        for (std::size_t j = 0; j < exit.size(); ++j)
            for (std::size_t a = 0; a < 3; ++a) sum[a] += exit[j][a] * Y[j];
        return sum;
    }

  private:
    const Content& content_;
    Nodes nodes_;
    std::array<Direction, 3> frame_;
    std::vector<DRgb> light_, blocked_;
};

std::vector<float> random_light(int bands, unsigned seed) {
    std::mt19937 random(seed);
    std::normal_distribution<float> gauss;
    std::vector<float> light(3 * square(bands));
    for (float& x : light) x = gauss(random);
    return light;
}
/// 1 in slot i.
std::vector<float> unit_light(int bands, std::size_t i) {
    std::vector<float> light(3 * square(bands), 0.0f);
    for (std::size_t a = 0; a < 3; ++a) light[3 * i + a] = 1;
    return light;
}

/// Unit directions above the surface.
std::vector<Vec3> views_of(const Content& c, std::size_t count) {
    std::mt19937 random(5);
    std::normal_distribution<float> gauss;
    std::vector<Vec3> views;
    while (views.size() < count) {
        Vec3 v{gauss(random), gauss(random), gauss(random)};
        const float length = std::hypot(v[0], v[1], v[2]);
        float n_dot_v = 0;
        for (std::size_t a = 0; a < 3; ++a) n_dot_v += (v[a] /= length) * c.normals[3 + a];
        if (n_dot_v > 0) views.push_back(v);
    }
    return views;
}

class GlossyReflected : public VectorCodeTest {};

/// Of sums in float, where radiance is about 1. Measured: up to 2e-6.
constexpr double kRounding = 2e-5;

TEST_F(GlossyReflected, ExitRadianceIsThatOfTheDefinition) {
    constexpr float kRoughness = 0.5f;
    const Rgb r0{0.9f, 0.5f, 0.04f};
    for (const auto& [light_bands, reflected_bands] :
         {std::pair{2, 2}, {3, 2}, {3, 3}, {4, 2}, {4, 4}, {5, 2}, {5, 3}, {5, 4}}) {
        // Lighting and diffuse transport of fewer, of as many and of more bands.
        const int lighting_bands = light_bands + 3 - reflected_bands;
        const std::vector<float> coeffs = random_light(lighting_bands, 7);
        const GlossyLight light({lighting_bands, coeffs}, light_bands);
        for (const int channels : {1, 3}) {
            SCOPED_TRACE(testing::Message() << light_bands << " bands, " << reflected_bands
                                            << " of reflected, " << channels << " channels");
            Content c{.exit_bands = channels == 1 ? 5 : 4,
                      .light_bands = light_bands,
                      .diffuse_bands = light_bands + 2 - reflected_bands % 4,
                      .diffuse_channels = reflected_bands == 3 ? 4 - channels : channels,
                      .reflected_bands = reflected_bands,
                      .reflected_channels = channels};
            c.randomise(static_cast<unsigned>(10 * light_bands + reflected_bands));
            if (channels == 3) c.emitted = {9, 9, 9, 0.3f, 0.2f, 0.1f};
            const Definition expected(c, coeffs);
            const GlossyExit exit = reflect(c.lobe(), c.transfer(light), kRoughness, r0);
            ASSERT_EQ(exit.bands, c.exit_bands);
            for (const Vec3& v : views_of(c, 8)) {
                const Rgb L = exit.radiance(v);
                const DRgb truth =
                    expected.radiance({double{v[0]}, double{v[1]}, double{v[2]}}, kRoughness, r0);
                for (std::size_t a = 0; a < 3; ++a)
                    EXPECT_NEAR(L[a], truth[a], kRounding * (1 + std::abs(truth[a])));
            }
        }
    }
}

/// Each column is what the light of its coefficient alone becomes, R0 = 0 and 1; with and without
/// what differs by direction. Emission is in none.
TEST_F(GlossyReflected, MatricesHaveWhatUnitLightingBecomes) {
    constexpr float kRoughness = 0.75f;
    const GlossyMatrices matrices;
    struct Case {
        int exit, light, reflected, channels;
    };
    for (const Case& of : {Case{5, 3, 3, 3}, {4, 2, 2, 1}, {2, 1, 1, 1}}) {
        Content c{.exit_bands = of.exit,
                  .light_bands = of.light,
                  .diffuse_bands = 2,
                  .reflected_bands = of.reflected,
                  .reflected_channels = of.channels};
        c.randomise(3);
        Content shining = c;
        shining.emitted.assign(6, 100.0f);
        const std::size_t exits = square(of.exit), lights = square(of.light);
        std::vector<GlossyLight> unit;
        for (std::size_t i = 0; i < lights; ++i)
            unit.emplace_back(ShLightingView{of.light, unit_light(of.light, i)}, of.light);
        for (const bool with : {true, false}) {
            const Mesh mesh = with ? shining.mesh() : shining.without_reflected();
            const Mesh dark = with ? c.mesh() : c.without_reflected();
            std::vector<float> t[3];
            for (int channel = 0; channel < 3; ++channel) {
                std::vector<float>& matrix = t[channel];
                matrix.resize(2 * exits * lights);
                ASSERT_TRUE(
                    matrices.expand(c.lobe(), mesh, Content::kVertex, kRoughness, channel, matrix));
            }
            for (std::size_t i = 0; i < lights; ++i) {
                SCOPED_TRACE(testing::Message() << "column " << i << " of " << lights);
                const TransferredLight transferred = unit[i].transfer(dark, Content::kVertex);
                const GlossyExit b = reflect(c.lobe(), transferred, kRoughness, {0, 0, 0});
                const GlossyExit both = reflect(c.lobe(), transferred, kRoughness, {1, 1, 1});
                for (const Vec3& v : views_of(c, 3)) {
                    const Rgb of_b = b.radiance(v), of_both = both.radiance(v);
                    const std::vector<double> Y =
                        basis(of.exit, {double{v[0]}, double{v[1]}, double{v[2]}});
                    for (std::size_t a = 0; a < 3; ++a) {
                        double sum_a = 0, sum_b = 0;
                        for (std::size_t j = 0; j < exits; ++j) {
                            sum_a += Y[j] * double{t[a][2 * (j * lights + i)]};
                            sum_b += Y[j] * double{t[a][2 * (j * lights + i) + 1]};
                        }
                        EXPECT_NEAR(sum_b, of_b[a], kRounding) << a;
                        EXPECT_NEAR(sum_a, of_both[a] - of_b[a], kRounding) << a;
                    }
                }
            }
        }
    }
}

TEST_F(GlossyReflected, MatricesTimesLightAreWhatItBecomes) {
    const GlossyMatrices matrices;
    const Content c = Content{}.randomise(6);
    const std::vector<float> coeffs = random_light(5, 8);
    const GlossyLight light({5, coeffs}, 5);
    const GlossyExit exit = reflect(c.lobe(), c.transfer(light), 1, {0.5f, 0.5f, 0.5f});
    for (std::size_t a = 0; a < 3; ++a) {
        std::vector<float> t(2 * 25 * 25);
        ASSERT_TRUE(
            matrices.expand(c.lobe(), c.mesh(), Content::kVertex, 1, static_cast<int>(a), t));
        for (const Vec3& v : views_of(c, 4)) {
            const std::vector<double> Y = basis(5, {double{v[0]}, double{v[1]}, double{v[2]}});
            double sum = 0;
            for (std::size_t j = 0; j < 25; ++j)
                for (std::size_t i = 0; i < 25; ++i)
                    sum += Y[j] * double{coeffs[3 * i + a]} *
                           (0.5 * double{t[2 * (25 * j + i)]} + double{t[2 * (25 * j + i) + 1]});
            EXPECT_NEAR(exit.radiance(v)[a], sum, kRounding * (1 + std::abs(sum)));
        }
    }
}

/// Without light from surfaces both forms are the same; what does not fit writes nothing.
TEST_F(GlossyReflected, MatricesOfWhatDoesNotFitAreRefused) {
    const GlossyMatrices matrices;
    Content c{.exit_bands = 3, .light_bands = 2, .reflected_bands = 2};
    c.randomise(2);
    std::vector<float> t(2 * 9 * 4, 7.0f);
    const auto expand = [&](const Mesh& mesh, std::uint64_t vertex = Content::kVertex,
                            int channel = 0) {
        return matrices.expand(c.lobe(), mesh, vertex, 0.5f, channel, t);
    };
    EXPECT_FALSE(expand(c.mesh(), Content::kVertex, -1));
    EXPECT_FALSE(expand(c.mesh(), Content::kVertex, 3));
    EXPECT_FALSE(expand(c.mesh(), 2));
    EXPECT_FALSE(expand({}));
    EXPECT_FALSE(matrices.expand({}, c.mesh(), Content::kVertex, 0.5f, 0, t));
    EXPECT_FALSE(matrices.expand(c.lobe(), c.mesh(), Content::kVertex, 0.5f, 0,
                                 std::span(t).first(t.size() - 1)));
    Content other{.exit_bands = 3, .light_bands = 3, .reflected_bands = 2};
    other.randomise(2);
    EXPECT_FALSE(expand(other.mesh()));
    other = c;
    std::fill(other.normals.begin(), other.normals.end(), 0.0f);
    EXPECT_FALSE(expand(other.mesh()));
    EXPECT_EQ(t, std::vector<float>(t.size(), 7.0f));

    Mesh direct = c.mesh();
    direct.diffuse = {};
    std::vector<float> by_transport(t.size());
    EXPECT_TRUE(expand(direct, Content::kVertex, 2));
    EXPECT_TRUE(matrices.expand(c.lobe(), direct.glossy, Content::kVertex, 0.5f, by_transport));
    EXPECT_EQ(t, by_transport);
    EXPECT_TRUE(expand(c.mesh(), Content::kVertex, 2));
    EXPECT_NE(t, by_transport);
}

/// Y_0 of what is blocked is the integral of light by surfaces less that of the sky: it stays,
/// others do not.
TEST_F(GlossyReflected, LightMovesAndIsNoMore) {
    const Content c = Content{}.randomise(12);
    const std::vector<float> coeffs = random_light(5, 3);
    const GlossyLight light({5, coeffs}, 5);
    const TransferredLight with = c.transfer(light),
                           without = light.transfer(c.without_reflected(), Content::kVertex);
    for (std::size_t a = 0; a < 3; ++a) {
        EXPECT_NEAR(with.blocked[0][a], without.blocked[0][a], 1e-5);
        for (std::size_t k = 1; k < 4; ++k)
            EXPECT_GT(std::abs(with.blocked[k][a] - without.blocked[k][a]), 1e-3) << k;
    }
}

/// Of a thousandth nobody knows what it sends; of a place that sees everything nothing is blocked.
TEST_F(GlossyReflected, AVertexThatSeesNearlyEverythingGetsNothing) {
    Content c;
    c.randomise(4);
    c.emitted.assign(6, 1.0f);
    const std::vector<float> coeffs = random_light(5, 3);
    const GlossyLight light({5, coeffs}, 5);
    const auto is_changed_at = [&](double share) {
        c.block(share);
        Mesh direct = c.mesh();
        direct.diffuse = {};
        return c.transfer(light).blocked != light.transfer(direct, Content::kVertex).blocked;
    };
    for (const double share : {-0.1, -1e-5, 0.0, 1e-4, 9.9e-4}) EXPECT_FALSE(is_changed_at(share));
    for (const double share : {1.01e-3, 0.1, 1.0}) EXPECT_TRUE(is_changed_at(share)) << share;
}

/// What is blocked sends what the sky does: the lobe shows neither, whatever r says of other light.
TEST_F(GlossyReflected, AFurnaceKeepsItsEnergy) {
    const std::size_t constant = 0;
    std::vector<float> white = unit_light(5, constant);
    for (float& x : white) x *= 2 * std::sqrt(std::numbers::pi_v<float>);
    const GlossyLight light({5, white}, 5);
    for (const double share : {2e-3, 0.4, 0.9}) {
        Content c;
        c.randomise(9, share);
        Content open = c;
        for (std::size_t m = 0; m < c.visibility_size(); ++m)
            open.visibility[c.visibility_size() + m] = static_cast<float>(c.of_an_open_place()[m]);
        // T = V + B, for all of B sends 1.
        for (std::size_t i = 0; i < c.diffuse_row_size(); ++i)
            c.diffuse[c.diffuse_row_size() + i] = open.visibility[c.visibility_size() + i / 3];
        for (std::size_t q = 0; q < 15; ++q)
            for (std::size_t a = 0; a < 3; ++a)
                c.reflected[c.reflected_row_size() + (q * 25 + constant) * 3 + a] = 0;
        for (const float roughness : {0.5f, 1.0f}) {
            const Rgb r0{1, 0.5f, 0};
            const GlossyExit exit = reflect(c.lobe(), c.transfer(light), roughness, r0);
            const GlossyExit expected = reflect(c.lobe(), open.transfer(light), roughness, r0);
            for (const Vec3& v : views_of(c, 8)) {
                const Rgb L = exit.radiance(v), white_L = expected.radiance(v);
                for (std::size_t a = 0; a < 3; ++a) EXPECT_NEAR(L[a], white_L[a], 1e-3) << share;
            }
        }
    }
}

}  // namespace
}  // namespace envbake::runtime
