/* Samples that hit a pole of the derivative.
 *
 * d/dc of sqrt(x - c) is infinite at x = c, and its integral is not. Cells that close in on c have points there, in f32
 * often, and no sum survives one. Where a call makes infinite what was finite, the samples that did are looked for by
 * halves, with seeds of 0 for all others (what a seed of 0 gives is 0, at a pole too), left out and counted. Few of a
 * call only, and where f itself is finite: a derivative that is infinite on an area stays so. */
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/accum.h"

enum { MOST_BYTES = 1 << 13, MOST = 16 /* samples left out of a call */ };

typedef struct Poles {
    Accum *a;
    Batch *b;
    SltKernelKind kind;
    uint32_t n, left_out;
    unsigned char sums[SLT_MAX_CHANNELS * MOST_BYTES]; /* of what has been added so far */
    double seeds[SLT_MAX_CHANNELS][BATCH];
} Poles;

/* The seeds of samples lo .. hi - 1, and 0 for all others. */
static void set_seeds(Poles *q, uint32_t lo, uint32_t hi) {
    for (uint32_t c = 0; c < q->b->s->channels; c++)
        for (uint32_t i = 0; i < q->n; i++)
            batch_set(q->b, SLT_IN_SEED0 + c, i, i >= lo && i < hi ? q->seeds[c][i] : 0);
}

static bool value_is_finite(const Poles *q, uint32_t i) {
    if (!batch_has(q->b, SLT_OUT_F)) batch_call(q->b, SLT_K_VALUE, q->n);
    bool finite = true;
    for (uint32_t c = 0; finite && c < q->b->s->channels; c++) {
        double f = batch_get(q->b, SLT_OUT_F, c, i);
        finite = f - f == 0;
    }
    return finite;
}

/* Adds samples lo .. hi - 1; false: they are not to be saved. */
static bool add(Poles *q, uint32_t lo, uint32_t hi) {
    const Before *at = &q->a->before;
    set_seeds(q, lo, hi);
    batch_call(q->b, q->kind, q->n);
    if (accum_is_finite(q->a)) {
        memcpy(q->sums, at->adj, at->n);
        return true;
    }
    memcpy(at->adj, q->sums, at->n);
    if (hi - lo == 1) return value_is_finite(q, lo) && ++q->left_out <= MOST;
    uint32_t middle = lo + (hi - lo) / 2;
    return add(q, lo, middle) && add(q, middle, hi);
}

/* Of sums that are small, and where a sample is one of many. */
bool accum_may_leave_out(const Accum *a) { return a->bytes <= MOST_BYTES && !a->infinite && !a->s->pixelwise; }

static void leave_out(Poles *q) {
    Accum *a = q->a;
    Batch *b = q->b;
    const Before *at = &a->before;
    unsigned char with[sizeof q->sums];
    uint64_t counters[SLT_COUNTERS], evaluations = b->evaluations;
    memcpy(with, at->adj, at->n), memcpy(counters, b->args.counters, sizeof counters);
    for (uint32_t c = 0; c < b->s->channels; c++)
        for (uint32_t i = 0; i < q->n; i++) {
            const void *seed = b->args.in[SLT_IN_SEED0 + c];
            q->seeds[c][i] = b->f64 ? ((const double *)seed)[i] : (double)((const float *)seed)[i];
        }
    accum_put_back(a);
    memcpy(q->sums, at->adj, at->n);
    a->infinite = !add(q, 0, q->n);
    if (a->infinite) memcpy(at->adj, with, at->n);
    set_seeds(q, 0, q->n);
    memcpy(b->args.counters, counters, sizeof counters), b->evaluations = evaluations;
    if (!a->infinite) b->args.counters[SLT_COUNT_NONFINITE] += q->left_out;
}

void accum_leave_out(Accum *a, Batch *b, SltKernelKind kind, uint32_t n) {
    if (accum_is_finite(a)) return;
    Poles *q = malloc(sizeof *q);
    if (!q) return;
    q->a = a, q->b = b, q->kind = kind, q->n = n, q->left_out = 0;
    leave_out(q);
    free(q);
}
