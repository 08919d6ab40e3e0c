/* Light of a parallelogram that reaches a point past a mesh, exactly, with its derivatives (silhouettes instead of all
 * triangles; Zhou, Wu, Ramamoorthi, Yan 2021 subtract triangles).
 *
 * Everything is seen from the receiver p. A place of the light is (u, v) in [0, 1]^2, its direction c + u U + v V, c
 * from p to the light's corner; X = p + h_z (c + u U + v V) with h = [U V c]^-1 (X - p), (u, v) = h_xy / h_z, is before
 * the light where h_z < 1. Planes through p are lines there. Horizons clip the light; edges across which the mesh
 * begins or ends for p end what is lit. How they cross tells where, with one ray to each part of their arrangement
 * (light_arrange.c). Where rounding hides how they cross they cut the light into convex pieces, each wholly lit or
 * dark, and one ray to each says which. A mesh of which nearly all edges are such (loose triangles), many one behind
 * the other, is subtracted triangle by triangle instead.
 *
 * The light is Lambert's sum over the border of what is lit, or that of all pieces; the derivative that of its sides
 * alone, each on a plane through p and two vertices: with the side held, J = integral of (n . w) w along its arc, and
 * dE = J . d(A x B) / |A x B| (light_sum.c). Against a GGX lobe all directions are first mapped by a matrix T (ltc.h).
 *
 * A triangle whose plane passes p within `near` hides nothing: it is the one that p lies on. One that reaches the
 * light's plane and no further hides nothing either.
 *
 *   planes -> triangles in the beam (bvh.h) -> edges, cut to the light -> crossings -> border of what is lit -> sums
 *                                                                      -> sub-windows of few edges -> pieces -> sums
 *
 * What is found is told as units (saltus/mesh.h) of the thread's store (pieces.h). */
#ifndef SALTUS_MESH_LIGHT_H
#define SALTUS_MESH_LIGHT_H

#include "adjacency.h"
#include "beam.h"
#include "cross.h"
#include "rays.h"
#include "saltus/query.h"

typedef enum LightWay {
    LIGHT_BY_COUNTS,
    LIGHT_SILHOUETTES,
    LIGHT_PIECES, /* silhouettes, but by pieces even where their arrangement is clear */
    LIGHT_TRIANGLES
} LightWay; /* the answer is the same up to rounding */

typedef struct LightScene {
    BvhScene tree;
    const Adjacency *adjacency;
    BvhSearch *search; /* of the tree's precision */
    const BeamSearch *beam;
    const CrossSearch *cross;
    const Cones *cones; /* NULL: of vertices that have moved */
    const void *values; /* the vertices */
    LightWay way;
    bool both; /* IRRADIANCE and LTC of one receiver: what one has found serves the other, until pieces_begin */
} LightScene;

/* rays: rows of a receiver and a light (saltus/mesh.h); what: SLT_QUERY_IRRADIANCE or SLT_QUERY_LTC. witness: the unit
 * of the answer, or 0 where nothing shines on p; of numbers that are not finite NaN is told. False: out of memory, some
 * are missing. */
bool light_find(const LightScene *s, SltQuery what, const void *rays, uint64_t mask, uint32_t width, int32_t *witness);

#endif
