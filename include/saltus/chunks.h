/* A straight-line program in chunks, as the runtime must know it to find out which of them run on a box (SltPruned).
 * Made by the compiler (pass/variant_chunks.c), read by runtime/sample/prune.h. */
#ifndef SALTUS_CHUNKS_H
#define SALTUS_CHUNKS_H

#include <stdbool.h>
#include <stdint.h>

typedef struct SltChunkOp {
    uint32_t arg[3]; /* operations that it reads, by number; nops where there is none */
    int32_t
        settled; /* >= 0: it is arg[0] where this place of SltPruned.settled is set, else arg[1]. -1: any operation */
} SltChunkOp;

typedef struct SltChunks {
    uint32_t nops, nchunks, nchoices, nroots;
    const SltChunkOp *op;         /* [nops], each behind what it reads, chunk by chunk */
    const uint32_t *first_op;     /* [nchunks + 1] */
    const uint32_t *first_choice; /* [nchunks + 1]: of SltKernelArgs.choices */
    const uint32_t *root;         /* [nroots]: operations that something outside all chunks reads */
    bool effects;                 /* the program prints or counts: a box whose value is known must be sampled too */
} SltChunks;

#endif
