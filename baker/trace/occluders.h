// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/scene.h"
#include "baker/math/vector.h"

namespace envbake {

/// True for a mesh whose triangles keep light out: alpha mode OPAQUE or MASK, and not marked as
/// casting nothing. They do from both sides, whatever the material's double_sided says. A wall is
/// seen from one side only so that a viewer looks into the room; it is still a wall, and light that
/// came in through its back would be a leak.
bool casts_shadow(const Scene& scene, const Mesh& mesh);

struct Triangle {
    Vec3 a, b, c;

    /// (b - a) x (c - a) in double: along the outside normal, twice the area long.
    DVec3 cross() const { return glm::cross(DVec3(b) - DVec3(a), DVec3(c) - DVec3(a)); }
};
inline Triangle triangle_of(const Mesh& mesh, std::size_t triangle) {
    const std::uint32_t* corner = &mesh.triangles[3 * triangle];
    return {mesh.positions[corner[0]], mesh.positions[corner[1]], mesh.positions[corner[2]]};
}
/// False where the corners stand on one line, exactly: such a triangle meets no ray.
inline bool has_area(const Triangle& t) {
    return t.cross() != DVec3(0);
}

/// The space in which rays are traced: the scene moved near the origin and scaled to about 1,
/// neither of which costs a bit. A scene a hundred kilometres from the origin, or a micrometre
/// wide, is traced exactly as the same scene at home would be, and nothing comes near the ends of
/// the float range.
///
/// Per axis the shift is the middle c of the scene where the scene spans [lo, hi] with
/// 0 < lo, hi <= 2 lo (or mirrored): there p - c is exact in float for every p [Sterbenz74].
/// Elsewhere it is 0: the coordinates are then no longer than twice the scene is wide. The scale is
/// a power of two.
class TraceSpace {
  public:
    TraceSpace() = default;
    /// Of the triangles of `scene`; coordinates that are not finite are passed over.
    explicit TraceSpace(const Scene& scene);

    Vec3 to_local(const DVec3& world) const { return Vec3((world - shift_) * scale_); }
    /// Local lengths per metre.
    double scale() const { return scale_; }
    /// The spacing of ray origins around a world position, metres: that of floats in local space.
    double resolution_at(const DVec3& world) const;

  private:
    DVec3 shift_{0};
    double scale_ = 1;
};

}  // namespace envbake
