// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"
#include "baker/core/progress.h"
#include "baker/input/scene.h"
#include "baker/math/axial_form.h"
#include "baker/trace/tracer.h"
#include "baker/transport/crossing_error.h"
#include "baker/transport/ray_origin.h"
#include "baker/transport/ray_set.h"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace envbake {

inline constexpr int kMaxRays = 1 << 18;  ///< of a vertex

/// What rows of more bands than T are for: it has errors of its own, and T's tolerance.
struct RowUse {
    std::vector<AxialForm> errors{};  ///< squared, by errors of a row, of row_bands; the worst
    double expected = 0;              ///< rms by those over that of T, before it is measured
    bool alone = false;               ///< nobody asks for T itself: no rays for its tolerance
};

struct DiffuseJob {
    int bands = 5;            ///< 1 .. 10; of the error, and of what the rays are chosen for
    int row_bands = 0;        ///< bands of a row, bands .. 11; 0: as many as `bands`
    bool shadowed = true;     ///< false: the analytic unoccluded answer, no rays
    double tolerance = 1e-2;  ///< rms over vertices of |T - T_true|_2 / |T_unoccluded|_2
    RowUse row_use{};
    int rays_per_vertex = 0;  ///< 0: chosen from the tolerance
    /// Wall time for this mesh, seconds; 0: as long as it takes. Where the rays that the tolerance
    /// needs would take longer, by the speed that the sample shows, it is as many as fit, but no
    /// fewer than the bands need for weights that are not negative. Not with rays_per_vertex.
    double seconds = 0;
    std::uint64_t seed = 0;
    /// Vertices first_vertex .. end_vertex - 1 alone, of which the mesh has so many: rows of a
    /// part, the same bits.
    std::size_t first_vertex = 0, end_vertex = kAllVertices;
    static constexpr std::size_t kAllVertices = ~std::size_t{0};
    /// For rows: those baked at once, and those that copies further on wait for. A copy whose row
    /// found no room is traced again. Under 64 rows it counts as 64; the bits do not depend on it.
    std::size_t memory_bytes = std::size_t{256} << 20;
};

/// Every vertex is one of unreferenced, merged, free and traced. Of a part of the vertices: free,
/// traced, solved and rays are of those, all else is of the whole mesh.
struct DiffuseReport {
    std::uint64_t vertex_count = 0;
    std::uint64_t unreferenced_count = 0;  ///< no triangle or no normal: T = 0, no rays
    std::uint64_t merged_count = 0;  ///< equal to an earlier vertex in position and normal: copied
    std::uint64_t free_count = 0;    ///< nothing above the tangent plane: analytic, no rays
    std::uint64_t traced_count = 0;
    std::uint64_t solved_count = 0;     ///< of those, where a pilot alone told the answer
    std::uint64_t ray_count = 0;        ///< without those of the error check
    std::uint64_t check_ray_count = 0;  ///< of the error check and of the choice of the ray count
    int rays_per_vertex = 0;            ///< of the traced ones that were not solved
    /// Traced again for want of memory: in none of the counts above.
    std::uint64_t repeated_ray_count = 0;

    /// Relative as DiffuseJob::tolerance, rms over all vertices: told from every vertex' own rays
    /// (CrossingError) by a scale that a sample of vertices, baked twice, gives; plus two standard
    /// errors. Vertices that need no rays count as 0.
    double error_rms = 0;
    double error_p999 = 0;  ///< 99.9th percentile over all vertices, by the same

    /// rms error by the worst of RowUse::errors over that of T, of the sample.
    double row_error = 0;

    // What the errors are told from.
    CrossingError crossing_error;
    std::vector<std::uint64_t> crossings;  ///< [c] vertices with c crossings
};

/// Adds another part of the same mesh. All parts together, in any order, make the report of the
/// whole.
void append(DiffuseReport& report, const DiffuseReport& part);

/// Rays per traced vertex that a bake of this job starts from: what a dense scan needs for the
/// tolerance, or job.rays_per_vertex. A bake settles on what its own mesh needs.
int expected_rays_per_vertex(const DiffuseJob& job);

/// T_i of a surface that nothing occludes: A^_l / pi * Y_i(n), A^_l = sh::clamped_cosine(l).
///   n     unit
///   out   [bands^2]
void unoccluded_transport(int bands, const DVec3& n, std::span<double> out);

/// |T|_2 of such a surface: the same for every n.
double unoccluded_norm(int bands);

/// Which rays of a mesh's vertices met something; for those who want to know what.
struct BlockedRays {
    std::uint64_t seed = 0;
    RaySet set;                        ///< the same for each
    std::vector<std::uint16_t> masks;  ///< [vertices, packets], bit i: ray i; of copies all 0

    std::span<const std::uint16_t> of(std::uint32_t vertex) const {
        return std::span(masks).subspan(vertex * set.directions.size(), set.directions.size());
    }
    /// By which the set was turned about the normal of a vertex.
    double turn_rad(const SurfacePoints& points, std::uint32_t vertex,
                    const TraceSpace& space) const;
};

/// Bakes "mesh/I/diffuse" or, with more bands, "mesh/I/glossy", [vertices, row_bands^2] f32:
///
///     T_i = 1/pi * integral of V(w) max(0, n.w) Y_i(w) dw
///
/// with n the shading normal and V the visibility from the vertex among all the scene's occluders
/// (SurfacePoints says where exactly rays start). The result is T_unoccluded less the blocked rays
/// of one quadrature set (RaySet), turned about each normal by an angle of the place's own: a
/// vertex that meets nothing is exactly analytic, one that sees nothing is exactly 0. Further bands
/// of a row change neither the rays nor the bits of the first.
///
/// The ray count N follows the tolerance: a sample of the vertices, baked twice, says how the error
/// goes with N, and N is what brings the rms over the mesh just below. Where enough of the sample
/// is solved by a quarter of the rays (all open or all blocked) every vertex begins with those and,
/// solved, ends with them. No other stop pays: the best count of a vertex goes as the 0.4th power
/// of the length of the outlines that it sees, and stages of N/2 or 2N by that length gained less
/// than 3 % over N and the solved ones. What was reached stands in the report; a tolerance out of
/// reach of 2^18 rays is not an error. A given job.rays_per_vertex is what every traced vertex
/// gets.
///
/// Rows are handed to `sink` in vertex order, some at a time. Beside the budget a bake takes about
/// 32 bytes a vertex of this mesh and 12 a triangle, for its welding.
/// `progress` counts vertices; a scene has many meshes, so who bakes them all announces the total.
/// Deterministic for any number of threads, unless `seconds` decide; vertices in another order are
/// the same rows in that order. An error of the sink ends the bake and is returned. `blocked` is
/// filled where it is given, an eighth of a byte a ray.
///
/// Errors:  Usage  bands, tolerance or rays_per_vertex is out of range
Expected<DiffuseReport> bake_diffuse(
    const DiffuseJob& job, const Scene& scene, std::size_t mesh, const Tracer& tracer,
    const std::function<Expected<void>(std::span<const float>)>& sink, Progress& progress,
    BlockedRays* blocked = nullptr);

}  // namespace envbake
