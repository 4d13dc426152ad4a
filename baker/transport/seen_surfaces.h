// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/progress.h"
#include "baker/input/scene.h"
#include "baker/math/simd.h"
#include "baker/trace/tracer.h"
#include "baker/transport/diffuse.h"
#include "baker/transport/lamps.h"
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
/// with F = 1 - T_00 / Y_00, the cosine-weighted share of its hemisphere that is blocked, as all
/// its rays have it. So light is neither lost nor made: with albedo 1 under a constant sky T_00
/// tends to Y_00 whatever the rays. Where T says that something is there and no ray ends at it, the
/// place sees its own like.
///
/// Neighbours follow each other in a ray set, so every k-th of the blocked rays are a few that are
/// well spread over what is blocked.
///
/// A back face of a single-sided material reflects nothing, though it blocks; of a double-sided one
/// it reflects what its front does, as a renderer shows it. What has no transport reflects nothing.
/// Albedo is base colour x texture x vertex colour x (1 - metallic), at most 1.
class SeenSurfaces {
  public:
    /// One block of places; rows are of different length.
    struct Point {
        std::uint32_t triangle;                 ///< of ScenePlaces::corners
        std::uint16_t u, v;                     ///< barycentric, in 65535ths, u + v <= 65535
        std::array<std::uint16_t, 3> albedo;    ///< RGB, in 65535ths
        std::array<std::uint8_t, 2> direction;  ///< about the normal, octahedral
    };

    enum class Rays {
        OfTheDirectBake,  ///< those of `blocked`
        New               ///< the same set turned otherwise, traced first
    };
    /// Follows every so many-th blocked ray of each chosen place, at least one.
    ///   lamps    where there are some, nothing else shines, and they are asked for by themselves
    ///   blocked  [mesh], as bake_diffuse() fills it
    ///   chosen   the places that get a row, by number
    ///   shares   [chosen], F of each; no rays where it is 0
    ///   strides  [mesh], 1 or more: of its places
    ///   offset   which of them: 0 .. 1, added to a random one
    ///   progress counts `chosen`
    SeenSurfaces(const Scene& scene, const Tracer& tracer, const ScenePlaces& places,
                 const Lamps& lamps, std::span<const BlockedRays> blocked,
                 std::span<const std::uint32_t> chosen, std::vector<float> shares,
                 std::span<const double> strides, double offset, Rays rays, Progress& progress);

    std::size_t row_count() const { return shares_.size(); }
    std::uint64_t point_count() const { return point_count_; }
    std::uint64_t black_back_count() const { return black_back_count_; }
    std::size_t bytes() const;

    /// Those of a place's points that are asked.
    enum class Of {
        All,
        Few  ///< every second or third, where eight are left
    };
    /// B of one row for sixteen columns of T.
    ///   columns  [places]
    Float16 reflected(std::size_t row, int channel, std::span<const Float16> columns, Of of) const;
    /// F times the mean albedo: B for T = 1.
    double reflectance(std::size_t row, int channel, Of of) const;
    /// F of one row.
    double share(std::size_t row) const { return static_cast<double>(shares_[row]); }
    /// A point as it is met.
    struct SeenPoint {
        Vec3 direction;  ///< where it is, in frame_about() the normal; unit, within 0.01
        Vec3 weights;    ///< of the three corners
        Vec3 albedo;     ///< RGB, 0 .. 1
        const std::array<std::uint32_t, 3>* corners;  ///< places; null: it is black
    };
    /// All points of one row: visit(const SeenPoint&).
    template <class Visit>
    void for_each_point(std::size_t index, const Visit& visit) const {
        for (const Point& point : row(index)) visit(seen_point(point));
    }
    /// Light of the surfaces that shine, 1/pi integral of L_e max(0, n.w) dw: by lamps, or F times
    /// the mean of what the points emit. W sr^-1 m^-2.
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

    SeenPoint seen_point(const Point& point) const;

    /// Every step-th from the first one on.
    struct Chosen {
        std::size_t first = 0, step = 1, count = 0;
    };
    static Chosen choose(std::size_t row, std::size_t point_count, Of of);

    std::span<const std::array<std::uint32_t, 3>> corners_;
    std::vector<float> shares_;
    std::vector<Vec3> emitted_;
    std::vector<Block> blocks_;
    std::uint64_t point_count_ = 0, black_back_count_ = 0;
};

}  // namespace envbake
