/* color.salt and glsl.salt against the same formulas in C. */
#include "tests/stdlib/fixture.h"

static double to_linear(double c) { return c <= 0.04045 ? c / 12.92 : pow((c + 0.055) / 1.055, 2.4); }

static void hsv(const double *h, double *rgb) {
    double n[3] = {5, 3, 1};
    for (int i = 0; i < 3; i++) {
        double k = fmod(n[i] + 6 * (h[0] - floor(h[0])), 6);
        rgb[i] = h[2] - h[2] * h[1] * fmax(0, fmin(fmin(k, 4 - k), 1));
    }
}

static SltProgram *colour(const char *expression) {
    char source[512];
    snprintf(source, sizeof source,
             "import color;\nparam float3 c = float3(0.0);\nparam float3 d = float3(0.25, 0.5, "
             "0.75);\nshader float3 main(float2 x) { return %s; }\n",
             expression);
    return compile(source, NULL);
}

static void get(SltProgram *p, const double *c, double *v) {
    double g[32];
    set(p, "c", c);
    evaluate(p, v, g);
}

static void test_round_trips(void **state) {
    (void)state;
    const char *back[] = {"linear_to_srgb(srgb_to_linear(c))", "srgb_to_linear(linear_to_srgb(c))",
                          "hsv_to_rgb(rgb_to_hsv(c))", "oklab_to_linear(linear_to_oklab(c))"};
    for (int k = 0; k < 4; k++) {
        SltProgram *p = colour(back[k]);
        uint32_t seed = 4;
        for (int i = 0; i < 100; i++) {
            double c[3] = {uniform(&seed), uniform(&seed), uniform(&seed)}, v[3];
            if (i % 10 == 0) c[1] = c[0], c[2] = i % 20 ? c[0] : 0;
            get(p, c, v);
            for (int a = 0; a < 3; a++)
                if (fabs(v[a] - c[a]) > (k == 3 ? 1e-6 : 1e-7)) fail_msg("%s: %.9g became %.9g", back[k], c[a], v[a]);
        }
        slt_program_free(p);
    }
}

static void test_values(void **state) {
    (void)state;
    SltProgram *lin = colour("srgb_to_linear(c)"), *rgb = colour("hsv_to_rgb(c)"), *grey = colour("linear_to_oklab(c)");
    uint32_t seed = 9;
    for (int i = 0; i < 60; i++) {
        double c[3] = {1.5 * uniform(&seed) - 0.25, uniform(&seed), uniform(&seed)}, v[3], want[3];
        get(lin, c, v);
        for (int a = 0; a < 3; a++) assert_true(fabs(v[a] - to_linear(c[a])) < 1e-12);
        get(rgb, c, v);
        hsv(c, want);
        for (int a = 0; a < 3; a++) assert_true(fabs(v[a] - want[a]) < 1e-12);
        c[1] = c[2] = c[0] = fabs(c[0]);
        get(grey, c, v);
        assert_true(fabs(v[0] - cbrt(c[0])) < 1e-6 && fabs(v[1]) < 1e-6 && fabs(v[2]) < 1e-6);
    }
    slt_program_free(lin);
    slt_program_free(rgb);
    slt_program_free(grey);
}

/* Continuous: a step of 1e-7 anywhere, also on the seams, moves the result by little; and the
 * derivative is its slope. */
static void test_continuity(void **state) {
    (void)state;
    const char *list[] = {
        "srgb_to_linear(c)",          "linear_to_srgb(c)",   "hsv_to_rgb(c)",
        "linear_to_oklab(c + 0.01)",  "palette(c.x)",        "heat(c.x)",
        "diverging(2.0 * c.x - 1.0)", "over(c, d, c.x)",     "over(float4(c, 0.5), float4(d, 0.25)).xyz",
        "blend_multiply(c, d)",       "blend_screen(c, d)",  "blend_add(c, d)",
        "blend_darken(c, d)",         "blend_lighten(c, d)", "blend_difference(c, d)",
        "blend_exclusion(c, d)",      "blend_overlay(c, d)", "blend_soft_light(c, d)",
        "tonemap_reinhard(c)",        "tonemap_exp(c, 1.3)", "float3(luminance(c))"};
    const double seams[] = {0.04045, 0.0031308, 1.0 / 6, 1.0 / 3, 0.5, 2.0 / 3, 0.25, 0.75, 5.0 / 6};
    for (size_t k = 0; k < sizeof list / sizeof *list; k++) {
        SltProgram *p = colour(list[k]);
        uint32_t seed = 12;
        for (int i = 0; i < 60; i++) {
            double c[3], v[3], up[3], down[3], g[18], ignored[18];
            for (int a = 0; a < 3; a++) c[a] = i % 3 == a ? seams[i / 3 % 9] : uniform(&seed);
            set(p, "c", c), evaluate(p, v, g);
            for (int a = 0; a < 3; a++) {
                double q[3] = {c[0], c[1], c[2]};
                q[a] = c[a] + 1e-6, set(p, "c", q), evaluate(p, up, ignored);
                q[a] = c[a] - 1e-6, set(p, "c", q), evaluate(p, down, ignored);
                for (int o = 0; o < 3; o++) {
                    double fd = (up[o] - down[o]) / 2e-6;
                    if (fabs(up[o] - v[o]) > 3e-5 || fabs(down[o] - v[o]) > 3e-5)
                        fail_msg("%s jumps at (%.9g, %.9g, %.9g)", list[k], c[0], c[1], c[2]);
                    if (fabs(up[o] + down[o] - 2 * v[o]) < 1e-9 && fabs(fd - g[o * 6 + a]) > 1e-3)
                        fail_msg("%s: derivative %.9g, differences %.9g", list[k], g[o * 6 + a], fd);
                }
            }
        }
        slt_program_free(p);
    }
}

static void test_glsl(void **state) {
    (void)state;
    const char *entries[] = {"a", "b", "c", "d"};
    for (int e = 0; e < 4; e++) {
        SltProgram *p = compile("import glsl;\nparam vec2 p = vec2(0.5, 0.25);\n"
                                "float pack(bvec3 b) { return (b.x ? 1.0 : 0.0) + (b.y ? 2.0 : 0.0) + (b.z ? "
                                "4.0 : 0.0); }\n"
                                "shader vec4 a(vec2 x) { return vec4(mod(p.x, p.y), fract(p.x), atan(p.y, "
                                "p.x), atan(p.x)); }\n"
                                "shader vec4 b(vec2 x) { return vec4(mix(p, vec2(1.0, 2.0), 0.25), "
                                "inversesqrt(abs(p.x)), mod(vec2(p.x, -p.x), 0.7).y); }\n"
                                "shader vec4 c(vec2 x) { mat2 m = outerProduct(p, vec2(1.0, -1.0)); return "
                                "vec4(m * vec2(2.0, 1.0), degrees(p.x), asinh(p.x)); }\n"
                                "shader float d(vec2 x) { return pack(lessThan(vec3(p, 0.5), vec3(0.0, 0.5, "
                                "1.0))); }\n",
                                entries[e]);
        uint32_t seed = 31;
        for (int i = 0; i < 40; i++) {
            double q[2] = {4 * uniform(&seed) - 2, 4 * uniform(&seed) - 2}, v[4], g[8], want[4] = {0};
            int n = e == 3 ? 1 : 4;
            set(p, "p", q), evaluate(p, v, g);
            if (e == 0)
                want[0] = q[0] - q[1] * floor(q[0] / q[1]), want[1] = q[0] - floor(q[0]), want[2] = atan2(q[1], q[0]),
                want[3] = atan(q[0]);
            if (e == 1)
                want[0] = 0.75 * q[0] + 0.25, want[1] = 0.75 * q[1] + 0.5, want[2] = 1 / sqrt(fabs(q[0])),
                want[3] = -q[0] - 0.7 * floor(-q[0] / 0.7);
            if (e == 2) want[0] = q[0], want[1] = q[1], want[2] = q[0] * 180 / M_PI, want[3] = asinh(q[0]);
            if (e == 3) want[0] = (q[0] < 0) + 2 * (q[1] < 0.5) + 4;
            for (int k = 0; k < n; k++)
                if (fabs(v[k] - want[k]) > 1e-11 * (1 + fabs(want[k])))
                    fail_msg("%s[%d] = %.17g, wanted %.17g at (%.9g, %.9g)", entries[e], k, v[k], want[k], q[0], q[1]);
        }
        slt_program_free(p);
    }
}

/* A saw tooth, tagged where mod is called: its wrap moves with the phase, and the derivative says so. */
static void test_glsl_mod_is_a_site(void **state) {
    (void)state;
    SltProgram *p = compile("import glsl;\nparam float phase = 0.13;\nshader float main(vec2 x) { "
                            "[Disc] return mod(3.3 * x.x + phase, 1.0); }\n",
                            NULL);
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    double v, g, interior;
    SltIntegral out = {.struct_size = sizeof out, .value = &v, .gradient = &g, .interior = &interior};
    job.integral = true, job.samples = 1 << 14, job.threads = 1;
    assert_int_equal(slt_grad_integral(p, &job, &out, NULL, &err), SLT_OK);
    /* The integral over [0, 1] of frac(3.3 x + b): d/db = (frac(3.3 + b) - frac(b)) / 3.3. */
    double want = (3.43 - 3 - 0.13) / 3.3;
    assert_true(fabs(interior - 1) < 1e-3);
    if (fabs(g - want) > 2e-3) fail_msg("%.9g, wanted %.9g", g, want);
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_round_trips),        cmocka_unit_test(test_values),
        cmocka_unit_test(test_continuity),         cmocka_unit_test(test_glsl),
        cmocka_unit_test(test_glsl_mod_is_a_site),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
