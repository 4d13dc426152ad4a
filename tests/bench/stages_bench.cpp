// SPDX-License-Identifier: Apache-2.0
// Time of every stage beside the error it states, on real input. Arguments: threads, then what the
// name says. Run with --benchmark_format=csv for a table.
#include "baker/brdf/table.h"
#include "baker/core/parallel.h"
#include "baker/core/progress.h"
#include "baker/input/read_environment.h"
#include "baker/input/read_scene.h"
#include "baker/lighting/mips.h"
#include "baker/lighting/sh_projection.h"
#include "baker/transport/diffuse.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <filesystem>
#include <string>

namespace envbake {
namespace {

std::filesystem::path data(const std::string& relative) {
    return std::filesystem::path(ENVBAKE_TEST_DATA) / relative;
}

void sh_lighting(benchmark::State& state, const std::string& file) {
    const auto environment = read_environment(data(file));
    if (!environment) return state.SkipWithError(environment.error().message.c_str());
    const ThreadLimit limit(static_cast<int>(state.range(0)));
    const ShLightingJob job{static_cast<int>(state.range(1))};
    for (auto _ : state) benchmark::DoNotOptimize(project_sh(job, *environment));
}

void mips(benchmark::State& state, const std::string& file) {
    const auto environment = read_environment(data(file));
    if (!environment) return state.SkipWithError(environment.error().message.c_str());
    const ThreadLimit limit(static_cast<int>(state.range(0)));
    const MipsJob job{.perceptual_roughness = {0, 0.25f, 0.5f, 0.75f, 1},
                      .levels = {0, 1, 2, 3, 4},
                      .tolerance = 1.0 / static_cast<double>(state.range(1))};
    double error = 0;
    for (auto _ : state) {
        Progress progress;
        for (const Mip& mip : bake_mips(job, *environment, progress))
            error = std::max(error, mip.error_estimate);
    }
    state.counters["stated_error"] = error;
}

void brdf_table(benchmark::State& state) {
    const ThreadLimit limit(static_cast<int>(state.range(0)));
    BrdfTable table;
    for (auto _ : state) table = bake_brdf_table({.size = static_cast<int>(state.range(1))});
    state.counters["texel_error"] = table.texel_error;
    state.counters["lookup_error"] = table.lookup_error;
    state.counters["lookup_rms"] = table.lookup_error_rms;
}

void diffuse(benchmark::State& state, const std::string& file) {
    const auto scene = read_scene(data(file), {.textures = false});
    if (!scene) return state.SkipWithError(scene.error().message.c_str());
    const ThreadLimit limit(static_cast<int>(state.range(0)));
    const auto tracer = Tracer::build(*scene);
    if (!tracer) return state.SkipWithError(tracer.error().message.c_str());
    const DiffuseJob job{.tolerance = 1.0 / static_cast<double>(state.range(1))};
    DiffuseReport last;
    std::uint64_t vertices = 0;
    for (auto _ : state) {
        for (std::size_t mesh = 0; mesh < scene->meshes.size(); ++mesh) {
            Progress progress;
            const auto report = bake_diffuse(
                job, *scene, mesh, *tracer,
                [](std::span<const float>) -> Expected<void> { return {}; }, progress);
            if (!report) return state.SkipWithError(report.error().message.c_str());
            last = *report;
            vertices += report->vertex_count;
        }
    }
    state.counters["stated_rms"] = last.error_rms;
    state.counters["rays"] = last.rays_per_vertex;
    state.counters["per_vertex"] = benchmark::Counter(
        static_cast<double>(vertices), benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

}  // namespace
}  // namespace envbake

int main(int argc, char** argv) {
    using namespace envbake;
    const auto add = [](const std::string& name, auto function, auto... arguments) {
        return benchmark::RegisterBenchmark(name.c_str(), function, arguments...)
            ->Unit(benchmark::kMillisecond)
            ->UseRealTime()
            ->MeasureProcessCPUTime();
    };
    const std::string sunny = "environments/kloppenheim_05_1k.hdr";
    const std::string overcast = "environments/potsdamer_platz_1k.hdr";
    add("sh/threads/bands", sh_lighting, sunny)->Args({1, 5})->Args({1, 10})->Args({2, 5});
    for (const auto& [name, file] : {std::pair{"mips/sunny", sunny}, {"mips/overcast", overcast}})
        add(std::string(name) + "/threads/1_over_tolerance", mips, file)
            ->Args({1, 33})
            ->Args({1, 100})
            ->Args({1, 1000})
            ->Args({2, 100});
    add("brdf_ggx/threads/size", brdf_table)->Args({1, 64})->Args({1, 128})->Args({2, 64});
    add("diffuse/bunny/threads/1_over_tolerance", diffuse, std::string("meshes/stanford_bunny.glb"))
        ->Args({1, 33})
        ->Args({1, 100})
        ->Args({1, 300})
        ->Args({2, 100});
    benchmark::Initialize(&argc, argv);
    benchmark::RunSpecifiedBenchmarks();
}
