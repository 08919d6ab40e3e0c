/* The packets of packet.inc.h for SSE2: 4 floats, doubles one by one; CMakeLists.txt gives this file its -m flags. */
#include "internal.h"

#include <math.h>

#if defined(__x86_64__)
#define LANES 4
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

const FieldKernels field_sse2 = {
    .query = {{trace_f32x4, occluded_f32x4, clearance_f32x4, shadow_f32x4, silhouette_f32x4, rise_f32x4},
              {trace_f64x1, occluded_f64x1, clearance_f64x1, shadow_f64x1, silhouette_f64x1, rise_f64x1}},
    .cone = {cone_trace_f32x4, cone_trace_f64x1},
    .first_level32 = first_level32,
    .first_level64 = first_level64,
    .next_level = next_level,
};
#endif
