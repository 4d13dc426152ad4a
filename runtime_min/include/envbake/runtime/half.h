// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstdint>

namespace envbake::runtime {

// IEEE 754 binary16: 1 sign, 5 exponent, 10 fraction bits. Largest finite value 65504, smallest
// normal 2^-14, smallest subnormal 2^-24.

/// Exact for every bit pattern. NaN stays NaN, with its payload.
constexpr float half_to_float(std::uint16_t half) {
    const std::uint32_t sign = (half & 0x8000u) << 16;
    const std::uint32_t magnitude = half & 0x7fffu;
    if (magnitude >= 0x7c00u) {  // infinity, NaN
        return std::bit_cast<float>(sign | 0x7f800000u | (magnitude & 0x03ffu) << 13);
    }
    if (magnitude >= 0x0400u) {  // normal: only the exponent's bias changes, 15 to 127
        return std::bit_cast<float>(sign | ((magnitude << 13) + (112u << 23)));
    }
    // Zero and subnormals: magnitude * 2^-24, exact in float.
    const float value = static_cast<float>(magnitude) * 0x1p-24f;
    return sign != 0 ? -value : value;
}

/// Rounds to the nearest half, ties to even. From 65520 on: infinity. NaN stays NaN, quiet.
constexpr std::uint16_t float_to_half(float value) {
    const std::uint32_t bits = std::bit_cast<std::uint32_t>(value);
    const std::uint32_t sign = bits >> 16 & 0x8000u;
    const std::uint32_t magnitude = bits & 0x7fffffffu;

    if (magnitude > 0x7f800000u) {
        return static_cast<std::uint16_t>(sign | 0x7e00u | (magnitude >> 13 & 0x03ffu));
    }
    if (magnitude >= 0x477ff000u) {  // 65520, half way to the number after 65504
        return static_cast<std::uint16_t>(sign | 0x7c00u);
    }
    // What is dropped is `shift` low bits of `kept`; a carry runs into the exponent, as it should.
    std::uint32_t kept = magnitude - (112u << 23);
    std::uint32_t shift = 13;
    if (magnitude < 0x38800000u) {  // below 2^-14: a subnormal half, or zero
        const std::uint32_t exponent = magnitude >> 23;
        if (exponent < 102) return static_cast<std::uint16_t>(sign);  // below 2^-25
        kept = (magnitude & 0x007fffffu) | 0x00800000u;
        shift = 126 - exponent;
    }
    const std::uint32_t dropped = kept & ((1u << shift) - 1);
    const std::uint32_t tie = 1u << (shift - 1);
    std::uint32_t rounded = kept >> shift;
    if (dropped > tie || (dropped == tie && (rounded & 1u) != 0)) ++rounded;
    return static_cast<std::uint16_t>(sign | rounded);
}

}  // namespace envbake::runtime
