// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/environment.h"
#include "baker/math/vector.h"
#include "baker/render/light_turn.h"

#include <cstddef>
#include <vector>

namespace envbake {

/// Picks directions in proportion to the luminance of an environment, texel by texel (luminance
/// times exact solid angle), by inverting a row and a column distribution: neighbouring random
/// numbers give neighbouring directions, so stratified points stay stratified.
/// Keeps a reference to the environment. Threads: const members may be called from any.
class EnvironmentSampler {
  public:
    explicit EnvironmentSampler(const Environment& environment, const LightTurn& turn = {});

    struct Light {
        DVec3 direction{0};  ///< unit
        Vec3 radiance{0};
        double pdf = 0;  ///< per steradian; 0: this direction is never picked
    };
    /// u0, u1 in [0, 1). pdf 0 when the environment is black.
    Light sample(double u0, double u1) const;
    /// What shines from `w`, and how densely sample() picks it.
    Light towards(const DVec3& w) const;

  private:
    struct Texel {
        std::size_t row = 0;  ///< faces of a cube one below the other
        std::size_t column = 0;
    };
    Texel texel_of(const DVec3& w) const;
    double solid_angle(const Texel& texel) const;
    double pdf(const Texel& texel, const DVec3& w) const;

    const Environment& environment_;
    LightTurn turn_;
    std::size_t rows_ = 0, columns_ = 0;
    std::vector<double> row_cdf_;     ///< rows + 1, up to total_
    std::vector<double> column_cdf_;  ///< rows * (columns + 1), each up to its row's weight
    double total_ = 0;                ///< luminance integrated over the sphere
};

/// Of linear Rec. 709 light.
inline double luminance(const DVec3& rgb) {
    return 0.2126 * rgb.x + 0.7152 * rgb.y + 0.0722 * rgb.z;
}

}  // namespace envbake
