/* A straight-line program in chunks, as the runtime must know it to find out which of them run on a box (SltPruned).
 * Made by the compiler (pass/variant_chunks.c), read by runtime/sample/prune.h.
 *
 * A value is an operation of the chunk, or an import: a value of another chunk, which that one exports. The last
 * imports are no chunk's: they are what is used outside all chunks. */
#ifndef SALTUS_CHUNKS_H
#define SALTUS_CHUNKS_H

#include <stdbool.h>
#include <stdint.h>

typedef struct SltChunkOp {
    /* What it reads, of its own chunk: an operation, by number; nops: none of a chunk; nops + 1 + i: import i. */
    uint32_t arg[3];
    int32_t
        choice; /* >= 0: it is arg[0] or arg[1], and arg[2] is read where that is not settled. -1: it is no choice */
} SltChunkOp;

typedef struct SltChunks {
    uint32_t nops, nchunks, nchoices, nimports, nexports;
    const SltChunkOp *op;         /* [nops], each behind what it reads, chunk by chunk */
    const uint32_t *first_op;     /* [nchunks + 1] */
    const uint32_t *first_choice; /* [nchunks + 1] */
    const uint32_t *first_import; /* [nchunks + 1]; those behind the last chunk's are used outside */
    const uint32_t *import;       /* [nimports]: which operation */
    const int32_t *exported;      /* [nops]: its number among exported values (SltPruned.from), or -1 */
    /* [nchoices]: the operand that it is where the difference of what it compares is below 0; -1: it is decided by more
     * than one comparison. The edge kernels give that difference, of one choice, as exported value `nexports`, and take
     * it as import `nimports`. */
    const int8_t *below;
    bool effects; /* the program prints or counts: a box whose value is known must be sampled too */
} SltChunks;

#endif
