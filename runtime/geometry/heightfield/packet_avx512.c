/* The packets of packet.inc.h for AVX-512: 16 floats or 8 doubles; CMakeLists.txt gives this file its -m flags. */
#include "internal.h"

#include <math.h>

#if defined(__x86_64__)
#define LANES 16
#define F64 0
#include "simd.h"
#include "leaf.h"
#include "packet.inc.h"
#include "cone.inc.h"
#undef LANES
#undef F64
#define LANES 8
#define F64 1
#include "simd.h"
#include "leaf.h"
#include "packet.inc.h"
#include "cone.inc.h"
#include "rows.inc.h"

const FieldKernels field_avx512 = {
    .query = {{trace_f32x16, occluded_f32x16, clearance_f32x16, shadow_f32x16, silhouette_f32x16, rise_f32x16},
              {trace_f64x8, occluded_f64x8, clearance_f64x8, shadow_f64x8, silhouette_f64x8, rise_f64x8}},
    .cone = {cone_trace_f32x16, cone_trace_f64x8},
    .first_level32 = first_level32,
    .first_level64 = first_level64,
    .next_level = next_level,
};
#endif
