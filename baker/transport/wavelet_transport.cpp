// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/wavelet_transport.h"

#include "baker/core/parallel.h"
#include "baker/transport/free_vertices.h"
#include "baker/transport/wavelet_block.h"
#include "envbake/runtime/wavelet.h"

#include <algorithm>
#include <limits>
#include <numbers>

namespace envbake {

namespace {

constexpr std::size_t kBlockSize = kWaveletBlock;
constexpr std::size_t kChunk = 8;  ///< vertices of one call of a parallel loop

void decompose(const CubeTexels& cube, std::span<float> texels, std::span<float> coeffs) {
    const std::size_t of_face = coeffs.size() / cube::kFaceCount;
    for (std::size_t at = 0; at < coeffs.size(); at += of_face)
        wavelet::forward(cube.face_size, &texels[at], &coeffs[at]);
}

struct BakedRow {
    std::vector<WaveletEntry> entries;
    bool free = false;
    int rays = 0;
};

BakedRow bake_row(const CubeTexels& cube, float step, const Tracer& tracer,
                  const RayOrigin& origin) {
    thread_local std::vector<float> coeffs;
    coeffs.resize(wavelet::coeff_count(cube.face_size));
    BakedRow row;
    row.free = is_free(origin, tracer.half_spaces());
    if (row.free)
        open_wavelet_transport(cube, origin.normal, coeffs);
    else
        row.rays = wavelet_transport(cube, tracer, origin, coeffs, Look::AtOutlines);
    row.entries = quantised(coeffs, step);
    return row;
}

}  // namespace

void append(WaveletReport& report, const WaveletReport& part) {
    report.vertex_count += part.vertex_count;
    report.unreferenced_count += part.unreferenced_count;
    report.free_count += part.free_count;
    report.traced_count += part.traced_count;
    report.ray_count += part.ray_count;
    report.coeff_count += part.coeff_count;
    report.byte_count += part.byte_count;
}

Error wavelets_too_large(std::size_t mesh) {
    return {Errc::Failed, concat("mesh/", mesh,
                                 "/wavelet: more than 16 GiB; ask for smaller faces or a larger "
                                 "tolerance")};
}

float wavelet_step(const WaveletJob& job) {
    constexpr double kOpenOverhead = std::numbers::inv_pi;
    constexpr double kMostUnits = 32639;  // 127 * 256 + 127
    return static_cast<float>(std::max(1.2 * job.tolerance, job.face_size / kMostUnits) *
                              kOpenOverhead);
}

int expected_wavelet_rays(const WaveletJob& job) {
    return 500 + 18 * job.face_size;  // the coarse look, and outlines
}

int wavelet_transport(const CubeTexels& cube, const Tracer& tracer, const RayOrigin& origin,
                      std::span<float> coeffs, Look look) {
    thread_local std::vector<float> texels;
    texels.resize(coeffs.size());
    const int rays = texel_transport(cube, tracer, origin, texels, look);
    decompose(cube, texels, coeffs);
    return rays;
}

void open_wavelet_transport(const CubeTexels& cube, const DVec3& normal, std::span<float> coeffs) {
    std::vector<float> texels(coeffs.size());
    open_texel_transport(cube, normal, texels);
    decompose(cube, texels, coeffs);
}

Expected<WaveletReport> bake_wavelet(
    const WaveletJob& job, const CubeTexels& cube, const Scene& scene, std::size_t mesh,
    const Tracer& tracer, const std::function<Expected<void>(std::span<const std::byte>)>& sink,
    std::vector<std::uint32_t>& offsets, std::span<std::uint64_t> square_sums, Progress& progress) {
    const SurfacePoints points(scene.meshes[mesh]);
    const float step = wavelet_step(job);
    // What it is a copy of, where that is in the same block: further back it is baked again, lest
    // the count of rays depend on what is still in memory.
    const auto original = [&](std::size_t v) -> std::size_t {
        const std::uint32_t place = points.representative(v);
        return place != SurfacePoints::kNone && place / kBlockSize == v / kBlockSize ? place : v;
    };
    // A quarter of the coefficients of a vertex.
    const std::size_t block_bytes =
        kBlockSize * square_sums.size() / 4 * (sizeof(WaveletEntry) + 2);
    const std::size_t in_hand =
        kBlockSize * std::clamp<std::size_t>(job.memory_bytes / block_bytes, 1, 64);
    WaveletReport report;
    const std::size_t range_end = std::min(job.end_vertex, points.size());
    report.vertex_count = range_end - std::min(job.first_vertex, range_end);
    offsets.assign(1, 0);
    std::vector<BakedRow> rows;
    std::vector<std::vector<std::byte>> blocks;
    for (std::size_t begin = job.first_vertex; begin < range_end; begin += in_hand) {
        rows.clear();
        rows.resize(std::min(in_hand, range_end - begin));
        parallel_for((rows.size() + kChunk - 1) / kChunk, [&](std::size_t chunk) {
            const std::size_t end = std::min(rows.size(), (chunk + 1) * kChunk);
            for (std::size_t i = chunk * kChunk; i < end; ++i) {
                const std::uint32_t place = points.representative(begin + i);
                if (place != SurfacePoints::kNone && original(begin + i) == begin + i)
                    rows[i] = bake_row(cube, step, tracer, points.origin(place, tracer.space()));
            }
            progress.add(end - chunk * kChunk);
        });
        for (std::size_t i = 0; i < rows.size(); ++i) {
            const std::size_t v = begin + i;
            if (points.representative(v) == SurfacePoints::kNone) {
                ++report.unreferenced_count;
                continue;
            }
            report.ray_count += static_cast<std::uint64_t>(rows[i].rays);
            if (original(v) != v) {
                rows[i] = rows[original(v) - begin];
            }
            ++(rows[i].free ? report.free_count : report.traced_count);
            report.coeff_count += rows[i].entries.size();
            for (const WaveletEntry& e : rows[i].entries)
                square_sums[e.index] += static_cast<std::uint64_t>(e.units * e.units);
        }
        blocks.clear();
        blocks.resize((rows.size() + kBlockSize - 1) / kBlockSize);
        parallel_for(blocks.size(), [&](std::size_t b) {
            std::vector<std::vector<WaveletEntry>> entries;
            for (std::size_t i = b * kBlockSize; i < std::min(rows.size(), (b + 1) * kBlockSize);
                 ++i)
                entries.push_back(std::move(rows[i].entries));
            blocks[b] = encode_wavelet_block(entries);
        });
        for (const std::vector<std::byte>& block : blocks) {
            report.byte_count += block.size();
            if (report.byte_count / 4 > std::numeric_limits<std::uint32_t>::max())
                return wavelets_too_large(mesh);
            offsets.push_back(static_cast<std::uint32_t>(report.byte_count / 4));
            ENVBAKE_TRY_VOID(sink(block));
        }
    }
    return report;
}

}  // namespace envbake
