/* What parts two rays that meet a mesh at different faces (SLT_QUERY_BETWEEN).
 *
 * Between the rays lie those of a family, o and d linear in s, from one at s = 0 to the other at s = 1. It cuts the
 * mesh along curves. The walk follows such a curve from the hit of either ray, from face to face:
 *
 *   - it arrives where the other ray hits: both see one piece of the surface, nothing parts them
 *   - it comes to an edge behind which there is no face, more than one, or one that turns back: that edge parts them
 *   - the surface leaves [t0, t1]: the end of the rays parts them, on that face
 *   - it arrives under what the other ray hits: the walk from there tells, or, where that arrives under the first, two
 *     surfaces cross
 *
 * Everything is in double, from the numbers as they are: the same bits everywhere. */
#ifndef SALTUS_MESH_WALK_H
#define SALTUS_MESH_WALK_H

#include "adjacency.h"

typedef struct WalkMesh {
    const Adjacency *adjacency;
    const int32_t *face; /* the topology of saltus/mesh.h */
    const void *vertex;  /* [nvertices][3] of float or double */
    bool f64;
} WalkMesh;

/* rays: rows of SltPairRow; witness: number SLT_PAIR_WHICH of the line, SLT_WITNESS_NONE where nothing parts the two,
 * SLT_BETWEEN_LOST where the walk gave up. Either lane of a pair gets the same answer. */
void walk_between(const WalkMesh *m, const void *rays, uint64_t mask, uint32_t width, int32_t *witness);

#endif
