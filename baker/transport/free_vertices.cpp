// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/free_vertices.h"

#include "baker/core/parallel.h"

#include <algorithm>

namespace envbake {

std::vector<std::uint64_t> count_free_vertices(const Scene& scene) {
    constexpr std::size_t kBlock = 256;
    const TraceSpace space(scene);
    const HalfSpaceTree occluders(scene);
    std::vector<std::uint64_t> counts;
    for (const Mesh& mesh : scene.meshes) {
        const SurfacePoints points(mesh);
        std::vector<std::uint8_t> free(points.size(), 0);  // of representatives
        parallel_for((points.size() + kBlock - 1) / kBlock, [&](std::size_t block) {
            const std::size_t end = std::min((block + 1) * kBlock, points.size());
            for (std::size_t v = block * kBlock; v < end; ++v) {
                const std::uint32_t place = points.representative(v);
                if (place == v) free[v] = is_free(points.origin(place, space), occluders);
            }
        });
        std::uint64_t count = 0;
        for (std::size_t v = 0; v < points.size(); ++v) {
            const std::uint32_t place = points.representative(v);
            if (place != SurfacePoints::kNone) count += free[place];
        }
        counts.push_back(count);
    }
    return counts;
}

}  // namespace envbake
