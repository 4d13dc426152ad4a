// SPDX-License-Identifier: Apache-2.0
#include "baker/trace/half_space_tree.h"

#include "baker/math/morton.h"
#include "baker/trace/occluders.h"

#include <algorithm>
#include <array>
#include <bit>
#include <limits>
#include <utility>

namespace envbake {

namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// The largest n.(x - origin) over a box.
double highest(const Vec3& low, const Vec3& high, const DVec3& origin, const DVec3& normal) {
    const DVec3 farthest(normal.x > 0 ? high.x : low.x, normal.y > 0 ? high.y : low.y,
                         normal.z > 0 ? high.z : low.z);
    return glm::dot(normal, farthest - origin);
}

}  // namespace

HalfSpaceTree::HalfSpaceTree(const Scene& scene, std::span<const MeshCoverage> coverage) {
    DVec3 low(kInfinity), high(-kInfinity);
    for (std::size_t m = 0; m < scene.meshes.size(); ++m) {
        const Mesh& mesh = scene.meshes[m];
        if (!casts_shadow(scene, mesh)) continue;
        for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
            if (coverage[m][i] == Coverage::Clear) continue;
            const Triangle t = triangle_of(mesh, i);
            if (!has_area(t)) continue;
            triangles_.push_back({t.a, t.b, t.c});
            for (const Vec3& p : {t.a, t.b, t.c}) {
                low = glm::min(low, DVec3(p));
                high = glm::max(high, DVec3(p));
            }
        }
    }
    if (triangles_.empty()) return;

    std::vector<std::pair<std::uint64_t, std::uint32_t>> order;
    order.reserve(triangles_.size());
    const DVec3 extent = glm::max(high - low, DVec3(std::numeric_limits<double>::min()));
    for (std::uint32_t i = 0; i < triangles_.size(); ++i) {
        const Corners& t = triangles_[i];
        const DVec3 middle = ((DVec3(t.a) + DVec3(t.b) + DVec3(t.c)) / 3.0 - low) / extent;
        order.emplace_back(morton3(middle.x, middle.y, middle.z), i);
    }
    std::sort(order.begin(), order.end());
    std::vector<Corners> sorted;
    sorted.reserve(triangles_.size());
    for (const auto& [code, i] : order) sorted.push_back(triangles_[i]);
    triangles_ = std::move(sorted);

    leaf_count_ = std::bit_ceil((triangles_.size() + kLeafSize - 1) / kLeafSize);
    nodes_.assign(2 * leaf_count_ - 1, Box{Vec3(kInfinity), Vec3(-kInfinity)});
    for (std::size_t i = 0; i < triangles_.size(); ++i) {
        Box& box = nodes_[leaf_count_ - 1 + i / kLeafSize];
        const Corners& t = triangles_[i];
        box.low = glm::min(box.low, glm::min(t.a, glm::min(t.b, t.c)));
        box.high = glm::max(box.high, glm::max(t.a, glm::max(t.b, t.c)));
    }
    for (std::size_t i = leaf_count_ - 1; i-- > 0;) {
        const Box &left = nodes_[2 * i + 1], &right = nodes_[2 * i + 2];
        nodes_[i] = {glm::min(left.low, right.low), glm::max(left.high, right.high)};
    }
}

/// `height` bounds n.(x - origin) over the box from above, the distance to the box bounds
/// |x - origin| from below: nothing inside can be above when the one is small against the other.
bool HalfSpaceTree::above(const Box& box, double height, const DVec3& origin) {
    if (!(height > 0)) return false;  // NaN, too: an empty box
    const DVec3 nearest = glm::clamp(origin, DVec3(box.low), DVec3(box.high));
    const DVec3 away = nearest - origin;
    return height * height > kNegligibleSlope * kNegligibleSlope * glm::dot(away, away);
}

bool HalfSpaceTree::leaf_above(std::size_t leaf, const DVec3& origin, const DVec3& normal) const {
    const std::size_t begin = leaf * kLeafSize;
    const std::size_t end = std::min(begin + kLeafSize, triangles_.size());
    for (std::size_t i = begin; i < end; ++i) {
        const Corners& t = triangles_[i];
        const double height =
            std::max({glm::dot(normal, DVec3(t.a) - origin), glm::dot(normal, DVec3(t.b) - origin),
                      glm::dot(normal, DVec3(t.c) - origin)});
        const Box box{glm::min(t.a, glm::min(t.b, t.c)), glm::max(t.a, glm::max(t.b, t.c))};
        if (above(box, height, origin)) return true;
    }
    return false;
}

bool HalfSpaceTree::any_above(const DVec3& origin, const DVec3& normal) const {
    if (nodes_.empty()) return false;
    // One entry a level at most: of two children one is entered and one waits.
    std::array<std::size_t, 64> waiting;
    std::size_t count = 0;
    waiting[count++] = 0;
    while (count > 0) {
        const std::size_t node = waiting[--count];
        if (node >= leaf_count_ - 1) {
            if (leaf_above(node - (leaf_count_ - 1), origin, normal)) return true;
            continue;
        }
        std::size_t children[2] = {2 * node + 1, 2 * node + 2};
        double heights[2];
        for (int i = 0; i < 2; ++i) {
            const Box& box = nodes_[children[i]];
            heights[i] = highest(box.low, box.high, origin, normal);
        }
        // The one that reaches higher is more likely to hold a witness: it goes on top.
        if (heights[0] > heights[1]) {
            std::swap(heights[0], heights[1]);
            std::swap(children[0], children[1]);
        }
        for (int i = 0; i < 2; ++i)
            if (above(nodes_[children[i]], heights[i], origin)) waiting[count++] = children[i];
    }
    return false;
}

}  // namespace envbake
