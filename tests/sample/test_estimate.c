/* Estimators against closed forms, on shaders written in C. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include "shaders.h"

typedef struct Result {
    double value[4], verr[4], grad[64], gerr[64], inter[64], bound[64], missed[64];
    SltStats stats;
} Result;

static Result integrate_as(Oracle *o, SltJob j) {
    static Result r;
    memset(&r, 0, sizeof r);
    SltIntegral out = {.struct_size = sizeof out,
                       .value = r.value,
                       .value_stderr = r.verr,
                       .gradient = r.grad,
                       .gradient_stderr = r.gerr,
                       .interior = r.inter,
                       .boundary = r.bound,
                       .missed_estimate = r.missed};
    SltError err;
    j.integral = true;
    SltStatus st = slt_estimate_integral(&o->scene, &j, &out, &r.stats, &err);
    if (st != SLT_OK) fail_msg("status %d: %s", st, err.text);
    return r;
}

static Result integrate(Oracle *o, uint64_t samples, uint64_t segments) {
    return integrate_as(o, (SltJob){.samples = samples, .segments = segments, .seed = 7, .threads = 2});
}

static void close_to(double got, double want, double tolerance, const char *what) {
    if (!(fabs(got - want) <= tolerance)) fail_msg("%s: got %.10g, want %.10g +- %.3g", what, got, want, tolerance);
}

static uint64_t dropped(const SltStats *s) {
    uint64_t n = 0;
    for (int d = 0; d < SLT_DROP_REASONS; d++) n += s->dropped[d];
    return n;
}

static void test_circle(void **state) {
    (void)state;
    for (int f32 = 0; f32 < 2; f32++) {
        Oracle o;
        oracle_init(&o, circle_f, circle_g, 2, 2, 1, 3, (double[]){0.3, 0.45, 0.52});
        if (f32) oracle_use_f32(&o);
        Result r = integrate(&o, 40000, 40000);
        double a = PI * 0.09, c = 2 * PI * 0.3;
        close_to(r.value[0], a, 5e-4, "area");
        close_to(r.grad[0], c, 1e-3 * c, "d0/dr");
        close_to(r.grad[1], 0, 2e-3, "d0/dcx");
        close_to(r.grad[3], c * 1.45, 1e-3 * c, "d1/dr");
        close_to(r.grad[4], a, 2e-3, "d1/dcx");
        close_to(r.grad[5], 0, 2e-3, "d1/dcy");
        for (int i = 0; i < 6; i++) close_to(r.inter[i], 0, 1e-12, "no interior term");
        assert_int_equal(dropped(&r.stats), 0);
        assert_true(r.stats.crossings > 400 && r.gerr[0] > 0 && r.gerr[0] < 2e-3);
        /* f once, its derivative once a channel, half an evaluation a segment, about a dozen a crossing. */
        assert_true(r.stats.evaluations < 3 * 40000 + 0.55 * 40000 + 14 * r.stats.crossings);
    }
}

static void test_twice_tested(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, twice_f, circle_g, 2, 1, 1, 3, (double[]){0.3, 0.5, 0.5});
    close_to(integrate(&o, 1000, 40000).grad[0], 3 * 2 * PI * 0.3, 0.01, "d/dr");
}

static void test_overlapping_discs(void **state) {
    (void)state;
    Oracle o;
    double p[] = {0.22, 0.4, 0.5, 0.17, 0.62, 0.55}, d = hypot(0.22, 0.05);
    oracle_init(&o, discs_f, discs_g, 2, 1, 1, 6, p);
    Result r = integrate(&o, 1000, 60000);
    close_to(r.grad[0], 2 * PI * 0.22 - arc_inside(0.22, 0.17, d), 0.005, "d/dr0");
    close_to(r.grad[3], 3 * 2 * PI * 0.17 - arc_inside(0.17, 0.22, d), 0.01, "d/dr1");
    assert_int_equal(dropped(&r.stats), 0);
}

static void test_thin_ring_needs_the_probe(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, one_f, ring_g, 2, 1, 1, 2, (double[]){0.31, 0.004});
    double exact = 4 * PI * 0.31;
    /* Spacing 1/32 after four replicates: eight times the half width. */
    Result plain = integrate(&o, 100, 8192);
    scene_near_miss(&o.scene);
    Result probed = integrate(&o, 100, 8192);
    assert_true(plain.grad[1] < 0.75 * exact);
    close_to(probed.grad[1], exact, 0.02 * exact, "with the probe");
    assert_true(probed.stats.evaluations < 1.6 * plain.stats.evaluations + 14 * probed.stats.crossings);
    /* Without it, the half-resolution lines tell that much is missed. */
    assert_true(plain.missed[1] > 0.2 * plain.grad[1]);
    close_to(probed.missed[1], probed.missed[1], 0, "finite");
}

static void test_stairs(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, stairs_f, stairs_g, 2, 1, 1, 1, (double[]){5.3});
    o.kind[0] = SLT_SITE_FLOOR;
    Result r = integrate(&o, 1000, 40000);
    close_to(r.grad[0], stairs_exact(5.3), 0.01, "d/ds");
    scene_near_miss(&o.scene);
    close_to(integrate(&o, 1000, 40000).grad[0], stairs_exact(5.3), 0.01, "d/ds with the probe");
}

static void test_one_dimension(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, step_f, step_g, 1, 1, 1, 1, (double[]){0.37});
    /* One crossing, exact whatever the lattice. */
    close_to(integrate(&o, 100, 64).grad[0], -2 * 0.37, 1e-4, "f64");
    oracle_use_f32(&o);
    close_to(integrate(&o, 100, 4096).grad[0], -2 * 0.37, 1e-4, "f32");
}

static void test_ball(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, one_f, ball_g, 3, 1, 1, 1, (double[]){0.3});
    close_to(integrate(&o, 1000, 4 * 3 * 16 * 16 * 16).grad[0], 4 * PI * 0.09, 0.004, "d/dr");
}

static void test_random_radius(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, one_f, random_g, 2, 1, 1, 1, (double[]){0.2});
    o.scene.uses_rand = true;
    double exact = 2 * PI * 0.2 * 13 / 12;
    Result r = integrate(&o, 100, 40000);
    close_to(r.grad[0], exact, 0.01 * exact, "lattice falls back to scanlines");
    close_to(r.grad[0], exact, 6 * r.gerr[0] + 1e-4, "within its error");
    close_to(integrate_as(&o, (SltJob){.samples = 100, .segments = 40000, .estimator = SLT_EST_SNAP_CROFTON}).grad[0],
             exact, 0.2 * exact, "crofton");
}

static void test_border_and_flower(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, one_f, edge_g, 2, 1, 1, 1, (double[]){0.25});
    close_to(integrate(&o, 100, 20000).grad[0], 0.25 / 0.37, 0.004, "edge");
    oracle_init(&o, one_f, flower_g, 2, 1, 1, 1, (double[]){0.28});
    close_to(integrate(&o, 100, 40000).grad[0], 2 * PI * 0.28 * 1.045, 0.005, "flower");
}

static void test_guarded(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, guarded_f, guarded_g, 2, 1, 2, 2, (double[]){0.3, 0.6});
    double half = acos(0.1 / 0.3);
    Result r = integrate(&o, 100, 40000);
    close_to(r.grad[0], 0.3 * (2 * PI - 2 * half), 0.004, "d/dr");
    close_to(r.grad[1], 2 * 0.3 * sin(half), 0.004, "d/dedge");
}

static void test_broken_boundary_is_counted(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, one_f, broken_g, 2, 1, 1, 1, (double[]){0.5123});
    o.step = 1e-10;
    Result r = integrate(&o, 100, 4000);
    assert_true(dropped(&r.stats) > 50);
    assert_true(r.grad[0] == 0);
    o.is_static[0] = 1;
    r = integrate(&o, 100, 4000);
    assert_true(r.stats.dropped[SLT_DROP_STATIC] > 50);
}

static void test_empty(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, circle_f, circle_g, 2, 2, 1, 3, (double[]){-1, 0.5, 0.5});
    for (int e = SLT_EST_LATTICE; e <= SLT_EST_FD; e++) {
        Result r = integrate_as(&o, (SltJob){.samples = 64, .segments = 64, .estimator = e});
        for (int i = 0; i < 6; i++) assert_true(r.grad[i] == 0 && r.gerr[i] == 0 && r.missed[i] == 0);
        assert_int_equal(r.stats.crossings, 0);
        /* One sample sees nothing either, and knows nothing. */
        r = integrate_as(&o, (SltJob){.samples = 1, .segments = 1, .estimator = e});
        for (int i = 0; i < 6; i++) assert_true(r.grad[i] == 0 && isinf(r.gerr[i]) && r.missed[i] == 0);
        assert_int_equal(r.stats.crossings, 0);
    }
    o.scene.hi[0] = o.scene.lo[0];
    SltJob j = {.size = {4, 4, 1}, .spp = 1};
    SltError err;
    float image[64];
    assert_int_equal(slt_estimate_render(&o.scene, &j, 0, image, NULL, &err), SLT_USAGE);
}

/* Other estimators: same answer, larger errors. */
static void test_estimators_agree(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, circle_f, circle_g, 2, 2, 1, 3, (double[]){0.3, 0.45, 0.52});
    double exact = 2 * PI * 0.3;
    struct {
        SltEstimator e;
        double tolerance;
    } row[] = {{SLT_EST_LATTICE, 2e-3},
               {SLT_EST_SCANLINE, 1e-2},
               {SLT_EST_SNAP_CROFTON, 0.1},
               {SLT_EST_SNAP_KNN, 0.08},
               {SLT_EST_FD, 0.03}};
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        Result r = integrate_as(&o, (SltJob){.samples = 60000, .segments = 60000, .seed = 3, .estimator = row[i].e});
        char name[32];
        snprintf(name, sizeof name, "estimator %d", (int)row[i].e);
        close_to(r.grad[0], exact, row[i].tolerance * exact, name);
        close_to(r.grad[4], PI * 0.09, 0.12, name);
    }
}

/* Equal evaluations, root mean square over seeds: the reason why the lattice is the default. */
static void test_lattice_beats_snapping(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, one_f, circle_g, 2, 1, 1, 3, (double[]){0.3, 0.5, 0.5});
    double exact = 2 * PI * 0.3, sum[2] = {0};
    uint64_t evaluations[2] = {0};
    enum { SEEDS = 40 };
    for (int e = 0; e < 2; e++)
        for (uint32_t seed = 0; seed < SEEDS; seed++) {
            SltJob j = {.samples = 1,
                        .segments = e ? 16384 : 60000,
                        .seed = seed,
                        .replicates = 1,
                        .estimator = e ? SLT_EST_SNAP_KNN : SLT_EST_LATTICE};
            Result r = integrate_as(&o, j);
            sum[e] += pow(r.grad[0] / exact - 1, 2);
            evaluations[e] += r.stats.evaluations;
        }
    double lattice = sqrt(sum[0] / SEEDS), knn = sqrt(sum[1] / SEEDS);
    print_message("circle: lattice %.4f %% at %llu evaluations, snap-knn %.4f %% at %llu: ratio %.0f\n", 100 * lattice,
                  (unsigned long long)evaluations[0] / SEEDS, 100 * knn, (unsigned long long)evaluations[1] / SEEDS,
                  knn / lattice);
    assert_true(evaluations[0] <= 1.05 * evaluations[1]);
    assert_true(knn > 30 * lattice);
}

/* Mean over seeds within its own standard error: no bias. */
static void test_unbiased(void **state) {
    (void)state;
    Oracle o;
    double exact[3] = {2 * PI * 0.3, 0.25 / 0.37, 2 * PI * 0.2 * 13 / 12};
    enum { SEEDS = 60 };
    for (int c = 0; c < 3; c++) {
        if (c == 0) oracle_init(&o, one_f, circle_g, 2, 1, 1, 3, (double[]){0.3, 0.5, 0.5});
        if (c == 1) oracle_init(&o, one_f, edge_g, 2, 1, 1, 1, (double[]){0.25});
        if (c == 2) oracle_init(&o, one_f, random_g, 2, 1, 1, 1, (double[]){0.2}), o.scene.uses_rand = true;
        double sum = 0, square = 0;
        for (uint32_t seed = 0; seed < SEEDS; seed++) {
            Result r = integrate_as(&o, (SltJob){.samples = 1, .segments = 800, .seed = seed, .replicates = 1});
            sum += r.grad[0], square += r.grad[0] * r.grad[0];
        }
        double mean = sum / SEEDS, se = sqrt(fmax(0, square / SEEDS - mean * mean) / (SEEDS - 1));
        close_to(mean, exact[c], 3 * se, "mean over seeds");
        assert_true(se < 0.01 * exact[c]);
    }
}

static void test_domain_of_other_shape(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, circle_f, circle_g, 2, 2, 1, 3, (double[]){0.3, 0.1, 0.2});
    o.scene.lo[0] = -1, o.scene.hi[0] = 1, o.scene.lo[1] = -0.2, o.scene.hi[1] = 0.6;
    Result r = integrate(&o, 10000, 60000);
    close_to(r.grad[0], 2 * PI * 0.3, 3e-3, "d0/dr");
    close_to(r.grad[4], PI * 0.09, 3e-3, "d1/dcx");
}

static void test_limits(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, circle_f, circle_g, 2, 2, 1, 3, (double[]){0.3, 0.5, 0.5});
    static float image[256 * 256 * 2];
    volatile int cancel = 1;
    SltError err;
    SltJob j = {.size = {256, 256, 1}, .spp = 64, .cancel = &cancel};
    assert_int_equal(slt_estimate_render(&o.scene, &j, 0, image, NULL, &err), SLT_INTERRUPTED);
    j.cancel = NULL, j.time_limit = 1e-3;
    assert_int_equal(slt_estimate_render(&o.scene, &j, 0, image, NULL, &err), SLT_LIMIT);
    assert_true(strstr(err.text, "time") != NULL);
}

static void test_crossing(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, circle_f, circle_g, 2, 2, 1, 3, (double[]){0.3, 0.5, 0.5});
    SltCrossing c;
    SltError err;
    assert_int_equal(slt_estimate_crossing(&o.scene, (double[]){0.5, 0.5, 0}, (double[]){1, 0.5, 0}, 0, &c, &err),
                     SLT_OK);
    assert_true(c.found && c.site == 0 && c.drop == -1);
    close_to(c.x[0], 0.8, 1e-6, "x");
    close_to(c.t, 0.6, 1e-6, "t");
    close_to(c.dg[0], 1, 1e-6, "dg");
    close_to(c.f_before[1], 1.8, 1e-4, "f before");
    close_to(c.f_after[1], 0, 0, "f after");
    assert_int_equal(slt_estimate_crossing(&o.scene, (double[]){0.5, 0.5, 0}, (double[]){0.6, 0.5, 0}, 0, &c, &err),
                     SLT_OK);
    assert_false(c.found);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_circle),
                                       cmocka_unit_test(test_twice_tested),
                                       cmocka_unit_test(test_overlapping_discs),
                                       cmocka_unit_test(test_thin_ring_needs_the_probe),
                                       cmocka_unit_test(test_stairs),
                                       cmocka_unit_test(test_one_dimension),
                                       cmocka_unit_test(test_ball),
                                       cmocka_unit_test(test_random_radius),
                                       cmocka_unit_test(test_border_and_flower),
                                       cmocka_unit_test(test_guarded),
                                       cmocka_unit_test(test_broken_boundary_is_counted),
                                       cmocka_unit_test(test_empty),
                                       cmocka_unit_test(test_estimators_agree),
                                       cmocka_unit_test(test_lattice_beats_snapping),
                                       cmocka_unit_test(test_unbiased),
                                       cmocka_unit_test(test_domain_of_other_shape),
                                       cmocka_unit_test(test_limits),
                                       cmocka_unit_test(test_crossing)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
