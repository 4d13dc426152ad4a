// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/glossy.h"
#include "baker/brdf/lobe_expansion.h"
#include "baker/math/quadrature.h"
#include "baker/transport/ray_origin.h"
#include "baker/transport/ray_set.h"
#include "baker/transport/visible_transport.h"
#include "envbake/runtime/sh.h"
#include "tests/unit/trace/shapes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
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
    }
    std::vector<double> operator()(const std::vector<double>& radiance) const {
        // Gauss and Jordan on [matrix | right-hand side].
        std::vector<std::vector<double>> m(size(), std::vector<double>(size() + 1, 0));
        for (std::size_t v = 0; v < views_.size(); ++v) {
            const double w = views_[v].weight, z = views_[v].w.z;
            for (std::size_t i = 0; i < size(); ++i) {
                for (std::size_t k = 0; k < size(); ++k)
                    m[i][k] += w * ((z + 0.01) * above_[v][i] * above_[v][k] +
                                    0.01 * below_[v][i] * below_[v][k]);
                m[i].back() += w * radiance[v] * ((z + 0.01) * above_[v][i] + 0.01 * below_[v][i]);
            }
        }
        for (std::size_t i = 0; i < size(); ++i) {
            for (std::size_t r = 0; r < size(); ++r) {
                if (r == i) continue;
                const double factor = m[r][i] / m[i][i];
                for (std::size_t k = i; k <= size(); ++k) m[r][k] -= factor * m[i][k];
            }
        }
        std::vector<double> x;
        for (std::size_t i = 0; i < size(); ++i) x.push_back(m[i].back() / m[i][i]);
        return x;
    }

  private:
    std::size_t size() const { return static_cast<std::size_t>(count_); }
    const std::vector<Direction>& views_;
    int count_;
    std::vector<std::vector<double>> above_, below_;
};

/// [exit][light] of one part, by brute force, in the frame of the normal.
std::vector<std::vector<double>> matrix(Distribution distribution, double roughness, int part,
                                        int exit_bands, int light_bands,
                                        const std::vector<Direction>& lights) {
    const std::vector<Direction> views = directions(28, 56, 0, 2 * pi);
    const ExitFit fit(views, exit_bands);
    const auto light_count = static_cast<std::size_t>(light_bands * light_bands);
    std::vector<std::vector<double>> radiance(light_count, std::vector<double>(views.size(), 0));
    std::vector<double> basis(light_count);
    for (const Direction& light : lights) {
        sh::evaluate(light_bands, light.w.x, light.w.y, light.w.z, basis.data());
        for (std::size_t v = 0; v < views.size(); ++v) {
            const double f = light.weight * light.w.z *
                             brdf(distribution, roughness * roughness, light.w, views[v].w, part);
            for (std::size_t i = 0; i < light_count; ++i) radiance[i][v] += f * basis[i];
        }
    }
    std::vector<std::vector<double>> t(static_cast<std::size_t>(exit_bands * exit_bands),
                                       std::vector<double>(light_count));
    for (std::size_t i = 0; i < light_count; ++i) {
        const std::vector<double> exit = fit(radiance[i]);
        for (std::size_t j = 0; j < exit.size(); ++j) t[j][i] = exit[j];
    }
    return t;
}

double norm(const std::vector<std::vector<double>>& a, const std::vector<std::vector<double>>& b) {
    double sum = 0;
    for (std::size_t j = 0; j < a.size(); ++j)
        for (std::size_t i = 0; i < a[j].size(); ++i)
            sum += (a[j][i] - b[j][i]) * (a[j][i] - b[j][i]);
    return std::sqrt(sum);
}
double norm(const std::vector<std::vector<double>>& a) {
    return norm(a, std::vector(a.size(), std::vector<double>(a[0].size(), 0)));
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
    /// [exit][light] of one part.
    std::vector<std::vector<double>> matrix(double roughness, int part) const {
        const auto exit = static_cast<std::size_t>(lobe_view.exit_bands * lobe_view.exit_bands);
        const auto light = static_cast<std::size_t>(lobe_view.light_bands * lobe_view.light_bands);
        std::vector<float> t(exit * light * 2);
        EXPECT_TRUE(
            runtime::glossy_matrices(lobe_view, transport, 0, static_cast<float>(roughness), t));
        std::vector<std::vector<double>> result(exit, std::vector<double>(light));
        for (std::size_t j = 0; j < exit; ++j)
            for (std::size_t i = 0; i < light; ++i)
                result[j][i] = t[(j * light + i) * 2 + static_cast<std::size_t>(part)];
        return result;
    }
};

/// Transport of the origin, normal +Z, mean over turns of a fine set.
std::vector<float> traced_row(const Scene& scene, int bands) {
    const auto tracer = Tracer::build(scene);
    EXPECT_TRUE(tracer) << tracer.error();
    const SurfacePoints points(scene.meshes[0]);
    const RayOrigin origin = points.origin(points.representative(0), tracer->space());
    const RaySet set = make_ray_set(4096, 5);
    std::vector<float> row(static_cast<std::size_t>(bands * bands));
    std::vector<double> mean(row.size(), 0);
    constexpr int kTurns = 64;
    for (int i = 0; i < kTurns; ++i) {
        visible_transport(set, *tracer, origin, 2 * pi * i / kTurns, row);
        for (std::size_t c = 0; c < row.size(); ++c) mean[c] += double{row[c]} / kTurns;
    }
    return {mean.begin(), mean.end()};
}

/// The foot of a wall at x < 0: half of every sky.
TEST(Glossy, FloorAtTheFootOfAWall) {
    const Scene scene = test::scene_of({test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}),
                                        test::quad({0, -1e4f, -1}, {0, 2e4f, 0}, {0, 0, 1e4f})});
    const std::vector<Direction> all = directions(40, 80, 0, 2 * pi);
    const std::vector<Direction> open = directions(40, 48, -pi / 2, pi / 2);
    for (const Distribution distribution : {Distribution::Ggx, Distribution::Beckmann}) {
        for (const double roughness : {1.0, 0.7, 0.5}) {
            const LobeExpansionJob job{.distribution = distribution,
                                       .roughness = {roughness, roughness}};
            const Baked baked(job, traced_row(scene, 11), {0, 0, 1});
            const auto white = matrix(distribution, roughness, 0, 5, 5, all);
            for (const int part : {0, 1}) {
                const auto exact = matrix(distribution, roughness, part, 5, 5, open);
                const auto found = baked.matrix(roughness, part);
                const double error = norm(found, exact) / norm(white);
                std::printf("%s r %.1f part %d: |t| %.4f, error %.5f of white\n",
                            distribution == Distribution::Ggx ? "ggx" : "beckmann", roughness, part,
                            norm(exact) / norm(white), error);
                EXPECT_LT(error, 1e-2);
            }
        }
    }
}

}  // namespace
}  // namespace envbake
