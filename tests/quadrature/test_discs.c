/* Opaque discs painted in order, from source: all derivatives against exact arcs and areas, and what they cost. Most
 * curves of such a picture are hidden, and most parts between curves belong to few shapes. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/saltus.h"
#include "tests/quadrature/discs.h"

enum { DISCS = 500 };

static char *source_of(const double *p) {
    char *text = malloc(DISCS * 120 + 1000), *at = text;
    at += sprintf(at, "struct Disc { float3 place; float ink; };\nparam Disc discs[%d] = {\n", DISCS);
    for (uint32_t i = 0; i < DISCS; i++)
        at += sprintf(at, "{ float3(%.17g, %.17g, %.17g), %.17g },\n", p[3 * i], p[3 * i + 1], p[3 * i + 2],
                      disc_color(i));
    sprintf(at,
            "};\nshader float main(float2 x) { float c = 0.0; for (int i = 0; i < %d; i++) { "
            "float2 v = x - discs[i].place.xy; "
            "[Disc] if (dot(v, v) < discs[i].place.z * discs[i].place.z) c = discs[i].ink; } return c; }",
            DISCS);
    return text;
}

static void many_discs(void **state) {
    (void)state;
    static double p[3 * DISCS], want[3 * DISCS], got[2][4 * DISCS];
    uint64_t random = 500;
    for (int i = 0; i < DISCS; i++) {
        p[3 * i] = disc_random(&random), p[3 * i + 1] = disc_random(&random);
        p[3 * i + 2] = 0.02 + 0.04 * disc_random(&random);
    }
    discs_exact(p, DISCS, want);
    char *source = source_of(p);
    SltOptions o = SLT_OPTIONS_INIT;
    o.f64 = true;
    SltProgram *program = NULL;
    if (slt_compile_string(source, "discs", &o, &program) != SLT_OK) fail_msg("%s", slt_diagnostics_text(program));
    assert_int_equal(slt_float_count(program), 4 * DISCS);
    double value[2];
    for (uint32_t threads = 1; threads <= 2; threads++) {
        SltJob job = SLT_JOB_INIT;
        job.integral = true, job.estimator = SLT_EST_QUADRATURE, job.error = 1e-6, job.threads = threads;
        SltIntegral out = {.struct_size = sizeof out, .gradient = got[threads - 1], .value = &value[threads - 1]};
        SltStats stats = SLT_STATS_INIT;
        SltError err = {0};
        if (slt_grad_integral(program, &job, &out, &stats, &err) != SLT_OK) fail_msg("%s", err.text);
        if (getenv("SALTUS_PRINT")) printf("    %llu evaluations\n", (unsigned long long)stats.evaluations);
        if (stats.left > 0) fail_msg("left %g", stats.left);
        if (stats.evaluations > 460000) fail_msg("%llu evaluations", (unsigned long long)stats.evaluations);
    }
    assert_memory_equal(got[0], got[1], sizeof got[0]);
    assert_memory_equal(&value[0], &value[1], sizeof value[0]);
    double off = 0, size = 0, inks = 0;
    for (uint32_t i = 0; i < DISCS; i++) {
        for (int k = 0; k < 3; k++) {
            double d = got[0][4 * i + k] - want[3 * i + k];
            off += d * d, size += want[3 * i + k] * want[3 * i + k];
        }
        inks += disc_color(i) * got[0][4 * i + 3]; /* derivatives in the ink are areas */
    }
    if (getenv("SALTUS_PRINT")) printf("    off by %.2g, areas by %.2g\n", sqrt(off / size), fabs(inks / value[0] - 1));
    if (!(sqrt(off / size) <= 1e-6)) fail_msg("off by %g", sqrt(off / size));
    if (!(fabs(inks / value[0] - 1) <= 1e-12)) fail_msg("areas off by %g", inks / value[0] - 1);
    slt_program_free(program);
    free(source);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(many_discs)};
    return cmocka_run_group_tests_name("discs", tests, NULL, NULL);
}
