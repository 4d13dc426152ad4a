// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

namespace envbake {

/// The error of a vertex, told from its own rays.
///
/// Rays of one set err where what they sample has an edge: in the cells of the set that the outline
/// of the blocked part of the hemisphere runs through. Neighbours in the set's order of which one
/// is blocked and the other open, the crossings, count those cells; each adds a square of about
/// (1 / N)^2, whatever its direction, since sum_i Y_i^2 is the same everywhere. So
///
///     E |T - T_true|^2 / |T_unoccluded|^2 = c(N) * crossings
///
/// with one c for a mesh. Measured on three scans, a hall, a garden and a shader ball: the mean
/// error of every tenth of the vertices, sorted by crossings, follows the line; a single vertex
/// scatters about it as a gamma variable of shape 2 does (relative deviation 0.6 to 0.9), and
/// c N^2 is 0.57 to 0.96 for 2,048 rays and 0.65 to 1.25 for 512.
struct CrossingError {
    double per_crossing = 0;  ///< c(N)
    double solved = 0;        ///< mean square relative error of vertices without a crossing
    double samples = 0;       ///< vertices that c rests on

    friend bool operator==(const CrossingError&, const CrossingError&) = default;

    /// Of a set of `ray_count` rays, before anything is measured. A vertex without a crossing
    /// counts as if its rays had one: what no ray met may still be there.
    static CrossingError expected(int ray_count, bool with_pilot, int bands);
    /// The same at another ray count.
    CrossingError scaled(int from_rays, int to_rays) const;
};

/// Error falls with the ray count N as N^(-kVarianceExponent / 2), for one vertex and for a mesh.
inline constexpr double kVarianceExponent = 1.52;

/// A vertex that was baked twice, independently.
struct BakedTwice {
    int crossings = 0;      ///< of the first bake
    double square = 0;      ///< squared relative error: half the squared distance of the two, or
                            ///< all of it where the second is far better
    double row_square = 0;  ///< the same by the worst of RowUse::errors
};
/// `expected` as the sample has it; the expectation counts as much as a few samples.
CrossingError fit_error(const CrossingError& expected, std::span<const BakedTwice> sample);

/// rms of row_square over rms of square; `expected` counts as much as a few samples.
double fit_row_error(double expected, std::span<const BakedTwice> sample);

struct ErrorEstimate {
    double rms = 0;   ///< over all vertices
    double p999 = 0;  ///< 99.9th percentile over all vertices
};
/// Of a whole mesh. The mean square gets two standard errors added, of the fit and of the vertices'
/// own scatter.
///   histogram  [c] vertices with c crossings; what is not in it has no error
///   all        vertices of the mesh
ErrorEstimate estimate_error(const CrossingError& error, std::span<const std::uint64_t> histogram,
                             std::uint64_t all);

/// What the mean square is multiplied by for that, of a fit to `samples` vertices and a mean over
/// `vertices`.
double standard_error_factor(double samples, double vertices);

}  // namespace envbake
