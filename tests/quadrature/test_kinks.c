/* Kinks inside one comparison: `max(a, b) < 0` where a and b are the same and move apart. The differences of the value,
 * forth and back, are the two orders: their mean is printed, half of how much they differ stated, with a warning. Where
 * a and b move alike nothing of that is said. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/saltus.h"

enum { FLOATS = 16 };

typedef struct Case {
    const char *name, *source;
    bool kink;
    const double *mean, *half; /* of the derivatives to both sides; NULL: values tell */
} Case;

#define LINE "[Domain(-1.0, 1.0)] shader float main(float x) "
#define PLANE "[Domain(-1.0, 1.0)] shader float main(float2 x) "
#define SOLID "[Domain(-1.0, 1.0)] shader float main(float3 x) "
#define TWO "param float r = 0.4; param float q = 0.4; "
#define DISCS "param float3 a = float3(0.1, 0.2, 0.4); param float3 b = float3(0.1, 0.2, 0.4); "
#define BOX "float box(float2 p, float2 h) { float2 d = abs(p) - h; return max(d.x, d.y); } "
#define SEEDS "param float2 p[3] = { float2(-0.4, 0.1), float2(0.3, -0.2), float2(0.3, -0.2) }; "

#define PI 3.14159265358979323846
static const double circles[] = {0.8 * PI, 0.8 * PI}, half_circles[] = {0.4 * PI, 0.4 * PI}, nothing[] = {0, 0};
static const double half_gaps[] = {0.4 * PI, -0.4 * PI}, gaps[] = {2, -2}, planes[] = {2, 2};
static const double balls[] = {2 * PI * 0.16, 2 * PI * 0.16};
/* Of a centre to one side one half of the circle moves, to the other side the other half. */
static const double discs[] = {0, 0, 0.4 * PI, 0, 0, 0.4 * PI},
                    disc_halves[] = {0.8, 0.8, 0.4 * PI, 0.8, 0.8, 0.4 * PI};

#define KINK true, NULL, NULL
#define SMOOTH false, NULL, NULL

static const Case cases[] = {
    {"on a line", TWO LINE "{ [Disc] if (max(x - r, x - q) < 0.0) return 1.0 + x; return 0.0; }", KINK},
    {"lines", TWO PLANE "{ [Disc] if (max(x.x - r, x.x - q) < 0.0) return 1.0; return 0.0; }", KINK},
    {"lines by minimum", TWO PLANE "{ [Disc] if (min(r - x.x, q - x.x) > 0.0) return 1.0 + x.x; return 0.0; }", KINK},
    {"lines of other slopes", TWO PLANE "{ [Disc] if (min(r - x.x, 2.0 * (q - x.x)) > 0.0) return 1.0; return 0.0; }",
     KINK},
    {"planes", TWO SOLID "{ [Disc] if (max(x.x - r, x.x - q) < 0.0) return 1.0; return 0.0; }", KINK},
    {"circles", TWO PLANE "{ [Disc] if (max(length(x) - r, length(x) - q) < 0.0) return 1.0 + x.x; return 0.0; }", true,
     half_circles, half_circles},
    {"balls", TWO SOLID "{ [Disc] if (max(length(x) - r, length(x) - q) < 0.0) return 1.0; return 0.0; }", true, balls,
     balls},
    {"a union of equal discs",
     DISCS PLANE "{ [Disc] if (min(length(x - a.xy) - a.z, length(x - b.xy) - b.z) < 0.0) return 1.0; return 0.0; }",
     true, discs, disc_halves},
    {"their intersection, by squares",
     DISCS PLANE "{ float2 d = x - a.xy; float2 e = x - b.xy; [Disc] if (max(dot(d, d) - a.z * a.z, dot(e, e) - b.z * "
                 "b.z) < 0.0) return 1.0; return 0.0; }",
     true, discs, disc_halves},
    {"a nearest seed that is there twice",
     SEEDS PLANE
     "{ float m = 9.0; for (int i = 1; i < 3; i++) { float2 d = x - p[i]; m = min(m, dot(d, d)); } float2 d = "
     "x - p[0]; [Disc] if (dot(d, d) < m) return 1.0 + x.x; return 0.0; }",
     KINK},
    {"a second nearest seed that is there twice",
     SEEDS
     "param float w = 0.1; " PLANE
     "{ float m = 9.0; float n = 9.0; for (int i = 0; i < 3; i++) { float2 d = x - p[i]; float q = dot(d, d); n = "
     "min(n, max(q, m)); m = min(m, q); } [Disc] if (n - m < w) return 1.0; return 0.0; }",
     KINK},
    {"boxes that share a part of their sides",
     "param float4 a = float4(-0.2, 0.0, 0.4, 0.5); param float4 b = float4(0.3, 0.1, 0.4, 0.4); " BOX PLANE
     "{ [Disc] if (min(box(x - a.xy, a.zw), box(x - b.xy, b.zw)) < 0.0) return 1.0; return 0.0; }",
     KINK},
    {"an absolute value of 0", TWO PLANE "{ [Disc] if (x.y < abs((x.x - r) - (x.x - q))) return 1.0; return 0.0; }",
     KINK},
    /* What is between the two ways of one comparison is there after a move back alone. */
    {"a gap that opens, on a line", TWO LINE "{ [Disc] if (min(x - r, q - x) < 0.0) return 1.0 + x; return 0.0; }",
     KINK},
    {"a gap that opens, between lines",
     TWO PLANE "{ [Disc] if (min(x.x + 0.3 * x.y - r, q - x.x - 0.3 * x.y) < 0.0) return 1.0 + x.x; return 0.0; }",
     KINK},
    {"a gap that opens, between circles",
     TWO PLANE "{ [Disc] if (min(length(x) - r, q - length(x)) < 0.0) return 1.0; return 0.0; }", true, half_gaps,
     half_circles},
    {"a gap that opens, between planes",
     TWO SOLID "{ [Disc] if (min(x.x - r, q - x.x) < 0.0) return 1.0; return 0.0; }", true, gaps, planes},
    {"boxes with a common face",
     "param float w = 0.25; " BOX PLANE
     "{ [Disc] if (min(box(x + float2(0.25, 0.0), float2(w, 0.5)), box(x - float2(0.25, 0.0), float2(0.25, 0.5))) < 0.0) return 1.0; return 0.0; }",
     KINK},
    {"a union of equal discs by comparing",
     DISCS PLANE
     "{ float d = length(x - a.xy) - a.z; float e = length(x - b.xy) - b.z; if (e < d) d = e; [Disc] if (d < 0.0) return 1.0; return 0.0; }",
     true, discs, disc_halves},
    {"a maximum of parameters", TWO PLANE "{ [Disc] if (length(x) < max(r, q)) return 1.0; return 0.0; }", true,
     half_circles, half_circles},
    {"an absolute value of parameters", TWO PLANE "{ [Disc] if (x.y < abs(r - q)) return 1.0; return 0.0; }", KINK},
    {"a branch of parameters",
     TWO PLANE "{ float s = r; if (q < s) s = q; [Disc] if (x.y < s) return 1.0; return 0.0; }", KINK},
    {"a maximum of parameters that is settled",
     TWO PLANE "{ [Disc] if (x.x + q * x.y < max(r, 0.1)) return 1.0; return 0.0; }", SMOOTH},
    {"lines that move alike",
     TWO PLANE "{ float s = r + q; [Disc] if (max(x.x - s, x.x - q - r) < 0.0) return 1.0; return 0.0; }", SMOOTH},
    {"circles that move alike",
     TWO PLANE "{ [Disc] if (max(length(x) - r, length(-x) - r) < 0.0) return 1.0 + q * x.x; return 0.0; }", SMOOTH},
    {"lines that cross", TWO PLANE "{ [Disc] if (max(x.x - r, x.y - q) < 0.0) return 1.0; return 0.0; }", SMOOTH},
    {"circles that touch",
     TWO PLANE
     "{ [Disc] if (min(length(x - float2(0.4, 0.1)) - r, length(x + float2(0.4, -0.1)) - q) < 0.0) return 1.0; "
     "return 0.0; }",
     false, circles, nothing},
    {"corners of a box",
     "param float2 h = float2(0.5, 0.5); " BOX PLANE "{ [Disc] if (box(x, h) < 0.0) return 1.0; return 0.0; }", SMOOTH},
};

static SltProgram *compile(const char *source, bool f64) {
    SltOptions o = {.struct_size = sizeof o, .f64 = f64, .near_miss = -1};
    SltProgram *p;
    if (slt_compile_string(source, "kinks.salt", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
    return p;
}

static void integral(SltProgram *p, SltJob j, double *value, double *gradient, double *error, SltStats *stats) {
    SltError err;
    SltIntegral out = {.struct_size = sizeof out, .value = value, .gradient = gradient, .gradient_stderr = error};
    j.integral = true, j.threads = 2, j.struct_size = sizeof j;
    if (slt_grad_integral(p, &j, &out, stats, &err) != SLT_OK) fail_msg("%s", err.text);
}

static double value_at(SltProgram *p, uint32_t i, double v) {
    SltError err;
    double value;
    SltJob j = {.estimator = SLT_EST_QUADRATURE, .abs_error = 1e-11, .max_evaluations = 1 << 20};
    assert_int_equal(slt_set_floats(p, i, 1, &v, &err), SLT_OK);
    integral(p, j, &value, NULL, NULL, NULL);
    return value;
}

/* Differences of the value, forth and back: their mean, and half of how much they differ. Returns the largest. */
static double differences(const char *source, double *mean, double *half) {
    SltProgram *p = compile(source, true);
    double largest = 0, h = 1e-5;
    for (uint32_t i = 0; i < slt_float_count(p); i++) {
        double at = slt_floats(p)[i], lo = value_at(p, i, at - h), hi = value_at(p, i, at + h), v = value_at(p, i, at);
        mean[i] = (hi - lo) / (2 * h), half[i] = fabs(hi - 2 * v + lo) / (2 * h);
        largest = fmax(largest, fmax(fabs(mean[i]), half[i]));
    }
    slt_program_free(p);
    return largest;
}

/* A move of one parameter alone passes each point of a curve in the order that is worst for it; that of all of them
 * does not: the bar may be this part of half the difference. */
#define LEAST 0.85

static void check(const Case *c) {
    double mean[FLOATS], half[FLOATS], got[FLOATS], error[FLOATS], value;
    double largest = c->mean ? 1 : differences(c->source, mean, half);
    const double *of = c->mean ? c->mean : mean, *to = c->mean ? c->half : half;
    for (int way = 0; way < 4; way++) {
        bool f64 = way & 1;
        SltStats stats = SLT_STATS_INIT;
        SltProgram *p = compile(c->source, f64);
        SltJob j = {.estimator = way < 2 ? SLT_EST_QUADRATURE : SLT_EST_AUTO, .samples = 1 << 20};
        integral(p, j, &value, got, error, &stats);
        uint32_t n = slt_float_count(p);
        slt_program_free(p);
        unsigned long long kinks = stats.dropped[SLT_DROP_COINCIDENT];
        print_message("%s, way %d: %g certified, %llu evaluations, %llu kinks\n", c->name, way, stats.certified,
                      (unsigned long long)stats.evaluations, kinks);
        if (c->kink != (kinks > 0)) fail_msg("%s, way %d: %llu kinks", c->name, way, kinks);
        if (way > 1 && !stats.certified) continue; /* lines: sample.ties */
        for (uint32_t i = 0; i < n; i++) {
            double within =
                (f64 && !c->mean ? 3e-5 : 1e-3) * largest; /* differences at a kink are as good as their step */
            if (!(fabs(got[i] - of[i]) <= within))
                fail_msg("%s, way %d: %u is %.9g, and not %.9g", c->name, way, i, got[i], of[i]);
            if (!(error[i] >= LEAST * to[i] - 1e-3 * largest))
                fail_msg("%s, way %d: %u states %g of %g", c->name, way, i, error[i], to[i]);
            if (!c->kink && !(error[i] <= 0.01 * largest)) fail_msg("%s, way %d: states %g", c->name, way, error[i]);
        }
        /* In f32 the cell with a piece that is shorter than moves go is not. */
        if (!(stats.certified > (f64 ? 0.999 : 0.9)))
            fail_msg("%s, way %d: %g certified", c->name, way, stats.certified);
    }
}

static void test_kinks(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) check(&cases[i]);
}

#define BAND "param float r = 0.4; param float w = "
/* Two values that rounding cannot tell apart are not the same for that: nothing of it is certified, nor called a kink.
 */
static const char *const hidden[] = {
    BAND "1e-7; " PLANE "{ float d = length(x - 0.1) - r; [Disc] if (abs(d) < w) return 1.0; return 0.0; }",
    BAND "1e-10; " PLANE "{ float d = length(x - 0.1) - r; [Disc] if (abs(d) < w) return 1.0; return 0.0; }",
    BAND "1e-7; " PLANE "{ float d = length(x - 0.1) - r; [Disc] if (min(d + w, -d) > 0.0) return 1.0; return 0.0; }",
    BAND "1e-7; " PLANE "{ float d = length(x - 0.1) - r; [Disc] if (max(d, d - w) < 0.0) return 1.0; return 0.0; }",
    BAND "1e-10; " PLANE "{ float d = length(x - 0.1) - r; [Disc] if (max(d, d - w) < 0.0) return 1.0; return 0.0; }",
};

static void test_hidden(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof hidden / sizeof *hidden; i++) {
        double value, gradient[FLOATS], error[FLOATS];
        SltStats stats = SLT_STATS_INIT;
        SltProgram *p = compile(hidden[i], false);
        integral(p, (SltJob){.estimator = SLT_EST_QUADRATURE, .samples = 1 << 20}, &value, gradient, error, &stats);
        slt_program_free(p);
        if (!(stats.certified < 0.98)) fail_msg("%s: %g certified", hidden[i], stats.certified);
        assert_int_equal(stats.dropped[SLT_DROP_COINCIDENT], 0);
    }
}

/* Values that are near, and not the same: nothing bends at the parameters. By cells and by lines. */
static void test_beside(void **state) {
    static const double apart[] = {1e-5, 3e-6};
    (void)state;
    for (int way = 0; way < 4; way++) {
        bool f64 = way & 1;
        double value, got[FLOATS], error[FLOATS], right = 2 * PI * (0.4 + apart[f64]);
        char source[256];
        SltStats stats = SLT_STATS_INIT;
        snprintf(source, sizeof source,
                 "param float r = 0.4; param float q = %.6f; " PLANE
                 "{ [Disc] if (length(x) < max(r, q)) return 1.0; return 0.0; }",
                 0.4 + apart[f64]);
        SltProgram *p = compile(source, f64);
        SltJob j = {.estimator = way < 2 ? SLT_EST_QUADRATURE : SLT_EST_LATTICE, .samples = 1 << 18};
        integral(p, j, &value, got, error, &stats);
        slt_program_free(p);
        print_message("way %d: %g +- %g, %g +- %g\n", way, got[0], error[0], got[1], error[1]);
        assert_int_equal(stats.dropped[SLT_DROP_COINCIDENT], 0);
        assert_true(got[0] == 0 && error[0] == 0);
        assert_true(fabs(got[1] - right) <= 4 * error[1] && error[1] < 1e-3);
    }
}

/* In f32 cells tell some pieces of this band's edge apart and others not, one after the other in one list: what the
 * ones have of moved parameters is no matter of the others. */
static void test_half_hidden(void **state) {
    (void)state;
    double got[3][FLOATS], value, error[FLOATS];
    SltProgram *p = compile(BAND "1e-6; " PLANE
                                 "{ float d = length(x) - r; [Disc] if (max(d + w, d) < 0.0) return 1.0; return 0.0; }",
                            false);
    for (uint32_t i = 0; i < 3; i++) {
        SltError err;
        SltJob j = {.struct_size = sizeof j, .integral = true, .estimator = SLT_EST_QUADRATURE, .samples = 1 << 18};
        SltIntegral out = {.struct_size = sizeof out, .value = &value, .gradient = got[i], .gradient_stderr = error};
        j.threads = 1 + i;
        if (slt_grad_integral(p, &j, &out, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
        assert_memory_equal(got[i], got[0], 2 * sizeof **got);
        print_message("%g +- %g, %g +- %g\n", got[i][0], error[0], got[i][1], error[1]);
        assert_true(fabs(got[i][1] + 0.8 * PI) <= 1.05 * error[1] + 1e-3);
    }
    slt_program_free(p);
}

#define POLYGON(params, a, b)                                                                                          \
    params " " PLANE "{ float f = 0.0; for (int i = 0; i < 4; i++) { float2 a = " a "; float2 b = " b "; [Disc] if "    \
    "((a.y > x.y) != (b.y > x.y) && x.x < (b.x - a.x) * (x.y - a.y) / (b.y - a.y) + a.x) f = 1.0 - f; } return f; }"

/* Corners that two edges have in common move both; corners of their own open a slit as wide as the domain. */
static void test_corners(void **state) {
    static const char *const source[2] = {
        POLYGON("param float2 e[4] = { float2(-0.5, -0.3), float2(0.5, -0.3), float2(0.4, 0.45), float2(-0.35, 0.5) };",
                "e[i]", "e[(i + 1) % 4]"),
        POLYGON("param float4 e[4] = { float4(-0.5, -0.3, 0.5, -0.3), float4(0.5, -0.3, 0.4, 0.45), "
                "float4(0.4, 0.45, -0.35, 0.5), float4(-0.35, 0.5, -0.5, -0.3) };",
                "e[i].xy", "e[i].zw")};
    (void)state;
    for (int way = 0; way < 4; way++) {
        bool own = way & 1;
        double value, gradient[FLOATS], error[FLOATS];
        SltStats stats = SLT_STATS_INIT;
        SltProgram *p = compile(source[own], way & 2);
        integral(p, (SltJob){.estimator = SLT_EST_QUADRATURE, .samples = 1 << 18}, &value, gradient, error, &stats);
        slt_program_free(p);
        print_message("way %d: %g certified, %g\n", way, stats.certified, (double)stats.dropped[SLT_DROP_COINCIDENT]);
        assert_int_equal(own, stats.dropped[SLT_DROP_COINCIDENT] > 0);
        assert_int_equal(own, stats.certified < 0.9);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_kinks), cmocka_unit_test(test_hidden),
                                       cmocka_unit_test(test_beside), cmocka_unit_test(test_half_hidden),
                                       cmocka_unit_test(test_corners)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
