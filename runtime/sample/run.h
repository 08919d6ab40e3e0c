/* A call: what all its threads share, and what each has for itself.
 *
 * Run and Scene are read-only while tiles are worked on; a worker writes to itself alone (or to pixels that its tile
 * owns), and results are added in `merge`, in the order of tiles: the same bits from any number of threads. */
#ifndef SALTUS_SAMPLE_RUN_H
#define SALTUS_SAMPLE_RUN_H

#include "runtime/base/threads.h"
#include "runtime/sample/cull.h"
#include "runtime/sample/sink.h"

struct Worker {
    Batch batch;
    Accum acc;
    Finder finder;
    Sink sink;
    CullLists cull;
    uint32_t *hash;   /* of a tile of vertices, or of lines */
    double *depth;    /* NULL without depth */
    int32_t *witness; /* [vertex][of region]; NULL without */
    float *near_g;    /* |g| of the nearest event, its key */
    uint32_t *near_key;
    int32_t *near_event; /* site, k0.. of it, SoA by vertex */
    uint64_t vertex_cap;
    double *value; /* of the tile: pixels or sums */
    uint64_t value_cap;
    struct Probes *probes; /* candidates of near.c */
    Follow *follow;        /* NULL: off */
};

struct Run {
    const SltScene *s;
    const SltJob *j;
    Grid grid;
    CullBoxes cull;
    Worker *worker;
    uint32_t nworkers;
    PoolOptions pool;
    Moved *apart;   /* [COINCIDE_WAYS] */
    SltStats stats; /* added to by merge */
    SltError *err;
    double start;
};
SltStatus run_begin(Run *r, const SltScene *s, const SltJob *j, SltError *err);
/* Adds the run's counts to `stats` (may be NULL) and frees everything. */
void run_end(Run *r, SltStats *stats);
void stats_add(SltStats *to, const SltStats *s); /* to may be NULL */
/* Workers with `accums` adjoint buffers and a sink. */
SltStatus run_workers(Run *r, uint64_t tiles, uint32_t accums, SinkKind kind);
void run_free_workers(Run *r);
/* Rays in an image, whose roots need not be finer than the pixels show. */
bool run_is_coarse(const Run *r);
SltStatus run_tiles(Run *r, uint64_t tiles, PoolWork *work, PoolMerge *merge, void *user);
/* In `merge`: the worker's counters join the run's. */
void run_collect(Run *r, Worker *w);
bool worker_vertices(Worker *w, uint64_t n);
Mark worker_mark(const Worker *w, uint64_t vertex);
bool worker_values(Worker *w, uint64_t n);
/* Evaluates region on n samples of the batch: they are the vertices from `at` on. */
void vertices_call(Worker *w, uint32_t n, uint64_t at);

#endif
