// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/axial_form.h"
#include "envbake/runtime/brdf.h"

#include <vector>

namespace envbake {

struct LobeExpansionJob {
    runtime::Distribution distribution = runtime::Distribution::Ggx;
    int exit_bands = 5;         ///< 1 .. 5
    int light_bands = 5;        ///< 1 .. 5
    double roughness[2]{1, 1};  ///< perceptual, 0 <= least <= largest <= 1
};

/// "brdf/ggx_lobe/..." and "brdf/beckmann_lobe/...": the specular lobe in SH about its normal, +Z.
///
/// What leaves a surface is 0 below its horizon, and a few bands cannot show that edge. Nobody
/// looks from there, so coefficients are not those of a projection: they are the best for who looks
/// from above. Of a function L over the upper hemisphere, with L(o*) its mirror image below,
///
///     e = argmin of integral over the sphere of (max(0, o.z) + d) (L(o*) - sum_j e_j Y_j(o))^2 do
///
/// The weight is what the surface sends; d, kHorizonWeight, keeps coefficients from growing without
/// bound under the horizon: they are some 6 times the least ones, and not 900.
///
/// The part f_p of the BRDF, p = a or b with Fresnel R0 a + b, turns light into such coefficients:
///
///     unoccluded_ji = e_j of L(o) = integral of f_p(w, o) w.z Y_i(w) dw
///     kernel_jk     = pi * the coefficients of f_p(w, o) in both its directions
///
/// An isotropic lobe does not mix orders m, and +m and -m are alike: a matrix is its blocks of m =
/// 0, 1, ..., one after the other, each [degrees m .. exit_bands - 1, degrees m ...].
struct LobeExpansion {
    /// Perceptual roughness of the rows: roughness[0] + (roughness[1] - roughness[0]) i / (rows -
    /// 1). 32 steps would lie between 0 and 1.
    int rows = 0;
    std::vector<float> unoccluded;  ///< [rows, 2, blocks of light_bands columns]
    std::vector<float> kernel;      ///< [rows, 2, blocks of kLobeBands columns]
};

LobeExpansion expand_lobe(const LobeExpansionJob& job);

/// What the expansion of a lobe R0 a + b leaves to be said of errors. Matrices are compared as
///
///     |t - t_true|_F / |a + b of a place that sees everything|_F
///
/// over exit and lighting coefficients: relative to a lobe that reflects all it can, as the error
/// of diffuse transport is relative to a white surface.
struct LobeErrors {
    /// The square of the error of t by the errors of a row of "mesh/I/glossy", about the normal:
    /// sum_ij (sum_k k_jk sum_m G_ikm x_m)^2.
    AxialForm of_row;
    /// The same by the errors x of light that surfaces send, weighted by the cosine, in kLobeBands
    /// bands about the normal: sum_j (sum_k k_jk x_k)^2 for each coefficient of the lighting.
    AxialForm of_reflected;
    /// By which the error of diffuse transport (DiffuseJob::tolerance, of light_bands) were
    /// multiplied to have that of t, both from the same rays, were outlines of what is blocked
    /// anywhere alike. They are not: most are near the horizon, where a lobe reflects the most.
    double per_transport_error = 0;
    /// Error of t where every number of "mesh/I/glossy" is off by independent errors of rms 1: by
    /// sum_im (sum_k k_jk G_ikm)^2 = light_bands^2 / 4pi sum_k k_jk^2, since the squares of the
    /// basis functions of whole bands add up to a constant.
    double per_rounding_error = 0;
    /// Of a place that sees no light at all, where the kernel's kLobeBands bands decide everything.
    /// Goes as the root of the blocked share.
    double fit = 0;
    /// Of the exit radiance that the true lobe has, what its exit_bands miss, relative to itself:
    /// rms over directions of light and of view, both weighted by their cosines. 0 of a mirror
    /// stands for all of it.
    double lost = 0;
};
LobeErrors lobe_errors(const LobeExpansionJob& job, double perceptual_roughness, double r0);

}  // namespace envbake
