/* What is seen of a mesh through a window, as convex polygons (Zhou, Wu, Ramamoorthi, Yan 2021; splits by half-planes
 * instead of their integers and trees).
 *
 * A place of the window is (s, t) in [0, 1]^2, its direction d = c + s u + t v, c from the eye to the window's first
 * corner. With corners A, B of an edge seen from the eye, g = d . (A x B) is linear in (s, t) and 0 on the edge's line;
 * d . n / det, n = A x B + B x C + C x A, is linear too and 1 / t of the triangle's plane: of two triangles the one
 * with more is seen, and where the difference changes its sign they cross. So every side of a piece is a line, and the
 * piece of a triangle is what half-planes leave of the window: in front, beside or beyond it alike, corners behind the
 * eye too.
 *
 *   windows -> those near each other, one way through the tree -> facets.inc.h, triangles in each window
 *           -> parts of the window with few triangles, depth first -> cover.inc.h, polygons of each -> told.c
 *
 * What is told lies in the thread's store, a row of units of 8 numbers of the mesh's precision, which kernels read: a
 * piece, its sides behind it (saltus/mesh.h). Unit 0 is no piece. The store is emptied by SLT_QUERY_BEGIN. */
#ifndef SALTUS_MESH_PIECES_H
#define SALTUS_MESH_PIECES_H

#include <stdatomic.h>

#include "adjacency.h"
#include "rays.h"
#include "saltus/mesh.h"

typedef struct PieceScene {
    BvhScene tree;
    const void *values;
    const Adjacency *adjacency; /* NULL: sides are not told */
    bool outlined;              /* outline.h is asked later */
    const struct FacetSearch *facets;
    atomic_bool *blind; /* set where a window's numbers are not finite, or beyond 1e30: nothing is seen through it */
} PieceScene;

/* The pieces seen through a window, rays: rows of SltBeamRow; witness: the unit of the first, or left as it is where
 * nothing is seen. False: out of memory, some are missing. */
bool pieces_find(const PieceScene *s, const void *rays, uint64_t mask, uint32_t width, int32_t *witness);

/* Is it known, by what was listed last, that all windows see nothing? */
bool pieces_none(const PieceScene *s, const void *rays, uint32_t width);

/* ---- the thread's store (told.c) */
void pieces_begin(void);       /* empties it, less what is held */
uint64_t pieces_begun(void);   /* how often that was, in this thread */
const void *pieces_told(void); /* SltToldFn */
/* Adds a unit, the first `whole` numbers integers; its number, 0 where there is no memory. */
uint32_t pieces_tell(bool f64, const double number[SLT_TOLD], uint32_t whole);

/* ---- what windows have seen, kept for whoever looks through them again (held.c) */
typedef struct Held Held;
void pieces_hold(bool on); /* GeometryOps.hold */
Held *pieces_held(void);   /* NULL: nothing is kept now */
void held_set(Held *h, bool on);
uint32_t held_begin(Held *h, uint32_t units); /* how many of so many units stay when the store is emptied */
/* The lanes whose window `of` was asked about before; their witnesses. */
uint64_t held_find(const Held *h, const void *of, const void *rays, bool f64, uint64_t mask, uint32_t width,
                   int32_t *witness);
void held_add(Held *h, const void *of, const void *rays, bool f64, uint64_t mask, uint32_t width,
              const int32_t *witness);

/* For each instruction set, the same bits from all. */
extern const struct FacetSearch facets_plain, facets_avx2, facets_avx512;

#endif
