// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/trace/tracer.h"

#include <array>
#include <cstddef>
#include <vector>

namespace envbake {

/// Directions over the hemisphere about +Z and the weights of a quadrature that is exact for the
/// unoccluded transfer of every coefficient:
///
///     sum_k w_k Y_i(w_k) = 1/pi * integral of max(0, z) Y_i(w) dw,    w_k >= 0
///
/// So what open rays add and what blocked rays take away is one and the same, and either side may
/// be summed. Turning the set about any axis keeps that, since rotations mix Y_i within a band.
struct RaySet {
    int bands = 0;
    int ray_count = 0;                           ///< a multiple of 16
    std::size_t pilot_packets = 0;               ///< these come first; 0: no pilot
    std::vector<DirectionPacket> directions;     ///< neighbours together: a packet is a patch
    std::vector<std::array<float, 16>> weights;  ///< of each packet's rays; about 1 / ray_count
    double smallest_relative_weight = 0;         ///< min over k of w_k ray_count, >= 0
};

/// The Fibonacci spiral on the disc, lifted to the hemisphere (Malley's method): density cos / pi,
/// hence weights near 1 / N. They are the equal weights changed by as little as makes them exact
/// (least squares). Where that leaves one negative (too few rays for so many coefficients) there
/// are more rays than asked for: the next multiples of 16
/// (of 64 for a small set with a pilot) above
/// ray_count * 1.25^k.
///
/// With a pilot every fourth ray of the spiral comes first: a spiral again, of four times the
/// angle, spread well enough to tell whether anything is in sight. Pilot and rest are each sorted
/// into patches. The set stays the same, only its order differs.
///
///   ray_count  >= 1
///   bands      1 .. 10
///
/// Cost: O(N bands^4), in double. At one given ray count the set is always the same.
RaySet make_ray_set(int ray_count, int bands, bool with_pilot = false);

}  // namespace envbake
