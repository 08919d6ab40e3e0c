/* Compiled heightfield sites through the estimators: gradients in heights, camera and sun against differences of the
 * integral. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/saltus.h"

enum { N = 33, HEIGHTS = N * N, FLOATS = HEIGHTS + 4 };

typedef struct Terrain {
    SltProgram *p;
    uint32_t base, n; /* of the heights; floats in all */
    double gradient[FLOATS], error[FLOATS], boundary[FLOATS];
    SltStats stats;
} Terrain;

static double two_bumps(double x, double y) {
    return 0.22 * exp(-(pow(x - 0.35, 2) + pow(y - 0.35, 2)) / 0.0128) +
           0.3 * exp(-(pow(x - 0.65, 2) + pow(y - 0.6, 2)) / 0.02) + 0.02 * sin(9 * x) * cos(7 * y);
}
static double one_spike(double x, double y) {
    return fabs(x - 0.5) < 1e-6 && fabs(y - 0.5) < 1e-6 ? 0.25 : 0.02 * sin(5 * x);
}

static void open_terrain(Terrain *t, const char *body, bool f64, int near_miss, double (*height)(double, double)) {
    char source[2048];
    SltError err;
    SltParam h = SLT_PARAM_INIT;
    memset(t, 0, sizeof *t);
    snprintf(source, sizeof source, "[Extent(0, 0, 1, 1)] param heightfield h = zeros(33, 33);\n%s", body);
    SltOptions o = {.struct_size = sizeof o, .f64 = f64, .near_miss = near_miss};
    if (slt_compile_string(source, "terrain.salt", &o, &t->p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(t->p));
    assert_int_equal(slt_param_find(t->p, "h", &h, &err), SLT_OK);
    t->base = h.fbase, t->n = slt_float_count(t->p);
    assert_true(t->n <= FLOATS && h.fcount == HEIGHTS);
    double v[HEIGHTS];
    for (int i = 0; i < HEIGHTS; i++) v[i] = height(i % N / (N - 1.0), 1 - i / N / (N - 1.0));
    assert_int_equal(slt_set_floats(t->p, t->base, HEIGHTS, v, &err), SLT_OK);
}

static double integral(Terrain *t, const SltJob *like) {
    SltJob j = *like;
    SltError err;
    double value = 0;
    SltIntegral out = {.struct_size = sizeof out, .value = &value};
    j.struct_size = sizeof j, j.integral = true;
    if (slt_grad_integral(t->p, &j, &out, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
    return value;
}

static void gradient(Terrain *t, const SltJob *like) {
    SltJob j = *like;
    SltError err;
    SltIntegral out = {
        .struct_size = sizeof out, .gradient = t->gradient, .gradient_stderr = t->error, .boundary = t->boundary};
    j.struct_size = sizeof j, j.integral = true;
    t->stats = SLT_STATS_INIT;
    if (slt_grad_integral(t->p, &j, &out, &t->stats, &err) != SLT_OK) fail_msg("%s", err.text);
}

/* Along dir[t->n]: within `tolerance` of the result or of the largest of its kind, and the spread of two differences
 * (which share the noise of the steps' edges). */
static void check_along(Terrain *t, const char *what, const double *dir, double step, double kind, double tolerance) {
    double at[FLOATS], v[2][2], sum = 0, boundary = 0;
    SltError err;
    memcpy(at, slt_floats(t->p), t->n * sizeof *at);
    for (int side = 0; side < 2; side++) {
        double moved[FLOATS];
        for (uint32_t i = 0; i < t->n; i++) moved[i] = at[i] + (side ? -step : step) * dir[i];
        assert_int_equal(slt_set_floats(t->p, 0, t->n, moved, &err), SLT_OK);
        for (uint32_t k = 0; k < 2; k++)
            v[k][side] = integral(t, &(SltJob){.samples = 1 << 19, .replicates = 1, .seed = 9 + k});
    }
    assert_int_equal(slt_set_floats(t->p, 0, t->n, at, &err), SLT_OK);
    for (uint32_t i = 0; i < t->n; i++) sum += dir[i] * t->gradient[i], boundary += dir[i] * t->boundary[i];
    double one = (v[0][0] - v[0][1]) / (2 * step), two = (v[1][0] - v[1][1]) / (2 * step), want = 0.5 * (one + two);
    print_message("  %s: %.6f (boundary %.6f), differences %.6f, %.6f\n", what, sum, boundary, one, two);
    if (!(fabs(sum - want) <= tolerance * fmax(fabs(want), kind) + 2 * fabs(one - two)))
        fail_msg("%s: got %.6f, want %.6f", what, sum, want);
}

static void check(Terrain *t, const char *name, double tolerance) {
    double dir[FLOATS] = {0};
    gradient(t, &(SltJob){.samples = 1 << 17, .segments = 1 << 18, .seed = 4});
    uint64_t dropped = 0;
    for (int d = 0; d < SLT_DROP_REASONS; d++) dropped += t->stats.dropped[d];
    print_message("%s: %llu segments, %llu crossings, %llu evaluations, %llu dropped\n", name,
                  (unsigned long long)t->stats.segments, (unsigned long long)t->stats.crossings,
                  (unsigned long long)t->stats.evaluations, (unsigned long long)dropped);
    assert_true(t->stats.crossings > 500 && dropped * 1000 <= t->stats.crossings);
    for (uint32_t i = 0; i < HEIGHTS; i++) dir[t->base + i] = (i % N + 1.0) / N;
    check_along(t, "heights, slanted", dir, 0.003, 0, tolerance);
    memset(dir, 0, sizeof dir);
    for (uint32_t i = 0; i < HEIGHTS; i++) dir[t->base + i] = i / N < N / 2;
    check_along(t, "heights, far half", dir, 0.003, 0, tolerance);
    double kind = 0;
    for (uint32_t p = 0; p < t->n; p++)
        if (p < t->base || p >= t->base + HEIGHTS) kind = fmax(kind, fabs(t->gradient[p]));
    for (uint32_t p = 0; p < t->n; p++) {
        if (p >= t->base && p < t->base + HEIGHTS) continue;
        memset(dir, 0, sizeof dir);
        dir[p] = 1;
        check_along(t, "parameter", dir, 0.004, kind, tolerance);
    }
    slt_program_free(t->p);
}

static const char *const view = "param float cz = 0.3;\n"
                                "[Domain(float2(-0.5, -0.5), float2(0.5, 0.2))]\n"
                                "shader float main(float2 x) {\n"
                                "    [Disc] Hit v = h.trace(float3(0.5, -0.6, cz), float3(x.x, 1.0, x.y), 0.0, 1e9);\n"
                                "    if (!v.hit) return 1.5;\n"
                                "    return 0.4 + 0.3 * v.normal.x + 0.5 * v.p.y;\n"
                                "}\n";

/* Ground against sky, a near bump against a far one and against the ground behind it. */
static void test_view(void **state) {
    (void)state;
    Terrain t;
    for (int k = 0; k < 3; k++) {
        /* Regions by path and by provenance. */
        open_terrain(&t, view, k == 1, k == 2 ? 0 : -1, two_bumps);
        check(&t, k == 1 ? "view, f64" : "view", 0.01);
    }
}

static void test_spike(void **state) {
    (void)state;
    Terrain t;
    open_terrain(&t, view, false, -1, one_spike);
    check(&t, "spike", 0.01);
}

static void test_shadow(void **state) {
    (void)state;
    Terrain t;
    open_terrain(
        &t,
        "param float sun = 0.35;\nparam float azimuth = 0.4;\n"
        "[Domain(float2(0.02, 0.02), float2(0.98, 0.98))]\n"
        "shader float main(float2 x) {\n"
        "    [Disc] bool dark = h.occluded(float3(x, h.height(x)), float3(cos(azimuth), sin(azimuth), sun), 0.05, 1e9);\n"
        "    if (dark) return 0.2;\n"
        "    return 1.0 + x.x;\n"
        "}\n",
        false, -1, two_bumps);
    check(&t, "shadow", 0.04);
}

/* What is seen, and whether it lies in shadow: the second ray starts where the first one ends, so silhouettes change
 * both. */
static void test_view_in_the_sun(void **state) {
    (void)state;
    Terrain t;
    open_terrain(&t,
                 "param float sun = 0.35;\nparam float cz = 0.3;\n"
                 "[Domain(float2(-0.5, -0.5), float2(0.5, 0.2))]\n"
                 "shader float main(float2 x) {\n"
                 "    float3 d = float3(x.x, 1.0, x.y), o = float3(0.5, -0.6, cz);\n"
                 "    [Disc] Hit v = h.trace(o, d, 0.0, 1e9);\n"
                 "    if (!v.hit) return 1.5;\n"
                 "    float3 p = float3(v.p, h.height(v.p));\n"
                 "    [Disc] bool dark = h.occluded(p, float3(0.9, 0.4, sun), 0.05, 1e9);\n"
                 "    return (dark ? 0.1 : 1.0) * (0.4 + 0.3 * v.p.y);\n"
                 "}\n",
                 false, -1, two_bumps);
    check(&t, "view in the sun", 0.02);
}

/* A camera that shakes: scanlines. */
static void test_random(void **state) {
    (void)state;
    Terrain t;
    open_terrain(&t,
                 "param float cz = 0.3;\n"
                 "[Domain(float2(-0.5, -0.5), float2(0.5, 0.2))]\n"
                 "shader float main(float2 x) {\n"
                 "    [Disc] Hit v = h.trace(float3(0.45 + 0.1 * rand(), -0.6, cz), float3(x.x, 1.0, x.y), 0.0, 1e9);\n"
                 "    return v.hit ? 0.4 + 0.5 * v.p.y : 1.5;\n"
                 "}\n",
                 false, -1, two_bumps);
    check(&t, "random", 0.05);
}

/* In an image, with any number of threads and lanes: the same bits, and in sum the integral's gradient. */
static void test_image(void **state) {
    (void)state;
    enum { SIZE = 64 };
    static float ones[SIZE * SIZE];
    for (int i = 0; i < SIZE * SIZE; i++) ones[i] = 0.7f / (SIZE * SIZE);
    Terrain t;
    SltError err;
    double first[FLOATS], again[FLOATS];
    open_terrain(&t, view, false, -1, two_bumps);
    for (uint32_t threads = 1; threads < 4; threads++) {
        SltJob j = {
            .struct_size = sizeof j, .size = {SIZE, SIZE, 1}, .spp = 16, .segments = 16, .seed = 3, .threads = threads};
        if (slt_grad_adjoint(t.p, &j, ones, threads == 1 ? first : again, NULL, NULL, &err) != SLT_OK)
            fail_msg("%s", err.text);
        if (threads > 1) assert_memory_equal(first, again, t.n * sizeof *first);
    }
    gradient(&t, &(SltJob){.samples = 1 << 17, .segments = 1 << 18, .seed = 4});
    double largest = 0, worst = 0;
    for (uint32_t i = 0; i < t.n; i++)
        if (i >= t.base && i < t.base + HEIGHTS)
            largest = fmax(largest, fabs(t.gradient[i])), worst = fmax(worst, fabs(t.gradient[i] - first[i]));
    print_message("image: largest %.6f, worst difference of a height %.6f\n", largest, worst);
    assert_true(worst < 0.05 * largest);
    slt_program_free(t.p);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_view),   cmocka_unit_test(test_spike),
                                       cmocka_unit_test(test_shadow), cmocka_unit_test(test_view_in_the_sun),
                                       cmocka_unit_test(test_random), cmocka_unit_test(test_image)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
