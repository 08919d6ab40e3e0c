/* Which boxes and triangles lie in a beam: what is inside of a few planes. */
#ifndef SALTUS_MESH_BEAM_H
#define SALTUS_MESH_BEAM_H

#include "bvh.h"

/* Inside: normal . (x - from) + off >= 0. */
typedef struct BeamPlane {
    double normal[3], off;
} BeamPlane;

/* Bits of those that are not wholly outside of one plane. */
typedef struct BeamSearch {
    uint32_t (*boxes)(const BvhNode *n, const BeamPlane *plane, int planes, const double from[3], double slack);
    uint32_t (*triangles)(const Bvh *b, int32_t leaf, const BeamPlane *plane, int planes, const double from[3]);
} BeamSearch;

/* For each instruction set, the same bits from all (facets_plain.c, facets_avx2.c, facets_avx512.c). */
extern const BeamSearch beam_plain, beam_avx2, beam_avx512;

#endif
