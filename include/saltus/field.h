/* Heightfield queries: how kernels ask where a ray meets the terrain.
 *
 * A query answers *where* with one integer, a witness; *what* (the distance, the clearance, the point) is ordinary
 * arithmetic of the kernel on the few heights that the witness names. So a query has no derivative rule of its own,
 * reverse mode never searches, and a tape keeps four bytes a query.
 *
 * Grid space: vertex (i, j), 0 <= i < w, 0 <= j < h, lies at x = i, y = j, with j upwards; its height is heights[(h - 1
 * - j) * w + i] (row 0 of the data is the largest y), in raw units: the program's [Extent] and [Height] are applied to
 * the ray, not to the data. Cell (i, j) spans [i, i+1] x [j, j+1] and is two triangles, split along (i+1, j)-(i, j+1).
 * The terrain is the solid below the surface inside the box [0, w-1] x [0, h-1]; outside there is none. t is in units
 * of the ray's direction, which need not have unit length. A point is blocked where the ray is strictly below the
 * surface.
 *
 * Triangles: 2 * (j * w + i) + (1 for the upper one, at (i+1, j+1)). Edges: 4 * (j * w + i) + kind, with kind 0: (i,
 * j)-(i+1, j), 1: (i, j)-(i, j+1), 2: the diagonal (i+1, j)-(i, j+1). */
#ifndef SALTUS_FIELD_H
#define SALTUS_FIELD_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum SltFieldWhat {
    SLT_FIELD_TRACE, /* the first point of [t0, t1] that is blocked: its triangle, AT_T0 (blocked at the start already),
                        or WALL (entering the box below its rim) */
    SLT_FIELD_OCCLUDED,  /* whether TRACE finds one: NONE, or any other number, which says no more. Cheaper */
    SLT_FIELD_CLEARANCE, /* where (ray - terrain) / t is least over the part of [t0, t1] inside the box, t0 > 0: an
                            edge, AT_T0 or AT_T1. The earliest of equals */
    SLT_FIELD_SHADOW, /* CLEARANCE for its sign and zero set only: exact where |ray - terrain| < band, else any blocked
                         point, or NONE. Cheaper */
    SLT_FIELD_SILHOUETTE, /* rays: ox oy oz dx dy - kmin kmax. The first local maximum of k(t) = (terrain - oz) / t
                             along (dx, dy), t > 0, above all before it, with kmin < k < kmax: an edge (a border edge
                             where the terrain ends while k rises). k is looked at where the ray crosses edges, so an
                             origin on the surface, up to rounding, is well defined; one below it is taken for one on it
                           */
    SLT_FIELD_RISE, /* the first local maximum of k after t0, before t1: an edge, AT_T0 if k falls from t0 on, or AT_T1
                       if it rises up to t1. The top of what a ray blocked at t0 runs into */
    SLT_FIELD_WHATS
} SltFieldWhat;

enum { SLT_FIELD_RAY_ROWS = 8 };

enum {
    SLT_FIELD_NONE = -1, /* nothing: a miss, no part of [t0, t1] in the box, or a ray with a NaN */
    SLT_FIELD_AT_T0 = -2,
    SLT_FIELD_AT_T1 = -3,
    /* A direction so small that 1 / dx overflows counts as 0; an infinite t as 1e30 (f64: 1e300); t0 of CLEARANCE,
       SHADOW and RISE is raised to 1e-30 (1e-300). */
    SLT_FIELD_WALL = -4 /* -4: x = 0, -5: x = w-1, -6: y = 0, -7: y = h-1 */
};

struct SltField;
/* rays: flt[8][width], rows ox oy oz dx dy dz t0 t1 in grid space (flt: the precision the field was made for); lanes
 * outside mask get NONE. The same ray gets the same answer at every width, in every lane, and from every structure.
 * width <= 64. Never allocates or fails; thread-safe while nobody refreshes the field. */
typedef void SltFieldQuery(const struct SltField *field, const void *heights, const void *rays, uint64_t mask,
                           uint32_t width, int32_t *id);

/* What a kernel sees of a field; the runtime's own part lies behind it. A copy with another slack may be queried too,
 * as long as the original lives. */
typedef struct SltField {
    SltFieldQuery *query[SLT_FIELD_WHATS];
    uint32_t w, h; /* vertices, each at least 2 */
    float band;    /* SHADOW: raw height units */
    float slack; /* heights may lie up to this above those the structure was made from (finite differences): bounds are
                    widened by it, answers stay exact */
    const void *structure;
} SltField;

#ifdef __cplusplus
}
#endif
#endif
