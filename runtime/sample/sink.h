/* What becomes of crossings: weights, then adjoints, a splat into images, or a list. One sink a thread; it uses that
 * thread's batch, accumulators and finder, and owns what it keeps. */
#ifndef SALTUS_SAMPLE_SINK_H
#define SALTUS_SAMPLE_SINK_H

#include "runtime/sample/accum.h"
#include "runtime/sample/coincide.h"
#include "runtime/sample/follow.h"

typedef enum SinkKind { SINK_INTEGRAL, SINK_REVERSE, SINK_FORWARD, SINK_KEEP } SinkKind;
typedef struct Directions {
    uint32_t n;
    void **flt; /* [n]: flt[nfloats] */
} Directions;
struct Sink {
    SinkKind kind;
    Batch *b;
    Accum *acc;
    Finder *f; /* counters of dropped crossings */
    const Grid *grid;
    double scale[3];        /* s_j of the weights */
    const float *adjoint;   /* SINK_REVERSE */
    uint32_t classes;       /* adjoint buffers of SINK_REVERSE: 1, or COSETS */
    const Directions *dirs; /* SINK_FORWARD: into splat, double[dir][pixel of the rectangle][channel] */
    double *splat;
    float *count;       /* crossings, same rectangle, may be NULL */
    uint64_t splat_cap; /* doubles of splat: it grows with the largest rectangle */
    uint32_t rect_lo[3], rect_n[3];
    Crossing *kept; /* SINK_KEEP */
    uint64_t nkept, kept_cap;
    uint64_t *order;
    Coincide coincide;
    Follow *follow; /* NULL: nobody asks */
    bool clip;      /* drop crossings outside the domain */
    bool failed;
};
bool sink_init(Sink *k, SinkKind kind, Batch *b, Accum *acc, Finder *f, const Grid *g);
void sink_free(Sink *k);
void sink_take(void *sink, Crossing *c, uint32_t n);
/* g and its gradient at each crossing, then the weight; false in keep[] where nothing can be integrated. */
void sink_weigh(Sink *k, Crossing *c, const uint64_t *order, uint32_t n, bool *keep);
/* A lane of the site kernels. */
void sink_put(Sink *k, uint32_t lane, const Crossing *c);
bool sink_rect(Sink *k, const double lo[3], const double hi[3]);
/* Adds the rectangle to the images, in tile order. */
void sink_merge_splat(Sink *k, float *const *out, float *crossings);

#endif
