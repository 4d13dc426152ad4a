// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/trace/tracer.h"
#include "baker/transport/ray_origin.h"
#include "baker/transport/ray_set.h"

#include <cstdint>
#include <span>

namespace envbake {

/// Most bands that a row may have.
inline constexpr int kMaxRowBands = 11;

/// What the rays of one place met.
struct Traced {
    int rays = 0;         ///< traced
    int blocked = 0;      ///< of those
    int crossings = 0;    ///< next to each other in the set's order, one blocked, one open
    bool solved = false;  ///< stopped after the pilot
};

enum class Stop { WhereSolved, Never };

/// Transport of one place by tracing one ray set: T_unoccluded less the blocked rays or the sum of
/// the open ones, whichever are fewer. No ray blocked: exactly T_unoccluded. All blocked: exactly
/// 0. Where the set has a pilot and all of it is open, or all blocked, that is taken as the answer
/// and the rest is not traced.
///
///   turn_rad  the set is turned about the normal by this angle
///   row       [n^2], n = 1 .. kMaxRowBands; beyond set.bands the quadrature is not exact
///   masks     [packets of the set] gets which rays were blocked, bit i of packet p; 0 where not
///             traced. Empty: not wanted
///
/// Threads: pure. Sums are of at most ray_count / 16 floats, then of 16 doubles.
Traced visible_transport(const RaySet& set, const Tracer& tracer, const RayOrigin& origin,
                         double turn_rad, std::span<float> row, Stop stop = Stop::WhereSolved,
                         std::span<std::uint16_t> masks = {});

/// What rays in `masks` would have carried, T_unoccluded - T, in the frame of the normal (+Z).
///   masks   [packets of the set]
///   out     [n^2], n = 1 .. kMaxRowBands
void blocked_about_normal(const RaySet& set, double turn_rad, std::span<const std::uint16_t> masks,
                          std::span<double> out);

}  // namespace envbake
