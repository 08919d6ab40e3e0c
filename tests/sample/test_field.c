/* Silhouettes and shadow edges of heightfields: landscapes whose integrals have closed forms. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include "ridges.h"
#include "runtime/geometry/geometry.h"
#include "runtime/sample/depth.h"
#include "runtime/sample/difference.h"

typedef struct Result {
    double value, grad[RIDGE_PARAMS], gerr[RIDGE_PARAMS], boundary[RIDGE_PARAMS], missed[RIDGE_PARAMS];
    SltStats stats;
} Result;

static Result integrate(Ridges *r, SltJob j) {
    Result o;
    memset(&o, 0, sizeof o);
    memset(r->calls, 0, sizeof r->calls), r->named = 0;
    SltIntegral out = {.value = &o.value,
                       .gradient = o.grad,
                       .gradient_stderr = o.gerr,
                       .boundary = o.boundary,
                       .missed_estimate = o.missed};
    SltError err;
    j.integral = true;
    SltStatus st = slt_estimate_integral(&r->scene, &j, &out, &o.stats, &err);
    if (st != SLT_OK) fail_msg("status %d: %s", st, err.text);
    return o;
}

static void close_to(double got, double want, double tolerance, const char *what) {
    if (!(fabs(got - want) <= tolerance)) fail_msg("%s: got %.10g, want %.10g +- %.3g", what, got, want, tolerance);
}

static uint64_t dropped(const SltStats *s) {
    uint64_t n = 0;
    for (int d = 0; d < SLT_DROP_REASONS; d++) n += s->dropped[d];
    return n;
}

static void print_costs(const char *name, const Ridges *r, const Result *o) {
    print_message(
        "%s: %llu segments, %llu crossings; lanes: region %llu, event %llu pairs (%llu named), site %llu, sides %llu\n",
        name, (unsigned long long)o->stats.segments, (unsigned long long)o->stats.crossings,
        (unsigned long long)r->calls[SLT_K_REGION], (unsigned long long)r->calls[SLT_K_EVENT] / 2,
        (unsigned long long)r->named, (unsigned long long)r->calls[SLT_K_SITE],
        (unsigned long long)r->calls[SLT_K_SIDES]);
    for (int d = 0; d < SLT_DROP_REASONS; d++)
        if (o->stats.dropped[d])
            print_message("  dropped: %s %llu\n", slt_drop_names[d], (unsigned long long)o->stats.dropped[d]);
}

/* Within the tolerance, relative to the boundary term, which may cancel the interior. */
static void check_gradient(const char *name, const Ridges *r, const Result *o, double tolerance) {
    for (uint32_t p = 0; p < r->scene.nfloats; p++) {
        char what[64];
        double exact = ridges_exact(r, p);
        snprintf(what, sizeof what, "%s, parameter %u", name, p);
        print_message("  %s: %.6f +- %.6f, exact %.6f, boundary %.6f\n", what, o->grad[p], o->gerr[p], exact,
                      o->boundary[p]);
        close_to(o->grad[p], exact, tolerance * fmax(fabs(exact), fabs(o->boundary[p])) + 4 * o->gerr[p], what);
    }
}

/* p = height of the camera, of a ridge that ends in the middle of the picture, of one behind it. */
static double bump(double x, double centre, double width) {
    double u = (x - centre) / width;
    return fabs(u) < 1 ? (1 - u * u) * (1 - u * u) : 0;
}
static double land(const double *p, double x, double rand0, uint32_t i) {
    (void)rand0;
    double h = 0.02 * i;
    if (i >= 7 && i <= 9) h += p[1] * bump(x, 0.4, 0.45) * (i == 8 ? 1 : 0.4);
    if (i >= 20 && i <= 24) h += p[2] * bump(x, 0.7, 0.6) * (1 - 0.4 * fabs(i - 22.0));
    return h;
}
static void init_land(Ridges *r) { ridges_init(r, land, 40, -0.4, 0.1, 3, (double[]){1.5, 1.1, 1.6}); }

/* A near ridge against far ground, ground against sky, two ridges over one another, and cusps where they end. */
static void test_ridges(void **state) {
    (void)state;
    static Ridges r;
    init_land(&r);
    for (int n = 6000; n <= 240000; n *= 40) {
        Result o = integrate(&r, (SltJob){.samples = 240000, .segments = (uint64_t)n, .seed = 5, .threads = 2});
        print_costs("two ridges", &r, &o);
        close_to(o.value, ridges_integral(&r, r.params), 1e-3 * o.value, "value");
        check_gradient("two ridges", &r, &o, n == 6000 ? 0.02 : 2e-3);
        assert_int_equal(dropped(&o.stats), 0);
        /* A crossing costs about a dozen evaluations; what is none, little. */
        assert_true(r.named <= 1.2 * o.stats.crossings);
        assert_true(o.stats.evaluations < 2 * 240000 + 0.7 * n + 1000 + 16 * o.stats.crossings);
    }
    /* Without the depths, only the skyline is seen. */
    scene_without_depth(&r.scene);
    Result blind = integrate(&r, (SltJob){.samples = 240000, .segments = 240000, .seed = 5});
    assert_true(fabs(blind.boundary[1]) < 0.2 * fabs(ridges_exact(&r, 1)));
}

/* The same predicate asked twice: both jump at once, and both count. */
static void test_twice(void **state) {
    (void)state;
    static Ridges r;
    init_land(&r);
    r.repeat = 2;
    Result o = integrate(&r, (SltJob){.samples = 240000, .segments = 60000, .seed = 6});
    check_gradient("twice", &r, &o, 4e-3);
    assert_int_equal(dropped(&o.stats), 0);
}

/* Shadow edges: hashes tell the ends apart, there is no depth. */
static void test_shadow(void **state) {
    (void)state;
    static Ridges r;
    init_land(&r);
    scene_without_depth(&r.scene), r.ground = 0.2;
    for (int k = 0; k < 4; k++) r.kind[k] = SLT_SITE_SHADOW;
    Result o = integrate(&r, (SltJob){.samples = 1000, .segments = 60000, .seed = 7});
    print_costs("shadow", &r, &o);
    check_gradient("shadow", &r, &o, 2e-3);
    assert_int_equal(dropped(&o.stats), 0);
}

/* Flat land to the horizon, seen from low above: depths differ more and more from row to row, and nothing jumps but the
 * ridge and the horizon. */
static double plain(const double *p, double x, double rand0, uint32_t i) {
    (void)rand0;
    return i == 30 ? p[1] * bump(x, 0.5, 0.2) : 0;
}
static void test_grazing(void **state) {
    (void)state;
    static Ridges r;
    ridges_init(&r, plain, 500, -0.2, 0.01, 2, (double[]){0.8, 0.3});
    for (int n = 4000; n <= 64000; n *= 16) {
        Result o = integrate(&r, (SltJob){.samples = 240000, .segments = (uint64_t)n, .seed = 8});
        print_costs("grazing", &r, &o);
        check_gradient("grazing", &r, &o, n == 4000 ? 0.2 : 0.03);
        assert_int_equal(dropped(&o.stats), 0);
        double idle = (double)r.calls[SLT_K_EVENT] / 2 - (double)r.named,
               extra = (double)r.calls[SLT_K_REGION] - 0.5 * n;
        print_message("  %.0f pairs asked for nothing, %.0f regions beyond the lattice\n", idle, extra);
        /* depth.c searches up to one edge in eight; of a finer lattice, fewer stand out. */
        assert_true(idle < (n == 4000 ? 0.125 : 0.07) * n && extra < (n == 4000 ? 0.3 : 0.15) * n);
    }
}

/* A spike one node wide, steep, in front of far ground. */
static double spike(const double *p, double x, double rand0, uint32_t i) {
    (void)rand0;
    return i == 12 ? p[1] * fmax(0, 1 - fabs(x - p[2]) / 0.04) : 0.01 * i;
}
static void test_spike(void **state) {
    (void)state;
    static Ridges r;
    ridges_init(&r, spike, 40, -0.3, 0.1, 3, (double[]){2, 2.2, 0.512});
    for (int follow = 0; follow < 2; follow++) {
        r.scene.follow = follow;
        Result o = integrate(&r, (SltJob){.samples = 240000, .segments = 240000, .seed = 9});
        print_costs("spike", &r, &o);
        assert_int_equal(dropped(&o.stats), 0);
        /* Its tip is narrower than the lattice is wide: what is lost falls with the spacing, and what lines see of it
         * by chance says how much that is; unless it is followed from the lines that see it. */
        double lost = fabs(ridges_exact(&r, 1) - o.grad[1]);
        print_message("  lost %.6f of %.6f, missed estimate %.6f\n", lost, fabs(ridges_exact(&r, 1)),
                      fabs(o.missed[1]));
        assert_true(lost < (follow ? 0.01 : 0.2) * fabs(ridges_exact(&r, 1)) && lost < 2 * o.gerr[1]);
        if (!follow) assert_true(lost > 0.05 * fabs(ridges_exact(&r, 1)));
        if (!follow) close_to(fabs(o.missed[1]), lost, 0.25 * lost, "spike, missed");
        close_to(o.grad[0], ridges_exact(&r, 0), (follow ? 0.002 : 0.02) * fabs(o.boundary[0]), "spike, camera");
    }
}

/* Heights that are random from sample to sample: scanlines, a stream each. */
static double shaken(const double *p, double x, double rand0, uint32_t i) {
    double q[3] = {p[0], p[1] * (0.5 + rand0), p[2]};
    return land(q, x, 0, i);
}
static void test_random(void **state) {
    (void)state;
    static Ridges r;
    ridges_init(&r, shaken, 40, -0.4, 0.1, 3, (double[]){1.5, 1.1, 1.6});
    r.scene.uses_rand = true;
    Result o = integrate(&r, (SltJob){.samples = 240000, .segments = 120000, .seed = 10});
    print_costs("random", &r, &o);
    check_gradient("random", &r, &o, 0.04);
    assert_int_equal(dropped(&o.stats), 0);
}

static void test_estimators_agree(void **state) {
    (void)state;
    static Ridges r;
    init_land(&r);
    struct {
        SltEstimator e;
        double tolerance;
        const char *name;
    } row[] = {{SLT_EST_SCANLINE, 0.01, "scanline"},
               {SLT_EST_SNAP_CROFTON, 0.1, "snap-crofton"},
               {SLT_EST_SNAP_KNN, 0.3, "snap-knn"}};
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        Result o = integrate(&r, (SltJob){.samples = 240000, .segments = 120000, .seed = 11, .estimator = row[i].e});
        print_costs(row[i].name, &r, &o);
        check_gradient(row[i].name, &r, &o, row[i].tolerance);
        assert_true(dropped(&o.stats) * 100 <= o.stats.crossings);
    }
}

/* Image mode: the pixels' derivatives add up to the integral's, in both directions and with any number of threads. */
static void test_image(void **state) {
    (void)state;
    enum { SIZE = 96 };
    static Ridges r;
    static float image[SIZE * SIZE], again[SIZE * SIZE], ones[SIZE * SIZE];
    init_land(&r);
    for (int i = 0; i < SIZE * SIZE; i++) ones[i] = 1;
    double area = (r.scene.hi[1] - r.scene.lo[1]) / (SIZE * SIZE), first[3] = {0};
    for (uint32_t threads = 1; threads <= 5; threads += 2) {
        SltJob j = {.size = {SIZE, SIZE, 1}, .spp = 16, .segments = 4, .seed = 3, .threads = threads};
        SltError err;
        double grad[3], dir[3] = {0, 0, 1}, sum = 0;
        const float *adjoint[2] = {ones, ones};
        assert_int_equal(slt_estimate_reverse(&r.scene, &j, adjoint, grad, NULL, NULL, &err), SLT_OK);
        float *to = threads == 1 ? image : again;
        assert_int_equal(slt_estimate_forward(&r.scene, &j, 1, (const double *const[]){dir}, &to, NULL, NULL, &err),
                         SLT_OK);
        if (threads == 1) {
            memcpy(first, grad, sizeof first);
            for (int i = 0; i < SIZE * SIZE; i++) sum += (double)image[i];
            double exact = ridges_exact(&r, 2);
            close_to(sum * area, exact, 0.02 * fabs(exact), "forward");
            close_to(grad[2] * area, exact, 0.02 * fabs(exact), "reverse");
        } else {
            assert_memory_equal(first, grad, sizeof first);
            assert_memory_equal(image, again, sizeof image);
        }
    }
}

/* Boundary functions whose roots are never where the picture jumps, or jump themselves: every search ends, and what
 * cannot be integrated is counted. */
static double elsewhere(double x) { return x - 0.0123; }
static double nothing(double x) { return x > 0.5 ? HUGE_VAL : -HUGE_VAL; }
static double erratic(double x) { return sin(1e7 * x) < 0 ? -HUGE_VAL : 1e-3; }
static double unknown(double x) { return x * (HUGE_VAL - HUGE_VAL); }
static void test_lies_end(void **state) {
    (void)state;
    static Ridges r;
    double (*const lies[])(double) = {elsewhere, nothing, erratic, unknown};
    for (size_t i = 0; i < sizeof lies / sizeof *lies; i++) {
        init_land(&r);
        r.lie = lies[i];
        Result o = integrate(&r, (SltJob){.samples = 1, .segments = 4000, .seed = 12});
        print_costs("lie", &r, &o);
        double each = (double)(o.stats.evaluations - r.calls[SLT_K_VJP]) / 200; /* of about 200 true crossings */
        assert_true(each < 1000);
        for (uint32_t p = 0; p < 3; p++) assert_true(isfinite(o.grad[p]));
        if (i != 2) assert_true(dropped(&o.stats) > 0);
    }
    init_land(&r);
    r.is_static[0] = 1;
    Result o = integrate(&r, (SltJob){.samples = 1, .segments = 4000, .seed = 12});
    assert_true(o.stats.dropped[SLT_DROP_STATIC] > 50 && o.boundary[0] == 0);
}

static void test_jump_of_a_tile(void **state) {
    (void)state;
    Spread s;
    spread_clear(&s);
    assert_true(spread_threshold(&s) == 0x1p-14);
    for (int i = 0; i < 15; i++) spread_add(&s, 1);
    assert_true(spread_threshold(&s) == 0x1p-14); /* too few to say */
    /* Sky says nothing; jumps in a third of the rest change little. */
    for (int i = 0; i < 1000; i++) spread_add(&s, 0), spread_add(&s, HUGE_VAL);
    spread_clear(&s);
    for (int i = 0; i < 1000; i++)
        spread_add(&s, (i & 1 ? -1 : 1) * 0.001 * (1 + i % 10 * 0.1)), spread_add(&s, i % 2 ? 3.0 : 0);
    double jump = spread_threshold(&s);
    assert_true(jump > 0.001 && jump < 0.0025);
    uint32_t hash[8] = {1, 1, 1, 1, 1, 1, 2, 2};
    /* A slope that goes on is no jump; one that begins, or a single step, is. */
    double slope[8] = {0, 1, 2, 3, 4, 5, 6, 7}, step[8] = {0, 0.01, 0.02, 1.02, 1.03, 1.04, 0, 0};
    assert_true(depth_threshold(hash, slope, 1, 2, 8, 0.1) == 1.5);
    assert_true(depth_threshold(hash, slope, 1, 0, 8, 0.1) == 0.1);
    assert_true(depth_threshold(hash, slope, 1, 4, 8, 0.1) == 0.1); /* beside another region */
    assert_true(depth_threshold(hash, step, 1, 2, 8, 0.1) == 0.1);
}

/* Finite differences move heights, not the structure above them. */
static void test_slack(void **state) {
    (void)state;
    static Ridges r;
    init_land(&r);
    SltGeometry *made;
    SltError err;
    const GeometrySource from = {.kind = SLT_GEOMETRY_HEIGHTFIELD, .size = {2, 2}, .f64 = true};
    assert_int_equal(geometry_make(&made, &from, r.params, &err), SLT_OK);
    SltGeometry field = *made;
    field.slack = 0.25f;
    const SltGeometry *geometries[] = {&field};
    uint32_t base = 0;
    r.scene.geometries = geometries, r.scene.ngeometries = 1, r.scene.geometry_base = &base;
    r.low = HUGE_VAL;
    integrate(&r, (SltJob){.samples = 64, .estimator = SLT_EST_FD, .fd_step = 0.125});
    /* Twice the step, which the error is from, is the farthest. */
    assert_true(r.slack >= 0.5 && r.slack < 0.5001 && r.low == 0.25);
    assert_true(field.slack == 0.25f);
    geometry_free(made);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_ridges),           cmocka_unit_test(test_twice), cmocka_unit_test(test_shadow),
        cmocka_unit_test(test_grazing),          cmocka_unit_test(test_spike), cmocka_unit_test(test_random),
        cmocka_unit_test(test_estimators_agree), cmocka_unit_test(test_image), cmocka_unit_test(test_lies_end),
        cmocka_unit_test(test_jump_of_a_tile),   cmocka_unit_test(test_slack)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
