/* The arrays of one thread's kernel calls, which a batch owns. An input stays until it is overwritten, an output until
 * the next call; inputs that were never set are 0. In builds with asserts outputs are NaN (integers -1) until a kernel
 * has written them, and a kernel sees NaN in the inputs that its layout says it does not read. */
#ifndef SALTUS_SAMPLE_BATCH_H
#define SALTUS_SAMPLE_BATCH_H

#include <assert.h>
#include <string.h>

#include "runtime/base/threads.h"
#include "runtime/sample/fill.h"

enum { BATCH = 1024 }; /* most samples of a call */

typedef struct Batch {
    const SltScene *s;
    SltKernelArgs args;
    bool f64, pixels; /* pixels: some kernel asks for pixel(), and batch_set_x sets it */
    bool streams;     /* some kernel reads random numbers, and batch_set_stream sets where they come from */
    uint32_t most;    /* samples of a call */
    const Grid *grid;
    const Fill *fill;
    struct CullLists *lists; /* those of args.cull, where they may be shortened for a few samples (cull.h) */
    uint64_t reads;          /* bit k: some kernel reads input k */
    void *memory;            /* of all inputs and outputs */
    SltPruned all;           /* straight-line programs: every chunk runs. args.pruned, where nobody knows better */
    void *all_memory;        /* of its arrays, and of choices that nobody asks for */
    unsigned char *tape;     /* scratch of reverse kernels */
    const SltLayout *layout; /* of the kernel that was called last: where its outputs are */
    unsigned char *poison;   /* builds with asserts: the array of NaN for inputs that are not read */
    const PoolOptions *pool; /* NULL, or: when that wants to stop, calls do nothing, and all outputs are 0 */
    uint64_t evaluations;    /* samples of all calls */
    bool again; /* the samples have been through a kernel that counts: cuts and failed asserts must not count twice */
} Batch;
bool batch_init(Batch *b, const SltScene *s, const Grid *g);
/* For calls of up to so many samples: all arrays lie on a few pages then. */
bool batch_init_few(Batch *b, const SltScene *s, const Grid *g, uint32_t most);
/* For calls to come: this is what runs, and there its choices are noted. NULL: everything, and nowhere. */
void batch_prune(Batch *b, const SltPruned *pruned, uint64_t *choices);
void batch_free(Batch *b);
void batch_collect(Batch *b, SltStats *t); /* adds the counts of all calls to t, and sets them to 0 */
/* Does some kernel read the input? */
static inline bool batch_wants(const Batch *b, uint32_t slot) { return b->reads >> slot & 1; }
/* Input `slot` (an SltInput) from sample i on: of floats (of the program's precision), of integers. Behind `most` there
 * is room for FILL_OVER more. */
static_assert((int)FILL_OVER <= (int)SLT_PAD, "rows are filled in whole vectors");
static inline void *batch_row(const Batch *b, uint32_t slot, uint32_t i) {
    return b->f64 ? (void *)((double *)b->args.in[slot] + i) : (void *)((float *)b->args.in[slot] + i);
}
static inline void *batch_row_int(const Batch *b, uint32_t slot, uint32_t i) { return (int32_t *)b->args.in[slot] + i; }
/* Input `slot` of sample i. */
static inline void batch_set(Batch *b, uint32_t slot, uint32_t i, double v) {
    assert(slot < SLT_IN_VARYING && i < b->most + SLT_PAD);
    if (b->f64) ((double *)b->args.in[slot])[i] = v;
    else ((float *)b->args.in[slot])[i] = (float)v;
}
static inline void batch_set_int(Batch *b, uint32_t slot, uint32_t i, int32_t v) {
    assert(slot < SLT_IN_VARYING && i < b->most + SLT_PAD);
    ((int32_t *)b->args.in[slot])[i] = v;
}
/* Input `slot` of samples i .. i + n - 1, all the same. */
static inline void batch_set_all(Batch *b, uint32_t slot, uint32_t i, uint32_t n, double v) {
    const float narrow = (float)v;
    void *row = batch_row(b, slot, i);
    if (b->f64)
        for (uint32_t k = 0; k < n; k++) ((double *)row)[k] = v;
    else
        for (uint32_t k = 0; k < n; k++) ((float *)row)[k] = narrow;
}
/* Output k of a role, of the kernel that was called last: of all samples (batch_out), or of sample i. */
static inline const void *batch_out(const Batch *b, SltRole role, uint32_t k) {
    assert(k < b->layout->out[role].count);
    return b->args.out[b->layout->out[role].first + k];
}
static inline double batch_get(const Batch *b, SltRole role, uint32_t k, uint32_t i) {
    const void *v = batch_out(b, role, k);
    return b->f64 ? ((const double *)v)[i] : (double)((const float *)v)[i];
}
static inline int32_t batch_get_int(const Batch *b, SltRole role, uint32_t k, uint32_t i) {
    return ((const int32_t *)batch_out(b, role, k))[i];
}
static inline bool batch_has(const Batch *b, SltRole role) { return b->layout->out[role].count > 0; }
/* How many edges may decide either way in box i, of a call of `bounds`. Where nothing decides, the kernel does not say.
 */
static inline int32_t batch_open(const Batch *b, uint32_t i) {
    return batch_has(b, SLT_OUT_OPEN) ? batch_get_int(b, SLT_OUT_OPEN, 0, i) : 0;
}
/* Is f one number of each channel on box i, of a call of `bounds` or `prune`? value: [channels] */
bool batch_is_constant(const Batch *b, uint32_t i, double *value);
/* The pixel that holds x. */
void batch_set_pixel(Batch *b, uint32_t i, const double x[3]);
/* The position of sample i, and the pixel that holds it where the kernels ask for pixel(). */
static inline void batch_set_x(Batch *b, uint32_t i, const double x[3]) {
    for (uint32_t d = 0; d < b->s->dim; d++) batch_set(b, SLT_IN_X0 + d, i, x[d]);
    if (b->pixels) batch_set_pixel(b, i, x);
}
/* A site with the indices of the loops around it: what a site kernel must know besides the point. */
typedef struct Event {
    int32_t site, k[SLT_MAX_K]; /* k: loop indices, outermost first */
    double boundary;            /* of a rounding: where its integer changes */
    double window[2];           /* of a ray: the stretch of it that g looks along, as parameters t; of a mesh a line */
    bool line;                  /* it is a line, of which a site has many */
} Event;
/* Do both tell of the same decision? A ray's window is only where to look for it. */
static inline bool event_same(const Event *e, const Event *f) {
    bool same = !e->line || (e->window[0] == f->window[0] && e->window[1] == f->window[1]);
    return same && e->site == f->site && e->boundary == f->boundary && !memcmp(e->k, f->k, sizeof e->k);
}
/* Of event e that `bounds` names of box i: the line of a mesh that it is, if it is one. */
void batch_read_line(const Batch *b, uint32_t e, uint32_t i, Event *event);
/* All of the event but its site, which is args.site for all samples. */
static inline void batch_set_event(Batch *b, uint32_t i, const Event *e) {
    const uint32_t depth = scene_outputs(b->s, SLT_K_EVENT, SLT_OUT_K),
                   windows = scene_outputs(b->s, SLT_K_EVENT, SLT_OUT_WINDOW);
    for (uint32_t d = 0; d < depth; d++) batch_set_int(b, SLT_IN_K0 + d, i, e->k[d]);
    if (scene_outputs(b->s, SLT_K_EVENT, SLT_OUT_BOUNDARY)) batch_set(b, SLT_IN_BOUNDARY, i, e->boundary);
    for (uint32_t end = 0; end < windows; end++) batch_set(b, SLT_IN_WINDOW0 + end, i, e->window[end]);
}
/* rand0: number 0 of the stream, in [0, 1); rounding to the program's precision keeps it below 1. */
static inline void batch_set_stream(Batch *b, uint32_t i, int32_t stream, double rand0) {
    if (!b->streams) return;
    batch_set_int(b, SLT_IN_STREAM, i, stream);
    batch_set(b, SLT_IN_RAND0, i, rand0 < 0x1.fffffep-1 ? rand0 : 0x1.fffffep-1);
}
/* Calls a kernel on samples 0 .. n-1 of the inputs; those up to the next multiple of its lanes become copies of sample
 * n-1 (with zero seeds). */
void batch_call(Batch *b, SltKernelKind kind, uint32_t n);
/* In its place where the time or the memory is out: a tile may have minutes before it, and comes to its end at once
 * where nothing jumps and everything is 0. pool_run will throw it away. */
void batch_stop(Batch *b, SltKernelKind kind);
/* The same for the bounds of a [Cull] loop, which count no evaluations. */
void batch_call_cull(Batch *b, uint32_t cull_id, uint32_t n);

#endif
