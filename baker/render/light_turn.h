// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/vector.h"
#include "envbake/runtime/bundle.h"

#include <cmath>
#include <vector>

namespace envbake {

/// The environment turned about +Y after the bake, counter-clockwise seen from above: what shone
/// from +Z shines from +X after a quarter.
class LightTurn {
  public:
    LightTurn() = default;
    explicit LightTurn(double radians)
        : radians_(radians), sine_(std::sin(radians)), cosine_(std::cos(radians)) {}

    double radians() const { return radians_; }
    /// Where the light of direction w of the bake shines from.
    DVec3 turned(const DVec3& w) const {
        return {cosine_ * w.x + sine_ * w.z, w.y, cosine_ * w.z - sine_ * w.x};
    }
    /// Where in the bake the light stood that shines from w.
    DVec3 back(const DVec3& w) const {
        return {cosine_ * w.x - sine_ * w.z, w.y, cosine_ * w.z + sine_ * w.x};
    }
    /// [bands^2, 3], as in ShLightingView.
    std::vector<float> turned(const runtime::ShLightingView& lighting) const;

  private:
    double radians_ = 0, sine_ = 0, cosine_ = 1;
};

}  // namespace envbake
