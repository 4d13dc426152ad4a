// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/lighting/wavelet_lighting.h"
#include "baker/transport/wavelet_transport.h"

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace envbake {

/// What the wavelet arrays of one bundle share: the basis, how much transport meets each
/// coefficient, and a few vertices that tell how many lighting terms are needed and what the whole
/// errs.
class WaveletStage {
  public:
    explicit WaveletStage(const WaveletJob& job)
        : job_(job), cube_(job.face_size), square_sums_(wavelet::coeff_count(job.face_size), 0) {}

    const CubeTexels& cube() const { return cube_; }
    int face_size() const { return job_.face_size; }
    float step() const { return wavelet_step(job_); }
    std::span<double> square_sums() { return square_sums_; }

    /// Where its transport is baked, the mesh' vertices count.
    void add_mesh(std::size_t mesh, std::uint64_t vertex_count) {
        meshes_.push_back({mesh, vertex_count});
        vertex_count_ += vertex_count;
    }

    /// rms over the vertices of all meshes; without a mesh, over surfaces that face everywhere with
    /// nothing above them. Call it when all meshes are baked, and once.
    std::vector<float> weights();

    struct Lighting {
        std::vector<wavelet::Term> terms;
        double truncation = 0;  ///< relative rms exit radiance that the terms left out have
        double error = 0;       ///< of all together: these terms, rounded transport, and outlines
                                ///< instead of every texel
        std::size_t coeff_count = 0;  ///< of the map, not 0
    };
    /// The terms that bring the sample within the tolerance; what they err is measured at vertices
    /// looked at texel by texel. `scene` and `tracer`: null without meshes.
    Lighting choose_lighting(const Environment& environment, int channels,
                             std::span<const float> weights, const Scene* scene,
                             const Tracer* tracer);

    /// A vertex of the sample with its transport as the bundle holds it.
    struct Vertex {
        std::uint32_t mesh = 0, vertex = 0;
        std::vector<float> stored;  ///< [coeff_count]
    };
    /// Of choose_lighting(); none without meshes.
    std::span<const Vertex> sample() const { return sample_; }

  private:
    struct MeshCount {
        std::size_t mesh;
        std::uint64_t vertex_count;
    };
    std::vector<std::vector<float>> look_at_sample(const Scene& scene, const Tracer& tracer);

    WaveletJob job_;
    CubeTexels cube_;
    std::vector<double> square_sums_;
    std::vector<MeshCount> meshes_;
    std::uint64_t vertex_count_ = 0;
    std::vector<Vertex> sample_;
};

}  // namespace envbake
