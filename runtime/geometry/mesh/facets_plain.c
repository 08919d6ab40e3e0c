/* facets.inc.h for the machine that all have. */
#include <float.h>
#include <math.h>

#include "window.h"

#include "lanes.h"
#include "facets.inc.h"
#include "cover.inc.h"

const FacetSearch facets_plain = {.place = place, .list = list, .survey = survey, .cover = cover_all, .split = split};
