// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <numbers>

namespace envbake::lat_long {

/// Equirectangular images: row 0 is +Y, the centre of the image looks along +X.
///
///     u = phi / 2 pi + 1/2,  phi = atan2(z, x) in [-pi, pi]      (columns, left to right)
///     v = theta / pi,        theta = the angle from +Y in [0, pi]  (rows, top to bottom)
template <class Real>
struct ImagePoint {
    Real u = 0;  ///< 0 .. 1
    Real v = 0;  ///< 0 .. 1
};

/// The unit direction at polar angle theta from +Y and azimuth phi about +Y, radians.
template <class Real>
std::array<Real, 3> direction_at_angles(Real theta, Real phi) {
    const Real sin_theta = std::sin(theta);
    return {sin_theta * std::cos(phi), std::cos(theta), sin_theta * std::sin(phi)};
}

template <class Real>
std::array<Real, 3> direction(Real u, Real v) {
    constexpr Real kPi = std::numbers::pi_v<Real>;
    return direction_at_angles(kPi * v, 2 * kPi * (u - Real(0.5)));
}

/// The inverse of direction(); `w` of any length but 0. atan2 in place of acos: a direction next to
/// a pole keeps its digits. At a pole u is 1/2.
template <class Real>
ImagePoint<Real> project(const std::array<Real, 3>& w) {
    constexpr Real kPi = std::numbers::pi_v<Real>;
    return {std::atan2(w[2], w[0]) / (2 * kPi) + Real(0.5),
            std::atan2(std::hypot(w[0], w[2]), w[1]) / kPi};
}

}  // namespace envbake::lat_long
