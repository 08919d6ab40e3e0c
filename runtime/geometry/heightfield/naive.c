/* Cell stepping for every query, in both precisions: the simplest code there is, and what all other structures must
 * agree with. */
#include "internal.h"

#include <math.h>

#define LANES 1
#define F64 0
#include "simd.h"
#include "leaf.h"
#include "naive.inc.h"
#undef F64
#define F64 1
#include "simd.h"
#include "leaf.h"
#include "naive.inc.h"

#define QUERY(name, what, bits)                                                                                                                                             \
    static void name##_##bits(const SltGeometry *field, const void *heights, const void *rays, uint64_t mask, uint32_t width, int32_t *id) {                                  \
        Field room;                                                                                                                                                        \
        naive_run_f##bits##x1(field_asked(field, &room), what, heights, rays, mask, width, id, NULL);                                                                      \
    }
#define QUERIES(bits)                                                                                                                                                       \
    QUERY(trace, SLT_QUERY_TRACE, bits)                                                                                                                                     \
    QUERY(clearance, SLT_QUERY_CLEARANCE, bits)                                                                                                                             \
    QUERY(shadow, SLT_QUERY_SHADOW, bits)                                                                                                                                   \
    QUERY(silhouette, SLT_QUERY_SILHOUETTE, bits)                                                                                                                           \
    QUERY(rise, SLT_QUERY_RISE, bits)
QUERIES(32)
QUERIES(64)

SltQueryFn *const field_naive[2][SLT_QUERIES] = {
    {trace_32, trace_32, clearance_32, shadow_32, silhouette_32, rise_32},
    {trace_64, trace_64, clearance_64, shadow_64, silhouette_64, rise_64},
};

void field_naive_count(const Field *f, SltQuery what, const void *heights, const void *rays, uint64_t mask,
                       uint32_t width, int32_t *id, FieldCounts *counts) {
    if (f->f64) naive_run_f64x1(f, what, heights, rays, mask, width, id, counts);
    else naive_run_f32x1(f, what, heights, rays, mask, width, id, counts);
}

void field_naive_slice(const Field *f, const void *heights, const void *ray, Slice *slice, FieldCounts *counts) {
    int32_t last = f->f64 ? naive_ray_f64x1(f, SLT_QUERY_SILHOUETTE, heights, ray, 1, 0, slice, counts)
                          : naive_ray_f32x1(f, SLT_QUERY_SILHOUETTE, heights, ray, 1, 0, slice, counts);
    if (last != SLT_WITNESS_NONE) slice_add(slice, last);
}
