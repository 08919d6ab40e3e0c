/* noise.salt: smooth where it says so, also across its cells; no sites but voronoi's; the promised
 * ranges; worley against every point there is. */
#include "tests/stdlib/fixture.h"

typedef struct Field {
    const char *call; /* of float3 p */
    int dim;
    double lo, hi;
    bool smooth; /* C2; else C0 with kinks */
} Field;

static const Field fields[] = {
    {"value_noise(p.xy)", 2, 0, 1, true},     {"value_noise(p)", 3, 0, 1, true},
    {"gradient_noise(p.xy)", 2, -1, 1, true}, {"gradient_noise(p)", 3, -1, 1, true},
    {"fbm(p.xy, 4)", 2, -2, 2, true},         {"fbm(p, 3)", 3, -2, 2, true},
    {"fbm(p.xy, 3, 0.7)", 2, -3, 3, true},    {"turbulence(p.xy, 4)", 2, 0, 2, false},
    {"ridged(p.xy, 4)", 2, 0, 2, false},      {"worley(p.xy).x", 2, 0, 1.4143, false},
    {"worley(p.xy).y", 2, 0, 2, false},       {"voronoi(p.xy).x", 2, 0, 1.4143, false},
};

static double at(SltProgram *p, const double *x, double *g) {
    double v, all[8];
    set(p, "p", x);
    evaluate(p, &v, all);
    if (g) memcpy(g, all, 3 * sizeof *g);
    return v;
}

static void test_fields(void **state) {
    (void)state;
    for (size_t k = 0; k < sizeof fields / sizeof *fields; k++) {
        const Field *f = &fields[k];
        char source[512];
        snprintf(source, sizeof source,
                 "import noise;\nparam float3 p = float3(0.0);\nshader float main(float2 x) { "
                 "return %s; }\n",
                 f->call);
        SltProgram *p = compile(source, NULL);
        uint32_t seed = 3;
        double sum = 0, square = 0;
        for (int i = 0; i < 250; i++) {
            double x[3], y[3], g[3], h[3];
            for (int a = 0; a < 3; a++) x[a] = 12 * uniform(&seed) - 6;
            /* Every other point lies on a border of a cell. */
            if (i & 1) x[i / 2 % f->dim] = round(x[i / 2 % f->dim]);
            double v = at(p, x, g);
            sum += v, square += v * v;
            if (!(v >= f->lo && v <= f->hi)) fail_msg("%s = %.9g at (%.9g, %.9g, %.9g)", f->call, v, x[0], x[1], x[2]);
            for (int a = 0; a < f->dim; a++) {
                memcpy(y, x, sizeof y);
                y[a] = x[a] + 1e-6;
                double up = at(p, y, h);
                y[a] = x[a] - 1e-6;
                double down = at(p, y, NULL);
                if (fabs(up - v) > 1e-4 || fabs(down - v) > 1e-4)
                    fail_msg("%s jumps at (%.9g, %.9g, %.9g)", f->call, x[0], x[1], x[2]);
                bool kink = !f->smooth && fabs(up + down - 2 * v) > 1e-9;
                double fd = (up - down) / 2e-6;
                if (!kink && fabs(fd - g[a]) > 2e-4)
                    fail_msg("%s: d/dx[%d] = %.9g, differences %.9g at (%.9g, %.9g, %.9g)", f->call, a, g[a], fd, x[0],
                             x[1], x[2]);
                if (f->smooth && fabs(h[a] - g[a]) > 1e-3)
                    fail_msg("%s: the derivative jumps at (%.9g, %.9g, %.9g)", f->call, x[0], x[1], x[2]);
            }
        }
        /* Not a constant in disguise. */
        assert_true(square / 250 - sum / 250 * (sum / 250) > 0.003);
        slt_program_free(p);
    }
}

/* Second derivatives: differences of the derivative agree across a cell's border. */
static void test_second_derivative(void **state) {
    (void)state;
    const char *calls[] = {"value_noise(p.xy)", "gradient_noise(p.xy)", "gradient_noise(p)"};
    for (int k = 0; k < 3; k++) {
        char source[512];
        snprintf(source, sizeof source,
                 "import noise;\nparam float3 p = float3(0.0);\nshader float main(float2 x) { "
                 "return %s; }\n",
                 calls[k]);
        SltProgram *p = compile(source, NULL);
        uint32_t seed = 8;
        for (int i = 0; i < 40; i++) {
            double x[3] = {floor(20 * uniform(&seed)) - 10, 9 * uniform(&seed), 5 * uniform(&seed)}, y[3], g0[3],
                   right[3], left[3];
            memcpy(y, x, sizeof y);
            at(p, y, g0);
            y[0] = x[0] + 1e-5, at(p, y, right);
            y[0] = x[0] - 1e-5, at(p, y, left);
            assert_true(fabs((right[0] - g0[0]) - (g0[0] - left[0])) / 1e-5 < 0.02);
        }
        slt_program_free(p);
    }
}

static void test_octaves(void **state) {
    (void)state;
    SltProgram *p = compile("import noise;\nparam float2 p = float2(0.0);\n"
                            "shader float3 main(float2 x) { return float3(fbm(p, 1) - gradient_noise(p), fbm(p, 0), "
                            "fbm(p, 2) - gradient_noise(p) - 0.5 * gradient_noise(2.0 * p + float2(17.31, 9.73))); }\n",
                            NULL);
    double x[2] = {0.37, 2.81}, v[3], g[6];
    set(p, "p", x);
    evaluate(p, v, g);
    for (int k = 0; k < 3; k++) assert_true(fabs(v[k]) < 1e-12);
    slt_program_free(p);
}

/* In shaders where x and parameters meet: no warning (compile checks that), and no more sites than
 * the shader's own. */
static void test_no_warnings(void **state) {
    (void)state;
    const char *bodies[] = {
        "import bezier;\nparam float2 c[4] = { float2(0.1), float2(0.9, 0.2), float2(0.3, 0.8), "
        "float2(0.7) };\nshader float main(float2 x) { float f = 0.0; [Disc] if (sd_stroke(x, "
        "c[0], c[1], c[2], c[3], 0.1) < "
        "0.0) f = 1.0; return f; }",
        "import bezier;\nparam float2 c[3] = { float2(0.1), float2(0.9, 0.2), float2(0.3, 0.8) "
        "};\nshader float main(float2 x) { float f = 0.0; [Disc] if (sd_stroke_tapered(x, c[0], "
        "c[1], c[2], 0.1, 0.2) < 0.0) f "
        "= 1.0; return f; }",
        "import color;\nparam float s = 1.1;\nshader float3 main(float2 x) { float3 c = float3(s * "
        "x, s * x.x * x.y); return blend_overlay(hsv_to_rgb(c), "
        "srgb_to_linear(linear_to_srgb(c))); }",
        "import noise;\nparam float s = 1.1;\nshader float main(float2 x) { return fbm(s * x, 3) + "
        "fbm(float3(s * x, s), 2) + ridged(s * x, 3) + turbulence(s * x, 3) + value_noise(s * x); "
        "}",
    };
    for (int k = 0; k < 4; k++) {
        SltProgram *p = compile(bodies[k], NULL);
        assert_int_equal(slt_site_count(p), k < 2 ? 1 : 0);
        slt_program_free(p);
    }
}

/* Only voronoi's identity is a site, where it is asked for; its mean over many cells is that of a uniform number, and
 * it moves with p. */
static void test_sites(void **state) {
    (void)state;
    SltProgram *p = compile("import noise;\nparam float2 shift = float2(0.3, 0.1);\nshader float main(float2 "
                            "x) { return fbm(8.0 * x + shift, 4) + worley(8.0 * x + shift).x; }\n",
                            NULL);
    assert_int_equal(slt_site_count(p), 0);
    slt_program_free(p);
    p = compile("import noise;\nparam float2 shift = float2(0.3, 0.1);\n[Domain(0.0, 16.0)] shader "
                "float main(float2 x) { [Disc] return voronoi(x + shift).y; }\n",
                NULL);
    assert_true(slt_site_count(p) > 0);
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    double value, g[2], se[2], up, down, step = 0.02;
    SltIntegral out = {.struct_size = sizeof out, .value = &value, .gradient = g, .gradient_stderr = se},
                only = {.struct_size = sizeof only, .value = &up};
    job.integral = true, job.samples = 1 << 16, job.threads = 1;
    assert_int_equal(slt_grad_integral(p, &job, &out, NULL, &err), SLT_OK);
    assert_true(fabs(value / 256 - 0.5) < 0.08);
    /* Moving the field by one moves the picture: the derivative is what enters less what leaves. */
    double moved[2] = {0.3 + step, 0.1};
    set(p, "shift", moved);
    assert_int_equal(slt_grad_integral(p, &job, &only, NULL, &err), SLT_OK);
    moved[0] = 0.3 - step;
    set(p, "shift", moved);
    only.value = &down;
    assert_int_equal(slt_grad_integral(p, &job, &only, NULL, &err), SLT_OK);
    double fd = (up - down) / (2 * step);
    if (fabs(fd - g[0]) > 6 * se[0] + 0.25) fail_msg("derivative %.6g +- %.2g, differences %.6g", g[0], se[0], fd);
    assert_true(fabs(g[0]) > 1e-3);
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fields),  cmocka_unit_test(test_second_derivative),
        cmocka_unit_test(test_octaves), cmocka_unit_test(test_no_warnings),
        cmocka_unit_test(test_sites),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
