/* rays.inc.h for AVX2; CMakeLists.txt gives this file its -m flags. */
#include "rays.h"

#include <float.h>
#include <math.h>

#include "saltus/query.h"

#if defined(__AVX2__)
#include "lanes.h"
#define F64 0
#include "rays.inc.h"
#undef F64
#define F64 1
#include "rays.inc.h"

const BvhSearches bvh_avx2 = {.name = "AVX2", .by = {search_f32, search_f64}};
#endif
