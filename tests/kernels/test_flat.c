/* Programs that are step functions of the position: which are known to be, and what quadrature then need not evaluate.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "bindings/c/api.h"

#define SHADER(params, body) params "[Domain(-1.0, 1.0)] shader float main(float2 x) { " body " }"
#define PAINTED(ink)                                                                                                   \
    SHADER("param float3 d[2] = { float3(-0.3, 0.1, 0.5), float3(0.3, 0.0, 0.5) }; param float k[2] = { 0.8, 0.3 };",  \
           "float f = 0.1; for (int i = 0; i < 2; i++) { float2 q = x - d[i].xy; [Disc] if (dot(q, q) < d[i].z * "     \
           "d[i].z) f = " ink "; } return f;")

static const struct {
    const char *name, *source;
    bool flat;
} cases[] = {
    {"constant inks", PAINTED("k[i]"), true},
    {"shaded inks", PAINTED("k[i] * x.x"), false},
    {"a shade that is detached", PAINTED("k[i] * detach(x.x)"), false},
    {"nearest seed",
     SHADER("param float p[3] = { 0.1, 0.4, 0.7 };",
            "float best = 9.0; float f = 0.0; for (int i = 0; i < 3; i++) { float q = abs(x.x - p[i]); "
            "[Disc] if (q < best) { best = q; f = p[i]; } } return f;"),
     true},
    {"its distance",
     SHADER("param float p[3] = { 0.1, 0.4, 0.7 };",
            "float best = 9.0; for (int i = 0; i < 3; i++) { float q = abs(x.x - p[i]); "
            "[Disc] if (q < best) { best = q; } } return best;"),
     false},
    {"quantised", SHADER("param float s = 4.3;", "[Disc] float q = floor(s * x.x); return q * s;"), true},
    {"what rounding leaves", SHADER("param float s = 4.3;", "[Disc] float q = floor(s * x.x); return s * x.x - q;"),
     false},
    {"an index",
     SHADER("param float k[4] = { 0.1, 0.7, 0.4, 0.2 };", "[Disc] float q = floor(2.0 * x.x + 2.0); "
                                                          "return k[int(q)];"),
     true},
    {"a march",
     SHADER("param float p = 0.3;", "float t = 0.0; for (int i = 0; i < 4; i++) { [Disc] if (t * t + x.x * t "
                                    "> x.y) break; t += p; } return t;"),
     true},
    {"a march that moves",
     SHADER("param float p = 0.3;", "float t = x.x; for (int i = 0; i < 4; i++) { [Disc] if (t * t "
                                    "> x.y) break; t += p; } return t;"),
     false},
};

static SltProgram *compile(const char *source) {
    SltOptions o = SLT_OPTIONS_INIT;
    SltProgram *p;
    o.f64 = true, o.no_cache = true, o.stdlib_dir = SALTUS_STDLIB_BUILD;
    if (slt_compile_string(source, "flat", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
    return p;
}

static void known(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        SltProgram *p = compile(cases[i].source);
        SltError err = {0};
        bool needs[K_KINDS] = {[K_VALUE] = true, [K_BOUNDS] = true, [K_EDGE] = true, [K_EDGE_BOUNDS] = true};
        if (api_kernels(p, needs, &err) != SLT_OK) fail_msg("%s: %s", cases[i].name, err.text);
        if (p->scene.flat != cases[i].flat) fail_msg("%s", cases[i].name);
        slt_program_free(p);
    }
}

/* The same answers as if points were needed all over, for a fraction of the evaluations. */
static void cheaper(void **state) {
    (void)state;
    static const char *sources[2] = {PAINTED("k[i]"), PAINTED("k[i] + 0.0 * x.x")};
    double gradient[2][8];
    SltStats stats[2];
    for (int i = 0; i < 2; i++) {
        SltProgram *p = compile(sources[i]);
        SltJob job = SLT_JOB_INIT;
        SltIntegral out = SLT_INTEGRAL_INIT;
        SltError err = {0};
        job.integral = true, job.threads = 1, job.estimator = SLT_EST_QUADRATURE, job.error = 1e-9;
        out.gradient = gradient[i], stats[i] = (SltStats)SLT_STATS_INIT;
        if (slt_grad_integral(p, &job, &out, &stats[i], &err) != SLT_OK) fail_msg("%s", err.text);
        assert_true(p->scene.flat == !i && stats[i].certified > 1 - 1e-9);
        slt_program_free(p);
    }
    for (int k = 0; k < 8; k++) assert_true(fabs(gradient[0][k] - gradient[1][k]) < 1e-8);
    assert_true(2 * stats[0].evaluations < stats[1].evaluations);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(known), cmocka_unit_test(cheaper)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
