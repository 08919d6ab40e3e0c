/* A call's state: workers, tiles, counts; and the boundary term of any estimator. */
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/internal.h"

SltStatus run_begin(Run *r, const SltScene *s, const SltJob *j, SltError *err) {
    memset(r, 0, sizeof *r);
    r->s = s, r->j = j, r->err = err, r->start = pool_now();
    r->pool.deadline = j->time_limit > 0 ? r->start + j->time_limit : 0;
    r->pool.cancel = j->cancel, r->pool.progress = j->progress, r->pool.progress_user = j->progress_user;
    r->pool.from = 0, r->pool.to = 1;
    if (err) err->status = SLT_OK, err->text[0] = 0;
    if (!s->width) return status_fail(err, SLT_INTERNAL, "a scene without a width");
    SltStatus st = grid_init(&r->grid, s, j, err);
    if (st == SLT_OK) st = cull_boxes(&r->cull, s, err);
    return st;
}

void stats_add(SltStats *to, const SltStats *s) {
    if (!to) return;
    to->samples += s->samples, to->segments += s->segments, to->crossings += s->crossings;
    to->evaluations += s->evaluations;
    for (int d = 0; d < SLT_DROP_REASONS; d++) to->dropped[d] += s->dropped[d];
    to->truncated += s->truncated, to->asserts += s->asserts, to->nonfinite += s->nonfinite;
    to->seconds += s->seconds;
    to->seconds_interior += s->seconds_interior, to->seconds_boundary += s->seconds_boundary;
}

void run_end(Run *r, SltStats *stats) {
    run_free_workers(r);
    coincide_end(r);
    grid_free(&r->grid);
    cull_free(&r->cull);
    r->stats.seconds = pool_now() - r->start;
    stats_add(stats, &r->stats);
}

static bool is_coarse(const Run *r) { return scene_outputs(r->s, SLT_K_EVENT, SLT_OUT_WINDOW) && !r->grid.integral; }

static bool follows(const Run *r) {
    bool lattice = r->j->estimator == SLT_EST_LATTICE && !r->s->uses_rand && r->s->dim == 2;
    return lattice && (r->s->follow > 1 || (r->s->follow == 1 && !is_coarse(r)));
}

static bool worker_init(Run *r, Worker *w, uint32_t accums, SinkKind kind) {
    if (!batch_init(&w->batch, r->s, &r->grid)) return false;
    if (!accum_init(&w->acc, r->s, accums)) return false;
    if (!finder_init(&w->finder, &w->batch)) return false;
    if (!sink_init(&w->sink, kind, &w->batch, &w->acc, &w->finder, &r->grid)) return false;
    w->finder.full = sink_take, w->finder.full_user = &w->sink;
    if (scene_outputs(r->s, SLT_K_REGION, SLT_OUT_NEAR_SITE) && !near_init(w)) return false;
    if (follows(r) && !(w->follow = w->sink.follow = follow_new())) return false;
    return cull_lists_init(&w->cull, &r->cull);
}

void run_free_workers(Run *r) {
    for (uint32_t i = 0; i < r->nworkers; i++) {
        Worker *w = &r->worker[i];
        batch_free(&w->batch), accum_free(&w->acc), finder_free(&w->finder), sink_free(&w->sink),
            cull_lists_free(&w->cull, &r->cull);
        free(w->hash), free(w->depth), free(w->witness), free(w->near_g), free(w->near_key), free(w->near_event),
            free(w->value), free(w->scratch), follow_free(w->follow);
    }
    free(r->worker);
    r->worker = NULL, r->nworkers = 0;
}

SltStatus run_workers(Run *r, uint64_t tiles, uint32_t accums, SinkKind kind) {
    run_free_workers(r);
    uint32_t n = pool_threads(r->j->threads, tiles);
    r->worker = alloc_zero(n, sizeof *r->worker);
    if (!r->worker) return status_fail(r->err, SLT_LIMIT, "out of memory");
    r->nworkers = n;
    for (uint32_t i = 0; i < n; i++)
        if (!worker_init(r, &r->worker[i], accums, kind)) return status_fail(r->err, SLT_LIMIT, "out of memory");
    return SLT_OK;
}

SltStatus run_tiles(Run *r, uint64_t tiles, PoolWork *work, PoolMerge *merge, void *user) {
    PoolOptions o = r->pool;
    o.threads = tiles < r->nworkers ? (uint32_t)(tiles ? tiles : 1) : r->nworkers;
    return pool_run(&o, tiles, work, merge, user, r->err);
}

void run_collect(Run *r, Worker *w) {
    SltStats *t = &r->stats;
    batch_collect(&w->batch, t);
    t->segments += w->finder.segments, w->finder.segments = 0;
    t->crossings += w->finder.crossings, w->finder.crossings = 0;
    for (int d = 0; d < SLT_DROP_REASONS; d++) t->dropped[d] += w->finder.dropped[d], w->finder.dropped[d] = 0;
}

bool worker_vertices(Worker *w, uint64_t n) {
    if (n <= w->vertex_cap) return true;
    free(w->hash), free(w->depth), free(w->witness), free(w->near_g), free(w->near_key), free(w->near_event);
    w->depth = NULL, w->witness = NULL, w->near_g = NULL, w->near_key = NULL, w->near_event = NULL;
    w->vertex_cap = n;
    w->hash = malloc(n * sizeof *w->hash);
    bool ok = w->hash != NULL;
    if (scene_outputs(w->batch.s, SLT_K_REGION, SLT_OUT_DEPTH)) ok &= (w->depth = malloc(n * sizeof *w->depth)) != NULL;
    uint32_t nwitness = scene_outputs(w->batch.s, SLT_K_REGION, SLT_OUT_WITNESS);
    if (nwitness) ok &= (w->witness = malloc(n * nwitness * sizeof *w->witness)) != NULL;
    if (scene_outputs(w->batch.s, SLT_K_REGION, SLT_OUT_NEAR_SITE)) {
        w->near_g = malloc(n * sizeof *w->near_g), w->near_key = malloc(n * sizeof *w->near_key);
        w->near_event = malloc(n * (1 + SLT_MAX_K) * sizeof *w->near_event);
        ok = ok && w->near_g && w->near_key && w->near_event;
    }
    if (!ok) w->vertex_cap = 0;
    return ok;
}

Mark worker_mark(const Worker *w, uint64_t v) {
    Mark m = {.hash = w->hash[v], .depth = w->depth ? w->depth[v] : 0};
    uint32_t n = scene_outputs(w->batch.s, SLT_K_REGION, SLT_OUT_WITNESS);
    for (uint32_t k = 0; k < n; k++) m.witness[k] = w->witness[v * n + k];
    return m;
}

bool worker_values(Worker *w, uint64_t n) {
    if (n > w->value_cap) {
        free(w->value);
        w->value = malloc(n * sizeof *w->value);
        w->value_cap = w->value ? n : 0;
        if (!w->value) return false;
    }
    memset(w->value, 0, n * sizeof *w->value);
    return true;
}

void boundary_merge(Boundary *y, Worker *w) {
    if (w->sink.kind == SINK_FORWARD) sink_merge_splat(&w->sink, y->out, y->crossings);
    else accum_merge(&w->acc, y->targets);
    run_collect(y->run, w);
}

void boundary_bind(Boundary *y, Worker *w, SinkKind kind) {
    w->finder.coarse = is_coarse(y->run);
    w->sink.coincide.apart = y->run->apart;
    w->sink.kind = kind, w->sink.adjoint = y->adjoint, w->sink.classes = y->classes, w->sink.dirs = y->dirs;
}

SltStatus boundary_run(Boundary *y, SinkKind kind) {
    Run *r = y->run;
    const SltScene *s = r->s;
    bool can = s->kernel[SLT_K_REGION] && s->kernel[SLT_K_EVENT] && s->kernel[SLT_K_SIDES] && s->kernel[SLT_K_SITE] &&
               s->kernel[SLT_K_SITE_GRAD] &&
               (kind == SINK_FORWARD ? s->kernel[SLT_K_SITE_JVP] : s->kernel[SLT_K_SITE_VJP]);
    if (!can || !s->nsites || !(y->segments > 0)) return SLT_OK;
    uint32_t accums = kind == SINK_INTEGRAL ? 2 * s->channels : kind == SINK_REVERSE ? y->classes : 0;
    SltStatus st = run_workers(r, UINT32_MAX, accums, kind);
    double lines = pow(y->segments / s->dim, 1.0 / s->dim) * (r->grid.integral ? 1 : r->grid.n[0]);
    if (st == SLT_OK && !coincide_begin(r, root_tolerance(is_coarse(r)) / fmax(1, lines)))
        st = status_fail(r->err, SLT_LIMIT, "out of memory");
    if (st == SLT_OK) {
        for (uint32_t i = 0; i < r->nworkers; i++) boundary_bind(y, &r->worker[i], kind);
        switch (r->j->estimator) {
        case SLT_EST_LATTICE:
            /* In a volume a lattice of n^3 vertices has so few lines a side that flat faces along the axes are off by
             * 1/n: lines spread evenly over the cross-sections are several times better at the same number of segments.
             */
            st = s->uses_rand || (s->dim == 3 && r->grid.integral) ? scanline_run(y) : lattice_run(y);
            break;
        case SLT_EST_SCANLINE: st = scanline_run(y); break;
        case SLT_EST_SNAP_KNN:
        case SLT_EST_SNAP_CROFTON: st = segments_run(y, kind); break;
        case SLT_EST_FD: st = status_fail(r->err, SLT_INTERNAL, "finite differences have no boundary term"); break;
        }
    }
    run_free_workers(r);
    return st;
}
