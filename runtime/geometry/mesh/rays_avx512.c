/* rays.inc.h for AVX-512; CMakeLists.txt gives this file its -m flags. */
#include "rays.h"

#include <float.h>
#include <math.h>

#include "saltus/query.h"

#if defined(__AVX512DQ__)
#include "lanes.h"
#define F64 0
#include "rays.inc.h"
#undef F64
#define F64 1
#include "rays.inc.h"

const BvhSearches bvh_avx512 = {.name = "AVX-512", .by = {search_f32, search_f64}};
#endif
