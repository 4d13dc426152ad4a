// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/runtime/bundle.h"

#include <cstdint>
#include <span>

namespace envbake::runtime {

// Shading on the CPU from a bundle. Every function is pure, allocates nothing, never throws, and
// may run on any number of threads at once. What a bundle lacks counts as 0: without lighting the
// irradiance is 0, without mips or a table the specular reflection is.
//
// Directions are unit, glTF world space, away from the surface; none is normalised here.

/// Irradiance on a surface that faces `n`.
///
///     E(n) = sum_l A_l sum_m l_lm Y_lm(n),  A_l of sh::clamped_cosine   (radiance 1 gives E = pi)
///
///   return  RGB, W m^-2. May be negative: behind a lone small light E dips to a few per cent of
///           its peak below 0. Clamp where you shade, not where lighting is still to be blended.
///
/// Source: [Ramamoorthi01].
[[nodiscard]] Rgb irradiance(const ShLightingView& lighting, const Vec3& n) noexcept;

/// Exit radiance of a diffuse vertex of albedo 1, with its shadows: sum_i l_i T_i. Multiply by the
/// albedo. Bands that only one side has count as 0. May be negative, as above.
///
///   row   [bands^2] of one vertex's transport
[[nodiscard]] Rgb diffuse_exit(std::span<const float> row, const ShLightingView& lighting) noexcept;

/// The same for `out.size()` vertices from `first` on, of 1 or 3 transport channels, in every
/// encoding, straight from what is stored, and with what they get from shining surfaces. Vertices
/// past the end of the transport, and every vertex of a mesh without transport, get 0. Many
/// vertices in one call cost less each: the light is prepared once a call, and where transport is
/// clustered, projected again wherever the cluster changes from one vertex to the next.
void diffuse_exit(const TransportView& transport, const ShLightingView& lighting,
                  std::uint64_t first, std::span<Rgb> out) noexcept;

/// Exit radiance of diffuse vertices of albedo 1 by wavelets, with hard shadows: sum over `terms`
/// of value times transport. Lights that come straight from the environment; what surfaces send to
/// each other is not in it.
///
///   terms  ascending by index; of bundle.wavelet_lighting(), or of another map:
///          wavelet::light_coefficients(), then wavelet::select_terms()
///   first  of the vertices to shade; those past the end of the transport get 0
///
/// What does not fit the format counts as 0. O(terms * log(coefficients)) a block of 256 vertices,
/// and the transport of the terms. Source: [Ng03].
void diffuse_exit(const WaveletTransportView& transport, std::span<const wavelet::Term> terms,
                  std::uint64_t first, std::span<Rgb> out) noexcept;

/// How many numbers project_light() makes.
[[nodiscard]] std::size_t projected_size(const ClusterBasisView& basis) noexcept;

/// What every basis row of the clusters sends under a light, in the order that diffuse_exit() reads
/// it in: once a light for all meshes. Does nothing where `projected` has not projected_size().
void project_light(const ClusterBasisView& basis, const ShLightingView& lighting,
                   std::span<float> projected) noexcept;

/// diffuse_exit() of clustered transport by the result of project_light(): n multiply-adds a vertex
/// and channel, whatever the number of bands. 0 where transport is not clustered, or `projected`
/// has another size.
void diffuse_exit(const TransportView& transport, std::span<const float> projected,
                  std::uint64_t first, std::span<Rgb> out) noexcept;

/// Prefiltered radiance seen along `direction` (any length but 0) by a lobe of a roughness. For
/// cube faces a GPU gives the same with trilinear filtering and seamless edges:
///
///   levels   p = roughness * (level_count - 1), clamped to the levels present; the value is linear
///            in p between levels floor(p) and floor(p) + 1.
///   within   the direction meets face f at (u, v) in [-1, 1]^2 (cube.h). In texels,
///            x = (u + 1) / 2 * size - 1/2, y = (v + 1) / 2 * size - 1/2: texel centres are at
///            integers. The value is bilinear between the texels (floor(x), floor(y)),
///            (floor(x) + 1, floor(y)), and so on, weighted by the fractions of x and y.
///   edges    a texel that lies outside f beyond one edge is the texel of the adjoining face that
///            touches that edge at the same place.
///   corners  a texel beyond two edges does not exist: it is the mean of the other three, the three
///            texels that meet in the corner of the cube.
///
/// So the value is continuous over the whole sphere. A lat-long image (lat_long.h, u and v in
/// [0, 1]) has x = u * width - 1/2, y = v * height - 1/2; columns wrap around, and a texel beyond a
/// pole is that of the same row half a turn away: continuous but for the two points of the poles.
///
///   perceptual_roughness   in [0, 1], clamped
[[nodiscard]] Rgb sample_mips(const MipsView& mips, const Vec3& direction,
                              float perceptual_roughness) noexcept;

/// A and B of the specular albedo R0 A + B: bilinear between the four texels around
/// table_position() of each axis (brdf.h); clamped to the table.
struct SpecularAlbedo {
    float a = 0, b = 0;
};
[[nodiscard]] SpecularAlbedo lookup_brdf(const BrdfTableView& table, float n_dot_v,
                                         float perceptual_roughness) noexcept;

/// Average over the hemisphere of the directional albedo E = A + B, 2 integral of E n.v d(n.v):
/// what multiple_scattering.h asks for. Linear between rows of the table; 0 without it.
[[nodiscard]] float lookup_average_albedo(const BrdfTableView& table,
                                          float perceptual_roughness) noexcept;

/// Reflected radiance of the specular lobe in the split-sum form: sample_mips(R) (R0 A + B), where
/// R is v mirrored at n. A view from below the surface counts as grazing, n.v = 0.
///
///   r0   reflectance at normal incidence, per channel: 0.04 for most dielectrics, the base colour
///        of a metal
///
/// Source: [Karis13].
[[nodiscard]] Rgb specular(const Bundle& bundle, Distribution distribution, const Vec3& n,
                           const Vec3& v, float perceptual_roughness, const Rgb& r0) noexcept;

/// The same for bundle.distribution().
[[nodiscard]] Rgb specular(const Bundle& bundle, const Vec3& n, const Vec3& v,
                           float perceptual_roughness, const Rgb& r0) noexcept;

/// A surface as reflect_light sees it.
struct Surface {
    Vec3 normal{0, 0, 1};
    Rgb albedo{};  ///< of the diffuse part: 0 for a metal
    Rgb r0{};      ///< reflectance at normal incidence; all 0: no specular lobe
    float perceptual_roughness = 1;
    Distribution distribution = Distribution::Ggx;
};

/// Radiance that a surface reflects towards `v` of a dominant light that nothing hides:
///
///     L = E max(0, n.l) (albedo / pi + D(h) V(l, v) F(v.h)),   l the light's direction
///
/// A light of angular radius s spreads h over s / 2: the lobe is widened by as much, alpha'^2 =
/// alpha^2 + (s / 2)^2. That keeps the energy and the extent of the highlight, not its shape.
/// Multiply by the light's visibility. To be added where bundle.lights_extracted().
[[nodiscard]] Rgb reflect_light(const DominantLight& light, const Surface& surface,
                                const Vec3& v) noexcept;

}  // namespace envbake::runtime
