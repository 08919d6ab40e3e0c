/* Untagged masks that stand still beside the edges of shadows: in a condition and in a loop, behind stripes narrower
 * than the lattice's spacing resolves without knowing of them. The shadow of a straight ridge, in closed form. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/saltus.h"

enum { SIDE = 17, RIDGE = 4 /* at y = 0.5: rows go down */ };
static const double height = 0.2, slope = 0.4, lift = 1e-4;

/* The rest of the body, and how many whole edges it shows. */
static const struct Shown {
    const char *body;
    double edges;
} shown[] = {
    {"[Disc] if (h.occluded(p, sun, 0.01, 50.0)) return 1.0; return 0.0;", 1},
    {"if (frac(16.0 * x.x) < 0.5) { [Disc] if (h.occluded(p, sun, 0.01, 50.0)) return 1.0; } return 0.0;", 0.5},
    {"float f = 0.0; for (int i = 0; i < 3; i++) { if (frac(16.0 * x.x + 0.25 * float(i)) >= 0.5) continue; [Disc] if "
     "(h.occluded(p, sun, 0.01, 50.0)) f += 1.0 + float(i); } return f;",
     3},
};

static void test_shadow_of_a_ridge(void **state) {
    (void)state;
    for (size_t k = 0; k < 2 * sizeof shown / sizeof *shown; k++) {
        const struct Shown *s = &shown[k / 2];
        char source[1024];
        SltOptions o = SLT_OPTIONS_INIT;
        SltParam q = SLT_PARAM_INIT;
        SltProgram *p;
        SltError err;
        o.f64 = k % 2;
        snprintf(source, sizeof source,
                 "[Extent(-1.0, -1.0, 1.0, 1.0)] param heightfield h = zeros(%d, %d);\nparam float slope = %g;\n"
                 "[Domain(float2(-0.75, -0.9), float2(0.75, 0.2))] shader float main(float2 x) {\n"
                 "float3 p = float3(x, %g), sun = float3(0.0, 1.0, slope);\n%s\n}\n",
                 SIDE, SIDE, slope, lift, s->body);
        if (slt_compile_string(source, "masks", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
        double v[SIDE * SIDE] = {0}, value, g[SIDE * SIDE + 1], bar[SIDE * SIDE + 1];
        for (int i = 0; i < SIDE; i++) v[RIDGE * SIDE + i] = height;
        slt_param_find(p, "h", &q, NULL);
        slt_set_floats(p, q.fbase, SIDE * SIDE, v, NULL);
        slt_param_find(p, "slope", &q, NULL);
        SltJob job = SLT_JOB_INIT;
        SltStats stats = SLT_STATS_INIT;
        SltIntegral out = {.struct_size = sizeof out, .value = &value, .gradient = g, .gradient_stderr = bar};
        job.integral = true, job.threads = 1, job.estimator = SLT_EST_LATTICE, job.segments = 1 << 18;
        if (slt_grad_integral(p, &job, &out, &stats, &err) != SLT_OK) fail_msg("%s", err.text);
        double want = -1.5 * s->edges * (height - lift) / (slope * slope), got = g[q.fbase];
        if (!(fabs(got - want) <= 4 * bar[q.fbase] + 1e-3 * fabs(want)) || !(fabs(got - want) <= 0.01 * fabs(want)))
            fail_msg("%s: %.6g +- %.2g, not %.6g", s->body, got, bar[q.fbase], want);
        assert_int_equal(stats.dropped[SLT_DROP_NO_EVENT], 0);
        slt_program_free(p);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_shadow_of_a_ridge)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
