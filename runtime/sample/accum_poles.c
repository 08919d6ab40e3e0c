/* Samples that hit a pole of the derivative.
 *
 * d/dc of sqrt(x - c) is infinite at x = c, and its integral is not. Cells that close in on c have points there, in f32
 * often, and no sum survives one. Where a call makes infinite what was finite, the samples that did are looked for by
 * halves, with seeds of 0 for all others (what a seed of 0 gives is 0, at a pole too), left out and counted. Few of a
 * call only, and where f itself is finite: a derivative that is infinite on an area stays so. */
#include <stdlib.h>

#include "runtime/sample/accum.h"

enum { MOST_BYTES = 1 << 13, MOST = 16 /* samples left out of a call */ };

struct Poles {
    Batch *b;
    uint32_t n, left_out;
    uint64_t bytes; /* of all rows */
    unsigned char *adj;
    unsigned char before[SLT_MAX_CHANNELS * MOST_BYTES];
    double seeds[SLT_MAX_CHANNELS][BATCH];
};

/* No exponent of all ones. */
static bool finite32(const unsigned char *bytes, uint64_t n) {
    uint32_t most = 0;
    for (uint64_t i = 0; i < n; i += 4) {
        uint32_t v;
        memcpy(&v, bytes + i, sizeof v);
        v &= UINT32_MAX >> 1;
        most = v > most ? v : most;
    }
    return most < UINT32_C(0x7f8) << 20;
}
static bool finite64(const unsigned char *bytes, uint64_t n) {
    uint64_t most = 0;
    for (uint64_t i = 0; i < n; i += 8) {
        uint64_t v;
        memcpy(&v, bytes + i, sizeof v);
        v &= UINT64_MAX >> 1;
        most = v > most ? v : most;
    }
    return most < UINT64_C(0x7ff) << 52;
}
static bool is_finite(const Poles *q) { return q->b->f64 ? finite64(q->adj, q->bytes) : finite32(q->adj, q->bytes); }

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
    set_seeds(q, lo, hi);
    batch_call(q->b, SLT_K_VJP, q->n);
    if (is_finite(q)) {
        memcpy(q->before, q->adj, q->bytes);
        return true;
    }
    memcpy(q->adj, q->before, q->bytes);
    if (hi - lo == 1) return value_is_finite(q, lo) && ++q->left_out <= MOST;
    uint32_t middle = lo + (hi - lo) / 2;
    return add(q, lo, middle) && add(q, middle, hi);
}

bool accum_watch(Accum *a, Batch *b, uint32_t which, uint32_t rows) {
    if (a->bytes > MOST_BYTES || a->infinite || b->s->pixelwise) return false; /* no sample is one of few */
    if (!a->poles) a->poles = malloc(sizeof *a->poles);
    if (!a->poles) return false;
    a->poles->b = b, a->poles->adj = a->buf[which].adj, a->poles->bytes = a->bytes * rows;
    memcpy(a->poles->before, a->poles->adj, a->poles->bytes);
    return true;
}

void accum_leave_out(Accum *a, uint32_t n) {
    Poles *q = a->poles;
    Batch *b = q->b;
    if (is_finite(q)) return;
    unsigned char with[sizeof q->before];
    uint64_t counters[SLT_COUNTERS], evaluations = b->evaluations;
    memcpy(with, q->adj, q->bytes), memcpy(counters, b->args.counters, sizeof counters);
    q->n = n, q->left_out = 0;
    for (uint32_t c = 0; c < b->s->channels; c++)
        for (uint32_t i = 0; i < n; i++) {
            const void *seed = b->args.in[SLT_IN_SEED0 + c];
            q->seeds[c][i] = b->f64 ? ((const double *)seed)[i] : (double)((const float *)seed)[i];
        }
    memcpy(q->adj, q->before, q->bytes);
    a->infinite = !add(q, 0, n);
    if (a->infinite) memcpy(q->adj, with, q->bytes);
    set_seeds(q, 0, n);
    memcpy(b->args.counters, counters, sizeof counters), b->evaluations = evaluations;
    if (!a->infinite) b->args.counters[SLT_COUNT_NONFINITE] += q->left_out;
}
