/* The heightfield benchmark: terrains, rays, and Embree beside our queries (field_bench.c is the driver, field.sh the
 * way to run it).
 *
 * A terrain is n x n heights in units of a cell, row 0 the largest y, as include/saltus/heightfield.h has it. Rays are
 * rows of 8 numbers for blocks of `width` rays, the layout of an SltQueryFn; every method gets the same rays, made
 * before any clock runs. */
#ifndef SALTUS_FIELD_BENCH_H
#define SALTUS_FIELD_BENCH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "saltus/heightfield.h"

typedef struct Terrain {
    char name[32];
    uint32_t n;
    float *h, lowest, highest;
} Terrain;

typedef struct Ray {
    float o[3], d[3], t0, t1;
} Ray;
typedef struct Rays {
    const char *name;
    Ray *ray;
    uint32_t count; /* a multiple of 64 */
    uint32_t cut;   /* rays of the camera that would have entered the box below its rim: they end before it */
    double hits;    /* share that hit */
} Rays;

double bench_now(void); /* processor time of the thread */
uint32_t bench_random(uint64_t *state);
static inline double bench_unit(uint64_t *state) { return (bench_random(state) + 0.5) * 0x1p-32; }

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
void rays_free(Rays *r);
/* Blocks of [8][width] for the queries; the caller frees. */
float *rays_blocks(const Rays *r, uint32_t width);

/* field_embree.c (without Embree: embree_scene_make returns NULL) */
typedef struct EmbreeScene EmbreeScene;
typedef enum EmbreeCall {
    EMBREE_INT1,
    EMBREE_INT8,
    EMBREE_INT16,
    EMBREE_OCC1,
    EMBREE_OCC8,
    EMBREE_OCC16,
    EMBREE_CALLS
} EmbreeCall;
extern const char *const embree_call_names[EMBREE_CALLS];
EmbreeScene *embree_scene_make(const Terrain *t, bool grid, double *seconds, size_t *bytes);
void embree_scene_free(EmbreeScene *s);
const char *embree_config(void);
/* Prepares packets once, then embree_run is what is timed. */
void embree_prepare(EmbreeScene *s, const Rays *r);
void embree_run(EmbreeScene *s, EmbreeCall call, bool coherent);
/* After embree_run: the distance of ray k, infinite for a miss (for an occlusion: 0 or infinite). */
float embree_result(const EmbreeScene *s, EmbreeCall call, uint32_t k);

#endif
