/* 8-bit pixels straight from the kernel: one sample in the middle of every pixel, strips of rows over threads.
 *
 * Lanes side by side are pixels of a row, written where they belong, whose y is read once; of a square where lanes
 * branch, since there neighbours branch otherwise less often than those of a row (back_share_row). Positions of columns
 * are made once, of rows once a strip.
 */
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"
#include "runtime/sample/prune.h"
#include "runtime/sample/run.h"

enum {
    SIDE = 8,      /* of a square; rows of a strip */
    CALL = 1024,   /* samples, of squares */
    CALL_ROW = 512 /* of a row: what a call costs against what its lanes of y do */
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
} PixelWorker;

typedef struct Pixels {
    SltProgram *p;
    const SltJob *job;
    uint32_t *out;
    bool squares, same_row, asks_pixels; /* same_row: a call is of one row, whose y it reads once */
    Columns in_row, in_squares;          /* lane (column / SIDE * SIDE + row) * SIDE + column % SIDE of a strip */
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

/* Of the lanes of a call, `rows` rows in the order of in_squares or one row. */
static void place_rows(const Pixels *q, PixelWorker *w, uint32_t first, uint32_t rows) {
    const size_t lanes = q->same_row ? SIDE : (rows > 1 ? CALL : CALL_ROW) + SLT_PAD, bytes = flt_bytes(q->p);
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

static void worker_free(PixelWorker *w) { free(w->y), free(w->z), free(w->zero), free(w->row); }

/* Samples of lanes from `lane` on. Kernels write whole vectors: there is room for SLT_PAD more. */
static void call(const Pixels *q, PixelWorker *w, const Columns *c, size_t lane, uint32_t n, uint32_t *out) {
    w->args.in[SLT_IN_X0] = c->x + lane * flt_bytes(q->p), w->args.in[SLT_IN_PIXEL0] = c->pixel + lane;
    w->args.out[0] = out;
    w->args.n_valid = n;
    q->p->scene.kernel[SLT_K_VALUE](&w->args, n);
}

static void run_squares(const Pixels *q, PixelWorker *w, uint32_t row) {
    const uint32_t width = q->job->size[0], columns = CALL / SIDE;
    place_rows(q, w, row, SIDE);
    for (uint32_t first = 0; first < width; first += columns) {
        uint32_t end = width - first < columns ? width : first + columns;
        call(q, w, &q->in_squares, (size_t)first * SIDE, (end - first) * SIDE, w->out);
        const uint32_t *from = w->out;
        for (uint32_t c = first; c < end; c += SIDE)
            for (uint32_t r = row; r < row + SIDE; r++, from += SIDE)
                memcpy(q->out + (size_t)r * width + c, from, SIDE * sizeof *from);
    }
}

static void run_row(const Pixels *q, PixelWorker *w, uint32_t row) {
    const uint32_t width = q->job->size[0];
    uint32_t *out = q->out + (size_t)row * width;
    place_rows(q, w, row, 1);
    for (uint32_t first = 0; first < width; first += CALL_ROW) {
        uint32_t n = width - first < CALL_ROW ? width - first : CALL_ROW, rest = n % q->p->scene.widest;
        if (n > rest) call(q, w, &q->in_row, first, n - rest, out + first);
        if (!rest) continue;
        call(q, w, &q->in_row, first + n - rest, rest, w->out);
        memcpy(out + first + n - rest, w->out, rest * sizeof *out);
    }
}

static bool work(void *user, uint32_t worker, uint64_t strip) {
    const Pixels *q = user;
    uint32_t row = (uint32_t)strip * SIDE, height = q->job->size[1], rows = height - row < SIDE ? height - row : SIDE;
    if (q->squares && rows == SIDE) run_squares(q, &q->worker[worker], row);
    else
        for (uint32_t r = row; r < row + rows; r++) run_row(q, &q->worker[worker], r);
    return true;
}

static void merge(void *user, uint32_t worker, uint64_t tile) { (void)user, (void)worker, (void)tile; }

static SltStatus render(SltProgram *p, const SltJob *job, uint32_t *pixels, SltStats *stats, SltError *err) {
    uint64_t strips = (job->size[1] + SIDE - 1) / SIDE;
    Pixels q = {.p = p, .job = job, .out = pixels};
    q.same_row = p->fn[K_VALUE]->same;
    q.squares = !q.same_row && job->size[0] % SIDE == 0 &&
                !ir_has(p->fn[K_VALUE]->body, OP_print); /* what is printed comes row by row */
    q.asks_pixels = p->scene.layout[SLT_K_VALUE].reads >> SLT_IN_PIXEL0 & 3;
    uint32_t threads = pool_threads(job->threads, strips);
    q.worker = aligned_alloc(64, threads * sizeof *q.worker);
    bool ok = q.worker && place_row(&q, &q.in_row) && (!q.squares || place_squares(&q, &q.in_row, &q.in_squares));
    if (q.worker) memset(q.worker, 0, threads * sizeof *q.worker);
    for (uint32_t t = 0; ok && t < threads; t++) ok = worker_init(&q, &q.worker[t]);
    double start = pool_now();
    PoolOptions o = pool_of_job(job, threads);
    SltStatus s = ok ? pool_run(&o, strips, work, merge, &q, err) : status_fail(err, SLT_LIMIT, "out of memory");
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
    if (s == SLT_OK) s = api_kernels(p, needs, err); /* pixels of a row share what its IR says */
    bool squares = s == SLT_OK && p->scene.dim == 2 && prune_can(&p->scene);
    if (s == SLT_OK) s = (squares ? api_render_squares : render)(p, &c.job, pixels, c.stats, err);
    return api_call_end(&c, s);
}
