/* Counter-based random numbers (Philox 4x32-10 of Random123): a number is a function of what it is for, never of the
 * order of calls, so any thread may ask for any number. No two purposes share a stream. */
#ifndef SALTUS_RUNTIME_BASE_RNG_H
#define SALTUS_RUNTIME_BASE_RNG_H

#include <stdint.h>

typedef enum RngPurpose {
    RNG_PIXEL,    /* shifts of the samples of a pixel */
    RNG_STREAM,   /* stream of a sample */
    RNG_INTEGRAL, /* shift of a replicate's samples */
    RNG_LATTICE,  /* shift of a lattice */
    RNG_LINE,     /* phase and stream of a scanline */
    RNG_BOX,      /* shift of the scanlines of a box */
    RNG_SEGMENT,  /* position and direction of a random segment */
    RNG_COINCIDE, /* where the parameters are moved to tell coinciding boundaries apart */
    RNG_POINT,    /* stream of a given point, and number 0 of that stream */
    RNG_VIEW,     /* choice of a view in a step of a fit */
    RNG_CHANCE    /* points at which the parameters are moved, and their streams */
} RngPurpose;

/* Four words for draw `counter` of `purpose`; `lane` tells independent repetitions (halves, replicates, axes) apart. */
void rng_block(uint32_t seed, RngPurpose purpose, uint32_t lane, uint64_t counter, uint32_t out[4]);
/* The middle of the word's interval: inside (0, 1), never an end. */
static inline double rng_unit(uint32_t word) { return ((double)word + 0.5) * 0x1p-32; }
/* Coordinate `dim` of point `index` of an additive recurrence in `dims` (1 to 4) dimensions (the generalised golden
 * ratio of Roberts), shifted by shift / 2^32: in [0, 1). */
extern const uint64_t rng_ratio[4][4];
static inline double rng_recurrence(uint32_t dims, uint32_t dim, uint64_t index, uint32_t shift) {
    uint64_t v = ((uint64_t)shift << 32 | 0x80000000u) + index * rng_ratio[dims - 1][dim];
    return (double)(v >> 11) * 0x1p-53;
}

#endif
