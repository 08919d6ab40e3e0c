/* Cells on scenes in C, against closed forms: what is integrated, what is proven, what is left over. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "tests/quadrature/discs.h"
#include "tests/quadrature/run.h"

static void near(const char *what, double is, double want, double tolerance) {
    if (getenv("CELLS_SHOW")) printf("    %s: %.15g, wanted %.15g, off by %.2g\n", what, is, want, is - want);
    if (!(fabs(is - want) <= tolerance)) {
        printf("%s: %.17g instead of %.17g, off by %g\n", what, is, want, is - want);
        if (!getenv("CELLS_SHOW")) fail();
    }
}

/* ---- 1D */
static Num step_g(const Scene *s, uint32_t e, const Num *x) {
    (void)e;
    return num_sub(x[0], param(s, 0));
}
static void step_f(Look *l, double *f) { f[0] = decide(l, 0) ? 2.5 + l->x[0] : l->x[0] * l->x[0]; }

static void step_in_1d(void **state) {
    (void)state;
    /* The last lies on a face of cells, as every shape with dyadic ends may. */
    const double at[] = {0.37, 1e-9, 1 - 0x1p-53, 0.5};
    for (int i = 0; i < 4; i++) {
        Scene s;
        scene_init(&s, 1, 1, 0, step_g, step_f, &at[i], 1);
        CellOptions o = run_options(4);
        Run r = run_scene(&s, &o, NULL);
        double t = at[i];
        near("integral", r.value[0], 2.5 * t + t * t / 2 + (1 - t * t * t) / 3, 1e-14);
        for (int rule = 0; rule < CELL_RULES; rule++) near("slope", r.slope[rule][0], 2.5 + t - t * t, 1e-13);
        assert_true(r.counts.left == 0 && r.left == 0);
    }
}

/* A jump on a face: of the two cells beside it one integrates it, and only one. */
static void step_on_a_face(void **state) {
    (void)state;
    for (int i = 0; i < 64; i++) {
        double t = i ? (double)i / 64 : 1.0 / 3;
        Scene s;
        scene_init(&s, 1, 1, 0, step_g, step_f, &t, 1);
        CellOptions o = run_options(3);
        o.grid[0] = 1.0 / 64;
        Run r = run_scene(&s, &o, NULL);
        near("slope", r.slope[0][0], 2.5 + t - t * t, 1e-13);
    }
}

static Num two_g(const Scene *s, uint32_t e, const Num *x) {
    if (e) return num_sub(num_sqr(x[0]), param(s, 1)); /* x < sqrt p1 */
    return num_sub(param(s, 0), num_sin(num_scale(10, x[0])));
}
static void two_f(Look *l, double *f) {
    f[0] = 0;
    if (decide(l, 0)) f[0] = decide(l, 1) ? 3 : 1;
}
/* sin 10x > p0, where x < sqrt p1 it counts thrice. */
static void nested_in_1d(void **state) {
    (void)state;
    const double p[] = {0.3, 0.05};
    Scene s;
    scene_init(&s, 1, 2, 0, two_g, two_f, p, 2);
    CellOptions o = run_options(4);
    Run r = run_scene(&s, &o, NULL);
    double pi = acos(-1), a = asin(0.3) / 10, z = (pi - asin(0.3)) / 10, b = a + 2 * pi / 10, y = z + 2 * pi / 10;
    double cut = sqrt(0.05), slope = 1 / (10 * sqrt(1 - 0.09));
    assert_true(a < cut && cut < z && y < 1);
    near("integral", r.value[0], 3 * (cut - a) + (z - cut) + (y - b), 1e-14);
    near("slope in the level", r.slope[0][0], -slope * (3 + 1 + 1 + 1), 1e-13);
    near("slope in the cut", r.slope[0][1], 2 / (2 * cut), 1e-13);
    assert_true(r.counts.left == 0);
}

static Num ramp_g(const Scene *s, uint32_t e, const Num *x) {
    (void)e;
    return num_mul(param(s, 0), x[0]);
}
static void ramp_f(Look *l, double *f) { f[0] = decide_floor(l, 0); }
static void floor_in_1d(void **state) {
    (void)state;
    const double a = 4.3;
    Scene s;
    scene_init(&s, 1, 1, 0, ramp_g, ramp_f, &a, 1);
    scene_floors(&s);
    CellOptions o = run_options(2);
    Run r = run_scene(&s, &o, NULL);
    near("integral", r.value[0], 4 - 10 / a, 1e-14);
    near("slope", r.slope[0][0], 10 / (a * a), 1e-13);
    assert_true(r.counts.left == 0);
}

static void in_single_precision(void **state) {
    (void)state;
    const float t32 = 0.37f;
    const double t = t32;
    Scene s;
    scene_init(&s, 1, 1, 0, step_g, step_f, &t, 1);
    s.slt.f64 = false, s.slt.params = &t32;
    CellOptions o = run_options(4);
    Run r = run_scene(&s, &o, NULL);
    near("integral", r.value[0], 2.5 * t + t * t / 2 + (1 - t * t * t) / 3, 2e-7);
    near("slope", r.slope[0][0], 2.5 + t - t * t, 5e-6);
    assert_true(r.counts.left == 0);
}

/* ---- 2D */
static const double PI = 3.14159265358979323846;

static Num circle_g(const Scene *s, uint32_t e, const Num *x) {
    (void)e;
    Num dx = num_sub(x[0], param(s, 0)), dy = num_sub(x[1], param(s, 1));
    return num_sub(num_add(num_sqr(dx), num_sqr(dy)), num_sqr(param(s, 2)));
}
static void inside_f(Look *l, double *f) { f[0] = decide(l, 0) ? 1 : 0; }

static void circle(void **state) {
    (void)state;
    /* The second has its centre and extremes on dyadic places. */
    const double p[2][3] = {{0.47, 0.53, 0.31}, {0.5, 0.5, 0.25}};
    for (int i = 0; i < 2; i++)
        for (uint32_t q = 2; q <= 10; q += 2) {
            Scene s;
            scene_init(&s, 2, 1, 0, circle_g, inside_f, p[i], 3);
            CellOptions o = run_options(q);
            Run r = run_scene(&s, &o, NULL);
            double tolerance = fmax(pow(10, -(double)q), 2e-14)*10, radius = p[i][2];
            near("area", r.value[0], PI * radius * radius, tolerance);
            near("slope in the radius", r.slope[0][2], 2 * PI * radius, tolerance);
            near("slope in x", r.slope[0][0], 0, tolerance);
            assert_true(r.counts.left == 0);
        }
}

static Num ring_g(const Scene *s, uint32_t e, const Num *x) {
    (void)e;
    Num dx = num_sub(x[0], num(0.47)), dy = num_sub(x[1], num(0.53));
    Num r = num_sqrt(num_add(num_sqr(dx), num_sqr(dy)));
    return num_sub(num_sqr(num_sub(r, param(s, 0))), num_sqr(param(s, 1)));
}
/* An implicit flower without atan2: r^2 - (a + b cos 5 phi) by the polynomial Re (x + i y)^5. */
static Num flower_g(const Scene *s, uint32_t e, const Num *x) {
    (void)e;
    Num u = num_scale(2, num_sub(x[0], num(0.51))), v = num_scale(2, num_sub(x[1], num(0.49)));
    Num uu = num_sqr(u), vv = num_sqr(v), rr = num_add(uu, vv);
    Num five = num_mul(u, num_add(num_sub(num_sqr(uu), num_scale(10, num_mul(uu, vv))), num_scale(5, num_sqr(vv))));
    Num r = num_sqrt(rr), rrr = num_mul(rr, r);
    /* r^4 - a r^3 - b r^-1 Re, times what keeps it a polynomial of r */
    return num_sub(num_sub(num_mul(rr, rrr), num_mul(param(s, 0), num_sqr(rr))), num_mul(param(s, 1), five));
}
static Num metaballs_g(const Scene *s, uint32_t e, const Num *x) {
    static const double at[8][3] = {{.22, .31, .05}, {.41, .27, .07}, {.63, .36, .06}, {.77, .61, .08},
                                    {.52, .71, .05}, {.31, .66, .07}, {.18, .52, .04}, {.71, .22, .05}};
    Num sum = num(0);
    (void)e;
    for (int i = 0; i < 8; i++) {
        Num dx = num_sub(x[0], num(at[i][0])), dy = num_sub(x[1], num(at[i][1]));
        Num rr = num_add(num_add(num_sqr(dx), num_sqr(dy)), num(1e-4));
        sum = num_add(sum, num_scale(at[i][2] * at[i][2], num_inv(rr)));
    }
    return num_sub(param(s, 0), sum);
}
static Num blobs_g(const Scene *s, uint32_t e, const Num *x) {
    (void)e;
    return num_add(num_mul(num_sin(num_scale(56.1, x[0])), num_sin(num_scale(55.3, x[1]))), param(s, 0));
}
static Num zone_g(const Scene *s, uint32_t e, const Num *x) {
    (void)e;
    Num dx = num_sub(x[0], num(0.47)), dy = num_sub(x[1], num(0.53));
    return num_sub(num_sin(num_scale(480, num_add(num_sqr(dx), num_sqr(dy)))), param(s, 0));
}

typedef struct Smooth {
    const char *name;
    Num (*g)(const Scene *, uint32_t, const Num *);
    double p[2];
    uint32_t np;
} Smooth;
static void smooth_curves(void **state) {
    (void)state;
    static const Smooth of[] = {{"ring", ring_g, {0.3, 0.005}, 2},  {"flower", flower_g, {0.5, 0.2}, 2},
                                {"metaballs", metaballs_g, {1}, 1}, {"blobs", blobs_g, {0.3}, 1},
                                {"zone plate", zone_g, {0.1}, 1}};
    for (int i = 0; i < 5; i++) {
        if (getenv("ONLY") && atoi(getenv("ONLY")) != i) continue;
        double want[3] = {0};
        printf("%s\n", of[i].name);
        for (uint32_t q = 12; q >= 2; q -= 2) {
            Scene s;
            scene_init(&s, 2, 1, 0, of[i].g, inside_f, of[i].p, of[i].np);
            CellOptions o = run_options(q);
            o.volume = getenv("CELLS_VOLUME") != NULL;
            o.budget = 3000000;
            Run r = run_scene(&s, &o, NULL);
            double is[3] = {r.value[0], r.slope[0][0], r.slope[0][1]};
            if (q == 12) memcpy(want, is, sizeof want);
            for (uint32_t k = !o.volume; k <= of[i].np; k++)
                printf("  Q %u: %.12g relative %.2g\n", q, is[k], fabs(is[k] / want[k] - 1));
        }
    }
}

/* Relative L2 error over the 3 n derivatives. */
static double discs_error(uint32_t n, double least, double most, uint32_t q, const CellOptions *options) {
    double *p = malloc(3 * n * sizeof *p), *want = malloc(3 * n * sizeof *p), *is = calloc(3 * n, sizeof *p);
    uint64_t random = n;
    for (uint32_t i = 0; i < n; i++) {
        p[3 * i] = disc_random(&random), p[3 * i + 1] = disc_random(&random);
        p[3 * i + 2] = least + (most - least) * disc_random(&random);
    }
    Scene s;
    scene_init(&s, 2, n, 0, disc_g, paint, p, 3 * n);
    s.opaque = true;
    discs_near(&s, p, n, (uint32_t)fmax(1, 0.5 / most));
    CellOptions o = *options;
    o.gauss = q;
    Run r = run_scene(&s, &o, is);
    discs_exact(p, n, want);
    double off = 0, all = 0;
    for (uint32_t i = 0; i < 3 * n; i++) off += (is[i] - want[i]) * (is[i] - want[i]), all += want[i] * want[i];
    if (getenv("CELLS_SHOW")) printf("  %u discs, Q %u: %.2g, left %g\n", n, q, sqrt(off / all), r.counts.left);
    free(p), free(want), free(is), free((void *)s.near), free((void *)s.near_start);
    return sqrt(off / all);
}

static void opaque_discs(void **state) {
    (void)state;
    CellOptions o = run_options(3);
    o.volume = false, o.least = 0x1p-20;
    for (uint32_t q = 2; q < 8; q++) discs_error(200, .02, .1, q, &o);
    for (uint32_t q = 3; q < 8; q++) discs_error(2000, .01, .04, q, &o);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(step_in_1d),  cmocka_unit_test(step_on_a_face),      cmocka_unit_test(nested_in_1d),
        cmocka_unit_test(floor_in_1d), cmocka_unit_test(in_single_precision), cmocka_unit_test(circle), cmocka_unit_test(smooth_curves), cmocka_unit_test(opaque_discs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
