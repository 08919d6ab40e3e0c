/* Cells on scenes in C, against closed forms: what is integrated, what is proven, what is left over. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "tests/quadrature/run.h"

static void near(const char *what, double is, double want, double tolerance) {
    if (getenv("CELLS_SHOW")) printf("    %s: %.15g, wanted %.15g, off by %.2g\n", what, is, want, is - want);
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

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(step_in_1d),  cmocka_unit_test(step_on_a_face),      cmocka_unit_test(nested_in_1d),
        cmocka_unit_test(floor_in_1d), cmocka_unit_test(in_single_precision),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
