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

/// A mesh whose wavelet transport is baked.
struct WaveletMesh {
    std::size_t mesh = 0;
    std::uint64_t vertex_count = 0;
};

/// What the terms of wavelet lighting are chosen by, beside the weights: the light itself, and a
/// few vertices that tell how many terms are needed and what the whole errs.
struct WaveletLight {
    std::vector<wavelet::Rgb> coeffs;  ///< of the environment, [coeff_count]
    struct Vertex {
        std::uint32_t mesh = 0, vertex = 0;
        std::vector<float> stored;  ///< [coeff_count], its transport as the bundle holds it
        std::vector<float> looked;  ///< the same, looked at texel by texel
    };
    std::vector<Vertex> sample;  ///< none without meshes
};

/// Spread evenly over the vertices of the meshes.
///   cube, scene, tracer  null without meshes
WaveletLight look_at_wavelet_light(const WaveletJob& job, const Environment& environment,
                                   int channels, std::span<const WaveletMesh> meshes,
                                   const CubeTexels* cube, const Scene* scene,
                                   const Tracer* tracer);

/// What the wavelet arrays of one bundle share: the basis, and how much transport meets each
/// coefficient.
class WaveletStage {
  public:
    explicit WaveletStage(const WaveletJob& job)
        : job_(job), square_sums_(wavelet::coeff_count(job.face_size), 0) {}

    int face_size() const { return job_.face_size; }
    float step() const { return wavelet_step(job_); }
    std::span<std::uint64_t> square_sums() { return square_sums_; }

    /// Where its transport is baked, the mesh' vertices count.
    void add_mesh(std::size_t mesh, std::uint64_t vertex_count) {
        meshes_.push_back({mesh, vertex_count});
    }
    const WaveletJob& job() const { return job_; }
    std::span<const WaveletMesh> meshes() const { return meshes_; }

    /// rms over the vertices of all meshes; without a mesh, over surfaces that face everywhere with
    /// nothing above them.
    std::vector<float> weights() const;

    struct Lighting {
        std::vector<wavelet::Term> terms;
        double truncation = 0;  ///< relative rms exit radiance that the terms left out have
        double error = 0;       ///< of all together: these terms, rounded transport, and outlines
                                ///< instead of every texel
        std::size_t coeff_count = 0;  ///< of the map, not 0
    };
    /// The terms that bring the sample within the tolerance; what they err is measured at vertices
    /// looked at texel by texel.
    Lighting choose_lighting(const WaveletLight& light, std::span<const float> weights) const;

  private:
    WaveletJob job_;
    std::vector<std::uint64_t> square_sums_;  ///< in steps
    std::vector<WaveletMesh> meshes_;
};

}  // namespace envbake
