/* What becomes of crossings: weights, then adjoints, a splat into images, or a list. A worker owns one sink, which uses
 * the worker's batch, accumulators and finder, and owns the splat and the crossings that it keeps. */
#ifndef SALTUS_SAMPLE_SINK_H
#define SALTUS_SAMPLE_SINK_H

#include "runtime/sample/accum.h"
#include "runtime/sample/coincide.h"
#include "runtime/sample/follow.h"
#include "runtime/sample/parts.h"
#include "runtime/sample/sketch.h"
#include "runtime/sample/splat.h"

typedef enum SinkKind {
    SINK_INTEGRAL, /* adjoints by channel, again those of crossings that coarser lines miss, what boundaries that
                      coincide add to the error, and sketches of lines, where there are any */
    SINK_PARTS,    /* adjoints by set (bit 0 of the class) and channel; bit 2: a fifth group gets their size, bit 1:
                      twice, as coarser lines miss them */
    SINK_REVERSE,  /* adjoints weighed by an adjoint image */
    SINK_FORWARD,  /* images of derivatives along directions */
    SINK_KEEP,     /* a list */
    SINK_NONE      /* there are no crossings: workers that take samples have no finder, either */
} SinkKind;
/* Directions in parameter space. */
typedef struct Directions {
    uint32_t n;
    void **flt; /* [n]: flt[nfloats] each */
} Directions;
/* From double[nfloats] each. False when memory runs out; directions_free is due all the same. */
bool directions_init(Directions *d, const SltScene *s, uint32_t n, const double *const *dirs);
void directions_free(Directions *d);
struct Sink {
    SinkKind kind;
    Batch *b;
    Accum *acc;
    Finder *f; /* its counts of dropped crossings */
    const Grid *grid;
    double scale[3];        /* s_j of the weights: sides of the domain (integral) or of a pixel */
    const float *adjoint;   /* SINK_REVERSE: an image */
    const float *noise[2];  /* SINK_REVERSE: how far the adjoint is off, and per jump what it is at least; or NULL. What
                               that weighs goes to the last PARTS_NOISE buffers */
    float least;            /* the second where it is the same everywhere, and no image; 0: none */
    uint32_t classes;       /* SINK_REVERSE: adjoint buffers, 1 or COSETS */
    bool sizes;             /* SINK_REVERSE: classes as of SINK_PARTS, sizes included */
    const Directions *dirs; /* SINK_FORWARD */
    Splat splat;            /* SINK_FORWARD: a plane for each direction */
    Crossing *kept;         /* SINK_KEEP: [nkept] */
    uint64_t nkept, kept_cap;
    uint64_t *order; /* [BATCH] */
    Coincide coincide;
    const SltCullList *lists; /* moved: those of the scene */
    bool moved;               /* calls see moved parameters: sink_move */
    Follow *follow;           /* NULL: fingers are not followed */
    uint8_t *met;             /* Run.met, of all workers */
    bool any_sign;            /* each crossing counts with a random sign */
    Sketch sketch;            /* SINK_INTEGRAL */
    Crossing *thin;           /* [nthin]: of this tile, for thin.h; only where `misses` */
    uint64_t nthin, thin_cap;
    Crossing *doubt; /* room for a batch's jumps that may be others: flank.c */
    uint64_t doubt_cap;
    bool misses; /* there are sums of what is missed: SINK_INTEGRAL, and as the last buffer SINK_REVERSE */
    bool clip;   /* drop crossings outside the domain, uncounted */
    bool failed; /* memory ran out */
    Apart *far;  /* stands.c: parameters that have gone far; NULL: not needed so far */
    /* Of crossings without a weight: |jump| times what their lines stand for; SINK_REVERSE: in [0], as the adjoint
     * weighs it. */
    double gone[SLT_MAX_CHANNELS];
};
bool sink_init(Sink *k, SinkKind kind, Batch *b, Accum *acc, Finder *f, const Grid *g);
void sink_free(Sink *k);
/* Takes n <= BATCH crossings: Finder.full. */
void sink_take(void *sink, Crossing *c, uint32_t n);
/* Takes those at which f does not jump: two boundaries that lie there may each jump, the one back what the other does.
 * Finder.silent_full. */
void sink_take_silent(void *sink, Crossing *c, uint32_t n);
/* The same for n <= BATCH crossings that have their weights already. */
void sink_put_weighed(Sink *k, const Crossing *c, uint32_t n);
/* weight * jump into the group of sizes alone; SINK_REVERSE: of the sum of what the adjoint weighs. n <= BATCH. */
void sink_put_size(Sink *k, const Crossing *c, uint32_t n);
/* The same into the sums of what is missed alone. */
void sink_put_missed(Sink *k, const Crossing *c, uint32_t n);
/* g and its gradient at each of the crossings order[0..n), all of the batch's site, and the weight; false in keep[]
 * where a crossing cannot be integrated, which is counted. */
void sink_weigh(Sink *k, Crossing *c, const uint64_t *order, uint32_t n, bool *keep);
/* stands.c: which of n <= FIND crossings lie where f jumps whatever the parameters are? They weigh nothing. */
void stands_find(Sink *k, const Crossing *const *c, uint32_t n, bool *stands);
/* Calls to come see the parameters that the crossing's g has; NULL: those of the scene. */
void sink_move(Sink *k, const Crossing *c);
/* Sets the inputs of a site kernel to the crossing's place and event. */
void sink_put(Sink *k, uint32_t lane, const Crossing *c);
/* SINK_FORWARD: the rectangle of pixels that crossings in [lo, hi] of the domain reach, all 0. False when memory runs
 * out. */
bool sink_rect(Sink *k, const double lo[3], const double hi[3]);

#endif
