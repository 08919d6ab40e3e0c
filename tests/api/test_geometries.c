/* The life of a geometry in a program object: made when a kernel asks, for what it asks, following its numbers, the
 * same answers however it came about. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "bindings/c/api.h"

enum { N = 33, SIZE = 24 };

static const char plain[] = "param heightfield h = zeros(33, 33);\n"
                            "shader float main(float2 x) { return h.height(x) + h.normal(x).x; }\n";
static const char lit[] = "[Height(0.2, 0.0)] param heightfield h = zeros(33, 33);\n"
                          "param float sun = 0.4;\n"
                          "shader float main(float2 x) {\n"
                          "    float3 o = float3(x, h.height(x) + 0.001);\n"
                          "    float f = 1.0;\n"
                          "    [Disc] if (h.clearance(o, float3(0.9, 0.3, sun), 0.02, 1e9) < 0.0) f = 0.2;\n"
                          "    return f;\n"
                          "}\n";
static const char seen[] = "[Height(0.2, 0.0)] param heightfield h = zeros(33, 33);\n"
                           "param heightfield other = zeros(3, 3);\n"
                           "shader float main(float2 x) {\n"
                           "    [NoDisc] Hit v = h.trace(float3(x, 2.0), float3(0.1, 0.2, -1.0), 0.0, 1e9);\n"
                           "    return v.hit ? v.t : 0.0;\n"
                           "}\n";

static SltProgram *compile(const char *source, SltStructure field, bool f64, bool interpret) {
    SltOptions opt = SLT_OPTIONS_INIT;
    SltProgram *p;
    opt.stdlib_dir = SALTUS_STDLIB_BUILD;
    opt.field = field, opt.f64 = f64, opt.interpret = interpret, opt.no_cache = true;
    if (slt_compile_string(source, "t.salt", &opt, &p) != SLT_OK)
        fail_msg("%s%s", slt_diagnostics_text(p), slt_last_error(p));
    return p;
}

static double terrain(uint32_t x, uint32_t y, uint32_t seed) {
    uint32_t h = (x * 73856093u) ^ (y * 19349663u) ^ (seed * 83492791u);
    h ^= h >> 13, h *= 0x5bd1e995u, h ^= h >> 15;
    return (double)(h % 1000) / 1000;
}

static void set_terrain(SltProgram *p, uint32_t seed) {
    double *v = malloc(N * N * sizeof *v);
    assert_non_null(v);
    for (uint32_t i = 0; i < N * N; i++) v[i] = terrain(i % N, i / N, seed);
    assert_int_equal(slt_set_floats(p, p->prog->params[0].fbase, N * N, v, NULL), SLT_OK);
    free(v);
}

static void render(SltProgram *p, float *image) {
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    job.size[0] = job.size[1] = SIZE, job.spp = 4, job.threads = 2;
    if (slt_render(p, &job, image, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
}

static void assert_same_image(SltProgram *a, SltProgram *b) {
    float x[SIZE * SIZE], y[SIZE * SIZE];
    render(a, x), render(b, y);
    assert_memory_equal(x, y, sizeof x);
}

/* No query, no structure; nothing before a kernel exists; only what kernels ask. */
static void built_on_need(void **state) {
    (void)state;
    float image[SIZE * SIZE];
    SltProgram *p = compile(plain, SLT_STRUCTURE_AUTO, false, false);
    assert_int_equal(p->prog->ngeometries, 0);
    render(p, image);
    assert_null(p->scene.geometries && p->scene.ngeometries ? p->scene.geometries[0] : NULL);
    slt_program_free(p);

    p = compile(seen, SLT_STRUCTURE_AUTO, false, false);
    assert_int_equal(p->prog->ngeometries, 1); /* `other` is not searched */
    assert_null(p->geometries[0]);
    render(p, image);
    assert_non_null(p->geometries[0]);
    assert_int_equal(p->geometry_state[0].built, 1u << SLT_QUERY_TRACE);
    for (int k = 0; k < K_KINDS; k++) assert_int_equal(api_geometry_queries(p->fn[k], 0) & ~(1u << SLT_QUERY_TRACE), 0);
    slt_program_free(p);

    p = compile(lit, SLT_STRUCTURE_AUTO, false, false);
    render(p, image);
    assert_int_equal(p->geometry_state[0].built &
                         (1u << SLT_QUERY_TRACE | 1u << SLT_QUERY_OCCLUDED | 1u << SLT_QUERY_SILHOUETTE),
                     0);
    assert_true(p->geometry_state[0].built & (1u << SLT_QUERY_SHADOW | 1u << SLT_QUERY_CLEARANCE));
    slt_program_free(p);
}

/* A few heights: the rectangle around them. None that is really another: nothing. Another parameter: nothing. The image
 * is that of a program that was never otherwise. */
static void follows_heights(void **state) {
    (void)state;
    for (int f64 = 0; f64 < 2; f64++) {
        SltProgram *p = compile(lit, SLT_STRUCTURE_AUTO, f64, false), *fresh;
        float image[SIZE * SIZE], before[SIZE * SIZE];
        uint32_t base = p->prog->params[0].fbase;
        set_terrain(p, 1);
        render(p, before);
        const GeometryState *s = &p->geometry_state[0];
        assert_int_equal(s->made, 1);
        set_terrain(p, 1);
        double sun = 0.3;
        SltParam at = SLT_PARAM_INIT;
        assert_int_equal(slt_param_find(p, "sun", &at, NULL), SLT_OK);
        assert_int_equal(slt_set_floats(p, at.fbase, 1, &sun, NULL), SLT_OK);
        render(p, image);
        assert_int_equal(s->followed, 0);

        /* rows 3 and 4 of the data, columns 5 to 7 */
        double tall[3] = {5, 6, 5};
        assert_int_equal(slt_set_floats(p, base + 3 * N + 5, 3, tall, NULL), SLT_OK);
        assert_int_equal(slt_set_floats(p, base + 4 * N + 6, 1, tall, NULL), SLT_OK);
        render(p, image);
        assert_int_equal(s->made, 1), assert_int_equal(s->followed, 1), assert_int_equal(s->followed_values, 6);
        assert_memory_not_equal(image, before, sizeof image);
        fresh = compile(lit, SLT_STRUCTURE_AUTO, f64, false);
        assert_int_equal(slt_set_floats(fresh, 0, fresh->prog->nfloats, slt_floats(p), NULL), SLT_OK);
        assert_same_image(p, fresh);

        /* back down again, and everything anew */
        double low[3] = {0, 0, 0};
        assert_int_equal(slt_set_floats(p, base + 3 * N + 5, 3, low, NULL), SLT_OK);
        assert_int_equal(slt_set_floats(fresh, base + 3 * N + 5, 3, low, NULL), SLT_OK);
        assert_same_image(p, fresh);
        set_terrain(p, 7);
        slt_program_free(fresh);
        fresh = compile(lit, SLT_STRUCTURE_AUTO, f64, false);
        assert_int_equal(slt_set_floats(fresh, 0, fresh->prog->nfloats, slt_floats(p), NULL), SLT_OK);
        assert_same_image(p, fresh);
        assert_int_equal(s->made, 1);
        slt_program_free(fresh);
        slt_program_free(p);
    }
}

/* Every structure, and the interpreter: the same bits. */
static void structures_agree(void **state) {
    (void)state;
    static const char *const sources[] = {lit, seen};
    for (int k = 0; k < 2; k++)
        for (int f64 = 0; f64 < 2; f64++) {
            SltProgram *oracle = compile(sources[k], SLT_STRUCTURE_NAIVE, f64, false);
            set_terrain(oracle, 3);
            for (int s = SLT_STRUCTURE_AUTO; s <= SLT_STRUCTURE_CONE; s++) {
                SltProgram *p = compile(sources[k], (SltStructure)s, f64, s == SLT_STRUCTURE_MIPMAP);
                set_terrain(p, 3);
                assert_same_image(p, oracle);
                set_terrain(p, 4), set_terrain(oracle, 4);
                assert_same_image(p, oracle);
                set_terrain(oracle, 3);
                slt_program_free(p);
            }
            slt_program_free(oracle);
        }
}

/* A gradient asks more than an image: the structure is made once more, for both; another --wrt asks nothing new. */
static void gradients_ask_more(void **state) {
    (void)state;
    SltProgram *p = compile(lit, SLT_STRUCTURE_AUTO, false, false);
    set_terrain(p, 2);
    float image[SIZE * SIZE];
    render(p, image);
    uint32_t wanted = p->geometry_state[0].wanted;
    SltJob job = SLT_JOB_INIT;
    job.integral = true, job.samples = 1024;
    double *gradient = calloc(p->prog->nfloats, sizeof *gradient);
    assert_non_null(gradient);
    SltIntegral out = {.struct_size = sizeof out, .gradient = gradient};
    SltError err = {0};
    if (slt_grad_integral(p, &job, &out, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
    assert_int_equal(p->geometry_state[0].wanted & wanted, wanted);
    assert_int_equal(p->geometry_state[0].built, p->geometry_state[0].wanted);
    uint32_t made = p->geometry_state[0].made;
    const char *sun[] = {"sun"};
    assert_int_equal(slt_wrt(p, sun, 1, &err), SLT_OK);
    if (slt_grad_integral(p, &job, &out, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
    assert_int_equal(p->geometry_state[0].made, made);
    free(gradient);
    slt_program_free(p);
}

/* An option struct of an older library is shorter; one from nowhere is refused. */
static void options_are_checked(void **state) {
    (void)state;
    SltOptions opt = SLT_OPTIONS_INIT;
    SltProgram *p;
    opt.field = (SltStructure)77;
    assert_int_equal(slt_compile_string(plain, "t.salt", &opt, &p), SLT_USAGE);
    slt_program_free(p);
    opt.struct_size = offsetof(SltOptions, field);
    assert_int_equal(slt_compile_string(plain, "t.salt", &opt, &p), SLT_OK);
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(built_on_need), cmocka_unit_test(follows_heights),
                                       cmocka_unit_test(structures_agree), cmocka_unit_test(gradients_ask_more),
                                       cmocka_unit_test(options_are_checked)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
