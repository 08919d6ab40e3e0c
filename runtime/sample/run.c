/* The state of a call: workers, tiles, counts, vertices. */
#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/run.h"

PoolOptions pool_of_job(const SltJob *j, uint32_t threads) {
    return (PoolOptions){.threads = threads,
                         .deadline = j->time_limit > 0 ? pool_now() + j->time_limit : 0,
                         .cancel = j->cancel,
                         .progress = j->progress,
                         .progress_user = j->progress_user,
                         .to = 1};
}

SltStatus run_begin(Run *r, const SltScene *s, const SltJob *j, SltError *err) {
    memset(r, 0, sizeof *r);
    r->s = s, r->j = j, r->err = err, r->start = pool_now();
    r->pool = pool_of_job(j, 0); /* run_tiles says how many threads */
    if (err) err->status = SLT_OK, err->text[0] = 0;
    if (!s->adj_lanes) return status_fail(err, SLT_INTERNAL, "a scene that has no sums of adjoints");
    SltStatus st = grid_init(&r->grid, s, j, err);
    if (st == SLT_OK) st = cull_boxes(&r->cull, s, err);
    return st;
}

void stats_add(SltStats *to, const SltStats *s) {
    if (!to) return;
    to->samples += s->samples, to->segments += s->segments, to->crossings += s->crossings;
    to->evaluations += s->evaluations;
    for (int d = 0; d < SLT_DROP_REASONS; d++)
        to->dropped[d] += s->dropped[d], place_least(&to->dropped_at[d], &s->dropped_at[d]);
    to->truncated += s->truncated, to->asserts += s->asserts, to->nonfinite += s->nonfinite;
    to->seconds += s->seconds;
    to->seconds_interior += s->seconds_interior, to->seconds_boundary += s->seconds_boundary;
    stats_of_cells(to, s);
}

void stats_of_cells(SltStats *to, const SltStats *s) {
    if (!to) return;
    to->cells = s->cells, to->certified = s->certified, to->settled = s->settled, to->curved = s->curved;
    to->singular = s->singular;
    to->upset = s->upset, to->upset_line = s->upset_line;
    to->left = s->left, to->left_bound = s->left_bound, to->boxes = s->boxes, to->stopped = s->stopped;
}

void run_end(Run *r, SltStats *stats) {
    run_free_workers(r);
    coincide_end(r);
    grid_free(&r->grid);
    cull_free(&r->cull);
    r->stats.seconds = pool_now() - r->start;
    stats_add(stats, &r->stats);
}

bool run_is_coarse(const Run *r) { return scene_outputs(r->s, SLT_K_EVENT, SLT_OUT_WINDOW) && !r->grid.integral; }

bool run_is_long(const Run *r, double samples) {
    enum { LONG = 1 << 26 }; /* instructions, of one lane: by vectors a millisecond */
    return samples * r->s->work > LONG;
}

static bool follows(const Run *r) {
    bool lattice = r->j->estimator == SLT_EST_LATTICE && !r->s->uses_rand && r->s->dim == 2;
    return lattice && (r->s->follow > 1 || (r->s->follow == 1 && !run_is_coarse(r)));
}

static bool worker_init(Run *r, Worker *w, uint32_t accums, SinkKind kind) {
    if (!batch_init_few(&w->batch, r->s, &r->grid, r->most ? r->most : BATCH)) return false;
    w->batch.pool = &r->pool;
    if (!accum_init(&w->acc, r->s, accums)) return false;
    if (kind != SINK_NONE && !finder_init(&w->finder, &w->batch)) return false;
    if (kind != SINK_NONE && !sink_init(&w->sink, kind, &w->batch, &w->acc, &w->finder, &r->grid)) return false;
    w->finder.full = sink_take, w->finder.silent_full = sink_take_silent, w->finder.full_user = &w->sink;
    if (follows(r) && !(w->follow = w->sink.follow = follow_new())) return false;
    return narrow_init(&w->narrow, r->s) && cull_lists_init(&w->cull, &r->cull);
}

void run_free_workers(Run *r) {
    for (uint32_t i = 0; i < r->nworkers; i++) {
        Worker *w = &r->worker[i];
        batch_free(&w->batch), accum_free(&w->acc), finder_free(&w->finder), sink_free(&w->sink),
            cull_lists_free(&w->cull, &r->cull), prune_free(&w->pruner);
        free(w->hash), free(w->face), free(w->settled), free(w->ask), free(w->depth), free(w->witness), free(w->near_g),
            free(w->near_key), free(w->near_event), free(w->value), free(w->probes), follow_free(w->follow),
            tails_free_tile(&w->tail), narrow_free(&w->narrow);
    }
    free(r->worker);
    r->worker = NULL, r->nworkers = 0;
}

SltStatus run_workers(Run *r, uint64_t tiles, uint32_t accums, SinkKind kind) {
    run_free_workers(r);
    uint32_t n = r->threads = pool_threads(r->j->threads, tiles);
    if (r->spares) n += n / 2;
    r->worker = alloc_zero(n, sizeof *r->worker);
    if (!r->worker) return status_fail(r->err, SLT_LIMIT, "out of memory");
    r->nworkers = n;
    for (uint32_t i = 0; i < n; i++)
        if (!worker_init(r, &r->worker[i], accums, kind)) return status_fail(r->err, SLT_LIMIT, "out of memory");
    return SLT_OK;
}

SltStatus run_tiles(Run *r, uint64_t tiles, PoolWork *work, PoolMerge *merge, void *user) {
    PoolOptions o = r->pool;
    o.threads = tiles < r->threads ? (uint32_t)(tiles ? tiles : 1) : r->threads;
    o.workers = r->nworkers;
    assert(o.threads >= 1 && o.threads <= r->nworkers); /* work(user, worker, tile) takes r->worker[worker] */
    return pool_run(&o, tiles, work, merge, user, r->err);
}

void run_collect(Run *r, Worker *w) {
    SltStats *t = &r->stats;
    batch_collect(&w->batch, t);
    t->segments += w->finder.segments, w->finder.segments = 0;
    t->crossings += w->finder.crossings, w->finder.crossings = 0;
    sizes_add(&r->kept, &w->finder.kept), w->finder.kept = (Sizes){0};
    sizes_add(&r->gone, &w->finder.gone), w->finder.gone = (Sizes){0};
    for (uint32_t c = 0; c < r->s->channels; c++) r->gone_along[c] += w->sink.gone[c], w->sink.gone[c] = 0;
    r->parts_gone += w->finder.parts_gone, w->finder.parts_gone = 0;
    r->followed += w->finder.followed, w->finder.followed = 0;
    r->steep += w->finder.steep, r->rims += w->finder.rims, w->finder.steep = w->finder.rims = 0;
    for (int d = 0; d < SLT_DROP_REASONS; d++) {
        t->dropped[d] += w->finder.dropped[d], w->finder.dropped[d] = 0;
        place_least(&t->dropped_at[d], &w->finder.dropped_at[d]), w->finder.dropped_at[d] = (SltPlace){0};
    }
}

void run_forget_few(Run *r) {
    enum { FEW = 1000 };
    uint64_t *coincident = &r->stats.dropped[SLT_DROP_COINCIDENT];
    if (*coincident * FEW <= r->stats.crossings) *coincident = 0;
}

bool worker_vertices(Worker *w, uint64_t n) {
    if (n <= w->vertex_cap) return true;
    free(w->hash), free(w->face), free(w->settled), free(w->ask), free(w->depth), free(w->witness), free(w->near_g),
        free(w->near_key), free(w->near_event);
    w->face = NULL, w->depth = NULL, w->witness = NULL, w->near_g = NULL, w->near_key = NULL, w->near_event = NULL;
    w->vertex_cap = n;
    w->hash = malloc(n * sizeof *w->hash);
    w->settled = malloc(n);
    w->ask = malloc(n);
    bool ok = w->hash && w->settled && w->ask;
    if (scene_outputs(w->batch.s, SLT_K_REGION, SLT_OUT_DEPTH)) ok &= (w->depth = malloc(n * sizeof *w->depth)) != NULL;
    if (scene_outputs(w->batch.s, SLT_K_REGION, SLT_OUT_FACE)) ok &= (w->face = malloc(n * sizeof *w->face)) != NULL;
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

void vertices_call(Worker *w, uint32_t n, uint64_t at) {
    Batch *b = &w->batch;
    batch_call(b, SLT_K_REGION, n);
    memcpy(w->hash + at, batch_out(b, SLT_OUT_HASH, 0), n * sizeof *w->hash);
    if (batch_has(b, SLT_OUT_FACE)) memcpy(w->face + at, batch_out(b, SLT_OUT_FACE, 0), n * sizeof *w->face);
    if (batch_has(b, SLT_OUT_DEPTH))
        for (uint32_t i = 0; i < n; i++) w->depth[at + i] = batch_get(b, SLT_OUT_DEPTH, 0, i);
    uint32_t nwitness = b->layout->out[SLT_OUT_WITNESS].count, loops = b->layout->out[SLT_OUT_NEAR_K].count;
    for (uint32_t k = 0; k < nwitness; k++)
        for (uint32_t i = 0; i < n; i++) w->witness[(at + i) * nwitness + k] = batch_get_int(b, SLT_OUT_WITNESS, k, i);
    if (!batch_has(b, SLT_OUT_NEAR_SITE)) return;
    const int32_t *site = batch_out(b, SLT_OUT_NEAR_SITE, 0);
    memcpy(w->near_event + at, site, n * sizeof *site);
    for (uint32_t i = 0; i < n; i++) {
        w->near_g[at + i] = (float)fabs(batch_get(b, SLT_OUT_NEAR_G, 0, i));
        w->near_key[at + i] = (uint32_t)site[i] * 0x9e3779b9u;
    }
    for (uint32_t d = 0; d < loops; d++) {
        const int32_t *k = batch_out(b, SLT_OUT_NEAR_K, d);
        memcpy(w->near_event + (d + 1) * w->vertex_cap + at, k, n * sizeof *k);
        for (uint32_t i = 0; i < n; i++)
            w->near_key[at + i] = (w->near_key[at + i] ^ (uint32_t)k[i]) * 0x85ebca6bu + 0x165667b1u;
    }
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
