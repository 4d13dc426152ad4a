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

constexpr std::size_t kBlockSize = 256;  ///< vertices; one byte names one of them

void decompose(const CubeTexels& cube, std::span<float> texels, std::span<float> coeffs) {
    const std::size_t of_face = coeffs.size() / cube::kFaceCount;
    for (std::size_t at = 0; at < coeffs.size(); at += of_face)
        wavelet::forward(cube.face_size, &texels[at], &coeffs[at]);
}

struct BakedBlock {
    std::vector<std::byte> bytes;
    std::vector<double> square_sums;
    WaveletReport report;
};

BakedBlock bake_block(const CubeTexels& cube, float step, const Tracer& tracer,
                      const SurfacePoints& points, std::size_t first) {
    const std::size_t count = std::min(kBlockSize, points.size() - first);
    BakedBlock block;
    block.square_sums.assign(wavelet::coeff_count(cube.face_size), 0);
    std::vector<std::vector<WaveletEntry>> rows(count);
    std::vector<float> coeffs(block.square_sums.size());
    std::vector<std::uint32_t> copies(count, 1);
    for (std::size_t i = 0; i < count; ++i) {
        const std::uint32_t place = points.representative(first + i);
        if (place != SurfacePoints::kNone && place >= first && place < first + i)
            ++copies[place - first];
    }
    for (std::size_t i = 0; i < count; ++i) {
        const std::uint32_t place = points.representative(first + i);
        if (place == SurfacePoints::kNone) {
            ++block.report.unreferenced_count;
            continue;
        }
        if (place >= first && place < first + i) {
            rows[i] = rows[place - first];
            block.report.coeff_count += rows[i].size();
            continue;
        }
        const RayOrigin origin = points.origin(place, tracer.space());
        const bool free = is_free(origin, tracer.half_spaces());
        if (free)
            open_wavelet_transport(cube, origin.normal, coeffs);
        else
            block.report.ray_count += static_cast<std::uint64_t>(
                wavelet_transport(cube, tracer, origin, coeffs, Look::AtOutlines));
        (free ? block.report.free_count : block.report.traced_count) += copies[i];
        for (std::size_t k = 0; k < coeffs.size(); ++k) {
            const auto c = static_cast<double>(coeffs[k]);
            block.square_sums[k] += copies[i] * c * c;
        }
        rows[i] = quantised(coeffs, step);
        block.report.coeff_count += rows[i].size();
    }
    block.bytes = encode_wavelet_block(rows);
    return block;
}

}  // namespace

float wavelet_step(const WaveletJob& job) {
    constexpr double kOpenOverhead = std::numbers::inv_pi;
    constexpr double kMostUnits = 32639;  // 127 * 256 + 127
    return static_cast<float>(std::max(1.5 * job.tolerance, job.face_size / kMostUnits) *
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
    std::vector<std::uint32_t>& offsets, std::span<double> square_sums, Progress& progress) {
    const SurfacePoints points(scene.meshes[mesh]);
    const float step = wavelet_step(job);
    const std::size_t block_count = (points.size() + kBlockSize - 1) / kBlockSize;
    // A quarter of the coefficients, and the sums of squares.
    const std::size_t block_bytes = square_sums.size() * (kBlockSize / 4 * 16 + sizeof(double));
    const std::size_t in_hand = std::clamp<std::size_t>(job.memory_bytes / block_bytes, 1, 64);
    WaveletReport report;
    report.vertex_count = points.size();
    offsets.assign(1, 0);
    std::vector<BakedBlock> blocks;
    for (std::size_t begin = 0; begin < block_count; begin += in_hand) {
        blocks.clear();
        blocks.resize(std::min(in_hand, block_count - begin));
        parallel_for(blocks.size(), [&](std::size_t i) {
            const std::size_t first = (begin + i) * kBlockSize;
            blocks[i] = bake_block(cube, step, tracer, points, first);
            progress.add(std::min(kBlockSize, points.size() - first));
        });
        for (const BakedBlock& block : blocks) {
            for (std::size_t k = 0; k < square_sums.size(); ++k)
                square_sums[k] += block.square_sums[k];
            report.unreferenced_count += block.report.unreferenced_count;
            report.free_count += block.report.free_count;
            report.traced_count += block.report.traced_count;
            report.ray_count += block.report.ray_count;
            report.coeff_count += block.report.coeff_count;
            report.byte_count += block.bytes.size();
            if (report.byte_count / 4 > std::numeric_limits<std::uint32_t>::max())
                return Error{Errc::Failed, concat("mesh/", mesh,
                                                  "/wavelet: more than 16 GiB; ask for smaller "
                                                  "faces or a larger tolerance")};
            offsets.push_back(static_cast<std::uint32_t>(report.byte_count / 4));
            ENVBAKE_TRY_VOID(sink(block.bytes));
        }
    }
    return report;
}

}  // namespace envbake
