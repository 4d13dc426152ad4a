// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/scene.h"
#include "baker/trace/tracer.h"
#include "baker/transport/diffuse.h"
#include "baker/transport/lobe_light.h"

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace envbake {

inline constexpr int kAllBounces = std::numeric_limits<int>::max();

/// What is left of a tolerance for the direct transport that bounces are added to: their own error
/// adds to it by squares.
inline constexpr double kDirectShare = 0.9;

/// Bound on the rms over vertices of what all bounces together can add to transport, relative as
/// DiffuseJob::tolerance: light that left a surface is less than max_albedo / (1 - max_albedo) of
/// the sky's, and reaches no vertex with a free hemisphere.
///   blocked_share  of the vertices that have something above them
double most_from_bounces(double max_albedo, double blocked_share, int bands);

struct BounceJob {
    int bands = 5;
    int channels = 3;  ///< 1: every albedo of the scene is grey
    int bounces = kAllBounces;
    bool emission = false;    ///< surfaces shine: MeshTransport::emitted is wanted
    double tolerance = 1e-2;  ///< as DiffuseJob::tolerance, of what the bounces add
    double stride = 0;        ///< every so many-th blocked ray is followed; 0: chosen
    std::uint64_t seed = 0;
    LobeLightJob lobes{};  ///< of the meshes that have glossy transport
};

/// The transport of one mesh, in memory.
struct MeshTransport {
    std::vector<float> rows;     ///< [vertices, bands^2, channels]; empty: the mesh has none
    std::vector<float> emitted;  ///< [vertices, 3], W sr^-1 m^-2
    /// "mesh/I/reflected", f16: [vertices, LobeLightReport::bands^2 - 1,
    /// LobeLightJob::light_bands^2, channels]. Empty: the mesh has no lobe, or the mean is enough
    /// for it.
    std::vector<std::uint16_t> reflected;
};

/// Errors are relative as DiffuseJob::tolerance, over all vertices and channels; they leave out
/// that T between the vertices of a triangle is taken to be linear.
struct BounceReport {
    int bounces = 0;                     ///< that were added
    double stride = 0;                   ///< every so many-th blocked ray was followed
    std::uint64_t point_count = 0;       ///< that they ended at
    std::uint64_t black_back_count = 0;  ///< of those, on backs of single-sided materials
    std::size_t memory_bytes = 0;        ///< largest, beside the transport itself

    double error_rms = 0;   ///< of the few rays
    double error_p999 = 0;  ///< 99.9th percentile over vertices
    double shrink = 0;    ///< each further bounce, and a pad, are at most this times the one before
    double left_out = 0;  ///< bound on the rms of all bounces that were not added
    double emitted_error_rms = 0;        ///< of the few rays, over the rms of what is emitted
    std::vector<LobeLightReport> lobes;  ///< one a lobe
};

/// Light that goes from surface to surface before it reaches a vertex:
///
///     T = T_direct + A T = sum over k of A^k T_direct,    (A T)(p) = B(p) of SeenSurfaces
///
/// for each coefficient and each channel by itself. Emission E is one column more, since light
/// from surfaces takes the same ways: exit radiance = albedo * (sum_i l_i T_i + E). E is what
/// surfaces send here and, like T, everything that was reflected on its way.
///
/// No ray is traced for a bounce: A is gathered once, from rays that the direct transport found
/// blocked. Some of them do, for light from surfaces is the smaller and smoother part: a sample of
/// the vertices tells how many, and, with other rays, what they err. What lamps send is not left to
/// those rays (Lamps).
///
/// The series ends after job.bounces, or where what is left out is bounded below 3 % of the
/// tolerance. A has no negative entry, T_00 is nowhere negative, and |T|_2 <= bands T_00. With t
/// the last bounce but one, the least of three holds for the rms of all after A t:
///
/// - where A w <= s w everywhere for w = t + pad, a constant: s / (1 - s) A w. The pad keeps places
///   out of s that light reaches late, or hardly;
/// - q / (1 - q) max A t, q the largest row sum of A;
/// - Y_00 A^{k+1} 1 after k bounces: T_direct is at most Y_00 (1 - A 1), for a place reflects no
///   more than what its blocked directions send, so (1 - A)^{-1} T_direct is at most Y_00.
///
/// Bounces before the last are by some of the points only; the last one, by all of them, looks at
/// so many places that hardly any of what that errs is left.
///
///   blocked    one a mesh, as bake_diffuse() fills it
/// Lobes ask for more than T does: for the directions that light comes from. Where a lobe is so
/// strong that the mean does not do, more rays are followed, and MeshTransport::reflected is
/// filled.
///
///   transport  one a mesh; rows hold T_direct, the same in every channel, and T afterwards
///   progress   counts vertices whose rays are followed, then those that light came to
///
/// Memory: 16 bytes for each point that a vertex sees, 200 for each vertex, 12 for each triangle,
/// and what is stored. Deterministic for any number of threads. Channels of equal albedo get equal
/// bits, and one of three is as one alone.
BounceReport add_bounces(const BounceJob& job, const Scene& scene, const Tracer& tracer,
                         std::span<const BlockedRays> blocked, std::span<MeshTransport> transport,
                         Progress& progress);

}  // namespace envbake
