/* What docs/numerics.md promises of bits: one program, one place of the parameters, one seed, run by the interpreter
 * and by kernels of every instruction set and width, by one and by several threads. Images, derivative images,
 * integrals and all counts are the same bits; gradients are at one width, and across widths as good as sums in another
 * order. Targets without fused multiply-add are a family of their own. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/saltus.h"

enum {
    SIDE = 12,
    PIXELS = SIDE * SIDE * SIDE * 4,
    FLOATS = 256,
    WAYS = 2,
    EVALUATIONS = 0,
    COUNTS = 3 + SLT_DROP_REASONS
};
static const SltEstimator ways[WAYS] = {SLT_EST_LATTICE, SLT_EST_QUADRATURE};

/* One way to run a program. width 0: interpreted. */
typedef struct Run {
    const char *target;
    uint32_t width, threads;
} Run;

typedef struct Results {
    float image[PIXELS], slope[PIXELS];
    double value[WAYS][4], gradient[WAYS][FLOATS];
    uint64_t counts[WAYS][COUNTS];
} Results;

static bool runs_here(const char *target) {
    SltOptions o = SLT_OPTIONS_INIT;
    SltProgram *p;
    o.target = target;
    SltStatus s = slt_compile_string("shader float main(float x) { return x; }", "probe", &o, &p);
    slt_program_free(p);
    return s == SLT_OK;
}

static void count(const SltStats *s, uint64_t *counts) {
    counts[EVALUATIONS] = s->evaluations, counts[1] = s->crossings, counts[2] = s->boxes;
    memcpy(counts + 3, s->dropped, sizeof s->dropped);
}

static SltProgram *load(const char *path, bool f64, const Run *run) {
    SltOptions o = SLT_OPTIONS_INIT;
    SltProgram *p;
    o.f64 = f64, o.width = run->width, o.interpret = !run->width, o.target = run->target;
    if (slt_compile_file(path, &o, &p) != SLT_OK) fail_msg("%s: %s", path, slt_diagnostics_text(p));
    return p;
}

static void compute(SltProgram *p, const char *path, uint32_t threads, Results *r) {
    SltError err = {0};
    SltJob job = SLT_JOB_INIT;
    uint32_t n = slt_float_count(p), dim = slt_dim(p);
    double dir[FLOATS];
    const double *dirs = dir;
    float *slope = r->slope;
    assert_true(n * slt_channels(p) <= FLOATS);
    memset(r, 0, sizeof *r);
    for (uint32_t i = 0; i < n; i++) dir[i] = 1.0 / (1 + i);
    job.threads = threads, job.seed = 5, job.spp = 2, job.estimator = SLT_EST_LATTICE;
    for (uint32_t d = 0; d < 3; d++) job.size[d] = d < dim ? SIDE : 1;
    if (slt_render(p, &job, r->image, NULL, &err) != SLT_OK) fail_msg("%s: %s", path, err.text);
    if (slt_grad_images(p, &job, 1, &dirs, &slope, NULL, NULL, &err) != SLT_OK) fail_msg("%s: %s", path, err.text);
    job.integral = true, job.samples = 1 << 9, job.segments = 1 << 9;
    for (int w = 0; w < WAYS; w++) {
        SltStats stats = SLT_STATS_INIT;
        SltIntegral out = {.struct_size = sizeof out, .value = r->value[w], .gradient = r->gradient[w]};
        job.estimator = ways[w];
        SltStatus s = slt_grad_integral(p, &job, &out, &stats, &err);
        if (s != SLT_OK && ways[w] != SLT_EST_QUADRATURE) fail_msg("%s: %s", path, err.text);
        count(&stats, r->counts[w]);
    }
}

static void name(char *text, size_t room, const char *path, bool f64, Run run) {
    const char *file = strrchr(path, '/');
    snprintf(text, room, "%s %s %s %u lanes %u threads", file ? file + 1 : path, f64 ? "f64" : "f32",
             run.target ? run.target : "native", run.width, run.threads);
}

static void same(const char *path, bool f64, Run run, const Results *want, const Results *got, bool gradients) {
    char who[256];
    name(who, sizeof who, path, f64, run);
    for (int i = 0; i < PIXELS; i++) {
        if (memcmp(&want->image[i], &got->image[i], sizeof(float)) != 0)
            fail_msg("%s: image[%d] is %.9g, not %.9g", who, i, got->image[i], want->image[i]);
        if (memcmp(&want->slope[i], &got->slope[i], sizeof(float)) != 0)
            fail_msg("%s: derivative[%d] is %.9g, not %.9g", who, i, got->slope[i], want->slope[i]);
    }
    for (int w = 0; w < WAYS; w++) {
        for (int c = 0; c < 4; c++)
            if (memcmp(&want->value[w][c], &got->value[w][c], sizeof(double)) != 0)
                fail_msg("%s, way %d: value %.17g, not %.17g", who, w, got->value[w][c], want->value[w][c]);
        for (int c = run.threads > 1 ? EVALUATIONS + 1 : 0; c < COUNTS; c++) /* threads fill batches otherwise */
            if (want->counts[w][c] != got->counts[w][c])
                fail_msg("%s, way %d: count %d is %llu, not %llu", who, w, c, (unsigned long long)got->counts[w][c],
                         (unsigned long long)want->counts[w][c]);
        double bound = 0;
        for (int i = 0; i < FLOATS; i++) bound = fmax(bound, (f64 ? 1e-14 : 1e-6) * fabs(want->gradient[w][i]));
        for (int i = 0; i < FLOATS; i++) {
            double a = want->gradient[w][i], b = got->gradient[w][i];
            if (gradients ? memcmp(&a, &b, sizeof a) != 0 : !(fabs(a - b) <= bound))
                fail_msg("%s, way %d: gradient[%d] is %.17g, not %.17g", who, w, i, b, a);
        }
    }
}

/* widths: up to a 0. */
static void one_family(const char *path, bool f64, const char *const *targets, const uint32_t *widths) {
    static Results first, narrow, got;
    Run run = {targets[0], 0, 1};
    SltProgram *p = load(path, f64, &run);
    compute(p, path, 1, &first);
    slt_program_free(p);
    for (size_t w = 0; widths[w]; w++)
        for (int t = 0; targets[t]; t++) {
            run = (Run){targets[t], widths[w], 1};
            p = load(path, f64, &run);
            compute(p, path, 1, &got);
            same(path, f64, run, &first, &got, false);
            if (t) same(path, f64, run, &narrow, &got, true);
            narrow = got;
            run.threads = 3;
            compute(p, path, 3, &got);
            same(path, f64, run, &narrow, &got, true);
            slt_program_free(p);
        }
}

static void test_bits(void **state) {
    (void)state;
    const char *fused[4] = {0}, *const plain[] = {"sse2", NULL};
    static const char *const known[] = {"avx2", "avx512"};
    int nfused = 0;
    for (size_t t = 0; t < sizeof known / sizeof *known; t++)
        if (runs_here(known[t])) fused[nfused++] = known[t];
    static const struct {
        const char *name;
        bool f64;
        uint32_t widths[6];
    } programs[] = {
        {"nested", false, {1, 4, 16, 64}}, /* all kinds of sites */
        {"nested", true, {8}},
        {"discs", false, {16}},  /* a loop with a list */
        {"random", false, {16}}, /* random numbers, arrays, integers */
    };
    for (size_t k = 0; k < sizeof programs / sizeof *programs; k++) {
        char path[512];
        snprintf(path, sizeof path, SALTUS_TEST_DIR "/programs/%s.salt", programs[k].name);
        if (nfused) one_family(path, programs[k].f64, fused, programs[k].widths);
        if (runs_here("sse2")) one_family(path, programs[k].f64, plain, programs[k].widths);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_bits)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
