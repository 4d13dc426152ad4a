// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/runtime/bundle.h"
#include "envbake/runtime/lobe.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace envbake::runtime {

// Glossy transport: what the specular lobe of a vertex reflects of SH lighting, with shadows. The
// exit radiance is in SH, too,
//
//     L(o) = sum_j (sum_i l_i t_ij) Y_j(o),   t = R0 a + b,   Schlick's Fresnel split exactly
//
// and holds for directions o above the surface only: its coefficients are the best there (least
// squares weighted by n.o), not those of a projection.
//
// The bundle does not hold t. It holds what t is made from, which no roughness changes:
//
//     V_m = 1/pi * integral of V(w) max(0, n.w) Y_m(w) dw      "mesh/I/glossy"
//
// to six bands more than the lighting has, and the lobe about its normal (lobe.h), "unoccluded" u
// and "kernel" k. With B = V of a place that sees everything, less V, and G the integral of three
// basis functions,
//
//     t_ij = u_ji - sum_k k_jk sum_m G_ikm B_m       (u and k turned to the vertex' normal)
//
// So a vertex that sees everything has exactly the lobe's own matrix. Where light bounces, the
// blocked directions send light themselves: the mean of what "mesh/I/diffuse" has from them, and
// what "mesh/I/reflected", where the bundle has it, moves from one of them to another. In a furnace
// nothing is lost. [Sloan02] section 4 stores the matrices; that they are products of a vector
// follows from the basis being closed under multiplication. Nothing here allocates or throws; pure
// functions, for any number of threads.

/// What reaches a vertex, about its normal: enough for every lobe and view.
struct TransferredLight {
    int bands = 0;  ///< of the lighting; 0: nothing reaches it
    std::array<Vec3, 3> frame{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};   ///< tangent, bitangent, normal
    std::array<Rgb, kMaxGlossyBands * kMaxGlossyBands> lighting{};  ///< l_i, turned
    /// sum_im G_ikm l_i B_m, less B_k times the light that surfaces send from there; turned.
    std::array<Rgb, kLobeBands * kLobeBands> blocked{};
};

/// A quarter turn about +X of seven bands of coefficients: with turns about +Z, which need no
/// matrix, it makes every other turn.
struct ShQuarterTurn {
    ShQuarterTurn() noexcept;
    std::array<float, 455> elements;  ///< band by band, row by row
};

/// An integral of three basis functions that is not 0: G of `first`, `kernel` and `visibility`,
/// slots sh::index.
struct TripleProduct {
    std::uint8_t first, kernel, visibility;
    float integral;
};

/// Lighting, prepared for many vertices: sum_i G_ikm l_i. 105 kB.
class GlossyLight {
  public:
    /// Bands of the lighting beyond those of the transport are left out.
    GlossyLight(const ShLightingView& lighting, int light_bands) noexcept;

    /// Some 20,000 multiply-adds, and up to 10,000 more by "mesh/I/reflected". Of a vertex past the
    /// end, or of a mesh without glossy transport or with that of other bands: nothing.
    [[nodiscard]] TransferredLight transfer(const Mesh& mesh, std::uint64_t vertex) const noexcept;

  private:
    static constexpr int kVisibilityBands = kMaxGlossyBands + kExtraVisibilityBands;
    /// Columns k are padded to whole vectors.
    static constexpr std::size_t kColumns = 56;
    static_assert(kColumns >= kLobeBands * kLobeBands && kColumns % 8 == 0);

    int bands_ = 0;
    ShQuarterTurn quarter_turn_;
    std::array<Rgb, kMaxGlossyBands * kMaxGlossyBands> lighting_{};
    alignas(64) std::array<
        std::array<std::array<float, kColumns>, kVisibilityBands * kVisibilityBands>, 3> product_{};
    std::size_t reflected_count_ = 0;
    std::array<TripleProduct, 2817> reflected_products_;  ///< of the first 16, but Y_0; first rises
};

/// Exit radiance of one vertex and lobe, about its normal.
struct GlossyExit {
    int bands = 0;
    std::array<Vec3, 3> frame{};
    std::array<Rgb, kMaxGlossyBands * kMaxGlossyBands> coeffs{};  ///< slot sh::index, RGB

    /// W sr^-1 m^-2. May be negative, as whatever is of few bands. A view from below the surface
    /// counts as grazing.
    [[nodiscard]] Rgb radiance(const Vec3& v) const noexcept;
};

/// Reflects by the lobe R0 a + b. Between rows of the lobe's table linear in the roughness, which
/// is clamped to the table. Some 2,000 multiply-adds.
[[nodiscard]] GlossyExit reflect(const LobeView& lobe, const TransferredLight& light,
                                 float perceptual_roughness, const Rgb& r0) noexcept;

/// Makes matrices, for those who store matrices; one does for all vertices and lobes. 43 kB.
class GlossyMatrices {
  public:
    GlossyMatrices() noexcept;

    /// The matrices a and b of one vertex, in world space, of light that comes from outside: some
    /// 80,000 multiply-adds.
    ///   out   [lobe.exit_bands^2, transport.light_bands^2, 2]: exit, lighting, a and b
    ///   return  false, and nothing written: out has another size, the vertex is past the end or
    ///           has no normal, or there is no transport or no lobe of its lighting bands
    [[nodiscard]] bool expand(const LobeView& lobe, const GlossyView& transport,
                              std::uint64_t vertex, float perceptual_roughness,
                              std::span<float> out) const noexcept;

    /// With all that surfaces reflect on its way, which has a colour. What they emit is in no
    /// matrix.
    ///   channel  0 .. 2: red, green or blue
    [[nodiscard]] bool expand(const LobeView& lobe, const Mesh& mesh, std::uint64_t vertex,
                              float perceptual_roughness, int channel,
                              std::span<float> out) const noexcept;

  private:
    struct Blocked;
    bool expand(const LobeView& lobe, const Blocked& blocked, float perceptual_roughness,
                std::span<float> out) const noexcept;

    ShQuarterTurn quarter_turn_;
    std::size_t product_count_ = 0;
    std::array<TripleProduct, 5175> products_;  ///< first: of the lighting, rising
};

}  // namespace envbake::runtime
