// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vec3.h"

#include <array>
#include <vector>

namespace envbake::sample {

struct SkyOptions {
    int width = 1024;               ///< >= 1
    int height = 512;               ///< >= 1
    double sun_elevation_deg = 36;  ///< above the horizon, 1 .. 90
    double sun_azimuth_deg = 140;   ///< about +Y: 0 is +X, 90 is +Z
    double turbidity = 2.5;         ///< 2 is very clear, 4 is hazy; [Preetham99] holds for 2 .. 10
    bool overcast = false;          ///< the CIE overcast sky: no sun, no colour to speak of
    bool sun_disc = true;           ///< false leaves the disc out (the clear sky around it stays)
};

/// Radiance as stored in an equirectangular image: row 0 at +Y, u = atan2(z, x) / 2 pi + 1/2, so
/// that the centre of the image looks along +X. Linear Rec. 709; 1 stands for 5 kcd m^-2.
struct SkyImage {
    int width = 0;
    int height = 0;
    std::vector<std::array<float, 3>> radiance;  ///< rows from the top
};

inline constexpr double kSunHalfAngleDeg = 0.265;  ///< seen from the Earth, 0.53 degrees across

/// Unit, towards the sun: (cos e cos a, sin e, cos e sin a).
Vec3 sun_direction(const SkyOptions& options);

/// Radiance of the sun's disc, uniform across it: sunlight outside the atmosphere, reddened and
/// weakened by the air and dust on its way. About 2e5 for a sun high in a clear sky.
Vec3 sun_radiance(const SkyOptions& options);

/// Radiance of the sky, without the disc of the sun, and below the horizon of the ground.
class Sky {
  public:
    explicit Sky(const SkyOptions& options);
    Vec3 radiance(Vec3 w) const;
    Vec3 ground() const { return ground_; }

  private:
    Vec3 above_horizon(Vec3 w) const;

    struct Perez {
        double a = 0, b = 0, c = 0, d = 0, e = 0;
        double operator()(double cos_theta, double gamma) const;
    };
    bool overcast_ = false;
    Vec3 sun_;
    Perez luminance_, chroma_x_, chroma_y_;
    Vec3 zenith_;  ///< luminance in kcd m^-2, chromaticities x and y, each over its Perez term
    Vec3 ground_;
};

/// Adds the sun's disc to an image of any size. The disc is box-filtered: each texel gets its
/// radiance times the share of the texel's solid angle that the disc covers, so that the energy of
/// the sun is the same at every size, down to a single texel.
void add_sun(const SkyOptions& options, SkyImage& image);

/// Draws the sky and the ground, texel by texel, and the sun.
SkyImage make_sky(const SkyOptions& options);

}  // namespace envbake::sample
