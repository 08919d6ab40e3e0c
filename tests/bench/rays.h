/* Rays of benchmarks, and Embree 3 as their anchor (where libembree-dev is installed). Every method gets the same rays,
 * made before any clock runs. */
#ifndef SALTUS_BENCH_RAYS_H
#define SALTUS_BENCH_RAYS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct Ray {
    float o[3], d[3], t0, t1;
} Ray;
typedef struct Rays {
    const char *name;
    Ray *ray;
    uint32_t count; /* a multiple of 64 */
    uint32_t cut;   /* rays of a camera over a terrain that would have entered the box below its rim: they end there */
    double hits;    /* share that hit */
} Rays;

double bench_now(void); /* processor time of the thread */
uint32_t bench_random(uint64_t *state);
static inline double bench_unit(uint64_t *state) { return (bench_random(state) + 0.5) * 0x1p-32; }
/* The pixel of ray k of a square camera: they come in squares of 4 x 4, four of which make 8 x 8. */
void rays_pixel(uint32_t k, uint32_t size, uint32_t *x, uint32_t *y);
void rays_free(Rays *r);
/* Rows of 8 numbers for blocks of `width` rays, the layout of an SltQueryFn; the caller frees. */
float *rays_blocks(const Rays *r, uint32_t width);

/* embree.c; without Embree: embree_scene_make returns NULL */
typedef struct EmbreeScene EmbreeScene;
typedef struct EmbreeSource {
    const float *vertex;  /* [nvertices][3] */
    const uint32_t *face; /* [nfaces][3]; NULL: the vertices are a grid of `side` columns and rows */
    uint32_t nvertices, nfaces, side;
    bool robust;
} EmbreeSource;
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
/* seconds, bytes: of its own structures, without vertices and indices. */
EmbreeScene *embree_scene_make(const EmbreeSource *from, double *seconds, size_t *bytes);
void embree_scene_free(EmbreeScene *s);
const char *embree_config(void);
/* Prepares packets once, then embree_run is what is timed. */
void embree_prepare(EmbreeScene *s, const Rays *r);
void embree_run(EmbreeScene *s, EmbreeCall call, bool coherent);
/* After embree_run: the distance of ray k, infinite for a miss (for an occlusion: 0 or infinite). */
float embree_result(const EmbreeScene *s, EmbreeCall call, uint32_t k);

#endif
