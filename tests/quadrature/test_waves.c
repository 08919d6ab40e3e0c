/* Sites whose g is a wave are integrated along the levels of what the wave is of (variant_waves.c). The same programs
 * with a g that is no wave to the compiler give the same derivatives, for many times the evaluations. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/quadrature/integrate.h"

#define PLANE                                                                                                          \
    "param float k = 60.0; param float t = 0.15; param float2 c = float2(0.06, -0.03); param float ink = 0.8;\n"       \
    "[Domain(-1.0, 1.0)] shader float main(float2 x) { float2 d = x - c; float u = k * dot(d, d); float f = 0.1;\n"
#define FEW "1e-30 * x.x" /* moves nothing, and yet it is not the same everywhere */

/* %s: nothing, or something that makes g no wave. */
static const struct {
    const char *name, *source;
    bool rings; /* enough of them that levels pay */
} cases[] = {
    {"sine", PLANE "[Disc] if (sin(u) > 0.0%s) f = ink; return f; }", true},
    {"cosine below a parameter", PLANE "[Disc] if (cos(u) < t%s) f = ink; return f; }", true},
    {"from a number", PLANE "[Disc] if (0.3 - 0.5 * sin(u) >= t%s) f = ink; return f; }", true},
    {"sum", PLANE "[Disc] if ((0.5 + sin(u + t) * k) / 60.0 - ink%s < -0.4) f = ink; return f; }", true},
    {"nearly flat", PLANE "[Disc] if (sin(u) > 0.99 + 1e-3 * t%s) f = ink; return f; }", true},
    {"never", PLANE "[Disc] if (sin(u) > 1.0 + t%s) f = ink; return f; }", false},
    {"always", PLANE "[Disc] if (-2.0 * cos(u) > -2.0 - t%s) f = ink; return f; }", false},
    {"of no rise", PLANE "[Disc] if (sin(9.0 * x.x * x.y + 7.0 * x.y) > t%s) f = ink; return f; }", false},
    {"shaded", PLANE "[Disc] if (sin(u) > t%s) f = ink + x.x * sin(3.0 * x.y); return f; }", true},
    {"in a loop",
     PLANE "for (int i = 0; i < 3; i++) { float2 v = d + 0.01 * float(i); [Disc] if (sin(k * dot(v, v)) > t%s) f += "
           "ink; } return f; }",
     true},
    {"another g hangs on it",
     PLANE "float r = 0.5; [Disc] if (sin(u) > t%s) r = 0.7; [Disc] if (length(x) < r * ink) f = 2.0; return f; }",
     false},
    {"on a circle's edge",
     PLANE "[Disc] if (sin(u) > 0.0%s) f = ink; [Disc] if (dot(d, d) < 25.132741228718345 / k) f += 0.3; return f; }",
     false},
    {"a maximum of it", PLANE "float s = sin(0.1 * u)%s; [Disc] if (s > t) f = ink; return f + 0.1 * max(s, t); }",
     false},
};

static void same_without_levels(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char source[2][900];
        for (int w = 0; w < 2; w++) snprintf(source[w], sizeof source[w], cases[i].source, w ? " + " FEW : "");
        Result levels = integrate("waves", source[0], true, 1e-8), plain = integrate("waves", source[1], true, 1e-8);
        double largest = 1e-3, off = fabs(levels.value - plain.value);
        for (uint32_t k = 0; k < levels.n; k++) largest = fmax(largest, fabs(plain.g[k]));
        for (uint32_t k = 0; k < levels.n; k++) off = fmax(off, fabs(levels.g[k] - plain.g[k]) / largest);
        if (getenv("SALTUS_PRINT"))
            printf("    %s: off by %.1e, %llu evaluations, %llu without levels\n", cases[i].name, off,
                   (unsigned long long)levels.stats.evaluations, (unsigned long long)plain.stats.evaluations);
        if (!(off <= 2e-8)) fail_msg("%s: off by %g", cases[i].name, off);
        if (levels.stats.certified < plain.stats.certified - 1e-9)
            fail_msg("%s: certified %g, %g", cases[i].name, levels.stats.certified, plain.stats.certified);
        if (cases[i].rings && levels.stats.evaluations * 2 > plain.stats.evaluations)
            fail_msg("%s: %llu evaluations", cases[i].name, (unsigned long long)levels.stats.evaluations);
    }
}

/* On a line every root counts alike: 1 / |slope|. */
static void roots_of_a_line(void **state) {
    (void)state;
    for (int i = 0; i < 40; i++) {
        double k = 23 + 37.7 * i, t = 0.95 * sin(1.7 * i), roots = 0;
        for (int m = -1; m * acos(-1) < k + 2; m++) {
            double u = acos(-1) * m + (m & 1 ? -1 : 1) * asin(t);
            roots += u > 0.5 && u < k + 0.5;
        }
        char source[300];
        snprintf(source, sizeof source,
                 "param float t = %.17g; shader float main(float x) { float f = 0.0; [Disc] if (sin(%.17g * x + 0.5) "
                 "> t) f = 1.0; return f; }",
                 t, k);
        double want = -roots / (k * sqrt(1 - t * t));
        Result r = integrate("waves", source, true, 1e-8), single = integrate("waves", source, false, 1e-5);
        if (!(fabs(r.g[0] / want - 1) < 1e-10)) fail_msg("k %g, t %g: %.15g, exact %.15g", k, t, r.g[0], want);
        if (!(fabs(single.g[0] / want - 1) < 1e-4)) fail_msg("f32, k %g, t %g: %g, exact %g", k, t, single.g[0], want);
    }
}

/* Two zone plates of 76 rings in the unit disc; roots whose slopes rounding spoils would take many times as much. */
static void zone_plates(void **state) {
    (void)state;
    static const char *const source[] = {
        "param float k = 238.76; [Domain(-1.0, 1.0)] shader float main(float2 x) { [Disc] return sin(k * dot(x, x)) > "
        "0.0 ? 1.0 : 0.0; }",
        "param float k = 240.0; param float t = 0.15; param float2 c = float2(0.06, -0.03); [Domain(-1.0, 1.0)] shader "
        "float main(float2 x) { [Disc] return sin(k * length(x - c)) > t ? 1.0 : 0.2; }"};
    for (int i = 0; i < 2; i++) {
        Result r = integrate("waves", source[i], true, 1e-9);
        if (getenv("SALTUS_PRINT"))
            printf("    %llu evaluations, %.3f s\n", (unsigned long long)r.stats.evaluations, r.stats.seconds);
        if (r.stats.evaluations > (i ? 850000 : 2000000))
            fail_msg("%llu evaluations", (unsigned long long)r.stats.evaluations);
        if (r.stats.stopped != SLT_STOP_NONE) fail_msg("stopped");
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(same_without_levels), cmocka_unit_test(roots_of_a_line),
                                       cmocka_unit_test(zone_plates)};
    return cmocka_run_group_tests_name("waves", tests, NULL, NULL);
}
