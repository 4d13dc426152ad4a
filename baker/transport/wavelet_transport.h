// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"
#include "baker/core/progress.h"
#include "baker/input/scene.h"
#include "baker/trace/tracer.h"
#include "baker/transport/cube_visibility.h"
#include "baker/transport/ray_origin.h"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace envbake {

inline constexpr std::size_t kWaveletBlock = 256;  ///< vertices; one byte names one of them

struct WaveletJob {
    int face_size = 64;       ///< texels, wavelet::is_face_size
    double tolerance = 1e-2;  ///< what rounding may take from a light of one texel
    std::size_t memory_bytes = std::size_t{256} << 20;  ///< of blocks in memory at once
    /// Vertices first_vertex .. end_vertex - 1 alone, of which the mesh has so many: blocks of a
    /// part, the same bits. Both are multiples of kWaveletBlock, or the latter is past the last.
    std::size_t first_vertex = 0, end_vertex = ~std::size_t{0};
};

/// Every vertex is one of unreferenced, free and traced. Numbers of parts add up.
struct WaveletReport {
    std::uint64_t vertex_count = 0;
    std::uint64_t unreferenced_count = 0;  ///< no triangle or no normal: no coefficients
    std::uint64_t free_count = 0;          ///< nothing above the tangent plane: no rays
    std::uint64_t traced_count = 0;        ///< of equal vertices each
    std::uint64_t ray_count = 0;
    std::uint64_t coeff_count = 0;  ///< stored, of all vertices
    std::uint64_t byte_count = 0;   ///< of the blocks
};

/// Adds another part of the same mesh.
void append(WaveletReport& report, const WaveletReport& part);

/// Blocks are counted in 32 bits of 4 bytes.
Error wavelets_too_large(std::size_t mesh);

/// What coefficients are rounded to: 1.2 times the tolerance, relative to 1 / pi, which is what an
/// open texel overhead has; but no less than lets the largest coefficient be a number of 15 bits.
/// Under a light of one texel, the worst, less than the tolerance is lost (rms): a test holds it to
/// that.
float wavelet_step(const WaveletJob& job);

/// Rays a vertex that needs rays: 990 to 1,120 were measured for faces of 32, 1,430 to 1,930
/// for 64.
int expected_wavelet_rays(const WaveletJob& job);

/// The coefficients of one place, before they are rounded: those of texel_transport().
///   coeffs  [wavelet::coeff_count(cube.face_size)]
///   return  rays traced
int wavelet_transport(const CubeTexels& cube, const Tracer& tracer, const RayOrigin& origin,
                      std::span<float> coeffs, Look look);

/// Those of a place with nothing above it.
void open_wavelet_transport(const CubeTexels& cube, const DVec3& normal, std::span<float> coeffs);

/// Bakes "mesh/I/wavelet/blocks", docs/format.md: 256 vertices a block, in it one run of (vertex,
/// value) a coefficient, so that who has a few lighting terms touches their runs alone.
///
/// Blocks are handed to `sink` in order. What is in memory does not grow with the mesh, but for 4
/// bytes a block and 32 a vertex (SurfacePoints). Light that comes straight from the environment:
/// no bounces. The rays are not those of bake_diffuse(): its few hundred are coarser than the
/// coarsest look here, and that is a fifth of the time; the rest goes into outlines.
///
///   offsets      gets where each block begins, and the last ends, in units of 4 bytes
///   square_sums  [coeff_count]: the squares of all vertices' coefficients are added, as
///                stored: what is rounded away is of no use to a light. In steps, so that the sum
///                is exact and parts of a mesh add up in any order
///
/// Deterministic for any number of threads and any budget. An error of the sink ends the bake and
/// is returned.
///
/// Errors:  Failed  the mesh needs more than 16 GiB
Expected<WaveletReport> bake_wavelet(
    const WaveletJob& job, const CubeTexels& cube, const Scene& scene, std::size_t mesh,
    const Tracer& tracer, const std::function<Expected<void>(std::span<const std::byte>)>& sink,
    std::vector<std::uint32_t>& offsets, std::span<std::uint64_t> square_sums, Progress& progress);

}  // namespace envbake
