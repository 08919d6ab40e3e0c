/* facets.inc.h for the machine that all have. */
#include <float.h>
#include <math.h>

#include "beam.h"
#include "cross.h"
#include "window.h"

#include "lanes.h"
#include "beams.inc.h"

#include "cover.inc.h"
#include "sheet.inc.h"

#include "facets.inc.h"
#include "beam.inc.h"
#include "cross.inc.h"

const FacetSearch facets_plain = {.inside = surely_inside,
                                  .read = read,
                                  .place = place,
                                  .list = list,
                                  .survey = survey,
                                  .survey_all = survey_all,
                                  .cover = cover_all,
                                  .split = split};
const BeamSearch beam_plain = {
    .boxes = beam_boxes, .triangles = beam_triangles, .alike = beam_alike, .facings = beam_facings};
const CrossSearch cross_plain = {.row = cross_row};
