/* Shadows on ground that is seen behind ridges: where a near ridge hides the ground behind it, the ray to the sun
 * begins elsewhere, and the shadow's boundary function jumps. Steps too small to be told from slopes across a whole
 * segment must then be found where it jumps: the crossing is theirs. Rough terrains have many. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/saltus.h"

enum { N = 256, SIZE = 256 };

static const char *const shadow_by[] = {"[Disc] if (h.occluded(p, sun, 0.006, 50.0)) l = 0.0;",
                                        "[Disc] if (h.clearance(p, sun, 0.01, 50.0) < 0.0) l = 0.0;",
                                        "[Disc] if (v.p.x + 0.5 * v.p.y < 0.1 * sun.x) l = 0.0;"};

static SltProgram *load(const char *shadow, bool f64) {
    char source[2048];
    SltOptions o = SLT_OPTIONS_INIT;
    SltParam q = SLT_PARAM_INIT;
    SltProgram *p;
    o.f64 = f64;
    snprintf(source, sizeof source,
             "[Extent(-1.0, -1.0, 1.0, 1.0)] param heightfield h = zeros(256, 256);\n"
             "param float3 eye = float3(0.0, -2.4, 1.6);\n"
             "param float3 sun = float3(0.7, -0.3, 0.5);\n"
             "[Domain(-1.0, 1.0)]\n"
             "shader float main(float2 x) {\n"
             "    float3 f = normalize(float3(0.0, 1.0, -0.62)), r = float3(1.0, 0.0, 0.0), u = cross(r, f);\n"
             "    float3 d = f + 0.42 * (x.x * r + x.y * u);\n"
             "    [Disc] Hit v = h.trace(eye, d, 0.0, 50.0);\n"
             "    if (!v.hit) return 0.1;\n"
             "    float3 p = float3(v.p, eye.z + v.t * d.z) + 0.001 * v.normal;\n"
             "    float l = max(dot(v.normal, normalize(sun)), 0.0);\n"
             "    %s\n"
             "    return 0.8 * (0.2 + l);\n"
             "}\n",
             shadow);
    if (slt_compile_string(source, "dropped", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
    double *v = malloc(sizeof *v * N * N);
    for (uint32_t i = 0; i < N * N; i++)
        v[i] = 0.03 * ((i * 2654435761u ^ (i >> 8) * 2246822519u) * 3266489917u >> 8) / 16777216.0;
    slt_param_find(p, "h", &q, NULL);
    slt_set_floats(p, q.fbase, N * N, v, NULL);
    free(v);
    return p;
}

static void test_steps(void **state) {
    (void)state;
    static float ones[SIZE * SIZE];
    for (int i = 0; i < SIZE * SIZE; i++) ones[i] = 1.0f / (SIZE * SIZE);
    for (size_t k = 0; k < sizeof shadow_by / sizeof *shadow_by; k++) {
        SltProgram *p = load(shadow_by[k], k == 1);
        for (int image = 0; image < 2; image++) {
            SltJob j = SLT_JOB_INIT;
            SltStats s = SLT_STATS_INIT;
            SltError err;
            double value, *g = malloc(sizeof *g * slt_float_count(p));
            SltIntegral out = {.struct_size = sizeof out, .value = &value, .gradient = g};
            j.threads = 2, j.seed = 3, j.size[0] = j.size[1] = SIZE, j.spp = 1, j.samples = 1 << 16,
            j.segments = image ? 0 : 1 << 17;
            j.integral = !image;
            if ((image ? slt_grad_adjoint(p, &j, ones, g, NULL, &s, &err) : slt_grad_integral(p, &j, &out, &s, &err)) !=
                SLT_OK)
                fail_msg("%s", err.text);
            uint64_t dropped = 0;
            for (int d = 0; d < SLT_DROP_REASONS; d++) dropped += d == SLT_DROP_COINCIDENT ? 0 : s.dropped[d];
            print_message("%s, %s: %llu of %llu\n", shadow_by[k], image ? "image" : "integral",
                          (unsigned long long)dropped, (unsigned long long)s.crossings);
            assert_true(s.crossings > 1000 && dropped * 100 <= s.crossings);
            free(g);
        }
        slt_program_free(p);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_steps)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
