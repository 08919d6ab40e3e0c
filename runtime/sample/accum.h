/* Adjoints of the parameters, as one thread gathers them: those of a tile in the kernels' layout, summed in double when
 * the tile is done, and added to the call's in `merge`. A worker owns its Accum. */
#ifndef SALTUS_SAMPLE_ACCUM_H
#define SALTUS_SAMPLE_ACCUM_H

#include "runtime/sample/batch.h"

enum {
    ACCUMS = 9 * SLT_MAX_CHANNELS, /* most buffers: for each channel three sums and the sketches of lines */
    ACCUM_BLOCK = 16,              /* parameters that are looked at together */
    ACCUM_WATCHED = 1 << 17,       /* most bytes of a buffer that is looked at before and after each call */
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
/* What lay in adj before a call. */
typedef struct Before {
    unsigned char *adj, *bytes; /* bytes: NULL until there are any */
    uint64_t n, room;
    bool zero; /* nothing did */
} Before;
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
    Before before;          /* accum_watch.c */
    bool infinite;          /* something of this tile is, on an area */
    SltKernelKind vjp;      /* which kernel calls of VJP run: that one, VJP_GUARDED, or SLT_KERNELS: call by call */
    bool suspect;           /* a sum of this tile is not finite */
    uint64_t evaluations, counters[SLT_COUNTERS]; /* of the batch, as the tile began */
    bool failed;                                  /* memory ran out */
} Accum;
bool accum_init(Accum *a, const SltScene *s, uint32_t n);
void accum_free(Accum *a);
/* Runs a reverse kernel that adds into buffer `which`, or with rows each row into the next one: of SITE_VJP for the
 * seeds of its channels, of VJP the derivatives of each channel times weight[n]. b->again: of the first call of VJP. */
void accum_call(Accum *a, Batch *b, SltKernelKind kind, uint32_t n, uint32_t which);
/* Around the work of a tile that may be done again: between begin and accum_close the kernel without guards runs, and
 * where a sum is not finite then, accum_again forgets the tile and is true: it wants to be done once more. */
void accum_begin(Accum *a, const Batch *b);
bool accum_again(Accum *a, Batch *b);
void accum_site_rows(Accum *a, Batch *b, uint32_t n, uint32_t which);
void accum_rows(Accum *a, Batch *b, const double *weight, uint32_t n, uint32_t which);
/* accum_close ends a tile, in `work`: lanes are summed into doubles. accum_merge, in `merge`, adds them and the log to
 * targets[which][nfloats], and empties the buffers. */
void accum_close(Accum *a);
void accum_merge(Accum *a, double *const *targets);

/* ---- accum_watch.c: keeps what is in as many buffers before a call; false: they are too large. Then, whether all that
 * is there is finite, and the same of n numbers; and what was there before, again. */
bool accum_watch(Accum *a, uint32_t which, uint32_t rows);
bool accum_is_finite(const Accum *a);
bool accum_are_finite(const Accum *a, const void *values, uint64_t n);
void accum_put_back(Accum *a);

/* ---- accum_poles.c: where a call of `kind` for n samples, which was watched, made something infinite: that is taken
 * out again, and added without the few samples that hit a pole. May it be? */
bool accum_may_leave_out(const Accum *a);
void accum_leave_out(Accum *a, Batch *b, SltKernelKind kind, uint32_t n);

/* ---- accum_fold.c: instead of accum_merge. Where parameters are many a tile logs each of those that it touches often:
 * from now on a log that gets long, and at accum_close all there is, goes into a->folded. False when memory runs out.
 */
bool accum_folds(Accum *a);
bool accum_fold_log(Accum *a, uint32_t which);
bool accum_fold(Accum *a, uint32_t which, uint32_t first, const double *sums, uint32_t n);
void accum_unfold(Accum *a); /* what was folded has been taken over */

#endif
