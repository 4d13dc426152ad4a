// SPDX-License-Identifier: Apache-2.0
// Diffuse transport: error against time, Embree's share of it, and how it scales. CSV, by the first
// argument:
//
// ladder   stage,input,method,setting,cpu_s,worst,rms,energy
//          a ladder of tolerances, beside the two textbook bakers. cpu_s is of the whole scene, all
//          threads; the textbook's is that of 1,000 random vertices, scaled up. worst, rms:
//          relative errors |T - T_true|_2 / |T_unoccluded|_2, against 2^16 rays each
//          (TransportTruth).
// bare     input,rays,bare_ns,traced_ns,speed,whole_ns,share
//          ns of CPU a ray: a bare loop of rtcOccluded16 over a vertex' rays, the same rays traced
//          and projected by the baker, speed = bare_ns / traced_ns. whole_ns: CPU time of a whole
//          bake over all its rays, those of the check among them; share = bare_ns / whole_ns.
// scaling  input,vertices,threads,wall_s,cpu_us,bare_us
//          one shape at 10^4 .. 10^6 vertices, 448 rays for each: microseconds a vertex
//
// Further arguments: scenes by their name; none: all four.
#include "baker/core/parallel.h"
#include "baker/input/read_scene.h"
#include "baker/transport/free_vertices.h"
#include "baker/transport/visible_transport.h"
#include "tests/bench/baked_scene.h"
#include "tests/bench/bare_rays.h"
#include "tests/bench/sampled_transport.h"
#include "tests/bench/transport_truth.h"
#include "tests/unit/trace/shapes.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <numbers>
#include <string>
#include <vector>

namespace envbake::bench {
namespace {

constexpr int kBands = 5;

double cpu_seconds() {
    return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}
std::size_t vertices_of(const Scene& scene) {
    std::size_t count = 0;
    for (const Mesh& mesh : scene.meshes) count += mesh.vertex_count();
    return count;
}

/// Origins of vertices that need rays, in runs of `run` neighbours spread over the scene.
std::vector<RayOrigin> traced_origins(const Scene& scene, const Tracer& tracer, std::size_t count,
                                      std::size_t run) {
    std::vector<RayOrigin> all, some;
    for (const Mesh& mesh : scene.meshes) {
        const SurfacePoints points(mesh);
        for (std::uint32_t v = 0; v < points.size(); ++v) {
            if (points.representative(v) != v) continue;
            const RayOrigin origin = points.origin(v, tracer.space());
            if (!is_free(origin, tracer.half_spaces())) all.push_back(origin);
        }
    }
    const std::size_t step = std::max(run, all.size() * run / count);
    for (std::size_t begin = 0; begin < all.size(); begin += step)
        for (std::size_t i = begin; i < std::min(begin + run, all.size()); ++i)
            some.push_back(all[i]);
    return some;
}

void print(const std::string& input, const char* method, double setting, double seconds,
           const std::vector<double>& errors) {
    std::printf("transport,%s,%s,%g,%.4g,%.3g,%.3g,0\n", input.c_str(), method, setting, seconds,
                *std::max_element(errors.begin(), errors.end()), rms(errors));
    std::fflush(stdout);
}

void measure_ladder(const std::string& input, const Scene& scene, const Tracer& tracer) {
    const std::vector<Place> places = random_places(scene, 2000);
    const auto truth = find_truth(kBands, scene, tracer, places, TransportTruth::kLogRays);
    for (const double tolerance : {3e-2, 1e-2, 3.5e-3, 1.5e-3}) {
        const double begin = cpu_seconds();
        const auto baked = bake_scene({.bands = kBands, .tolerance = tolerance}, scene, tracer);
        if (!baked) return;
        print(input, "envbake", tolerance, cpu_seconds() - begin, errors_of(*baked, places, truth));
    }
    std::vector<SurfacePoints> points;
    for (const Mesh& mesh : scene.meshes) points.emplace_back(mesh);
    const double norm = TransportTruth(kBands).unoccluded_norm();
    constexpr std::size_t kSampled = 1000;
    for (const Samples samples : {Samples::Independent, Samples::Jittered}) {
        for (const int grid : {16, 32, 64, 128}) {
            std::vector<double> errors;
            const double begin = cpu_seconds();
            for (std::size_t i = 0; i < kSampled; ++i) {
                const SurfacePoints& surface = points[places[i].mesh];
                const std::uint32_t place = surface.representative(places[i].vertex);
                if (place == SurfacePoints::kNone) continue;
                const auto row = sampled_transport(
                    samples, grid, kBands, surface.origin(place, tracer.space()), tracer, i);
                double square = 0;
                for (std::size_t c = 0; c < row.size(); ++c)
                    square += std::pow(static_cast<double>(row[c]) - truth[i][c], 2);
                errors.push_back(std::sqrt(square) / norm);
            }
            print(input, samples == Samples::Jittered ? "jittered grid" : "independent rays",
                  grid * grid,
                  (cpu_seconds() - begin) * static_cast<double>(vertices_of(scene)) / kSampled,
                  errors);
        }
    }
}

/// The least of some runs of each, in turns, so that a busy machine is busy for both.
void measure_bare(const std::string& input, const Scene& scene, const Tracer& tracer) {
    const BareRays bare(scene, tracer.space());
    const std::vector<RayOrigin> origins = traced_origins(scene, tracer, 3000, 64);
    for (const double tolerance : {1e-2, 3.5e-3}) {
        const double begin = cpu_seconds();
        const auto baked = bake_scene({.bands = kBands, .tolerance = tolerance}, scene, tracer);
        if (!baked) return;
        const double whole = cpu_seconds() - begin;
        double rays = 0, full = 0;
        for (const BakedMesh& mesh : *baked) {
            rays += static_cast<double>(mesh.report.ray_count + mesh.report.check_ray_count);
            full = std::max(full, static_cast<double>(mesh.report.rays_per_vertex));
        }
        const RaySet set = make_ray_set(static_cast<int>(full), kBands);
        double least_bare = 1e30, least_traced = 1e30;
        for (int run = 0; run < 5; ++run) {
            const double turn_rad = run;
            const BareRays::Result result = bare.trace(set, origins, turn_rad);
            least_bare = std::min(least_bare, result.cpu_s);
            std::vector<float> row(kBands * kBands);
            std::uint64_t blocked = 0;
            const double start = thread_cpu_seconds();
            for (const RayOrigin& origin : origins)
                blocked += static_cast<std::uint64_t>(
                    visible_transport(set, tracer, origin, turn_rad, row).blocked);
            least_traced = std::min(least_traced, thread_cpu_seconds() - start);
            // Directions are rounded in another order: a few rays may graze the other side.
            if (std::abs(static_cast<double>(blocked) - static_cast<double>(result.blocked_count)) >
                1e-4 * static_cast<double>(result.ray_count))
                std::fprintf(stderr, "%s: %llu and %llu rays blocked: not the same rays\n",
                             input.c_str(), static_cast<unsigned long long>(blocked),
                             static_cast<unsigned long long>(result.blocked_count));
        }
        const double per_ray =
            1e9 / (static_cast<double>(origins.size()) * static_cast<double>(set.ray_count));
        std::printf("%s,%d,%.1f,%.1f,%.3f,%.1f,%.3f\n", input.c_str(), set.ray_count,
                    least_bare * per_ray, least_traced * per_ray, least_bare / least_traced,
                    1e9 * whole / rays, least_bare * per_ray / (1e9 * whole / rays));
        std::fflush(stdout);
    }
}

/// A ball with bumps and dents of a tenth of its radius, level subdivisions of an octahedron.
Mesh bumpy_ball(int level) {
    Mesh mesh = test::sphere({0, 0, 0}, 1, level);
    for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
        const DVec3 p = mesh.positions[v];
        const DVec3 a = 9.0 * p;
        mesh.positions[v] *= static_cast<float>(
            1 + 0.1 * std::sin(a.x) * std::sin(a.y) * std::sin(a.z) + 0.05 * std::sin(2 * a.y));
        mesh.normals[v] = Vec3(0);
    }
    for (std::size_t i = 0; i < mesh.triangles.size(); i += 3) {
        const std::uint32_t* corner = &mesh.triangles[i];
        const Vec3 cross = glm::cross(mesh.positions[corner[1]] - mesh.positions[corner[0]],
                                      mesh.positions[corner[2]] - mesh.positions[corner[0]]);
        for (int k = 0; k < 3; ++k) mesh.normals[corner[k]] += cross;
    }
    for (Vec3& n : mesh.normals) n = glm::normalize(n);
    return mesh;
}

void measure_scaling() {
    constexpr int kRays = 448;
    const RaySet set = make_ray_set(kRays, kBands);
    for (const int level : {5, 6, 7, 8}) {
        const Scene scene = test::scene_of({bumpy_ball(level)});
        const auto tracer = Tracer::build(scene);
        if (!tracer) return;
        const auto count = static_cast<double>(vertices_of(scene));
        const std::vector<RayOrigin> origins = traced_origins(scene, *tracer, 3000, 64);
        const BareRays bare(scene, tracer->space());
        double bare_us = 1e30;
        for (int run = 0; run < 3; ++run)
            bare_us = std::min(bare_us, 1e6 * bare.trace(set, origins, run).cpu_s /
                                            static_cast<double>(origins.size()));
        for (const int threads : {1, 2, 4, 8}) {
            if (threads > thread_count()) break;
            const ThreadLimit limit(threads);
            const auto wall = std::chrono::steady_clock::now();
            const double begin = cpu_seconds();
            std::uint64_t sent = 0;
            Progress progress;
            const auto report = bake_diffuse(
                {.bands = kBands, .rays_per_vertex = kRays}, scene, 0, *tracer,
                [&](std::span<const float> rows) -> Expected<void> {
                    sent += rows.size();
                    return {};
                },
                progress);
            if (!report) return;
            const double cpu = cpu_seconds() - begin;
            std::printf(
                "bumpy ball,%.0f,%d,%.3f,%.2f,%.2f\n", count, threads,
                std::chrono::duration<double>(std::chrono::steady_clock::now() - wall).count(),
                1e6 * cpu / static_cast<double>(report->traced_count), bare_us);
            std::fflush(stdout);
        }
    }
}

}  // namespace
}  // namespace envbake::bench

int main(int argc, char** argv) {
    using namespace envbake;
    const std::string what = argc > 1 ? argv[1] : "";
    if (what == "scaling") {
        std::puts("input,vertices,threads,wall_s,cpu_us,bare_us");
        bench::measure_scaling();
        return 0;
    }
    if (what == "ladder") {
        std::puts("stage,input,method,setting,cpu_s,worst,rms,energy");
    } else if (what == "bare") {
        std::puts("input,rays,bare_ns,traced_ns,speed,whole_ns,share");
    } else {
        std::fprintf(stderr, "transport_against_time ladder|bare|scaling [SCENE...]\n");
        return 2;
    }
    std::vector<std::string> names(argv + 2, argv + argc);
    if (names.empty())
        names = {"stanford_bunny", "shader_ball", "dungeon_hall", "japanese_bridge_garden"};
    for (const std::string& name : names) {
        const auto scene =
            read_scene(std::filesystem::path(ENVBAKE_TEST_DATA) / "meshes" / (name + ".glb"),
                       {.textures = false});
        if (!scene) {
            std::fprintf(stderr, "%s\n", scene.error().message.c_str());
            return 1;
        }
        const auto tracer = Tracer::build(*scene);
        if (!tracer) {
            std::fprintf(stderr, "%s\n", tracer.error().message.c_str());
            return 1;
        }
        (what == "ladder" ? bench::measure_ladder : bench::measure_bare)(name, *scene, *tracer);
    }
}
