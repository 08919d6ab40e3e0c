/* Straight-line programs: which chunks of operations run in a box, and which choices are settled there.
 *
 * `bounds` on a box notes what each choice (min, max, select) may be. Backwards from what is used outside the chunks
 * follows which operations matter: of a settled choice one operand only. A chunk runs if one of its operations matters.
 * 64 boxes are walked at once, a bit each; boxes inside a box start from its chunks alone, and the walk is as short as
 * those. (Keeter 2020; he shortens a program for each box, here one compiled program leaves chunks out.)
 *
 * A Pruner belongs to one thread. */
#ifndef SALTUS_SAMPLE_PRUNE_H
#define SALTUS_SAMPLE_PRUNE_H

#include "runtime/sample/batch.h"
#include "saltus/chunks.h"

/* What runs in one box: arrays of a Pruner, good until it picks for the same level again. */
typedef struct PruneSet {
    SltPruned pruned;
    int32_t *chunks, *settled; /* the arrays of `pruned` */
} PruneSet;

enum { PRUNE_LEVELS = 3 };
typedef struct Pruner {
    const SltChunks *c;
    uint64_t *choices;          /* [2 * nchoices]: noted by `bounds` */
    uint64_t *live;             /* [nops + 1]: by operation, a bit a box */
    uint64_t *runs;             /* [nchunks]: by chunk, likewise */
    PruneSet set[PRUNE_LEVELS]; /* [0]: every chunk, nothing settled */
} Pruner;
bool prune_init(Pruner *p, const SltScene *s); /* s->chunks is not NULL */
void prune_free(Pruner *p);
/* Calls `bounds` on boxes 0 .. n-1 (n <= SLT_CHOICE_BOXES) of the batch's inputs, boxes inside the one of `parent`, and
 * finds what runs in each. Outputs of `bounds` can be read from the batch afterwards. */
void prune_boxes(Pruner *p, Batch *b, const PruneSet *parent, uint32_t n);
/* The second half of it: from p->choices. */
void prune_walk(Pruner *p, const PruneSet *parent, uint32_t n);
/* What runs in one of the boxes, as the set of `level` (from 1 on), which is not the parent's. */
const PruneSet *prune_pick(Pruner *p, const PruneSet *parent, uint32_t box, uint32_t level);

/* ---- prune_image.c: the pixels of an image by boxes of them, smaller until few operations are left. */
typedef struct PixelRect {
    uint32_t lo[3], n[3]; /* first pixel and pixels by axis, y upwards; 1 along axes that the domain lacks */
} PixelRect;

typedef struct PruneImage {
    uint32_t dim, channels;
    double lo[3], side[3]; /* of pixel 0: its corner, its sides */
    double reach;          /* how far outside a pixel its samples may lie, in pixels */
    void *user;
    /* f has this value[channels] in all samples of the pixels. */
    void (*constant)(void *user, const PixelRect *r, const double *value);
    /* Calls `value` on the samples of the pixels, with these arguments. */
    void (*sample)(void *user, const PixelRect *r, const SltPruned *pruned);
} PruneImage;
/* Can kernels of this scene be pruned? */
bool prune_can(const SltScene *s);
/* Pixels along a side of the rectangles that prune_image is best given. */
uint32_t prune_tile(uint32_t dim);
void prune_image(Pruner *p, Batch *b, const PruneImage *image, const PixelRect *r);

#endif
