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
            double tolerance = fmax(pow(10, -(double)q), 2e-14) * 10, radius = p[i][2];
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
    /* r^3 - a r^2 - b Re / r^2, with something added to r^2 there */
    return num_sub(num_sub(rrr, num_mul(param(s, 0), rr)),
                   num_mul(param(s, 1), num_mul(five, num_inv(num_add(rr, num(0.05))))));
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
    return num_sub(num_sin(num_scale(240, num_add(num_sqr(dx), num_sqr(dy)))), param(s, 0));
}

typedef struct Smooth {
    const char *name;
    Num (*g)(const Scene *, uint32_t, const Num *);
    double p[2];
    uint32_t np;
    double least;
} Smooth;
/* The derivatives, whose error falls tenfold with every added pair of points. */
static void smooth_curves(void **state) {
    (void)state;
    /* The last number: the level at which rounding ends that. */
    static const Smooth of[] = {{"ring", ring_g, {0.3, 0.005}, 2, 1e-12},
                                {"flower", flower_g, {0.5, 0.2}, 2, 1e-11},
                                {"metaballs", metaballs_g, {1}, 1, 1e-11},
                                {"blobs", blobs_g, {0.3}, 1, 1e-9},
                                {"zone plate", zone_g, {0.1}, 1, 1e-9}};
    for (int i = 0; i < 5; i++) {
        double want[2] = {0}, off[2][9] = {{0}};
        if (getenv("CELLS_SHOW")) printf("%s\n", of[i].name);
        for (uint32_t q = 10; q >= 2; q -= 2) {
            if (of[i].g == zone_g && q > 6) continue;
            Scene s;
            scene_init(&s, 2, 1, 0, of[i].g, inside_f, of[i].p, of[i].np);
            CellOptions o = run_options(q);
            o.volume = false, o.coarse = 0;
            Run r = run_scene(&s, &o, NULL);
            assert_true(r.counts.left < 1e-8 && r.counts.boxes + r.counts.points < 4000000);
            for (uint32_t k = 0; k < of[i].np; k++) {
                if (want[k] == 0) want[k] = r.slope[0][k];
                if (q < 10) off[k][q] = fabs(r.slope[0][k] / want[k] - 1);
            }
        }
        for (uint32_t k = 0; k < of[i].np; k++)
            for (uint32_t q = 4; q < 10; q += 2)
                if (!(off[k][q] <= fmax(off[k][q - 2] / 10, of[i].least))) {
                    printf("%s, %u points: %g, with two fewer %g\n", of[i].name, q, off[k][q], off[k][q - 2]);
                    fail();
                }
    }
}

static uint64_t discs_points; /* of the last run */

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
    s.opaque = true, s.point = disc_point;
    discs_near(&s, p, n, (uint32_t)fmax(1, 0.5 / most));
    CellOptions o = *options;
    o.gauss = q, o.coarse = q - 1;
    Run r = run_scene(&s, &o, is);
    discs_points = r.counts.points;
    discs_exact(p, n, want);
    double off = 0, all = 0;
    for (uint32_t i = 0; i < 3 * n; i++) off += (is[i] - want[i]) * (is[i] - want[i]), all += want[i] * want[i];
    if (getenv("CELLS_SHOW")) printf("  %u discs, Q %u: %.2g, left %g\n", n, q, sqrt(off / all), r.counts.left);
    free(p), free(want), free(is), free((void *)s.near), free((void *)s.near_start);
    return sqrt(off / all);
}

static void opaque_discs(void **state) {
    (void)state;
    CellOptions o = run_options(4);
    o.volume = false, o.least = 0x1p-20;
    assert_true(discs_error(200, .02, .1, 7, &o) < 1e-5);
    o.fixed = false, o.tolerance = 1e-7;
    assert_true(discs_error(200, .02, .1, 4, &o) < 1e-7);
    assert_true(discs_error(2000, .01, .04, 4, &o) < 1e-7);
    /* Roots that end where cubics say that they are: fewer looks at g, and far less than the slack is lost. */
    o.flat = true;
    uint64_t points[2];
    for (int i = 0; i < 2; i++) {
        o.slack = i ? 0x1p-24 : 0;
        assert_true(discs_error(2000, .01, .04, 4, &o) < 1e-7);
        points[i] = discs_points;
    }
    assert_true((double)points[1] < 0.95 * (double)points[0]);
}

/* ---- several events */
static Num discs2_g(const Scene *s, uint32_t e, const Num *x) {
    Num dx = num_sub(x[0], param(s, 3 * e)), dy = num_sub(x[1], param(s, 3 * e + 1));
    return num_sub(num_add(num_sqr(dx), num_sqr(dy)), num_sqr(param(s, 3 * e + 2)));
}
static void both_f(Look *l, double *f) { f[0] = decide(l, 0) ? decide(l, 1) ? 3 : 1 : 0.5; }
/* A lens is nested in a disc; the arc of the second circle outside of the first is never looked at. */
static void lens(void **state) {
    (void)state;
    /* The last: equal discs, symmetric about the middle of the domain, in both axes aligned. */
    static const double p[3][6] = {{0.41, 0.47, 0.29, 0.63, 0.55, 0.26},
                                   {0.4, 0.5, 0.25, 0.6, 0.5, 0.25},
                                   {0.375, 0.375, 0.25, 0.625, 0.625, 0.25}};
    for (int i = 0; i < 3; i++)
        for (int volume = 0; volume < 2; volume++) {
            Scene s;
            scene_init(&s, 2, 2, 0, discs2_g, both_f, p[i], 6);
            CellOptions o = run_options(6);
            o.fixed = false, o.tolerance = volume ? 1e-9 : 1e-11, o.volume = volume;
            Run r = run_scene(&s, &o, NULL);
            double D = hypot(p[i][3] - p[i][0], p[i][4] - p[i][1]), a = p[i][2], b = p[i][5];
            double ca = acos((D * D + a * a - b * b) / (2 * D * a)), cb = acos((D * D + b * b - a * a) / (2 * D * b));
            double area = a * a * (ca - sin(2 * ca) / 2) + b * b * (cb - sin(2 * cb) / 2);
            if (volume) near("value", r.value[0], 0.5 + 0.5 * PI * a * a + 2 * area, 1e-7);
            near("first radius", r.slope[0][2], a * (0.5 * 2 * PI + 2 * 2 * ca), 1e-8);
            near("second radius", r.slope[0][5], b * 2 * 2 * cb, 1e-8);
            assert_true(r.counts.left < 1e-9);
        }
}

/* A line that leaves a disc where the two have no height axis in common. */
static Num chord_g(const Scene *s, uint32_t e, const Num *x) {
    return e ? circle_g(s, e, x) : num_sub(x[1], param(s, 3));
}
static void chord(void **state) {
    (void)state;
    const double p[] = {0.47, 0.53, 0.31, 0.57};
    Scene s;
    scene_init(&s, 2, 2, 0, chord_g, both_f, p, 4);
    CellOptions o = run_options(8);
    o.volume = false;
    Run r = run_scene(&s, &o, NULL);
    near("slope in the line", r.slope[0][3], 0.5 + 2 * 2 * sqrt(0.31 * 0.31 - 0.04 * 0.04), 1e-12);
    assert_true(r.counts.left == 0);
}

/* The nearest of three seeds: three lines that meet in a point. */
static Num seed_g(const Scene *s, uint32_t e, const Num *x) {
    static const uint32_t pair[3][2] = {{1, 0}, {2, 0}, {2, 1}};
    Num d[2];
    for (int k = 0; k < 2; k++) {
        uint32_t n = pair[e][k];
        d[k] = num_add(num_sqr(num_sub(x[0], param(s, 2 * n))), num_sqr(num_sub(x[1], param(s, 2 * n + 1))));
    }
    return num_sub(d[0], d[1]);
}
static void nearest_f(Look *l, double *f) {
    uint32_t best = decide(l, 0) ? 1 : 0;
    if (decide(l, best ? 2 : 1)) best = 2;
    f[0] = best == 0 ? 1 : best == 1 ? 2 : 4;
}
/* The integral over a polygon cut by half planes, exactly: the area nearest to seed k. */
static double area_nearest(const double *p, uint32_t k) {
    double v[16][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}}, w[16][2], area = 0;
    int n = 4;
    for (uint32_t j = 0; j < 3; j++) {
        if (j == k) continue;
        double a = 2 * (p[2 * j] - p[2 * k]), b = 2 * (p[2 * j + 1] - p[2 * k + 1]);
        double c =
            p[2 * j] * p[2 * j] + p[2 * j + 1] * p[2 * j + 1] - p[2 * k] * p[2 * k] - p[2 * k + 1] * p[2 * k + 1];
        int m = 0;
        for (int i = 0; i < n; i++) {
            double *u = v[i], *t = v[(i + 1) % n], gu = a * u[0] + b * u[1] - c, gt = a * t[0] + b * t[1] - c;
            if (gu <= 0) memcpy(w[m++], u, sizeof w[0]);
            if ((gu < 0) != (gt < 0))
                for (int d = 0; d < 2; d++) w[m][d] = u[d] + gu / (gu - gt) * (t[d] - u[d]);
            m += (gu < 0) != (gt < 0);
        }
        memcpy(v, w, sizeof v), n = m;
    }
    for (int i = 0; i < n; i++) area += 0.5 * (v[i][0] * v[(i + 1) % n][1] - v[(i + 1) % n][0] * v[i][1]);
    return area;
}
static double nearest_value(const double *p) {
    return area_nearest(p, 0) + 2 * area_nearest(p, 1) + 4 * area_nearest(p, 2);
}
static void triple_point(void **state) {
    (void)state;
    static const double p[2][6] = {{0.2, 0.3, 0.8, 0.4, 0.45, 0.85}, {0.25, 0.25, 0.75, 0.25, 0.5, 0.75}};
    for (int i = 0; i < 2; i++)
        for (int volume = 0; volume < 2; volume++) {
            Scene s;
            scene_init(&s, 2, 3, 0, seed_g, nearest_f, p[i], 6);
            CellOptions o = run_options(4);
            o.fixed = false, o.tolerance = 1e-11, o.volume = volume;
            Run r = run_scene(&s, &o, NULL);
            if (volume) near("value", r.value[0], nearest_value(p[i]), 1e-8);
            for (int k = 0; k < 6; k++) {
                double q[6], side[2];
                for (int t = 0; t < 2; t++) {
                    memcpy(q, p[i], sizeof q), q[k] += t ? 1e-4 : -1e-4;
                    side[t] = nearest_value(q);
                }
                near("slope", r.slope[0][k], (side[1] - side[0]) / 2e-4, 1e-6);
            }
        }
}

/* A rectangle as the sign of its distance, which bends at three seams; and as two conditions along the axes. */
static Num rectangle_g(const Scene *s, uint32_t e, const Num *x) {
    Num u = num_sub(x[0], param(s, 0)), v = num_sub(x[1], param(s, 1));
    if (e == 1) return u;
    if (e == 2) return v;
    Num a = num_sub(num_abs(u), param(s, 2)), b = num_sub(num_abs(v), param(s, 3));
    return e ? num_sub(a, b) : num_max(a, b);
}
static Num quadrant_g(const Scene *s, uint32_t e, const Num *x) { return num_sub(x[e], param(s, e)); }
static void quadrant_f(Look *l, double *f) { f[0] = decide(l, 0) ? decide(l, 1) ? 2 : 1 : decide(l, 1) ? 4 : 0; }
static void rectangles(void **state) {
    (void)state;
    const double p[2][4] = {{0.43, 0.51, 0.217, 0.134}, {0.5, 0.5, 0.25, 0.125}};
    for (int i = 0; i < 4; i++) {
        const double *q = p[i / 2];
        Scene s;
        CellOptions o = run_options(4);
        o.volume = i & 1;
        scene_init(&s, 2, 1, 3, rectangle_g, inside_f, q, 4);
        Run r = run_scene(&s, &o, NULL);
        if (o.volume) near("area", r.value[0], 4 * q[2] * q[3], 1e-10);
        near("in its centre", r.slope[0][0], 0, 1e-7); /* the corners are left over */
        near("in its width", r.slope[0][2], 4 * q[3], 1e-7);
        near("in its height", r.slope[0][3], 4 * q[2], 1e-7);
        scene_init(&s, 2, 2, 0, quadrant_g, quadrant_f, q, 2);
        r = run_scene(&s, &o, NULL);
        if (o.volume) near("area", r.value[0], 2 * q[0] * q[1] + q[0] * (1 - q[1]) + 4 * (1 - q[0]) * q[1], 1e-10);
        near("in x", r.slope[0][0], -2 * q[1] + (1 - q[1]), 1e-10);
        near("in y", r.slope[0][1], q[0] + 4 * (1 - q[0]), 1e-10);
        assert_true(r.counts.left < 1e-9);
    }
}

/* g jumps at untagged seams: the heights of steps. */
static Num stairs_g(const Scene *s, uint32_t e, const Num *x) {
    Num u = num_sub(num_scale(4, x[0]), num(0.3));
    if (e) return num_sub(u, num(e - 1));
    Num step = num_floor(u);
    return num_sub(x[1], num_mul(param(s, 0), num_add(num_mul(step, step), num(1))));
}
static void stairs(void **state) {
    (void)state;
    const double p = 0.09;
    for (int volume = 0; volume < 2; volume++) {
        Scene s;
        scene_init(&s, 2, 1, 4, stairs_g, inside_f, &p, 1);
        CellOptions o = run_options(4);
        o.volume = volume;
        Run r = run_scene(&s, &o, NULL);
        double slope = 0.075 * 2 + 0.25 * (1 + 2 + 5) + 0.175 * 10;
        if (volume) near("area", r.value[0], p * slope, 1e-10);
        near("slope", r.slope[0][0], slope, 1e-10);
        assert_true(r.counts.left < 1e-9);
    }
}

/* A site that jumps where an untagged seam does, with something behind the seam that makes cells be cut there: nothing
 * of the site is lost unseen. */
static Num coinciding_g(const Scene *s, uint32_t e, const Num *x) {
    if (e == 0) return stairs_g(s, 0, x);
    if (e == 1) return num_sub(x[0], num(0.325)); /* the seam 4 x - 0.3 = 1 */
    return stairs_g(s, e - 1, x);
}
static void coinciding_f(Look *l, double *f) { f[0] = (decide(l, 0) ? 1 : 0) + (decide(l, 1) ? 10 : 0); }
static void site_on_a_seam(void **state) {
    (void)state;
    const double p = 0.09;
    for (int volume = 0; volume < 2; volume++) {
        Scene s;
        scene_init(&s, 2, 2, 4, coinciding_g, coinciding_f, &p, 1);
        CellOptions o = run_options(4);
        o.volume = volume, o.least = 0x1p-8;
        Run r = run_scene(&s, &o, NULL);
        double seen = r.jumps[1], slope = 0.075 * 2 + 0.25 * (1 + 2 + 5) + 0.175 * 10;
        near("slope", r.slope[0][0], slope, 1e-10);
        /* The line x = 0.325 is 1 long. */
        if (!(fabs(seen - 1) < 1e-9) && !(r.counts.left > 0)) fail_msg("%g of the line, and nothing left over", seen);
    }
}

/* A sphere that is darkest at its edge: f has a root there, and does not jump. */
static void sphere_f(Look *l, double *f) {
    double dx = l->x[0] - 0.47, dy = l->x[1] - 0.53, in = 1 - (dx * dx + dy * dy) / (0.31 * 0.31);
    f[0] = decide(l, 0) && in > 0 ? sqrt(in) : 0;
}
static bool sphere_rough(const Scene *s, const Num *x) {
    Num g = circle_g(s, 0, x);
    return g.v.lo <= 0 && g.v.hi >= 0;
}
static void shaded_sphere(void **state) {
    (void)state;
    const double p[] = {0.47, 0.53, 0.31};
    Scene s;
    scene_init(&s, 2, 1, 0, circle_g, sphere_f, p, 3);
    s.rough = sphere_rough;
    CellOptions o = run_options(6);
    o.fixed = false, o.tolerance = 1e-8;
    Run r = run_scene(&s, &o, NULL);
    near("value", r.value[0], 2 * PI * 0.31 * 0.31 / 3, 1e-7);
    near("slope", r.slope[0][2], 0, 1e-6);
    assert_true(r.counts.left < 1e-9);
}

/* ---- small things */
/* A disc or a ring, anywhere, down to a millionth of the domain: it is found, or its place is reported as left over. */
static Num speck_g(const Scene *s, uint32_t e, const Num *x) {
    (void)e;
    Num dx = num_sub(x[0], param(s, 0)), dy = num_sub(x[1], param(s, 1)), r = num_add(num_sqr(dx), num_sqr(dy));
    if (s->p[3] == 0) return num_sub(r, num_sqr(param(s, 2)));
    return num_sub(num_abs(num_sub(num_sqrt(r), param(s, 2))), num(s->p[3]));
}
static void specks(void **state) {
    (void)state;
    uint64_t random = 7;
    for (int i = 0; i < 60; i++) {
        double p[4] = {disc_random(&random), disc_random(&random), pow(10, -1 - 5 * disc_random(&random)), 0};
        if (i % 2) p[3] = p[2] * pow(10, -0.5 - 1.5 * disc_random(&random));
        if (p[0] < p[2] * 1.1 || p[0] > 1 - p[2] * 1.1 || p[1] < p[2] * 1.1 || p[1] > 1 - p[2] * 1.1) continue;
        Scene s;
        scene_init(&s, 2, 1, 0, speck_g, inside_f, p, 4);
        CellOptions o = run_options(6);
        o.volume = false, o.fixed = false, o.tolerance = 1e-7 * p[2], o.least = 0x1p-20;
        Run r = run_scene(&s, &o, NULL);
        /* the integral is pi r^2, and 4 pi r w of a ring of half width w */
        double want = p[3] == 0 ? 2 * PI * p[2] : 4 * PI * p[3];
        bool found = fabs(r.slope[0][2] / want - 1) < 1e-6;
        bool reported = r.left > 0;
        if (!found && !reported)
            printf("speck %d at %g %g, radius %g, half width %g: %g instead of %g\n", i, p[0], p[1], p[2], p[3],
                   r.slope[0][2], want);
        assert_true(found || reported);
        if (p[3] == 0) assert_true(found);
    }
}

/* ---- 3D */
static Num ball_g(const Scene *s, uint32_t e, const Num *x) {
    Num sum = num(0);
    if (e) return num_sub(num_add(x[0], num_add(num_scale(0.3, x[1]), num_scale(0.2, x[2]))), param(s, 4));
    for (uint32_t d = 0; d < 3; d++) sum = num_add(sum, num_sqr(num_sub(x[d], param(s, d))));
    return num_sub(sum, num_sqr(param(s, 3)));
}
static void ball(void **state) {
    (void)state;
    const double p[] = {0.47, 0.53, 0.49, 0.31};
    for (int volume = 0; volume < 2; volume++) {
        Scene s;
        scene_init(&s, 3, 1, 0, ball_g, inside_f, p, 4);
        CellOptions o = run_options(6);
        o.fixed = false, o.tolerance = 1e-7, o.volume = volume, o.least = 0x1p-8;
        Run r = run_scene(&s, &o, NULL);
        if (volume) near("volume", r.value[0], 4 * PI / 3 * pow(0.31, 3), 1e-7);
        near("slope in the radius", r.slope[0][3], 4 * PI * 0.31 * 0.31, 1e-6);
        near("slope in x", r.slope[0][0], 0, 1e-6);
        near("slope in y", r.slope[0][1], 0, 1e-6);
        assert_true(r.counts.left < 1e-6);
    }
}
/* The part of a ball on one side of a slanted plane. */
static void ball_cap(void **state) {
    (void)state;
    const double p[] = {0.47, 0.53, 0.49, 0.31, 0.8};
    Scene s;
    scene_init(&s, 3, 2, 0, ball_g, both_f, p, 5);
    CellOptions o = run_options(6);
    o.fixed = false, o.tolerance = 1e-7, o.least = 0x1p-8;
    Run r = run_scene(&s, &o, NULL);
    double n = sqrt(1 + 0.09 + 0.04), d = (0.8 - 0.47 - 0.3 * 0.53 - 0.2 * 0.49) / n, R = 0.31,
           ball = 4 * PI / 3 * R * R * R;
    double below = PI * (R + d) * (R + d) * (2 * R - d) / 3; /* of the ball, where the plane's g < 0 */
    near("value", r.value[0], 0.5 + 0.5 * ball + 2 * below, 1e-7);
    near("slope in the plane", r.slope[0][4], 2 * PI * (R * R - d * d) / n, 1e-6);
    near("slope in the radius", r.slope[0][3], 0.5 * 4 * PI * R * R + 2 * 2 * PI * R * (R + d), 1e-6);
    assert_true(r.counts.left < 1e-6);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(step_in_1d),
                                       cmocka_unit_test(step_on_a_face),
                                       cmocka_unit_test(nested_in_1d),
                                       cmocka_unit_test(floor_in_1d),
                                       cmocka_unit_test(in_single_precision),
                                       cmocka_unit_test(circle),
                                       cmocka_unit_test(smooth_curves),
                                       cmocka_unit_test(opaque_discs),
                                       cmocka_unit_test(lens),
                                       cmocka_unit_test(chord),
                                       cmocka_unit_test(triple_point),
                                       cmocka_unit_test(rectangles),
                                       cmocka_unit_test(stairs),
                                       cmocka_unit_test(site_on_a_seam),
                                       cmocka_unit_test(shaded_sphere),
                                       cmocka_unit_test(specks),
                                       cmocka_unit_test(ball),
                                       cmocka_unit_test(ball_cap)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
