/* A tree of boxes over the triangles of a mesh, eight children a node, for rays (rays.inc.h).
 *
 *   values (caller's) + faces (caller's)  ->  leaves of up to 8 triangles  ->  nodes of up to 8 boxes
 *
 * Made by the surface area heuristic (binned, Wald 2007), refitted when vertices move, made again when its cost has
 * grown by a third. Boxes are floats, rounded outwards in f64. Corners of triangles are copied into leaves. */
#ifndef SALTUS_MESH_BVH_H
#define SALTUS_MESH_BVH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    BVH_WIDTH = 8,
    BVH_LEAF = 8,   /* triangles, at most */
    BVH_DEPTH = 40, /* levels of nodes, at most: 7 wait at each while rays go down */
    BVH_STACK = BVH_DEPTH * (BVH_WIDTH - 1) + 1
};

/* child: >= 0 a node, < 0 the leaf ~child; where there is none the box is empty (lo > hi). */
typedef struct BvhNode {
    float lo[3][BVH_WIDTH], hi[3][BVH_WIDTH];
    int32_t child[BVH_WIDTH];
} BvhNode;
#define BVH_UPPER offsetof(BvhNode, hi) /* from a lower side to the upper one */

/* at[corner][axis][triangle]; a place without a triangle has number -1, one whose
 * triangle is not finite that number; the corners of both are NaN. */
typedef struct BvhLeaf32 {
    _Alignas(64) float at[3][3][BVH_LEAF];
    int32_t triangle[BVH_LEAF];
} BvhLeaf32;
typedef struct BvhLeaf64 {
    _Alignas(64) double at[3][3][BVH_LEAF];
    int32_t triangle[BVH_LEAF];
} BvhLeaf64;

typedef struct Bvh {
    bool f64;
    uint32_t nfaces, nnodes, nleaves;
    const int32_t *face; /* [nfaces][3], not owned */
    BvhNode *node;       /* children lie behind their parents */
    void *leaf;          /* BvhLeaf32 or BvhLeaf64 */
    double magnitude;    /* the largest |coordinate| of a vertex that a triangle has */
    uint32_t unmet;      /* triangles that are never met */
    uint64_t version;    /* no other tree, nor this one with its vertices elsewhere, has this number */
    double cost, made;   /* area-weighted tests of a ray: now, and when the tree was made */
} Bvh;

/* A triangle with a corner that is not finite is never met. False when out of memory; then nothing is held. */
bool bvh_make(Bvh *b, const void *values, bool f64, const int32_t *face, uint32_t nfaces);
/* The vertices have moved. False when a new tree was wanted and there is no memory: the old one was refitted. */
bool bvh_follow(Bvh *b, const void *values);
void bvh_free(Bvh *b);
size_t bvh_bytes(const Bvh *b);

#endif
