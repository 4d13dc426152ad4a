// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/scene.h"
#include "baker/math/simd.h"
#include "baker/trace/tracer.h"
#include "baker/transport/ray_origin.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace envbake {

/// The different vertices of all meshes that have transport, numbered through: equal ones once,
/// those on no surface not at all.
struct ScenePlaces {
    static constexpr std::uint32_t kNone = SurfacePoints::kNone;
    struct Place {
        std::uint32_t mesh, vertex;
    };
    std::vector<Place> places;
    std::vector<SurfacePoints> surfaces;                ///< of every mesh
    std::vector<std::vector<std::uint32_t>> numbers;    ///< [mesh][vertex]; empty: no transport
    std::vector<std::uint64_t> first_triangle;          ///< [mesh], in the scene's triangles
    std::vector<std::array<std::uint32_t, 3>> corners;  ///< places, of each of those; kNone first:
                                                        ///< the triangle has no transport

    /// has_transport  [mesh]
    ScenePlaces(const Scene& scene, const std::vector<bool>& has_transport);
};

/// What each place sees of the surfaces around it, by a few rays: light that is reflected to it is
///
///     B(p) = F(p) * mean over the rays that met something of albedo(x) T(x),
///     T(x) = interpolated between the corners of the triangle that x is on
///
/// with F = 1 - T_00 / Y_00, the cosine-weighted share of its hemisphere that is blocked, as the
/// far more numerous rays of the direct transport have it. So light is neither lost nor made: with
/// albedo 1 under a constant sky T_00 tends to Y_00 whatever the rays. Where T says that something
/// is there and no ray met it, the place sees its own like.
///
/// A back face of a single-sided material reflects nothing, though it blocks; of a double-sided one
/// it reflects what its front does, as a renderer shows it. What has no transport reflects nothing.
/// Albedo is base colour x texture x vertex colour x (1 - metallic), at most 1.
class SeenSurfaces {
  public:
    /// One block of places; rows are of different length.
    struct Point {
        std::uint32_t triangle;               ///< of ScenePlaces::corners
        std::uint16_t u, v;                   ///< barycentric, in 65535ths, u + v <= 65535
        std::array<std::uint16_t, 3> albedo;  ///< RGB, in 65535ths
    };

    /// Traces `ray_count` rays (rounded up to 16) about the normal of each place that `blocked`
    /// gives a share above 0.
    ///   blocked  [chosen], F of each
    ///   chosen   the places that get a row, by number
    SeenSurfaces(const Scene& scene, const Tracer& tracer, const ScenePlaces& places,
                 std::span<const std::uint32_t> chosen, std::vector<float> blocked, int ray_count,
                 std::uint64_t seed);

    std::size_t row_count() const { return blocked_.size(); }
    int rays_per_row() const { return rays_per_row_; }
    std::uint64_t ray_count() const { return ray_count_; }
    std::uint64_t point_count() const { return point_count_; }
    std::uint64_t black_back_count() const { return black_back_count_; }
    std::size_t bytes() const;

    /// B of one row for sixteen columns of T.
    ///   columns  [places]
    Float16 reflected(std::size_t row, int channel, std::span<const Float16> columns) const;
    /// F times the mean albedo: B for T = 1.
    double reflectance(std::size_t row, int channel) const;
    /// F times the mean of what the surfaces emit: W sr^-1 m^-2.
    const Vec3& emitted(std::size_t row) const { return emitted_[row]; }

  private:
    static constexpr std::size_t kBlock = 64;
    struct Block {
        std::array<std::uint32_t, kBlock + 1> first{};
        std::vector<Point> points;
        std::uint64_t black_back_count = 0;
    };
    class Gatherer;
    static constexpr std::uint32_t kBlack = 0xffffffff;  ///< Point::triangle of what is black

    std::span<const Point> row(std::size_t index) const {
        const Block& block = blocks_[index / kBlock];
        const std::size_t k = index % kBlock;
        return std::span(block.points).subspan(block.first[k], block.first[k + 1] - block.first[k]);
    }

    std::span<const std::array<std::uint32_t, 3>> corners_;
    std::vector<float> blocked_;
    std::vector<Vec3> emitted_;
    int rays_per_row_ = 0;
    std::vector<Block> blocks_;
    std::uint64_t ray_count_ = 0, point_count_ = 0, black_back_count_ = 0;
};

}  // namespace envbake
