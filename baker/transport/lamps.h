// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/random.h"
#include "baker/input/scene.h"
#include "baker/trace/tracer.h"
#include "baker/transport/ray_origin.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace envbake {

/// The surfaces of a scene that shine, where they are so few triangles that each can be asked for.
/// Rays over the hemisphere meet a small lamp seldom: of a lamp that covers a thousandth of it,
/// 1,600 rays make an error of half. Rays towards it do not miss it.
class Lamps {
  public:
    /// Beyond, asking each costs more than the rays that are there anyway.
    static constexpr std::size_t kMostTriangles = 64;

    /// Every triangle of a material that emits, textures aside; none where they are too many.
    explicit Lamps(const Scene& scene);

    bool empty() const { return triangles_.empty(); }

    /// 1/pi integral of L_e V max(0, n.w) dw over the lamps: W sr^-1 m^-2.
    ///
    /// Of each triangle Lambert's form factor, exact where nothing stands between, times the mean
    /// of what 16 points of it send, weighted by cos cos / r^2; 64 points where some are hidden.
    /// Single-sided materials shine to their front only.
    Vec3 light(const Scene& scene, const Tracer& tracer, const RayOrigin& origin,
               RandomStream& random) const;

  private:
    struct Triangle {
        std::uint32_t mesh, triangle;
    };
    std::vector<Triangle> triangles_;
};

}  // namespace envbake
