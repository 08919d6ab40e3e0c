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
 *   window -> sub-windows of few triangles, depth first -> pieces of each -> the thread's store
 *
 * The store is a row of units of 8 numbers of the mesh's precision, which kernels read (OP_told): a piece, its sides
 * behind it. It is emptied by SLT_QUERY_BEGIN. */
#ifndef SALTUS_MESH_PIECES_H
#define SALTUS_MESH_PIECES_H

#include "rays.h"

/* The pieces seen through a window, rays: rows of SltBeamRow; witness: the unit of the first, or SLT_WITNESS_NONE. */
void pieces_find(const BvhScene *s, const void *values, const void *rays, uint64_t mask, uint32_t width,
                 int32_t *witness);
void pieces_begin(void);                                    /* empties the thread's store */
double pieces_told(bool f64, int32_t unit, uint32_t which); /* 0 where there is nothing */

/* Does the store of any thread lack pieces for want of memory since the last call? */
bool pieces_lost(void);

#endif
