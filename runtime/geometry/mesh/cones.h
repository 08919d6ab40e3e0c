/* Cones of the normals under the children of each node of a tree: do all faces below a child turn the same side to a
 * point? Then none of their edges ends a shadow for it, and who looks for such edges goes past. */
#ifndef SALTUS_MESH_CONES_H
#define SALTUS_MESH_CONES_H

#include "adjacency.h"
#include "bvh.h"

/* Of the faces below a child and those across their edges: normals are within a cone around `axis`, planes pass the
 * place `middle` within `off`. off: infinite where some of their edges are the ends of a sheet, of many faces, or of
 * faces that run different ways; also where normals are all over, or a face has none. */
typedef struct ConeNode {
    float axis[3][BVH_WIDTH], middle[3][BVH_WIDTH], cosine[BVH_WIDTH], sine[BVH_WIDTH], off[BVH_WIDTH];
} ConeNode;

typedef struct Cones {
    ConeNode *node; /* as those of the tree; NULL: none */
    uint32_t n;
    bool one_way; /* wherever two faces share an edge, and no third does, it runs in opposite ways in them */
} Cones;

/* From where vertices are now. Without memory there are none. */
void cones_follow(Cones *c, const Bvh *b, const Adjacency *a, const void *values);
void cones_free(Cones *c);

#endif
