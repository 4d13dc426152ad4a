// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/vector.h"

#include <cstdint>

namespace envbake::bench {

/// Point i of `count`: (i + 1/2) / count and the radical inverse of i in base 2.
inline DVec2 hammersley(int i, int count) {
    auto bits = static_cast<std::uint32_t>(i);
    double inverse = 0;
    for (double digit = 0.5; bits != 0; bits >>= 1, digit /= 2) {
        if ((bits & 1u) != 0) inverse += digit;
    }
    return {(i + 0.5) / count, inverse};
}

}  // namespace envbake::bench
