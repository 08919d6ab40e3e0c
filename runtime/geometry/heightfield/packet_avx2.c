/* The packets of packet.inc.h for AVX2: 8 floats or 4 doubles; CMakeLists.txt gives this file its -m flags. */
#include "internal.h"

#include <math.h>

#if defined(__x86_64__)
#define LANES 8
#define F64 0
#include "simd.h"
#include "leaf.h"
#include "packet.inc.h"
#include "cone.inc.h"
#undef LANES
#undef F64
#define LANES 4
#define F64 1
#include "simd.h"
#include "leaf.h"
#include "packet.inc.h"
#include "cone.inc.h"
#include "rows.inc.h"

const FieldKernels field_avx2 = {
    .query = {{trace_f32x8, occluded_f32x8, clearance_f32x8, shadow_f32x8, silhouette_f32x8, rise_f32x8},
              {trace_f64x4, occluded_f64x4, clearance_f64x4, shadow_f64x4, silhouette_f64x4, rise_f64x4}},
    .cone = {cone_trace_f32x8, cone_trace_f64x4},
    .first_level32 = first_level32,
    .first_level64 = first_level64,
    .next_level = next_level,
};
#endif
