/* Nanoseconds a sample of every kernel, on one thread: the middles of the pixels of an image, in tiles as the runtime
 * runs them; the median of interleaved rounds. Where an image of this size has lists of the iterations that matter in
 * parts of its tiles (runtime/sample/narrow.h) so has its value here, and what making them takes is part of it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bindings/c/api.h"
#include "cli/bench.h"
#include "compiler/pass/walk.h"
#include "runtime/sample/narrow.h"

enum {
    SIDE = 32,       /* of a tile, in pixels; of a volume's SIDE / 4 */
    N = SIDE * SIDE, /* samples of a tile at most: those of one call */
    TILES = 64,      /* spread evenly over an image that has more */
    ROUNDS = 9,
    LOG = 1 << 20
};

static const int shown[] = {K_VALUE, K_REGION, K_EVENT, K_SIDES, K_SITE, K_SITE_GRAD, K_VJP, K_SITE_VJP};
enum { NSHOWN = sizeof shown / sizeof *shown };

/* Lists of parts of tiles, as images have them. */
typedef struct Lists {
    Batch batch; /* of `bounds` */
    Narrowed narrow;
    bool serve;
} Lists;

/* The samples of all tiles, one after the other, and room for what one call makes of them. */
typedef struct Buffers {
    uint32_t ntiles, n, stride; /* n: samples of a tile, which lie `stride` after those before */
    void *in[SLT_IN_VARYING], *out[SLT_OUT_MAX], *adj, *tape, *log_index, *log_value;
    SltKernelArgs args;
} Buffers;

static void set_flt(const SltProgram *p, void *a, int i, double v) {
    if (p->opt.f64) ((double *)a)[i] = v;
    else ((float *)a)[i] = (float)v;
}

static void free_buffers(Buffers *b) {
    for (int i = 0; i < SLT_IN_VARYING; i++) free(b->in[i]);
    for (int i = 0; i < SLT_OUT_MAX; i++) free(b->out[i]);
    free(b->adj);
    free(b->tape);
    free(b->log_index);
    free(b->log_value);
}

static void place_samples(const SltProgram *p, const uint32_t size[3], Buffers *b) {
    double lo[3], hi[3];
    slt_domain(p, lo, hi);
    uint32_t dim = slt_dim(p), side[3] = {1, 1, 1};
    uint64_t tiles = 1, across[3] = {1, 1, 1};
    b->n = 1;
    for (uint32_t d = 0; d < dim; d++) {
        uint32_t want = dim == 1 ? N : dim == 2 ? SIDE : SIDE / 4;
        side[d] = size[d] < want ? size[d] : want;
        across[d] = size[d] / side[d];
        tiles *= across[d], b->n *= side[d];
    }
    b->ntiles = tiles < TILES ? (uint32_t)tiles : TILES;
    b->stride = (b->n + SLT_PAD - 1) / SLT_PAD * SLT_PAD;
    for (uint32_t t = 0; t < b->ntiles; t++) {
        /* in the middle of its part of all: the first tile of a row lies at every place across, not always at the left
         */
        uint64_t tile = (uint64_t)((t + 0.5) / b->ntiles * (double)tiles);
        for (uint32_t i = 0; i < b->n; i++) {
            uint64_t at = tile, in = i;
            uint32_t k = t * b->stride + i;
            for (uint32_t d = 0; d < dim; d++) {
                uint64_t pixel = at % across[d] * side[d] + in % side[d];
                at /= across[d], in /= side[d];
                set_flt(p, b->in[SLT_IN_X0 + d], (int)k, lo[d] + ((double)pixel + 0.5) / size[d] * (hi[d] - lo[d]));
                if (d < 2) ((int32_t *)b->in[SLT_IN_PIXEL0 + d])[k] = (int32_t)(d ? size[1] - 1 - pixel : pixel);
            }
            set_flt(p, b->in[SLT_IN_RAND0], (int)k, fmod(k * 0.618033988749895, 1.0));
            ((int32_t *)b->in[SLT_IN_STREAM])[k] = (int32_t)k;
            for (int s = 0; s < SLT_MAX_CHANNELS; s++) set_flt(p, b->in[SLT_IN_SEED0 + s], (int)k, 1);
        }
    }
}

static bool make_buffers(SltProgram *p, const uint32_t size[3], Buffers *b) {
    size_t bytes = (N + SLT_PAD) * sizeof(double), lanes = p->scene.adj_lanes;
    bool ok = true;
    for (int i = 0; i < SLT_IN_VARYING; i++) ok &= (b->in[i] = aligned_alloc(64, TILES * bytes)) != NULL;
    for (int i = 0; i < SLT_OUT_MAX; i++) ok &= (b->out[i] = aligned_alloc(64, bytes)) != NULL;
    size_t adj = ((size_t)slt_float_count(p) * lanes * 8 + 127) & ~(size_t)63;
    size_t tape = (((size_t)p->scene.tape_bytes + 64) * SLT_PAD + 4096 + 63) & ~(size_t)63;
    if (p->scene.tape_grows) tape += (size_t)1 << 28; /* of the pages those that are touched */
    b->adj = aligned_alloc(64, adj);
    b->tape = aligned_alloc(64, tape);
    b->log_index = malloc((LOG + SLT_PAD) * sizeof(uint32_t));
    b->log_value = malloc((LOG + SLT_PAD) * sizeof(double));
    if (!ok || !b->adj || !b->tape || !b->log_index || !b->log_value) return false;
    memset(b->adj, 0, adj);
    for (int i = 0; i < SLT_IN_VARYING; i++) memset(b->in[i], 0, TILES * bytes);
    place_samples(p, size, b);
    for (int i = 0; i < SLT_OUT_MAX; i++) b->args.out[i] = b->out[i];
    b->args.params = p->flt, b->args.iparams = p->ints, b->args.geometries = p->geometries;
    b->args.adj = b->adj;
    b->args.log_index = b->log_index, b->args.log_value = b->log_value, b->args.log_cap = LOG;
    b->args.tape = b->tape, b->args.tape_bytes = tape;
    b->args.resolution[0] = size[0], b->args.resolution[1] = size[1];
    b->args.n_valid = b->n;
    return true;
}

static const bool is_float[SLT_IN_VARYING] = {
#define FLT true
#define INT false
#define SLT_INPUT(id, text, type, ...) type,
#include "saltus/kernel.def"
#undef FLT
#undef INT
};

/* The samples of the next call, from this one on. */
static void put_samples(Buffers *b, uint32_t first, bool f64) {
    for (int i = 0; i < SLT_IN_VARYING; i++) {
        size_t element = f64 && is_float[i] ? sizeof(double) : sizeof(float);
        b->args.in[i] = (char *)b->in[i] + first * element;
    }
}

/* All tiles once. */
static void run_kernel(Buffers *b, SltKernel *f, bool f64) {
    for (uint32_t t = 0; t < b->ntiles; t++) {
        put_samples(b, t * b->stride, f64);
        f(&b->args, b->n);
        b->args.log_len = 0;
    }
}

static double flt_at(const Buffers *b, uint32_t slot, uint32_t i, bool f64) {
    return f64 ? ((double *)b->in[slot])[i] : (double)((float *)b->in[slot])[i];
}

/* All tiles once, a few rows of a tile a call. */
static void run_listed(Buffers *b, Lists *l, SltKernel *f, bool f64) {
    enum { STRIP = SIDE / 4, CALL = STRIP * SIDE };
    for (uint32_t t = 0; t < b->ntiles; t++) {
        const uint32_t first = t * b->stride;
        NarrowParts p = {.rows = N / CALL, .samples = N};
        p.x[0] = flt_at(b, SLT_IN_X0, first, f64), p.x[1] = flt_at(b, SLT_IN_X0, first + SIDE - 1, f64);
        for (uint32_t r = 0; r < p.rows; r++)
            for (uint32_t end = 0; end < 2; end++)
                p.y[r][end] = flt_at(b, SLT_IN_X1, first + r * CALL + end * (CALL - 1), f64);
        if (!narrow_tile(&l->narrow, &l->batch, &p)) l->serve = false;
        for (uint32_t r = 0; r < p.rows; r++) {
            narrow_rows(&l->narrow, &l->batch, r, r);
            b->args.cull = l->batch.args.cull, b->args.n_valid = CALL;
            put_samples(b, first + r * CALL, f64);
            f(&b->args, CALL);
        }
        narrow_end(&l->narrow, &l->batch);
    }
    b->args.cull = NULL, b->args.n_valid = b->n;
}

/* Where an image of this job has lists: are they there now? */
static SltStatus lists_make(Lists *l, SltProgram *p, const SltJob *j, uint32_t samples, SltError *err) {
    if (samples != N || !api_lists_pay(p, (double)j->size[0] * j->size[1] * j->spp)) return SLT_OK;
    if (!api_lists_begin(p) || !narrow_serves(&p->scene)) return SLT_OK;
    l->serve = batch_init(&l->batch, &p->scene, NULL) && narrow_init(&l->narrow, &p->scene);
    return l->serve ? SLT_OK : status_fail(err, SLT_LIMIT, "out of memory");
}

static void lists_free(Lists *l) { batch_free(&l->batch), narrow_free(&l->narrow); }

/* Of this thread: what other programs do lengthens it less than the clock's time. */
static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int compare(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

int bench_kernels(Cli *c, SltProgram *p) {
    SltError err = {0};
    int prepared = cli_prepare_job(c, p);
    if (prepared != SLT_OK) return prepared;
    bool needs[K_KINDS] = {false};
    for (int k = 0; k < NSHOWN; k++) needs[shown[k]] = true;
    p->threads = c->job.threads;
    SltStatus status = api_kernels(p, needs, &err);
    if (status == SLT_OK) status = api_geometries(p, &err);
    if (status != SLT_OK) return cli_fail(c, &err);
    Buffers b = {0};
    if (!make_buffers(p, c->job.size, &b)) return free_buffers(&b), cli_error(SLT_LIMIT, "out of memory");
    Lists lists = {0};
    status = lists_make(&lists, p, &c->job, b.n, &err);
    if (status != SLT_OK) return lists_free(&lists), free_buffers(&b), cli_fail(c, &err);
    enum { LISTED = NSHOWN }; /* behind the kernels: the value with lists */
    double ns[NSHOWN + 1][ROUNDS];
    int calls[NSHOWN + 1];
    const int n = lists.serve ? NSHOWN + 1 : NSHOWN;
    for (int r = -1; r < ROUNDS; r++) /* before the first: how many calls are long enough */
        for (int k = 0; k < n; k++) {
            SltKernel *f = p->scene.kernel[k == LISTED ? K_VALUE : shown[k]];
            if (!f) continue;
            if (r < 0) calls[k] = 1;
            double start = now();
            for (int i = 0; i < calls[k]; i++)
                if (k == LISTED) run_listed(&b, &lists, f, p->opt.f64);
                else run_kernel(&b, f, p->opt.f64);
            const double one = (now() - start) / calls[k];
            if (r < 0) calls[k] = (int)fmin(2000, fmax(1, 0.02 / fmax(one, 1e-7)));
            else ns[k][r] = one / ((double)b.ntiles * b.n) * 1e9;
        }
    lists_free(&lists), api_lists_end(p);
    if (n > NSHOWN) qsort(ns[LISTED], ROUNDS, sizeof **ns, compare);
    const double listed = n > NSHOWN ? ns[LISTED][ROUNDS / 2] : 0;
    double base = 0;
    if (c->json) printf("{\"kernels\": {");
    else printf("%-10s %10s %8s %6s %8s %10s\n", "kernel", "ns/sample", "ratio", "width", "ops", "tape bytes");
    bool first = true;
    for (int k = 0; k < NSHOWN; k++) {
        if (!p->scene.kernel[shown[k]]) continue;
        qsort(ns[k], ROUNDS, sizeof **ns, compare);
        double median = ns[k][ROUNDS / 2];
        if (shown[k] == K_VALUE) base = median;
        uint32_t width = p->module_of[shown[k]] ? back_width(p->module_of[shown[k]], kernel_names[shown[k]]) : 1,
                 ops = walk_fn_size(p->fn[shown[k]]);
        unsigned long long tape = p->tape[shown[k]].bytes_per_lane;
        const bool has_lists = shown[k] == K_VALUE && listed > 0;
        if (c->json) {
            printf("%s\"%s\": {\"ns\": ", first ? "" : ", ", kernel_names[shown[k]]);
            json_number(stdout, has_lists ? listed : median);
            if (has_lists) printf(", \"without_lists\": "), json_number(stdout, median);
            printf(", \"ratio\": ");
            json_number(stdout, median / base);
            printf(", \"width\": %u, \"ops\": %u, \"tape_bytes\": %llu}", width, ops, tape);
        } else {
            printf("%-10s %10.3f %8.2f %6u %8u %10llu\n", kernel_names[shown[k]], median, median / base, width, ops,
                   tape);
            if (has_lists) printf("%-10s %10.3f %8.2f\n", "  listed", listed, listed / base);
        }
        first = false;
    }
    double total = p->ms_front + p->ms_passes + p->ms_llvm;
    if (c->json)
        printf("}, \"compile_ms\": {\"front\": %.4f, \"passes\": %.4f, \"llvm\": %.4f, \"total\": %.4f}}\n",
               p->ms_front, p->ms_passes, p->ms_llvm, total);
    else
        printf("compile: front end %.1f ms, passes %.1f ms, LLVM %.1f ms, total %.1f ms\n", p->ms_front, p->ms_passes,
               p->ms_llvm, total);
    free_buffers(&b);
    return SLT_OK;
}
