// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/environment.h"
#include "envbake/runtime/wavelet.h"

#include <span>
#include <vector>

namespace envbake {

/// The coefficients of the environment in the basis of runtime/wavelet.h: exact box averages over
/// the texels, times their solid angles.
///   channels  3, or 1: the map is grey, and red stands for all
///   return    [wavelet::coeff_count(face_size)]
std::vector<wavelet::Rgb> project_wavelet(const Environment& environment, int face_size,
                                          int channels);

/// Lighting terms, ascending by index, and what leaving out the others costs.
struct ChosenTerms {
    std::vector<wavelet::Term> terms;
    double error = 0;  ///< relative rms exit radiance over rows and channels
};

/// As few terms as keep the error below `tolerance`, for this number and for every larger one. They
/// are taken in the order of wavelet::select_terms(), by what they add to vertices (rms).
///   coeffs   of the light
///   weights  [coeffs]: rms of transport
///   rows     transport of some vertices, [coeffs] each
ChosenTerms choose_terms(std::span<const wavelet::Rgb> coeffs, std::span<const float> weights,
                         std::span<const std::vector<float>> rows, double tolerance);

/// What SH of so many bands lose where this light throws a hard shadow: the relative rms error of
/// the irradiance of surfaces that see the sky on one side of a straight edge through their zenith
/// distance of all angles (48 surfaces and edges, spread evenly), on texels of 6 degrees. A smooth
/// map loses a few hundredths, a sun in the open a third.
double sh_shadow_loss(const Environment& environment, int bands);

}  // namespace envbake
