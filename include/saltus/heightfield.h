/* The coordinates and the witnesses of the geometry `heightfield`, on which its search (runtime/geometry/heightfield)
 * and its evaluation (compiler/front/gen/heightfield.c) agree.
 *
 * Grid space: vertex (i, j), 0 <= i < w, 0 <= j < h, lies at x = i, y = j, with j upwards. Its height is
 * values[(h - 1 - j) * w + i]: row 0 of the data is the largest y. Heights are raw: the program's [Extent] and [Height]
 * are applied to the ray, not to the data. Cell (i, j) spans [i, i+1] x [j, j+1] and is two triangles, split along
 * (i+1, j)-(i, j+1). The terrain is the solid below the surface inside the box [0, w-1] x [0, h-1]; outside the box
 * there is none.
 *
 * Faces: triangle 2 * (j * w + i) of cell (i, j) holds vertex (i, j), the next number is the one that holds (i+1, j+1);
 * and the walls of the box, where a ray enters the terrain from the side. Edges: 4 * (j * w + i) + kind, with kind 0:
 * (i, j)-(i+1, j), 1: (i, j)-(i, j+1), 2: the diagonal (i+1, j)-(i, j+1). */
#ifndef SALTUS_HEIGHTFIELD_H
#define SALTUS_HEIGHTFIELD_H

#include "saltus/query.h"

/* The wall x = 0; the walls x = w-1, y = 0 and y = h-1 are this less 1, 2 and 3. */
enum { SLT_HEIGHTFIELD_WALL = SLT_WITNESS_OWN };

#endif
