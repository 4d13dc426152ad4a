// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/environment.h"
#include "baker/math/vector.h"

#include <array>
#include <cstddef>
#include <utility>
#include <variant>

namespace envbake::lighting {

/// A rectangle in the coordinates of a source grid: a texel, a part of one, or a block of many.
struct SourceRect {
    int face = -1;          ///< 0 .. 5, or -1: lat-long
    double a0 = 0, a1 = 0;  ///< theta, or v
    double b0 = 0, b1 = 0;  ///< phi, or u

    /// The unit direction at fractions s of a and t of b, each 0 .. 1.
    DVec3 towards(double s, double t) const;
    /// Lengths on the sphere, radians, along a and along b at the widest place.
    DVec2 sides() const;
};

/// What a rectangle of uniform radiance 1 is to a kernel: exact moments of order 0 and 1, and the
/// second as that of a small parallelogram.
struct SourcePatch {
    double omega = 0;  ///< solid angle, sr
    DVec3 centre{0};   ///< mean direction, shorter than 1
    double variance =
        0;            ///< V = (1 - |centre|^2) / 2: for a small square the variance along a side
    DVec3 half_a{0};  ///< the patch is about centre + s half_a + t half_b, s and t in [-1, 1]
    DVec3 half_b{0};
    double extent = 0;  ///< the longer side, radians
    double aspect = 1;  ///< the longer side over the shorter
    double bend = 0;    ///< angle by which the longer sides turn: 0 for great circles, radians
    double taper = 0;   ///< 0: a parallelogram; 1: a triangle, at a pole
};

SourcePatch make_patch(const SourceRect& rect);

/// The factors of a lat-long patch that depend on theta alone and on phi alone. A grid has few rows
/// and columns: kept, they make the patch of a texel without any trigonometry.
struct ThetaTerms {
    double half, sine, cosine;  ///< half the height, radians; of the middle
    double sin_half, cos_half;
    double integral;      ///< of sin
    double ring, height;  ///< of sin^2 and of sin cos, over that of sin
    double widest;        ///< largest sin
    double taper;
};
struct PhiTerms {
    double half, sine, cosine;  ///< half the width, radians; of the middle
    double sin_half, cos_half;
    double shortening;  ///< sin(half) / half
};
ThetaTerms theta_terms(double theta0, double theta1);
PhiTerms phi_terms(double phi0, double phi1);
SourcePatch make_patch(const ThetaTerms& theta, const PhiTerms& phi);

/// A texel, or a part that halving its sides has left of it. Halves of a lat-long texel come from
/// half-angle formulas.
class TexelPart {
  public:
    explicit TexelPart(const SourceRect& rect) : rect_(rect) {}
    TexelPart(const ThetaTerms& theta, const PhiTerms& phi) : theta_(theta), phi_(phi) {}

    SourcePatch patch() const {
        return rect_.face < 0 ? make_patch(theta_, phi_) : make_patch(rect_);
    }
    /// As SourceRect::sides().
    DVec2 sides() const;
    /// The two halves along theta or v, and along phi or u.
    std::array<TexelPart, 2> halves_along_a() const;
    std::array<TexelPart, 2> halves_along_b() const;

  private:
    SourceRect rect_;  ///< of a cube face
    ThetaTerms theta_{};
    PhiTerms phi_{};
};

/// Texel (row, column) of a grid, and blocks row0 .. row1, column0 .. column1 of texels.
SourceRect block_rect(const LatLongGrid& grid, int row0, int row1, int column0, int column1);
SourceRect block_rect(const CubeGrid& grid, int face, int row0, int row1, int column0, int column1);

}  // namespace envbake::lighting
