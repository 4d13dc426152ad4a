// SPDX-License-Identifier: Apache-2.0
#include "baker/trace/tracer.h"

#include "baker/input/sample_texture.h"
#include "baker/trace/coverage.h"
#include "baker/trace/embree.h"
#include "baker/trace/half_space_tree.h"
#include "baker/trace/occluders.h"

#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace envbake {

namespace {

constexpr unsigned kOccluderMask = 1;
constexpr unsigned kTransparentMask = 2;
constexpr float kInfinity = std::numeric_limits<float>::infinity();

struct DeviceRelease {
    void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
};
struct SceneRelease {
    void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
};
struct BufferRelease {
    void operator()(RTCBuffer buffer) const { rtcReleaseBuffer(buffer); }
};
struct GeometryRelease {
    void operator()(RTCGeometry geometry) const { rtcReleaseGeometry(geometry); }
};
using Device = std::unique_ptr<RTCDeviceTy, DeviceRelease>;
using EmbreeScene = std::unique_ptr<RTCSceneTy, SceneRelease>;
using Buffer = std::unique_ptr<RTCBufferTy, BufferRelease>;
using Geometry = std::unique_ptr<RTCGeometryTy, GeometryRelease>;

/// What a hit of one geometry means. Embree holds a pointer to it.
struct TracedTriangles {
    const Scene* scene = nullptr;
    std::size_t mesh = 0;
    std::vector<std::uint32_t> triangles;  ///< index in the mesh of each; empty: the same index

    std::uint32_t triangle(std::uint32_t primitive) const {
        return triangles.empty() ? primitive : triangles[primitive];
    }
};

/// Embree calls this for each hit on a triangle with holes; a hit in a hole is taken back.
void drop_hits_in_holes(const RTCFilterFunctionNArguments* arguments) {
    const auto& traced = *static_cast<const TracedTriangles*>(arguments->geometryUserPtr);
    const Mesh& mesh = traced.scene->meshes[traced.mesh];
    const float cutoff =
        traced.scene->materials[static_cast<std::size_t>(mesh.material)].alpha_cutoff;
    for (unsigned i = 0; i < arguments->N; ++i) {
        if (arguments->valid[i] != -1) continue;
        const float u = RTCHitN_u(arguments->hit, arguments->N, i);
        const float v = RTCHitN_v(arguments->hit, arguments->N, i);
        const std::uint32_t triangle =
            traced.triangle(RTCHitN_primID(arguments->hit, arguments->N, i));
        if (surface_alpha(*traced.scene, mesh, triangle, Vec3(1 - u - v, u, v)) < cutoff)
            arguments->valid[i] = 0;
    }
}

/// Embree passes over what it does not like without a word, so the input is checked here.
Expected<void> check(const Scene& scene, const Mesh& mesh, std::size_t index) {
    for (const std::uint32_t vertex : mesh.triangles) {
        if (vertex >= mesh.vertex_count())
            return Error{Errc::InvalidInput,
                         concat(scene.file_name, ": mesh/", index, ": a triangle names vertex ",
                                vertex, " of ", mesh.vertex_count())};
        const Vec3& p = mesh.positions[vertex];
        if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z))
            return Error{Errc::InvalidInput,
                         concat(scene.file_name, ": mesh/", index, ": vertex ", vertex, " is at (",
                                p.x, ", ", p.y, ", ", p.z, "); positions must be finite")};
    }
    return {};
}

Error embree_error(RTCDevice device, const char* what) {
    const RTCError code = rtcGetDeviceError(device);
    return {Errc::Failed,
            concat("Embree cannot ", what,
                   code == RTC_ERROR_OUT_OF_MEMORY ? ": out of memory"
                                                   : concat(": error ", static_cast<int>(code)))};
}

}  // namespace

struct Tracer::State {
    TraceSpace space;
    HalfSpaceTree half_spaces;
    /// Geometry 2m is what of mesh m has no holes, 2m + 1 what has.
    std::vector<TracedTriangles> geometries;
    Device device;
    EmbreeScene scene;

    Expected<void> add(const Scene& source, std::size_t index, const MeshCoverage& coverage);
    Expected<void> add_geometry(const Scene& source, unsigned id, RTCBuffer positions,
                                std::vector<std::uint32_t> kept);
};

Expected<void> Tracer::State::add(const Scene& source, std::size_t index,
                                  const MeshCoverage& coverage) {
    const Mesh& mesh = source.meshes[index];
    std::array<std::vector<std::uint32_t>, 2> kept;  // without holes, with
    for (std::uint32_t i = 0; i < mesh.triangle_count(); ++i)
        if (coverage[i] != Coverage::Clear && has_area(triangle_of(mesh, i)))
            kept[coverage[i] == Coverage::Holed ? 1 : 0].push_back(i);
    if (kept[0].empty() && kept[1].empty()) return {};

    constexpr std::size_t kPadding = 16;  // bytes behind the last vertex that Embree reads
    const Buffer positions(
        rtcNewBuffer(device.get(), 3 * sizeof(float) * mesh.vertex_count() + kPadding));
    if (!positions) return embree_error(device.get(), "hold the vertices");
    auto* at = static_cast<float*>(rtcGetBufferData(positions.get()));
    for (const Vec3& world : mesh.positions) {
        const Vec3 local = space.to_local(world);
        for (int axis = 0; axis < 3; ++axis) *at++ = local[axis];
    }
    for (std::size_t holed = 0; holed < 2; ++holed)
        if (!kept[holed].empty())
            ENVBAKE_TRY_VOID(add_geometry(source, static_cast<unsigned>(2 * index + holed),
                                          positions.get(), std::move(kept[holed])));
    return {};
}

Expected<void> Tracer::State::add_geometry(const Scene& source, unsigned id, RTCBuffer positions,
                                           std::vector<std::uint32_t> kept) {
    const Mesh& mesh = source.meshes[id / 2];
    const bool holed = id % 2 == 1;
    const Geometry geometry(rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_TRIANGLE));
    rtcSetGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, positions, 0,
                         3 * sizeof(float), mesh.vertex_count());
    auto* indices = static_cast<std::uint32_t*>(
        rtcSetNewGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                3 * sizeof(std::uint32_t), kept.size()));
    if (indices == nullptr) return embree_error(device.get(), "hold the triangles");
    for (const std::uint32_t triangle : kept)
        for (std::size_t corner = 0; corner < 3; ++corner)
            *indices++ = mesh.triangles[3 * triangle + corner];

    TracedTriangles& traced = geometries[id];
    traced.scene = &source;
    traced.mesh = id / 2;
    if (kept.size() != mesh.triangle_count()) traced.triangles = std::move(kept);

    rtcSetGeometryMask(geometry.get(),
                       casts_shadow(source, mesh) ? kOccluderMask : kTransparentMask);
    if (holed) {
        rtcSetGeometryUserData(geometry.get(), &traced);
        rtcSetGeometryIntersectFilterFunction(geometry.get(), drop_hits_in_holes);
        rtcSetGeometryOccludedFilterFunction(geometry.get(), drop_hits_in_holes);
    }
    rtcCommitGeometry(geometry.get());
    rtcAttachGeometryByID(scene.get(), geometry.get(), id);
    return {};
}

const char* isa_name(Isa isa) {
    constexpr const char* kNames[] = {"best", "sse4.2", "avx", "avx2", "avx512"};
    return kNames[static_cast<std::size_t>(isa)];
}

Expected<Tracer> Tracer::build(const Scene& scene, Isa isa) {
    auto state = std::make_unique<State>();
    const std::string config = isa == Isa::Best ? "" : concat("isa=", isa_name(isa));
    state->device.reset(rtcNewDevice(config.c_str()));
    if (!state->device) return embree_error(nullptr, "start");
    if (rtcGetDeviceProperty(state->device.get(), RTC_DEVICE_PROPERTY_RAY_MASK_SUPPORTED) == 0)
        return Error{Errc::Failed,
                     "this Embree was built without ray masks: build it with EMBREE_RAY_MASK=ON"};
    state->scene.reset(rtcNewScene(state->device.get()));
    rtcSetSceneFlags(state->scene.get(), RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(state->scene.get(), RTC_BUILD_QUALITY_MEDIUM);
    state->geometries.resize(2 * scene.meshes.size());
    // The space is read off the indexed vertices, so those are checked before.
    for (std::size_t i = 0; i < scene.meshes.size(); ++i)
        ENVBAKE_TRY_VOID(check(scene, scene.meshes[i], i));
    state->space = TraceSpace(scene);
    const std::vector<MeshCoverage> coverage = coverage_of(scene);
    state->half_spaces = HalfSpaceTree(scene, coverage);
    for (std::size_t i = 0; i < scene.meshes.size(); ++i)
        ENVBAKE_TRY_VOID(state->add(scene, i, coverage[i]));
    rtcCommitScene(state->scene.get());
    if (rtcGetDeviceError(state->device.get()) != RTC_ERROR_NONE)
        return embree_error(state->device.get(), "build its tree");
    return Tracer(std::move(state));
}

Tracer::Tracer(std::unique_ptr<State> state) : state_(std::move(state)) {}
Tracer::Tracer(Tracer&&) noexcept = default;
Tracer& Tracer::operator=(Tracer&&) noexcept = default;
Tracer::~Tracer() = default;

const TraceSpace& Tracer::space() const {
    return state_->space;
}
const HalfSpaceTree& Tracer::half_spaces() const {
    return state_->half_spaces;
}

namespace {

void set_rays(RTCRay16& rays, const Vec3& from, const DirectionPacket& directions) {
    for (unsigned i = 0; i < 16; ++i) {
        rays.org_x[i] = from.x;
        rays.org_y[i] = from.y;
        rays.org_z[i] = from.z;
        rays.tnear[i] = 0;
        rays.dir_x[i] = directions.x[i];
        rays.dir_y[i] = directions.y[i];
        rays.dir_z[i] = directions.z[i];
        rays.time[i] = 0;
        rays.tfar[i] = kInfinity;
        rays.mask[i] = kOccluderMask;
        rays.id[i] = i;
        rays.flags[i] = 0;
    }
}

}  // namespace

std::uint32_t Tracer::occluded16(const DVec3& origin, const DirectionPacket& directions,
                                 std::uint32_t active) const {
    alignas(64) RTCRay16 rays;
    alignas(64) int valid[16];
    set_rays(rays, state_->space.to_local(origin), directions);
    for (unsigned i = 0; i < 16; ++i) valid[i] = (active >> i & 1) != 0 ? -1 : 0;
    embree::occluded16(valid, state_->scene.get(), rays);
    std::uint32_t blocked = 0;
    for (unsigned i = 0; i < 16; ++i)  // Embree marks an occluded ray by tfar = -inf
        blocked |= static_cast<std::uint32_t>(rays.tfar[i] < 0) << i;
    return blocked & active;
}

std::uint32_t Tracer::closest16(const DVec3& origin, const DirectionPacket& directions,
                                HitPacket& hits, std::uint32_t active) const {
    alignas(64) RTCRayHit16 query;
    alignas(64) int valid[16];
    set_rays(query.ray, state_->space.to_local(origin), directions);
    for (unsigned i = 0; i < 16; ++i) {
        valid[i] = (active >> i & 1) != 0 ? -1 : 0;
        query.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
        query.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
    }
    embree::intersect16(valid, state_->scene.get(), query);
    std::uint32_t blocked = 0;
    hits.from_behind = 0;
    for (unsigned i = 0; i < 16; ++i) {
        if (query.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID) continue;
        blocked |= 1u << i;
        const TracedTriangles& traced = state_->geometries[query.hit.geomID[i]];
        hits.mesh[i] = static_cast<std::uint32_t>(traced.mesh);
        hits.triangle[i] = traced.triangle(query.hit.primID[i]);
        hits.u[i] = query.hit.u[i];
        hits.v[i] = query.hit.v[i];
        const float towards = query.hit.Ng_x[i] * directions.x[i] +
                              query.hit.Ng_y[i] * directions.y[i] +
                              query.hit.Ng_z[i] * directions.z[i];
        hits.from_behind |= static_cast<std::uint32_t>(towards > 0) << i;
    }
    return blocked;
}

namespace {

RTCRay make_ray(const Vec3& from, const DVec3& direction, unsigned mask) {
    RTCRay ray{};
    ray.org_x = from.x;
    ray.org_y = from.y;
    ray.org_z = from.z;
    ray.dir_x = static_cast<float>(direction.x);
    ray.dir_y = static_cast<float>(direction.y);
    ray.dir_z = static_cast<float>(direction.z);
    ray.tfar = kInfinity;
    ray.mask = mask;
    return ray;
}

}  // namespace

bool Tracer::occluded(const DVec3& origin, const DVec3& direction) const {
    RTCRay ray = make_ray(state_->space.to_local(origin), direction, kOccluderMask);
    embree::occluded1(state_->scene.get(), ray);
    return ray.tfar < 0;
}

std::optional<Hit> Tracer::closest(const DVec3& origin, const DVec3& direction) const {
    RTCRayHit query{};
    query.ray =
        make_ray(state_->space.to_local(origin), direction, kOccluderMask | kTransparentMask);
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    embree::intersect1(state_->scene.get(), query);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
    Hit hit;
    const TracedTriangles& traced = state_->geometries[query.hit.geomID];
    hit.mesh = static_cast<std::uint32_t>(traced.mesh);
    hit.triangle = traced.triangle(query.hit.primID);
    hit.u = query.hit.u;
    hit.v = query.hit.v;
    hit.distance = static_cast<float>(query.ray.tfar / state_->space.scale());
    hit.geometric_normal = glm::normalize(DVec3(query.hit.Ng_x, query.hit.Ng_y, query.hit.Ng_z));
    return hit;
}

}  // namespace envbake
