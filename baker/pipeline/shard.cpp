// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/shard.h"

#include <algorithm>
#include <variant>

namespace envbake {

namespace {

/// The mesh whose vertices a stage works on.
std::optional<std::size_t> mesh_of(const Job& job) {
    if (const auto* glossy = std::get_if<PlannedGlossy>(&job)) return glossy->mesh;
    if (const auto* diffuse = std::get_if<PlannedDiffuse>(&job)) return diffuse->mesh;
    if (const auto* wavelet = std::get_if<PlannedWavelet>(&job)) return wavelet->mesh;
    return std::nullopt;
}

}  // namespace

std::string shard_name(const std::string& output) {
    return "shard/" + output;
}

ShareOfWork::ShareOfWork(const BakePlan& plan, const BakeFacts& facts, Shard shard)
    : shard_(shard), ranges_(facts.meshes.size()) {
    std::vector<bool> has_rows(facts.meshes.size(), false);
    for (const PlannedStage& stage : plan.stages)
        if (stage.job)
            if (const auto mesh = mesh_of(*stage.job)) has_rows[*mesh] = true;
    const auto blocks_of = [&](std::size_t mesh) -> std::uint64_t {
        if (!has_rows[mesh]) return 0;
        return (facts.meshes[mesh].vertex_count + kWaveletBlock - 1) / kWaveletBlock;
    };
    std::uint64_t all = 0;
    for (std::size_t mesh = 0; mesh < ranges_.size(); ++mesh) all += blocks_of(mesh);
    const auto count = static_cast<std::uint64_t>(shard.count);
    const auto index = static_cast<std::uint64_t>(shard.index);
    const std::uint64_t first = all * (index - 1) / count, end = all * index / count;
    std::uint64_t before = 0;
    for (std::size_t mesh = 0; mesh < ranges_.size(); ++mesh) {
        const std::uint64_t blocks = blocks_of(mesh);
        const auto vertex_at = [&](std::uint64_t block) {
            const std::uint64_t within = std::clamp(block, before, before + blocks) - before;
            return std::min(within * kWaveletBlock, facts.meshes[mesh].vertex_count);
        };
        ranges_[mesh] = {vertex_at(first), vertex_at(end)};
        before += blocks;
    }
}

bool ShareOfWork::takes_next() {
    return next_++ % shard_.count == shard_.index - 1;
}

}  // namespace envbake
