// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/trace/tracer.h"
#include "baker/transport/ray_origin.h"

#include <cstdint>
#include <vector>

namespace envbake::bench {

enum class Samples {
    Independent,  ///< random directions over the sphere
    Jittered,     ///< one in each cell of a grid of equal solid angles over the sphere
};

/// Diffuse transport as the textbook does it [Green03]: samples over the sphere, those above the
/// surface traced one at a time, and every open one's cosine and basis added up.
///
///   grid    grid^2 samples on the sphere
///   return  [bands^2], T as envbake defines it
std::vector<float> sampled_transport(Samples samples, int grid, int bands, const RayOrigin& origin,
                                     const Tracer& tracer, std::uint64_t seed);

}  // namespace envbake::bench
