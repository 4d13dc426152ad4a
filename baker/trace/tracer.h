// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"
#include "baker/input/scene.h"
#include "baker/math/vector.h"

#include <array>
#include <cstdint>
#include <memory>
#include <optional>

namespace envbake {

class HalfSpaceTree;
class TraceSpace;

/// Sixteen rays that leave one origin; structure of arrays, as Embree's packets want them.
struct alignas(64) DirectionPacket {
    std::array<float, 16> x, y, z;
};

struct Hit {
    std::uint32_t mesh = 0;      ///< index into Scene::meshes
    std::uint32_t triangle = 0;  ///< index into that mesh's triangles
    float u = 0, v = 0;          ///< barycentric weights of the triangle's vertices 1 and 2
    float distance = 0;          ///< in units of |direction|
    Vec3 geometric_normal{0};    ///< unit; by winding, not turned towards the ray
};

/// What sixteen rays of one origin meet first; structure of arrays. Of rays that meet nothing
/// nothing is written.
struct HitPacket {
    std::array<std::uint32_t, 16> mesh, triangle;  ///< as in Hit
    std::array<float, 16> u, v;
    std::uint32_t from_behind = 0;  ///< bit i: ray i meets the side that winds clockwise
};

/// Instructions that rays are traced with.
enum class Isa {
    Best,  ///< the last of these that the machine has
    Sse42,
    Avx,
    Avx2,
    Avx512
};
/// "sse4.2"
const char* isa_name(Isa isa);

/// Answers visibility among a scene's triangles. Robust: no leaks at shared edges. Triangles that
/// cannot be hit (zero area) are left out; what casts no shadow (casts_shadow() in occluders.h) is
/// seen only by closest(). Every other triangle is met from both sides. Where alpha mode MASK cuts
/// a hole, rays go through: triangles are solid, clear or with holes (coverage.h) before the first
/// ray, and only the last kind looks into its texture at a hit.
///
/// Origins are world positions, in double because rays are traced in a space of finer grain
/// (TraceSpace); directions need not be unit. An origin on a surface may or may not meet it:
/// keep away by a few TraceSpace::resolution_at().
///
/// Threads: every query may run on any number of threads at once. Whether something is hit never
/// depends on how the tree was built; closest() may name either of two triangles that it meets at
/// exactly the same distance, and so may closest16().
class Tracer {
  public:
    /// The scene must outlive the tracer where alpha mode MASK reads textures.
    ///
    ///   isa  rays that graze a triangle may meet it by some instructions and miss it by others
    ///
    /// Errors:  InvalidInput  a vertex of a triangle is not finite, or an index is out of range
    ///          Failed        Embree cannot start, or is out of memory; the machine, or this build
    ///                        of Embree, lacks the instructions
    static Expected<Tracer> build(const Scene& scene, Isa isa = Isa::Best);
    Tracer(Tracer&&) noexcept;
    Tracer& operator=(Tracer&&) noexcept;
    ~Tracer();

    /// Bit i set: ray i (of those set in `active`) meets an occluder.
    std::uint32_t occluded16(const DVec3& origin, const DirectionPacket& directions,
                             std::uint32_t active = 0xffff) const;
    /// Bit i set: ray i (of those in `active`) meets an occluder, the first of which is in `hits`.
    std::uint32_t closest16(const DVec3& origin, const DirectionPacket& directions, HitPacket& hits,
                            std::uint32_t active = 0xffff) const;
    bool occluded(const DVec3& origin, const DVec3& direction) const;
    std::optional<Hit> closest(const DVec3& origin, const DVec3& direction) const;

    const TraceSpace& space() const;
    const HalfSpaceTree& half_spaces() const;

  private:
    struct State;
    explicit Tracer(std::unique_ptr<State> state);
    std::unique_ptr<State> state_;
};

}  // namespace envbake
