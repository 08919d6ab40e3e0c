/* 8-bit pixels straight from the kernel: one sample in the middle of every pixel, strips of rows over threads.
 *
 * Lanes side by side are pixels of a square, since where neighbours branch otherwise those of a row do so more often.
 */
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"
#include "runtime/sample/prune.h"
#include "runtime/sample/run.h"

enum { SIDE = 8 /* of a square; rows of a strip */, CALL = 1024 /* samples */ };

/* The samples of one call. Positions are those of the scene's precision. */
typedef struct PixelWorker {
    void *x[3], *zero;
    int32_t *pixel[2];
    uint32_t out[CALL + SLT_PAD] __attribute__((aligned(64)));
    SltKernelArgs args;
} PixelWorker;

typedef struct Pixels {
    SltProgram *p;
    const SltJob *job;
    uint32_t *out;
    bool squares, asks_pixels;
    void *middle; /* [width] of the columns */
    PixelWorker *worker;
} Pixels;

double api_middle(const SltProgram *p, const SltJob *job, uint32_t axis, uint32_t cell) {
    const Program *g = p->prog;
    return g->lo[axis] + (cell + 0.5) * ((g->hi[axis] - g->lo[axis]) / job->size[axis]); /* as grid_middle */
}

static void set(const SltProgram *p, void *a, uint32_t i, double v) {
    if (p->opt.f64) ((double *)a)[i] = v;
    else ((float *)a)[i] = (float)v;
}

/* Everything that a call reads is a number, also where nobody looks. */
static bool worker_init(const Pixels *q, PixelWorker *w) {
    enum { LANES = CALL + SLT_PAD };
    bool ok = true;
    for (int d = 0; d < 3; d++) ok &= (w->x[d] = aligned_alloc(64, LANES * sizeof(double))) != NULL;
    for (int d = 0; d < 2; d++) ok &= (w->pixel[d] = aligned_alloc(64, LANES * sizeof(int32_t))) != NULL;
    ok &= (w->zero = aligned_alloc(64, LANES * sizeof(double))) != NULL;
    if (!ok) return false;
    memset(w->zero, 0, LANES * sizeof(double));
    for (int d = 0; d < 2; d++) memset(w->pixel[d], 0, LANES * sizeof(int32_t));
    for (uint32_t d = 0; d < 3; d++)
        for (uint32_t i = 0; i < LANES; i++) set(q->p, w->x[d], i, api_middle(q->p, q->job, d, 0));
    for (int s = 0; s < SLT_IN_VARYING; s++) w->args.in[s] = w->zero;
    for (int d = 0; d < 3; d++) w->args.in[IN_X0 + d] = w->x[d];
    w->args.in[IN_PIXEL0] = w->pixel[0], w->args.in[IN_PIXEL1] = w->pixel[1];
    w->args.out[0] = w->out;
    w->args.params = q->p->flt, w->args.iparams = q->p->scene.iparams, w->args.geometries = q->p->scene.geometries;
    w->args.resolution[0] = (int32_t)q->job->size[0], w->args.resolution[1] = (int32_t)q->job->size[1];
    return true;
}

static void worker_free(PixelWorker *w) {
    for (int d = 0; d < 3; d++) free(w->x[d]);
    for (int d = 0; d < 2; d++) free(w->pixel[d]);
    free(w->zero);
}

/* A stretch of `across` columns of `rows` rows, square by square, each row by row: lane
 * (square * rows + row) * SIDE + column. One row is in order. */
typedef struct Stretch {
    uint32_t first, across, row, rows;
} Stretch;

/* n numbers, nearly always SIDE of them: then the compiler knows how many. */
#define COPY(to, from, n)                                                                                              \
    ((n) == SIDE ? memcpy((to), (from), SIDE * sizeof *(to)) : memcpy((to), (from), (n) * sizeof *(to)))

static uint32_t left(const Stretch *s, uint32_t column) {
    return s->across - column < SIDE ? s->across - column : SIDE;
}

#define PLACE_COLUMNS(name, T)                                                                                         \
    static void name(const Stretch *s, const T *middle, T *x) {                                                        \
        for (uint32_t c = 0; c < s->across; c += SIDE)                                                                 \
            for (uint32_t r = 0, n = left(s, c); r < s->rows; r++, x += n) COPY(x, middle + s->first + c, n);          \
    }
PLACE_COLUMNS(place_f32, float)
PLACE_COLUMNS(place_f64, double)

static void place_pixels(const Stretch *s, int32_t *at) {
    for (uint32_t c = 0; c < s->across; c += SIDE)
        for (uint32_t r = 0; r < s->rows; r++)
            for (uint32_t k = 0; k < left(s, c); k++) *at++ = (int32_t)(s->first + c + k);
}

static void take_pixels(const Stretch *s, const uint32_t *from, uint32_t *image, uint32_t width) {
    for (uint32_t c = 0; c < s->across; c += SIDE)
        for (uint32_t r = 0, n = left(s, c); r < s->rows; r++, from += n)
            COPY(image + (size_t)(s->row + r) * width + s->first + c, from, n);
}

/* Of lanes in the order of a stretch. */
static void place_rows(const Pixels *q, PixelWorker *w, const Stretch *s, uint32_t lanes) {
    for (uint32_t i = 0; i < lanes; i += SIDE) {
        uint32_t row = s->row + i / SIDE % s->rows;
        double y = api_middle(q->p, q->job, 1, q->job->size[1] - 1 - row);
        for (uint32_t k = i; k < i + SIDE; k++) set(q->p, w->x[1], k, y), w->pixel[1][k] = (int32_t)row;
    }
}

static void run_stretch(const Pixels *q, PixelWorker *w, const Stretch *s) {
    if (q->p->opt.f64) place_f64(s, q->middle, w->x[0]);
    else place_f32(s, q->middle, w->x[0]);
    if (q->asks_pixels) place_pixels(s, w->pixel[0]);
    w->args.n_valid = s->across * s->rows;
    q->p->scene.kernel[SLT_K_VALUE](&w->args, s->across * s->rows);
    take_pixels(s, w->out, q->out, q->job->size[0]);
}

static void run_rows(const Pixels *q, PixelWorker *w, uint32_t row, uint32_t rows) {
    const uint32_t width = q->job->size[0], columns = CALL / rows;
    Stretch s = {.row = row, .rows = rows};
    place_rows(q, w, &s, CALL);
    for (s.first = 0; s.first < width; s.first += columns) {
        s.across = width - s.first < columns ? width - s.first : columns;
        run_stretch(q, w, &s);
    }
}

static bool work(void *user, uint32_t worker, uint64_t strip) {
    const Pixels *q = user;
    uint32_t row = (uint32_t)strip * SIDE, height = q->job->size[1], rows = height - row < SIDE ? height - row : SIDE;
    if (q->squares && rows == SIDE) run_rows(q, &q->worker[worker], row, SIDE);
    else
        for (uint32_t r = row; r < row + rows; r++) run_rows(q, &q->worker[worker], r, 1);
    return true;
}

static void merge(void *user, uint32_t worker, uint64_t tile) { (void)user, (void)worker, (void)tile; }

static SltStatus render(SltProgram *p, const SltJob *job, uint32_t *pixels, SltStats *stats, SltError *err) {
    uint64_t strips = (job->size[1] + SIDE - 1) / SIDE;
    Pixels q = {.p = p, .job = job, .out = pixels};
    q.squares =
        job->size[0] % SIDE == 0 && !ir_has(p->fn[K_VALUE]->body, OP_print); /* what is printed comes row by row */
    q.asks_pixels = p->scene.layout[SLT_K_VALUE].reads >> SLT_IN_PIXEL0 & 1;
    uint32_t threads = pool_threads(job->threads, strips);
    q.worker = aligned_alloc(64, threads * sizeof *q.worker);
    q.middle = malloc(job->size[0] * sizeof(double));
    bool ok = q.worker && q.middle;
    if (q.worker) memset(q.worker, 0, threads * sizeof *q.worker);
    for (uint32_t i = 0; ok && i < job->size[0]; i++) set(p, q.middle, i, api_middle(p, job, 0, i));
    for (uint32_t t = 0; ok && t < threads; t++) ok = worker_init(&q, &q.worker[t]);
    double start = pool_now();
    PoolOptions o = pool_of_job(job, threads);
    SltStatus s = ok ? pool_run(&o, strips, work, merge, &q, err) : status_fail(err, SLT_LIMIT, "out of memory");
    if (stats) stats->samples += (uint64_t)job->size[0] * job->size[1], stats->seconds += pool_now() - start;
    for (uint32_t t = 0; q.worker && t < threads; t++) worker_free(&q.worker[t]);
    free(q.worker);
    free(q.middle);
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
    if (s == SLT_OK) s = api_call_kernels(&c, needs);
    bool squares = s == SLT_OK && p->scene.dim == 2 && prune_can(&p->scene);
    if (s == SLT_OK) s = (squares ? api_render_squares : render)(p, &c.job, pixels, c.stats, err);
    return api_call_end(&c, s);
}
