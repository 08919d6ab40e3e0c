/* A walk over the samples of rectangles of pixels, all or those of one coset, a batch at a time: positions, pixels,
 * random streams. The rectangles must outlive it. */
#ifndef SALTUS_SAMPLE_WALK_H
#define SALTUS_SAMPLE_WALK_H

#include "runtime/sample/fill.h"
#include "runtime/sample/interior.h"

typedef struct TileRect {
    uint32_t lo[3], n[3];
    uint64_t pixels;
} TileRect;

/* Where the walk is, and of the last batch its runs: samples of one pixel. */
typedef struct Walk {
    const Interior *p;
    const TileRect *t, *end;
    uint32_t cls;                      /* coset, when p->classes > 1 */
    uint32_t pixel;                    /* in the order of the walk: rectangle by rectangle, row by row upwards */
    uint32_t sample;                   /* of the pixel */
    uint32_t at[3];                    /* place of the pixel in the grid */
    bool single;                       /* each run of the last batch is one sample */
    uint32_t runs, first_pixel;        /* first_pixel: of the first run */
    uint32_t count[BATCH + FILL_OVER]; /* by run: samples, */
    uint64_t owner[BATCH + FILL_OVER]; /* and where in an image its pixel is */
} Walk;
/* Of n rectangles. */
void walk_begin(Walk *k, const Interior *p, const TileRect *t, uint32_t n, uint32_t cls);
/* Fills up to BATCH lanes with the next samples; 0 at the end. Without an adjoint no pixel is left out. */
uint32_t walk_fill(Walk *k, Batch *b);

/* Samples from .. from + n - 1 of an integral. */
void walk_integral(Batch *b, const Pattern *p, uint64_t from, uint32_t n);
#endif
