/* Reverse kernels without guards against 0 times what is infinite, and the guarded ones that run where a sum of theirs
 * is not finite. */
#include <math.h>

#include "bindings/c/api.h"
#include "tests/api/program.h"
#include "tests/scratch.h"

/* What the choice throws away is a root of something negative over half of the domain: 0 * NaN without a guard. N: as
 * many parameters, of which the first two matter; above 32 sums are too many to be kept before each call. */
static const char thrown[] = "const int N = 2;\n"
                             "param float p[N] = init(start);\n"
                             "float start(int i) { return 0.5 + 0.25 * float(i); }\n"
                             "[NoDisc] shader float main(float2 x) {\n"
                             "    float q = p[int(x.y * 1.9999)], h = x.x - 0.5, right = q * q * (1.5 + sqrt(h));\n"
                             "    return h < 0.0 ? q * (1.0 + x.x) : right;\n"
                             "}\n";
/* The slope of the root is nowhere infinite, which no range tells. */
static const char tame[] =
    "param float p[2] = { 0.5, 0.75 };\n"
    "[NoDisc] shader float main(float2 x) { return sqrt(abs(p[0]) * x.x + p[1] * x.y + 0.1); }\n";

enum { MOST = 5000, SIDE = 96 };

typedef struct Gradient {
    double integral[MOST], image[MOST], loss[MOST];
} Gradient;

static SltProgram *program(const char *source, int n, bool f64, bool guarded) {
    char number[16];
    snprintf(number, sizeof number, "%d", n);
    const SltSet set = {"N", number};
    SltOptions opt = SLT_OPTIONS_INIT;
    opt.f64 = f64, opt.set = &set, opt.nset = n > 2;
    SltProgram *p = compile_with(source, opt);
    p->guarded = guarded;
    return p;
}

static void take_gradients(SltProgram *p, uint32_t threads, Gradient *g) {
    static float image[SIDE * SIDE];
    SltError err;
    SltJob job = SLT_JOB_INIT;
    SltIntegral out = SLT_INTEGRAL_INIT;
    memset(g, 0, sizeof *g);
    for (int i = 0; i < SIDE * SIDE; i++) image[i] = 0.25f + (float)(i % 7) / 8;
    job.threads = threads, job.estimator = SLT_EST_LATTICE, job.samples = 1 << 14;
    out.gradient = g->integral;
    assert_ok(slt_grad_integral(p, &job, &out, NULL, &err));
    job.size[0] = job.size[1] = SIDE, job.spp = 2;
    assert_ok(slt_grad_adjoint(p, &job, image, g->image, NULL, NULL, &err));
    assert_ok(slt_grad_loss(p, &job, image, NULL, NULL, g->loss, NULL, NULL, NULL, &err));
}

static bool all_finite(const Gradient *g) {
    bool finite = true;
    for (int i = 0; i < MOST; i++) finite &= isfinite(g->integral[i]) && isfinite(g->image[i]) && isfinite(g->loss[i]);
    return finite;
}

/* The bits of a program that keeps its guards, of few parameters and many, by any number of threads. */
static void thrown_away(void **state) {
    (void)state;
    static const int counts[] = {2, 300, MOST};
    static Gradient bare, guarded, threaded;
    for (int i = 0; i < 6; i++) {
        SltProgram *p = program(thrown, counts[i / 2], i % 2, false), *q = program(thrown, counts[i / 2], i % 2, true);
        take_gradients(p, 1, &bare), take_gradients(q, 1, &guarded), take_gradients(p, 8, &threaded);
        assert_true(all_finite(&bare) && bare.integral[0] != 0);
        assert_memory_equal(&bare, &guarded, sizeof bare);
        assert_memory_equal(&bare, &threaded, sizeof bare);
        assert_non_null(p->scene.kernel[K_VJP_GUARDED]);
        assert_ptr_not_equal(p->scene.kernel[K_VJP_GUARDED], slt_kernel_late);
        assert_ptr_not_equal(p->scene.kernel[K_VJP_GUARDED], p->scene.kernel[K_VJP]);
        assert_null(q->scene.kernel[K_VJP_GUARDED]);
        /* Of each half of y the integrals over halves of x: of 1 + x, and of 2 p (1.5 + sqrt(x - .5)). */
        for (int k = 0; k < 2; k++) {
            const double want = .5 * (.625 + 2 * (.5 + .25 * k) * (.75 + sqrt(.5) / 3));
            assert_true(fabs(bare.integral[k] - want) < 2e-3 * want);
        }
        slt_program_free(p), slt_program_free(q);
    }
}

/* Two vectors of SSE2 are 8 lanes, as many as it may have with --width: rows of adjoints are longer in the one case,
 * and the guarded kernel has those of the one it stands for. One cache for all: what is in it fits who takes it. */
static const char straight[] = "param float p[4] = { 0.1, 0.2, 0.3, 0.4 };\n"
                               "[NoDisc] shader float main(float2 x) {\n"
                               "    float z = sqrt(x.x - 0.5 + p[0]);\n"
                               "    return x.x > 0.6 ? z * p[1] : p[2] * x.y + p[3]; }\n";

static void every_width(void **state) {
    (void)state;
    static const char *const targets[] = {"sse2", "avx2", "avx512"};
    static const uint32_t widths[] = {0, 4, 8, 16, 0, 8};
    static Gradient want, got;
    assert_int_equal(setenv("XDG_CACHE_HOME", scratch, 1), 0);
    for (int i = 0; i < 2 * 3 * 6; i++) {
        SltOptions opt = SLT_OPTIONS_INIT;
        SltProgram *p;
        opt.f64 = i % 2, opt.target = targets[i / 12], opt.width = widths[i / 2 % 6];
        const SltStatus st = slt_compile_string(straight, "straight.salt", &opt, &p);
        if (st == SLT_OK) {
            take_gradients(p, 1, i ? &got : &want);
            for (int k = 0; k < 4 && i; k++) {
                assert_true(fabs(got.integral[k] - want.integral[k]) < 1e-5 * fabs(want.integral[k]));
                assert_true(fabs(got.loss[k] - want.loss[k]) < 1e-4 * fabs(want.loss[k]));
            }
        } else {
            assert_int_equal(st, SLT_USAGE); /* not on this processor */
        }
        slt_program_free(p);
    }
}

/* Nobody compiles what nothing asks for. */
static void not_needed(void **state) {
    (void)state;
    static Gradient bare, guarded;
    SltProgram *p = program(tame, 2, false, false), *q = program(tame, 2, false, true);
    take_gradients(p, 2, &bare), take_gradients(q, 2, &guarded);
    assert_memory_equal(&bare, &guarded, sizeof bare);
    assert_ptr_equal(p->scene.kernel[K_VJP_GUARDED], slt_kernel_late);
    assert_null(p->module_of[K_VJP_GUARDED]);
    slt_program_free(p), slt_program_free(q);
}

/* It follows what is differentiated, whether it waits or was compiled. */
static void turns(void **state) {
    (void)state;
    static const char *const wrt[] = {"p[1]"};
    static Gradient all, one, again, fresh;
    SltError err;
    for (int i = 0; i < 2; i++) {
        SltProgram *p = program(i ? tame : thrown, 2, false, false), *q = program(i ? tame : thrown, 2, false, false);
        take_gradients(p, 1, &all);
        assert_ok(slt_wrt(p, wrt, 1, &err));
        take_gradients(p, 1, &one);
        assert_ok(slt_wrt(p, NULL, 0, &err));
        take_gradients(p, 1, &again);
        assert_memory_equal(&all, &again, sizeof all);
        assert_ok(slt_wrt(q, wrt, 1, &err));
        take_gradients(q, 1, &fresh);
        assert_memory_equal(&one, &fresh, sizeof one);
        assert_true(one.integral[0] == 0 && one.integral[1] == all.integral[1]);
        slt_program_free(p), slt_program_free(q);
    }
}

/* Where tiles come to no finite end they are not tried for a while, longer each time, and tried again. */
static void doubts(void **state) {
    (void)state;
    double gradient[300];
    SltError err;
    SltJob job = SLT_JOB_INIT;
    SltIntegral out = SLT_INTEGRAL_INIT;
    SltProgram *p = program(thrown, 300, false, false);
    out.gradient = gradient, job.estimator = SLT_EST_LATTICE, job.samples = 1 << 12, job.threads = 1;
    uint32_t most = 0, tries = 0;
    for (int i = 0; i < 200; i++) {
        const uint32_t left = p->doubt.left;
        assert_ok(slt_grad_integral(p, &job, &out, NULL, &err));
        assert_true(p->doubt.next >= most && p->doubt.next <= 256 && p->doubt.left <= p->doubt.next);
        tries += p->doubt.left > left, most = p->doubt.next;
    }
    assert_true(most == 256 && tries > 4 && tries < 20);
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(thrown_away), cmocka_unit_test(every_width),
                                       cmocka_unit_test(not_needed), cmocka_unit_test(turns), cmocka_unit_test(doubts)};
    return cmocka_run_group_tests(tests, scratch_make, scratch_drop);
}
