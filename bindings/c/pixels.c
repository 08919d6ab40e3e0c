/* 8-bit pixels straight from the kernel: one sample in the middle of every pixel, rows over threads. */
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"
#include "runtime/sample/prune.h"
#include "runtime/sample/run.h"

enum { ROWS = 8 };

typedef struct PixelWorker {
    void *x[3];
    int32_t *pixel[2], *zero;
    uint32_t *out;
    SltKernelArgs args;
} PixelWorker;

typedef struct Pixels {
    SltProgram *p;
    const SltJob *job;
    uint32_t *out;
    PixelWorker *worker;
} Pixels;

static void set(const SltProgram *p, void *a, uint32_t i, double v) {
    if (p->opt.f64) ((double *)a)[i] = v;
    else ((float *)a)[i] = (float)v;
}

static void set_all(const SltProgram *p, void *a, uint32_t n, double v) {
    const float narrow = (float)v;
    if (p->opt.f64)
        for (uint32_t i = 0; i < n; i++) ((double *)a)[i] = v;
    else
        for (uint32_t i = 0; i < n; i++) ((float *)a)[i] = narrow;
}

double api_middle(const SltProgram *p, const SltJob *job, uint32_t axis, uint32_t cell) {
    const Program *g = p->prog;
    return g->lo[axis] + (cell + 0.5) * ((g->hi[axis] - g->lo[axis]) / job->size[axis]); /* as grid_middle */
}

static bool worker_init(Pixels *q, PixelWorker *w) {
    uint32_t width = q->job->size[0], n = (width + SLT_PAD - 1) / SLT_PAD * SLT_PAD;
    bool ok = true;
    for (int d = 0; d < 3; d++) ok &= (w->x[d] = aligned_alloc(64, (size_t)n * 8)) != NULL;
    for (int d = 0; d < 2; d++) ok &= (w->pixel[d] = aligned_alloc(64, (size_t)n * 4)) != NULL;
    ok &= (w->zero = aligned_alloc(64, (size_t)n * 8)) != NULL;
    ok &= (w->out = aligned_alloc(64, (size_t)n * 4)) != NULL;
    if (!ok) return false;
    memset(w->zero, 0, (size_t)n * 8);
    for (uint32_t i = 0; i < n; i++) {
        uint32_t x = i < width ? i : width - 1;
        set(q->p, w->x[0], i, api_middle(q->p, q->job, 0, x));
        set(q->p, w->x[2], i, api_middle(q->p, q->job, 2, 0));
        w->pixel[0][i] = (int32_t)x;
    }
    for (int s = 0; s < SLT_IN_VARYING; s++) w->args.in[s] = w->zero;
    for (int d = 0; d < 3; d++) w->args.in[IN_X0 + d] = w->x[d];
    w->args.in[IN_PIXEL0] = w->pixel[0], w->args.in[IN_PIXEL1] = w->pixel[1];
    w->args.out[0] = w->out;
    w->args.params = q->p->flt, w->args.iparams = q->p->scene.iparams, w->args.geometries = q->p->scene.geometries;
    w->args.resolution[0] = (int32_t)width, w->args.resolution[1] = (int32_t)q->job->size[1];
    w->args.n_valid = width;
    return true;
}

static void worker_free(PixelWorker *w) {
    for (int d = 0; d < 3; d++) free(w->x[d]);
    for (int d = 0; d < 2; d++) free(w->pixel[d]);
    free(w->zero);
    free(w->out);
}

static bool work(void *user, uint32_t worker, uint64_t tile) {
    Pixels *q = user;
    PixelWorker *w = &q->worker[worker];
    uint32_t width = q->job->size[0], height = q->job->size[1], n = (width + SLT_PAD - 1) / SLT_PAD * SLT_PAD;
    for (uint32_t row = (uint32_t)tile * ROWS; row < height && row < (tile + 1) * ROWS; row++) {
        set_all(q->p, w->x[1], n, api_middle(q->p, q->job, 1, height - 1 - row));
        for (uint32_t i = 0; i < n; i++) w->pixel[1][i] = (int32_t)row;
        q->p->scene.kernel[SLT_K_VALUE](&w->args, width);
        memcpy(q->out + (size_t)row * width, w->out, (size_t)width * sizeof *q->out);
    }
    return true;
}

static void merge(void *user, uint32_t worker, uint64_t tile) { (void)user, (void)worker, (void)tile; }

static SltStatus render(SltProgram *p, const SltJob *job, uint32_t *pixels, SltStats *stats, SltError *err) {
    uint64_t tiles = (job->size[1] + ROWS - 1) / ROWS;
    Pixels q = {.p = p, .job = job, .out = pixels};
    uint32_t threads = pool_threads(job->threads, tiles);
    q.worker = calloc(threads, sizeof *q.worker);
    bool ok = q.worker != NULL;
    for (uint32_t t = 0; ok && t < threads; t++) ok = worker_init(&q, &q.worker[t]);
    double start = pool_now();
    PoolOptions o = pool_of_job(job, threads);
    SltStatus s = ok ? pool_run(&o, tiles, work, merge, &q, err) : status_fail(err, SLT_LIMIT, "out of memory");
    if (stats) stats->samples += (uint64_t)job->size[0] * job->size[1], stats->seconds += pool_now() - start;
    for (uint32_t t = 0; q.worker && t < threads; t++) worker_free(&q.worker[t]);
    free(q.worker);
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
