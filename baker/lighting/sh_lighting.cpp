// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/sh_lighting.h"

#include "envbake/runtime/sh.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>

namespace envbake {

ShLighting to_irradiance(const ShLighting& lighting) {
    ShLighting irradiance = lighting;
    for (int l = 0; l < lighting.bands; ++l) {
        for (int m = -l; m <= l; ++m) {
            irradiance.coeffs[static_cast<std::size_t>(sh::index(l, m))] *= sh::clamped_cosine(l);
        }
    }
    return irradiance;
}

ShLighting first_bands(const ShLighting& lighting, int bands) {
    assert(bands <= lighting.bands);
    return {bands, {lighting.coeffs.begin(), lighting.coeffs.begin() + sh::coeff_count(bands)}};
}

std::vector<double> band_energy(const ShLighting& lighting) {
    std::vector<double> energy;
    const DVec3 mean = lighting.coeffs[0];
    for (int l = 0; l < lighting.bands; ++l) {
        DVec3 sum(0);
        for (int m = -l; m <= l; ++m) {
            const DVec3& c = lighting.coeffs[static_cast<std::size_t>(sh::index(l, m))];
            // Divided first: the square of 1e30 would leave little room.
            for (int k = 0; k < 3; ++k) sum[k] += mean[k] > 0 ? std::pow(c[k] / mean[k], 2) : 0;
        }
        energy.push_back(std::max({sum.x, sum.y, sum.z}));
    }
    return energy;
}

int bands_worth_storing(const std::vector<double>& energy, double tolerance) {
    int bands = static_cast<int>(energy.size());
    double dropped = 0;
    while (bands > 1) {
        dropped += energy[static_cast<std::size_t>(bands - 1)];
        if (std::sqrt(8.0 / 3 * dropped) > tolerance) break;
        --bands;
    }
    return bands;
}

}  // namespace envbake
