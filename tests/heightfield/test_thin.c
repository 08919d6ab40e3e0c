/* Fingers of shadow thinner than the lattice: posts of one texel on flat ground under a low sun. What is dark is the
 * convex hull of the post's foot and of its tip's shadow, so that areas and their derivatives are known. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/saltus.h"

enum { N = 33, HEIGHTS = N * N, POSTS = 5 };
#define RAISED 0.004 /* the rays' origins above the ground */

static const int post[POSTS][2] = {{4, 2}, {7, 8}, {5, 14}, {8, 20}, {6, 26}};
static const double tall[POSTS] = {0.11, 0.12, 0.10, 0.12, 0.11};

typedef struct Sun {
    double x, y, z;
} Sun;

/* The area of the hull of n points. */
static int turn(const double *o, const double *a, const double *b) {
    double v = (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
    return v > 0 ? 1 : v < 0 ? -1 : 0;
}
static double hull_area(const double (*p)[2], int n) {
    /* Gift wrapping. */
    int first = 0, at, hull[16], m = 0;
    for (int i = 1; i < n; i++)
        if (p[i][0] < p[first][0]) first = i;
    at = first;
    do {
        hull[m++] = at;
        int next = at == 0 ? 1 : 0;
        for (int i = 0; i < n; i++)
            if (i != at && turn(p[at], p[next], p[i]) < 0) next = i;
        at = next;
    } while (at != first && m < 16);
    double area = 0;
    for (int i = 0; i < m; i++) {
        const double *a = p[hull[i]], *b = p[hull[(i + 1) % m]];
        area += 0.5 * (a[0] * b[1] - a[1] * b[0]);
    }
    return area;
}

/* A post of height h: a pyramid over the six neighbours of its node (cells are split along (1,0)-(0,1)), cut at the
 * height of the origins. */
static double dark(int k, double h, Sun s) {
    static const int foot[6][2] = {{1, 0}, {0, 1}, {-1, 1}, {-1, 0}, {0, -1}, {1, -1}};
    double p[7][2], cell = 1.0 / (N - 1), part = (h - RAISED) / h;
    for (int i = 0; i < 7; i++) {
        for (int d = 0; d < 2; d++) p[i][d] = cell * (post[k][d] + (i < 6 ? part * foot[i][d] : 0));
        if (i == 6) p[i][0] -= (h - RAISED) * s.x / s.z, p[i][1] -= (h - RAISED) * s.y / s.z;
    }
    return hull_area((const double(*)[2])p, 7);
}

typedef struct Answer {
    double height[POSTS], sun[3]; /* derivatives of the dark area */
} Answer;

static Answer exact(Sun s) {
    Answer a = {{0}, {0}};
    for (int k = 0; k < POSTS; k++) {
        a.height[k] = (dark(k, tall[k] + 1e-5, s) - dark(k, tall[k] - 1e-5, s)) / 2e-5;
        for (int d = 0; d < 3; d++) {
            Sun up = s, down = s;
            *(d == 0   ? &up.x
              : d == 1 ? &up.y
                       : &up.z) += 1e-6,
                *(d == 0   ? &down.x
                  : d == 1 ? &down.y
                           : &down.z) -= 1e-6;
            a.sun[d] += (dark(k, tall[k], up) - dark(k, tall[k], down)) / 2e-6;
        }
    }
    return a;
}

static SltProgram *load(Sun s, bool f64, int near_miss) {
    char source[2048];
    SltError err;
    SltParam q = SLT_PARAM_INIT;
    SltProgram *p;
    snprintf(source, sizeof source,
             "[Extent(0, 0, 1, 1)] param heightfield h = zeros(33, 33);\n"
             "param float3 sun = float3(%.17g, %.17g, %.17g);\n"
             "shader float main(float2 x) {\n"
             "    [Disc] if (h.occluded(float3(x, 0.004), sun, 0.0, 10.0)) return 1.0;\n"
             "    return 0.0;\n"
             "}\n",
             s.x, s.y, s.z);
    SltOptions o = {.struct_size = sizeof o, .f64 = f64, .near_miss = near_miss};
    if (slt_compile_string(source, "thin", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
    double v[HEIGHTS] = {0};
    for (int k = 0; k < POSTS; k++) v[(N - 1 - post[k][1]) * N + post[k][0]] = tall[k];
    assert_int_equal(slt_param_find(p, "h", &q, &err), SLT_OK);
    assert_int_equal(slt_set_floats(p, q.fbase, HEIGHTS, v, &err), SLT_OK);
    return p;
}

/* Derivatives as parts of the exact ones: of the posts' heights together, and of the sun's; their means over seeds, and
 * the standard error of the first. */
typedef struct Found {
    double heights, error, sun, missed;
    SltStats stats;
} Found;

static Found run(SltProgram *p, const Answer *want, uint32_t side, uint32_t seeds, bool image) {
    Found f = {.stats = SLT_STATS_INIT};
    double squares = 0;
    static float ones[128 * 128];
    for (uint32_t i = 0; i < side * side; i++) ones[i] = 1;
    SltError err;
    SltParam h = SLT_PARAM_INIT, s = SLT_PARAM_INIT;
    slt_param_find(p, "h", &h, &err), slt_param_find(p, "sun", &s, &err);
    uint32_t n = slt_float_count(p);
    double *g = calloc(n, sizeof *g), *missed = calloc(n, sizeof *missed);
    for (uint32_t seed = 0; seed < seeds; seed++) {
        SltJob j = {.struct_size = sizeof j,
                    .integral = !image,
                    .samples = 1,
                    .segments = image ? 2 : 2 * side * side,
                    .size = {side, side, 1},
                    .spp = 1,
                    .seed = seed,
                    .replicates = 1,
                    .threads = 2};
        SltIntegral out = {.struct_size = sizeof out, .gradient = g, .missed_estimate = missed};
        if ((image ? slt_grad_adjoint(p, &j, ones, g, NULL, &f.stats, &err)
                   : slt_grad_integral(p, &j, &out, &f.stats, &err)) != SLT_OK)
            fail_msg("%s", err.text);
        for (uint32_t i = 0; i < n && image; i++) g[i] /= side * side;
        double sum = 0, of = 0;
        for (int k = 0; k < POSTS; k++) {
            uint32_t at = h.fbase + (uint32_t)((N - 1 - post[k][1]) * N + post[k][0]);
            sum += g[at], of += want->height[k], f.missed += fabs(missed[at]);
        }
        squares += sum / of * sum / of / seeds;
        f.heights += sum / of / seeds, f.sun += g[s.fbase + 2] / want->sun[2] / seeds;
    }
    f.error = sqrt(fmax(0, squares - f.heights * f.heights) / (seeds - 1)), f.missed /= seeds;
    free(g), free(missed);
    return f;
}

static const Sun low = {-0.9, -0.31, 0.25};
/* Cells of 1/32; shadows two of them wide where they begin, twelve long. Spacings of two cells to a quarter. */
static void test_posts(void **state) {
    (void)state;
    static const struct {
        uint32_t side;
        double lost; /* of what is lost by lines that know nothing of one another */
    } row[] = {{16, 0.1}, {32, 0.1}, {64, 0.1}, {128, 0.1}};
    Answer want = exact(low);
    bool print = getenv("SALTUS_PRINT") != NULL;
    for (int image = 0; image < 2; image++) {
        /* In images with rays it is asked for. */
        SltProgram *on = load(low, !image, image ? 1 : -1), *off = load(low, !image, image ? -1 : 0);
        for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
            uint32_t side = row[i].side, seeds = print ? 8192 / side : 1024 / side + 8;
            Found a = run(off, &want, side, seeds, image), b = run(on, &want, side, seeds, image);
            print_message(
                "%s, spacing %.2f cells: lost %.4f +- %.4f (missed estimate %.4f), followed %.4f +- %.4f; of the sun %.4f, %.4f; %llu and %llu evaluations\n",
                image ? "image" : "integral", 32.0 / side, 1 - a.heights, a.error, a.missed, 1 - b.heights, b.error,
                1 - a.sun, 1 - b.sun, (unsigned long long)a.stats.evaluations / seeds,
                (unsigned long long)b.stats.evaluations / seeds);
            assert_true(1 - a.heights > 4 * a.error);
            assert_true(fabs(1 - b.heights) < row[i].lost * (1 - a.heights) + 4 * b.error);
            for (int d = 0; d < SLT_DROP_REASONS; d++)
                if (b.stats.dropped[d] * 1000 > b.stats.crossings)
                    fail_msg("%llu of %llu dropped: %s", (unsigned long long)b.stats.dropped[d],
                             (unsigned long long)b.stats.crossings, slt_drop_names[d]);
        }
        slt_program_free(on), slt_program_free(off);
    }
}

/* Fingers that go from tile to tile: the same bits, whoever works on the tiles. */
static void test_threads(void **state) {
    (void)state;
    SltProgram *p = load(low, false, -1);
    uint32_t n = slt_float_count(p);
    double *g[2] = {calloc(n, sizeof **g), calloc(n, sizeof **g)};
    SltStats stats[2] = {SLT_STATS_INIT, SLT_STATS_INIT};
    SltError err;
    for (int k = 0; k < 2; k++) {
        SltJob j = {.struct_size = sizeof j,
                    .integral = true,
                    .samples = 1,
                    .segments = 2 * 300 * 300,
                    .seed = 5,
                    .replicates = 1,
                    .threads = k ? 3 : 1};
        SltIntegral out = {.struct_size = sizeof out, .gradient = g[k]};
        if (slt_grad_integral(p, &j, &out, &stats[k], &err) != SLT_OK) fail_msg("%s", err.text);
    }
    assert_memory_equal(g[0], g[1], n * sizeof **g);
    assert_int_equal(stats[0].crossings, stats[1].crossings);
    assert_int_equal(stats[0].evaluations, stats[1].evaluations);
    free(g[0]), free(g[1]);
    slt_program_free(p);
}

/* An image's derivative along the sun's height adds up to the gradient of its sum. */
static void test_forward(void **state) {
    (void)state;
    enum { SIDE = 150 };
    static float ones[SIDE * SIDE], image[SIDE * SIDE];
    for (int i = 0; i < SIDE * SIDE; i++) ones[i] = 1;
    SltProgram *p = load(low, true, 1);
    uint32_t n = slt_float_count(p);
    double *g = calloc(n, sizeof *g), *dir = calloc(n, sizeof *dir), sum = 0;
    float *out = image;
    SltJob j = {.struct_size = sizeof j, .size = {SIDE, SIDE, 1}, .spp = 1, .segments = 2, .seed = 4, .threads = 2};
    SltStats stats[2] = {SLT_STATS_INIT, SLT_STATS_INIT};
    SltParam q = SLT_PARAM_INIT;
    SltError err;
    slt_param_find(p, "sun", &q, &err);
    dir[q.fbase + 2] = 1;
    if (slt_grad_adjoint(p, &j, ones, g, NULL, &stats[0], &err) != SLT_OK) fail_msg("%s", err.text);
    if (slt_grad_images(p, &j, 1, (const double *const[]){dir}, &out, NULL, &stats[1], &err) != SLT_OK)
        fail_msg("%s", err.text);
    for (int i = 0; i < SIDE * SIDE; i++) sum += (double)image[i];
    print_message("%g, %g\n", sum, g[q.fbase + 2]);
    assert_true(fabs(sum) > 1 && fabs(sum - g[q.fbase + 2]) < 1e-4 * fabs(sum));
    assert_int_equal(stats[0].crossings, stats[1].crossings);
    free(g), free(dir);
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_posts), cmocka_unit_test(test_forward),
                                       cmocka_unit_test(test_threads)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
