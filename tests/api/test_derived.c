/* Arrays that are computed from parameters, in a program object: computed when what they read has changed, no number of
 * theirs among the caller's. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

#include "bindings/c/derived.h"
#include "tests/scratch.h"

static const char file[] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
/* The height at the corners' middle: (up + which) times 1, lit by `light`. */
static const char source[] =
    "[Vertex(place)] param mesh m = \"%s\";\n"
    "param float up = 0.5;\n"
    "param int which = 0;\n"
    "param float light = 2.0;\n"
    "float3 place(int i, float3 p, int part) { return p + float3(0.0, 0.0, up + float(which)); }\n"
    "shader float main(float2 x) {\n"
    "    [NoDisc] MeshHit v = m.trace(float3(x * 0.4, 9.0), float3(0.0, 0.0, -1.0), 0.0, 99.0);\n"
    "    return light * v.p.z * m.smooth_normal(v).z;\n"
    "}\n";
enum { FLOATS = 9 + 2, UP = 9, LIGHT = 10 };

static SltProgram *compile(void) {
    char text[8192];
    SltOptions opt = SLT_OPTIONS_INIT;
    SltProgram *p;
    scratch_put("a.obj", file);
    snprintf(text, sizeof text, source, scratch_path("a.obj"));
    opt.stdlib_dir = SALTUS_STDLIB_BUILD, opt.f64 = true;
    if (slt_compile_string(text, "t.salt", &opt, &p) != SLT_OK)
        fail_msg("%s%s", slt_diagnostics_text(p), slt_last_error(p));
    return p;
}

static double value(SltProgram *p, const double *floats, const int32_t *ints) {
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    const double x[2] = {0.5, 0.5};
    double out;
    job.floats = floats, job.ints = ints;
    if (slt_eval(p, &job, 1, x, NULL, &out, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
    return out;
}

static void set(SltProgram *p, uint32_t at, double v) { assert_int_equal(slt_set_floats(p, at, 1, &v, NULL), SLT_OK); }

static void follows(void **state) {
    (void)state;
    SltProgram *p = compile();
    assert_int_equal(slt_float_count(p), FLOATS);
    assert_int_equal(slt_int_count(p), 1);
    assert_float_equal(value(p, NULL, NULL), 1, 1e-12);
    /* Integers are not watched: this array reads some, so it is computed for each call. */
    set(p, UP, 0.75);
    assert_float_equal(value(p, NULL, NULL), 1.5, 1e-12);
    int32_t one = 1;
    assert_int_equal(slt_set_ints(p, 0, 1, &one, NULL), SLT_OK);
    assert_float_equal(value(p, NULL, NULL), 3.5, 1e-12);
    assert_int_equal(slt_set_floats(p, FLOATS, 1, &(double){0}, NULL), SLT_USAGE);
    slt_program_free(p);
}

/* A call's own parameters, floats and integers, place for this call alone. */
static void lent(void **state) {
    (void)state;
    SltProgram *p = compile();
    double floats[FLOATS];
    memcpy(floats, slt_floats(p), sizeof floats);
    floats[UP] = 2;
    const int32_t ints[1] = {3};
    assert_float_equal(value(p, floats, NULL), 4, 1e-12);
    assert_float_equal(value(p, floats, ints), 10, 1e-12);
    assert_float_equal(value(p, NULL, ints), 7, 1e-12);
    assert_float_equal(value(p, NULL, NULL), 1, 1e-12);
    slt_program_free(p);
}

static void gradient(SltProgram *p, double g[FLOATS + 1]) {
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    SltIntegral out = SLT_INTEGRAL_INIT;
    job.samples = 64, job.estimator = SLT_EST_LATTICE, job.threads = 1;
    out.gradient = g;
    g[FLOATS] = 123; /* behind the caller's numbers nothing is written */
    if (slt_grad_integral(p, &job, &out, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
    assert_true(g[FLOATS] == 123);
}

static void differentiated(void **state) {
    (void)state;
    SltProgram *p = compile();
    double g[FLOATS + 1], h[FLOATS + 1];
    const char *up[] = {"up"}, *light[] = {"light"};
    gradient(p, g);
    assert_float_equal(g[UP], 2, 1e-12);
    assert_float_equal(g[LIGHT], 0.5, 1e-12);
    assert_float_equal(g[2] + g[5] + g[8], 2, 1e-12); /* all vertices up */
    assert_int_equal(slt_wrt(p, up, 1, NULL), SLT_OK);
    assert_int_equal(p->wrt[p->prog->derived[0].base], 1);
    gradient(p, h);
    assert_true(h[UP] == g[UP] && h[LIGHT] == 0 && h[2] == 0);
    assert_int_equal(slt_wrt(p, light, 1, NULL), SLT_OK);
    assert_int_equal(p->wrt[p->prog->derived[0].base], 0);
    assert_null(p->derived[0].fn[K_VJP]);
    gradient(p, h);
    assert_true(h[UP] == 0 && h[LIGHT] == g[LIGHT]);
    assert_null(p->derived[0].fn[K_VJP]); /* what is not differentiated is not compiled */
    slt_program_free(p);
}

/* Normals read positions alone: they are computed again when these move, and at no other time. */
static void watched(void **state) {
    (void)state;
    SltProgram *p = compile();
    value(p, NULL, NULL);
    uint32_t before = p->derived[1].computed;
    assert_string_equal(p->prog->derived[1].what, "normals of vertices");
    p->prog->derived[0].reads_ints = p->prog->derived[1].reads_ints = false;
    set(p, LIGHT, 3), value(p, NULL, NULL);
    set(p, UP, 0.5), value(p, NULL, NULL); /* as it was */
    assert_int_equal(p->derived[1].computed, before);
    set(p, UP, 0.6), value(p, NULL, NULL);
    assert_int_equal(p->derived[1].computed, before + 1);
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(follows), cmocka_unit_test(lent),
                                       cmocka_unit_test(differentiated), cmocka_unit_test(watched)};
    return cmocka_run_group_tests_name("api.derived", tests, scratch_make, scratch_drop);
}
