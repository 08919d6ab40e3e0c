/* Heightfields: geometry_heightfield is what runtime/geometry/geometry.h calls; the functions here are for tests and
 * benchmarks, which ask more. Heights passed to a query lie at most `slack` above those of the last make or refresh.
 *
 *   heights (caller's)
 *     ->  mipmap: level 1, 2 ... (maximum over 2 x 2, 4 x 4 ... cells)
 *     ->  packets of 16, 8, 4 or 1 rays
 *     ->  witnesses
 *
 * Only what the queries in use need is built: a naive field holds no memory of its own, unless it is asked BLOCKED,
 * which needs the mipmap. */
#ifndef SALTUS_HEIGHTFIELD_FIELD_H
#define SALTUS_HEIGHTFIELD_FIELD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "runtime/geometry/geometry.h"
#include "saltus/heightfield.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Instruction sets, narrowest first; FIELD_ISA_BEST is the widest that this machine has. */
typedef enum FieldIsa {
    FIELD_ISA_BEST,
    FIELD_ISA_SCALAR,
    FIELD_ISA_SSE2,
    FIELD_ISA_AVX2,
    FIELD_ISA_AVX512,
    FIELD_ISAS
} FieldIsa;

typedef struct FieldOptions {
    SltStructure structure;
    uint32_t queries;      /* bit (1 << SltQuery); 0: all */
    float band;            /* of SLT_QUERY_SHADOW, in raw units of height; infinity makes it CLEARANCE */
    float slack;           /* of SltGeometry, in raw units of height */
    bool cone_exact;       /* CONE: FieldConeOptions.exact: slower to make */
    bool cone_directional; /* CONE: FieldConeOptions.directional */
    float max_slope;       /* CONE: FieldConeOptions.max_slope in grid space; 0: no bound */
    FieldIsa isa;          /* wider than the machine has: SLT_USAGE */
} FieldOptions;

/* heights: w * h of float or, if f64, double. `o` may be NULL: a mipmap for all queries. *out is the caller's, for
 * field_free. Non-finite heights are allowed: NaN blocks nothing. */
SltStatus field_make(SltGeometry **out, const void *heights, bool f64, uint32_t w, uint32_t h, const FieldOptions *o,
                     SltError *err);

/* The heights of the vertices x0 <= i < x1, y0 <= j < y1 have changed (grid coordinates: j upwards, not rows of the
 * data). The rectangle is clipped to the field; an empty one does nothing. */
void field_refresh(SltGeometry *field, const void *heights, uint32_t x0, uint32_t y0, uint32_t x1, uint32_t y1);

void field_free(SltGeometry *field); /* NULL: nothing */

/* Bytes held for the structure, without the heights. */
size_t field_bytes(const SltGeometry *field);

/* One line for people: structure, levels, instruction set. The string lives as long as the field. */
const char *field_describe(const SltGeometry *field);

/* ---- counting, for tests and benchmarks: one ray at a time, same answers, slower */
typedef struct FieldCounts {
    uint64_t rays, nodes, cells; /* nodes: looked up in a level; cells: whose triangles were tested */
} FieldCounts;
void field_count(const SltGeometry *field, SltQuery what, const void *heights, const void *rays, uint64_t mask,
                 uint32_t width, int32_t *id, FieldCounts *counts);

/* All silhouettes of one slice in one pass: from o[3] along d[2] (numbers of the field's precision), slopes kmin < k <
 * kmax. Writes at most `cap` edges to id, nearest first, and returns how many there are: the edges that
 * SLT_QUERY_SILHOUETTE gives when it is asked again and again with kmin = the last k. counts may be NULL. */
uint32_t field_silhouettes(const SltGeometry *field, const void *heights, const void *o, const void *d, double kmin,
                           double kmax, int32_t *id, uint32_t cap, FieldCounts *counts);

#ifdef __cplusplus
}
#endif
#endif
