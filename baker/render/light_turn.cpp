// SPDX-License-Identifier: Apache-2.0
#include "baker/render/light_turn.h"

#include "envbake/runtime/sh_rotation.h"

#include <cassert>

namespace envbake {

std::vector<float> LightTurn::turned(const runtime::ShLightingView& lighting) const {
    std::vector<float> coeffs(lighting.coeffs.begin(), lighting.coeffs.end());
    if (radians_ == 0 || lighting.bands == 0) return coeffs;
    const auto rotation = sh::Rotation::from_quaternion(
        {0, std::sin(radians_ / 2), 0, std::cos(radians_ / 2)}, lighting.bands);
    const bool done = rotation && rotation->apply(lighting.coeffs, coeffs, 3);
    assert(done);  // a quaternion of length 1, and no more bands than a bundle may have
    static_cast<void>(done);
    return coeffs;
}

}  // namespace envbake
