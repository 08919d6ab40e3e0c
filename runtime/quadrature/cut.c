/* Lines through cells that are left, cut by bounds. Between two vertices that look alike a ridge may hide that is much
 * thinner than they are apart; where g is flat but beside it, as that of exp(-u*u / (w*w)) > 0.3 + 0.1 * x, no slope
 * tells. Bounds do: a part of a line on which an event is open is halved, down to a few floats, until a vertex lies in
 * what hides there or nothing is open any more. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/sweep.h"
#include "runtime/sample/near.h"
#include "runtime/sample/prove.h"

#define VAIN 0.5 /* share of the cells that cutting does not settle: where g is 0 on an area it never ends */

enum {
    LINE_BOXES = 96, /* a line: about two for each halving, and as many crossings as are usual */
    PILOT_COST = 80, /* of a cell, for each line across it */
    MANY = 16        /* one crossing in so many */
};

bool left_cut(SweepWorker *v, const LeftCell *l, uint64_t from, uint32_t n, bool *done, bool *seen) {
    const Sweep *p = v->sweep;
    Batch *b = &v->w->batch;
    Finder *f = &v->w->finder;
    const SltScene *s = b->s;
    uint8_t cell[LEFT_CHUNK];
    uint32_t lanes = 0, open = 0;
    bool ok = true, gave_up[LEFT_CHUNK] = {false};
    v->vain = 0;
    if (!p->errors || !p->options.curves || p->marches || f->proves || s->ngeometries || s->uses_rand) return true;
    for (uint32_t i = 0; i < n; i++) {
        if (!(l[i].stands > 0) || done[i] || sweep_gap(p, &l[i].box) >= 0) continue;
        batch_set_x(b, lanes, l[i].box.lo);
        for (uint32_t d = 0; d < s->dim; d++) batch_set(b, SLT_IN_H0 + d, lanes, l[i].box.hi[d]);
        cell[lanes++] = (uint8_t)i;
    }
    b->args.note = NULL;
    if (lanes) batch_call(b, SLT_K_BOUNDS, lanes);
    for (uint32_t i = 0; i < lanes; i++) {
        if (batch_get_int(b, SLT_OUT_BOX_STATE, 0, i) & SLT_BOX_UNKNOWN) continue;
        done[cell[i]] = true;
        if (!prove_is_settled(b, i)) cell[open++] = cell[i];
    }
    if (!open) return true;
    f->proves = f->finest = true, f->open = gave_up, f->met = seen;
    f->prove_boxes = (uint64_t)open * LINE_BOXES * s->dim * p->lines;
    for (uint32_t i = 0; i < open && ok; i++) {
        v->owner = cell[i];
        ok = left_lines(v, &l[cell[i]], p->lines, l[cell[i]].stands > 1 ? (int)((from + cell[i]) & 1) : -1);
    }
    finder_run(f, true);
    f->proves = f->finest = false, f->open = f->met = NULL;
    for (uint32_t i = 0; i < open; i++) v->vain += gave_up[cell[i]] ? 1.0 / open : 0;
    return ok;
}

static void forget(void *user, Crossing *c, uint32_t n) { (void)user, (void)c, (void)n; }

bool left_hides(SweepWorker *v, double spend) {
    Sweep *p = v->sweep;
    Finder *f = &v->w->finder;
    void (*full)(void *, Crossing *, uint32_t) = f->full, (*silent_full)(void *, Crossing *, uint32_t) = f->silent_full;
    LeftCell cell[LEFT_CHUNK];
    Box hull = p->left[0].box;
    double most = fmin(fmin(LEFT_CHUNK, (double)p->nleft), spend / (PILOT_COST * p->lines));
    uint32_t n = most < 1 ? 1 : (uint32_t)most;
    bool done[LEFT_CHUNK] = {false}, seen[LEFT_CHUNK] = {false};
    for (uint32_t i = 0; i < n; i++) {
        cell[i] = p->left[(2 * i + 1) * p->nleft / (2 * n)], cell[i].stands = 1;
        for (uint32_t d = 0; d < v->w->batch.s->dim; d++) {
            hull.lo[d] = fmin(hull.lo[d], cell[i].box.lo[d]);
            hull.end[d] = fmax(hull.end[d], cell[i].box.end[d]);
        }
    }
    SltStats before = p->run->stats;
    sweep_begin_tile(v, &hull);
    f->full = f->silent_full = forget, v->w->sink.misses = false;
    for (uint32_t i = 0; i < n; i++) v->owner = (uint8_t)i, v->failed |= !left_lines(v, &cell[i], p->lines, -1);
    near_flush(v->w);
    finder_run(f, true);
    uint64_t met = f->crossings;
    v->failed |= !left_cut(v, cell, 0, n, done, seen);
    uint64_t all = f->crossings - met;
    f->full = full, f->silent_full = silent_full, v->w->sink.misses = true;
    run_collect(p->run, v->w);
    before.evaluations = p->run->stats.evaluations, p->run->stats = before; /* what was found is found again */
    if (v->vain > VAIN) p->hides = false;
    return p->hides && all > met && MANY * (all - met) > met;
}
