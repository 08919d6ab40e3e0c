/* 8-bit pixels of a 2D program in chunks: squares of pixels, whose boxes say which chunks run (runtime/sample/prune.h).
 * The same bits as row by row. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"
#include "runtime/sample/prune.h"
#include "runtime/sample/run.h"

typedef struct Squares Squares;
typedef struct SquareWorker {
    const Squares *all;
    Batch batch;
    Pruner pruner;
} SquareWorker;

struct Squares {
    SltProgram *p;
    const SltJob *job;
    uint32_t *out;
    uint32_t n[3], side, across; /* pixels; of a square; squares in a row of them */
    double *x, *y;               /* middles of columns, and of rows from below */
    SquareWorker *worker;
};

static uint32_t *pixels_of(const Squares *s, const PixelRect *r, uint32_t y) {
    return s->out + (size_t)(s->n[1] - 1 - (r->lo[1] + y)) * s->n[0] + r->lo[0];
}

/* As curve and channel8 of back/cpu/emit_pixels.c, to the bit. */
#define CURVE(T, root_of)                                                                                              \
    static T curve_##T(T v) {                                                                                          \
        T root = root_of(v), r = (T)BACK_SRGB[BACK_SRGB_TERMS - 1];                                                    \
        for (int k = BACK_SRGB_TERMS - 2; k >= 0; k--) r = r * root + (T)BACK_SRGB[k];                                 \
        return v < (T)0.0031308 ? v * (T)12.92 : r;                                                                    \
    }
CURVE(float, sqrtf)
CURVE(double, sqrt)

static uint32_t channel8(const SltProgram *p, double v) {
    bool curved = !p->prog->display;
    double x = v > 0 ? v : 0;
    x = x < 1 ? x : 1;
    if (p->opt.f64) return (uint32_t)((curved ? curve_double(x) : x) * 255 + 0.5);
    return (uint32_t)((curved ? curve_float((float)x) : (float)x) * 255.0f + 0.5f);
}

static void constant(void *user, const PixelRect *r, const double *value) {
    const Squares *s = ((SquareWorker *)user)->all;
    uint32_t word = 0xff000000u;
    for (uint32_t c = 0; c < 3; c++) word |= channel8(s->p, value[s->p->scene.channels >= 3 ? c : 0]) << 8 * c;
    for (uint32_t y = 0; y < r->n[1]; y++) {
        uint32_t *pixels = pixels_of(s, r, y), n = r->n[0];
        for (uint32_t x = 0; x < n; x++) pixels[x] = word;
    }
}

static void sample(void *user, const PixelRect *r, uint32_t n, const SltPruned *pruned) {
    SquareWorker *w = user;
    const Squares *s = w->all;
    Batch *b = &w->batch;
    uint32_t pixels = 0;
    for (uint32_t k = 0; k < n; k++)
        for (uint32_t y = r[k].lo[1]; y < r[k].lo[1] + r[k].n[1]; y++)
            for (uint32_t x = r[k].lo[0]; x < r[k].lo[0] + r[k].n[0]; x++, pixels++) {
                batch_set(b, SLT_IN_X0, pixels, s->x[x]);
                batch_set(b, SLT_IN_X1, pixels, s->y[y]);
                batch_set_int(b, SLT_IN_PIXEL0, pixels, (int32_t)x);
                batch_set_int(b, SLT_IN_PIXEL1, pixels, (int32_t)(s->n[1] - 1 - y));
            }
    batch_prune(b, pruned, NULL);
    batch_call(b, SLT_K_PRUNED, pixels);
    batch_prune(b, NULL, NULL);
    const uint32_t *word = batch_out(b, SLT_OUT_F, 0);
    for (uint32_t k = 0; k < n; k++)
        for (uint32_t y = 0; y < r[k].n[1]; y++, word += r[k].n[0])
            memcpy(pixels_of(s, &r[k], y), word, r[k].n[0] * sizeof *word);
}

static bool work(void *user, uint32_t worker, uint64_t tile) {
    Squares *s = user;
    SquareWorker *w = &s->worker[worker];
    const SltScene *scene = &s->p->scene;
    PruneImage image = {.dim = scene->dim, .user = w, .constant = constant, .sample = sample};
    PixelRect r = {.n = {1, 1, 1}};
    uint32_t at[2] = {(uint32_t)(tile % s->across), (uint32_t)(tile / s->across)};
    for (uint32_t d = 0; d < 2; d++) {
        image.lo[d] = scene->lo[d], image.side[d] = (scene->hi[d] - scene->lo[d]) / s->n[d];
        r.lo[d] = at[d] * s->side;
        r.n[d] = s->n[d] - r.lo[d] < s->side ? s->n[d] - r.lo[d] : s->side;
    }
    prune_image(&w->pruner, &w->batch, &image, &r);
    return true;
}

static void merge(void *user, uint32_t worker, uint64_t tile) { (void)user, (void)worker, (void)tile; }

static bool begin(Squares *s, uint32_t threads) {
    s->x = malloc((size_t)s->n[0] * sizeof *s->x), s->y = malloc((size_t)s->n[1] * sizeof *s->y);
    s->worker = calloc(threads, sizeof *s->worker);
    bool ok = s->x && s->y && s->worker;
    for (uint32_t i = 0; ok && i < s->n[0]; i++) s->x[i] = api_middle(s->p, s->job, 0, i);
    for (uint32_t i = 0; ok && i < s->n[1]; i++) s->y[i] = api_middle(s->p, s->job, 1, i);
    for (uint32_t t = 0; ok && t < threads; t++) {
        SquareWorker *w = &s->worker[t];
        w->all = s;
        ok = batch_init(&w->batch, &s->p->scene, NULL) && prune_init(&w->pruner, s->p->scene.chunks);
        for (uint32_t d = 0; ok && d < 2; d++) w->batch.args.resolution[d] = (int32_t)s->job->size[d];
    }
    return ok;
}

SltStatus api_render_squares(SltProgram *p, const SltJob *job, uint32_t *pixels, SltStats *stats, SltError *err) {
    Squares s = {.p = p, .job = job, .out = pixels, .n = {job->size[0], job->size[1]}};
    s.side = prune_tile(2, s.n);
    s.across = (s.n[0] + s.side - 1) / s.side;
    uint64_t tiles = (uint64_t)s.across * ((s.n[1] + s.side - 1) / s.side);
    uint32_t threads = pool_threads(job->threads, tiles);
    double start = pool_now();
    bool ok = begin(&s, threads);
    PoolOptions o = pool_of_job(job, threads);
    SltStatus status = ok ? pool_run(&o, tiles, work, merge, &s, err) : status_fail(err, SLT_LIMIT, "out of memory");
    if (stats) stats->samples += (uint64_t)s.n[0] * s.n[1], stats->seconds += pool_now() - start;
    for (uint32_t t = 0; s.worker && t < threads; t++) batch_free(&s.worker[t].batch), prune_free(&s.worker[t].pruner);
    free(s.x), free(s.y), free(s.worker);
    return status;
}
