/* Sites in loops of which other sites need the result: a loop is cloned for the later one, and the earlier one is cut
 * out of it as well. And queries beside [SkipLoop], each iteration with an edge of its own. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include "saltus/saltus.h"

enum { N = 17 };

/* The integral's derivative in `name`. */
static double derivative(const char *source, const char *name) {
    SltOptions o = SLT_OPTIONS_INIT;
    SltProgram *p;
    SltParam q = SLT_PARAM_INIT;
    SltError err;
    SltStats s = SLT_STATS_INIT;
    double value;
    if (slt_compile_string(source, "loops", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
    if (slt_param_find(p, "h", &q, &err) == SLT_OK) {
        double v[N * N];
        for (uint32_t i = 0; i < N * N; i++)
            v[i] = 0.2 * ((i * 2654435761u ^ (i >> 3) * 2246822519u) * 3266489917u >> 8) / 16777216.0;
        slt_set_floats(p, q.fbase, N * N, v, NULL);
    }
    double *g = malloc(sizeof *g * slt_float_count(p)), at;
    SltJob j = {.struct_size = sizeof j, .integral = true, .samples = 1 << 18, .seed = 2, .threads = 2};
    SltIntegral out = {.struct_size = sizeof out, .value = &value, .gradient = g};
    if (slt_grad_integral(p, &j, &out, &s, &err) != SLT_OK) fail_msg("%s", err.text);
    for (int d = 0; d < SLT_DROP_REASONS; d++) assert_true(s.dropped[d] * 1000 <= s.crossings);
    assert_int_equal(slt_param_find(p, name, &q, &err), SLT_OK);
    at = g[q.fbase];
    free(g);
    slt_program_free(p);
    return at;
}

/* c falls by 0.1 where x passes p, p + 0.1, .. p + 0.3, and f = 1 below y = p - c. */
static void test_result_of_a_loop(void **state) {
    (void)state;
    double got = derivative("param float p = 0.43;\n"
                            "shader float main(float2 x) {\n"
                            "    float c = 0.0;\n"
                            "    for (int i = 0; i < 4; i++) {\n"
                            "        [Disc] if (x.x < p + 0.1 * i) c += 0.1;\n"
                            "    }\n"
                            "    [Disc] if (c + x.y < p) return 1.0;\n"
                            "    return c;\n"
                            "}\n",
                            "p");
    double want = (0.03 + 0.97 * 0.4) + (0.43 * 0.6 + 0.1 * (0.7 + 0.8 + 0.9) + 0.27) - 0.43;
    print_message("%g, exact %g\n", got, want);
    assert_true(fabs(got - want) < 0.004);
}

#define RAY "float3(x, 0.05 + 0.01 * i), float3(1.0, 0.1 * i, sun), 0.01, 10.0"
#define LOOP(statement)                                                                                                                                                                                                     \
    "[Extent(0, 0, 1, 1)] param heightfield h = zeros(17, 17); param float sun = 0.4;"                                                                                                                                     \
    "[Domain(0.1, 0.9)] shader float main(float2 x) { float f = 1.0; bool dark = false;"                                                                                                                                   \
    " for (int i = 0; i < 4; i++) { " statement " } return dark ? 0.5 * f : 1.0; }"

static void test_queries(void **state) {
    (void)state;
    static const struct {
        const char *name, *skip, *plain;
    } row[] = {
        {"a condition", LOOP("[Disc, SkipLoop] if (h.occluded(" RAY ")) dark = true;"),
         LOOP("[Disc] if (h.occluded(" RAY ")) dark = true;")},
        {"its opposite", LOOP("[Disc, SkipLoop] if (!h.occluded(" RAY ")) dark = true;"),
         LOOP("[Disc] if (!h.occluded(" RAY ")) dark = true;")},
        {"a hit", LOOP("[Disc, SkipLoop] if (h.trace(" RAY ").hit) dark = true;"),
         LOOP("[Disc] if (h.occluded(" RAY ")) dark = true;")},
        {"beside",
         LOOP("[Disc] bool o = h.occluded(" RAY
              "); if (o) f *= 0.7; [Disc, SkipLoop] if (h.height(x) + 0.1 * i < sun) dark = true;"),
         LOOP("[Disc] bool o = h.occluded(" RAY
              "); if (o) f *= 0.7; [Disc] if (h.height(x) + 0.1 * i < sun) dark = true;")},
    };
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        double a = derivative(row[i].skip, "sun"), b = derivative(row[i].plain, "sun");
        print_message("%s: %g, without [SkipLoop] %g\n", row[i].name, a, b);
        assert_true(fabs(b) > 0.01 && fabs(a - b) < 0.03 * fabs(b));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_result_of_a_loop), cmocka_unit_test(test_queries)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
