/* Straight-line programs: which chunks of operations run in a box, and which choices are settled there.
 *
 * `prune` on a box notes what each choice (min, max, select) may be. Backwards from what is used outside the chunks
 * follows which operations matter: of a settled choice one operand only, and not the choice itself, for whoever wants
 * it reads the operand. A chunk runs if one of its operations matters. 64 boxes are walked at once, a bit each; boxes
 * inside a box start from its chunks alone, and the walk is as short as those. (Keeter 2020; he shortens a program for
 * each box, here one compiled program leaves chunks out.)
 *
 * A Pruner belongs to one thread. */
#ifndef SALTUS_SAMPLE_PRUNE_H
#define SALTUS_SAMPLE_PRUNE_H

#include "runtime/sample/batch.h"
#include "saltus/chunks.h"

/* A box that was picked: what runs in it, and what was found of the boxes inside it. */
typedef struct PruneLevel {
    SltPruned pruned;
    int32_t *chunks, *settled, *from; /* the arrays of `pruned` */
    uint32_t *via;                    /* [nimports]: `from`, as an operation */
    uint64_t *choices;         /* [2 * nchoices]: noted by `prune`; of choices that matter, settled by the walk */
    uint64_t *live;            /* [nops + 1 + nimports]: by value (SltChunkOp.arg), a bit a box */
    uint64_t *runs;            /* [nchunks]: by chunk, likewise */
    uint32_t *is;              /* [nchoices][stride]: the operation that a choice that matters is, by box */
    uint32_t stride;           /* boxes of a row, 16 or SLT_CHOICE_BOXES */
    uint32_t *passed, npassed; /* [nchoices]: operations that are choices and matter, while they are walked */
} PruneLevel;

enum { PRUNE_LEVELS = 4 };
typedef struct Pruner {
    const SltChunks *c;
    PruneLevel level[PRUNE_LEVELS]; /* [0]: everything, every chunk runs */
} Pruner;
bool prune_init(Pruner *p, const SltChunks *c);
void prune_free(Pruner *p);
/* Calls `prune` on boxes 0 .. n-1 (n <= SLT_CHOICE_BOXES) of the batch's inputs, boxes inside the one of this level.
 * Its outputs can be read from the batch afterwards. */
void prune_boxes(Pruner *p, Batch *b, uint32_t level, uint32_t n);
/* Finds what runs in each of these boxes, a bit each, from the choices that were noted of them. */
void prune_walk(Pruner *p, uint32_t level, uint64_t boxes);
/* A box that was walked becomes that of the next level. */
void prune_pick(Pruner *p, uint32_t level, uint32_t box);

/* Choices that matter in a box that was walked and are open there, up to `most`, ascending; how many, or most + 1. */
uint32_t prune_open(const Pruner *p, uint32_t level, uint32_t box, int32_t *choice, uint32_t most);
/* What runs in the box of this level, for later: prune_enter makes it that level's box again. The caller frees it; NULL
 * when memory runs out. */
int32_t *prune_keep(const Pruner *p, uint32_t level);
void prune_enter(Pruner *p, uint32_t level, const int32_t *kept);

/* ---- prune_image.c: the pixels of an image by boxes of them, smaller until few operations are left. */
typedef struct PixelRect {
    uint32_t lo[3], n[3]; /* first pixel and pixels by axis, y upwards; 1 along axes that the domain lacks */
} PixelRect;

typedef struct PruneImage {
    uint32_t dim;
    double lo[3], side[3]; /* of pixel 0: its corner, its sides */
    double reach;          /* how far outside a pixel its samples may lie, in pixels */
    void *user;
    /* f has this value[channels] in all samples of the pixels. */
    void (*constant)(void *user, const PixelRect *r, const double *value);
    /* Calls `pruned` on the samples of the pixels of all n rectangles, in 2D together at most BATCH, with these
     * arguments. */
    void (*sample)(void *user, const PixelRect *r, uint32_t n, const SltPruned *pruned);
} PruneImage;
/* Has this scene prune and pruned? */
bool prune_can(const SltScene *s);
/* Pixels along a side of the rectangles that prune_image is best given: of large ones the first boxes cost least, but
 * an image should have some for each thread. */
uint32_t prune_tile(uint32_t dim, const uint32_t n[3]);
void prune_image(Pruner *p, Batch *b, const PruneImage *image, const PixelRect *r);

#endif
