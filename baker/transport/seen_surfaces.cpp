// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/seen_surfaces.h"

#include "baker/core/parallel.h"
#include "baker/core/random.h"
#include "baker/input/sample_texture.h"
#include "baker/math/frame.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

namespace envbake {

namespace {

/// Random streams.
constexpr std::uint64_t kChoice = 0x73656e, kLampPoints = 0x6c616d70, kOtherLampPoints = 0x6c616d71;
constexpr float kSteps = 65535;

std::uint16_t steps(float x) {
    return static_cast<std::uint16_t>(std::clamp(x, 0.0f, 1.0f) * kSteps + 0.5f);
}

/// A direction of the upper hemisphere, projected onto the octahedron |x| + |y| + z = 1, whose
/// upper half is a square turned by 45 degrees.
std::array<std::uint8_t, 2> octahedral(const DVec3& w) {
    const double scale = 127.5 / (std::abs(w.x) + std::abs(w.y) + std::max(w.z, 0.0));
    return {static_cast<std::uint8_t>(127.5 + scale * (w.x + w.y) + 0.5),
            static_cast<std::uint8_t>(127.5 + scale * (w.x - w.y) + 0.5)};
}
Vec3 from_octahedral(const std::array<std::uint8_t, 2>& code) {
    const float sum = static_cast<float>(code[0]) / 127.5f - 1,
                difference = static_cast<float>(code[1]) / 127.5f - 1;
    const float x = (sum + difference) / 2, y = (sum - difference) / 2;
    return glm::normalize(Vec3(x, y, 1 - std::abs(x) - std::abs(y)));
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

/// Follows the rays of single places.
class SeenSurfaces::Gatherer {
  public:
    Gatherer(const Scene& scene, const Tracer& tracer, const ScenePlaces& places,
             const Lamps& lamps, std::span<const BlockedRays> blocked,
             std::span<const double> strides, double offset, Rays rays)
        : scene_(scene),
          tracer_(tracer),
          places_(places),
          lamps_(lamps),
          blocked_(blocked),
          strides_(strides),
          offset_(offset),
          rays_(rays) {}

    /// What lamps send to a place.
    Vec3 lamp_light(std::uint32_t number) const {
        const auto [mesh, vertex] = places_.places[number];
        const SurfacePoints& surface = places_.surfaces[mesh];
        RandomStream random(blocked_[mesh].seed,
                            rays_ == Rays::New ? kOtherLampPoints : kLampPoints,
                            surface.stream(vertex, tracer_.space()));
        return lamps_.light(scene_, tracer_, surface.origin(vertex, tracer_.space()), random);
    }

    /// Appends what the place sees to block.points; returns the mean emission of that.
    Vec3 gather(std::uint32_t number, Block& block) const {
        const auto [mesh, vertex] = places_.places[number];
        const BlockedRays& blocked = blocked_[mesh];
        const SurfacePoints& surface = places_.surfaces[mesh];
        const RayOrigin origin = surface.origin(vertex, tracer_.space());
        RandomStream random(blocked.seed, kChoice, surface.stream(vertex, tracer_.space()));
        const double start = random.next() + offset_;
        const double turn = blocked.turn_rad(surface, vertex, tracer_.space()) +
                            (rays_ == Rays::New ? 2 * std::numbers::pi * random.next() : 0);
        const Frame frame = turned(frame_about(origin.normal), turn);

        std::span<const std::uint16_t> masks = blocked.of(vertex);
        std::vector<std::uint16_t> traced;
        if (rays_ == Rays::New) {
            for (const DirectionPacket& local : blocked.set.directions)
                traced.push_back(static_cast<std::uint16_t>(
                    tracer_.occluded16(origin.position, to_world(local, frame))));
            masks = traced;
        }
        const std::size_t before = block.points.size();
        DVec3 emission(0);
        Followed followed;
        double at = start - std::floor(start);
        for (std::size_t p = 0; p < masks.size(); ++p) {
            for (std::uint32_t left = masks[p]; left != 0; left &= left - 1) {
                at += 1 / strides_[mesh];
                if (at < 1) continue;
                at -= 1;
                followed.add(blocked.set.directions[p],
                             static_cast<std::size_t>(std::countr_zero(left)), frame);
                if (followed.count == 16) emission += end(origin, followed, block);
            }
        }
        emission += end(origin, followed, block);
        if (block.points.size() == before) emission = add_own_like(mesh, vertex, block);
        const std::size_t count = block.points.size() - before;
        return Vec3(emission / static_cast<double>(std::max<std::size_t>(count, 1)));
    }

  private:
    /// Rays on their way.
    struct Followed {
        DirectionPacket world{};
        std::size_t count = 0;

        void add(const DirectionPacket& local, std::size_t i, const Frame& frame) {
            const DVec3 w = frame.to_world({local.x[i], local.y[i], local.z[i]});
            world.x[count] = static_cast<float>(w.x);
            world.y[count] = static_cast<float>(w.y);
            world.z[count] = static_cast<float>(w.z);
            ++count;
        }
    };

    /// Appends where the rays end; returns the sum of what is emitted there.
    DVec3 end(const RayOrigin& origin, Followed& followed, Block& block) const {
        if (followed.count == 0) return DVec3(0);
        const Frame frame = frame_about(origin.normal);
        HitPacket hits;
        std::uint32_t met =
            tracer_.closest16(origin.position, followed.world, hits, (1u << followed.count) - 1);
        followed.count = 0;
        DVec3 emission(0);
        for (; met != 0; met &= met - 1) {
            const auto i = static_cast<std::size_t>(std::countr_zero(met));
            emission += DVec3(add(hits.mesh[i], hits.triangle[i],
                                  Vec3(1 - hits.u[i] - hits.v[i], hits.u[i], hits.v[i]),
                                  (hits.from_behind >> i & 1) != 0, block));
            const DVec3 w(followed.world.x[i], followed.world.y[i], followed.world.z[i]);
            block.points.back().direction =
                octahedral({glm::dot(frame.tangent, w), glm::dot(frame.bitangent, w),
                            glm::dot(frame.normal, w)});
        }
        return emission;
    }

    /// Returns what the point emits.
    Vec3 add(std::size_t mesh, std::size_t triangle, const Vec3& weights, bool from_behind,
             Block& block) const {
        const Mesh& seen = scene_.meshes[mesh];
        const std::uint64_t number = places_.first_triangle[mesh] + triangle;
        Point point{static_cast<std::uint32_t>(number), 0, 0, {0, 0, 0}, octahedral({0, 0, 1})};
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

    DVec3 add_own_like(std::size_t mesh, std::uint32_t vertex, Block& block) const {
        const Mesh& own = scene_.meshes[mesh];
        const std::uint32_t number = places_.numbers[mesh][vertex];
        for (const std::uint32_t triangle : places_.surfaces[mesh].triangles_at(vertex)) {
            for (int k = 0; k < 3; ++k) {
                if (places_.numbers[mesh][own.triangles[3 * std::size_t{triangle} +
                                                        static_cast<std::size_t>(k)]] != number)
                    continue;
                Vec3 weights(0);
                weights[k] = 1;
                return DVec3(add(mesh, triangle, weights, false, block));
            }
        }
        return DVec3(0);
    }

    const Scene& scene_;
    const Tracer& tracer_;
    const ScenePlaces& places_;
    const Lamps& lamps_;
    std::span<const BlockedRays> blocked_;
    std::span<const double> strides_;
    double offset_;
    Rays rays_;
};

SeenSurfaces::SeenSurfaces(const Scene& scene, const Tracer& tracer, const ScenePlaces& places,
                           const Lamps& lamps, std::span<const BlockedRays> blocked,
                           std::span<const std::uint32_t> chosen, std::vector<float> shares,
                           std::span<const double> strides, double offset, Rays rays,
                           Progress& progress)
    : corners_(places.corners), shares_(std::move(shares)), emitted_(chosen.size(), Vec3(0)) {
    const Gatherer gatherer(scene, tracer, places, lamps, blocked, strides, offset, rays);
    blocks_.resize((chosen.size() + kBlock - 1) / kBlock);
    parallel_for(blocks_.size(), [&](std::size_t b) {
        Block& block = blocks_[b];
        for (std::size_t k = 0; k < kBlock; ++k) {
            const std::size_t index = b * kBlock + k;
            if (index < chosen.size() && shares_[index] > 0)
                emitted_[index] = shares_[index] * gatherer.gather(chosen[index], block);
            if (index < chosen.size() && !lamps.empty())
                emitted_[index] = gatherer.lamp_light(chosen[index]);
            block.first[k + 1] = static_cast<std::uint32_t>(block.points.size());
        }
        block.points.shrink_to_fit();
        progress.add(std::min(kBlock, chosen.size() - b * kBlock), block.points.size());
    });
    for (const Block& block : blocks_) {
        point_count_ += block.points.size();
        black_back_count_ += block.black_back_count;
    }
}

std::size_t SeenSurfaces::bytes() const {
    return point_count_ * sizeof(Point) + blocks_.size() * sizeof(Block) +
           row_count() * (sizeof(float) + sizeof(Vec3));
}

SeenSurfaces::Chosen SeenSurfaces::choose(std::size_t row, std::size_t point_count, Of of) {
    constexpr std::size_t kFewest = 8, kLongestStep = 3;
    const std::size_t step =
        of == Of::All ? 1 : std::clamp(point_count / kFewest, std::size_t{1}, kLongestStep);
    const std::size_t first = row % step;
    return {first, step, (point_count - first + step - 1) / step};
}

Float16 SeenSurfaces::reflected(std::size_t index, int channel, std::span<const Float16> columns,
                                Of of) const {
    const std::span<const Point> points = row(index);
    const Chosen chosen = choose(index, points.size(), of);
    Float16 sum{};
    for (std::size_t i = chosen.first; i < points.size(); i += chosen.step) {
        const Point& point = points[i];
        if (point.triangle == kBlack) continue;
        const std::array<std::uint32_t, 3>& at = corners_[point.triangle];
        const float albedo =
            static_cast<float>(point.albedo[static_cast<std::size_t>(channel)]) / kSteps;
        const float u = static_cast<float>(point.u) / kSteps,
                    v = static_cast<float>(point.v) / kSteps;
        sum += albedo * ((1 - u - v) * columns[at[0]] + u * columns[at[1]] + v * columns[at[2]]);
    }
    return points.empty() ? sum : sum * (shares_[index] / static_cast<float>(chosen.count));
}

SeenSurfaces::SeenPoint SeenSurfaces::seen_point(const Point& point) const {
    const float u = static_cast<float>(point.u) / kSteps, v = static_cast<float>(point.v) / kSteps;
    return {from_octahedral(point.direction),
            {1 - u - v, u, v},
            Vec3(point.albedo[0], point.albedo[1], point.albedo[2]) / kSteps,
            point.triangle == kBlack ? nullptr : &corners_[point.triangle]};
}

double SeenSurfaces::reflectance(std::size_t index, int channel, Of of) const {
    const std::span<const Point> points = row(index);
    if (points.empty()) return 0;
    const Chosen chosen = choose(index, points.size(), of);
    double sum = 0;
    for (std::size_t i = chosen.first; i < points.size(); i += chosen.step)
        sum += points[i].albedo[static_cast<std::size_t>(channel)];
    return static_cast<double>(shares_[index]) * sum /
           (static_cast<double>(kSteps) * static_cast<double>(chosen.count));
}

}  // namespace envbake
