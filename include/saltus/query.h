/* Queries: how kernels ask where a ray meets a geometry.
 *
 * A query answers *where* with one integer, a witness; *what* (the distance, the clearance, the point) is ordinary
 * arithmetic of the kernel on the few numbers of the geometry that the witness names. So a query has no derivative rule
 * of its own, reverse mode never searches, and a tape keeps four bytes a query.
 *
 * The rows of saltus/queries.def say what there is to ask, those of saltus/geometries.def whom. A ray is given in the
 * coordinates of the geometry; t is in units of its direction, which need not have unit length. A point of the ray is
 * blocked where it is strictly inside the geometry. What faces and edges are, and how they are numbered, each geometry
 * says (saltus/heightfield.h). */
#ifndef SALTUS_QUERY_H
#define SALTUS_QUERY_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum SltGeometryKind {
#define GEOMETRY(id, ...) SLT_GEOMETRY_##id,
#include "saltus/geometries.def"
#undef GEOMETRY
    SLT_GEOMETRIES
} SltGeometryKind;

enum {
#define GEOMETRY(id, ...) SLT_ON_##id = 1 << SLT_GEOMETRY_##id,
#include "saltus/geometries.def"
#undef GEOMETRY
    SLT_ON_NOTHING = 0
};

/* TRACE       the first point of [t0, t1] that is blocked: its face, or AT_T0 (blocked at the start already)
 * OCCLUDED    whether TRACE finds one: NONE, or any other number, which says no more
 * CLEARANCE   where (ray - geometry) / t is least over the part of [t0, t1] in the geometry's box, t0 > 0: an edge,
 *             AT_T0 or AT_T1. The earliest of equals
 * SHADOW      CLEARANCE for its sign and zero set only: exact where |ray - geometry| < band, else any blocked point, or
 *             NONE
 * SILHOUETTE  the first local maximum of k(t) = (geometry - oz) / t along (dx, dy), t > 0, above all before it, with
 *             kmin < k < kmax: an edge (a border edge where the geometry ends while k rises). k is looked at where the
 *             ray crosses edges, so an origin on the surface, up to rounding, is well defined; one below it is taken
 *             for one on it
 * RISE        the first local maximum of k after t0, before t1: an edge, AT_T0 if k falls from t0 on, or AT_T1 if it
 *             rises up to t1. The top of what a ray blocked at t0 runs into */
typedef enum SltQuery {
#define QUERY(id, ...) SLT_QUERY_##id,
#include "saltus/queries.def"
#undef QUERY
    SLT_QUERIES
} SltQuery;

/* The numbers of a ray, one row each. Of a SLICE, T0 is kmin, T1 is kmax and DZ is not read. */
typedef enum SltRayRow {
    SLT_RAY_OX,
    SLT_RAY_OY,
    SLT_RAY_OZ,
    SLT_RAY_DX,
    SLT_RAY_DY,
    SLT_RAY_DZ,
    SLT_RAY_T0,
    SLT_RAY_T1,
    SLT_RAY_ROWS
} SltRayRow;

/* A direction so small that 1 / dx overflows counts as 0; an infinite t as 1e30 (f64: 1e300); t0 of CLEARANCE, SHADOW
 * and RISE is raised to 1e-30 (1e-300). */
enum {
    SLT_WITNESS_NONE = -1, /* nothing: a miss, no part of [t0, t1] in the box, or a ray with a NaN */
    SLT_WITNESS_AT_T0 = -2,
    SLT_WITNESS_AT_T1 = -3,
    SLT_WITNESS_OWN = -4 /* from here down: the geometry's own */
};

struct SltGeometry;
/* values: the geometry's slice of the parameters. rays: flt[SLT_RAY_ROWS][width] (flt: the precision the geometry was
 * made for); lanes outside mask get NONE. The same ray gets the same answer at every width, in every lane, and from
 * every structure. width <= 64. Never allocates or fails; thread-safe while nobody refreshes the geometry. */
typedef void SltQueryFn(const struct SltGeometry *geometry, const void *values, const void *rays, uint64_t mask,
                        uint32_t width, int32_t *witness);

/* What a kernel sees of a geometry. A copy with another slack may be queried too, as long as the original lives. */
typedef struct SltGeometry {
    SltQueryFn *query[SLT_QUERIES]; /* NULL: this geometry does not answer it */
    float slack; /* the geometry may exceed by this much what it was made from (finite differences): bounds are widened
                    by it, answers stay exact */
    const void *made; /* its own part (runtime/geometry/geometry.h); of a copy, the original's */
} SltGeometry;

#ifdef __cplusplus
}
#endif
#endif
