// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/vector.h"

#include <vector>

namespace envbake {

/// "environment/sh": l_i = integral of L(w) Y_i(w) dw, RGB, slot sh::index(l, m); W m^-2.
struct ShLighting {
    int bands = 0;
    std::vector<DVec3> coeffs;  ///< bands * bands; of a grey map all three channels are equal
};

/// "environment/irradiance": A_l l_lm, so that E(n) = sum_i of them times Y_i(n). Source:
/// [Ramamoorthi01].
ShLighting to_irradiance(const ShLighting& lighting);

ShLighting first_bands(const ShLighting& lighting, int bands);

/// The share of each band l: sum over m of l_lm^2 / l_00^2, of the channel where it is largest.
/// All 0 for a black environment.
std::vector<double> band_energy(const ShLighting& lighting);

/// The number of bands, at least 1, that light a diffuse surface as all of them do, to `tolerance`
/// of the mean radiance: exit radiance of albedo 1 is sum_i l_i T_i, and whatever stands in the way
/// |T|_2 <= sqrt(2 / (3 pi)), its value where nothing does. So what bands from n on add is at most
///
///     sqrt(2 / (3 pi)) |l_n..|_2  =  sqrt(8 / 3) |l_n..|_2 / l_00  of the mean radiance
///
/// `energy` is that of band_energy().
int bands_worth_storing(const std::vector<double>& energy, double tolerance);

}  // namespace envbake
