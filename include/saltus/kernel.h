/* How compiled kernels meet the runtime: the whole contract of the JIT, and of objects made by `saltus build`.
 *
 * A kernel processes n samples. Every array is a structure of arrays, 64-byte aligned, and readable and writable up to
 * n rounded up to SLT_PAD elements: kernels work in full vectors, so the caller fills the tail with copies of a valid
 * sample (and zero seeds). flt is float or double by the program's precision. The kernel never allocates, never fails
 * and keeps no state: one SltKernelArgs per thread makes it thread-safe. */
#ifndef SALTUS_KERNEL_H
#define SALTUS_KERNEL_H

#include <stddef.h>
#include <stdint.h>

#include "saltus/contract.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Iterations of one loop that may do something in this tile. */
typedef struct SltCullList {
    const int32_t *items; /* [count], ascending */
    int32_t count;        /* < 0: no list, every iteration runs */
} SltCullList;

/* What one iteration of a loop does in the boxes of one call of `bounds`, which are SLT_PAD at most then: bit b is box
 * b. An iteration that may do nothing in a box can be left out there, and so can all before one that overwrites. */
typedef struct SltNote {
    uint64_t may, must; /* it may change something; it surely overwrites all that the loop carries */
} SltNote;

/* What a straight-line program does in this call, the same for all its samples: which of its chunks of operations run,
 * which of its choices (min, max, select) are known to be one operand, and where chunks find the values of others: a
 * choice that is one operand is not computed, who wants it reads the operand. What is not run is never looked at. */
typedef struct SltPruned {
    const int32_t *chunks;  /* by number, ascending; ends with SLT_NO_CHUNK */
    const int32_t *settled; /* [2 * choices] by 2 * choice + operand: -1, it is this operand, or 0 */
    const int32_t *from;    /* [imports]: which exported value */
} SltPruned;

typedef struct SltKernelArgs {
    const void *in[SLT_IN_VARYING]; /* by SltInput: flt or int32_t, one a sample; NULL where not read */
    void *out[SLT_OUT_MAX];         /* by SltLayout.out, one a sample: flt, or int32_t for integers and booleans */
    const void *params;             /* flt[nfloats] */
    const int32_t *iparams;         /* int32_t[nints] */
    const void *dparams;            /* forward mode: flt[nfloats], the direction in parameter space */
    /* Reverse mode: adjoints of the parameters, to which kernels add. flt[nfloats][lanes], for the caller to sum over
     * lanes once a tile; or flt[nfloats], as the kernel was compiled. For a parameter that is read at an index that
     * differs between lanes, kernels append index and value to the log instead; the caller adds up the log in order.
     * Of several rows the adjoints of each lie behind those of the one before, and indices count on from row to row. */
    void *adj;
    uint32_t *log_index; /* log_index and log_value have room for log_cap + SLT_PAD: kernels write whole vectors */
    void *log_value;     /* flt */
    uint64_t log_len, log_cap; /* beyond log_cap entries are counted, not written: grow the log and run again */
    unsigned char *tape;       /* scratch of the reverse kernels, 64-byte aligned */
    uint64_t tape_bytes;       /* of tape, for all lanes */
    int32_t resolution[2];     /* columns, rows of the image */
    int32_t site;              /* site kernels: which site */
    int32_t rows;              /* reverse kernels that read it: how many rows of adjoints, a channel's each; 0: 1 */
    const SltPruned *pruned;   /* kernels of a straight-line program in chunks: what runs; else NULL */
    /* prune and such bounds, of up to SLT_CHOICE_BOXES boxes: [2 * choices] by 2 * choice + operand, bit i: on box i it
     * may be this operand. Of chunks that did not run it says nothing. */
    uint64_t *choices;
    const SltCullList *cull; /* by number of the list, as many as the program has; NULL: all iterations of all loops */
    SltNote *const *note;    /* bounds: what it notes, by number of the list, then by place in the list (without one: by
                                iteration); all 0 before. NULL: nothing is noted */
    uint64_t counters[SLT_COUNTERS]; /* by SltCounter: kernels add */
    /* print() in a lane: the text with {} for each of the n values. NULL: nothing is printed. */
    void (*print)(void *user, const char *text, uint32_t len, const double *values, uint32_t n, uint32_t lane);
    void *user;                                  /* of print */
    const struct SltGeometry *const *geometries; /* by number, for queries (saltus/query.h); NULL: none is asked */
    uint32_t n_valid; /* n without padding: samples beyond do not count in counters, prints and log */
} SltKernelArgs;

typedef void SltKernel(SltKernelArgs *args, uint32_t n);

/* Which inputs one kernel reads, and where its outputs are. */
typedef struct SltLayout {
    uint64_t reads; /* bit (1 << SltInput) */
    struct {
        uint16_t first, count; /* SltKernelArgs.out[first .. first + count - 1]; count 0: it has no such output */
    } out[SLT_ROLES];
} SltLayout;

#ifdef __cplusplus
}
#endif
#endif
