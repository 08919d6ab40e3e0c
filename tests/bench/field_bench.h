/* The heightfield benchmark: terrains, rays, and Embree beside our queries (field_bench.c is the driver, field.sh the
 * way to run it).
 *
 * A terrain is n x n heights in units of a cell, row 0 the largest y, as include/saltus/heightfield.h has it. Rays are
 * rows of 8 numbers for blocks of `width` rays, the layout of an SltQueryFn; every method gets the same rays, made
 * before any clock runs. */
#ifndef SALTUS_FIELD_BENCH_H
#define SALTUS_FIELD_BENCH_H

#include "rays.h"
#include "saltus/heightfield.h"

typedef struct Terrain {
    char name[32];
    uint32_t n;
    float *h, lowest, highest;
} Terrain;

/* field_terrain.c: "dem" (the elevations of SALTUS_DATA), "fbm"; false when the data are not there */
bool terrain_make(Terrain *t, const char *name, uint32_t n);
void terrain_free(Terrain *t);
static inline float terrain_at(const Terrain *t, uint32_t i, uint32_t j) {
    return t->h[(size_t)(t->n - 1 - j) * t->n + i];
}
/* The height and the facet's normal (unit length) at a point of the box. */
double terrain_height(const Terrain *t, double x, double y, double normal[3]);
/* The distance of the witness of a TRACE query; infinite for NONE. */
double terrain_distance(const Terrain *t, const Ray *r, int32_t id);

/* field_rays.c: the camera's rays, and from the points they hit (`where`: distances, infinite for a miss) the rays to a
 * low sun and over the hemisphere */
Rays rays_camera(const Terrain *t, uint32_t size);
Rays rays_sun(const Terrain *t, const Rays *from, const double *where, double elevation);
Rays rays_hemisphere(const Terrain *t, const Rays *from, const double *where);
/* Any ray at all, and the awkward ones: along grid lines and diagonals, through vertices, vertical, from below, with
 * the sun on the horizon. */
Rays rays_any(const Terrain *t, uint32_t count, uint64_t seed);

/* The scene of a terrain for Embree: a mesh of its triangles, or its grid primitive. */
EmbreeScene *terrain_embree(const Terrain *t, bool grid, double *seconds, size_t *bytes);

#endif
