/* Boundaries that coincide exactly: derivatives against central differences of the value, which is exact whatever lies
 * on what; and a warning where there is no derivative, and only there. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/saltus.h"

enum { FLOATS = 64 };

typedef struct Case {
    const char *name, *source;
    bool kink;
} Case;

#define HEAD "[Domain(-1.0, 1.0)] shader float main(float2 x) { float f = 0.0; "
/* The nearest seed by a running minimum, as one writes it. */
#define NEAREST(n, d)                                                                                                  \
    HEAD "float best = 1e9; for (int i = 0; i < " #n "; i++) { float d = " d                                           \
         "; [Disc] if (d < best) { best = d; f = 1.0 + 0.1 * i * i; } } return f; }"
#define PLAIN "distance(x, p[i])"
#define SQUARED "dot(x - p[i], x - p[i])"
#define GRID(n, m)                                                                                                     \
    "param float2 p[" #n " * " #m "] = init(at); float2 at(int i) { return float2(-1.0 + (2.0 * (i % " #n ") + 1.0) / " #n    \
    ".0, -1.0 + (2.0 * (i / " #n ") + 1.0) / " #m ".0); } "

static const Case cases[] = {
    {"2 x 2 seeds", GRID(2, 2) NEAREST(4, PLAIN), false},
    {"4 x 3 seeds", GRID(4, 3) NEAREST(12, SQUARED), false},
    {"3 x 3 seeds", GRID(3, 3) NEAREST(9, PLAIN), false},
    {"5 x 2 seeds", GRID(5, 2) NEAREST(10, SQUARED), false},
    {"hexagons",
     "param float2 p[9] = init(at); float2 at(int i) { return float2(-0.65 + 0.5 * (i % 3) + 0.25 * (i / 3 % 2), "
     "-0.75 + 0.43301270189221932 * (i / 3)); } " NEAREST(9, SQUARED),
     false},
    {"a disc hidden by another of its size",
     "param float3 a = float3(0.1, -0.05, 0.5); param float3 b = float3(0.1, -0.05, 0.5);" HEAD
     "[Disc] if (distance(x, a.xy) < a.z) f = 1.0; [Disc] if (distance(x, b.xy) < b.z) f = 1.0; return f + 1.0; }",
     true},
    {"two discs that add up",
     "param float3 a = float3(0.1, -0.05, 0.5); param float3 b = float3(0.1, -0.05, 0.5);" HEAD
     "[Disc] if (distance(x, a.xy) < a.z) f += 1.0 + x.x; [Disc] if (distance(x, b.xy) < b.z) f += 2.0 + x.y; return f; }",
     false},
    {"the same predicate twice",
     "param float3 a = float3(0.1, -0.05, 0.5);" HEAD
     "[Disc] if (distance(x, a.xy) < a.z) f = 1.0; [Disc] if (distance(x, a.xy) < a.z) f = f * f + 2.0; return f; }",
     false},
    {"three discs of one centre",
     "param float2 c = float2(0.1, -0.05); param float r[3] = { 0.7, 0.5, 0.3 };" HEAD
     "for (int i = 0; i < 3; i++) [Disc] if (distance(x, c) < r[i]) f += 1.0 + i; return f; }",
     false},
    {"discs that touch, and add up",
     "param float3 a[2] = { float3(-0.4, 0.1, 0.4), float3(0.4, 0.1, 0.4) };" HEAD
     "for (int i = 0; i < 2; i++) [Disc] if (distance(x, a[i].xy) < a[i].z) f += 1.0 + i; return f; }",
     false},
    {"a box with a side given twice",
     "param float4 s = float4(-0.5, 0.4, -0.3, 0.6);" HEAD
     "[Disc] bool l = x.x > s.x; [Disc] bool r = x.x < s.y; [Disc] bool b = x.y > s.z; [Disc] bool t = x.y < s.w;"
     "[Disc] bool again = x.x < s.y; return l && r && b && t && again ? 1.0 : 0.0; }",
     false},
    {"a box over its neighbour",
     "param float a = 0.15; param float b = 0.15;" HEAD
     "[Disc] if (x.x > b) f = 1.0; [Disc] if (x.x < a) f = 3.0; return f; }",
     true},
    {"boxes in one stack, with one edge",
     "param float a = 0.15; param float2 y = float2(-0.5, 0.5);" HEAD
     "[Disc] if (x.x > a && x.y > y.x) f = 1.0; [Disc] if (x.x < a && x.y < y.y) f = 3.0; return f; }",
     false},
    {"a maximum of two equal",
     "param float r = 0.4; param float q = 0.4;" HEAD
     "[Disc] if (max(r - length(x), 2.0 * (q - length(x))) > 0.0) f = 1.0 + x.x; return f; }",
     true},
    {"a minimum of two of other slopes",
     "param float a = 0.15; param float b = 0.15;" HEAD
     "[Disc] if (min(a - x.x, 2.0 * (b - x.x)) > 0.0) f = 1.0; return f; }",
     true},
    {"a maximum of what only crosses",
     "param float a = 0.15; param float b = 0.15;" HEAD "[Disc] if (max(a - x.x, b - x.y) > 0.0) f = 1.0; return f; }",
     false},
    {"mirrored",
     "param float w = 0.5; param float2 c = float2(0.0, 0.1);" HEAD
     "[Disc] if (abs(x.x - c.x) < w && abs(x.y - c.y) < w) f = 2.0; [Disc] if (abs(c.x - x.x) < w) f += 1.0; return f; }",
     false},
};

static SltProgram *compile(const char *source, bool f64) {
    SltOptions o = {.struct_size = sizeof o, .f64 = f64, .near_miss = -1};
    SltProgram *p;
    if (slt_compile_string(source, "ties.salt", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
    return p;
}

static void integral(SltProgram *p, SltJob j, double *value, double *gradient, double *error, SltStats *stats) {
    SltError err;
    SltIntegral out = {.struct_size = sizeof out, .value = value, .gradient = gradient, .gradient_stderr = error};
    j.integral = true;
    if (slt_grad_integral(p, &j, &out, stats, &err) != SLT_OK) fail_msg("%s", err.text);
}

/* Differences of the value; returns the largest. */
static double differences(SltProgram *p, double *want) {
    uint32_t n = slt_float_count(p);
    SltJob j = {.struct_size = sizeof j,
                .estimator = SLT_EST_QUADRATURE,
                .abs_error = 1e-11,
                .max_evaluations = 1 << 16,
                .threads = 2};
    double largest = 0, h = 1e-5;
    for (uint32_t i = 0; i < n; i++) {
        double at = slt_floats(p)[i], v[2];
        for (int side = 0; side < 2; side++) {
            double moved = side ? at + h : at - h;
            SltError err;
            assert_int_equal(slt_set_floats(p, i, 1, &moved, &err), SLT_OK);
            integral(p, j, &v[side], NULL, NULL, NULL);
        }
        SltError err;
        assert_int_equal(slt_set_floats(p, i, 1, &at, &err), SLT_OK);
        want[i] = (v[1] - v[0]) / (2 * h), largest = fmax(largest, fabs(want[i]));
    }
    return largest;
}

static void check(const Case *c) {
    static const struct {
        SltEstimator estimator;
        bool f64;
        double within;
    } ways[] = {{SLT_EST_QUADRATURE, true, 1e-6}, {SLT_EST_QUADRATURE, false, 2e-3}, {SLT_EST_AUTO, true, 1e-6},
                {SLT_EST_AUTO, false, 2e-3},      {SLT_EST_LATTICE, true, 0.01},     {SLT_EST_LATTICE, false, 0.02}};
    /* In single precision rounding of seeds moves curves apart by little more than that of their roots. */
    double want[FLOATS], got[FLOATS], error[FLOATS], value;
    SltProgram *p = compile(c->source, true);
    uint32_t n = slt_float_count(p);
    double largest = differences(p, want);
    slt_program_free(p);
    for (size_t w = 0; w < sizeof ways / sizeof *ways; w++) {
        SltStats stats = SLT_STATS_INIT;
        double worst = 0, widest = 0;
        p = compile(c->source, ways[w].f64);
        SltJob j = {.struct_size = sizeof j, .estimator = ways[w].estimator, .samples = 1 << 18, .threads = 2};
        integral(p, j, &value, got, error, &stats);
        slt_program_free(p);
        for (uint32_t i = 0; i < n; i++) worst = fmax(worst, fabs(got[i] - want[i])), widest = fmax(widest, error[i]);
        uint64_t kinks = stats.dropped[SLT_DROP_COINCIDENT];
        print_message("%s, way %zu: off by %.2g of %.3g, stated %.2g, %llu kinks\n", c->name, w, worst, largest, widest,
                      (unsigned long long)kinks);
        double within = fmax(ways[w].within, c->kink ? 1e-4 : 0); /* differences at a kink are as good as their step */
        if (!(worst <= within * largest)) fail_msg("%s, way %zu: off by %g of %g", c->name, w, worst, largest);
        if (c->kink && !(widest > 0.1 * largest)) fail_msg("%s, way %zu: a kink, but %g is stated", c->name, w, widest);
        if (c->kink ? !kinks : kinks != 0) fail_msg("%s, way %zu: %d kinks", c->name, w, (int)kinks);
    }
}

static void test_ties(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) check(&cases[i]);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_ties)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
