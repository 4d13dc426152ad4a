// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/bare_rays.h"

#include "baker/math/frame.h"

#include <ctime>
#include <limits>
#include <vector>

#if ENVBAKE_EMBREE_MAJOR >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

namespace envbake::bench {

double thread_cpu_seconds() {
    timespec now{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

struct BareRays::State {
    TraceSpace space;
    RTCDevice device = nullptr;
    RTCScene scene = nullptr;
};

BareRays::BareRays(const Scene& scene, const TraceSpace& space)
    : state_(std::make_unique<State>()) {
    state_->space = space;
    state_->device = rtcNewDevice(nullptr);
    state_->scene = rtcNewScene(state_->device);
    rtcSetSceneFlags(state_->scene, RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(state_->scene, RTC_BUILD_QUALITY_MEDIUM);
    for (const Mesh& mesh : scene.meshes) {
        if (mesh.triangles.empty() || !casts_shadow(scene, mesh)) continue;
        RTCGeometry geometry = rtcNewGeometry(state_->device, RTC_GEOMETRY_TYPE_TRIANGLE);
        auto* position = static_cast<float*>(
            rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                    3 * sizeof(float), mesh.vertex_count()));
        for (const Vec3& world : mesh.positions) {
            const Vec3 local = space.to_local(world);
            for (int axis = 0; axis < 3; ++axis) *position++ = local[axis];
        }
        auto* index = static_cast<std::uint32_t*>(
            rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                    3 * sizeof(std::uint32_t), mesh.triangle_count()));
        for (const std::uint32_t corner : mesh.triangles) *index++ = corner;
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(state_->scene, geometry);
        rtcReleaseGeometry(geometry);
    }
    rtcCommitScene(state_->scene);
}

BareRays::~BareRays() {
    rtcReleaseScene(state_->scene);
    rtcReleaseDevice(state_->device);
}

BareRays::Result BareRays::trace(const RaySet& set, std::span<const RayOrigin> origins,
                                 std::span<const std::size_t> packet_counts,
                                 double turn_rad) const {
    Result result;
    std::vector<RTCRay16> packets;
    alignas(64) int valid[16];
    for (int& v : valid) v = -1;
    for (std::size_t o = 0; o < origins.size(); ++o) {
        const Frame frame = turned(frame_about(origins[o].normal), turn_rad);
        const Vec3 from = state_->space.to_local(origins[o].position);
        packets.resize(packet_counts[o]);
        for (std::size_t p = 0; p < packets.size(); ++p) {
            RTCRay16& rays = packets[p];
            for (unsigned i = 0; i < 16; ++i) {
                const DirectionPacket& local = set.directions[p];
                const auto w = Vec3(frame.to_world(DVec3(local.x[i], local.y[i], local.z[i])));
                rays.org_x[i] = from.x;
                rays.org_y[i] = from.y;
                rays.org_z[i] = from.z;
                rays.tnear[i] = 0;
                rays.dir_x[i] = w.x;
                rays.dir_y[i] = w.y;
                rays.dir_z[i] = w.z;
                rays.time[i] = 0;
                rays.tfar[i] = std::numeric_limits<float>::infinity();
                rays.mask[i] = 0xffffffff;
                rays.id[i] = i;
                rays.flags[i] = 0;
            }
        }
        const double begin = thread_cpu_seconds();
        for (RTCRay16& rays : packets) {
#if ENVBAKE_EMBREE_MAJOR >= 4
            RTCOccludedArguments arguments;
            rtcInitOccludedArguments(&arguments);
            arguments.flags = RTC_RAY_QUERY_FLAG_INCOHERENT;
            rtcOccluded16(valid, state_->scene, &rays, &arguments);
#else
            RTCIntersectContext context;
            rtcInitIntersectContext(&context);
            context.flags = RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
            rtcOccluded16(valid, state_->scene, &context, &rays);
#endif
        }
        result.cpu_s += thread_cpu_seconds() - begin;
        result.ray_count += 16 * packets.size();
        for (const RTCRay16& rays : packets)
            for (const float far : rays.tfar) result.blocked_count += far < 0;
    }
    return result;
}

}  // namespace envbake::bench
