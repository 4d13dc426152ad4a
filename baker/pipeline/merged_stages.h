// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/pipeline/shard.h"
#include "baker/pipeline/stage_source.h"

#include "envbake/format/reader.h"

#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace envbake {

/// A part of a bake, as it lies on the disk.
struct ShardFile {
    std::filesystem::path path;
    std::map<std::string, Json> results;  ///< of the stages that it ran, by their output
};

/// What the stages gave, read from shards. A shard is mapped only as long as one of its arrays is
/// looked at: memory does not grow with them.
///
/// Errors:  InvalidBundle  a shard is damaged, or lacks what it should have
///          Failed         it cannot be read
class MergedStages : public StageSource {
  public:
    /// shards  all of a bake, in order
    /// inputs  facts, and where light bounces the scene: that needs all transport at once
    MergedStages(std::span<const ShardFile> shards, const BakeInputs& inputs, Isa isa,
                 Progress& progress)
        : shards_(shards),
          inputs_(inputs),
          isa_(isa),
          progress_(progress),
          blocked_(inputs.facts.meshes.size()) {}

    Expected<std::vector<Mip>> mips(const std::string& output, const MipsJob& job) override;
    Expected<BrdfTable> table(const std::string& output, const BrdfTableJob& job) override;
    Expected<LobeExpansion> lobe(const std::string& output, const LobeExpansionJob& job) override;
    Expected<DiffuseReport> rows(const std::string& output, const DiffuseJob& job, std::size_t mesh,
                                 bool for_bounces, const Sink<float>& sink) override;
    Expected<std::vector<float>> normals(std::size_t mesh) override;
    Expected<BounceReport> bounces(const BounceJob& job,
                                   std::span<MeshTransport> transport) override;
    Expected<WaveletReport> wavelet(const std::string& output, const WaveletJob& job,
                                    std::size_t mesh, const Sink<std::byte>& sink,
                                    std::vector<std::uint32_t>& offsets,
                                    std::span<std::uint64_t> square_sums) override;
    Expected<WaveletLight> wavelet_light(const std::string& output, const WaveletJob& job,
                                         int channels,
                                         std::span<const WaveletMesh> meshes) override;

  private:
    /// The shard that has a stage without vertices.
    Expected<const ShardFile*> owner(const std::string& output) const;
    struct Part {
        const ShardFile* shard;
        std::uint64_t begin, end, pieces;  ///< vertices, and arrays that they are in
        Json result;
    };
    /// All vertices of a mesh, in order.
    Expected<std::vector<Part>> parts(const std::string& output, std::size_t mesh) const;

    /// What the rays of a mesh met.
    Expected<void> read_blocked(const std::string& output, const DiffuseJob& job, std::size_t mesh,
                                std::span<const Part> parts);

    std::span<const ShardFile> shards_;
    const BakeInputs& inputs_;
    Isa isa_;
    Progress& progress_;
    std::vector<BlockedRays> blocked_;  ///< [mesh]
};

}  // namespace envbake
