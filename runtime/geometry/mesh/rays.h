/* Rays against the tree, compiled for each instruction set (rays.inc.h): the same bits from all. */
#ifndef SALTUS_MESH_RAYS_H
#define SALTUS_MESH_RAYS_H

#include "bvh.h"

/* What a search goes through. */
typedef struct BvhScene {
    const Bvh *bvh;
    const void *moved; /* vertices where they are now, up to `slack` from those of the tree; NULL: there */
    double slack;
} BvhScene;

/* The first triangle that each ray meets, or of `any` 0 if it meets one; else SLT_WITNESS_NONE. rays: as of SltQueryFn.
 */
typedef void BvhSearch(const BvhScene *s, const void *rays, uint64_t mask, uint32_t width, bool any, int32_t *witness);
typedef struct BvhSearches {
    const char *name;
    BvhSearch *by[2]; /* [f64] */
} BvhSearches;
extern const BvhSearches bvh_plain, bvh_avx2, bvh_avx512;

#endif
