// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/scene.h"
#include "baker/math/vector.h"
#include "baker/trace/occluders.h"

#include <cstdint>
#include <span>
#include <vector>

namespace envbake {

/// Where the rays of a vertex start, and what they are about.
struct RayOrigin {
    DVec3 position;  ///< beside the vertex, off every triangle that meets there; world, metres
    DVec3 normal;    ///< the shading normal, unit: the cosine is taken about it
};

/// The vertices of a mesh as places on a surface: which are the same place, which are none, and
/// where the rays of each start.
///
/// A vertex itself is no place to start from. It lies in the planes of its triangles, and in a
/// corner of a room in the planes of walls that it has no part in; which side a ray starts on would
/// be decided by rounding. So the origin is moved, twice:
///
/// 1. Inwards, along the surface, by 1e-4 of the extent of its triangles (by less where they are
///    narrow), in the mean of the unit directions over the angle that they span: a floor vertex at
///    the foot of a wall leaves the plane of the wall, to its own side. In a corner that mean is
///    the bisector however the corner is cut into triangles; amid a full turn of them it is 0.
/// 2. Up, along the mean geometric normal g, until it is `lift` above the plane of every triangle.
///    A dent's triangles rise around it; above their planes it is above them. Triangles that
///    overhang (n_f.g < 0.05) are let be: no lift gets above those.
///
/// `lift` is the larger of 4 spacings of floats in the space where rays are traced, so that
/// rounding the origin does not put it back, and 1e-6 of the triangles' extent, since Embree's
/// error in a distance to a plane grows with the distance to the triangle's corners (about 2e-7 of
/// it). Where there is room the inset is 64 lifts or more, so that the far side of a wedge down to
/// 1 degree stays above.
///
/// Equal means equal bits of position and normal (-0 equals 0). A vertex without a normal, or in no
/// triangle with an area, is no place on a surface: nobody can see it.
class SurfacePoints {
  public:
    static constexpr std::uint32_t kNone = 0xffffffff;

    explicit SurfacePoints(const Mesh& mesh);

    std::size_t size() const { return representative_.size(); }
    /// The first vertex equal to `vertex`, maybe itself; kNone where it is not on a surface.
    std::uint32_t representative(std::size_t vertex) const { return representative_[vertex]; }

    /// Of a representative. O(n log n) in the triangles that meet there. Depends on what they are,
    /// to the bit, and not on the order in which the mesh lists them.
    RayOrigin origin(std::uint32_t representative, const TraceSpace& space) const;

    /// A number to draw random numbers from: that of the place, and not of the vertex. It depends
    /// on the position in trace space and on the normal alone, so a scene whose vertices, triangles
    /// or meshes are listed in another order, or which is moved or scaled without rounding, is
    /// baked to the same bits.
    std::uint64_t stream(std::uint32_t representative, const TraceSpace& space) const;

    /// The triangles with an area that meet at a representative, as the mesh numbers them.
    std::span<const std::uint32_t> triangles_at(std::uint32_t representative) const;

  private:
    void weld();
    void collect_triangles();

    const Mesh& mesh_;
    std::vector<std::uint32_t> representative_;
    std::vector<std::uint32_t> first_;  ///< of triangles_, by representative; one more at the end
    std::vector<std::uint32_t> triangles_;
};

}  // namespace envbake
