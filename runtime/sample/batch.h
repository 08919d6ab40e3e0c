/* The arrays of one thread's kernel calls. A batch owns them; what was put in stays there till it is overwritten, what
 * came out until the next call. Inputs that nobody has put in are 0. In builds with asserts outputs are NaN (integers
 * -1) until a kernel has written them, and so is what a kernel sees of inputs that it says it does not read. */
#ifndef SALTUS_SAMPLE_BATCH_H
#define SALTUS_SAMPLE_BATCH_H

#include <assert.h>
#include "runtime/sample/grid.h"

enum { BATCH = 1024 }; /* most samples of a call */

typedef struct Batch {
    const SltScene *s;
    SltKernelArgs args;
    bool f64, pixels; /* fill the pixel() inputs */
    const Grid *grid;
    void *memory;
    unsigned char *tape;
    const SltLayout *layout; /* of the kernel that was called last: where its outputs are */
    unsigned char *poison; /* builds with asserts: what a kernel sees in inputs that its layout says it does not read */
    uint64_t evaluations;
    bool
        again; /* these samples have been through a kernel that counts: cuts and failed asserts are not counted twice */
} Batch;
bool batch_init(Batch *b, const SltScene *s, const Grid *g);
void batch_free(Batch *b);
void batch_collect(Batch *b, SltStats *t); /* adds what the calls counted, and counts from 0 again */
static inline void batch_set(Batch *b, uint32_t slot, uint32_t i, double v) {
    assert(slot < SLT_IN_VARYING && i < BATCH + SLT_PAD);
    if (b->f64) ((double *)b->args.in[slot])[i] = v;
    else ((float *)b->args.in[slot])[i] = (float)v;
}
static inline void batch_set_int(Batch *b, uint32_t slot, uint32_t i, int32_t v) {
    assert(slot < SLT_IN_VARYING && i < BATCH + SLT_PAD);
    ((int32_t *)b->args.in[slot])[i] = v;
}
/* Output number k of a role, of the kernel that was called last: all samples, or one. */
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
/* Position, and the pixel it lies in when the shader's image has pixels. */
void batch_set_x(Batch *b, uint32_t i, const double x[3]);
/* What a site kernel must know besides the point. */
typedef struct Event {
    int32_t site, k[SLT_MAX_K];
    double boundary, window[2]; /* where it is about an integer, or a ray */
} Event;
/* All but the site, which is the same for all samples. */
void batch_set_event(Batch *b, uint32_t i, const Event *e);
/* Number 0 of a stream: kept below 1 in the program's precision. */
void batch_set_stream(Batch *b, uint32_t i, int32_t stream, double rand0);
/* Calls a kernel on lanes 0..n-1 of the inputs; the tail up to the next multiple of SLT_PAD becomes copies of lane n-1
 * (with zero seeds). */
void batch_call(Batch *b, SltKernelKind kind, uint32_t n);
/* The same for the bounds of a [Cull] loop, which count no evaluations. */
void batch_call_cull(Batch *b, uint32_t cull_id, uint32_t n);

#endif
