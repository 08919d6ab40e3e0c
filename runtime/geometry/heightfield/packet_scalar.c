/* The packets of packet.inc.h for any machine: one ray at a time. The counting entries are here too; CMakeLists.txt
 * gives this file its -m flags. */
#include "internal.h"

#include <math.h>

#define LANES 1
#define F64 0
#include "simd.h"
#include "leaf.h"
#include "packet.inc.h"
#include "cone.inc.h"
#undef LANES
#undef F64
#define LANES 1
#define F64 1
#include "simd.h"
#include "leaf.h"
#include "packet.inc.h"
#include "cone.inc.h"
#include "rows.inc.h"

const FieldKernels field_scalar = {
    .query = {{trace_f32x1, occluded_f32x1, clearance_f32x1, shadow_f32x1, silhouette_f32x1, rise_f32x1},
              {trace_f64x1, occluded_f64x1, clearance_f64x1, shadow_f64x1, silhouette_f64x1, rise_f64x1}},
    .cone = {cone_trace_f32x1, cone_trace_f64x1},
    .first_level32 = first_level32,
    .first_level64 = first_level64,
    .next_level = next_level,
};

void field_scalar_count(const Field *f, SltQuery what, const void *heights, const void *rays, uint64_t mask,
                        uint32_t width, int32_t *id, FieldCounts *counts) {
#define COUNT(run)                                                                                                                                                          \
    switch (what) {                                                                                                                                                         \
    case SLT_QUERY_TRACE:                                                                                                                                                   \
    case SLT_QUERY_OCCLUDED: run(f, SLT_QUERY_OCCLUDED, heights, rays, mask, width, id, counts); break;                                                                        \
    case SLT_QUERY_CLEARANCE: run(f, SLT_QUERY_CLEARANCE, heights, rays, mask, width, id, counts); break;                                                                   \
    case SLT_QUERY_SHADOW: run(f, SLT_QUERY_SHADOW, heights, rays, mask, width, id, counts); break;                                                                         \
    case SLT_QUERY_SILHOUETTE: run(f, SLT_QUERY_SILHOUETTE, heights, rays, mask, width, id, counts); break;                                                                 \
    case SLT_QUERY_RISE: run(f, SLT_QUERY_RISE, heights, rays, mask, width, id, counts); break;                                                                             \
    case SLT_QUERY_BEGIN: case SLT_QUERY_PIECES: case SLT_QUERY_SEEN: case SLT_QUERY_BETWEEN: case SLT_QUERY_IRRADIANCE: case SLT_QUERY_LTC: case SLT_QUERY_LIT: case SLT_QUERY_BLOCKED: case SLT_QUERY_LINE: \
    case SLT_QUERIES: break;                                                                                                                                           \
    }
    if (f->f64) COUNT(packet_run_f64x1)
    else COUNT(packet_run_f32x1)
#undef COUNT
}

void field_scalar_cone_count(const Field *f, const void *heights, const void *rays, uint64_t mask, uint32_t width,
                             int32_t *id, FieldCounts *counts) {
    if (f->f64) cone_run_f64x1(f, heights, rays, mask, width, id, counts);
    else cone_run_f32x1(f, heights, rays, mask, width, id, counts);
}

void field_scalar_slice(const Field *f, const void *heights, const void *ray, Slice *slice, FieldCounts *counts) {
    int32_t last = f->f64 ? packet_walk_f64x1(f, SLT_QUERY_SILHOUETTE, heights, ray, 1, -1, slice, counts)
                          : packet_walk_f32x1(f, SLT_QUERY_SILHOUETTE, heights, ray, 1, -1, slice, counts);
    if (last != SLT_WITNESS_NONE) slice_add(slice, last);
}
