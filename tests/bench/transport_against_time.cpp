// SPDX-License-Identifier: Apache-2.0
// Diffuse transport: error against time, Embree's share of it, and how it scales. CSV, by the first
// argument:
//
// ladder   stage,input,method,setting,cpu_s,worst,rms,energy
//          a ladder of tolerances, beside the two textbook bakers. cpu_s is of the whole scene, all
//          threads; the textbook's is that of 1,000 random vertices, scaled up. worst, rms:
//          relative errors |T - T_true|_2 / |T_unoccluded|_2, against 2^16 rays each
//          (TransportTruth).
// bare     input,tolerance,bare_ns,traced_ns,speed,whole_ns,share
//          ns of CPU a ray: a bare loop of rtcOccluded16 over the rays of some 4,000 vertices (128
//          of a small mesh), the same rays traced and projected by the baker, speed = bare_ns /
//          traced_ns. whole_ns: CPU time of a whole bake over all its rays, those of the check
//          among them, the least of 3; share = bare_ns / whole_ns.
// bounces
// input,tolerance,albedo,channels,direct_s,direct_tighter_s,bounces_s,ratio,bounces,points,stated_rms,true_rms
//          all bounces at albedo 0.5 everywhere: seconds of CPU of a direct bake, of one to the
//          tolerance that is left for it, and of the bounces; ratio of those two to the first. The
//          true rms is of what the bounces add, against a bake to a fifth of the tolerance.
// scaling  input,vertices,threads,wall_s,cpu_us,bare_us
//          one shape at 10^4 .. 10^6 vertices, 448 rays for each: microseconds a vertex
//
// Further arguments: scenes by their name, none: all four; of scaling, the most vertices.
#include "baker/core/parallel.h"
#include "baker/input/read_scene.h"
#include "baker/transport/free_vertices.h"
#include "baker/transport/interreflection.h"
#include "baker/transport/visible_transport.h"
#include "tests/bench/baked_scene.h"
#include "tests/bench/bare_rays.h"
#include "tests/bench/or_exit.h"
#include "tests/bench/sampled_transport.h"
#include "tests/bench/transport_truth.h"
#include "tests/unit/trace/shapes.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <numbers>
#include <optional>
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

/// About one in `step` of the vertices of a mesh that need rays, in runs of neighbours.
std::vector<RayOrigin> traced_origins(const Mesh& mesh, const Tracer& tracer, std::size_t step) {
    constexpr std::size_t kRun = 16;
    std::vector<RayOrigin> origins;
    const SurfacePoints points(mesh);
    for (std::uint32_t v = 0; v < points.size(); ++v) {
        if (points.representative(v) != v || v / kRun % step != 0) continue;
        const RayOrigin origin = points.origin(v, tracer.space());
        if (!is_free(origin, tracer.half_spaces())) origins.push_back(origin);
    }
    return origins;
}

/// Nanoseconds of CPU for one ray: of the bare loop, and of the baker over the same rays.
struct PerRay {
    double bare_ns = 0, traced_ns = 0;
};

/// The least of some runs of each, in turns, so that a busy machine is busy for both.
PerRay per_ray(const RaySet& set, const Tracer& tracer, const BareRays& bare,
               const std::vector<RayOrigin>& origins) {
    PerRay least{1e30, 1e30};
    for (int run = 0; run < 5; ++run) {
        const double turn_rad = run;
        std::vector<float> row(kBands * kBands);
        std::vector<std::size_t> packets;
        std::uint64_t blocked = 0;
        const double start = thread_cpu_seconds();
        for (const RayOrigin& origin : origins) {
            const Traced traced = visible_transport(set, tracer, origin, turn_rad, row);
            packets.push_back(static_cast<std::size_t>(traced.rays / 16));
            blocked += static_cast<std::uint64_t>(traced.blocked);
        }
        const double traced_s = thread_cpu_seconds() - start;
        const BareRays::Result result = bare.trace(set, origins, packets, turn_rad);
        const auto rays = static_cast<double>(result.ray_count);
        // Directions are rounded in another order: a few rays may graze the other side.
        if (std::abs(static_cast<double>(blocked) - static_cast<double>(result.blocked_count)) >
            1 + 1e-4 * rays)
            std::fprintf(stderr, "%llu and %llu rays blocked: not the same rays\n",
                         static_cast<unsigned long long>(blocked),
                         static_cast<unsigned long long>(result.blocked_count));
        least.bare_ns = std::min(least.bare_ns, 1e9 * result.cpu_s / rays);
        least.traced_ns = std::min(least.traced_ns, 1e9 * traced_s / rays);
    }
    return least;
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

void measure_bare(const std::string& input, const Scene& scene, const Tracer& tracer) {
    const BareRays bare(scene, tracer.space());
    for (const double tolerance : {1e-2, 3.5e-3}) {
        std::vector<BakedMesh> baked;
        double whole_s = 1e30;  // the least of some runs here, too
        for (int run = 0; run < 3; ++run) {
            const double begin = cpu_seconds();
            auto bake = bake_scene({.bands = kBands, .tolerance = tolerance}, scene, tracer);
            if (!bake) return;
            whole_s = std::min(whole_s, cpu_seconds() - begin);
            baked = std::move(*bake);
        }
        double ray_count = 0, bare_s = 0, traced_s = 0;
        for (std::size_t m = 0; m < scene.meshes.size(); ++m) {
            const DiffuseReport& report = baked[m].report;
            if (report.traced_count == 0) continue;
            const RaySet set =
                make_ray_set(report.rays_per_vertex, kBands, report.solved_count > 0);
            const std::size_t step =
                std::min(vertices_of(scene) / 4000, scene.meshes[m].vertex_count() / 128);
            const auto origins = traced_origins(scene.meshes[m], tracer, step + 1);
            if (origins.empty()) continue;
            const PerRay least = per_ray(set, tracer, bare, origins);
            const auto rays = static_cast<double>(report.ray_count + report.check_ray_count);
            ray_count += rays;
            bare_s += 1e-9 * rays * least.bare_ns;
            traced_s += 1e-9 * rays * least.traced_ns;
        }
        std::printf("%s,%g,%.1f,%.1f,%.3f,%.1f,%.3f\n", input.c_str(), tolerance,
                    1e9 * bare_s / ray_count, 1e9 * traced_s / ray_count, bare_s / traced_s,
                    1e9 * whole_s / ray_count, bare_s / whole_s);
        std::fflush(stdout);
    }
}

struct Bounced {
    std::vector<MeshTransport> transport;
    BounceReport report;
    double direct_s = 0, bounces_s = 0;
};
std::optional<Bounced> bake_bounced(const Scene& scene, const Tracer& tracer, double tolerance,
                                    int channels) {
    Bounced bounced;
    bounced.transport.resize(scene.meshes.size());
    std::vector<BlockedRays> blocked(scene.meshes.size());
    Progress progress;
    const double begin = cpu_seconds();
    for (std::size_t m = 0; m < scene.meshes.size(); ++m) {
        std::vector<float>& kept = bounced.transport[m].rows;
        kept.reserve(scene.meshes[m].vertex_count() * kBands * kBands *
                     static_cast<std::size_t>(channels));
        const auto report = bake_diffuse(
            {.bands = kBands, .tolerance = kDirectShare * tolerance}, scene, m, tracer,
            [&](std::span<const float> rows) -> Expected<void> {
                for (const float value : rows)
                    for (int c = 0; c < channels; ++c) kept.push_back(value);
                return {};
            },
            progress, &blocked[m]);
        if (!report) return std::nullopt;
    }
    bounced.direct_s = cpu_seconds() - begin;
    bounced.report = add_bounces({.bands = kBands, .channels = channels, .tolerance = tolerance},
                                 scene, tracer, blocked, bounced.transport, progress);
    bounced.bounces_s = cpu_seconds() - begin - bounced.direct_s;
    return bounced;
}

void measure_bounces(const std::string& input, Scene& scene, const Tracer& tracer) {
    for (Material& material : scene.materials) {
        material.base_color = Vec3(0.5f);
        material.metallic = 0;
        material.base_color_texture.reset();
    }
    for (Mesh& mesh : scene.meshes) mesh.colors.clear();
    for (const double tolerance : {1e-2, 3.5e-3}) {
        const auto truth = bake_bounced(scene, tracer, tolerance / 5, 1);
        if (!truth) return;
        for (const int channels : {1, 3}) {
            double direct_s = 1e30;
            std::optional<Bounced> least;
            for (int run = 0; run < 3; ++run) {
                const double begin = cpu_seconds();
                if (!bake_scene({.bands = kBands, .tolerance = tolerance}, scene, tracer)) return;
                direct_s = std::min(direct_s, cpu_seconds() - begin);
                auto bounced = bake_bounced(scene, tracer, tolerance, channels);
                if (!bounced) return;
                if (!least ||
                    bounced->direct_s + bounced->bounces_s < least->direct_s + least->bounces_s)
                    least = std::move(bounced);
            }
            double squares = 0;
            std::size_t count = 0;
            for (std::size_t m = 0; m < scene.meshes.size(); ++m) {
                const std::vector<float>& rows = truth->transport[m].rows;
                for (std::size_t i = 0; i < rows.size(); ++i)
                    squares += std::pow(
                        static_cast<double>(rows[i]) -
                            static_cast<double>(
                                least->transport[m].rows[i * static_cast<std::size_t>(channels)]),
                        2);
                count += rows.size() / (kBands * kBands);
            }
            const BounceReport& r = least->report;
            std::printf("%s,%g,0.5,%d,%.3f,%.3f,%.3f,%.3f,%d,%.1f,%.3e,%.3e\n", input.c_str(),
                        tolerance, channels, direct_s, least->direct_s, least->bounces_s,
                        (least->direct_s + least->bounces_s) / direct_s, r.bounces,
                        static_cast<double>(r.point_count) / static_cast<double>(count),
                        r.error_rms,
                        std::sqrt(squares / static_cast<double>(count)) / unoccluded_norm(kBands));
            std::fflush(stdout);
        }
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

void measure_scaling(double most_vertices) {
    constexpr int kRays = 448;
    const RaySet set = make_ray_set(kRays, kBands);
    for (const int level : {5, 6, 7, 8}) {
        const Scene scene = test::scene_of({bumpy_ball(level)});
        if (static_cast<double>(vertices_of(scene)) > most_vertices) break;
        const auto tracer = Tracer::build(scene);
        if (!tracer) return;
        const auto count = static_cast<double>(vertices_of(scene));
        const auto origins =
            traced_origins(scene.meshes[0], *tracer, vertices_of(scene) / 4000 + 1);
        const BareRays bare(scene, tracer->space());
        const double bare_us = 1e-3 * kRays * per_ray(set, *tracer, bare, origins).bare_ns;
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
        bench::measure_scaling(argc > 2 ? std::atof(argv[2]) : 1e6);
        return 0;
    }
    if (what == "ladder") {
        std::puts("stage,input,method,setting,cpu_s,worst,rms,energy");
    } else if (what == "bare") {
        std::puts("input,tolerance,bare_ns,traced_ns,speed,whole_ns,share");
    } else if (what == "bounces") {
        std::puts(
            "input,tolerance,albedo,channels,direct_s,direct_tighter_s,bounces_s,ratio,bounces,"
            "points,"
            "stated_rms,true_rms");
    } else {
        std::fprintf(
            stderr,
            "transport_against_time ladder|bare|bounces [SCENE...] | scaling [MOST_VERTICES]\n");
        return 2;
    }
    std::vector<std::string> names(argv + 2, argv + argc);
    if (names.empty())
        names = {"stanford_bunny", "shader_ball", "dungeon_hall", "japanese_bridge_garden"};
    for (const std::string& name : names) {
        Scene scene = bench::or_exit(
            read_scene(std::filesystem::path(ENVBAKE_TEST_DATA) / "meshes" / (name + ".glb"),
                       {.textures = false}));
        const Tracer tracer = bench::or_exit(Tracer::build(scene));
        if (what == "ladder") bench::measure_ladder(name, scene, tracer);
        if (what == "bare") bench::measure_bare(name, scene, tracer);
        if (what == "bounces") bench::measure_bounces(name, scene, tracer);
    }
}
