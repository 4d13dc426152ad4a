// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace envbake {

/// A counter-based random stream: number k of stream (seed, stage, element) is a pure function of
/// the four, so results do not depend on threads or on order.
/// Source: the SplitMix64 finaliser, Steele, Lea, Flood 2014, "Fast splittable pseudorandom number
/// generators".
class RandomStream {
  public:
    RandomStream(std::uint64_t seed, std::uint64_t stage, std::uint64_t element)
        : state_(mix(mix(mix(seed) + stage) + element)) {}

    std::uint64_t next_bits() { return mix(state_ += kGamma); }
    /// Uniform in [0, 1), 53 bits.
    double next() { return static_cast<double>(next_bits() >> 11) * 0x1p-53; }

  private:
    static constexpr std::uint64_t kGamma = 0x9e3779b97f4a7c15u;
    static constexpr std::uint64_t mix(std::uint64_t z) {
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
        return z ^ (z >> 31);
    }
    std::uint64_t state_;
};

}  // namespace envbake
