/* The samples of f and of its derivatives, where it is smooth. */
#ifndef SALTUS_SAMPLE_INTERIOR_H
#define SALTUS_SAMPLE_INTERIOR_H

#include "runtime/sample/run.h"

typedef struct Interior {
    Run *run;
    uint32_t half;  /* 0: all samples; 1, 2 */
    uint32_t count; /* samples of a pixel */
    uint32_t tile[3], tiles[3];
    uint64_t ntiles;
    /* value: one of */
    float *image;
    /* reverse */
    const float *adjoint;
    double factor; /* of every seed */
    uint32_t classes;
    double *const *targets;
    /* forward */
    const Directions *dirs;
    float *const *out;
} Interior;
SltStatus interior_image(Run *r, uint32_t half, float *image);
SltStatus interior_reverse(Run *r, uint32_t half, const float *adjoint, double factor, uint32_t classes,
                           double *const *targets);
SltStatus interior_forward(Run *r, const Directions *d, float *const *out);
/* Integral over the domain of every channel, replicate r of n: value[channels]; gradient [channels][nfloats] when not
 * NULL. */
SltStatus interior_integral(Run *r, uint32_t replicate, uint64_t samples, double *value, double *gradient);

#endif
