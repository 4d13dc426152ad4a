// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/trace/occluders.h"
#include "baker/transport/ray_origin.h"
#include "baker/transport/ray_set.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

namespace envbake::bench {

/// Embree and nothing else: the scene's occluders in a tree with the flags of the baker's, packets
/// of rays laid out before the clock starts, and a loop of rtcOccluded16 over them. A masked
/// triangle counts as solid.
class BareRays {
  public:
    struct Result {
        double cpu_s = 0;  ///< of the calling thread, inside the loop
        std::uint64_t ray_count = 0;
        std::uint64_t blocked_count = 0;
    };

    BareRays(const Scene& scene, const TraceSpace& space);
    ~BareRays();

    /// The first packet_counts[i] packets of `set`, turned by `turn_rad` about the normal of
    /// origins[i].
    Result trace(const RaySet& set, std::span<const RayOrigin> origins,
                 std::span<const std::size_t> packet_counts, double turn_rad) const;

  private:
    struct State;
    std::unique_ptr<State> state_;
};

double thread_cpu_seconds();

}  // namespace envbake::bench
