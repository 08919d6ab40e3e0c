/* Cells of which the curves are integrated, but not what lies beside them: those of several have no height axis in
 * common, or the evaluations ran out. They get samples as dense as the lattice's, half of them in a set of its own,
 * whose distance tells the error: a point in the middle, which is all that fits a small one, tells nothing of a large
 * one that is cut by an edge. */
#include <math.h>
#include <stdlib.h>

#include "runtime/quadrature/sweep.h"

enum {
    ACROSS = 256, /* most samples along a side: as many as a batch has room for */
    CHUNKS = 64   /* of the list: each tells its own error, and of few their mean is not known */
};

/* Samples along each side of a cell that is to have so many; even, so that both sets have as many. */
static uint32_t across(double samples, uint32_t dim) {
    double n = 2 * ceil(0.5 * pow(samples, 1.0 / dim));
    return n > ACROSS ? ACROSS : n < 2 ? 2 : (uint32_t)n;
}

bool sweep_takes_beside(const Sweep *p, const Box *cell) {
    if (p->kind != SWEEP_INTEGRAL || !p->errors || !(p->samples > 0)) return false;
    return sweep_measure(cell, p->run->s->dim) * p->samples >= p->volume;
}

/* Where cells are few they are cut, so that there are enough of them to tell an error by. */
static bool cut_beside(Sweep *p, double density) {
    const uint32_t dim = p->run->s->dim;
    for (uint64_t i = 0; i < p->nbeside && p->nbeside < CHUNKS;) {
        uint64_t before = p->nbeside;
        for (uint64_t n = p->nbeside; i < n && p->nbeside < CHUNKS; i++) {
            Box *b = &p->beside[i], half;
            if (sweep_measure(b, dim) * density < 8) continue;
            uint32_t axis = 0;
            for (uint32_t d = 1; d < dim; d++)
                if (b->end[d] - b->lo[d] > b->end[axis] - b->lo[axis]) axis = d;
            double middle = 0.5 * (b->lo[axis] + b->end[axis]);
            if (!sweep_room_beside(&p->beside, p->nbeside, &p->beside_cap)) return false;
            b = &p->beside[i], half = *b, half.lo[axis] = middle;
            b->end[axis] = b->hi[axis] = middle;
            p->beside[p->nbeside++] = half;
        }
        i = p->nbeside > before ? 0 : p->nbeside;
    }
    return true;
}

static uint64_t chunk_of(const Sweep *p) {
    uint64_t n = p->nbeside / CHUNKS;
    return n < 1 ? 1 : n > LEFT_CHUNK ? LEFT_CHUNK : n;
}

static bool beside_work(void *user, uint32_t worker, uint64_t chunk) {
    Sweep *p = user;
    SweepWorker *v = &p->worker[worker];
    uint64_t size = chunk_of(p), from = chunk * size, to = from + size < p->nbeside ? from + size : p->nbeside;
    const uint32_t dim = p->run->s->dim;
    Box hull = p->beside[from];
    for (uint64_t i = from; i < to; i++)
        for (uint32_t d = 0; d < dim; d++) {
            hull.lo[d] = fmin(hull.lo[d], p->beside[i].lo[d]);
            hull.end[d] = fmax(hull.end[d], p->beside[i].end[d]);
        }
    sweep_begin_tile(v, &hull);
    for (uint64_t i = from; i < to && pool_stop_reason(&p->run->pool) == SLT_OK; i++) {
        LeftCell cell = {.box = p->beside[i], .stands = 1};
        left_samples(v, &cell, across(p->density * sweep_measure(&cell.box, dim), dim), -1);
    }
    accum_close(&v->w->acc);
    return !(v->failed || v->w->acc.failed);
}

static void beside_merge(void *user, uint32_t worker, uint64_t chunk) {
    Sweep *p = user;
    (void)chunk;
    sweep_merge_sums(p, &p->worker[worker], SUM_SETS, 1);
}

SltStatus sweep_sample_beside(Sweep *p) {
    p->density = p->samples / p->volume;
    if (!p->nbeside) return SLT_OK;
    if (!cut_beside(p, p->density)) return status_fail(p->run->err, SLT_LIMIT, "out of memory");
    p->mixed = true;
    uint64_t size = chunk_of(p);
    return run_tiles(p->run, (p->nbeside + size - 1) / size, beside_work, beside_merge, p);
}
