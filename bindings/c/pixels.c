/* 8-bit pixels straight from the kernel: one sample in the middle of every pixel, strips of rows over threads.
 *
 * Lanes side by side are pixels of a row, written where they belong, whose y is read once; of a square where lanes
 * branch, since there neighbours branch otherwise less often than those of a row (back_share_row). Positions of columns
 * are made once, of rows once a strip.
 */
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"
#include "bindings/c/listed.h"
#include "runtime/sample/prune.h"
#include "runtime/sample/run.h"

enum {
    SIDE = PIXEL_SIDE, /* of a square; rows of a strip */
    CALL = 1024,       /* samples, of squares */
    CALL_ROW = 512     /* of a row: what a call costs against what its lanes of y do */
};

/* Positions along x and pixels of lanes, for the whole width. Positions are those of the scene's precision. */
typedef struct Columns {
    size_t lanes;
    char *x;
    int32_t *pixel;
} Columns;

/* The samples of one call. */
typedef struct PixelWorker {
    void *y, *z, *zero;
    int32_t *row;
    uint32_t out[CALL + SLT_PAD] __attribute__((aligned(64)));
    SltKernelArgs args;
    Listed *listed;              /* NULL: there are no lists */
    uint32_t word[LISTED_PARTS]; /* of parts of a tile that are flat: all their pixels */
} PixelWorker;

typedef struct Pixels {
    SltProgram *p;
    const SltJob *job;
    uint32_t *out;
    bool squares, same_row, asks_pixels; /* same_row: a call is of one row, whose y it reads once */
    Columns in_row, in_squares;          /* lane (column / SIDE * SIDE + row) * SIDE + column % SIDE of a strip */
    bool listed;                         /* tiles, with lists of what can matter in their parts */
    PixelWorker *worker;
} Pixels;

double api_middle(const SltProgram *p, const SltJob *job, uint32_t axis, uint32_t cell) {
    const Program *g = p->prog;
    return g->lo[axis] + (cell + 0.5) * ((g->hi[axis] - g->lo[axis]) / job->size[axis]); /* as grid_middle */
}

static void set(const SltProgram *p, void *a, size_t i, double v) {
    if (p->opt.f64) ((double *)a)[i] = v;
    else ((float *)a)[i] = (float)v;
}

static size_t flt_bytes(const SltProgram *p) { return p->opt.f64 ? sizeof(double) : sizeof(float); }

/* Everything that a call reads is a number, also where nobody looks. */
static bool make_columns(const Pixels *q, Columns *c, uint32_t rows) {
    c->lanes = (size_t)q->job->size[0] * rows + SLT_PAD;
    c->x = aligned_alloc(64, (c->lanes * sizeof(double) + 63) / 64 * 64);
    c->pixel = aligned_alloc(64, (c->lanes * sizeof(int32_t) + 63) / 64 * 64);
    return c->x && c->pixel;
}

static bool place_row(const Pixels *q, Columns *c) {
    if (!make_columns(q, c, 1)) return false;
    for (uint32_t i = 0; i < c->lanes; i++)
        set(q->p, c->x, i, api_middle(q->p, q->job, 0, i)), c->pixel[i] = (int32_t)i;
    return true;
}

/* The columns of each square SIDE times. */
static bool place_squares(const Pixels *q, const Columns *row, Columns *c) {
    if (!make_columns(q, c, SIDE)) return false;
    const size_t bytes = SIDE * flt_bytes(q->p);
    for (size_t i = 0; i < c->lanes / SIDE; i++) {
        size_t from = i / SIDE;
        memcpy(c->x + i * bytes, row->x + from * bytes, bytes);
        memcpy(c->pixel + i * SIDE, row->pixel + from * SIDE, SIDE * sizeof *c->pixel);
    }
    return true;
}

/* Of the lanes of calls of so many columns, `rows` rows in the order of in_squares or one row. */
static void place_rows(const Pixels *q, PixelWorker *w, uint32_t first, uint32_t rows, uint32_t columns) {
    const size_t most = rows > 1 ? CALL : CALL_ROW, wanted = (size_t)rows * columns, bytes = flt_bytes(q->p),
                 lanes = q->same_row ? SIDE : (wanted < most ? wanted : most) + SLT_PAD;
    for (uint32_t r = 0; r < rows; r++) {
        double y = api_middle(q->p, q->job, 1, q->job->size[1] - 1 - first - r);
        for (uint32_t k = r * SIDE; k < r * SIDE + SIDE; k++) set(q->p, w->y, k, y), w->row[k] = (int32_t)(first + r);
    }
    for (size_t n = (size_t)rows * SIDE, more; n < lanes; n += more) {
        more = n < lanes - n ? n : lanes - n;
        memcpy((char *)w->y + n * bytes, w->y, more * bytes);
        if (q->asks_pixels) memcpy(w->row + n, w->row, more * sizeof *w->row);
    }
}

static bool worker_init(const Pixels *q, PixelWorker *w) {
    enum { LANES = CALL + SLT_PAD };
    if (q->listed && (!(w->listed = calloc(1, sizeof *w->listed)) || !listed_init(w->listed, q->p, q->job)))
        return false;
    w->y = aligned_alloc(64, LANES * sizeof(double)), w->z = aligned_alloc(64, LANES * sizeof(double));
    w->zero = aligned_alloc(64, LANES * sizeof(double)), w->row = aligned_alloc(64, LANES * sizeof(int32_t));
    if (!w->y || !w->z || !w->zero || !w->row) return false;
    memset(w->zero, 0, LANES * sizeof(double));
    memset(w->row, 0, LANES * sizeof *w->row);
    for (uint32_t i = 0; i < LANES; i++) set(q->p, w->z, i, api_middle(q->p, q->job, 2, 0));
    for (int s = 0; s < SLT_IN_VARYING; s++) w->args.in[s] = w->zero;
    w->args.in[SLT_IN_X1] = w->y, w->args.in[SLT_IN_X2] = w->z, w->args.in[SLT_IN_PIXEL1] = w->row;
    w->args.params = q->p->flt, w->args.iparams = q->p->scene.iparams, w->args.geometries = q->p->scene.geometries;
    w->args.resolution[0] = (int32_t)q->job->size[0], w->args.resolution[1] = (int32_t)q->job->size[1];
    return true;
}

static void worker_free(PixelWorker *w) {
    if (w->listed) listed_free(w->listed);
    free(w->listed), free(w->y), free(w->z), free(w->zero), free(w->row);
}

/* Samples of lanes from `lane` on. Kernels write whole vectors: there is room for SLT_PAD more. */
static void call(const Pixels *q, PixelWorker *w, const Columns *c, size_t lane, uint32_t n, uint32_t *out) {
    w->args.in[SLT_IN_X0] = c->x + lane * flt_bytes(q->p), w->args.in[SLT_IN_PIXEL0] = c->pixel + lane;
    w->args.out[0] = out;
    w->args.n_valid = n;
    q->p->scene.kernel[SLT_K_VALUE](&w->args, n);
}

/* Columns from `column` on up to the one before `beyond`. */
static void run_squares(const Pixels *q, PixelWorker *w, uint32_t row, uint32_t column, uint32_t beyond) {
    const uint32_t width = q->job->size[0], columns = CALL / SIDE;
    for (uint32_t first = column; first < beyond; first += columns) {
        uint32_t end = beyond - first < columns ? beyond : first + columns;
        call(q, w, &q->in_squares, (size_t)first * SIDE, (end - first) * SIDE, w->out);
        const uint32_t *from = w->out;
        for (uint32_t c = first; c < end; c += SIDE)
            for (uint32_t r = row; r < row + SIDE; r++, from += SIDE)
                memcpy(q->out + (size_t)r * width + c, from, SIDE * sizeof *from);
    }
}

/* The same of a part that is flat: the first square tells. */
static void fill_squares(const Pixels *q, PixelWorker *w, uint32_t row, const PixelPart *part, uint32_t i) {
    const uint32_t width = q->job->size[0], column = part->first[0];
    if (row == part->first[1]) {
        call(q, w, &q->in_squares, (size_t)column * SIDE, SIDE * SIDE, w->out);
        w->word[i] = w->out[0];
    }
    for (uint32_t r = row; r < row + SIDE; r++) {
        uint32_t *to = q->out + (size_t)r * width + column;
        for (uint32_t c = 0; c < part->n[0]; c++) to[c] = w->word[i];
    }
}

static void run_row(const Pixels *q, PixelWorker *w, uint32_t row, uint32_t column, uint32_t beyond) {
    uint32_t *out = q->out + (size_t)row * q->job->size[0];
    for (uint32_t first = column; first < beyond; first += CALL_ROW) {
        uint32_t n = beyond - first < CALL_ROW ? beyond - first : CALL_ROW, rest = n % q->p->scene.widest;
        if (n > rest) call(q, w, &q->in_row, first, n - rest, out + first);
        if (!rest) continue;
        call(q, w, &q->in_row, first + n - rest, rest, w->out);
        memcpy(out + first + n - rest, w->out, rest * sizeof *out);
    }
}

/* Rows of parts that lie side by side, all as wide as the first or less; `first`: its number, of lists. */
static void run_rows(const Pixels *q, PixelWorker *w, uint32_t row, uint32_t rows, const PixelPart *part, uint32_t n,
                     uint32_t first) {
    const bool squares = q->squares && rows == SIDE;
    const uint32_t step = squares ? SIDE : 1;
    for (uint32_t r = row; r < row + rows; r += step) {
        place_rows(q, w, r, step, part->n[0]);
        for (uint32_t i = 0; i < n; i++) {
            if (q->listed) w->args.cull = listed_part(w->listed, first + i);
            if (squares && q->listed && w->listed->flat >> (first + i) & 1) fill_squares(q, w, r, &part[i], first + i);
            else (squares ? run_squares : run_row)(q, w, r, part[i].first[0], part[i].first[0] + part[i].n[0]);
        }
    }
}

static uint32_t least(uint32_t a, uint32_t b) { return a < b ? a : b; }

static bool run_strip(const Pixels *q, PixelWorker *w, uint64_t strip) {
    const uint32_t row = (uint32_t)strip * SIDE;
    const PixelPart all = {.first = {0, row}, .n = {q->job->size[0], least(q->job->size[1] - row, SIDE)}};
    run_rows(q, w, row, all.n[1], &all, 1, 0);
    return true;
}

static bool run_tile(const Pixels *q, PixelWorker *w, uint64_t tile) {
    const uint32_t across = (q->job->size[0] + LISTED_TILE - 1) / LISTED_TILE;
    PixelPart all = {.first = {(uint32_t)(tile % across) * LISTED_TILE, (uint32_t)(tile / across) * LISTED_TILE}},
              part[LISTED_PARTS];
    for (uint32_t d = 0; d < 2; d++) all.n[d] = least(q->job->size[d] - all.first[d], LISTED_TILE);
    const uint32_t n = listed_tile(w->listed, q->p, q->job, &all, part),
                   side_by_side = (all.n[0] + LISTED_PART - 1) / LISTED_PART;
    for (uint32_t i = 0; i < n; i += side_by_side)
        for (uint32_t row = 0; row < part[i].n[1]; row += SIDE)
            run_rows(q, w, part[i].first[1] + row, least(part[i].n[1] - row, SIDE), &part[i], side_by_side, i);
    return n > 0;
}

static bool work(void *user, uint32_t worker, uint64_t at) {
    const Pixels *q = user;
    return (q->listed ? run_tile : run_strip)(q, &q->worker[worker], at);
}

static void merge(void *user, uint32_t worker, uint64_t tile) { (void)user, (void)worker, (void)tile; }

static SltStatus render(SltProgram *p, const SltJob *job, uint32_t *pixels, SltStats *stats, SltError *err) {
    Pixels q = {.p = p, .job = job, .out = pixels};
    q.same_row = p->fn[K_VALUE]->same;
    q.squares = !q.same_row && job->size[0] % SIDE == 0 &&
                !ir_has(p->fn[K_VALUE]->body, OP_print); /* what is printed comes row by row */
    q.listed = q.squares && listed_serves(p, job);
    const uint64_t strips = (job->size[1] + SIDE - 1) / SIDE, across = (job->size[0] + LISTED_TILE - 1) / LISTED_TILE,
                   down = (job->size[1] + LISTED_TILE - 1) / LISTED_TILE, items = q.listed ? across * down : strips;
    q.asks_pixels = p->scene.layout[SLT_K_VALUE].reads >> SLT_IN_PIXEL0 & 3;
    uint32_t threads = pool_threads(job->threads, items);
    q.worker = aligned_alloc(64, threads * sizeof *q.worker);
    bool ok = q.worker && place_row(&q, &q.in_row) && (!q.squares || place_squares(&q, &q.in_row, &q.in_squares));
    if (q.worker) memset(q.worker, 0, threads * sizeof *q.worker);
    for (uint32_t t = 0; ok && t < threads; t++) ok = worker_init(&q, &q.worker[t]);
    double start = pool_now();
    PoolOptions o = pool_of_job(job, threads);
    SltStatus s = ok ? pool_run(&o, items, work, merge, &q, err) : status_fail(err, SLT_LIMIT, "out of memory");
    uint64_t all = 0, kept = 0;
    for (uint32_t t = 0; s == SLT_OK && q.listed && t < threads; t++)
        all += q.worker[t].listed->all, kept += q.worker[t].listed->kept;
    if (all) listed_judge(p, all, kept);
    if (stats) stats->samples += (uint64_t)job->size[0] * job->size[1], stats->seconds += pool_now() - start;
    for (uint32_t t = 0; q.worker && t < threads; t++) worker_free(&q.worker[t]);
    free(q.worker);
    free(q.in_row.x), free(q.in_row.pixel), free(q.in_squares.x), free(q.in_squares.pixel);
    return s;
}

SltStatus slt_render_rgba8(SltProgram *p, const SltJob *job, uint32_t *pixels, SltStats *stats, SltError *err) {
    static const bool needs[K_KINDS] = {[K_VALUE] = true, [K_PRUNE] = true, [K_PRUNED] = true};
    ApiCall c;
    SltStatus s = api_call_begin(&c, p, job, stats, err);
    if (s == SLT_OK && (p->opt.interpret || !p->opt.rgba8))
        s = status_fail(err, SLT_USAGE, "8-bit pixels need a program compiled with rgba8, and no interpreter");
    if (s == SLT_OK && (p->prog->dim == 3 || p->prog->uses_rand))
        s = status_fail(err, SLT_USAGE, "8-bit pixels are for 1D and 2D domains without rand()");
    if (s == SLT_OK) s = api_site_facts(p, err);
    if (s == SLT_OK && api_wants_lists(p, &c.job) && !api_lists_begin(p)) listed_judge(p, 1, 1);
    if (s == SLT_OK) s = api_kernels(p, needs, err); /* pixels of a row share what its IR says */
    bool squares = s == SLT_OK && p->scene.dim == 2 && prune_can(&p->scene);
    if (s == SLT_OK) s = (squares ? api_render_squares : render)(p, &c.job, pixels, c.stats, err);
    return api_call_end(&c, s);
}
