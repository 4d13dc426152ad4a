// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>

namespace envbake {

/// Place along a Z curve: neighbours on the curve are neighbours in space. Bits are interleaved by
/// the usual doubling of the gap between them; coordinates outside [0, 1] count as its ends.
inline std::uint64_t morton2(double x, double y) {
    const auto spread = [](double t) {
        auto v = static_cast<std::uint64_t>(std::clamp(t, 0.0, 1.0) * 0xffffff);
        v = (v | v << 16) & 0x0000ffff0000ffffu;
        v = (v | v << 8) & 0x00ff00ff00ff00ffu;
        v = (v | v << 4) & 0x0f0f0f0f0f0f0f0fu;
        v = (v | v << 2) & 0x3333333333333333u;
        return (v | v << 1) & 0x5555555555555555u;
    };
    return spread(x) | spread(y) << 1;
}

/// The same in space, 21 bits an axis.
inline std::uint64_t morton3(double x, double y, double z) {
    const auto spread = [](double t) {
        auto v = static_cast<std::uint64_t>(std::clamp(t, 0.0, 1.0) * 0x1fffff);
        v = (v | v << 32) & 0x001f00000000ffffu;
        v = (v | v << 16) & 0x001f0000ff0000ffu;
        v = (v | v << 8) & 0x100f00f00f00f00fu;
        v = (v | v << 4) & 0x10c30c30c30c30c3u;
        return (v | v << 2) & 0x1249249249249249u;
    };
    return spread(x) | spread(y) << 1 | spread(z) << 2;
}

}  // namespace envbake
