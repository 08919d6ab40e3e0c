/* Embree 3 as the anchor of benchmarks of rays: a mesh of triangles or its grid primitive, one thread. What is timed of
 * a packet call is the call and what must be reset in the packet before it (the far ends, the ids), nothing else. */
#include "rays.h"

const char *const embree_call_names[EMBREE_CALLS] = {"int1", "int8", "int16", "occ1", "occ8", "occ16"};

#ifndef BENCH_EMBREE
EmbreeScene *embree_scene_make(const EmbreeSource *from, double *seconds, size_t *bytes) {
    (void)from, (void)seconds, (void)bytes;
    return NULL;
}
void embree_scene_free(EmbreeScene *s) { (void)s; }
const char *embree_config(void) { return "none"; }
void embree_prepare(EmbreeScene *s, const Rays *r) { (void)s, (void)r; }
void embree_run(EmbreeScene *s, EmbreeCall call, bool coherent) { (void)s, (void)call, (void)coherent; }
float embree_result(const EmbreeScene *s, EmbreeCall call, uint32_t k) {
    (void)s, (void)call, (void)k;
    return 0.0f;
}
#else
#include <embree3/rtcore.h>
#include <math.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct EmbreeScene {
    RTCDevice device;
    RTCScene scene;
    const Rays *rays;
    struct RTCRayHit *one;
    struct RTCRayHit8 *eight;
    struct RTCRayHit16 *sixteen;
};

static bool count_bytes(void *user, ssize_t bytes, bool post) {
    (void)post;
    atomic_fetch_add((_Atomic long *)user, bytes);
    return true;
}

EmbreeScene *embree_scene_make(const EmbreeSource *from, double *seconds, size_t *bytes) {
    EmbreeScene *s = calloc(1, sizeof *s);
    static _Atomic long used;
    atomic_store(&used, 0);
    s->device = rtcNewDevice("threads=1,set_affinity=0");
    rtcSetDeviceMemoryMonitorFunction(s->device, count_bytes, &used);
    RTCGeometry g = rtcNewGeometry(s->device, from->face ? RTC_GEOMETRY_TYPE_TRIANGLE : RTC_GEOMETRY_TYPE_GRID);
    float *v = rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, from->nvertices);
    memcpy(v, from->vertex, 12 * (size_t)from->nvertices);
    if (from->face) {
        uint32_t *tri = rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, from->nfaces);
        memcpy(tri, from->face, 12 * (size_t)from->nfaces);
    } else {
        struct RTCGrid *one = rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_GRID, 0, RTC_FORMAT_GRID, sizeof *one, 1);
        *one = (struct RTCGrid){
            .startVertexID = 0, .stride = from->side, .width = (uint16_t)from->side, .height = (uint16_t)from->side};
    }
    long buffers = atomic_load(&used);
    double start = bench_now();
    rtcCommitGeometry(g);
    s->scene = rtcNewScene(s->device);
    if (from->robust) rtcSetSceneFlags(s->scene, RTC_SCENE_FLAG_ROBUST);
    rtcAttachGeometry(s->scene, g);
    rtcCommitScene(s->scene);
    *seconds = bench_now() - start;
    *bytes = (size_t)(atomic_load(&used) - buffers);
    rtcReleaseGeometry(g);
    return s;
}
void embree_scene_free(EmbreeScene *s) {
    if (!s) return;
    rtcReleaseScene(s->scene);
    rtcReleaseDevice(s->device);
    free(s->one), free(s->eight), free(s->sixteen);
    free(s);
}

const char *embree_config(void) {
    static char text[64];
    RTCDevice d = rtcNewDevice("threads=1");
    snprintf(text, sizeof text, "%ld, packets of 8 %s, of 16 %s",
             (long)rtcGetDeviceProperty(d, RTC_DEVICE_PROPERTY_VERSION),
             rtcGetDeviceProperty(d, RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED) ? "native" : "emulated",
             rtcGetDeviceProperty(d, RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) ? "native" : "emulated");
    rtcReleaseDevice(d);
    return text;
}

#define FILL(q, W)                                                                                                                                                       \
    do {                                                                                                                                                                 \
        (q)->ray.org_x[k % W] = r->o[0], (q)->ray.org_y[k % W] = r->o[1], (q)->ray.org_z[k % W] = r->o[2];                                                               \
        (q)->ray.dir_x[k % W] = r->d[0], (q)->ray.dir_y[k % W] = r->d[1], (q)->ray.dir_z[k % W] = r->d[2];                                                               \
        (q)->ray.tnear[k % W] = r->t0, (q)->ray.time[k % W] = 0.0f, (q)->ray.mask[k % W] = ~0u, (q)->ray.id[k % W] = 0, (q)->ray.flags[k % W] = 0;                       \
        (q)->hit.geomID[k % W] = RTC_INVALID_GEOMETRY_ID;                                                                                                                \
    } while (0)

void embree_prepare(EmbreeScene *s, const Rays *rays) {
    s->rays = rays;
    free(s->one), free(s->eight), free(s->sixteen);
    s->one = aligned_alloc(64, sizeof *s->one * rays->count);
    s->eight = aligned_alloc(64, sizeof *s->eight * (rays->count / 8));
    s->sixteen = aligned_alloc(64, sizeof *s->sixteen * (rays->count / 16));
    for (uint32_t k = 0; k < rays->count; k++) {
        const Ray *r = &rays->ray[k];
        struct RTCRayHit *q = &s->one[k];
        *q = (struct RTCRayHit){.ray = {.org_x = r->o[0],
                                        .org_y = r->o[1],
                                        .org_z = r->o[2],
                                        .dir_x = r->d[0],
                                        .dir_y = r->d[1],
                                        .dir_z = r->d[2],
                                        .tnear = r->t0,
                                        .mask = ~0u}};
        FILL(&s->eight[k / 8], 8);
        FILL(&s->sixteen[k / 16], 16);
    }
}

void embree_run(EmbreeScene *s, EmbreeCall call, bool coherent) {
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    uint32_t count = s->rays->count;
    const Ray *ray = s->rays->ray;
    _Alignas(64) int valid[16];
    for (int i = 0; i < 16; i++) valid[i] = -1;
    switch (call) {
    case EMBREE_INT1:
    case EMBREE_OCC1:
        for (uint32_t k = 0; k < count; k++) {
            struct RTCRayHit *q = &s->one[k];
            q->ray.tfar = ray[k].t1, q->hit.geomID = RTC_INVALID_GEOMETRY_ID;
            if (call == EMBREE_INT1) rtcIntersect1(s->scene, &context, q);
            else rtcOccluded1(s->scene, &context, &q->ray);
        }
        break;
    case EMBREE_INT8:
    case EMBREE_OCC8:
        for (uint32_t k = 0; k < count; k += 8) {
            struct RTCRayHit8 *q = &s->eight[k / 8];
            for (uint32_t i = 0; i < 8; i++) q->ray.tfar[i] = ray[k + i].t1, q->hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
            if (call == EMBREE_INT8) rtcIntersect8(valid, s->scene, &context, q);
            else rtcOccluded8(valid, s->scene, &context, &q->ray);
        }
        break;
    default:
        for (uint32_t k = 0; k < count; k += 16) {
            struct RTCRayHit16 *q = &s->sixteen[k / 16];
            for (uint32_t i = 0; i < 16; i++)
                q->ray.tfar[i] = ray[k + i].t1, q->hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
            if (call == EMBREE_INT16) rtcIntersect16(valid, s->scene, &context, q);
            else rtcOccluded16(valid, s->scene, &context, &q->ray);
        }
    }
}

float embree_result(const EmbreeScene *s, EmbreeCall call, uint32_t k) {
    switch (call) {
    case EMBREE_INT1: return s->one[k].hit.geomID == RTC_INVALID_GEOMETRY_ID ? INFINITY : s->one[k].ray.tfar;
    case EMBREE_INT8:
        return s->eight[k / 8].hit.geomID[k % 8] == RTC_INVALID_GEOMETRY_ID ? INFINITY
                                                                            : s->eight[k / 8].ray.tfar[k % 8];
    case EMBREE_INT16:
        return s->sixteen[k / 16].hit.geomID[k % 16] == RTC_INVALID_GEOMETRY_ID ? INFINITY
                                                                                : s->sixteen[k / 16].ray.tfar[k % 16];
    case EMBREE_OCC1: return s->one[k].ray.tfar < 0.0f ? 0.0f : INFINITY;
    case EMBREE_OCC8: return s->eight[k / 8].ray.tfar[k % 8] < 0.0f ? 0.0f : INFINITY;
    default: return s->sixteen[k / 16].ray.tfar[k % 16] < 0.0f ? 0.0f : INFINITY;
    }
}
#endif
