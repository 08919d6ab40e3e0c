/* One call: Run is what all its threads share, Worker what each has for itself.
 *
 * Run and SltScene are read-only while tiles are worked on; a worker writes to itself alone (or to pixels that its tile
 * owns), and results are added in `merge`, in the order of tiles: the same bits from any number of threads. */
#ifndef SALTUS_SAMPLE_RUN_H
#define SALTUS_SAMPLE_RUN_H

#include "runtime/base/threads.h"
#include "runtime/sample/cull.h"
#include "runtime/sample/narrow.h"
#include "runtime/sample/prune.h"
#include "runtime/sample/sink.h"
#include "runtime/sample/tails.h"

struct Worker {
    Batch batch;
    Accum acc;
    Finder finder;
    Sink sink;
    CullLists cull;
    Pruner pruner; /* its c is NULL: not made yet */
    /* By vertex of a tile or of lines; NULL where the region kernel does not give it. */
    uint32_t *hash;
    uint32_t *face;
    double *depth;
    int32_t *witness;    /* [vertex][witnesses of region] */
    float *near_g;       /* |g| of the nearest event */
    uint32_t *near_key;  /* a hash that tells nearest events apart */
    int32_t *near_event; /* [1 + SLT_MAX_K][vertex_cap]: site and loop indices of the nearest event */
    uint8_t *settled;    /* bits (1 << axis): nothing can jump on the edge that starts here */
    uint8_t *ask;        /* ask.h */
    uint64_t vertex_cap; /* vertices that there is room for */
    double *value;       /* pixels or sums of the tile */
    uint64_t value_cap;
    struct Probes *probes; /* candidates of near.c; NULL: none so far */
    Follow *follow;        /* NULL: fingers are not followed */
    TailTile tail;         /* of interior_integral */
    Narrowed narrow;       /* lists of its parts, */
    uint32_t strip;        /* which are so many rows of pixels, or vertices */
};

struct Run {
    const SltScene *s;
    const SltJob *j;
    Grid grid;
    CullBoxes cull;
    Worker *worker;
    uint32_t threads, nworkers;
    uint32_t most; /* samples of a call of the workers; 0: BATCH */
    bool spares; /* run_workers makes more of them than threads: tiles whose turn to be merged has not come keep some */
    PoolOptions pool;
    bool proven;   /* lines had no gaps (prove.h) in some tile: what was missed says what is still missing */
    Apart *apart;  /* for coincide.c; NULL: boundaries that coincide are not looked for */
    uint8_t *tied; /* [sites]: twins.c; NULL: no site has a twin, or it was not asked so far */
    bool tied_known;
    uint64_t followed; /* crossings found along fingers */
    uint8_t *met;      /* [sites]: 1 where lines have met a crossing; NULL: nobody asks */
    SltStats stats;    /* counts of the tiles merged so far */
    Sizes kept, gone;  /* likewise; see Finder */
    uint64_t steep, rims;
    double gone_along[SLT_MAX_CHANNELS], parts_gone; /* likewise: Sink.gone, Finder.parts_gone */
    SltError *err;
    double start; /* by pool_now() */
};
/* The pool of a job that starts now, with so many threads: its deadline, cancel and progress. */
PoolOptions pool_of_job(const SltJob *j, uint32_t threads);
SltStatus run_begin(Run *r, const SltScene *s, const SltJob *j, SltError *err);
/* Adds the run's counts to `stats` (may be NULL) and frees everything. */
void run_end(Run *r, SltStats *stats);
/* After lines: where few of their crossings told of boundaries that coincide they are not counted as such: edges that
 * are almost one, as of faces seen at a grazing angle, lie nearer to each other than parameters were moved. What these
 * may err by is stated all the same. */
void run_forget_few(Run *r);
/* to may be NULL. stats_of_cells: only the members about cells, which are not added up. */
void stats_add(SltStats *to, const SltStats *s);
void stats_of_cells(SltStats *to, const SltStats *s);
/* Makes workers, with `accums` adjoint buffers and, but for SINK_NONE, a finder and a sink. */
SltStatus run_workers(Run *r, uint64_t tiles, uint32_t accums, SinkKind kind);
void run_free_workers(Run *r);
/* Are these rays in an image, whose roots need not be finer than the pixels show? */
bool run_is_coarse(const Run *r);
/* Do so many samples take longer than a thread takes to begin, and its worker? */
bool run_is_long(const Run *r, double samples);
/* pool_run with the run's options; user goes to work and merge. */
SltStatus run_tiles(Run *r, uint64_t tiles, PoolWork *work, PoolMerge *merge, void *user);
/* In `merge`: the worker's counters join the run's. */
void run_collect(Run *r, Worker *w);
/* Room for n vertices; for n values, set to 0. False when memory runs out. */
bool worker_vertices(Worker *w, uint64_t n);
bool worker_values(Worker *w, uint64_t n);
static inline Mark worker_mark(const Worker *w, uint64_t vertex) {
    Mark m = {.hash = w->hash[vertex], .face = w->face ? w->face[vertex] : 0, .depth = w->depth ? w->depth[vertex] : 0};
    const uint32_t n = w->witness ? scene_outputs(w->batch.s, SLT_K_REGION, SLT_OUT_WITNESS) : 0;
    for (uint32_t k = 0; k < n; k++) m.witness[k] = w->witness[vertex * n + k];
    return m;
}
/* Do rays of the two hit different faces of meshes? */
static inline bool worker_faces_differ(const Worker *w, uint64_t a, uint64_t b) {
    return w->face && w->face[a] != w->face[b];
}
/* Evaluates region on n samples of the batch, which are the vertices from `at` on. */
void vertices_call(Worker *w, uint32_t n, uint64_t at);

#endif
