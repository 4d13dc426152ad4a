// SPDX-License-Identifier: Apache-2.0
// Holds the error that a diffuse bake states against the true one, as CSV:
//
//     scene,tolerance,vertices,rays,check_rays,solved,cpu_us,true_rms,stated_rms,true_p999,stated_p999
//
// rays, check_rays, cpu_us  a vertex of the whole scene; CPU time of all threads
// solved                    share of the vertices that need rays, where a pilot told the answer
// true_...                  of 2,000 random vertices of the scene, against 2^16 rays each
// stated_...                what the reports of its meshes say, taken together
//
//     transport_check [--meshes] SCENE TOLERANCE...
//
// --meshes: instead, every vertex of every mesh of at most 1,000 vertices against 2^14 rays, a line
// a mesh.
#include "baker/input/read_scene.h"
#include "tests/bench/baked_scene.h"
#include "tests/bench/or_exit.h"
#include "tests/bench/transport_truth.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

namespace envbake::bench {
namespace {

constexpr int kBands = 5;

double cpu_seconds() {
    return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

int check_scene(const std::string& name, const Scene& scene, const Tracer& tracer,
                const std::vector<double>& tolerances) {
    const std::vector<Place> places = random_places(scene, 2000);
    const auto truth = find_truth(kBands, scene, tracer, places, TransportTruth::kLogRays);
    std::size_t vertex_count = 0;
    for (const Mesh& mesh : scene.meshes) vertex_count += mesh.vertex_count();
    std::puts(
        "scene,tolerance,vertices,rays,check_rays,solved,cpu_us,true_rms,stated_rms,true_p999,"
        "stated_p999");
    for (const double tolerance : tolerances) {
        double least = std::numeric_limits<double>::max();
        std::vector<BakedMesh> baked;
        for (int run = 0; run < 3; ++run) {
            const double begin = cpu_seconds();
            baked = or_exit(bake_scene({.bands = kBands, .tolerance = tolerance}, scene, tracer));
            least = std::min(least, cpu_seconds() - begin);
        }
        double rays = 0, check_rays = 0, solved = 0, traced = 0, square = 0, stated_p999 = 0;
        for (const BakedMesh& mesh : baked) {
            const DiffuseReport& r = mesh.report;
            rays += static_cast<double>(r.ray_count);
            check_rays += static_cast<double>(r.check_ray_count);
            solved += static_cast<double>(r.solved_count);
            traced += static_cast<double>(r.traced_count);
            square += r.error_rms * r.error_rms * static_cast<double>(r.vertex_count);
            stated_p999 = std::max(stated_p999, r.error_p999);
        }
        const auto count = static_cast<double>(vertex_count);
        const std::vector<double> errors = errors_of(baked, places, truth);
        std::printf("%s,%g,%zu,%.1f,%.1f,%.3f,%.2f,%.3e,%.3e,%.3e,%.3e\n", name.c_str(), tolerance,
                    vertex_count, rays / count, check_rays / count, solved / traced,
                    1e6 * least / count, rms(errors), std::sqrt(square / count), p999(errors),
                    stated_p999);
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
    const auto truth = find_truth(kBands, scene, tracer, places, 14);
    std::puts("mesh,tolerance,vertices,rays,true_rms,stated_rms,true_p999,stated_p999");
    for (const double tolerance : tolerances) {
        const auto baked = bake_scene({.bands = kBands, .tolerance = tolerance}, scene, tracer);
        if (!baked) return 1;
        const std::vector<double> errors = errors_of(*baked, places, truth);
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
    const Scene scene = bench::or_exit(read_scene(file, {.textures = false}));
    const Tracer tracer = bench::or_exit(Tracer::build(scene));
    std::vector<double> tolerances;
    for (; at < argc; ++at) tolerances.push_back(std::atof(argv[at]));
    return by_mesh ? bench::check_meshes(scene, tracer, tolerances)
                   : bench::check_scene(file.stem().string(), scene, tracer, tolerances);
}
