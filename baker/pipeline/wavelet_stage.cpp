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

/// The sample, each with a row of its own to come.
std::vector<RayOrigin> choose_sample(std::span<const WaveletMesh> meshes, const Scene& scene,
                                     const Tracer& tracer,
                                     std::vector<WaveletLight::Vertex>& sample) {
    std::uint64_t vertex_count = 0;
    for (const WaveletMesh& mesh : meshes) vertex_count += mesh.vertex_count;
    const std::uint64_t count = std::min(kSampleSize, vertex_count);
    std::vector<std::optional<SurfacePoints>> points(scene.meshes.size());
    std::uint64_t before = 0;
    std::size_t at = 0;
    std::vector<RayOrigin> origins;
    for (std::uint64_t k = 0; k < count; ++k) {
        const std::uint64_t wanted = (2 * k + 1) * vertex_count / (2 * count);
        while (wanted - before >= meshes[at].vertex_count) before += meshes[at++].vertex_count;
        const std::size_t mesh = meshes[at].mesh;
        if (!points[mesh]) points[mesh].emplace(scene.meshes[mesh]);
        const auto vertex = static_cast<std::uint32_t>(wanted - before);
        const std::uint32_t place = points[mesh]->representative(vertex);
        if (place == SurfacePoints::kNone) continue;
        sample.push_back({static_cast<std::uint32_t>(mesh), vertex, {}, {}});
        origins.push_back(points[mesh]->origin(place, tracer.space()));
    }
    return origins;
}

}  // namespace

WaveletLight look_at_wavelet_light(const WaveletJob& job, const Environment& environment,
                                   int channels, std::span<const WaveletMesh> meshes,
                                   const CubeTexels* cube, const Scene* scene,
                                   const Tracer* tracer) {
    WaveletLight light{project_wavelet(environment, job.face_size, channels), {}};
    if (meshes.empty()) return light;
    const std::vector<RayOrigin> origins = choose_sample(meshes, *scene, *tracer, light.sample);
    const float step = wavelet_step(job);
    parallel_for(origins.size(), [&](std::size_t i) {
        WaveletLight::Vertex& vertex = light.sample[i];
        std::vector<float>& row = vertex.looked;
        row.resize(light.coeffs.size());
        if (is_free(origins[i], tracer->half_spaces()))
            open_wavelet_transport(*cube, origins[i].normal, row);
        else
            wavelet_transport(*cube, *tracer, origins[i], row, Look::AtOutlines);
        vertex.stored.assign(row.size(), 0.0f);
        for (const WaveletEntry& entry : quantised(row, step))
            vertex.stored[entry.index] = static_cast<float>(entry.units) * step;
        wavelet_transport(*cube, *tracer, origins[i], row, Look::Everywhere);
    });
    return light;
}

std::vector<float> WaveletStage::weights() const {
    std::vector<double> sums(square_sums_.size());
    double count = 0;
    for (const WaveletMesh& mesh : meshes_) count += static_cast<double>(mesh.vertex_count);
    for (std::size_t i = 0; i < sums.size(); ++i)
        sums[i] = static_cast<double>(step()) * static_cast<double>(step()) *
                  static_cast<double>(square_sums_[i]);
    if (meshes_.empty()) {
        for (const std::vector<float>& row : open_rows(CubeTexels(job_.face_size))) {
            for (std::size_t i = 0; i < row.size(); ++i)
                sums[i] += static_cast<double>(row[i]) * static_cast<double>(row[i]);
            ++count;
        }
    }
    std::vector<float> weights;
    for (const double sum : sums)
        weights.push_back(static_cast<float>(std::sqrt(sum / std::max(count, 1.0))));
    return weights;
}

WaveletStage::Lighting WaveletStage::choose_lighting(const WaveletLight& light,
                                                     std::span<const float> weights) const {
    std::vector<std::vector<float>> rows;
    if (meshes_.empty()) rows = open_rows(CubeTexels(job_.face_size));
    for (const WaveletLight::Vertex& vertex : light.sample) rows.push_back(vertex.looked);
    std::vector<wavelet::Term> all;
    for (std::uint32_t i = 0; i < light.coeffs.size(); ++i)
        if (light.coeffs[i] != wavelet::Rgb{}) all.push_back({i, light.coeffs[i]});
    ChosenTerms chosen =
        choose_terms(light.coeffs, weights, rows, kTruncationShare * job_.tolerance);
    Lighting lighting{std::move(chosen.terms), chosen.error, chosen.error, all.size()};
    double wrong = 0, whole = 0;
    for (const WaveletLight::Vertex& vertex : light.sample) {
        const DVec3 truth = exit_radiance(all, vertex.looked);
        const DVec3 difference = exit_radiance(lighting.terms, vertex.stored) - truth;
        wrong += glm::dot(difference, difference);
        whole += glm::dot(truth, truth);
    }
    if (whole > 0) lighting.error = std::sqrt(wrong / whole);
    return lighting;
}

}  // namespace envbake
