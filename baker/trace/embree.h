// SPDX-License-Identifier: Apache-2.0
#pragma once

/// Embree 3 and 4 behind the few calls we make. Included by tracer.cpp alone.
/// CMakeLists.txt defines ENVBAKE_EMBREE_MAJOR from the package that it found.

#if ENVBAKE_EMBREE_MAJOR >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

namespace envbake::embree {

/// Incoherent by measurement, although the rays of a packet share their origin. Time of the
/// coherent traversal against this one, sets of 448 / 1600 rays a vertex: 1.2 / 1.05 on the
/// Stanford bunny, 1.3 / 1.2 in a hall of small parts, 0.95 / 0.85 in a garden of large triangles.
#if ENVBAKE_EMBREE_MAJOR >= 4

inline void occluded16(const int* valid, RTCScene scene, RTCRay16& rays) {
    RTCOccludedArguments arguments;
    rtcInitOccludedArguments(&arguments);
    arguments.flags = RTC_RAY_QUERY_FLAG_INCOHERENT;
    rtcOccluded16(valid, scene, &rays, &arguments);
}
inline void intersect16(const int* valid, RTCScene scene, RTCRayHit16& ray_hits) {
    RTCIntersectArguments arguments;
    rtcInitIntersectArguments(&arguments);
    arguments.flags = RTC_RAY_QUERY_FLAG_INCOHERENT;
    rtcIntersect16(valid, scene, &ray_hits, &arguments);
}
inline void occluded1(RTCScene scene, RTCRay& ray) {
    rtcOccluded1(scene, &ray);
}
inline void intersect1(RTCScene scene, RTCRayHit& ray_hit) {
    rtcIntersect1(scene, &ray_hit);
}

#else

inline RTCIntersectContext incoherent_context() {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    return context;
}
inline void occluded16(const int* valid, RTCScene scene, RTCRay16& rays) {
    RTCIntersectContext context = incoherent_context();
    rtcOccluded16(valid, scene, &context, &rays);
}
inline void intersect16(const int* valid, RTCScene scene, RTCRayHit16& ray_hits) {
    RTCIntersectContext context = incoherent_context();
    rtcIntersect16(valid, scene, &context, &ray_hits);
}
inline void occluded1(RTCScene scene, RTCRay& ray) {
    RTCIntersectContext context = incoherent_context();
    rtcOccluded1(scene, &context, &ray);
}
inline void intersect1(RTCScene scene, RTCRayHit& ray_hit) {
    RTCIntersectContext context = incoherent_context();
    rtcIntersect1(scene, &context, &ray_hit);
}

#endif

}  // namespace envbake::embree
