/* facets.inc.h for AVX-512; CMakeLists.txt gives this file its -m flags. */
#include <float.h>
#include <math.h>

#include "beam.h"
#include "cross.h"
#include "window.h"

#if defined(__AVX512DQ__)
#include "lanes.h"
#include "beams.inc.h"

#include "cover.inc.h"
#include "sheet.inc.h"

#include "facets.inc.h"
#include "beam.inc.h"
#include "cross.inc.h"

const FacetSearch facets_avx512 = {.inside = surely_inside,
                                   .read = read,
                                   .place = place,
                                   .list = list,
                                   .survey = survey,
                                   .survey_all = survey_all,
                                   .cover = cover_all,
                                   .split = split};
const BeamSearch beam_avx512 = {
    .boxes = beam_boxes, .triangles = beam_triangles, .alike = beam_alike, .facings = beam_facings};
const CrossSearch cross_avx512 = {.row = cross_row};
#endif
