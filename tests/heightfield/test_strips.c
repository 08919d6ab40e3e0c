/* Hundreds of shadows narrower than the lattice: the lines of the lattice have no gaps where bounds of rays prove it
 * (runtime/sample/prove.h), so derivatives are lost only to what is narrower still, and the stated errors hold. With
 * quadrature curves are followed through cells (runtime/quadrature/march.c), and come out right.
 *
 * Posts of one texel on flat ground: what is dark is known exactly, the convex hull of a post's foot and of its tip's
 * shadow. Real ground under a low sun (SALTUS_DATA): against lines thirty times denser, and differences of the value.
 * SALTUS_PRINT=1: more seeds and densities, for docs/heightfields.md. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/saltus.h"

enum { N = 513, SIDE = 18, POSTS = SIDE * SIDE, BLOCK = 28 }; /* a block of cells for each post and its shadow */
#define RAISED 0.001 /* the rays' origins above the ground */
static const double sun[3] = {-0.9, -0.31, 0.25};

/* Posts and their heights, all different. */
static void post(int k, int at[2], double *height) {
    at[0] = 6 + BLOCK * (k % SIDE) + k * 7 % 3, at[1] = 10 + BLOCK * (k / SIDE) + k * 5 % 4;
    *height = 0.0085 + 0.002 * (k * 37 % POSTS) / POSTS;
}

static double turn(const double *o, const double *a, const double *b) {
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
}

/* The area of the hull of n points: gift wrapping. */
static double hull_area(const double (*p)[2], int n) {
    int first = 0, steps = 0;
    double area = 0;
    for (int i = 1; i < n; i++)
        if (p[i][0] < p[first][0]) first = i;
    int at = first;
    do {
        int next = at == 0 ? 1 : 0;
        for (int i = 0; i < n; i++)
            if (i != at && turn(p[at], p[next], p[i]) < 0) next = i;
        area += 0.5 * (p[at][0] * p[next][1] - p[at][1] * p[next][0]);
        at = next;
    } while (at != first && ++steps < 16);
    return area;
}

/* A post is a pyramid over the six neighbours of its node (cells are split along (1,0)-(0,1)), cut at the height of the
 * origins. */
static double dark(int k, const double s[3]) {
    static const int foot[6][2] = {{1, 0}, {0, 1}, {-1, 1}, {-1, 0}, {0, -1}, {1, -1}};
    int at[2];
    double p[7][2], h, cell = 1.0 / (N - 1);
    post(k, at, &h);
    for (int i = 0; i < 7; i++)
        for (int d = 0; d < 2; d++)
            p[i][d] = cell * (at[d] + (i < 6 ? (h - RAISED) / h * foot[i][d] : 0)) -
                      (i == 6 ? (h - RAISED) * s[d] / s[2] : 0);
    return hull_area((const double(*)[2])p, 7);
}

static void posts_exact(const double at[3], double d[3]) {
    for (int a = 0; a < 3; a++) {
        double up[3], down[3];
        memcpy(up, at, sizeof up), memcpy(down, at, sizeof down);
        up[a] += 1e-6, down[a] -= 1e-6, d[a] = 0;
        for (int k = 0; k < POSTS; k++) d[a] += (dark(k, up) - dark(k, down)) / 2e-6;
    }
}

static SltProgram *compile(const char *source, bool f64, int near_miss) {
    SltProgram *p;
    SltOptions o = {.struct_size = sizeof o, .f64 = f64, .near_miss = near_miss};
    if (slt_compile_string(source, "strips", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
    return p;
}

static void set_heights(SltProgram *p, const double *v, uint32_t n) {
    SltError err;
    SltParam q = SLT_PARAM_INIT;
    assert_int_equal(slt_param_find(p, "h", &q, &err), SLT_OK);
    assert_int_equal(slt_set_floats(p, q.fbase, n, v, &err), SLT_OK);
}

static const char posts[] = "[Extent(0, 0, 1, 1)] param heightfield h = zeros(513, 513);\n"
                            "param float3 sun = float3(-0.9, -0.31, 0.25);\n"
                            "shader float main(float2 x) {\n"
                            "    [Disc] if (h.occluded(float3(x, 0.001), sun, 0.0, 10.0)) return 1.0;\n"
                            "    return 0.0;\n"
                            "}\n";
/* The same under a disc, whose edge crosses some of the shadows. */
static const char posts_and_disc[] = "[Extent(0, 0, 1, 1)] param heightfield h = zeros(513, 513);\n"
                                     "param float3 sun = float3(-0.9, -0.31, 0.25);\n"
                                     "param float r = 0.3;\n"
                                     "shader float main(float2 x) {\n"
                                     "    float f = 0.0;\n"
                                     "    [Disc] if (length(x - float2(0.51, 0.48)) < r) f = 2.0;\n"
                                     "    [Disc] if (h.occluded(float3(x, 0.001), sun, 0.0, 10.0)) f += 1.0;\n"
                                     "    return f;\n"
                                     "}\n";

static SltProgram *load_posts(const char *source, bool f64, int near_miss) {
    SltProgram *p = compile(source, f64, near_miss);
    double *v = calloc(N * N, sizeof *v);
    for (int k = 0; k < POSTS; k++) {
        int at[2];
        double h;
        post(k, at, &h);
        v[(N - 1 - at[1]) * N + at[0]] = h;
    }
    set_heights(p, v, N * N);
    free(v);
    return p;
}

typedef struct Found {
    double sun[3], error[3], missed[3]; /* derivatives, stated standard errors, missed estimates */
    double radius, radius_error;        /* of the disc, if there is one */
    SltStats stats;
} Found;

/* With the members of a job that say what is wanted; the others are the same always. */
static Found run_job(SltProgram *p, const SltJob *wanted) {
    Found f = {.stats = SLT_STATS_INIT};
    SltError err;
    SltParam s = SLT_PARAM_INIT;
    slt_param_find(p, "sun", &s, &err);
    uint32_t n = slt_float_count(p);
    double *g = calloc(3 * (size_t)n, sizeof *g);
    SltJob j = *wanted;
    j.struct_size = sizeof j, j.integral = true, j.samples = 16, j.no_interior = true;
    j.threads = wanted->threads ? wanted->threads : 2;
    SltIntegral out = {
        .struct_size = sizeof out, .gradient = g, .gradient_stderr = g + n, .missed_estimate = g + 2 * (size_t)n};
    if (slt_grad_integral(p, &j, &out, &f.stats, &err) != SLT_OK) fail_msg("%s", err.text);
    for (int a = 0; a < 3; a++)
        f.sun[a] = g[s.fbase + (uint32_t)a], f.error[a] = g[n + s.fbase + (uint32_t)a],
        f.missed[a] = g[2 * (size_t)n + s.fbase + (uint32_t)a];
    if (slt_param_find(p, "r", &s, &err) == SLT_OK) f.radius = g[s.fbase], f.radius_error = g[n + s.fbase];
    free(g);
    return f;
}

static Found run(SltProgram *p, SltEstimator estimator, uint64_t segments, uint32_t seed) {
    return run_job(p, &(SltJob){.estimator = estimator, .segments = segments, .seed = seed});
}

/* Relative to the largest component: how far off, at most, and the error stated there. */
static double compare(const char *what, const Found *f, const double want[3], double *worst) {
    double scale = 0, off = 0;
    for (int a = 0; a < 3; a++) scale = fmax(scale, fabs(want[a]));
    *worst = 0;
    for (int a = 0; a < 3; a++) {
        double e = fabs(f->sun[a] - want[a]), stated = f->error[a];
        off = fmax(off, e / scale);
        *worst = fmax(*worst, e / stated);
    }
    print_message(
        "%-44s off by %6.3f %% of the largest, stated %6.3f %%, missed estimate %6.3f %%, at most %4.1f times "
        "what is stated; %llu evaluations, %.2f s\n",
        what, 100 * off, 100 * f->error[2] / scale, 100 * fabs(f->missed[2]) / scale, *worst,
        (unsigned long long)f->stats.evaluations, f->stats.seconds);
    return off;
}

static void test_posts(void **state) {
    (void)state;
    double want[3], worst;
    posts_exact(sun, want);
    uint32_t seeds = getenv("SALTUS_PRINT") ? 8 : 1;
    for (int f64 = 0; f64 < (seeds > 1 ? 2 : 1); f64++) {
        SltProgram *gaps = load_posts(posts, f64, 0), *p = load_posts(posts, f64, -1);
        for (uint32_t seed = 0; seed < seeds; seed++) {
            Found a = run(gaps, SLT_EST_LATTICE, 1 << 20, seed), b = run(p, SLT_EST_LATTICE, 1 << 20, seed);
            Found c = run(p, SLT_EST_QUADRATURE, (1 << 20) >> seed, 0);
            double lost = compare("324 posts, lines with gaps", &a, want, &worst);
            double off = compare("324 posts, lines without gaps", &b, want, &worst);
            assert_true(lost > 0.02);
            assert_true(off < 0.003 && worst < 2);
            off = compare("324 posts, curves", &c, want, &worst);
            assert_true((off < 0.0015 || seed) && worst < 1);
            assert_true(seed || c.error[2] < 0.003 * fabs(want[2]));
        }
        Found d = run(p, SLT_EST_AUTO, 1 << 20, 0);
        assert_true(compare("324 posts, by default", &d, want, &worst) < 0.0015 && worst < 1);
        assert_true(d.stats.cells);
        slt_program_free(gaps), slt_program_free(p);
    }
}

/* Stated errors mean what they say: under several suns and with several sizes of cells the root mean square error is
 * .2 to 1.2 of the median of what is stated. */
static void test_bars(void **state) {
    (void)state;
    enum { SUNS = 6 };
    SltProgram *p = load_posts(posts, false, -1);
    SltError err;
    SltParam at = SLT_PARAM_INIT;
    double squares[3] = {0}, stated[3][SUNS];
    assert_int_equal(slt_param_find(p, "sun", &at, &err), SLT_OK);
    for (int k = 0; k < SUNS; k++) {
        double s[3] = {sun[0] * (1 + 0.02 * (k % 3 - 1)), sun[1] * (1 + 0.03 * (k % 2)), sun[2] * (1 - 0.01 * k)};
        double want[3], worst;
        posts_exact(s, want);
        assert_int_equal(slt_set_floats(p, at.fbase, 3, s, &err), SLT_OK);
        Found f = run(p, SLT_EST_QUADRATURE, 20000 + 4000 * (uint64_t)k, 0);
        compare("324 posts, curves, another sun", &f, want, &worst);
        assert_true(worst < 2);
        for (int a = 0; a < 3; a++) {
            squares[a] += (f.sun[a] - want[a]) * (f.sun[a] - want[a]) / SUNS;
            int i = k;
            for (; i && stated[a][i - 1] > f.error[a]; i--) stated[a][i] = stated[a][i - 1];
            stated[a][i] = f.error[a];
        }
    }
    for (int a = 0; a < 3; a++) {
        double ratio = sqrt(squares[a]) / (0.5 * (stated[a][SUNS / 2 - 1] + stated[a][SUNS / 2]));
        print_message("root mean square error, of the median stated: %.2f\n", ratio);
        assert_true(ratio > 0.2 && ratio < 1.2);
    }
    slt_program_free(p);
}

/* Fewer evaluations than following all curves takes: some cells stand for others, and the error says so. */
static void test_few_evaluations(void **state) {
    (void)state;
    double want[3], worst;
    posts_exact(sun, want);
    SltProgram *p = load_posts(posts, false, -1);
    for (uint64_t most = 500000; most <= 1000000; most += 250000) {
        Found f = run_job(p, &(SltJob){.estimator = SLT_EST_QUADRATURE, .segments = 1 << 18, .max_evaluations = most});
        double off = compare("324 posts, few evaluations", &f, want, &worst);
        assert_true(off < 0.1 && worst < 2);
        assert_true(f.stats.evaluations < 1.5 * (double)most);
    }
    slt_program_free(p);
}

/* An error that is asked for is reached, and holds. */
static void test_error(void **state) {
    (void)state;
    double want[3], worst;
    posts_exact(sun, want);
    SltProgram *p = load_posts(posts, true, -1);
    Found f = run_job(p, &(SltJob){.estimator = SLT_EST_QUADRATURE, .segments = 1 << 14, .error = 0.005});
    double off = compare("324 posts, an error of 0.5 %", &f, want, &worst);
    assert_int_equal(f.stats.stopped, SLT_STOP_NONE);
    assert_true(off < 0.005 && worst < 1 && f.error[2] <= 0.005 * fabs(want[2]));
    slt_program_free(p);
}

/* Shadows beside other curves, which lie in the same cells: the same derivatives as each has alone. */
static void test_mixed(void **state) {
    (void)state;
    const double radius = 2 * 2 * 3.14159265358979323846 * 0.3;
    double want[3], worst;
    posts_exact(sun, want);
    SltProgram *p = load_posts(posts_and_disc, false, -1);
    Found f = run(p, SLT_EST_QUADRATURE, 1 << 18, 0);
    double off = compare("324 posts and a disc", &f, want, &worst), of_radius = fabs(f.radius - radius);
    print_message("the disc's radius: off by %.1e, stated %.1e\n", of_radius / radius, f.radius_error / radius);
    assert_true(off < 0.005 && worst < 1);
    assert_true(of_radius < 0.002 * radius && of_radius < 2 * f.radius_error);
    slt_program_free(p);
}

static void test_threads(void **state) {
    (void)state;
    SltProgram *p = load_posts(posts, false, -1);
    for (int few = 0; few < 2; few++) {
        SltJob j = {.estimator = SLT_EST_QUADRATURE, .segments = 1 << 14, .max_evaluations = few ? 500000 : 0};
        Found of[3];
        for (uint32_t k = 0; k < 3; k++) j.threads = k + 1, of[k] = run_job(p, &j);
        for (uint32_t k = 1; k < 3; k++) {
            assert_memory_equal(of[k].sun, of[0].sun, sizeof of[0].sun);
            assert_memory_equal(of[k].error, of[0].error, sizeof of[0].error);
            assert_int_equal(of[k].stats.evaluations, of[0].stats.evaluations);
        }
    }
    slt_program_free(p);
}

/* Real ground, ten times as high, the sun eleven degrees above it: 64 % of it dark. */
enum { W = 403, H = 344 };
static const char real[] = "[Extent(0, 0, 1, 1)] [Height(0.0001, 0.0)] param heightfield h = zeros(403, 344);\n"
                           "param float3 sun = float3(-0.9, -0.31, 0.2);\n"
                           "[Domain(0.45, 0.95)]\n"
                           "shader float main(float2 x) {\n"
                           "    [Disc] if (h.occluded(float3(x, h.height(x) + 1e-4), sun, 0.0, 10.0)) return 1.0;\n"
                           "    return 0.0;\n"
                           "}\n";

/* By curves through cells, 2^22 segments in f64: stated 0.1 %; 2^20 segments are 0.001 % off it. */
static const double real_sun[3] = {-0.12602325616111207, -0.027547578784093966, -0.60980339984034282};

static SltProgram *load_real(bool f64, int near_miss) {
    const char *folder = getenv("SALTUS_DATA");
    char path[512];
    static float z[W * H];
    static double v[W * H];
    if (!folder) return NULL;
    snprintf(path, sizeof path, "%s/jacksboro_403x344.f32", folder);
    FILE *file = fopen(path, "rb");
    if (!file) return NULL;
    assert_int_equal(fread(z, sizeof *z, W * H, file), W * H);
    fclose(file);
    for (int i = 0; i < W * H; i++) v[i] = z[i];
    SltProgram *p = compile(real, f64, near_miss);
    set_heights(p, v, W * H);
    return p;
}

static void test_real(void **state) {
    (void)state;
    SltProgram *gaps = load_real(false, 0), *p = load_real(false, -1);
    double worst;
    if (!gaps) {
        print_message("no SALTUS_DATA: skipped\n");
        skip();
    }
    uint32_t seeds = getenv("SALTUS_PRINT") ? 8 : 1;
    /* 2^18 segments of a quarter of the ground are as dense as 2^20 of all of it. */
    for (uint32_t seed = 0; seed < seeds; seed++) {
        Found a = run(gaps, SLT_EST_LATTICE, 1 << 18, seed), b = run(p, SLT_EST_LATTICE, 1 << 18, seed);
        double lost = compare("real ground, lines with gaps", &a, real_sun, &worst);
        double off = compare("real ground, lines without gaps", &b, real_sun, &worst);
        assert_true(lost > 0.02);
        /* What is left is that lines are few; half a per cent, which the standard error knows. */
        assert_true(off < 0.012 && worst < 2.5);
    }
    /* Curves have no seed. Other cells, and fewer of them: */
    static const uint64_t segments[] = {1 << 18, 200000, 1 << 14, 1 << 16, 1 << 20};
    for (uint32_t k = 0; k < (seeds > 1 ? 5 : 2); k++) {
        Found c = run(p, SLT_EST_QUADRATURE, segments[k], 0);
        double off = compare("real ground, curves", &c, real_sun, &worst);
        assert_true((off < 0.0015 || segments[k] < 1 << 17) && worst < 1);
        assert_true(c.error[2] < 0.0025 * fabs(real_sun[2]) || segments[k] < 1 << 17);
    }
    /* By default, where so many segments pay for following them. */
    Found d = run(p, SLT_EST_AUTO, 1 << 20, 0), few = run(p, SLT_EST_AUTO, 1 << 14, 0);
    assert_true(compare("real ground, by default", &d, real_sun, &worst) < 0.0015 && worst < 1);
    assert_true(d.stats.cells && !few.stats.cells);
    slt_program_free(gaps), slt_program_free(p);
}

/* Where bounds settle nothing for rounding, the halving of cells ends soon. */
static void test_rounding(void **state) {
    (void)state;
    SltProgram *p = compile("param heightfield h = zeros(12, 12);\n"
                            "shader float main(float2 x) {\n"
                            "    float3 p = float3(x, h.height(x) + 1e-5);\n"
                            "    [Disc] if (h.occluded(p, float3(0.5, -0.4, 0.5), 0.0, 1e9)) return 0.0;\n"
                            "    return 1.0;\n"
                            "}\n",
                            false, -1);
    double v[12 * 12];
    for (uint32_t i = 0; i < 12 * 12; i++) v[i] = 0.2 * (i * 2654435761u >> 8) * 0x1p-24;
    set_heights(p, v, 12 * 12);
    SltStats stats = SLT_STATS_INIT;
    SltError err;
    SltJob j = SLT_JOB_INIT;
    uint32_t n = slt_float_count(p);
    double *g = calloc(n, sizeof *g);
    SltIntegral out = {.struct_size = sizeof out, .gradient = g};
    j.segments = 1 << 16, j.samples = 16, j.no_interior = true, j.estimator = SLT_EST_QUADRATURE;
    if (slt_grad_integral(p, &j, &out, &stats, &err) != SLT_OK) fail_msg("%s", err.text);
    print_message("rounding: %llu evaluations\n", (unsigned long long)stats.evaluations);
    assert_true(stats.evaluations < 16000000);
    free(g), slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_posts),           cmocka_unit_test(test_bars),
                                       cmocka_unit_test(test_few_evaluations), cmocka_unit_test(test_error),
                                       cmocka_unit_test(test_mixed),           cmocka_unit_test(test_threads),
                                       cmocka_unit_test(test_rounding),        cmocka_unit_test(test_real)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
