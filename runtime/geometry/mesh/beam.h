/* Which boxes and triangles lie in a beam: what is inside of a few planes. */
#ifndef SALTUS_MESH_BEAM_H
#define SALTUS_MESH_BEAM_H

#include "bvh.h"
#include "cones.h"

/* Inside: normal . (x - from) + off >= 0. */
typedef struct BeamPlane {
    double normal[3], off;
} BeamPlane;

/* What a point p of a beam tells faces by. */
typedef struct BeamSight {
    double p[3], near; /* a plane that passes p within `near` is seen from neither side */
    double along[3];   /* times a way from p: 1 at the light's plane */
    double beyond;     /* from where on nothing hides; infinite where nothing reaches there */
} BeamSight;

/* Facing of light_inner.h is bit k of `high` and `low`, of triangle k of a leaf. */
typedef struct BeamFacings {
    uint32_t low, high;
} BeamFacings;

/* Bits of those that are not wholly outside of one plane. */
typedef struct BeamSearch {
    uint32_t (*boxes)(const BvhNode *n, const BeamPlane *plane, int planes, const double from[3], double slack);
    uint32_t (*triangles)(const Bvh *b, int32_t leaf, const BeamPlane *plane, int planes, const double from[3]);
    /* Of children below which all faces turn the same side to p, and hide before the light. */
    uint32_t (*alike)(const BvhNode *n, const ConeNode *c, const BeamSight *s);
    BeamFacings (*facings)(const Bvh *b, int32_t leaf, const BeamSight *s);
} BeamSearch;

/* For each instruction set, the same bits from all (facets_plain.c, facets_avx2.c, facets_avx512.c). */
extern const BeamSearch beam_plain, beam_avx2, beam_avx512;

#endif
