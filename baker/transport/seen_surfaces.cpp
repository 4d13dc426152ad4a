// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/seen_surfaces.h"

#include "baker/core/parallel.h"
#include "baker/core/random.h"
#include "baker/input/sample_texture.h"
#include "baker/math/frame.h"
#include "baker/transport/ray_set.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

namespace envbake {

namespace {

constexpr std::uint64_t kTurns = 0x73656e;  // random stream
constexpr float kSteps = 65535;

std::uint16_t steps(float x) {
    return static_cast<std::uint16_t>(std::clamp(x, 0.0f, 1.0f) * kSteps + 0.5f);
}

DirectionPacket to_world(const DirectionPacket& local, const Frame& frame) {
    DirectionPacket world;
    for (std::size_t i = 0; i < 16; ++i) {
        const DVec3 w = frame.to_world({local.x[i], local.y[i], local.z[i]});
        world.x[i] = static_cast<float>(w.x);
        world.y[i] = static_cast<float>(w.y);
        world.z[i] = static_cast<float>(w.z);
    }
    return world;
}

}  // namespace

ScenePlaces::ScenePlaces(const Scene& scene, const std::vector<bool>& has_transport) {
    numbers.resize(scene.meshes.size());
    for (std::size_t m = 0; m < scene.meshes.size(); ++m) {
        const Mesh& mesh = scene.meshes[m];
        surfaces.emplace_back(mesh);
        first_triangle.push_back(corners.size());
        corners.resize(corners.size() + mesh.triangle_count(), {kNone, 0, 0});
        if (!has_transport[m]) continue;
        numbers[m].resize(mesh.vertex_count(), kNone);
        for (std::uint32_t v = 0; v < mesh.vertex_count(); ++v) {
            const std::uint32_t first = surfaces[m].representative(v);
            if (first == v) {
                numbers[m][v] = static_cast<std::uint32_t>(places.size());
                places.push_back({static_cast<std::uint32_t>(m), v});
            } else if (first != kNone) {
                numbers[m][v] = numbers[m][first];
            }
        }
        for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
            std::array<std::uint32_t, 3> at;
            for (std::size_t k = 0; k < 3; ++k) at[k] = numbers[m][mesh.triangles[3 * i + k]];
            if (std::find(at.begin(), at.end(), kNone) == at.end())
                corners[first_triangle[m] + i] = at;
        }
    }
}

/// Traces the rays of single places.
class SeenSurfaces::Gatherer {
  public:
    Gatherer(const Scene& scene, const Tracer& tracer, const ScenePlaces& places, int ray_count,
             std::uint64_t seed)
        : scene_(scene),
          tracer_(tracer),
          places_(places),
          set_(make_ray_set(ray_count, 1)),
          seed_(seed) {}

    int ray_count() const { return set_.ray_count; }

    /// Appends what the place sees to block.points; returns the mean emission of that.
    Vec3 gather(std::uint32_t number, Block& block) const {
        const auto [mesh, vertex] = places_.places[number];
        const SurfacePoints& surface = places_.surfaces[mesh];
        const RayOrigin origin = surface.origin(vertex, tracer_.space());
        const double turn =
            2 * std::numbers::pi *
            RandomStream(seed_, kTurns, surface.stream(vertex, tracer_.space())).next();
        const Frame frame = turned(frame_about(origin.normal), turn);
        const std::size_t before = block.points.size();
        DVec3 emission(0);
        HitPacket hits;
        for (const DirectionPacket& local : set_.directions) {
            std::uint32_t met = tracer_.closest16(origin.position, to_world(local, frame), hits);
            for (; met != 0; met &= met - 1) {
                const auto i = static_cast<std::size_t>(std::countr_zero(met));
                const bool from_behind = (hits.from_behind >> i & 1) != 0;
                emission += DVec3(add(hits.mesh[i], hits.triangle[i],
                                      Vec3(1 - hits.u[i] - hits.v[i], hits.u[i], hits.v[i]),
                                      from_behind, block));
            }
        }
        if (block.points.size() == before) emission = DVec3(add_own_like(mesh, vertex, block));
        const std::size_t count = block.points.size() - before;
        return Vec3(emission / static_cast<double>(std::max<std::size_t>(count, 1)));
    }

  private:
    /// Returns what the point emits.
    Vec3 add(std::size_t mesh, std::size_t triangle, const Vec3& weights, bool from_behind,
             Block& block) const {
        const Mesh& seen = scene_.meshes[mesh];
        const std::uint64_t number = places_.first_triangle[mesh] + triangle;
        Point point{static_cast<std::uint32_t>(number), 0, 0, {0, 0, 0}};
        const bool black =
            from_behind && !scene_.materials[static_cast<std::size_t>(seen.material)].double_sided;
        block.black_back_count += black;
        Vec3 emission(0);
        if (!black) {
            const SurfaceMaterial material = surface_material(scene_, seen, triangle, weights);
            emission = material.emission;
            if (places_.corners[number][0] != ScenePlaces::kNone) {
                const Vec3 albedo = material.diffuse_albedo();
                point.albedo = {steps(albedo.x), steps(albedo.y), steps(albedo.z)};
                point.u = steps(weights.y);
                point.v =
                    std::min(steps(weights.z),
                             static_cast<std::uint16_t>(kSteps - static_cast<float>(point.u)));
            }
        }
        if (point.albedo == std::array<std::uint16_t, 3>{}) point.triangle = kBlack;
        block.points.push_back(point);
        return emission;
    }

    Vec3 add_own_like(std::size_t mesh, std::uint32_t vertex, Block& block) const {
        const Mesh& own = scene_.meshes[mesh];
        const std::uint32_t number = places_.numbers[mesh][vertex];
        for (const std::uint32_t triangle : places_.surfaces[mesh].triangles_at(vertex)) {
            for (int k = 0; k < 3; ++k) {
                if (places_.numbers[mesh][own.triangles[3 * std::size_t{triangle} +
                                                        static_cast<std::size_t>(k)]] != number)
                    continue;
                Vec3 weights(0);
                weights[k] = 1;
                return add(mesh, triangle, weights, false, block);
            }
        }
        return Vec3(0);
    }

    const Scene& scene_;
    const Tracer& tracer_;
    const ScenePlaces& places_;
    RaySet set_;
    std::uint64_t seed_;
};

SeenSurfaces::SeenSurfaces(const Scene& scene, const Tracer& tracer, const ScenePlaces& places,
                           std::span<const std::uint32_t> chosen, std::vector<float> blocked,
                           int ray_count, std::uint64_t seed)
    : corners_(places.corners), blocked_(std::move(blocked)), emitted_(chosen.size(), Vec3(0)) {
    const Gatherer gatherer(scene, tracer, places, ray_count, seed);
    rays_per_row_ = gatherer.ray_count();
    blocks_.resize((chosen.size() + kBlock - 1) / kBlock);
    parallel_for(blocks_.size(), [&](std::size_t b) {
        Block& block = blocks_[b];
        for (std::size_t k = 0; k < kBlock; ++k) {
            const std::size_t index = b * kBlock + k;
            if (index < chosen.size() && blocked_[index] > 0)
                emitted_[index] = blocked_[index] * gatherer.gather(chosen[index], block);
            block.first[k + 1] = static_cast<std::uint32_t>(block.points.size());
        }
        block.points.shrink_to_fit();
    });
    for (const Block& block : blocks_) {
        point_count_ += block.points.size();
        black_back_count_ += block.black_back_count;
    }
    for (const float share : blocked_)
        if (share > 0) ray_count_ += static_cast<std::uint64_t>(gatherer.ray_count());
}

std::size_t SeenSurfaces::bytes() const {
    return point_count_ * sizeof(Point) + blocks_.size() * sizeof(Block) +
           row_count() * (sizeof(float) + sizeof(Vec3));
}

Float16 SeenSurfaces::reflected(std::size_t index, int channel,
                                std::span<const Float16> columns) const {
    const std::span<const Point> points = row(index);
    Float16 sum{};
    for (const Point& point : points) {
        if (point.triangle == kBlack) continue;
        const std::array<std::uint32_t, 3>& at = corners_[point.triangle];
        const float albedo =
            static_cast<float>(point.albedo[static_cast<std::size_t>(channel)]) / kSteps;
        const float u = static_cast<float>(point.u) / kSteps,
                    v = static_cast<float>(point.v) / kSteps;
        sum += albedo * ((1 - u - v) * columns[at[0]] + u * columns[at[1]] + v * columns[at[2]]);
    }
    return points.empty() ? sum : sum * (blocked_[index] / static_cast<float>(points.size()));
}

double SeenSurfaces::reflectance(std::size_t index, int channel) const {
    const std::span<const Point> points = row(index);
    if (points.empty()) return 0;
    double sum = 0;
    for (const Point& point : points) sum += point.albedo[static_cast<std::size_t>(channel)];
    return static_cast<double>(blocked_[index]) * sum /
           (static_cast<double>(kSteps) * static_cast<double>(points.size()));
}

}  // namespace envbake
