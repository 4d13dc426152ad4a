// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "sky.h"

#include <array>
#include <cstdint>
#include <string>

namespace envbake::sample {

/// Ward's shared-exponent encoding, rounded to the nearest representable value: the largest channel
/// is off by at most 1/256 of itself, the others by as much in absolute terms. A value v is stored
/// as mantissa m with v = m 2^(exponent - 136). Non-negative, finite, below 2^127.
std::array<std::uint8_t, 4> to_rgbe(const std::array<float, 3>& rgb);

/// A whole Radiance .hdr file, rows run-length encoded where the format allows it (width 8 ..
/// 32767).
std::string encode_hdr(const SkyImage& image);

}  // namespace envbake::sample
