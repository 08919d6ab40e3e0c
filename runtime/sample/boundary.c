/* What the boundary terms of all estimators share. */
#include "runtime/sample/boundary.h"

#include <math.h>

static BoundaryRun *const estimators[SLT_ESTIMATORS] = {
#define SLT_ESTIMATOR(id, name, run, ...) [SLT_EST_##id] = run,
#define SLT_CELLS(id, ...) [SLT_EST_##id] = lattice_run, /* what bounds leave over goes to the lattice */
#include "saltus/estimators.def"
};

bool slt_estimate_by_differences(SltEstimator e) { return !estimators[e]; }

double boundary_segments(const SltJob *j) {
    if (j->segments) return (double)j->segments;
    return j->integral ? (double)(j->samples ? j->samples : 1) : (double)(j->spp ? j->spp : 1);
}

void boundary_merge(Boundary *y, Worker *w) {
    if (w->sink.kind == SINK_FORWARD) splat_merge(&w->sink.splat, y->out, y->crossings);
    else if (y->parts) parts_merge(y->parts, &w->acc, &y->parts_of, y->targets);
    else accum_merge(&w->acc, y->targets);
    run_collect(y->run, w);
}

void boundary_bind(Boundary *y, Worker *w, SinkKind kind) {
    w->finder.coarse = run_is_coarse(y->run);
    w->sink.coincide.apart = y->run->apart, w->finder.ties = y->run->apart != NULL;
    w->sink.coincide.tied = w->finder.tied = y->run->tied;
    w->finder.proves = w->finder.finest = y->boxes > 0, w->finder.prove_boxes = y->boxes;
    w->finder.only_hidden = y->only_hidden;
    w->finder.pairs = y->run->grid.integral && !y->windows;
    w->sink.kind = kind, w->sink.adjoint = y->adjoint, w->sink.classes = y->classes, w->sink.dirs = y->dirs;
    w->sink.any_sign = y->any_sign, w->sink.met = y->run->met;
    w->sink.noise[0] = y->noise[0], w->sink.noise[1] = y->noise[1], w->sink.least = y->least;
    w->sink.misses = kind == SINK_INTEGRAL || (kind == SINK_REVERSE && y->misses);
}

bool boundary_in_order(const Run *r) {
    return estimators[r->j->estimator] == lattice_run && r->grid.integral && r->s->dim > 1 && !r->s->uses_rand;
}

/* Workers are memory that is touched for nothing where there is a tile for one of them alone, or little to do. */
static uint64_t most_tiles(const Boundary *y, uint32_t n) {
    enum { SAMPLES = 16 }; /* that a segment takes as long as, or longer */
    if (n > 1) return run_is_long(y->run, SAMPLES * y->segments * n) ? n : 1;
    if (y->windows) return y->windows->n;
    return estimators[y->run->j->estimator] == lattice_run ? lattice_tiles(y) : UINT32_MAX;
}

#define STEP 0x1p-15 /* by which parameters are moved, for boundaries that coincide: no less, whatever is known of roots */

/* All n in one go, or one alone. */
static SltStatus run_some(Boundary *y, uint32_t n, SinkKind kind) {
    Run *r = y->run;
    const SltScene *s = r->s;
    bool can = s->kernel[SLT_K_REGION] && s->kernel[SLT_K_EVENT] && s->kernel[SLT_K_SIDES] && s->kernel[SLT_K_SITE] &&
               s->kernel[SLT_K_SITE_GRAD] &&
               (kind == SINK_FORWARD ? s->kernel[SLT_K_SITE_JVP] : s->kernel[SLT_K_SITE_VJP]);
    if (!can || !s->nsites || !(y->segments > 0)) return SLT_OK;
    /* Windows have no sketches: what called for them has three sums a channel. */
    uint32_t sums = boundary_in_order(r) && !y->any_sign && !y->windows ? 3 + SKETCHES : 3;
    uint32_t accums = kind == SINK_INTEGRAL  ? sums * s->channels
                      : kind == SINK_REVERSE ? y->classes + y->misses + (y->noise[0] ? PARTS_NOISE : 0)
                                             : 0;
    /* Tiles of images are small, and their lists short: parts of them would gain what their lists take. */
    const bool memory = !r->grid.integral || cull_by_parts(&r->cull);
    SltStatus st =
        memory ? run_workers(r, most_tiles(y, n), accums, kind) : status_fail(r->err, SLT_LIMIT, "out of memory");
    double lines = pow(y->segments / s->dim, 1.0 / s->dim) * (r->grid.integral ? 1 : r->grid.n[0]);
    double step = coincide_step(root_tolerance(run_is_coarse(r)) / fmax(1, lines), STEP);
    if (st == SLT_OK && !(coincide_begin(r, step) && twins_begin(r)))
        st = status_fail(r->err, SLT_LIMIT, "out of memory");
    if (st == SLT_OK) {
        for (uint32_t i = 0; i < r->nworkers; i++) boundary_bind(y, &r->worker[i], kind);
        st = y->windows ? scanline_windows(y)
             : n > 1    ? lattice_run_small(y, n, kind)
                        : estimators[r->j->estimator](y, kind);
    }
    run_free_workers(r);
    return st;
}

SltStatus boundary_run(Boundary *y, SinkKind kind) { return run_some(y, 1, kind); }

SltStatus boundary_run_all(Boundary *y, uint32_t n, SinkKind kind) {
    if (estimators[y->run->j->estimator] == lattice_run && lattice_is_small(y)) return run_some(y, n, kind);
    SltStatus st = SLT_OK;
    PoolOptions *pool = &y->run->pool;
    const double from = pool->from, step = (pool->to - from) / n;
    for (uint32_t i = 0; i < n && st == SLT_OK; i++) {
        pool->from = from + i * step, pool->to = pool->from + step;
        st = run_some(&y[i], 1, kind);
    }
    return st;
}
