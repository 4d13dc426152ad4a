// SPDX-License-Identifier: Apache-2.0
// Holds the error that a diffuse bake states against the true one, as CSV:
//
//     scene,tolerance,vertices,rays,check_rays,cpu_us,true_rms,stated_rms,true_p999,stated_p999
//
// rays, check_rays, cpu_us  a vertex of the whole scene; CPU time of all threads
// true_...                  of 2,000 random vertices of the scene, against 2^16 rays each
// stated_...                what the reports of its meshes say, taken together
//
//     transport_check [--meshes] SCENE TOLERANCE...
//
// --meshes: instead, every vertex of every mesh of at most 1,000 vertices against 2^14 rays, a line
// a mesh.
#include "baker/core/parallel.h"
#include "baker/input/read_scene.h"
#include "baker/transport/diffuse.h"
#include "tests/bench/transport_truth.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <limits>
#include <optional>
#include <random>
#include <string>
#include <vector>

namespace envbake::bench {
namespace {

constexpr int kBands = 5;
constexpr std::size_t kCoeffs = kBands * kBands;

double cpu_seconds() {
    return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

struct Place {
    std::size_t mesh;
    std::uint32_t vertex;
};

struct BakedMesh {
    DiffuseReport report;
    std::vector<float> rows;
};

Expected<std::vector<BakedMesh>> bake(const DiffuseJob& job, const Scene& scene,
                                      const Tracer& tracer) {
    std::vector<BakedMesh> meshes(scene.meshes.size());
    for (std::size_t m = 0; m < meshes.size(); ++m) {
        Progress progress;
        ENVBAKE_TRY(meshes[m].report, bake_diffuse(
                                          job, scene, m, tracer,
                                          [&](std::span<const float> rows) -> Expected<void> {
                                              meshes[m].rows.insert(meshes[m].rows.end(),
                                                                    rows.begin(), rows.end());
                                              return {};
                                          },
                                          progress));
    }
    return meshes;
}

/// Relative errors of those places.
std::vector<double> errors_of(const std::vector<BakedMesh>& baked, const std::vector<Place>& places,
                              const std::vector<std::vector<double>>& truth, double norm) {
    std::vector<double> errors;
    for (std::size_t i = 0; i < places.size(); ++i) {
        const float* row = &baked[places[i].mesh].rows[places[i].vertex * kCoeffs];
        double square = 0;
        for (std::size_t c = 0; c < kCoeffs; ++c)
            square += (static_cast<double>(row[c]) - truth[i][c]) *
                      (static_cast<double>(row[c]) - truth[i][c]);
        errors.push_back(std::sqrt(square) / norm);
    }
    return errors;
}
double rms(const std::vector<double>& errors) {
    double sum = 0;
    for (const double e : errors) sum += e * e;
    return errors.empty() ? 0 : std::sqrt(sum / static_cast<double>(errors.size()));
}
double p999(std::vector<double> errors) {
    if (errors.empty()) return 0;
    std::sort(errors.begin(), errors.end());
    return errors[static_cast<std::size_t>(0.999 * static_cast<double>(errors.size()))];
}

std::vector<std::vector<double>> find_truth(const Scene& scene, const Tracer& tracer,
                                            const std::vector<Place>& places, int log_rays) {
    const TransportTruth truth(kBands);
    std::vector<SurfacePoints> points;
    for (const Mesh& mesh : scene.meshes) points.emplace_back(mesh);
    std::vector<std::vector<double>> rows(places.size());
    parallel_for(places.size(), [&](std::size_t i) {
        const SurfacePoints& surface = points[places[i].mesh];
        const std::uint32_t place = surface.representative(places[i].vertex);
        rows[i] = place == SurfacePoints::kNone
                      ? std::vector<double>(kCoeffs, 0)
                      : truth.at(surface.origin(place, tracer.space()), tracer,
                                 0x7275746800000000u + i, log_rays);
    });
    return rows;
}

int check_scene(const std::string& name, const Scene& scene, const Tracer& tracer,
                const std::vector<double>& tolerances) {
    std::vector<Place> all;
    for (std::size_t m = 0; m < scene.meshes.size(); ++m)
        for (std::uint32_t v = 0; v < scene.meshes[m].vertex_count(); ++v) all.push_back({m, v});
    std::vector<Place> places;
    std::sample(all.begin(), all.end(), std::back_inserter(places), 2000, std::mt19937(1));
    const auto truth = find_truth(scene, tracer, places, TransportTruth::kLogRays);
    const double norm = TransportTruth(kBands).unoccluded_norm();
    std::puts(
        "scene,tolerance,vertices,rays,check_rays,cpu_us,true_rms,stated_rms,true_p999,"
        "stated_p999");
    for (const double tolerance : tolerances) {
        double least = std::numeric_limits<double>::max();
        std::vector<BakedMesh> baked;
        for (int run = 0; run < 3; ++run) {
            const double begin = cpu_seconds();
            auto result = bake({.bands = kBands, .tolerance = tolerance}, scene, tracer);
            if (!result) {
                std::fprintf(stderr, "%s\n", result.error().message.c_str());
                return 1;
            }
            least = std::min(least, cpu_seconds() - begin);
            baked = std::move(*result);
        }
        double rays = 0, check_rays = 0, square = 0, stated_p999 = 0;
        for (const BakedMesh& mesh : baked) {
            const DiffuseReport& r = mesh.report;
            rays += static_cast<double>(r.ray_count);
            check_rays += static_cast<double>(r.check_ray_count);
            square += r.error_rms * r.error_rms * static_cast<double>(r.vertex_count);
            stated_p999 = std::max(stated_p999, r.error_p999);
        }
        const auto count = static_cast<double>(all.size());
        const std::vector<double> errors = errors_of(baked, places, truth, norm);
        std::printf("%s,%g,%zu,%.1f,%.1f,%.2f,%.3e,%.3e,%.3e,%.3e\n", name.c_str(), tolerance,
                    all.size(), rays / count, check_rays / count, 1e6 * least / count, rms(errors),
                    std::sqrt(square / count), p999(errors), stated_p999);
        std::fflush(stdout);
    }
    return 0;
}

int check_meshes(const Scene& scene, const Tracer& tracer, const std::vector<double>& tolerances) {
    std::vector<Place> places;
    std::vector<std::size_t> first(scene.meshes.size() + 1, 0);
    for (std::size_t m = 0; m < scene.meshes.size(); ++m) {
        const std::size_t count = scene.meshes[m].vertex_count();
        if (count <= 1000)
            for (std::uint32_t v = 0; v < count; ++v) places.push_back({m, v});
        first[m + 1] = places.size();
    }
    const auto truth = find_truth(scene, tracer, places, 14);
    const double norm = TransportTruth(kBands).unoccluded_norm();
    std::puts("mesh,tolerance,vertices,rays,true_rms,stated_rms,true_p999,stated_p999");
    for (const double tolerance : tolerances) {
        const auto baked = bake({.bands = kBands, .tolerance = tolerance}, scene, tracer);
        if (!baked) return 1;
        const std::vector<double> errors = errors_of(*baked, places, truth, norm);
        int meshes = 0, low = 0, high = 0;
        for (std::size_t m = 0; m < scene.meshes.size(); ++m) {
            const std::vector<double> own(
                errors.begin() + static_cast<std::ptrdiff_t>(first[m]),
                errors.begin() + static_cast<std::ptrdiff_t>(first[m + 1]));
            if (own.empty()) continue;
            const DiffuseReport& r = (*baked)[m].report;
            std::printf("%zu,%g,%zu,%.1f,%.3e,%.3e,%.3e,%.3e\n", m, tolerance, own.size(),
                        static_cast<double>(r.ray_count) / static_cast<double>(own.size()),
                        rms(own), r.error_rms, p999(own), r.error_p999);
            ++meshes;
            low += rms(own) > 1.1 * r.error_rms;
            high += rms(own) > 1.1 * tolerance;
        }
        std::fprintf(
            stderr,
            "tolerance %g: of %d meshes %d state a tenth too little, %d miss the tolerance "
            "by a tenth\n",
            tolerance, meshes, low, high);
    }
    return 0;
}

}  // namespace
}  // namespace envbake::bench

int main(int argc, char** argv) {
    using namespace envbake;
    int at = 1;
    const bool by_mesh = at < argc && std::strcmp(argv[at], "--meshes") == 0;
    at += by_mesh;
    if (argc - at < 2) {
        std::fprintf(stderr, "transport_check [--meshes] SCENE TOLERANCE...\n");
        return 2;
    }
    const std::filesystem::path file = argv[at++];
    const auto scene = read_scene(file, {.textures = false});
    if (!scene) {
        std::fprintf(stderr, "%s\n", scene.error().message.c_str());
        return 1;
    }
    const auto tracer = Tracer::build(*scene);
    if (!tracer) {
        std::fprintf(stderr, "%s\n", tracer.error().message.c_str());
        return 1;
    }
    std::vector<double> tolerances;
    for (; at < argc; ++at) tolerances.push_back(std::atof(argv[at]));
    return by_mesh ? bench::check_meshes(*scene, *tracer, tolerances)
                   : bench::check_scene(file.stem().string(), *scene, *tracer, tolerances);
}
