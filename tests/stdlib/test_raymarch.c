/* raymarch.salt: boxes, roots and normals of fields with closed forms, a homogeneous medium, the phase function. */
#include "tests/stdlib/table.h"

static double slab(const double *v, bool far) {
    double lo = -INFINITY, hi = INFINITY;
    for (int a = 0; a < 3; a++) {
        double o = 2 * v[a], d = v[3 + a], p = (-0.5 - o) / d, q = (0.75 - o) / d;
        lo = fmax(lo, fmin(p, q)), hi = fmin(hi, fmax(p, q));
    }
    return far ? hi : lo;
}
static double near_side(const double *v) { return slab(v, false); }
static double far_side(const double *v) { return slab(v, true); }
static double crossing(const double *v) { return v[0] + (v[1] - v[0]) * v[2] / (v[2] + v[3] + 2); }
static double gradient(const double *v) { return v[0] + 2 * v[1] + 3 * v[2]; }
static double normal(const double *v) { return v[0] / len3(v3(v)); }
static double epsilon(const double *v) { return 2 * v[0] * tan(0.4) * 0.5 / 240; }
static double penumbra(const double *v) { return fmin(v[0], fmin(1, fmax(0, 8 * v[1] / v[2]))); }
static double occlusion(const double *v) { return v[0] + 0.125 * (3 * v[2] - v[1]); }
static double henyey(const double *v) {
    double g = 0.7 * v[0], k = 1 + g * g - 2 * g * v[1];
    return (1 - g * g) / (4 * M_PI * pow(k, 1.5));
}
/* Two layers before a background. */
static double medium(const double *v) {
    double a = exp(-v[0] * v[1]), b = exp(-v[2] * v[3]);
    return (1 - a) * v[4] + a * (1 - b) * v[5] + a * b * v[6];
}

static const Case cases[] = {
    {.body = "float far; float near = march_box(2.0 * " VEC3(0) ", " VEC3(3) ", float3(-0.5), float3(0.75), far); "
                                                                             "return near;",
     .want = near_side},
    {.body = "float far; float near = march_box(2.0 * " VEC3(0) ", " VEC3(3) ", float3(-0.5), float3(0.75), far); "
                                                                             "return far;",
     .want = far_side},
    {.body = "march_crossing(v[0], v[2], v[1], -v[3] - 2.0)", .want = crossing, .lo = 0.1, .hi = 1},
    {.body = "float h[4]; for (int i = 0; i < 4; i++) h[i] = dot(" VEC3(
         0) ", float3(0.3) + march_offset(i, 0.1)); "
            "return dot(march_gradient(h[0], h[1], h[2], h[3], 0.1), float3(1.0, 2.0, 3.0));",
     .want = gradient},
    {.body =
         "float h[4]; for (int i = 0; i < 4; i++) h[i] = dot(" VEC3(0) ", float3(0.3) + march_offset(i, 0.1)); "
                                                                       "return march_normal(h[0], h[1], h[2], h[3]).x;",
     .want = normal,
     .lo = 0.2,
     .hi = 1},
    {.body = "march_epsilon(v[0], 0.5, 0.8, 240.0)", .want = epsilon},
    {.body = "march_penumbra(v[0], v[1], v[2], 8.0)", .want = penumbra, .lo = 0.1, .hi = 2},
    {.body = "march_occlusion(v[0], 3, v[1], v[2])", .want = occlusion},
    {.body = "phase_henyey(v[1], 0.7 * v[0])", .want = henyey},
    {.body = "Medium m = medium_step(medium_step(medium_begin(), v[0], float3(v[4]), v[1]), v[2], float3(v[5]), v[3]); "
             "return medium_over(m, float3(v[6])).y;",
     .want = medium,
     .lo = 0.1,
     .hi = 2},
};

static void test_closed_forms(void **state) {
    (void)state;
    TABLE_RUN("raymarch", cases);
}

/* A ray that runs along a face of the box: within the slab it never leaves it. */
static void test_along_a_face(void **state) {
    (void)state;
    SltProgram *p = compile("import raymarch;\nparam float3 o = float3(0.0);\nparam float3 d = float3(1.0, 0.0, 0.0);\n"
                            "shader float2 main(float2 x) { float far; float t = march_box(o, d, float3(-1.0), "
                            "float3(1.0), far); return float2(t, far); }\n",
                            NULL);
    double v[2], g[12];
    evaluate(p, v, g);
    assert_true(fabs(v[0] + 1) < 1e-12 && fabs(v[1] - 1) < 1e-12);
    for (int i = 0; i < 12; i++) assert_true(isfinite(g[i]));
    double out[3] = {0, 2, 0};
    set(p, "o", out);
    evaluate(p, v, g);
    assert_true(v[0] > v[1]);
    slt_program_free(p);
}

/* A march to a ball: where it ends, refined, has the root's value and derivative, steps or not. */
static void test_march_to_a_ball(void **state) {
    (void)state;
    SltProgram *p = compile("import raymarch;\nparam float r = 0.6;\nparam float3 o = float3(0.1, 0.2, -3.0);\n"
                            "float field(float3 q) { return length(q) - r; }\n"
                            "shader float main(float2 x) {\n"
                            "    float3 d = float3(0.0, 0.0, 1.0); float t = 0.0;\n"
                            "    for (int i = 0; i < 60; i++) { float h = field(o + t * d); [NoDisc] if (h < 1e-4) "
                            "break; t += h; }\n"
                            "    float3 q = o + detach(t) * d; float h[4];\n"
                            "    for (int i = 0; i < 4; i++) h[i] = field(q + march_offset(i, 1e-4));\n"
                            "    float3 n = march_normal(h[0], h[1], h[2], h[3]);\n"
                            "    return march_root(t, field(q), dot(n, d)); }\n",
                            NULL);
    double v, g[4], far = sqrt(0.36 - 0.05);
    evaluate(p, &v, g);
    assert_true(fabs(v - (3 - far)) < 1e-6);
    uint32_t r = base_of(p, "r"), o = base_of(p, "o");
    double want[4];
    want[r] = -0.6 / far, want[o] = 0.1 / far, want[o + 1] = 0.2 / far, want[o + 2] = -1;
    for (int i = 0; i < 4; i++)
        if (fabs(g[i] - want[i]) > 1e-3) fail_msg("derivative %d is %.9g, wanted %.9g", i, g[i], want[i]);
    slt_program_free(p);
}

/* The phase function's integral over the sphere is 1, its mean cosine g. */
static void test_phase(void **state) {
    (void)state;
    SltProgram *p = compile("import raymarch;\nparam float g = 0.6;\n[Domain(-1.0, 1.0)] shader float2 main(float c) { "
                            "float f = TAU * phase_henyey(c, g); return float2(f, f * c); }\n",
                            NULL);
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    double v[2], se[2];
    SltIntegral out = {.struct_size = sizeof out, .value = v, .value_stderr = se};
    job.integral = true, job.samples = 1 << 16, job.threads = 1;
    assert_int_equal(slt_grad_integral(p, &job, &out, NULL, &err), SLT_OK);
    assert_true(fabs(v[0] - 1) < 6 * se[0] + 1e-4 && fabs(v[1] - 0.6) < 6 * se[1] + 1e-4);
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_closed_forms),
        cmocka_unit_test(test_along_a_face),
        cmocka_unit_test(test_march_to_a_ball),
        cmocka_unit_test(test_phase),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
