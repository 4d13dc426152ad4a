// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/lobe_light.h"
#include "baker/brdf/lobe_expansion.h"
#include "baker/math/quadrature.h"
#include "baker/transport/interreflection.h"
#include "envbake/runtime/half.h"
#include "envbake/runtime/lobe.h"
#include "envbake/runtime/sh.h"
#include "tests/unit/trace/shapes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

/// The light that surfaces send into lobes, against integrals over directions by brute force. T
/// between vertices is linear on both sides.
namespace envbake {
namespace {

using std::numbers::pi;

constexpr std::size_t kCoeffs = 25, kChannels = 3, kColumns = kCoeffs * kChannels;

struct Lit {
    std::vector<MeshTransport> direct, transport;
    BounceReport report;
};

/// Mesh 1 is what has the lobe.
Lit light(const Scene& scene, const Tracer& tracer, double roughness, double r0,
          double tolerance = 1e-2) {
    Lit lit;
    Progress progress;
    std::vector<BlockedRays> blocked(scene.meshes.size());
    for (std::size_t m = 0; m < scene.meshes.size(); ++m) {
        MeshTransport mesh;
        const auto sink = [&](std::span<const float> rows) -> Expected<void> {
            for (const float value : rows) mesh.rows.insert(mesh.rows.end(), kChannels, value);
            return {};
        };
        EXPECT_TRUE(bake_diffuse({.tolerance = tolerance / 2}, scene, m, tracer, sink, progress,
                                 &blocked[m]));
        lit.direct.push_back(std::move(mesh));
    }
    lit.transport = lit.direct;
    BounceJob job{.tolerance = tolerance};
    job.lobes.errors = {{lobe_errors({}, roughness, r0).of_reflected}};
    job.lobes.lobe_of_mesh.assign(scene.meshes.size(), LobeLightJob::kNoLobe);
    job.lobes.lobe_of_mesh[1] = 0;
    lit.report = add_bounces(job, scene, tracer, blocked, lit.transport, progress);
    return lit;
}

/// A block that hangs in a room of one bright, one blue and three dim walls.
Scene room_and_block() {
    std::vector<Mesh> meshes(2);
    meshes[1] = test::box({-0.5f, -0.6f, 0.4f}, {0.6f, 0.4f, 1.2f}, 5, 1);
    test::append(meshes[0], test::grid({-2, -2, 0}, {0, 4, 0}, {0, 0, 3}, 8));
    Mesh blue = test::grid({2, -2, 0}, {0, 0, 3}, {0, 4, 0}, 8);
    Mesh dim = test::grid({-2, -2, 0}, {4, 0, 0}, {0, 4, 0}, 8);
    test::append(dim, test::grid({-2, -2, 0}, {0, 0, 3}, {4, 0, 0}, 8));
    test::append(dim, test::grid({-2, 2, 0}, {4, 0, 0}, {0, 0, 3}, 8));
    meshes.push_back(blue);
    meshes.push_back(dim);
    Scene scene = test::scene_of(meshes);
    const Vec3 colors[]{
        {0.9f, 0.9f, 0.9f}, {0.9f, 0.9f, 0.9f}, {0.1f, 0.2f, 0.8f}, {0.2f, 0.2f, 0.2f}};
    scene.materials.assign(4, scene.materials[0]);
    for (std::size_t m = 0; m < 4; ++m) {
        scene.materials[m].base_color = colors[m];
        scene.materials[m].metallic = 0;
        scene.meshes[m].material = static_cast<int>(m);
    }
    return scene;
}

/// What is sent to a place, [49 functions about the normal, columns]: by rays to all directions,
/// and as a reader of the bundle has it, by the mean alone and with what is stored.
struct Met {
    std::vector<double> exact, mean, stored;
};

Met met(const Scene& scene, const Tracer& tracer, const Lit& lit, std::size_t vertex) {
    constexpr int kRows = 24, kAround = 48;
    const std::size_t mesh = 1;
    const SurfacePoints points(scene.meshes[mesh]);
    const RayOrigin origin = points.origin(points.representative(vertex), tracer.space());
    const Frame frame = frame_about(origin.normal);
    const Quadrature rule = gauss_legendre(kRows);

    struct Ray {
        std::vector<double> local, world;  // basis
        double weight;                     // cos / pi
        std::vector<double> light;
    };
    std::vector<Ray> blocked;
    double share = 0;
    std::vector<double> mean_basis(16, 0);
    for (std::size_t i = 0; i < rule.nodes.size(); ++i) {
        const double z2 = (1 + rule.nodes[i]) / 2, radius = std::sqrt(1 - z2);
        for (int k = 0; k < kAround; ++k) {
            const double phi = 2 * pi * (k + 0.5) / kAround;
            const DVec3 w(radius * std::cos(phi), radius * std::sin(phi), std::sqrt(z2));
            const DVec3 in_world = frame.to_world(w);
            const auto hit = tracer.closest(origin.position, in_world);
            if (!hit) continue;
            Ray ray{std::vector<double>(49), std::vector<double>(16), rule.weights[i] / 2 / kAround,
                    std::vector<double>(kColumns, 0)};
            sh::evaluate(7, w.x, w.y, w.z, ray.local.data());
            sh::evaluate(4, in_world.x, in_world.y, in_world.z, ray.world.data());
            const Mesh& seen = scene.meshes[hit->mesh];
            const bool behind = glm::dot(DVec3(hit->geometric_normal), in_world) > 0;
            const Vec3 albedo = scene.materials[static_cast<std::size_t>(seen.material)].base_color;
            const DVec3 bary(1 - hit->u - hit->v, hit->u, hit->v);
            for (std::size_t c = 0; !behind && c < kColumns; ++c)
                for (int corner = 0; corner < 3; ++corner) {
                    const std::size_t v =
                        seen.triangles[3 * hit->triangle + static_cast<std::size_t>(corner)];
                    ray.light[c] += bary[corner] * double{albedo[static_cast<int>(c % 3)]} *
                                    double{lit.transport[hit->mesh].rows[v * kColumns + c]};
                }
            share += ray.weight;
            for (std::size_t q = 0; q < 16; ++q) mean_basis[q] += ray.weight * ray.world[q];
            blocked.push_back(std::move(ray));
        }
    }
    const std::vector<std::uint16_t>& stored = lit.transport[mesh].reflected;
    const std::size_t row = stored.size() / scene.meshes[mesh].vertex_count();
    Met result{std::vector<double>(49 * kColumns, 0), {}, {}};
    result.mean = result.stored = result.exact;
    for (const Ray& ray : blocked) {
        for (std::size_t c = 0; c < kColumns; ++c) {
            const std::size_t at = vertex * kColumns + c;
            const double mean =
                (double{lit.transport[mesh].rows[at]} - double{lit.direct[mesh].rows[at]}) / share;
            double sent = mean;
            for (std::size_t q = 0; q < row / kColumns; ++q)
                sent += double{runtime::half_to_float(stored[vertex * row + q * kColumns + c])} *
                        (ray.world[q + 1] - mean_basis[q + 1] / share);
            for (std::size_t k = 0; k < 49; ++k) {
                const double weight = ray.weight * ray.local[k];
                result.exact[k * kColumns + c] += weight * ray.light[c];
                result.mean[k * kColumns + c] += weight * mean;
                result.stored[k * kColumns + c] += weight * sent;
            }
        }
    }
    return result;
}

struct TrueErrors {
    double mean = 0, stored = 0;
};

/// rms over every thirteenth vertex of the block and the channels, by the matrices that light
/// becomes.
TrueErrors true_errors(const Scene& scene, const Tracer& tracer, const Lit& lit, double roughness,
                       double r0) {
    const LobeExpansion lobe = expand_lobe({.roughness = {roughness, roughness}});
    const std::size_t a_size = runtime::lobe_size(5, 7), u_size = runtime::lobe_size(5, 5);
    double white = 0;
    for (int m = -4; m <= 4; ++m)
        for (int j = std::abs(m); j < 5; ++j)
            for (int i = std::abs(m); i < 5; ++i) {
                const std::size_t at = runtime::lobe_slot(5, 5, std::abs(m), j, i);
                white +=
                    std::pow(double{lobe.unoccluded[at]} + double{lobe.unoccluded[u_size + at]}, 2);
            }
    const auto squared = [&](const std::vector<double>& x, const std::vector<double>& y) {
        double sum = 0;
        for (int m = -4; m <= 4; ++m)
            for (int j = std::abs(m); j < 5; ++j)
                for (std::size_t c = 0; c < kColumns; ++c) {
                    double difference = 0;
                    for (int k = std::abs(m); k < 7; ++k) {
                        const std::size_t slot = runtime::lobe_slot(5, 7, std::abs(m), j, k);
                        const auto at = static_cast<std::size_t>(sh::index(k, m)) * kColumns + c;
                        difference +=
                            (r0 * double{lobe.kernel[slot]} + double{lobe.kernel[a_size + slot]}) *
                            (x[at] - y[at]);
                    }
                    sum += difference * difference;
                }
        return sum / white / kChannels;
    };
    TrueErrors errors;
    double count = 0;
    for (std::size_t v = 0; v < scene.meshes[1].vertex_count(); v += 13, ++count) {
        const Met of_vertex = met(scene, tracer, lit, v);
        errors.mean += squared(of_vertex.mean, of_vertex.exact);
        errors.stored += squared(of_vertex.stored, of_vertex.exact);
    }
    return {std::sqrt(errors.mean / count), std::sqrt(errors.stored / count)};
}

TEST(LobeLight, IsBakedToTheTolerance) {
    const Scene scene = room_and_block();
    const auto tracer = Tracer::build(scene);
    ASSERT_TRUE(tracer) << tracer.error();
    constexpr double kRoughness = 0.5, kR0 = 0.9, kTolerance = 1e-2;
    const Lit lit = light(scene, *tracer, kRoughness, kR0, kTolerance);
    const LobeLightReport& report = lit.report.lobes.at(0);
    EXPECT_GT(report.bands, 1);
    EXPECT_LT(report.error_rms, kTolerance);
    EXPECT_LE(report.error_rms, report.error_p999);
    EXPECT_TRUE(lit.transport[0].reflected.empty());
    const TrueErrors errors = true_errors(scene, *tracer, lit, kRoughness, kR0);
    EXPECT_LT(errors.stored, 1.2 * report.error_rms);  // of a few of them
    EXPECT_GT(errors.stored, report.error_rms / 4);
    EXPECT_GT(errors.mean, 2 * errors.stored);
}

/// A dielectric's lobe is so weak that the mean is enough for it, and no more rays are followed.
TEST(LobeLight, TheMeanIsEnoughForWeakLobes) {
    const Scene scene = room_and_block();
    const auto tracer = Tracer::build(scene);
    ASSERT_TRUE(tracer) << tracer.error();
    const Lit lit = light(scene, *tracer, 0.6, 0.02, 3e-2);
    const LobeLightReport& report = lit.report.lobes.at(0);
    EXPECT_EQ(report.bands, 1);
    EXPECT_TRUE(lit.transport[1].reflected.empty());
    EXPECT_EQ(report.stride, lit.report.stride);
    const TrueErrors errors = true_errors(scene, *tracer, lit, 0.6, 0.02);
    EXPECT_EQ(errors.mean, errors.stored);
    EXPECT_LT(errors.mean, report.error_rms);
    EXPECT_GT(errors.mean, report.error_rms / 4);
}

/// In a white furnace every direction sends the same.
TEST(LobeLight, AFurnaceHasNoVariation) {
    Scene scene = room_and_block();
    for (Material& material : scene.materials) material.base_color = {1, 1, 1};
    const auto tracer = Tracer::build(scene);
    ASSERT_TRUE(tracer) << tracer.error();
    const Lit lit = light(scene, *tracer, 0.5, 1, 1e-2);
    const std::vector<std::uint16_t>& stored = lit.transport[1].reflected;
    ASSERT_FALSE(stored.empty());
    float worst = 0, largest = 0;
    for (std::size_t i = 0; i < stored.size(); ++i) {
        const float r = std::abs(runtime::half_to_float(stored[i]));
        largest = std::max(largest, r);
        if (i % kColumns < kChannels) worst = std::max(worst, r);  // of a constant sky
    }
    EXPECT_LT(worst, 5e-3f);
    EXPECT_GT(largest, 0.1f);
}

TEST(LobeLight, ChoosesTheFewestBandsThatDo) {
    const LobeLight::Errors errors{1e-3, {5e-3, 3e-3, 2e-3, 1.9e-3}, {2e-2, 1e-2, 9e-3, 8e-3}};
    EXPECT_EQ(choose_bands(errors, 6e-3).bands, 1);
    EXPECT_EQ(choose_bands(errors, 4e-3).bands, 2);
    EXPECT_EQ(choose_bands(errors, 4e-3).error_rms, 3e-3);
    EXPECT_EQ(choose_bands(errors, 4e-3).error_p999, 1e-2);
    EXPECT_EQ(choose_bands(errors, 1e-4).bands, 4);
}

}  // namespace
}  // namespace envbake
