/* Integrals by quadrature, on scenes in C: closed forms, stated errors, budgets, threads. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include "tests/quadrature/estimates.h"

#define PI 3.14159265358979323846

static bool show;

typedef struct Answer {
    double value, value_error, slope[8], error[8];
    SltStats stats;
    SltStatus status;
} Answer;

static Answer ask(const Scene *s, const SltJob *job) {
    Answer a = {.stats = SLT_STATS_INIT};
    SltJob j = *job;
    SltIntegral out = SLT_INTEGRAL_INIT;
    SltError err;
    j.integral = true;
    if (j.estimator == SLT_EST_AUTO) j.estimator = SLT_EST_QUADRATURE;
    out.value = &a.value, out.value_stderr = &a.value_error, out.gradient = a.slope, out.gradient_stderr = a.error;
    a.status = slt_estimate_integral(&s->slt, &j, &out, &a.stats, &err);
    if (show)
        printf(
            "    value %.15g +- %.2g  slope %.15g +- %.2g, %.15g +- %.2g  evaluations %llu boxes %llu settled %.4g curved %.4g "
            "left %.2g (%.2g) stop %d\n",
            a.value, a.value_error, a.slope[0], a.error[0], a.slope[2], a.error[2],
            (unsigned long long)a.stats.evaluations, (unsigned long long)a.stats.boxes, a.stats.settled, a.stats.curved,
            a.stats.left, a.stats.left_bound, a.stats.stopped);
    return a;
}

static void near(const char *what, double is, double want, double tolerance) {
    if (!(fabs(is - want) <= tolerance)) {
        printf("%s: %.17g instead of %.17g, off by %g\n", what, is, want, is - want);
        fail();
    }
}

/* ---- 1D */
static Num step_g(const Scene *s, uint32_t e, const Num *x) {
    (void)e;
    return num_sub(x[0], param(s, 0));
}
static void step_f(Look *l, double *f) { f[0] = decide(l, 0) ? 2.5 + l->x[0] : exp(l->x[0]); }

static void a_step(void **state) {
    (void)state;
    double t = 0.37;
    Scene s;
    scene_init(&s, 1, 1, 0, step_g, step_f, &t, 1);
    estimates_init(&s);
    SltJob j = SLT_JOB_INIT;
    j.samples = j.segments = 1 << 12, j.error = 1e-12;
    Answer a = ask(&s, &j);
    assert_int_equal(a.status, SLT_OK);
    double value = 2.5 * t + t * t / 2 + exp(1) - exp(t), slope = 2.5 + t - exp(t);
    near("value", a.value, value, 1e-12), near("slope", a.slope[0], slope, 1e-12);
    assert_true(a.stats.cells && a.stats.left == 0 && fabs(a.stats.certified - 1) < 1e-12);
    assert_true(a.error[0] >= fabs(a.slope[0] - slope) && a.error[0] < 1e-12);
    assert_true(a.value_error >= fabs(a.value - value));
}

/* ---- 2D */
static Num circle_g(const Scene *s, uint32_t e, const Num *x) {
    (void)e;
    Num dx = num_sub(x[0], param(s, 0)), dy = num_sub(x[1], param(s, 1));
    return num_sub(num_add(num_sqr(dx), num_sqr(dy)), num_sqr(param(s, 2)));
}
static void circle_f(Look *l, double *f) { f[0] = decide(l, 0) ? 1 : 0; }

static void a_circle(void **state) {
    (void)state;
    const double p[] = {0.52, 0.47, 0.3};
    Scene s;
    scene_init(&s, 2, 1, 0, circle_g, circle_f, p, 3);
    estimates_init(&s);
    SltJob j = SLT_JOB_INIT;
    j.samples = j.segments = 1 << 18;
    Answer a = ask(&s, &j);
    near("value", a.value, PI * 0.09, 1e-7);
    near("slope in r", a.slope[2], 2 * PI * 0.3, 1e-6);
    near("slope in x", a.slope[0], 0, 1e-6);
}

/* Nothing is certified: what is left is searched as ever. */
static bool everywhere(const Scene *s, const SltKernelArgs *a, uint32_t i) {
    (void)s, (void)a, (void)i;
    return true;
}
static bool right_third(const Scene *s, const SltKernelArgs *a, uint32_t i) {
    return scene_in(s, a, SLT_IN_H0, i) > 2.0 / 3;
}

static void without_certificate(void **state) {
    (void)state;
    const double p[] = {0.52, 0.47, 0.3};
    Scene s;
    scene_init(&s, 2, 1, 0, circle_g, circle_f, p, 3);
    estimates_init(&s);
    SltJob j = SLT_JOB_INIT;
    j.samples = j.segments = 1 << 16;
    for (int part = 0; part < 2; part++) {
        estimates_unknown = part ? right_third : everywhere;
        Answer a = ask(&s, &j);
        near("value", a.value, PI * 0.09, 1e-3);
        near("slope in r", a.slope[2], 2 * PI * 0.3, 5e-3);
        assert_true(fabs(a.slope[2] - 2 * PI * 0.3) <= 2 * a.error[2] + 1e-3);
        assert_true(a.stats.cells && isnan(a.stats.left_bound));
        near("left", a.stats.left, part ? 1.0 / 3 : 1, 0.05);
        assert_true(a.stats.evaluations < 150000);
    }
    estimates_unknown = NULL;
}

/* ---- the error that is asked for */
static Num ring_g(const Scene *s, uint32_t e, const Num *x) {
    Num dx = num_sub(x[0], param(s, 0)), dy = num_sub(x[1], param(s, 1));
    Num r = e ? num_add(param(s, 2), param(s, 3)) : num_sub(param(s, 2), param(s, 3));
    return num_sub(num_add(num_sqr(dx), num_sqr(dy)), num_sqr(r));
}
static void ring_f(Look *l, double *f) {
    bool inner = decide(l, 0), outer = decide(l, 1);
    f[0] = outer && !inner ? 1 : 0;
}
static const double ring[] = {0.52, 0.47, 0.3, 0.005};

static void an_error_is_kept(void **state) {
    (void)state;
    Scene s;
    scene_init(&s, 2, 2, 0, ring_g, ring_f, ring, 4);
    estimates_init(&s);
    for (double error = 1e-3; error > 1e-12; error *= 1e-2) {
        SltJob j = SLT_JOB_INIT;
        j.error = error;
        Answer a = ask(&s, &j);
        double want = 4 * PI * 0.3, largest = 0;
        assert_int_equal(a.stats.stopped, SLT_STOP_NONE);
        for (int i = 0; i < 4; i++) largest = fmax(largest, a.error[i]);
        assert_true(largest <= error * fabs(a.slope[3]));
        near("slope in the width", a.slope[3], want, a.error[3] + 1e-13);
        near("slope in the radius", a.slope[2], 4 * PI * 0.005, a.error[2] + 1e-13);
    }
    SltJob j = SLT_JOB_INIT;
    j.abs_error = 1e-7;
    Answer a = ask(&s, &j);
    for (int i = 0; i < 4; i++) assert_true(a.error[i] <= 1e-7);
}

static void what_stops(void **state) {
    (void)state;
    Scene s;
    scene_init(&s, 2, 2, 0, ring_g, ring_f, ring, 4);
    estimates_init(&s);
    SltJob j = SLT_JOB_INIT;
    j.error = 1e-9, j.max_evaluations = 4000;
    Answer a = ask(&s, &j);
    assert_int_equal(a.stats.stopped, SLT_STOP_EVALUATIONS);
    assert_true(a.stats.evaluations < 3 * j.max_evaluations && isfinite(a.slope[3]));
    assert_true(fabs(a.slope[3] - 4 * PI * 0.3) <= a.error[3]);
    j.error = 1e-17, j.max_evaluations = 0;
    a = ask(&s, &j);
    assert_int_equal(a.stats.stopped, SLT_STOP_ROUNDING);
    near("slope in the width", a.slope[3], 4 * PI * 0.3, 1e-12);
}

/* A disc so small that lines meet none of it, in cells that bounds leave: what is stated says that it may be there. */
static void what_lines_miss(void **state) {
    (void)state;
    static const double dot[] = {0.823, 0.471, 1e-4};
    Scene s;
    SltJob j = SLT_JOB_INIT;
    j.samples = j.segments = 1 << 12;
    estimates_unknown = right_third;
    scene_init(&s, 2, 1, 0, circle_g, circle_f, dot, 3);
    estimates_init(&s);
    Answer a = ask(&s, &j);
    estimates_unknown = NULL;
    assert_true(a.stats.left > 0.3 && a.slope[2] == 0);
    assert_true(2 * PI * 1e-4 <= 2 * a.error[2]);
}

static void more_points(void **state) {
    (void)state;
    Scene s;
    scene_init(&s, 2, 1, 0, circle_g, circle_f, ring, 3);
    estimates_init(&s);
    SltJob j = SLT_JOB_INIT;
    j.samples = 1 << 20;
    double last = 1;
    for (j.gauss = 2; j.gauss <= 6; j.gauss += 2) {
        Answer a = ask(&s, &j);
        double off = fabs(a.slope[2] / (2 * PI * 0.3) - 1);
        assert_true(off <= 0.1 * last || off < 1e-13);
        last = off;
    }
}

static void the_same_bits(void **state) {
    (void)state;
    Scene s;
    scene_init(&s, 2, 2, 0, ring_g, ring_f, ring, 4);
    estimates_init(&s);
    for (int part = 0; part < 2; part++) {
        Answer first = {0};
        estimates_unknown = part ? right_third : NULL;
        for (uint32_t threads = 1; threads <= 5; threads += threads == 1 ? 1 : 3) {
            SltJob j = SLT_JOB_INIT;
            j.samples = 1 << 15, j.threads = threads;
            Answer a = ask(&s, &j);
            if (threads == 1) first = a;
            assert_memory_equal(&a.value, &first.value, sizeof a.value);
            assert_memory_equal(a.slope, first.slope, sizeof a.slope);
            assert_memory_equal(a.error, first.error, sizeof a.error);
            assert_true(a.stats.evaluations == first.stats.evaluations);
        }
    }
    estimates_unknown = NULL;
}

int main(void) {
    show = getenv("SALTUS_PRINT") != NULL;
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_step),           cmocka_unit_test(a_circle),       cmocka_unit_test(without_certificate),
        cmocka_unit_test(an_error_is_kept), cmocka_unit_test(what_stops),     cmocka_unit_test(more_points),
        cmocka_unit_test(the_same_bits),    cmocka_unit_test(what_lines_miss)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
