// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/glossy.h"
#include "baker/brdf/lobe_expansion.h"
#include "baker/math/quadrature.h"
#include "baker/transport/diffuse.h"
#include "baker/transport/ray_origin.h"
#include "baker/transport/ray_set.h"
#include "baker/transport/visible_transport.h"
#include "envbake/runtime/sh.h"
#include "tests/unit/trace/shapes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <span>
#include <vector>

/// Transport matrices from rays against integrals done by brute force: over directions of light and
/// of view, by the formulas of the papers, without the expansion of the lobe or its half vectors.
namespace envbake {
namespace {

using runtime::Distribution;
using std::numbers::pi;

struct Direction {
    DVec3 w;
    double weight;
};

/// Gauss and Legendre in sqrt(z), midpoints in azimuth from `from` to `to`; about +Z.
std::vector<Direction> directions(int rows, int columns, double from, double to) {
    std::vector<Direction> result;
    const Quadrature rule = gauss_legendre(rows);
    for (std::size_t i = 0; i < rule.nodes.size(); ++i) {
        const double x = (1 + rule.nodes[i]) / 2, z = x * x, radius = std::sqrt(1 - z * z);
        for (int k = 0; k < columns; ++k) {
            const double phi = from + (to - from) * (k + 0.5) / columns;
            result.push_back({{radius * std::cos(phi), radius * std::sin(phi), z},
                              rule.weights[i] * x * (to - from) / columns});
        }
    }
    return result;
}

struct Lobe {
    Distribution distribution;
    double roughness;
};

/// D, Smith's G2 = 1 / (1 + Lambda + Lambda) and the parts of Fresnel. [Heitz14], [Walter07].
double brdf(Distribution distribution, double alpha, const DVec3& w, const DVec3& o, int part) {
    const DVec3 h = glm::normalize(w + o);
    const auto tan2 = [](double c) { return (1 - c * c) / (c * c); };
    const auto lambda = [&](double c) {
        const double a = 1 / (alpha * std::sqrt(tan2(c)));
        return distribution == Distribution::Ggx
                   ? (std::sqrt(1 + 1 / (a * a)) - 1) / 2
                   : std::exp(-a * a) / (2 * a * std::sqrt(pi)) - std::erfc(a) / 2;
    };
    const double t = tan2(h.z) / (alpha * alpha), c4 = std::pow(h.z, 4);
    const double d = distribution == Distribution::Ggx
                         ? 1 / (pi * alpha * alpha * c4 * (1 + t) * (1 + t))
                         : std::exp(-t) / (pi * alpha * alpha * c4);
    const double fresnel = std::pow(1 - glm::dot(o, h), 5);
    return d / (1 + lambda(w.z) + lambda(o.z)) / (4 * w.z * o.z) *
           (part == 0 ? 1 - fresnel : fresnel);
}

/// Coefficients of exit radiance: least squares over the sphere of what is mirrored below the
/// horizon, weighted by max(0, z) + 1/100. [view][coefficient] to the normal equations' solution.
class ExitFit {
  public:
    ExitFit(const std::vector<Direction>& views, int bands) : views_(views), count_(bands * bands) {
        for (const Direction& view : views) {
            std::vector<double> above(size()), below(size());
            sh::evaluate(bands, view.w.x, view.w.y, view.w.z, above.data());
            sh::evaluate(bands, view.w.x, view.w.y, -view.w.z, below.data());
            above_.push_back(std::move(above));
            below_.push_back(std::move(below));
        }
        // Gauss and Jordan on [matrix | 1].
        inverse_.assign(size(), std::vector<double>(2 * size(), 0));
        auto& m = inverse_;
        for (std::size_t i = 0; i < size(); ++i) {
            m[i][size() + i] = 1;
            for (std::size_t v = 0; v < views_.size(); ++v)
                for (std::size_t k = 0; k < size(); ++k)
                    m[i][k] +=
                        views_[v].weight * ((views_[v].w.z + 0.01) * above_[v][i] * above_[v][k] +
                                            0.01 * below_[v][i] * below_[v][k]);
        }
        for (std::size_t i = 0; i < size(); ++i) {
            for (std::size_t r = 0; r < size(); ++r) {
                if (r == i) continue;
                const double factor = m[r][i] / m[i][i];
                for (std::size_t k = i; k < 2 * size(); ++k) m[r][k] -= factor * m[i][k];
            }
        }
    }
    std::vector<double> operator()(const std::vector<double>& radiance) const {
        std::vector<double> moments(size(), 0), x(size(), 0);
        for (std::size_t v = 0; v < views_.size(); ++v)
            for (std::size_t i = 0; i < size(); ++i)
                moments[i] += views_[v].weight * radiance[v] *
                              ((views_[v].w.z + 0.01) * above_[v][i] + 0.01 * below_[v][i]);
        for (std::size_t i = 0; i < size(); ++i)
            for (std::size_t k = 0; k < size(); ++k)
                x[i] += inverse_[i][size() + k] / inverse_[i][i] * moments[k];
        return x;
    }

  private:
    std::size_t size() const { return static_cast<std::size_t>(count_); }
    const std::vector<Direction>& views_;
    int count_;
    std::vector<std::vector<double>> above_, below_, inverse_;
};

/// By brute force, in the frame of the normal: exit coefficients of light from single directions.
class ExitOfLight {
  public:
    ExitOfLight(const Lobe& lobe, int bands)
        : lobe_(lobe), views_(directions(20, 40, 0, 2 * pi)), fit_(views_, bands) {}

    std::vector<double> operator()(const Direction& light, int part) const {
        std::vector<double> radiance;
        for (const Direction& view : views_)
            radiance.push_back(
                light.weight * light.w.z *
                brdf(lobe_.distribution, lobe_.roughness * lobe_.roughness, light.w, view.w, part));
        return fit_(radiance);
    }

  private:
    Lobe lobe_;
    std::vector<Direction> views_;
    ExitFit fit_;
};

/// [exit][light] of one part.
std::vector<std::vector<double>> matrix(const Lobe& lobe, int part, int exit_bands, int light_bands,
                                        const std::vector<Direction>& lights) {
    const ExitOfLight exit_of(lobe, exit_bands);
    std::vector<double> basis(static_cast<std::size_t>(light_bands * light_bands));
    std::vector<std::vector<double>> t(static_cast<std::size_t>(exit_bands * exit_bands),
                                       std::vector<double>(basis.size()));
    for (const Direction& light : lights) {
        sh::evaluate(light_bands, light.w.x, light.w.y, light.w.z, basis.data());
        const std::vector<double> exit = exit_of(light, part);
        for (std::size_t j = 0; j < exit.size(); ++j)
            for (std::size_t i = 0; i < basis.size(); ++i) t[j][i] += exit[j] * basis[i];
    }
    return t;
}

/// Floats of one lobe and one vertex, as views of a bundle.
struct Baked {
    LobeExpansion lobe;
    std::vector<float> visibility, normals;
    runtime::LobeView lobe_view;
    runtime::GlossyView transport;

    Baked(const LobeExpansionJob& job, const std::vector<float>& row, const Vec3& normal)
        : lobe(expand_lobe(job)), visibility(row), normals{normal.x, normal.y, normal.z} {
        lobe_view = {lobe.rows,
                     job.exit_bands,
                     job.light_bands,
                     static_cast<float>(job.roughness[0]),
                     static_cast<float>(job.roughness[1]),
                     {lobe.unoccluded.data(), lobe.unoccluded.size()},
                     {lobe.kernel.data(), lobe.kernel.size()}};
        transport = {1,
                     job.light_bands,
                     {visibility.data(), visibility.size()},
                     {normals.data(), normals.size()}};
    }
    /// |a + b of a place that sees everything|_F^2.
    double white_squared() const {
        const int exit = lobe_view.exit_bands, light = lobe_view.light_bands;
        const std::size_t size = runtime::lobe_size(exit, light);
        double sum = 0;
        for (int m = 0; m < std::min(exit, light); ++m)
            for (std::size_t at = runtime::lobe_block(exit, light, m);
                 at < runtime::lobe_block(exit, light, m + 1); ++at)
                sum +=
                    (m == 0 ? 1 : 2) *
                    std::pow(double{lobe.unoccluded[at]} + double{lobe.unoccluded[size + at]}, 2);
        return sum;
    }
    /// [exit][light] of one part.
    std::vector<std::vector<double>> matrix(double roughness, int part) const {
        const auto exit = static_cast<std::size_t>(lobe_view.exit_bands * lobe_view.exit_bands);
        const auto light = static_cast<std::size_t>(lobe_view.light_bands * lobe_view.light_bands);
        static const runtime::GlossyMatrices matrices;
        std::vector<float> t(exit * light * 2);
        EXPECT_TRUE(matrices.expand(lobe_view, transport, 0, static_cast<float>(roughness), t));
        std::vector<std::vector<double>> result(exit, std::vector<double>(light));
        for (std::size_t j = 0; j < exit; ++j)
            for (std::size_t i = 0; i < light; ++i)
                result[j][i] = t[(j * light + i) * 2 + static_cast<std::size_t>(part)];
        return result;
    }
};

/// The foot of a wall at x < 0, traced by many rays: what is left is what seven bands miss of the
/// lobe. Every coefficient, not only their norm.
TEST(Glossy, FloorAtTheFootOfAWall) {
    const Scene scene = test::scene_of({test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}),
                                        test::quad({0, -1e4f, -1}, {0, 2e4f, 0}, {0, 0, 1e4f})});
    const auto tracer = Tracer::build(scene);
    ASSERT_TRUE(tracer) << tracer.error();
    const SurfacePoints points(scene.meshes[0]);
    const RayOrigin origin = points.origin(points.representative(0), tracer->space());
    const RaySet set = make_ray_set(4096, 5);
    std::vector<float> row(121), mean(121, 0);
    constexpr int kTurns = 64;
    for (int i = 0; i < kTurns; ++i) {
        visible_transport(set, *tracer, origin, 2 * pi * i / kTurns, row);
        for (std::size_t c = 0; c < row.size(); ++c) mean[c] += row[c] / kTurns;
    }
    const std::vector<Direction> open = directions(24, 32, -pi / 2, pi / 2);
    for (const Lobe lobe : {Lobe{Distribution::Ggx, 1.0}, Lobe{Distribution::Ggx, 0.5},
                            Lobe{Distribution::Beckmann, 0.7}}) {
        const LobeExpansionJob job{.distribution = lobe.distribution,
                                   .roughness = {lobe.roughness, lobe.roughness}};
        const Baked baked(job, mean, {0, 0, 1});
        const LobeErrors errors = lobe_errors(job, lobe.roughness, 1);
        double sum = 0;
        for (const int part : {0, 1}) {
            const auto exact = matrix(lobe, part, 5, 5, open);
            const auto found = baked.matrix(lobe.roughness, part);
            for (std::size_t j = 0; j < exact.size(); ++j) {
                for (std::size_t i = 0; i < exact[j].size(); ++i) {
                    const double error = found[j][i] - exact[j][i];
                    EXPECT_NEAR(error, 0, 2e-3) << "part " << part << ": " << j << ", " << i;
                    sum += error * error;
                }
            }
        }
        // Half of the sky is blocked, so that is what the baker would state, and more than it is.
        EXPECT_LT(std::sqrt(sum / baked.white_squared()), errors.fit * std::sqrt(0.5) + 1e-3);
    }
}

/// What a bake makes of places under a ball and beside a wall, all of them, at the default
/// tolerance, against exact visibility: a ray meets the ball, or the wall, or neither.
TEST(Glossy, ABakeIsWithinItsStatedError) {
    constexpr float kRadius = 0.7f;
    const Vec3 centre(0.2f, 0.1f, 1.1f);
    Scene scene = test::scene_of({test::grid({-1, -1, 0}, {2, 0, 0}, {0, 2, 0}, 12),
                                  test::sphere(centre, kRadius * 1.00012f, 5),
                                  test::quad({-1.05f, -20, -1}, {0, 40, 0}, {0, 0, 40})});
    const auto tracer = Tracer::build(scene);
    ASSERT_TRUE(tracer) << tracer.error();
    std::vector<float> rows;
    Progress progress;
    const Lobe lobe{Distribution::Ggx, 0.6};
    const LobeExpansionJob expansion{.distribution = lobe.distribution,
                                     .exit_bands = 3,
                                     .light_bands = 5,
                                     .roughness = {lobe.roughness, lobe.roughness}};
    const LobeErrors errors = lobe_errors(expansion, lobe.roughness, 1);
    const DiffuseJob job{.bands = 5,
                         .row_bands = 11,
                         .tolerance = 1e-2,
                         .row_use = {{errors.of_row}, errors.per_transport_error}};
    const auto report = bake_diffuse(
        job, scene, 0, *tracer,
        [&](std::span<const float> more) -> Expected<void> {
            rows.insert(rows.end(), more.begin(), more.end());
            return {};
        },
        progress);
    ASSERT_TRUE(report) << report.error();

    const auto visible = [&](const Vec3& from, const DVec3& w) {
        const DVec3 to_centre = DVec3(centre) - DVec3(from);
        const double along = glm::dot(to_centre, w);
        const double off2 = glm::dot(to_centre, to_centre) - along * along;
        if (along > 0 && off2 < double{kRadius} * double{kRadius}) return false;
        if (w.x >= 0) return true;
        const double t = (-1.05 - double{from.x}) / w.x;
        return std::abs(double{from.y} + t * w.y) > 20 || t * w.z > 39;
    };
    // A grid over the squared cosine, so fine that edges across it err by a tenth of the tolerance.
    const std::vector<Direction> sky = directions(96, 192, 0, 2 * pi);
    std::vector<std::vector<double>> basis, exit;  // of light from each direction
    const ExitOfLight exit_of(lobe, expansion.exit_bands);
    for (const Direction& light : sky) {
        exit.push_back(exit_of(light, 0));
        const std::vector<double> of_b = exit_of(light, 1);
        for (std::size_t j = 0; j < of_b.size(); ++j) exit.back()[j] += of_b[j];
        basis.emplace_back(25);
        sh::evaluate(5, light.w.x, light.w.y, light.w.z, basis.back().data());
    }
    double sum = 0, white = 0;
    const std::size_t count = scene.meshes[0].vertex_count();
    for (std::size_t vertex = 0; vertex < count; ++vertex) {
        std::vector<std::vector<double>> exact(9, std::vector<double>(25, 0));
        for (std::size_t d = 0; d < sky.size(); ++d) {
            if (!visible(scene.meshes[0].positions[vertex], sky[d].w)) continue;
            for (std::size_t j = 0; j < 9; ++j)
                for (std::size_t i = 0; i < 25; ++i) exact[j][i] += exit[d][j] * basis[d][i];
        }
        const auto begin = rows.begin() + static_cast<std::ptrdiff_t>(121 * vertex);
        const Baked baked(expansion, {begin, begin + 121}, {0, 0, 1});
        white = baked.white_squared();
        const auto a = baked.matrix(lobe.roughness, 0), b = baked.matrix(lobe.roughness, 1);
        for (std::size_t j = 0; j < 9; ++j)
            for (std::size_t i = 0; i < 25; ++i)
                sum += std::pow(a[j][i] + b[j][i] - exact[j][i], 2);
    }
    const double error = std::sqrt(sum / static_cast<double>(count) / white);
    EXPECT_LT(error, std::hypot(report->row_error * report->error_rms, errors.fit) + 1e-3);
    EXPECT_LT(report->row_error * report->error_rms, 1.1 * job.tolerance);
    EXPECT_GT(error, 1e-4);  // it was measured
}

/// Noise in what is stored comes through the lobe as its errors say.
TEST(Glossy, RoundingErrsAsStated) {
    constexpr double kNoise = 1e-3;
    for (const double roughness : {0.5, 1.0}) {
        const LobeExpansionJob job{.roughness = {roughness, roughness}};
        std::vector<float> row(121, 0.01f);
        const Baked clean(job, row, {0, 0.6f, 0.8f});
        std::mt19937 random(1);
        std::normal_distribution<float> noise(0, static_cast<float>(kNoise));
        double sum = 0;
        constexpr int kTrials = 60;
        for (int trial = 0; trial < kTrials; ++trial) {
            std::vector<float> other = row;
            for (float& x : other) x += noise(random);
            const Baked spoiled(job, other, {0, 0.6f, 0.8f});
            const auto a = clean.matrix(roughness, 0), b = spoiled.matrix(roughness, 0);
            const auto a1 = clean.matrix(roughness, 1), b1 = spoiled.matrix(roughness, 1);
            for (std::size_t j = 0; j < a.size(); ++j)
                for (std::size_t i = 0; i < a[j].size(); ++i)
                    sum += std::pow(b[j][i] + b1[j][i] - a[j][i] - a1[j][i], 2);
        }
        const double error = std::sqrt(sum / kTrials / clean.white_squared());
        const double stated = kNoise * lobe_errors(job, roughness, 1).per_rounding_error;
        EXPECT_NEAR(error, stated, 0.2 * stated) << roughness;
    }
}

/// One wrong row, not noise: the form is of its matrices, number for number.
TEST(Glossy, ARowErrsAsItsFormSays) {
    const Vec3 up(0, 0, 1);
    for (const auto& [exit, light] : {std::pair{5, 5}, std::pair{3, 4}}) {
        const double roughness = 0.5, r0 = 0.3;
        const LobeExpansionJob job{
            .exit_bands = exit, .light_bands = light, .roughness = {roughness, roughness}};
        const auto size = static_cast<std::size_t>(sh::coeff_count(light + 6));
        std::mt19937 random(2);
        std::normal_distribution<float> noise(0, 0.1f);
        std::vector<float> row(size), other(size);
        std::vector<double> difference(size);
        for (std::size_t c = 0; c < size; ++c) {
            row[c] = noise(random);
            other[c] = row[c] + noise(random);
            difference[c] = double{other[c]} - double{row[c]};
        }
        const Baked one(job, row, up), two(job, other, up);
        double sum = 0;
        const auto a = one.matrix(roughness, 0), b = one.matrix(roughness, 1);
        const auto a2 = two.matrix(roughness, 0), b2 = two.matrix(roughness, 1);
        for (std::size_t j = 0; j < a.size(); ++j)
            for (std::size_t i = 0; i < a[j].size(); ++i)
                sum += std::pow(r0 * (a2[j][i] - a[j][i]) + b2[j][i] - b[j][i], 2);
        const AxialForm form = lobe_errors(job, roughness, r0).of_row;
        ASSERT_EQ(form.bands, light + 6);
        EXPECT_NEAR(form(difference), sum / one.white_squared(), 1e-5 * form(difference));
    }
}

/// The diffuse part of a longer row is the row that a diffuse bake gives.
TEST(Glossy, MoreBandsChangeNoBitOfTheFirst) {
    const Scene scene = test::scene_of(
        {test::grid({-1, -1, 0}, {2, 0, 0}, {0, 2, 0}, 8), test::sphere({0, 0, 1}, 0.6f, 2)});
    const auto tracer = Tracer::build(scene);
    ASSERT_TRUE(tracer) << tracer.error();
    const auto bake = [&](int row_bands) {
        std::vector<float> rows;
        Progress progress;
        const auto report = bake_diffuse(
            {.bands = 4, .row_bands = row_bands}, scene, 0, *tracer,
            [&](std::span<const float> more) -> Expected<void> {
                rows.insert(rows.end(), more.begin(), more.end());
                return {};
            },
            progress);
        EXPECT_TRUE(report) << report.error();
        return rows;
    };
    const std::vector<float> rows = bake(0), more = bake(10);
    ASSERT_EQ(more.size(), rows.size() / 16 * 100);
    for (std::size_t i = 0; i < rows.size(); ++i)
        ASSERT_EQ(rows[i], more[i / 16 * 100 + i % 16]) << i;
}

}  // namespace
}  // namespace envbake
