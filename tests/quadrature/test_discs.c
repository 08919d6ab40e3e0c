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

static SltProgram *compile(double p[3 * DISCS]) {
    uint64_t random = 500;
    for (int i = 0; i < DISCS; i++) {
        p[3 * i] = disc_random(&random), p[3 * i + 1] = disc_random(&random);
        p[3 * i + 2] = 0.02 + 0.04 * disc_random(&random);
    }
    char *source = source_of(p);
    SltOptions o = SLT_OPTIONS_INIT;
    o.f64 = true;
    SltProgram *program = NULL;
    if (slt_compile_string(source, "discs", &o, &program) != SLT_OK) fail_msg("%s", slt_diagnostics_text(program));
    assert_int_equal(slt_float_count(program), 4 * DISCS);
    free(source);
    return program;
}

static void many_discs(void **state) {
    (void)state;
    static double p[3 * DISCS], want[3 * DISCS], got[2][4 * DISCS];
    SltProgram *program = compile(p);
    discs_exact(p, DISCS, want);
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
        if (stats.evaluations > 74000) fail_msg("%llu evaluations", (unsigned long long)stats.evaluations);
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
}

/* Two discs whose borders meet at a right angle, where one curve is upright and the other lies: they have no height
 * axis in common, and no cells around that place are needed for the areas. */
static void right_angle(void **state) {
    (void)state;
    static const char source[] =
        "param float3 disc[2] = { float3(0.3337, 0.5871, 0.28), float3(0.6137, 0.3071, 0.28) };\n"
        "param float ink[2] = { 0.9, 0.4 };\n"
        "shader float main(float2 x) { float c = 0.2; for (int i = 0; i < 2; i++) { float2 v = x - disc[i].xy;\n"
        "[Disc] if (dot(v, v) < disc[i].z * disc[i].z) c = ink[i]; } return c; }";
    SltOptions o = SLT_OPTIONS_INIT;
    o.f64 = true;
    SltProgram *p = NULL;
    if (slt_compile_string(source, "right angle", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
    SltJob job = SLT_JOB_INIT;
    job.integral = true, job.estimator = SLT_EST_QUADRATURE, job.error = 1e-6;
    double got[8], bar[8];
    SltIntegral out = {.struct_size = sizeof out, .gradient = got, .gradient_stderr = bar};
    SltStats stats = SLT_STATS_INIT;
    SltError err = {0};
    if (slt_grad_integral(p, &job, &out, &stats, &err) != SLT_OK) fail_msg("%s", err.text);
    double r = 0.28, pi = acos(-1), lens = r * r * (pi / 2 - 1), quarter = r * pi / 2;
    /* A quarter of the first circle is hidden, and as much of the second lies on the first disc. Jumps: 0.7 and 0.2 to
     * the ground, -0.5 between the two. */
    const double want[8] = {-0.7 * r,          0.7 * r,   0.7 * 3 * quarter,
                            0.7 * r,           -0.7 * r,  (0.2 * 3 - 0.5) * quarter,
                            pi * r * r - lens, pi * r * r};
    if (getenv("SALTUS_PRINT")) printf("    %llu evaluations\n", (unsigned long long)stats.evaluations);
    for (int i = 0; i < 8; i++)
        if (!(fabs(got[i] - want[i]) <= 1e-9) || !(fabs(got[i] - want[i]) <= bar[i]))
            fail_msg("%d: %.12g, not %.12g; stated %g", i, got[i], want[i], bar[i]);
    if (stats.left > 0) fail_msg("left %g", stats.left);
    if (stats.evaluations > 800) fail_msg("%llu evaluations", (unsigned long long)stats.evaluations);
    slt_program_free(p);
}

/* Curves of the second degree that are no circles: their points come from a closed form too. */
static void other_quadrics(void **state) {
    (void)state;
    static const struct {
        const char *source;
        double want[5];
    } list[] = {
        {"param float2 c = float2(0.5137, 0.4871); param float2 r = float2(0.31, 0.12); param float k = 0.7;\n"
         "shader float main(float2 x) { float f = 0.2; float2 v = (x - c) / r; v.y += k * v.x;\n"
         "[Disc] if (dot(v, v) < 1.0) f = 0.9; return f; }",
         {0, 0, 0.7 * 3.14159265358979324 * 0.12, 0.7 * 3.14159265358979324 * 0.31, 0}},
        {"param float p = 0.17; param float s = 0.37;\n"
         "shader float main(float2 x) { float f = 0.2; [Disc] if (x.x * x.y < p) f = 0.9;\n"
         "[Disc] if (x.x + 2.0 * x.y < s) f = 0.5; return f; }",
         {0.7 * 1.77195684193187529, -0.4 * 0.37 / 2}}, /* ln .17 */
    };
    for (size_t i = 0; i < sizeof list / sizeof *list; i++) {
        SltOptions o = SLT_OPTIONS_INIT;
        o.f64 = true;
        SltProgram *p = NULL;
        if (slt_compile_string(list[i].source, "quadric", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
        for (double error = 1e-3; error > 1e-10; error *= 1e-3) {
            SltJob job = SLT_JOB_INIT;
            job.integral = true, job.estimator = SLT_EST_QUADRATURE, job.error = error;
            double got[5] = {0}, bar[5] = {0};
            SltIntegral out = {.struct_size = sizeof out, .gradient = got, .gradient_stderr = bar};
            SltStats stats = SLT_STATS_INIT;
            SltError err = {0};
            if (slt_grad_integral(p, &job, &out, &stats, &err) != SLT_OK) fail_msg("%s", err.text);
            for (int k = 0; k < 5; k++)
                if (!(fabs(got[k] - list[i].want[k]) <= fmin(error, bar[k] + 1e-12)))
                    fail_msg("%zu, %d: %.12g, not %.12g; stated %g", i, k, got[k], list[i].want[k], bar[k]);
            if (stats.left > 0) fail_msg("left %g", stats.left);
        }
        slt_program_free(p);
    }
}

/* Parts of one disc in different pixels are not one: the loss of an image is that of its pixels, and, as these are
 * linear in the inks, so is what its derivatives in the inks add up to.
 * One sweep for image and derivatives says the same as one for each. */
static void image_of_discs(void **state) {
    (void)state;
    enum { SIDE = 48, N = SIDE * SIDE };
    static double p[3 * DISCS], gradient[4 * DISCS], apart[4 * DISCS], bound[4 * DISCS];
    static float target[N], image[N], fused[N];
    SltProgram *program = compile(p);
    SltJob job = SLT_JOB_INIT;
    job.estimator = SLT_EST_QUADRATURE, job.size[0] = job.size[1] = SIDE, job.spp = 4;
    for (int i = 0; i < N; i++) target[i] = (float)(0.5 + 0.4 * sin(0.7 * i));
    SltError err = {0};
    double loss[3], sum = 0, inks = 0, want = 0, off = 0, size = 0;
    if (slt_grad_loss(program, &job, target, NULL, &loss[0], NULL, NULL, image, NULL, &err) != SLT_OK ||
        slt_grad_loss(program, &job, target, NULL, &loss[1], gradient, NULL, fused, NULL, &err) != SLT_OK ||
        slt_grad_loss(program, &job, target, NULL, &loss[2], apart, bound, NULL, NULL, &err) != SLT_OK)
        fail_msg("%s", err.text);
    for (int i = 0; i < N; i++) {
        double d = (double)image[i] - (double)target[i];
        sum += d * d / N, want += 2 * d * (double)image[i] / N;
        if (!(fabsf(fused[i] - image[i]) < 1e-5f))
            fail_msg("pixel %d: %g, not %g", i, (double)fused[i], (double)image[i]);
    }
    for (int k = 0; k < 3; k++)
        if (!(fabs(loss[k] - sum) < 1e-6)) fail_msg("loss %d: %.9g, not %.9g", k, loss[k], sum);
    for (uint32_t i = 0; i < DISCS; i++) inks += disc_color(i) * gradient[4 * i + 3];
    if (!(fabs(inks - want) < 1e-6)) fail_msg("inks: %.9g, not %.9g", inks, want);
    for (int i = 0; i < 4 * DISCS; i++)
        off += (gradient[i] - apart[i]) * (gradient[i] - apart[i]), size += apart[i] * apart[i];
    if (getenv("SALTUS_PRINT")) printf("    one sweep or two: %.2g\n", sqrt(off / size));
    if (!(sqrt(off / size) < 1e-4)) fail_msg("one sweep or two: off by %g", sqrt(off / size));
    slt_program_free(program);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(many_discs), cmocka_unit_test(right_angle),
                                       cmocka_unit_test(other_quadrics), cmocka_unit_test(image_of_discs)};
    return cmocka_run_group_tests_name("discs", tests, NULL, NULL);
}
