/* rays.inc.h for the machine that all have. */
#include "rays.h"

#include <float.h>
#include <math.h>

#include "saltus/query.h"

#include "lanes.h"
#define F64 0
#include "rays.inc.h"
#undef F64
#define F64 1
#include "rays.inc.h"

const BvhSearches bvh_plain = {.name = "scalar", .by = {search_f32, search_f64}};
