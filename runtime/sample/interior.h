/* The interior term: samples of f and of its derivatives. */
#ifndef SALTUS_SAMPLE_INTERIOR_H
#define SALTUS_SAMPLE_INTERIOR_H

#include "runtime/sample/parts.h"
#include "runtime/sample/run.h"
#include "runtime/sample/tails.h"

/* A loss that is a sum over pixels: what its derivative weighs a pixel with hangs on that pixel alone. */
typedef struct PixelLoss {
    const float *target, *mask; /* mask: NULL: 1 everywhere */
    float *image, *adjoint;     /* filled, tile by tile */
} PixelLoss;

typedef struct Interior {
    Run *run;
    uint32_t half;              /* 0: all samples; 1 or 2: one half of them */
    uint32_t count;             /* samples of a pixel */
    uint32_t tile[3], tiles[3]; /* pixels of a tile, and tiles, by axis */
    uint64_t ntiles;
    /* interior_image, interior_halves */
    float *image, *other; /* other: NULL, or the image of the second half */
    /* interior_reverse */
    const float *adjoint;   /* an image */
    const float *halves[2]; /* those of the halves, where they have their own; else NULL */
    const PixelLoss *loss;  /* NULL: the adjoint is known */
    uint32_t classes;       /* 1, or COSETS */
    double *const *targets; /* sums [nfloats], by class; of pairs by half in each class */
    Parts *parts;           /* how they spread by tile; may be NULL */
    PartsOf parts_of;
    /* interior_forward */
    const Directions *dirs;
    float *const *out; /* images, by direction */
} Interior;
/* half 0: all samples of a pixel; 1 or 2: one of the two halves. */
SltStatus interior_image(Run *r, uint32_t half, float *image);
/* Both halves, tile by tile: what is known of a tile serves both. */
SltStatus interior_halves(Run *r, float *const image[2]);
/* Of both halves of the samples, each with its adjoint, where there are two; else of all. With parts by pairs each
 * half has targets of its own, and classes are sets of pixels. loss: NULL, or what makes the adjoint, which is its
 * own, on the way. */
SltStatus interior_reverse(Run *r, const float *const adjoint[2], uint32_t classes, double *const *targets,
                           Parts *parts, PartsOf of, const PixelLoss *loss);
SltStatus interior_forward(Run *r, const Directions *d, float *const *out);
/* The integral over the domain by replicates of so many samples each: value[replicates][channels];
 * gradient[replicates][channels][nfloats] when not NULL, whose samples join `tails` when that is not NULL. */
SltStatus interior_integral(Run *r, uint32_t replicates, uint64_t samples, double *value, double *gradient,
                            Tails *tails);
bool interior_is_small(const Run *r, uint32_t replicates, uint64_t samples); /* no work for several threads */

#endif
