// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace envbake {

/// A coefficient in units of the step: value = units * step.
struct WaveletEntry {
    std::uint32_t index = 0;
    std::int16_t units = 0;
};

/// Coefficients as numbers of steps. Those of less than one are left out, and not only those that
/// would round to 0: fewer coefficients for the same error than larger steps give. Measured
/// with 0.9 steps in place of 1, faces of 64: 2,078 and 3,638 a vertex of a garden and a scan,
/// against 2,428 and 4,532 where all that rounds to 0 is left out, of steps a third larger.
///   step  above max |coeffs| / 32,639
std::vector<WaveletEntry> quantised(std::span<const float> coeffs, float step);

/// One block of "mesh/I/wavelet/blocks", docs/format.md.
///   rows  of up to 256 vertices, each ascending by index
std::vector<std::byte> encode_wavelet_block(std::span<const std::vector<WaveletEntry>> rows);

}  // namespace envbake
