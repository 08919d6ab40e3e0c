/* Adjoints of one thread: those of a tile in the kernels' layout, summed in double when the tile is done, and handed
 * over in `merge`. */
#ifndef SALTUS_SAMPLE_ACCUM_H
#define SALTUS_SAMPLE_ACCUM_H

#include "runtime/sample/batch.h"

enum {
    ACCUMS = 2 * SLT_MAX_CHANNELS, /* most buffers: each channel, and what its lines would have missed */
    COSETS = 4                     /* interleaved parts of an image, whose spread bounds the error of the whole */
};

typedef struct AdjointBuffer {
    unsigned char *adj; /* flt[nfloats][width] or flt[nfloats] */
    double *sum;        /* [nfloats]: of the tile */
    uint32_t *touched;  /* blocks of ACCUM_BLOCK parameters with a sum */
    uint32_t ntouched;
    bool dirty;
    uint32_t *log_index;
    unsigned char *log_value; /* flt */
    uint64_t log_len, log_cap;
} AdjointBuffer;
typedef struct Accum {
    const SltScene *s;
    uint32_t n;
    uint64_t stride, bytes; /* bytes a parameter, bytes of adj */
    AdjointBuffer buf[ACCUMS];
    uint32_t *blocks, nblocks; /* first parameter of each block that kernels may add to */
    unsigned char *scratch;    /* where a repeated call adds what must not count twice */
    bool failed;
} Accum;
bool accum_init(Accum *a, const SltScene *s, uint32_t n);
void accum_free(Accum *a);
/* Runs a reverse kernel that adds into buffer `which`. */
void accum_call(Accum *a, Batch *b, SltKernelKind kind, uint32_t n, uint32_t which);
/* End of a tile: lanes into doubles (in `work`); then in `merge` into targets[which][nfloats], which also empties the
 * buffers. */
void accum_close(Accum *a);
void accum_merge(Accum *a, double *const *targets);

#endif
