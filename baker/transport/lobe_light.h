// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/axial_form.h"
#include "baker/transport/reflected_light.h"
#include "baker/transport/seen_surfaces.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace envbake {

/// Light between surfaces as specular lobes meet it. Glossy transport has the mean of what the
/// blocked directions of a vertex send; where that errs more than the tolerance leaves, "mesh/I/
/// reflected" says how they differ, in as few bands as bring it below.
struct LobeLightJob {
    static constexpr std::size_t kNoLobe = ~std::size_t{0};

    /// LobeErrors::of_reflected of each roughness and distribution of a lobe, [lobe]. Those of
    /// strong lobes are large: what a dielectric errs in the mean is nothing to the tolerance.
    std::vector<std::vector<AxialForm>> errors;
    std::vector<std::size_t> lobe_of_mesh;  ///< [meshes]; kNoLobe: no glossy transport
    int light_bands = 5;                    ///< of glossy transport
};

/// Errors are |t - t_true|_F / |a + b of an open vertex|_F, of the scene's vertices that have
/// glossy transport, as if all of them had this lobe.
struct LobeLightReport {
    int bands = 1;      ///< of "mesh/I/reflected"; 1: the mean is enough
    double stride = 0;  ///< every so many-th blocked ray was followed
    double error_rms = 0;
    double error_p999 = 0;  ///< 99.9th percentile over vertices
};

/// The errors, measured: a sample of the vertices follows every blocked ray of a set that is turned
/// otherwise.
class LobeLight {
  public:
    /// The transport of a place by its number: coefficients of the lighting, times channels.
    using RowOf = std::function<const float*(std::uint32_t)>;

    ///   truth  a row for each place of the sample, by every ray
    LobeLight(const LobeLightJob& job, int channels, RowOf row_of, SeenSurfaces truth);

    /// Of one lobe.
    struct Errors {
        double noise = 0;  ///< rms of the few rays, if every band were stored
        /// [bands - 1], of the noise and of the bands that are not stored.
        std::vector<double> rms, p999;

        double least() const { return *std::min_element(rms.begin(), rms.end()); }
        Errors& operator*=(double factor);
    };
    /// What every stride-th ray errs, [lobe].
    ///   seen      a row for each of the sample
    ///   exponent  the error falls with the number of rays N as N^-exponent
    std::vector<Errors> errors(const SeenSurfaces& seen, double stride, double exponent) const;

    /// f16, a row of "mesh/I/reflected": [bands^2 - 1, light_bands^2, channels].
    ///   row     of `seen`
    ///   normal  of the place
    std::vector<std::uint16_t> stored_row(const SeenSurfaces& seen, std::size_t row,
                                          const DVec3& normal, int bands) const;

  private:
    const LobeLightJob& job_;
    ReflectedLight::Job sums_;
    SeenSurfaces truth_;
};

/// The fewest bands whose error is below `allowed`; where none is, those that err the least.
LobeLightReport choose_bands(const LobeLight::Errors& errors, double allowed);

}  // namespace envbake
