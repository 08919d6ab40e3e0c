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

/* Iterations of a [Cull] loop that may do something in this tile, ascending. */
typedef struct SltCullList {
    const int32_t *items;
    int32_t count; /* < 0: no list, run all */
} SltCullList;

typedef struct SltKernelArgs {
    const void *in[SLT_IN_VARYING]; /* by SltInput: flt or int32_t; NULL where not read */
    void *out[SLT_OUT_MAX];         /* by SltLayout.out: flt, or int32_t for integers and booleans */
    const void *params;             /* flt[nfloats] */
    const int32_t *iparams;         /* int32_t[nints] */
    const void *dparams;            /* flt[nfloats], forward mode */
    /* Reverse mode. Layout by the kernel's AdjLayout: LANES: flt[nfloats][adj_width], summed over lanes by the caller
     * once a tile; FLAT: flt[nfloats]. Parameters read at varying indices append pairs of index and value to the log
     * instead, which the caller adds up in this order. */
    void *adj;
    uint32_t *log_index;       /* both with room for log_cap + SLT_PAD: kernels write whole vectors */
    void *log_value;           /* flt */
    uint64_t log_len, log_cap; /* at log_cap the kernel stops writing and goes on counting: grow and run again */
    unsigned char *tape;       /* scratch of the reverse kernels, 64-byte aligned */
    uint64_t tape_bytes;
    int32_t resolution[2];
    int32_t site;
    const SltCullList *cull;         /* by cull_id, or NULL */
    uint64_t counters[SLT_COUNTERS]; /* by SltCounter */
    /* print(): values already as doubles; may be NULL (then nothing is printed) */
    void (*print)(void *user, const char *text, uint32_t len, const double *values, uint32_t n, uint32_t lane);
    void *user;
    const struct SltGeometry *const *geometries; /* that kernels search (saltus/query.h); NULL: none */
    uint32_t n_valid; /* lanes beyond do not count in counters, prints and log (n without padding) */
} SltKernelArgs;

typedef void SltKernel(SltKernelArgs *args, uint32_t n);

/* What one kernel reads and writes. */
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
