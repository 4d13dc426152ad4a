// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/render/picture.h"

namespace envbake {

/// The factor that brings the log-average luminance of the surface pixels (of all pixels when there
/// is no surface) to a middle grey of 0.18 times `key`. Pixels darker than a thousandth of the mean
/// count as that, so that a few black corners do not decide. 1 for a black picture.
/// Source: [Reinhard02] eq. 1, over surfaces only.
double auto_exposure(const Picture& picture, double key = 1);

/// Radiance times `exposure` to sRGB: a filmic curve on each channel, which bends highlights softly
/// instead of cutting them, then the sRGB transfer function, rounded to 8 bits.
///
///     curve(x) = x (2.51 x + 0.03) / (x (2.43 x + 0.59) + 0.14), cut to [0, 1]
///
/// Negative radiance is black. Source of the curve: [Narkowicz16], a fit to ACES.
DisplayPicture tone_map(const Picture& picture, double exposure);

/// The curve alone and the transfer function alone, both rising from 0 to 1.
double filmic_curve(double x);
double srgb_from_linear(double linear);

}  // namespace envbake
