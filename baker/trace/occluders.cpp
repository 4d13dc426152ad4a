// SPDX-License-Identifier: Apache-2.0
#include "baker/trace/occluders.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace envbake {

bool casts_shadow(const Scene& scene, const Mesh& mesh) {
    const Material& material = scene.materials[static_cast<std::size_t>(mesh.material)];
    return mesh.casts && material.alpha_mode != AlphaMode::Blend;
}

TraceSpace::TraceSpace(const Scene& scene) {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    DVec3 low(kInfinity), high(-kInfinity);
    for (const Mesh& mesh : scene.meshes) {
        for (const std::uint32_t vertex : mesh.triangles) {
            const DVec3 p = mesh.positions[vertex];
            if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) continue;
            low = glm::min(low, p);
            high = glm::max(high, p);
        }
    }
    if (low.x > high.x) return;  // no triangles
    double largest = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const double lo = low[axis], hi = high[axis];
        if ((lo > 0 && hi <= 2 * lo) || (hi < 0 && lo >= 2 * hi))
            shift_[axis] = static_cast<float>((lo + hi) / 2);
        largest = std::max({largest, std::abs(lo - shift_[axis]), std::abs(hi - shift_[axis])});
    }
    if (largest > 0) scale_ = std::ldexp(1.0, -std::ilogb(largest));
}

double TraceSpace::resolution_at(const DVec3& world) const {
    constexpr int kFractionBits = 23;
    constexpr double kSmallest = 0x1p-20;  // beside a local coordinate plane floats are finer still
    const DVec3 local = glm::abs((world - shift_) * scale_);
    const double largest = std::max({local.x, local.y, local.z, kSmallest});
    return std::ldexp(1.0, std::ilogb(largest) - kFractionBits) / scale_;
}

}  // namespace envbake
