/* Adjoints of the parameters, as one thread gathers them: those of a tile in the kernels' layout, summed in double when
 * the tile is done, and added to the call's in `merge`. A worker owns its Accum. */
#ifndef SALTUS_SAMPLE_ACCUM_H
#define SALTUS_SAMPLE_ACCUM_H

#include "runtime/sample/batch.h"

enum {
    ACCUMS = 9 * SLT_MAX_CHANNELS, /* most buffers: for each channel three sums and the sketches of lines */
    ACCUM_BLOCK = 16,              /* parameters that are looked at together */
    COSETS = 4                     /* interleaved parts of an image, whose spread bounds the error of the whole */
};

typedef struct AdjointBuffer {
    unsigned char *adj; /* of this tile: flt[nfloats][adj_lanes]. Those of one
                           buffer lie behind those of the one before, as the rows of a kernel do */
    double *sum;        /* [nfloats]: adj summed over lanes, of the blocks in touched alone */
    uint32_t *touched;  /* [ntouched]: first parameter of each block whose sum is not 0 */
    uint32_t ntouched;
    bool dirty;                /* a kernel has added to adj */
    uint32_t *log_index;       /* of this tile: see SltKernelArgs.log_index. Of later rows, too, of calls for several */
    unsigned char *log_value;  /* flt */
    uint64_t log_len, log_cap; /* entries */
} AdjointBuffer;
/* accum_fold.c: the sums of a tile, of the parameters alone that it touches. */
typedef struct Folded {
    uint32_t n, cap, *parameter; /* [n] */
    uint32_t *slot;              /* by parameter: 1 and which of them; 0: none. NULL: nothing is folded */
    double *sum;                 /* [n][buffers] */
} Folded;
typedef struct Poles Poles;
typedef struct Accum {
    const SltScene *s;
    uint32_t n; /* buffers */
    Folded folded;
    uint64_t stride, bytes; /* of adj: bytes a parameter, bytes in all */
    AdjointBuffer buf[ACCUMS];
    unsigned char *adj, *sums; /* of all buffers */
    /* [nstretches][2]: parameters from .. to - 1, whole blocks of 16, that kernels may add to */
    uint32_t (*stretch)[2], nstretches;
    const Fill *fill;
    unsigned char *scratch; /* instead of adj where a call is repeated for its log: what it adds must not count twice */
    Poles *poles;           /* accum_poles.c */
    bool infinite;          /* something of this tile is, on an area */
    bool failed;            /* memory ran out */
} Accum;
bool accum_init(Accum *a, const SltScene *s, uint32_t n);
void accum_free(Accum *a);
/* Runs a reverse kernel that adds into buffer `which`, or with rows each row into the next one: of SITE_VJP for the
 * seeds of its channels, of VJP the derivatives of each channel times weight[n]. b->again: of the first call of VJP. */
void accum_call(Accum *a, Batch *b, SltKernelKind kind, uint32_t n, uint32_t which);
void accum_site_rows(Accum *a, Batch *b, uint32_t n, uint32_t which);
void accum_rows(Accum *a, Batch *b, const double *weight, uint32_t n, uint32_t which);
/* accum_close ends a tile, in `work`: lanes are summed into doubles. accum_merge, in `merge`, adds them and the log to
 * targets[which][nfloats], and empties the buffers. */
void accum_close(Accum *a);
void accum_merge(Accum *a, double *const *targets);

/* ---- accum_poles.c: watch, before a call of VJP for as many rows; behind it, what it made infinite is taken out again
 * and added without the few samples that hit a pole. False: there are too many parameters to look. */
bool accum_watch(Accum *a, Batch *b, uint32_t which, uint32_t rows);
void accum_leave_out(Accum *a, uint32_t n);

/* ---- accum_fold.c: instead of accum_merge. Where parameters are many a tile logs each of those that it touches often:
 * from now on a log that gets long, and at accum_close all there is, goes into a->folded. False when memory runs out.
 */
bool accum_folds(Accum *a);
bool accum_fold_log(Accum *a, uint32_t which);
bool accum_fold(Accum *a, uint32_t which, uint32_t first, const double *sums, uint32_t n);
void accum_unfold(Accum *a); /* what was folded has been taken over */

#endif
