// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"
#include "baker/core/progress.h"
#include "baker/pipeline/bake.h"
#include "baker/pipeline/wavelet_stage.h"
#include "baker/plan/plan.h"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace envbake {

template <class T>
using Sink = std::function<Expected<void>(std::span<const T>)>;

/// The mesh whose rows() a stage asks for; none where it asks for none.
std::optional<std::size_t> mesh_of_rows(const Job& job);

/// Where a run has what its stages give, before any encoding: from the stages themselves, or from
/// the parts of a bake whose stages ran elsewhere. What the run makes of it is the same.
///
///   output  PlannedStage::output
class StageSource {
  public:
    virtual ~StageSource() = default;

    virtual Expected<std::vector<Mip>> mips(const std::string& output, const MipsJob& job) = 0;
    virtual Expected<BrdfTable> table(const std::string& output, const BrdfTableJob& job) = 0;
    virtual Expected<LobeExpansion> lobe(const std::string& output,
                                         const LobeExpansionJob& job) = 0;

    /// Rows of one mesh, in vertex order.
    ///   for_bounces  bounces() will want what its rays met
    virtual Expected<DiffuseReport> rows(const std::string& output, const DiffuseJob& job,
                                         std::size_t mesh, bool for_bounces,
                                         const Sink<float>& sink) = 0;
    /// The shading normals that those rows are about, [vertices, 3]; 0 where there is none.
    virtual Expected<std::vector<float>> normals(std::size_t mesh) = 0;
    virtual Expected<BounceReport> bounces(const BounceJob& job,
                                           std::span<MeshTransport> transport) = 0;

    /// As bake_wavelet().
    virtual Expected<WaveletReport> wavelet(const std::string& output, const WaveletJob& job,
                                            std::size_t mesh, const Sink<std::byte>& sink,
                                            std::vector<std::uint32_t>& offsets,
                                            std::span<std::uint64_t> square_sums) = 0;
    virtual Expected<WaveletLight> wavelet_light(const std::string& output, const WaveletJob& job,
                                                 int channels,
                                                 std::span<const WaveletMesh> meshes) = 0;
};

/// The stages themselves.
class BakedStages : public StageSource {
  public:
    BakedStages(const BakeInputs& inputs, Isa isa, Progress& progress)
        : inputs_(inputs), isa_(isa), progress_(progress) {}

    Expected<std::vector<Mip>> mips(const std::string&, const MipsJob& job) override;
    Expected<BrdfTable> table(const std::string&, const BrdfTableJob& job) override;
    Expected<LobeExpansion> lobe(const std::string&, const LobeExpansionJob& job) override;
    Expected<DiffuseReport> rows(const std::string&, const DiffuseJob& job, std::size_t mesh,
                                 bool for_bounces, const Sink<float>& sink) override;
    Expected<std::vector<float>> normals(std::size_t mesh) override;
    Expected<BounceReport> bounces(const BounceJob& job,
                                   std::span<MeshTransport> transport) override;
    Expected<WaveletReport> wavelet(const std::string&, const WaveletJob& job, std::size_t mesh,
                                    const Sink<std::byte>& sink,
                                    std::vector<std::uint32_t>& offsets,
                                    std::span<std::uint64_t> square_sums) override;
    Expected<WaveletLight> wavelet_light(const std::string&, const WaveletJob& job, int channels,
                                         std::span<const WaveletMesh> meshes) override;

    /// Whether any stage had rays to cast.
    bool traced() const { return tracer_.has_value(); }
    /// What the rays of a mesh met, where that was asked for; it is forgotten here.
    BlockedRays take_blocked(std::size_t mesh) { return std::exchange(blocked_[mesh], {}); }

  private:
    Expected<void> build_tracer();
    const CubeTexels& cube(int face_size);

    const BakeInputs& inputs_;
    Isa isa_;
    Progress& progress_;
    std::optional<Tracer> tracer_;
    std::optional<CubeTexels> cube_;    ///< one serves every mesh
    std::vector<BlockedRays> blocked_;  ///< [mesh]
};

}  // namespace envbake
