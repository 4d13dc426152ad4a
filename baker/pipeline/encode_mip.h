// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/lighting/mips.h"
#include "envbake/format/layout.h"

#include <optional>
#include <vector>

namespace envbake {

/// A mip as half floats, in the order of Mip::texels.
struct HalfMip {
    std::vector<format::Half> texels;
    double error = 0;  ///< worst |half - v| / (v + 1e-3 mean)
};

/// Encodes a mip as f16 if that costs no more than `error_budget` anywhere; values beyond 65504 or
/// a dark mip below the half floats' normal range are reasons why it may not.
///
///   mean    the environment's mean radiance, the scale of the error's norm
std::optional<HalfMip> encode_half(const Mip& mip, double mean, double error_budget);

}  // namespace envbake
