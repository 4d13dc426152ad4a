// SPDX-License-Identifier: Apache-2.0
// Diffuse shading of many vertices in every encoding, beside a plain read of the same bytes, in one
// run: bytes per second of both. Arguments: the number of vertices; 5 bands, one channel. Rows are
// noise, for time does not depend on what they are; clusters follow one another at random.
#include "envbake/runtime/half.h"
#include "envbake/runtime/shade.h"

#include <benchmark/benchmark.h>

#include <cstdint>
#include <cstring>
#include <random>
#include <string>
#include <vector>

namespace envbake::runtime {
namespace {

constexpr std::size_t kCoeffs = 25;
constexpr std::uint32_t kClusters = 256;
constexpr std::size_t kWeights = 10;

/// Transport of one encoding, in memory.
struct Transport {
    TransportView view;
    std::vector<std::byte> stored;  ///< what grows with the vertices
    std::vector<std::uint8_t> clusters;
    std::vector<float> range, basis, light;

    ShLightingView lighting() const { return {5, light}; }
    std::uint64_t bytes() const { return stored.size() + clusters.size(); }
};

Transport make(const std::string& encoding, std::size_t vertices) {
    std::mt19937 random(1);
    std::uniform_real_distribution<float> noise(-0.3f, 0.3f);
    Transport t;
    for (std::size_t i = 0; i < 3 * kCoeffs; ++i) t.light.push_back(noise(random));
    t.view.vertex_count = vertices;
    t.view.bands = 5;
    const std::size_t element = encoding == "f32"                            ? 4
                                : encoding == "f16" || encoding == "unorm16" ? 2
                                                                             : 1;
    const std::size_t numbers = vertices * (encoding == "cpca" ? kWeights : kCoeffs);
    t.stored.resize(numbers * element);
    for (std::size_t i = 0; i < numbers; ++i) {
        const float value = noise(random);
        const std::uint16_t half = float_to_half(value);
        const auto code = static_cast<std::uint16_t>(random());
        const void* from = encoding == "f32"   ? static_cast<const void*>(&value)
                           : encoding == "f16" ? static_cast<const void*>(&half)
                                               : static_cast<const void*>(&code);
        std::memcpy(&t.stored[i * element], from, element);
    }
    if (encoding == "f32" || encoding == "f16") {
        t.view.values = {t.stored.data(), numbers, encoding == "f16"};
        return t;
    }
    t.view.codes = t.stored.data();
    if (encoding == "cpca") {
        for (std::size_t i = 0; i < kClusters * (1 + kWeights) * kCoeffs; ++i)
            t.basis.push_back(noise(random));
        for (std::size_t v = 0; v < vertices; ++v)
            t.clusters.push_back(static_cast<std::uint8_t>(random()));
        t.view.encoding = TransportEncoding::Clustered;
        t.view.clusters = t.clusters.data();
        t.view.basis = {
            kClusters, static_cast<int>(kWeights), 5, 1, {t.basis.data(), t.basis.size(), false}};
        return t;
    }
    for (std::size_t i = 0; i < kCoeffs; ++i) t.range.insert(t.range.end(), {-0.3f, 1e-5f});
    t.view.range = t.range.data();
    t.view.encoding = encoding == "unorm8" ? TransportEncoding::Unorm8 : TransportEncoding::Unorm16;
    return t;
}

void report(benchmark::State& state, const Transport& transport) {
    state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(transport.bytes()));
    state.counters["bytes_per_vertex"] =
        static_cast<double>(transport.bytes()) / static_cast<double>(transport.view.vertex_count);
    state.counters["per_vertex"] = benchmark::Counter(
        static_cast<double>(transport.view.vertex_count),
        benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void shade(benchmark::State& state, const std::string& encoding) {
    const Transport transport = make(encoding, static_cast<std::size_t>(state.range(0)));
    std::vector<Rgb> out(transport.view.vertex_count);
    std::vector<float> projected(projected_size(transport.view.basis));
    for (auto _ : state) {
        if (encoding == "cpca") {
            project_light(transport.view.basis, transport.lighting(), projected);
            diffuse_exit(transport.view, projected, 0, out);
        } else {
            diffuse_exit(transport.view, transport.lighting(), 0, out);
        }
        benchmark::DoNotOptimize(out.data());
        benchmark::ClobberMemory();
    }
    report(state, transport);
}

/// Adds up the same bytes as 64-bit words, four sums at a time, and writes as many colours.
void read_plain(benchmark::State& state, const std::string& encoding) {
    const Transport transport = make(encoding, static_cast<std::size_t>(state.range(0)));
    std::vector<Rgb> out(transport.view.vertex_count);
    for (auto _ : state) {
        std::uint64_t sums[4] = {};
        const std::byte* bytes = transport.stored.data();
        for (std::size_t i = 0; i + 32 <= transport.stored.size(); i += 32)
            for (std::size_t k = 0; k < 4; ++k) {
                std::uint64_t word = 0;
                std::memcpy(&word, bytes + i + 8 * k, 8);
                sums[k] += word;
            }
        for (const std::uint8_t cluster : transport.clusters) sums[0] += cluster;
        const auto value = static_cast<float>((sums[0] + sums[1] + sums[2] + sums[3]) & 255);
        for (Rgb& rgb : out) rgb = {value, value, value};
        benchmark::DoNotOptimize(out.data());
        benchmark::ClobberMemory();
    }
    report(state, transport);
}

}  // namespace
}  // namespace envbake::runtime

int main(int argc, char** argv) {
    using namespace envbake::runtime;
    for (const std::string encoding : {"f32", "f16", "unorm16", "unorm8", "cpca"}) {
        for (const std::int64_t vertices : {30'000, 2'000'000}) {
            benchmark::RegisterBenchmark(("shade/" + encoding).c_str(), shade, encoding)
                ->Arg(vertices);
            benchmark::RegisterBenchmark(("read/" + encoding).c_str(), read_plain, encoding)
                ->Arg(vertices);
        }
    }
    benchmark::Initialize(&argc, argv);
    benchmark::RunSpecifiedBenchmarks();
}
