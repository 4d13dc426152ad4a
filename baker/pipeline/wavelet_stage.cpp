// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/wavelet_stage.h"

#include "baker/core/parallel.h"
#include "baker/transport/free_vertices.h"
#include "baker/transport/wavelet_block.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

namespace envbake {

namespace {

constexpr std::uint64_t kSampleSize = 128;

/// What is left for the terms, when rounding and outlines take some: errors add by squares.
constexpr double kTruncationShare = 0.75;

/// Surfaces with nothing above them, facing everywhere.
std::vector<std::vector<float>> open_rows(const CubeTexels& cube) {
    constexpr int kCount = 64;
    std::vector<std::vector<float>> rows;
    for (int k = 0; k < kCount; ++k) {
        const double z = 1 - (2 * k + 1.0) / kCount;
        const double phi = std::numbers::pi * (3 - std::sqrt(5.0)) * k;
        const double r = std::sqrt(1 - z * z);
        rows.emplace_back(wavelet::coeff_count(cube.face_size));
        open_wavelet_transport(cube, {r * std::cos(phi), r * std::sin(phi), z}, rows.back());
    }
    return rows;
}

DVec3 exit_radiance(std::span<const wavelet::Term> terms, std::span<const float> row) {
    DVec3 sum(0);
    for (const wavelet::Term& term : terms)
        sum += DVec3(term.value[0], term.value[1], term.value[2]) *
               static_cast<double>(row[term.index]);
    return sum;
}

}  // namespace

std::vector<float> WaveletStage::weights() {
    double count = static_cast<double>(vertex_count_);
    if (meshes_.empty()) {
        for (const std::vector<float>& row : open_rows(cube_)) {
            for (std::size_t i = 0; i < row.size(); ++i)
                square_sums_[i] += static_cast<double>(row[i]) * static_cast<double>(row[i]);
            ++count;
        }
    }
    std::vector<float> weights;
    for (const double sum : square_sums_)
        weights.push_back(static_cast<float>(std::sqrt(sum / std::max(count, 1.0))));
    return weights;
}

/// Vertices spread evenly over the meshes: their transport as it is stored goes into the sample,
/// that of looking everywhere is returned.
std::vector<std::vector<float>> WaveletStage::look_at_sample(const Scene& scene,
                                                             const Tracer& tracer) {
    const std::uint64_t count = std::min(kSampleSize, vertex_count_);
    std::vector<std::optional<SurfacePoints>> points(scene.meshes.size());
    std::uint64_t before = 0;
    std::size_t at = 0;
    std::vector<RayOrigin> origins;
    for (std::uint64_t k = 0; k < count; ++k) {
        const std::uint64_t wanted = (2 * k + 1) * vertex_count_ / (2 * count);
        while (wanted - before >= meshes_[at].vertex_count) before += meshes_[at++].vertex_count;
        const std::size_t mesh = meshes_[at].mesh;
        if (!points[mesh]) points[mesh].emplace(scene.meshes[mesh]);
        const auto vertex = static_cast<std::uint32_t>(wanted - before);
        const std::uint32_t place = points[mesh]->representative(vertex);
        if (place == SurfacePoints::kNone) continue;
        sample_.push_back({static_cast<std::uint32_t>(mesh), vertex, {}});
        origins.push_back(points[mesh]->origin(place, tracer.space()));
    }
    std::vector<std::vector<float>> rows(origins.size());
    parallel_for(origins.size(), [&](std::size_t i) {
        std::vector<float>& row = rows[i];
        row.resize(square_sums_.size());
        if (is_free(origins[i], tracer.half_spaces()))
            open_wavelet_transport(cube_, origins[i].normal, row);
        else
            wavelet_transport(cube_, tracer, origins[i], row, Look::AtOutlines);
        sample_[i].stored.assign(row.size(), 0.0f);
        for (const WaveletEntry& entry : quantised(row, step()))
            sample_[i].stored[entry.index] = static_cast<float>(entry.units) * step();
        wavelet_transport(cube_, tracer, origins[i], row, Look::Everywhere);
    });
    return rows;
}

WaveletStage::Lighting WaveletStage::choose_lighting(const Environment& environment, int channels,
                                                     std::span<const float> weights,
                                                     const Scene* scene, const Tracer* tracer) {
    const std::vector<std::vector<float>> rows =
        meshes_.empty() ? open_rows(cube_) : look_at_sample(*scene, *tracer);
    const std::vector<wavelet::Rgb> coeffs = project_wavelet(environment, job_.face_size, channels);
    std::vector<wavelet::Term> all;
    for (std::uint32_t i = 0; i < coeffs.size(); ++i)
        if (coeffs[i] != wavelet::Rgb{}) all.push_back({i, coeffs[i]});
    ChosenTerms chosen = choose_terms(coeffs, weights, rows, kTruncationShare * job_.tolerance);
    Lighting lighting{std::move(chosen.terms), chosen.error, chosen.error, all.size()};
    double wrong = 0, whole = 0;
    for (std::size_t i = 0; i < sample_.size(); ++i) {
        const DVec3 truth = exit_radiance(all, rows[i]);
        const DVec3 difference = exit_radiance(lighting.terms, sample_[i].stored) - truth;
        wrong += glm::dot(difference, difference);
        whole += glm::dot(truth, truth);
    }
    if (whole > 0) lighting.error = std::sqrt(wrong / whole);
    return lighting;
}

}  // namespace envbake
