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

/// Coefficients as numbers of steps, those that round to 0 left out.
///   step  above max |coeffs| / 32,639
std::vector<WaveletEntry> quantised(std::span<const float> coeffs, float step);

/// One block of "mesh/I/wavelet/blocks", docs/format.md.
///   rows  of up to 256 vertices, each ascending by index
std::vector<std::byte> encode_wavelet_block(std::span<const std::vector<WaveletEntry>> rows);

}  // namespace envbake
