// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/scene.h"
#include "baker/math/vector.h"
#include "baker/trace/coverage.h"

#include <cstdint>
#include <span>
#include <vector>

namespace envbake {

/// Tells whether any occluder stands above a plane. Where none does, visibility is 1 over the whole
/// hemisphere and no ray is needed.
///
/// A complete binary tree of boxes over the triangles in Z order: no pointers, 36 bytes a triangle
/// and 6 to 12 for the boxes. Building is O(F log F), a query O(log F) on the usual surface.
/// Threads: queries are pure.
class HalfSpaceTree {
  public:
    HalfSpaceTree() = default;
    /// Over every triangle that casts a shadow; one with holes counts as if it had none.
    HalfSpaceTree(const Scene& scene, std::span<const MeshCoverage> coverage);
    explicit HalfSpaceTree(const Scene& scene) : HalfSpaceTree(scene, coverage_of(scene)) {}

    /// True where some point x of some triangle has
    ///
    ///     n.(x - origin) > kNegligibleSlope |x - origin|
    ///
    /// Conservative: true may also be said when that is not so by a hair, false never wrongly.
    /// `normal` is a unit vector.
    bool any_above(const DVec3& origin, const DVec3& normal) const;

    /// What rises less than this (about the angle in radians) does not count. Blocking the whole
    /// ring below elevation e changes T by less than 3.06 sin^2 e of its norm (5 bands), which is
    /// 3e-10 here and far below the rounding of a float.
    static constexpr double kNegligibleSlope = 1e-5;

  private:
    struct Box {
        Vec3 low, high;
    };
    struct Corners {
        Vec3 a, b, c;
    };
    static constexpr std::size_t kLeafSize = 4;

    static bool above(const Box& box, double height, const DVec3& origin);
    bool leaf_above(std::size_t leaf, const DVec3& origin, const DVec3& normal) const;

    std::size_t leaf_count_ = 0;      ///< a power of two
    std::vector<Box> nodes_;          ///< children of i: 2i + 1 and 2i + 2; empty ones are inverted
    std::vector<Corners> triangles_;  ///< kLeafSize to a leaf
};

}  // namespace envbake
