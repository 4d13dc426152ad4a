// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/pipeline/metadata.h"
#include "baker/plan/plan.h"

#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace envbake {

// A shard is a bundle that holds what the stages gave for a part of a bake's work, before any
// encoding. By format::kShardName every reader knows it. Its other arrays stand under "shard/";
// what they are is a matter between one version's `bake --shard` and `merge`, so its metadata has
// the names that the code has.

/// The array, or the first part of the names of the arrays, that hold what a stage gave.
std::string shard_name(const std::string& output);

/// What of a bake is one shard's. Vertices are cut into blocks, the blocks of all meshes that get
/// transport are numbered through, and each shard has as many of them as the others; what no
/// vertices belong to goes round.
class ShareOfWork {
  public:
    ShareOfWork(const BakePlan& plan, const BakeFacts& facts, Shard shard);

    struct Range {
        std::size_t begin = 0, end = 0;
    };
    /// Vertices of a mesh; empty where none are this shard's.
    Range vertices(std::size_t mesh) const { return ranges_[mesh]; }
    /// Of the stages without vertices, in the order of the plan: whether the next is this shard's.
    bool takes_next();

  private:
    Shard shard_;
    int next_ = 0;
    std::vector<Range> ranges_;
};

/// The metadata of a shard without its own results: what is the same in every shard of a bake.
///   described  describe_bake()
Json shared_json(const BakeRequest& request, const BakeInputs& inputs, const Json& described);

/// What `shared` says of how the parts become a whole. Neither scene nor environment is there.
///
/// Errors:  Json::exception  it says something else
struct SharedState {
    BakeRequest request;  ///< without paths
    BakeInputs inputs;    ///< lights, SH, facts
};
SharedState read_shared(const Json& shared);

/// The plan of the bake whose state that is. `shared` may be forged: everything that the rest of a
/// merge counts or indexes by is held against everything else.
///
/// Errors:  InvalidBundle    it contradicts itself
///          Json::exception  it lacks something
Expected<BakePlan> plan_of_shards(const Json& shared, const SharedState& state);

/// A number that counts something. Throws Json::exception where it does not.
std::uint64_t read_count(const Json& json);

Json report_json(const DiffuseReport& report);
Json report_json(const WaveletReport& report);
Json report_json(const BrdfTable& table);  ///< all but the numbers
// Json::exception where they say something else.
void read_report(const Json& json, DiffuseReport& report);
void read_report(const Json& json, WaveletReport& report);
void read_report(const Json& json, BrdfTable& table);

}  // namespace envbake
