/* Triangle meshes as geometries (saltus/query.h): what kernels and runtime agree on.
 *
 * Numbers: 3 a vertex, x y z. Topology: integers that never change, in the int vector of the parameters:
 *   faces [nfaces][3]    vertices of each triangle, counter-clockwise seen from outside
 *   parts [nfaces]       which `o` or `g` of the file
 *   uv    [nfaces][3][2][2]  if the mesh has any: u, v of each corner as the bits of two floats whose sum it is
 *
 * FACE witnesses are triangles, from 0. A ray is in the coordinates of the vertices. What counts as hit: both sides,
 * the borders of triangles included; of equal t the lowest triangle. A triangle seen edge-on is not hit. */
#ifndef SALTUS_MESH_H
#define SALTUS_MESH_H

#include <stdint.h>

enum { SLT_MESH_FACE = 3, SLT_MESH_PART = 1, SLT_MESH_UV = 12 }; /* integers a triangle */

/* How many integers the topology of nfaces triangles is. */
#define SLT_MESH_TOPOLOGY(nfaces, has_uv) \
    ((uint64_t)(nfaces) * (SLT_MESH_FACE + SLT_MESH_PART + ((has_uv) ? SLT_MESH_UV : 0)))

#endif
