/* facets.inc.h for the machine that all have. */
#include <float.h>
#include <math.h>

#include "window.h"

#include "lanes.h"
#include "facets.inc.h"

const FacetSearch facets_plain = {.read = read, .place = place, .list = list, .survey = survey};
