// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/vector.h"

#include <cmath>

namespace envbake {

/// Right-handed and orthonormal: tangent x bitangent = normal.
struct Frame {
    DVec3 tangent, bitangent, normal;

    DVec3 to_world(const DVec3& local) const {
        return tangent * local.x + bitangent * local.y + normal * local.z;
    }
};

/// The frame about a unit normal: no branch, no loss of digits at either pole, continuous but for
/// z = 0. Source: [Duff17], listing 3.
inline Frame frame_about(const DVec3& normal) {
    const double sign = std::copysign(1.0, normal.z);
    const double a = -1 / (sign + normal.z);
    const double b = normal.x * normal.y * a;
    return {{1 + sign * normal.x * normal.x * a, sign * b, -sign * normal.x},
            {b, sign + normal.y * normal.y * a, -normal.y},
            normal};
}

/// The same frame turned about its normal, counter-clockwise as seen from its tip.
inline Frame turned(const Frame& frame, double angle_rad) {
    const double c = std::cos(angle_rad), s = std::sin(angle_rad);
    return {frame.tangent * c + frame.bitangent * s, frame.bitangent * c - frame.tangent * s,
            frame.normal};
}

}  // namespace envbake
