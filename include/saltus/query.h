/* Queries: how kernels ask where a ray meets a geometry.
 *
 * A query answers *where* with one integer, a witness; *what* (the distance, the clearance, the point) is ordinary
 * arithmetic of the kernel on the few numbers of the geometry that the witness names. So a query has no derivative rule
 * of its own, reverse mode never searches, and a tape keeps four bytes a query.
 *
 * Queries are the rows of saltus/queries.def, geometries those of saltus/geometries.def. A ray is given in the
 * coordinates of the geometry; t is in units of the ray's direction, which need not have unit length. A point of the
 * ray is blocked where it is strictly inside the geometry. The header of each geometry says what its faces and edges
 * are and how they are numbered (saltus/heightfield.h). */
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

/* Sets of kinds, for the column `geometries` of queries.def. */
enum {
#define GEOMETRY(id, ...) SLT_ON_##id = 1 << SLT_GEOMETRY_##id,
#include "saltus/geometries.def"
#undef GEOMETRY
    SLT_ON_NOTHING = 0
};

/* Heights of ray and geometry at the same point of the ground are z(t) = oz + t dz and G(t).
 *
 * TRACE       the first point of [t0, t1] that is blocked: its face, or AT_T0 (blocked at the start already)
 * OCCLUDED    whether TRACE finds one: NONE, or any other number, which says no more
 * CLEARANCE   where (z - G) / t is least over the part of [t0, t1] in the geometry's box, t0 > 0: an edge, AT_T0 or
 *             AT_T1. Of equal places the first
 * SHADOW      CLEARANCE for its sign and zero set only: the same place where |z - G| < band (GeometrySource.band)
 * there; else any blocked point, or if there is none any point or NONE SILHOUETTE  with the slope k(t) = (G - oz) / t
 * seen from the origin along (dx, dy), t > 0: the first local maximum of k that exceeds every k before it, kmin < k <
 * kmax: an edge (a border edge where the geometry ends while k rises). k is looked at where the ray crosses edges, so
 * an origin on the surface, up to rounding, is well defined; one below it is taken for one on it RISE        the first
 * local maximum of k after t0, before t1: an edge, AT_T0 if k falls from t0 on, or AT_T1 if it rises up to t1. The top
 * of what a ray blocked at t0 runs into
 * BLOCKED     of a box of rays: whether TRACE finds a point for all of them, for none, or that is not known
 * LINE        of a box of rays: one of the two numbers of a line (saltus/mesh.h) that parts those that meet something
 *             from those that do not, or NONE
 * BEGIN       0, and what the thread was told of pieces is forgotten: before the first PIECES of a vector of samples
 * PIECES      what is seen through a window: the unit of the first piece (saltus/mesh.h) in SltToldFn, 0 for none
 * SEEN        PIECES whose sides are not told
 * BETWEEN     what parts two rays that meet different faces: one of the two numbers of a line (saltus/mesh.h), or NONE
 * IRRADIANCE  what of a parallelogram shines on a point past the geometry: the unit of the answer (saltus/mesh.h), or 0
 * LTC         the same, of a shining surface
 * LIT         what a point light sees of a piece: the unit of the answer, or 0 */
typedef enum SltQuery {
#define QUERY(id, ...) SLT_QUERY_##id,
#include "saltus/queries.def"
#undef QUERY
    SLT_QUERIES
} SltQuery;

/* The numbers of a ray. Of a SLICE (queries.def), T0 is kmin, T1 is kmax and DZ is not read. A BOX of rays has twice as
 * many: the least of each, then the greatest; every ray has each of its numbers in between, the ends included. LIFT is
 * read of boxes alone: how high origins lie above the geometry below them, up to rounding of a few units in the last
 * place of either or of LIFT_OF; then OZ is not read. NaN or infinite: not known. */
typedef enum SltRayRow {
    SLT_RAY_OX,
    SLT_RAY_OY,
    SLT_RAY_OZ,
    SLT_RAY_DX,
    SLT_RAY_DY,
    SLT_RAY_DZ,
    SLT_RAY_T0,
    SLT_RAY_T1,
    SLT_RAY_POINT_ROWS,
    SLT_RAY_LIFT = SLT_RAY_POINT_ROWS,
    SLT_RAY_LIFT_OF,
    SLT_RAY_ROWS,
    SLT_BOX_ROWS = 2 * SLT_RAY_ROWS,
    SLT_LINE_WHICH = SLT_BOX_ROWS, /* of a LINE, behind the box: number k of the two of line n as 2 n + k */
    SLT_LINE_ROWS
} SltRayRow;

/* Witnesses below 0. Before a search, a dx or dy so small that its reciprocal overflows counts as 0, an infinite t as
 * 1e30 (f64: 1e300), and t0 of CLEARANCE, SHADOW and RISE is raised to 1e-30 (1e-300). */
enum {
    SLT_WITNESS_NONE = -1, /* nothing: a miss, no part of [t0, t1] in the box, or a ray with a NaN */
    SLT_WITNESS_AT_T0 = -2,
    SLT_WITNESS_AT_T1 = -3,
    SLT_WITNESS_OWN = -4 /* from here down: what the geometry's header says */
};
/* Answers of BLOCKED. Of FREE and BLOCKED every ray of the box, decided by TRACE or OCCLUDED, is a case; EITHER says
 * nothing. EITHER + n, n from 1 to SLT_LINES: rays between which there is none of n lines, which LINE names, are
 * decided alike. EITHER + SLT_LINES + n: there are more lines, or these do not tell whose a place is. */
enum { SLT_RAYS_FREE = SLT_WITNESS_NONE, SLT_RAYS_BLOCKED = 0, SLT_RAYS_EITHER = 1, SLT_LINES = 4 };

struct SltGeometry;
/* Answers one query for `width` <= 64 rays into witness[width]; lanes outside mask get NONE. values: the geometry's
 * slice of the parameters. rays: flt[SLT_RAY_POINT_ROWS][width] (of boxes flt[SLT_BOX_ROWS][width]), flt being the
 * precision that the geometry was made for. The same ray gets the same answer at every width, in every lane, and from
 * every structure. Never allocates or fails; thread-safe while nobody refreshes the geometry. */
typedef void SltQueryFn(const struct SltGeometry *geometry, const void *values, const void *rays, uint64_t mask,
                        uint32_t width, int32_t *witness);

/* What queries of this thread have found, from unit 0 on, which is nothing; stays until the next query. */
typedef const void *SltToldFn(void);

/* What a kernel sees of a geometry. A copy with another slack may be queried too, as long as the original lives. */
typedef struct SltGeometry {
    SltQueryFn *query[SLT_QUERIES]; /* NULL: this geometry does not answer it */
    float slack;      /* values may exceed those that the structure was made from by this much, in their unit (finite
                         differences): searches widen their bounds by it, and answers stay exact */
    SltToldFn *told;  /* NULL: nothing is told */
    const void *made; /* the whole geometry (runtime/geometry/geometry.h); of a copy, the original */
} SltGeometry;

#ifdef __cplusplus
}
#endif
#endif
