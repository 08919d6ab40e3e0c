/* f at given points. A tile is a batch of points. */
#include <stdlib.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/run.h"

typedef struct Points {
    const SltScene *s;
    const SltJob *j;
    uint64_t n;
    const double *x;
    const uint32_t *streams;
    double *out;
    Batch *batch; /* by worker */
    SltStats stats;
} Points;

static uint32_t tile_size(const Points *p, uint64_t tile) {
    uint64_t left = p->n - tile * BATCH;
    return left < BATCH ? (uint32_t)left : BATCH;
}

static bool point_work(void *user, uint32_t worker, uint64_t tile) {
    Points *p = user;
    const SltScene *s = p->s;
    Batch *b = &p->batch[worker];
    uint64_t first = tile * BATCH;
    uint32_t n = tile_size(p, tile);
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t d = 0; d < s->dim; d++) batch_set(b, SLT_IN_X0 + d, i, p->x[(first + i) * s->dim + d]);
        if (!s->uses_rand) continue;
        uint32_t word[4];
        rng_block(p->j->seed, RNG_POINT, 0, p->streams ? p->streams[first + i] : first + i, word);
        batch_set_stream(b, i, (int32_t)word[0], rng_unit(word[1]));
    }
    batch_call(b, SLT_K_VALUE, n);
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t c = 0; c < s->channels; c++)
            p->out[(first + i) * s->channels + c] = batch_get(b, SLT_OUT_F, c, i);
    return true;
}

static void point_merge(void *user, uint32_t worker, uint64_t tile) {
    Points *p = user;
    p->stats.samples += tile_size(p, tile);
    batch_collect(&p->batch[worker], &p->stats);
}

SltStatus slt_estimate_points(const SltScene *s, const SltJob *j, uint64_t n, const double *x, const uint32_t *streams,
                              double *out, SltStats *stats, SltError *err) {
    Points p = {.s = s, .j = j, .n = n, .x = x, .streams = streams, .out = out};
    uint64_t tiles = n / BATCH + (n % BATCH != 0);
    uint32_t threads = pool_threads(j->threads, tiles);
    double start = pool_now();
    PoolOptions o = pool_of_job(j, threads);
    p.batch = alloc_zero(threads, sizeof *p.batch);
    bool memory = p.batch != NULL;
    for (uint32_t t = 0; t < threads && memory; t++) memory = batch_init(&p.batch[t], s, NULL);
    SltStatus st = memory ? pool_run(&o, tiles, point_work, point_merge, &p, err)
                          : status_fail(err, SLT_LIMIT, "out of memory for the points");
    for (uint32_t t = 0; t < threads && p.batch; t++) batch_free(&p.batch[t]);
    free(p.batch);
    p.stats.seconds = p.stats.seconds_interior = pool_now() - start;
    stats_add(stats, &p.stats);
    return st;
}
