// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/trace/tracer.h"
#include "baker/transport/ray_origin.h"
#include "baker/transport/ray_set.h"

#include <span>

namespace envbake {

/// Transport of one place by tracing one ray set: T_unoccluded less the blocked rays or the sum of
/// the open ones, whichever are fewer. No ray blocked: exactly T_unoccluded. All blocked: exactly
/// 0.
///
///   turn_rad  the set is turned about the normal by this angle
///   row       [set.bands^2]
///   return    how many rays were blocked
///
/// Threads: pure. Sums are of at most ray_count / 16 floats, then of 16 doubles.
int visible_transport(const RaySet& set, const Tracer& tracer, const RayOrigin& origin,
                      double turn_rad, std::span<float> row);

}  // namespace envbake
