// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/runtime/cube.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>

namespace envbake::wavelet {

/// The orthonormal 2D Haar basis on each face of a cube map of n x n texels, non-standard
/// decomposition: four neighbours a b / c d become one mean and three details,
///
///     m = (a + b + c + d) / 2     across = (a - b + c - d) / 2
///     down = (a + b - c - d) / 2  diagonal = (a - b - c + d) / 2
///
/// and the means are decomposed again, until one is left: n times the mean of the face.
///
/// Coefficient `face * n * n + row * n + column`: (0, 0) is that mean. With s = 1, 2, 4 .. n / 2,
/// the details of the squares of n / s texels stand at rows 0 .. s and columns s .. 2s (across), at
/// rows s .. 2s and columns 0 .. s (down), and at rows and columns s .. 2s (diagonal).
///
/// Lighting is a texel's radiance times its solid angle, transport the mean over a texel, so that
/// the dot product of their coefficients is the integral over the sphere.
///
/// No rotation of the light turns coefficients into coefficients: turn the map, and transform it
/// again (light_coefficients(); 8 ms for faces of 64 from a map with faces of 256).
///
/// Source: [Ng03]; the decomposition [Stollnitz95] section 3.

inline constexpr int kMinFaceSize = 16;
inline constexpr int kMaxFaceSize = 128;

/// A power of two within those limits.
constexpr bool is_face_size(std::uint64_t n) {
    return n >= kMinFaceSize && n <= kMaxFaceSize && std::has_single_bit(n);
}
constexpr std::size_t coeff_count(int face_size) {
    return static_cast<std::size_t>(cube::kFaceCount) * static_cast<std::size_t>(face_size) *
           static_cast<std::size_t>(face_size);
}

/// Decomposes one face.
///   n       a power of two
///   texels  [n, n], destroyed
///   coeffs  [n, n]
template <class Real>
void forward(int n, Real* texels, Real* coeffs) {
    for (int s = n / 2; s >= 1; s /= 2) {
        for (int r = 0; r < s; ++r) {
            const Real* __restrict upper = texels + 4 * r * s;
            const Real* __restrict lower = upper + 2 * s;
            Real* __restrict mean = coeffs + r * n;  // where details of the next levels will stand
            Real* __restrict across = mean + s;
            Real* __restrict down = coeffs + (s + r) * n;
            Real* __restrict diagonal = down + s;
            for (int c = 0; c < s; ++c) {
                const Real left = upper[2 * c] + lower[2 * c];
                const Real right = upper[2 * c + 1] + lower[2 * c + 1];
                const Real left_fall = upper[2 * c] - lower[2 * c];
                const Real right_fall = upper[2 * c + 1] - lower[2 * c + 1];
                mean[c] = (left + right) / 2;
                across[c] = (left - right) / 2;
                down[c] = (left_fall + right_fall) / 2;
                diagonal[c] = (left_fall - right_fall) / 2;
            }
            // s to a row, at the front: never past what is still to be read.
            std::copy_n(mean, s, texels + r * s);
        }
    }
    coeffs[0] = texels[0];
}

/// The texels of one face: the inverse of forward().
template <class Real>
void inverse(int n, const Real* coeffs, Real* texels) {
    texels[0] = coeffs[0];
    for (int s = 1; s < n; s *= 2) {
        for (int r = s - 1; r >= 0; --r) {  // backwards: means are read before they are written to
            for (int c = s - 1; c >= 0; --c) {
                const Real mean = texels[r * s + c];
                const Real across = coeffs[r * n + s + c];
                const Real down = coeffs[(s + r) * n + c];
                const Real diagonal = coeffs[(s + r) * n + s + c];
                Real* upper = texels + 4 * r * s + 2 * c;
                Real* lower = upper + 2 * s;
                upper[0] = (mean + across + down + diagonal) / 2;
                upper[1] = (mean - across + down - diagonal) / 2;
                lower[0] = (mean + across - down - diagonal) / 2;
                lower[1] = (mean - across - down + diagonal) / 2;
            }
        }
    }
}

using Rgb = std::array<float, 3>;

/// One term of a map's lighting.
struct Term {
    std::uint32_t index = 0;  ///< of a coefficient
    Rgb value{};              ///< W m^-2
};

constexpr std::size_t light_scratch_size(int face_size) {
    return (3 * static_cast<std::size_t>(cube::kFaceCount) + 1) *
           static_cast<std::size_t>(face_size) * static_cast<std::size_t>(face_size);
}

/// The coefficients of any cube map: radiance, W sr^-1 m^-2, linear; faces +X -X +Y -Y +Z -Z, rows
/// from the top (cube.h). Every texel of the map is a constant over its exact solid angle, and a
/// texel of the basis takes what it shares with it: no flux is lost for any pair of sizes.
///
///   map_size   texels along an edge of the map, 1 or more
///   map        [6, map_size, map_size]
///   face_size  of the basis, a power of two
///   coeffs     [coeff_count(face_size)]
///   scratch    [light_scratch_size(face_size)]
///
/// O(map + coefficients). In double, rounded at the end.
void light_coefficients(int map_size, std::span<const Rgb> map, int face_size,
                        std::span<Rgb> coeffs, std::span<double> scratch) noexcept;

/// What a term adds to vertices, rms: |value| (summed over the channels, for a term that is large
/// in one of them is needed) times the weight of its coefficient. Without weights, |value|.
double importance(const Term& term, std::span<const float> weights) noexcept;

/// Brings the `count` terms that matter most to the front of `terms` and sorts them by index. What
/// matters is importance(), with weights, and not size alone: under a sun that choice spends its
/// terms where no vertex can tell the difference.
///
///   weights  [coeff_count] or empty: rms over vertices of the transport of each coefficient
///   return   count, or all terms where there are fewer
///
/// O(terms). Source: [Ng03] section 4.3, with the rms of transport in place of the area.
std::size_t select_terms(std::span<Term> terms, std::span<const float> weights,
                         std::size_t count) noexcept;

}  // namespace envbake::wavelet
