/* What points of a tile add to the pixels around them. A rectangle of pixels holds all that the tile's points reach;
 * its owner adds it to the images in tile order. The grid outlives it. */
#ifndef SALTUS_SAMPLE_SPLAT_H
#define SALTUS_SAMPLE_SPLAT_H

#include "runtime/sample/grid.h"

typedef struct Splat {
    const Grid *grid;
    uint32_t planes, channels;
    uint32_t lo[3], n[3];               /* the rectangle: first pixel and number of pixels by axis */
    double *value;                      /* [plane][pixel of the rectangle][channel] */
    float *count;                       /* by pixel of the rectangle */
    double *share;                      /* one of each pixel along an axis */
    uint64_t cap, count_cap, share_cap; /* what there is room for: the largest rectangle so far */
} Splat;
/* The rectangle of pixels that points in [lo, hi] of the domain reach, all 0. False when memory runs out. */
bool splat_begin(Splat *p, const Grid *g, uint32_t planes, uint32_t channels, const double lo[3], const double hi[3]);
void splat_free(Splat *p);
/* Adds value[channels] times the filters' weights at x to a plane. */
void splat_add(Splat *p, uint32_t plane, const double x[3], const double *value);
/* Adds value[channels] times the parts of the filters that lie in the box [lo, hi] to plane 0: what f adds that has
 * this value everywhere in the box. */
void splat_add_box(Splat *p, const double lo[3], const double hi[3], const double *value);
/* Adds 1 to the count of the pixel that holds x. */
void splat_count(Splat *p, const double x[3]);
/* Adds the planes to the images out[planes], and the counts to `counts` (may be NULL). */
void splat_merge(const Splat *p, float *const *out, float *counts);

#endif
