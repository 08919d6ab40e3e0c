/* Boundaries that coincide: counted where they move differently, and only there. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/saltus.h"

enum { FLOATS = 64 };

static SltStats stats_of(const char *source, bool f64, const SltJob *like, bool image) {
    SltOptions o = {.struct_size = sizeof o, .f64 = f64, .near_miss = -1};
    SltProgram *p;
    SltStats stats = SLT_STATS_INIT;
    SltError err;
    double gradient[FLOATS], value;
    SltJob j = *like;
    if (slt_compile_string(source, "coincide.salt", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
    if (image) {
        static float ones[64 * 64];
        for (int i = 0; i < 64 * 64; i++) ones[i] = 1;
        j.size[0] = j.size[1] = 64, j.size[2] = 1, j.spp = 1;
        if (slt_grad_adjoint(p, &j, ones, gradient, NULL, &stats, &err) != SLT_OK) fail_msg("%s", err.text);
    } else {
        j.integral = true;
        SltIntegral out = {.struct_size = sizeof out, .value = &value, .gradient = gradient};
        if (slt_grad_integral(p, &j, &out, &stats, &err) != SLT_OK) fail_msg("%s", err.text);
    }
    slt_program_free(p);
    return stats;
}

/* The least and the largest part of the crossings that may be counted. */
static void check(const char *name, const char *source, double least, double most) {
    for (int k = 0; k < 5; k++) {
        SltJob j = {.struct_size = sizeof j,
                    .samples = k == 3 ? 1 << 8 : 1 << 14,
                    .seed = 3 + (uint32_t)k,
                    .threads = 2,
                    .estimator = k == 4 ? SLT_EST_SCANLINE : SLT_EST_LATTICE};
        SltStats s = stats_of(source, k == 1, &j, k == 2);
        double part = (double)s.dropped[SLT_DROP_COINCIDENT] / (double)s.crossings;
        print_message("%s: %llu of %llu\n", name, (unsigned long long)s.dropped[SLT_DROP_COINCIDENT],
                      (unsigned long long)s.crossings);
        assert_true(s.crossings > 0);
        if (!(part >= least && part <= most))
            fail_msg("%s, case %d: %g of the crossings, not %g to %g", name, k, part, least, most);
        for (int d = 0; d < SLT_DROP_REASONS; d++)
            if (d != SLT_DROP_COINCIDENT) assert_int_equal(s.dropped[d], 0);
    }
}

/* Two circles of one radius, each with its own parameter: their product, and the one inside the other. Glancing
 * crossings are not asked. */
static void test_apart(void **state) {
    (void)state;
    check(
        "product",
        "param float r = 0.3; param float q = 0.3; shader float main(float2 x) { float d = length(x - float2(0.48, 0.53));"
        " [Disc] float a = d < r ? 1.0 : 0.0; [Disc] float b = d < q ? 1.0 : 0.0; return a * b; }",
        0.6, 1);
    check(
        "guarded",
        "param float r = 0.3; param float q = 0.3; shader float main(float2 x) { float d = length(x - float2(0.48, 0.53));"
        " [Disc] if (d < r) { [Disc] if (d < q) return 2.0; return 1.0; } return 0.0; }",
        0.6, 1);
    /* Opposite: one grows where the other shrinks. */
    check(
        "complement",
        "param float r = 0.3; param float q = 0.3; shader float main(float2 x) { float d = length(x - float2(0.48, 0.53)), c = 0.0;"
        " [Disc] if (d < r) c = 1.0; [Disc] if (0.6 - q < d) c = c + 3.0; return c * c; }",
        0.6, 1);
    check(
        "a line of its own",
        "param float a = 0.4; param float b = 0.4; shader float main(float x) { [Disc] float u = x < a ? 1.0 : 0.0; [Disc] float v = x < b ? 1.0 : 0.0; return u * v; }",
        1, 1);
}

/* The same boundary twice, boundaries that cross, that share an edge, that are near. */
static void test_together(void **state) {
    (void)state;
    check("twice",
          "param float r = 0.3; shader float main(float2 x) { float d = length(x - float2(0.48, 0.53));"
          " [Disc] float a = d < r ? 1.0 : 0.0; [Disc] float b = 2.0 * d < 2.0 * r ? 1.0 : 0.0; return a * b; }",
          0, 0);
    check(
        "crossing",
        "param float2 c[6] = init(at); float2 at(int i) { return rand2(); } shader float main(float2 x) { float f = 0.0;"
        " for (int i = 0; i < 6; i++) [Disc] if (length(x - c[i]) < 0.3) f = 0.2 * f + i; return f; }",
        0, 0.002);
    check(
        "a shared edge",
        "param float2 p = float2(0.1, 0.4); param float2 q = float2(0.93, 0.51); shader float main(float2 x) {"
        " float s = (q.x - p.x) * (x.y - p.y) - (q.y - p.y) * (x.x - p.x), t = (p.x - q.x) * (x.y - q.y) - (p.y - q.y) * (x.x - q.x);"
        " float f = 0.0; [Disc] if (s > 0.0) f = 1.0; [Disc] if (t > 0.0) f = 2.0; return f; }",
        0, 0);
    check(
        "near",
        "param float r = 0.3; param float q = 0.304; shader float main(float2 x) { float d = length(x - float2(0.48, 0.53));"
        " [Disc] float a = d < r ? 1.0 : 0.0; [Disc] float b = d < q ? 1.0 : 0.0; return a + b; }",
        0, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_apart), cmocka_unit_test(test_together)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
