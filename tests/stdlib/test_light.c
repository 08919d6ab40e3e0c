/* camera.salt and brdf.salt: frames are orthonormal, projection inverts rays, a ball's outline has
 * the derivative of its closed form, the microfacet density is one, reflection is symmetric and
 * loses energy. */
#include "tests/stdlib/fixture.h"

static void test_camera(void **state) {
    (void)state;
    SltProgram *p = compile("import camera;\nparam float3 eye = float3(0.0);\nparam float3 to = float3(0.0);\n"
                            "param float2 at = float2(0.0);\n"
                            "shader float4 main(float2 x) {\n"
                            "    Camera c = look_at(eye, to, float3(0.0, 1.0, 0.0));\n"
                            "    float3 d = camera_ray(c, at, 0.9);\n"
                            "    float3 q = camera_project(c, eye + 3.0 * d, 0.9);\n"
                            "    float3x3 m = float3x3(c.right, c.up, c.forward);\n"
                            "    float off = 0.0;\n"
                            "    float3x3 one = m * transpose(m);\n"
                            "    for (int i = 0; i < 3; i++) for (int j = 0; j < 3; j++) off += abs(one[i][j] "
                            "- (i == j ? 1.0 : 0.0));\n"
                            "    return float4(q.xy, length(d), off + 1.0 - dot(cross(c.right, c.up), "
                            "-c.forward));\n}\n",
                            NULL);
    uint32_t seed = 2;
    for (int i = 0; i < 40; i++) {
        double eye[3], to[3], at[2], v[4], g[32];
        for (int a = 0; a < 3; a++) eye[a] = 4 * uniform(&seed) - 2, to[a] = 4 * uniform(&seed) - 2;
        at[0] = 2 * uniform(&seed) - 1, at[1] = 2 * uniform(&seed) - 1;
        set(p, "eye", eye), set(p, "to", to), set(p, "at", at);
        evaluate(p, v, g);
        assert_true(fabs(v[0] - at[0]) < 1e-9 && fabs(v[1] - at[1]) < 1e-9);
        assert_true(fabs(v[2] - 1) < 1e-12 && fabs(v[3]) < 1e-9);
    }
    slt_program_free(p);
}

/* A ball of radius r at distance z is seen as a disc of radius r / sqrt(z^2 - r^2) at tan(fov / 2)
 * = 1. */
static void test_ball(void **state) {
    (void)state;
    SltProgram *p = compile("import camera;\nparam float r = 0.8;\n[Domain(-1.0, 1.0)] shader float main(float2 x) {\n"
                            "    Camera c = look_at(float3(0.0, 0.0, 2.0), float3(0.0), float3(0.0, 1.0, 0.0));\n"
                            "    float s, f = 0.0;\n"
                            "    float t = ray_sphere(c.eye, camera_ray(c, x, 0.5 * PI), float3(0.0), r, s);\n"
                            "    [Disc] if (s > 0.0 && t > 0.0) f = 1.0;\n    return f;\n}\n",
                            NULL);
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    double value, g, se;
    SltIntegral out = {.struct_size = sizeof out, .value = &value, .gradient = &g, .gradient_stderr = &se};
    job.integral = true, job.samples = 1 << 16, job.threads = 1;
    assert_int_equal(slt_grad_integral(p, &job, &out, NULL, &err), SLT_OK);
    double k = 4 - 0.64, area = M_PI * 0.64 / k, slope = M_PI * 2 * 0.8 * 4 / (k * k);
    if (fabs(value - area) > 3e-3) fail_msg("area %.9g, wanted %.9g", value, area);
    if (fabs(g - slope) > 6 * se + 4e-3 * slope) fail_msg("%.9g +- %.2g, wanted %.9g", g, se, slope);
    slt_program_free(p);
}

static void integrate(const char *source, double *value) {
    SltProgram *p = compile(source, NULL);
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    double g[64];
    SltIntegral out = {.struct_size = sizeof out, .value = value, .gradient = g};
    job.integral = true, job.samples = 1 << 16, job.threads = 1;
    assert_int_equal(slt_grad_integral(p, &job, &out, NULL, &err), SLT_OK);
    slt_program_free(p);
}

static void test_brdf(void **state) {
    (void)state;
    double v[4];
    /* Over the hemisphere in (angle from the normal, azimuth), the sine included. */
    integrate("import brdf;\n[Domain(float2(0.0, 0.0), float2(0.5 * PI, TAU))] shader float3 "
              "main(float2 x) {\n"
              "    float c = cos(x.x), s = sin(x.x);\n"
              "    return c * s * float3(ggx_density(c, 0.25), ggx_density(c, 0.7), "
              "lambert(float3(1.0)).x);\n}\n",
              v);
    for (int k = 0; k < 3; k++)
        if (fabs(v[k] - 1) > 2e-3) fail_msg("normalisation %d: %.9g", k, v[k]);
    /* A white mirror in a white furnace: less than 1, by what single scattering loses. The numbers
       are the midpoint rule's, 400 x 400, computed apart. */
    integrate("import brdf;\n[Domain(float2(0.0, 0.0), float2(0.5 * PI, TAU))] shader float2 "
              "main(float2 x) {\n"
              "    float3 l = float3(sin(x.x) * cos(x.y), sin(x.x) * sin(x.y), cos(x.x)), n = "
              "float3(0.0, 0.0, 1.0);\n"
              "    float3 v = normalize(float3(0.6, 0.0, 0.8));\n"
              "    float w = l.z * sin(x.x);\n"
              "    return w * float2(ggx(n, v, l, float3(1.0), 0.9).x, ggx(n, v, l, float3(1.0), "
              "0.4).x);\n}\n",
              v);
    if (fabs(v[0] - 0.454116) > 1e-3 || fabs(v[1] - 0.958073) > 1e-3) fail_msg("%.9g %.9g", v[0], v[1]);
    integrate("import brdf;\nshader float2 main(float2 x) {\n"
              "    float3 n = float3(0.0, 0.0, 1.0), a = normalize(float3(x, 0.4)), b = "
              "normalize(float3(-0.3, x.y, 0.7));\n"
              "    float3 f = float3(0.04, 0.5, 0.9), d = ggx(n, a, b, f, 0.5) - ggx(n, b, a, f, 0.5);\n"
              "    float3 e = fresnel_schlick(f, 0.0) - 1.0 + fresnel_schlick(f, 1.0) - f;\n"
              "    return float2(dot(d, d), dot(e, e));\n}\n",
              v);
    assert_true(v[0] < 1e-20 && v[1] < 1e-20);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_camera),
        cmocka_unit_test(test_ball),
        cmocka_unit_test(test_brdf),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
