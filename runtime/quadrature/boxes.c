/* Bounds of given boxes. A tile is TILE boxes: one call of `bounds`, then calls of `edge_bounds`, or of
 * `written_bounds`, one for each edge that is open in any of them. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/boxes.h"
#include "runtime/sample/alloc.h"
#include "runtime/sample/run.h"

enum { TILE = 128 }; /* TILE * SLT_MAX_OPEN events fit into one call */
_Static_assert(TILE *SLT_MAX_OPEN <= BATCH, "a tile's events are one batch");

typedef struct BoxWorker {
    Batch batch;
    BoxFacts facts[TILE];
    struct {
        uint32_t box, event;
    } asked[TILE * SLT_MAX_OPEN]; /* the lanes of a call of either */
} BoxWorker;

typedef struct Boxes {
    const SltScene *s;
    uint64_t n;
    const double *lo, *hi;
    BoxTake *take;
    void *user;
    BoxWorker *worker;
    SltKernelKind of_edge; /* which tells of g */
    SltStats stats;
} Boxes;

static uint32_t tile_size(const Boxes *q, uint64_t tile) {
    uint64_t left = q->n - tile * TILE;
    return left < TILE ? (uint32_t)left : TILE;
}

static void set_box(const Boxes *q, Batch *b, uint32_t lane, uint64_t box) {
    for (uint32_t d = 0; d < q->s->dim; d++) {
        batch_set(b, SLT_IN_X0 + d, lane, q->lo[box * q->s->dim + d]);
        batch_set(b, SLT_IN_H0 + d, lane, q->hi[box * q->s->dim + d]);
    }
}

/* The two ends of a bound of which the kernel may not know one or both. */
static void read_ends(const Batch *b, SltRole lo, SltRole hi, uint32_t k, uint32_t lane, double out[2]) {
    double l = batch_get(b, lo, k, lane), h = batch_get(b, hi, k, lane);
    bool known = l <= h;
    out[0] = known ? l : -INFINITY, out[1] = known ? h : INFINITY;
}

static void know_nothing(BoxFacts *f) {
    *f = (BoxFacts){.state = SLT_BOX_UNKNOWN};
    for (int c = 0; c < SLT_MAX_CHANNELS; c++) f->f[c][0] = -INFINITY, f->f[c][1] = INFINITY;
}

static void read_box(const SltScene *s, const Batch *b, uint32_t lane, BoxFacts *f) {
    *f = (BoxFacts){.state = batch_get_int(b, SLT_OUT_BOX_STATE, 0, lane)};
    for (uint32_t c = 0; c < s->channels; c++) read_ends(b, SLT_OUT_F_LO, SLT_OUT_F_HI, c, lane, f->f[c]);
    if (!batch_has(b, SLT_OUT_OPEN)) return; /* nothing in the program decides or bends */
    f->open = (uint32_t)batch_get_int(b, SLT_OUT_OPEN, 0, lane);
    uint32_t named = scene_outputs(s, SLT_K_BOUNDS, SLT_OUT_OPEN_EDGE);
    f->loops = named ? scene_outputs(s, SLT_K_BOUNDS, SLT_OUT_OPEN_K) / named : 0;
    for (uint32_t e = 0; e < named && e < f->open; e++) {
        BoxEvent *event = &f->event[e];
        int32_t edge = batch_get_int(b, SLT_OUT_OPEN_EDGE, e, lane);
        if (edge < 0) break;
        *event = (BoxEvent){.edge = edge, .g = {-INFINITY, INFINITY}};
        for (int d = 0; d < 3; d++) event->dg[d][0] = -INFINITY, event->dg[d][1] = INFINITY;
        for (uint32_t k = 0; k < f->loops; k++) event->k[k] = batch_get_int(b, SLT_OUT_OPEN_K, e * f->loops + k, lane);
        if (s->edge_kind && s->edge_kind[edge] != SLT_SITE_COMPARE && batch_has(b, SLT_OUT_OPEN_FIRST)) {
            event->first = batch_get(b, SLT_OUT_OPEN_FIRST, e, lane);
            event->last = batch_get(b, SLT_OUT_OPEN_LAST, e, lane);
        }
        Event line = {.site = edge};
        batch_read_line(b, e, lane, &line);
        memcpy(event->line, line.window, sizeof event->line);
        f->listed++;
    }
}

/* The bounds of g of every open event of this edge. */
static void ask_edge(const Boxes *q, BoxWorker *w, uint64_t first, uint32_t n, int32_t edge) {
    Batch *b = &w->batch;
    uint32_t lanes = 0;
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t e = 0; e < w->facts[i].listed; e++) {
            const BoxEvent *event = &w->facts[i].event[e];
            if (event->edge != edge) continue;
            set_box(q, b, lanes, first + i);
            for (uint32_t k = 0; k < w->facts[i].loops; k++) batch_set_int(b, SLT_IN_K0 + k, lanes, event->k[k]);
            batch_set(b, SLT_IN_BOUNDARY, lanes, event->first);
            for (uint32_t end = 0; end < 2; end++) batch_set(b, SLT_IN_WINDOW0 + end, lanes, event->line[end]);
            w->asked[lanes].box = i, w->asked[lanes++].event = e;
        }
    b->args.site = edge;
    batch_call(b, q->of_edge, lanes);
    for (uint32_t i = 0; i < lanes; i++) {
        BoxEvent *event = &w->facts[w->asked[i].box].event[w->asked[i].event];
        read_ends(b, SLT_OUT_G_LO, SLT_OUT_G_HI, 0, i, event->g);
        for (uint32_t d = 0; d < q->s->dim; d++) read_ends(b, SLT_OUT_DG_LO, SLT_OUT_DG_HI, d, i, event->dg[d]);
        event->state = batch_get_int(b, SLT_OUT_G_STATE, 0, i);
    }
}

/* The least edge above `above` that is open in any of the boxes; -1: none. */
static int32_t next_edge(const BoxWorker *w, uint32_t n, int32_t above) {
    int32_t least = -1;
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t e = 0; e < w->facts[i].listed; e++) {
            int32_t edge = w->facts[i].event[e].edge;
            if (edge > above && (least < 0 || edge < least)) least = edge;
        }
    return least;
}

static bool box_work(void *user, uint32_t worker, uint64_t tile) {
    Boxes *q = user;
    BoxWorker *w = &q->worker[worker];
    Batch *b = &w->batch;
    uint64_t first = tile * TILE;
    uint32_t n = tile_size(q, tile);
    if (!q->s->kernel[SLT_K_BOUNDS]) {
        for (uint32_t i = 0; i < n; i++) know_nothing(&w->facts[i]);
    } else {
        for (uint32_t i = 0; i < n; i++) set_box(q, b, i, first + i);
        batch_call(b, SLT_K_BOUNDS, n);
        for (uint32_t i = 0; i < n; i++) read_box(q->s, b, i, &w->facts[i]);
    }
    if (q->s->kernel[q->of_edge])
        for (int32_t edge = -1; (edge = next_edge(w, n, edge)) >= 0;) ask_edge(q, w, first, n, edge);
    for (uint32_t i = 0; i < n; i++) q->take(q->user, first + i, &w->facts[i]);
    return true;
}

static void box_merge(void *user, uint32_t worker, uint64_t tile) {
    Boxes *q = user;
    batch_collect(&q->worker[worker].batch, &q->stats);
    q->stats.boxes += tile_size(q, tile);
}

SltStatus slt_estimate_boxes(const SltScene *s, const SltJob *j, uint64_t n, const double *lo, const double *hi,
                             BoxTake *take, void *user, SltStats *stats, SltError *err) {
    Boxes q = {.s = s, .n = n, .lo = lo, .hi = hi, .take = take, .user = user};
    q.of_edge = s->kernel[SLT_K_WRITTEN_BOUNDS] ? SLT_K_WRITTEN_BOUNDS : SLT_K_EDGE_BOUNDS;
    uint64_t tiles = n / TILE + (n % TILE != 0);
    uint32_t threads = pool_threads(j->threads, tiles);
    double start = pool_now();
    PoolOptions o = pool_of_job(j, threads);
    q.worker = alloc_zero(threads, sizeof *q.worker);
    bool memory = q.worker != NULL;
    for (uint32_t t = 0; t < threads && memory; t++) memory = batch_init(&q.worker[t].batch, s, NULL);
    SltStatus st = memory ? pool_run(&o, tiles, box_work, box_merge, &q, err)
                          : status_fail(err, SLT_LIMIT, "out of memory for the boxes");
    for (uint32_t t = 0; t < threads && q.worker; t++) batch_free(&q.worker[t].batch);
    free(q.worker);
    q.stats.seconds = pool_now() - start;
    stats_add(stats, &q.stats);
    if (stats) stats->boxes = q.stats.boxes;
    return st;
}
