// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/row_store.h"
#include "baker/pipeline/bake.h"
#include "baker/pipeline/encode_transport.h"
#include "baker/pipeline/metadata.h"
#include "baker/pipeline/older_bundle.h"
#include "baker/pipeline/self_test.h"
#include "baker/pipeline/stage_source.h"
#include "baker/pipeline/wavelet_stage.h"

#include "envbake/format/writer.h"

#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace envbake {

/// The half of a pair of lobes that a distribution has, in a report and among the stored arrays.
template <class Lobes>
auto& lobe_of(Lobes& lobes, runtime::Distribution distribution) {
    return distribution == runtime::Distribution::Ggx ? lobes.ggx : lobes.beckmann;
}

/// Makes a bundle of what the stages of one plan give, wherever they are run (StageSource). Its
/// stages stand by subject in run_lighting.cpp, run_transport.cpp, run_encoding.cpp,
/// run_wavelet.cpp and run_self_test.cpp; what is not baked again in run_kept.cpp.
class Run {
  public:
    /// described  describe_bake()
    Run(const BakeRequest& request, const BakeInputs& inputs, const Json& described,
        const BakePlan& plan, StageSource& stages, format::Writer& writer, Progress& progress);

    /// Keeps the stages that an older bundle has with the same key: execute() will copy their
    /// arrays. What else a stage leaves, for the report and for the self-test, is read back now.
    ///
    /// Errors:  InvalidBundle  the older bundle is not what it says: this run is of no use any more
    Expected<void> take_over(const OlderBundle& older);

    Expected<BakeOutcome> execute();

  private:
    /// Arrays whose error in a relative norm is above the tolerance that was asked for. The table
    /// is not among them: its size is an option of its own. The transport of a scene counts as a
    /// whole: its error is an rms, and that of a small mesh is as often above as below.
    std::vector<std::string> shortfalls() const;
    Expected<void> require_finite(std::span<const float> values) const;
    std::uint64_t vertex_count(std::size_t mesh) const {
        return inputs_.facts.meshes[mesh].vertex_count;
    }
    format::Codec codec() const {
        return request_.compress ? format::Codec::Zstd : format::Codec::None;
    }
    template <class T>
    Expected<void> add(std::string name, std::vector<std::uint64_t> shape,
                       std::span<const T> elements, format::Codec array_codec) {
        written_.push_back(name);
        return checked(writer_.add<T>(std::move(name), std::move(shape), elements, array_codec));
    }
    Expected<void> begin(const format::ArraySpec& spec);
    Expected<void> append(std::span<const std::byte> bytes);
    Expected<void> end();
    Expected<void> checked(const format::Expected<void>& done) const;

    Expected<void> bake(const std::string& output, const PlannedLights&);
    /// The lighting to be stored, cut to the planned bands and damped.
    ShLighting planned_lighting(const PlannedSh& sh);
    Expected<void> bake(const std::string& output, const PlannedSh& sh);
    Expected<void> bake(const std::string& output, const PlannedMips& mips);
    Expected<void> store(const std::string& name, const Mip& mip,
                         std::vector<StoredArrays::Mip>& stored_mips);
    Expected<void> bake(const std::string& output, const PlannedTable& planned);
    Expected<void> bake(const std::string& output, const PlannedLobe& planned);
    /// For the report and the self-test.
    void note(const LobeExpansionJob& job, const LobeExpansion& lobe);

    Expected<void> bake(const std::string& output, const PlannedGlossy& glossy);
    /// Transport that came with the glossy one.
    Expected<void> store_kept(const std::string& output, const PlannedDiffuse& diffuse);
    Expected<void> bake(const std::string& output, const PlannedDiffuse& diffuse);
    /// Bakes transport into memory, the same in every channel, for the bounces.
    Expected<void> keep(const std::string& output, const PlannedDiffuse& diffuse);
    /// Adds the bounces to all that waited, and writes it, unless it waits for its encoding.
    Expected<void> bake(const std::string&, const PlannedBounces& bounces);
    /// What they are to the mesh's lobe.
    Expected<void> store_reflected(std::size_t mesh, const LobeLightReport& light);
    Expected<void> bake(const std::string& output, const PlannedEmitted& planned);
    /// The job with the mesh's part of the time that is left: by its share of the vertices that are
    /// still to be traced.
    DiffuseJob in_time(DiffuseJob job, std::size_t mesh);
    static BakeReport::ArrayError error_of_transport(double rms) {
        return {rms, "rms over vertices of |T - T_true|_2 / |T_unoccluded|_2"};
    }
    static BakeReport::ArrayError error_of_matrices(double rms) {
        return {rms, "rms over vertices of |t - t_true|_F / |a + b of an open vertex|_F"};
    }
    /// One bar for the transport of all meshes, once the first of them begins.
    void announce_transport();

    /// Bakes transport into the store, for its encoding.
    Expected<void> keep_on_disk(const std::string& output, const PlannedDiffuse& diffuse);
    /// All the transport that waited.
    Expected<std::vector<TransportPart>> waiting_parts();
    /// Writes what waited, in its encoding.
    Expected<void> bake(const std::string&, const PlannedEncoding& planned);
    std::vector<std::uint64_t> coefficient_axes(std::size_t coeffs) const;
    Expected<void> write_basis(const ClusteredRows& clusters, std::size_t coeffs);
    Expected<void> write(const TransportPart& part, const EncodedPart& encoded,
                         const ClusteredRows& clusters, std::size_t coeffs);

    WaveletStage& wavelet(const WaveletJob& job);
    Expected<void> bake(const std::string& output, const PlannedWavelet& planned);
    Expected<void> bake(const std::string& output, const PlannedWaveletWeights& planned);
    Expected<void> bake(const std::string& output, const PlannedWaveletLight& planned);

    /// A few vertices spread evenly over all the baked meshes, two thirds of the way into each
    /// stretch.
    void choose_self_test_vertices();
    /// A few vertices of the first meshes.
    void choose_glossy_vertices(std::size_t mesh);
    void keep_self_test_normals(std::size_t mesh, std::span<const float> normals);
    void keep_self_test_rows(std::size_t mesh, std::uint64_t first_vertex,
                             std::span<const float> rows, std::uint64_t row_size,
                             std::span<const float> emitted = {});
    Expected<void> write_self_test();

    // What bake() would have left behind beside arrays, of stages that are kept.
    Expected<void> read_back(const std::string&, const PlannedLights&) { return {}; }
    Expected<void> read_back(const std::string&, const PlannedSh&) { return {}; }
    Expected<void> read_back(const std::string& output, const PlannedMips& mips);
    Expected<void> read_back(const std::string& output, const PlannedTable& planned);
    Expected<void> read_back(const std::string& output, const PlannedLobe& planned);
    Expected<void> read_back(const std::string& output, const PlannedGlossy& glossy);
    Expected<void> read_back(const std::string& output, const PlannedDiffuse& diffuse);
    Expected<void> read_back(const std::string&, const PlannedBounces&);
    Expected<void> read_back(const std::string&, const PlannedEmitted&) { return {}; }
    Expected<void> read_back(const std::string&, const PlannedEncoding&);
    Expected<void> read_back(const std::string&, const PlannedWavelet& planned);
    Expected<void> read_back(const std::string& output, const PlannedWaveletWeights& planned);
    Expected<void> read_back(const std::string&, const PlannedWaveletLight&);
    const Json& older_mesh(std::size_t mesh) const;
    Expected<void> copy_arrays(std::span<const std::string> names);

    const BakeRequest& request_;
    const BakeInputs& inputs_;
    const Json& described_;
    const BakePlan& plan_;
    StageSource& stages_;
    format::Writer& writer_;
    Progress& progress_;
    const OlderBundle* older_ = nullptr;
    std::vector<bool> kept_;            ///< one a stage
    std::vector<std::string> written_;  ///< arrays, since the stage began
    /// Rows of a mesh in the store.
    struct OnDisk {
        std::size_t mesh, begin, size;
    };
    bool encoded_ = false;           ///< transport waits for PlannedEncoding
    std::optional<RowStore> store_;  ///< what does so and does not wait for bounces
    std::vector<OnDisk> on_disk_;
    std::vector<MeshTransport> transport_;  ///< what waits for its bounces or its turn
    int bounce_channels_ = 1;
    std::optional<WaveletStage> wavelet_;
    std::vector<float> wavelet_weights_;
    double vertices_to_trace_ = 0;
    BakeReport report_;
    StoredArrays stored_;
};

/// run_plan(), of stages that run here or ran elsewhere.
///   described  describe_bake()
Expected<BakeOutcome> write_bundle(const BakeRequest& request, const BakeInputs& inputs,
                                   const Json& described, const BakePlan& plan, StageSource& stages,
                                   Older older, Progress& progress);

}  // namespace envbake
