// SPDX-License-Identifier: Apache-2.0
// Shading on the CPU from glossy transport, in multiply-adds beside what this build's own
// arithmetic can do. One thread. Run with --benchmark_format=csv for a table.
#include "envbake/runtime/glossy.h"
#include "envbake/runtime/half.h"
#include "envbake/runtime/sh.h"

#include <benchmark/benchmark.h>

#include <cmath>
#include <memory>
#include <random>
#include <vector>

namespace envbake::runtime {
namespace {

/// Any numbers will do: nothing branches on them.
struct Content {
    static constexpr int kExit = 5, kLight = 5;
    static constexpr std::uint64_t kVertices = 10000;
    std::vector<float> coeffs, visibility, normals, unoccluded, kernel, diffuse;
    std::vector<std::uint16_t> reflected;

    Content() {
        std::mt19937 random(1);
        std::normal_distribution<float> gauss;
        const auto fill = [&](std::size_t count) {
            std::vector<float> values(count);
            for (float& x : values) x = gauss(random);
            return values;
        };
        coeffs = fill(75);
        visibility = fill(kVertices * 121);
        diffuse = fill(kVertices * 75);
        for (const float x : fill(kVertices * 15 * 75)) reflected.push_back(float_to_half(x));
        unoccluded = fill(2 * lobe_size(kExit, kLight));
        kernel = fill(2 * lobe_size(kExit, kLobeBands));
        for (std::uint64_t v = 0; v < kVertices; ++v) {
            const std::vector<float> n = fill(3);
            const float length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
            for (const float x : n) normals.push_back(x / length);
        }
    }
    ShLightingView lighting() const { return {5, coeffs}; }
    GlossyView transport() const {
        return {kVertices,
                kLight,
                {visibility.data(), visibility.size()},
                {normals.data(), normals.size()}};
    }
    Mesh mesh() const {
        Mesh mesh;
        mesh.vertex_count = kVertices;
        mesh.glossy = transport();
        return mesh;
    }
    /// Where light bounces, RGB: with what surfaces send by direction, in four bands.
    Mesh mesh_with_bounces() const {
        Mesh with = mesh();
        with.diffuse.vertex_count = kVertices;
        with.diffuse.bands = kLight;
        with.diffuse.channels = 3;
        with.diffuse.values = {diffuse.data(), diffuse.size()};
        with.glossy.reflected_bands = kMaxReflectedBands;
        with.glossy.reflected_channels = 3;
        with.glossy.reflected = {reflected.data(), reflected.size(), true};
        return with;
    }
    LobeView lobe() const {
        return {1,
                kExit,
                kLight,
                0.5f,
                0.5f,
                {unoccluded.data(), unoccluded.size()},
                {kernel.data(), kernel.size()}};
    }
};

void rate(benchmark::State& state, double multiply_adds) {
    state.counters["multiply_adds"] =
        benchmark::Counter(multiply_adds, benchmark::Counter::kIsIterationInvariantRate);
}

/// What one core of this machine does with this compiler's vectors: sixteen sums that do not wait
/// for each other.
void peak(benchmark::State& state) {
    constexpr std::size_t kLanes = 256;
    alignas(64) float sums[kLanes] = {};
    float x = 0.5f, y = 1e-9f;
    benchmark::DoNotOptimize(x);
    benchmark::DoNotOptimize(y);
    constexpr int kRounds = 1000;
    for (auto _ : state) {
        for (int round = 0; round < kRounds; ++round)
            for (float& sum : sums) sum = sum * x + y;
        benchmark::DoNotOptimize(sums);
    }
    rate(state, 1.0 * kLanes * kRounds);
}

void prepare_light(benchmark::State& state) {
    const Content content;
    for (auto _ : state) {
        const auto light = std::make_unique<GlossyLight>(content.lighting(), 5);
        benchmark::DoNotOptimize(light.get());
    }
}

/// Of a new light, once a vertex: the 121 x 49 products of each channel are most of it.
void transfer(benchmark::State& state) {
    const Content content;
    const auto light = std::make_unique<GlossyLight>(content.lighting(), 5);
    std::uint64_t v = 0;
    for (auto _ : state) {
        benchmark::DoNotOptimize(light->transfer(content.mesh(), v));
        v = (v + 1) % Content::kVertices;
    }
    rate(state, 3.0 * 121 * 49);
}

void transfer_with_bounces(benchmark::State& state) {
    const Content content;
    const Mesh mesh = content.mesh_with_bounces();
    const auto light = std::make_unique<GlossyLight>(content.lighting(), 5);
    std::uint64_t v = 0;
    for (auto _ : state) {
        benchmark::DoNotOptimize(light->transfer(mesh, v));
        v = (v + 1) % Content::kVertices;
    }
    rate(state, 3.0 * (121 * 49 + 15 * 25 + 2817));
}

/// Of a lobe, once a vertex or pixel.
void reflect_lobe(benchmark::State& state) {
    const Content content;
    const auto light = std::make_unique<GlossyLight>(content.lighting(), 5);
    const TransferredLight transferred = light->transfer(content.mesh(), 0);
    for (auto _ : state)
        benchmark::DoNotOptimize(reflect(content.lobe(), transferred, 0.5f, {0.9f, 0.8f, 0.5f}));
    rate(state, 3.0 * (85 + 145));
}

/// Of a view.
void radiance(benchmark::State& state) {
    const Content content;
    const auto light = std::make_unique<GlossyLight>(content.lighting(), 5);
    const GlossyExit exit =
        reflect(content.lobe(), light->transfer(content.mesh(), 0), 0.5f, {0.9f, 0.8f, 0.5f});
    Vec3 v{0.6f, 0, 0.8f};
    for (auto _ : state) {
        benchmark::DoNotOptimize(v);
        benchmark::DoNotOptimize(exit.radiance(v));
    }
    rate(state, 3.0 * 25);
}

/// Once a vertex, for those who store matrices.
void matrices(benchmark::State& state) {
    const Content content;
    const auto maker = std::make_unique<GlossyMatrices>();
    std::vector<float> t(25 * 25 * 2);
    std::uint64_t v = 0;
    for (auto _ : state) {
        benchmark::DoNotOptimize(maker->expand(content.lobe(), content.transport(), v, 0.5f, t));
        benchmark::DoNotOptimize(t.data());
        v = (v + 1) % Content::kVertices;
    }
}

BENCHMARK(peak);
BENCHMARK(prepare_light);
BENCHMARK(transfer);
BENCHMARK(transfer_with_bounces);
BENCHMARK(reflect_lobe);
BENCHMARK(radiance);
BENCHMARK(matrices);

}  // namespace
}  // namespace envbake::runtime

BENCHMARK_MAIN();
