/* pathtrace.salt: the white furnace, irradiance in closed form, and on bumps the same light and the same derivatives as
 * by slices (heightfield.salt), which share nothing with it but the queries. */
#include "tests/stdlib/fixture.h"

typedef struct Mean {
    double value, se, g[512], gse[512];
} Mean;

static Mean mean(SltProgram *p, uint32_t samples, uint32_t seed) {
    Mean m = {0};
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    SltIntegral out = {
        .struct_size = sizeof out, .value = &m.value, .value_stderr = &m.se, .gradient = m.g, .gradient_stderr = m.gse};
    job.integral = true, job.samples = samples, job.threads = 1, job.seed = seed;
    assert_true(slt_float_count(p) <= sizeof m.g / sizeof *m.g);
    if (slt_grad_integral(p, &job, &out, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
    return m;
}

static void near_to(const char *what, double a, double b, double tolerance) {
    if (!(fabs(a - b) <= tolerance)) fail_msg("%s: %.9g, wanted %.9g +- %.2g", what, a, b, tolerance);
}

#define SCENE                                                                                                                  \
    "import pathtrace;\nimport heightfield;\nimport camera;\nimport brdf;\n"                                                   \
    "param heightfield h = zeros(13, 13);\nparam float albedo = 0.6;\nparam float elevation = 0.9;\nparam float eye_x = 0.45;\n" \
    "param float sky = 0.0;\nparam float sunlight = 0.0;\n"

static void set_bumps(SltProgram *p, double tall) {
    double v[13 * 13];
    for (int j = 0; j < 13; j++)
        for (int i = 0; i < 13; i++) {
            double x = i / 12.0, y = j / 12.0, edge = fmin(fmin(x, 1 - x), fmin(y, 1 - y));
            v[j * 13 + i] = tall * (0.5 + 0.5 * sin(9 * x + 1) * sin(8 * y + 0.4)) * fmin(1, 6 * edge);
        }
    set(p, "h", v);
}

#define PATH                                                                                                                   \
    "    float3 eye = float3(eye_x, 0.2, 1.1), d = normalize(float3(0.35 * x.x + 0.05, 0.35 * x.y + 0.3, -1.0));\n"            \
    "    Sun s = { float3(cos(elevation) * 0.6, cos(elevation) * 0.8, sin(elevation)), float3(sunlight), 0.1 };\n"

/* All that a white ground under a white sky sends back is white. */
static void test_furnace(void **state) {
    (void)state;
    double one = 1, zero = 0, some = 0.6;
    for (int way = 0; way < 2; way++) {
        SltProgram *p = compile(
            way ? SCENE
                "[Domain(-1.0, 1.0)] shader float main(float2 x) {\n" PATH
                "    AreaLight l = area_sun(s.to, s.irradiance, s.radius);\n    Ride r = { d, 1.0 };\n"
                "    return slice_radiance(h, float3(albedo), l, float3(sky), float3(sky), eye, r, 1e-5, 0.1, 12).x / 4.0;\n}\n"
                : SCENE
                "[Domain(-1.0, 1.0)] shader float main(float2 x) {\n" PATH
                "    return path_radiance(h, float3(albedo), s, float3(sky), float3(sky), eye, d, 12).x / 4.0;\n}\n",
            NULL);
        set(p, "sky", &one), set(p, "albedo", &some);
        Mean m = mean(p, 1 << 12, 1);
        near_to("flat", m.value, 0.6, 6 * m.se + 1e-4);
        near_to("flat, slope", m.g[base_of(p, "albedo")], 1, 6 * m.gse[base_of(p, "albedo")] + 1e-3);
        set(p, "albedo", &one);
        set_bumps(p, 0.2);
        m = mean(p, 1 << 12, 1);
        near_to("bumps", m.value, 1, 6 * m.se + 2e-3);
        set_bumps(p, 0);
        set(p, "sky", &zero), set(p, "sunlight", (double[]){2});
        m = mean(p, 1 << 12, 1);
        near_to("sun", m.value, 2 * sin(0.9) / M_PI, 4e-3);
        slt_program_free(p);
    }
}

/* A point and a rectangle over a flat ground; a coated ground gives back less than it gets (about 0.8 of it: what
 * passes the coat does so twice). */
static void test_lights(void **state) {
    (void)state;
    SltProgram *p = compile(
        SCENE
        "shader float main(float2 x) {\n    float3 q = float3(0.5 + 1e-6 * x.x, 0.4, 1e-5), n = float3(0.0, 0.0, 1.0);\n"
        "    Light a = point_light(float3(0.2, 0.5, 0.6), float3(3.0), q);\n"
        "    return reflected(h, float3(albedo), q, n, a, 0.0).x;\n}\n",
        NULL);
    Mean m = mean(p, 64, 1);
    double r2 = 0.09 + 0.01 + 0.36;
    near_to("point", m.value, 3 * 0.6 / M_PI * 0.6 / (r2 * sqrt(r2)), 1e-4);
    slt_program_free(p);
    p = compile(
        SCENE
        "shader float main(float2 x) {\n    float3 q = float3(0.5 + 1e-6 * x.x, 0.4, 1e-5), n = float3(0.0, 0.0, 1.0);\n"
        "    Light a = rectangle_light(float3(0.5, 0.4, 0.3), float3(50.0, 0.0, 0.0), float3(0.0, -50.0, 0.0), float3(2.0), q, 0.5 + 0.5 * sign(x - 0.5) * pow(abs(2.0 * x - 1.0), 4.0));\n"
        "    float2 j = 4.0 * pow(abs(2.0 * x - 1.0), 3.0);\n    return j.x * j.y * reflected(h, float3(albedo), q, n, a, 0.0).x;\n}\n",
        NULL);
    m = mean(p, 1 << 16, 1); /* as good as a whole sky of radiance 2; the points are drawn towards the middle */
    near_to("wide rectangle", m.value, 2 * 0.6, 1e-2);
    slt_program_free(p);
    p = compile(SCENE "param texture2D map = zeros(4, 2, 1);\n[Domain(-1.0, 1.0)] shader float main(float2 x) {\n" PATH
                      "    Material m = { float3(albedo), float3(0.2), 0.4 };\n"
                      "    return path_radiance(h, m, s, map, eye, d, 6).x / 4.0;\n}\n",
                NULL);
    double white[8] = {1, 1, 1, 1, 1, 1, 1, 1}, one = 1;
    set(p, "map", white), set(p, "albedo", &one);
    for (int k = 0; k < 2; k++) {
        set_bumps(p, 0.2 * k);
        m = mean(p, 1 << 14, 1);
        if (!(m.value > 0.75 && m.value < 1 + 6 * m.se)) fail_msg("coat: %.6g +- %.2g", m.value, m.se);
    }
    slt_program_free(p);
}

/* Direct light and one or two reflections on bumps, light and derivatives by every parameter and by three directions of
 * the heights. */
static void test_two_ways(void **state) {
    (void)state;
    static const double setting[2][2] = {{0.0, 3.0}, {1.0, 1.5}}; /* sky, sunlight */
    static const int bounces[2] = {0, 1};
    for (int i = 0; i < 2; i++) {
        Mean m[2];
        uint32_t base = 0, scalar[3] = {0};
        static const char *const names[3] = {"albedo", "elevation", "eye_x"};
        for (int way = 0; way < 2; way++) {
            char source[2048];
            snprintf(
                source, sizeof source,
                way ? SCENE
                    "[Domain(-1.0, 1.0)] shader float main(float2 x) {\n" PATH
                    "    AreaLight l = area_sun(s.to, s.irradiance, s.radius);\n"
                    "    Patch q = { float3(0.05, 0.3, -1.0), float3(0.35, 0.0, 0.0), float3(0.0, 0.35, 0.0), false };\n"
                    "    Ride r = ride_patch(h, eye, q, x, rand2());\n"
                    "    return slice_radiance(h, float3(albedo), l, float3(sky), float3(sky), eye, r, 1e-4, 0.125, %d).x / 4.0;\n}\n"
                    : SCENE
                    "const float NEAR_GROUND = 0.125;\n[Domain(-1.0, 1.0)] shader float main(float2 x) {\n" PATH
                    "    float3 sum = float3(0.0), weight = float3(1.0), o = eye;\n"
                    "    for (int i = 0; i <= %d + 1; i++) {\n        Ground g = ground(h, o, d);\n"
                    "        [NoDisc] if (!g.hit) {\n            sum += weight * sky;\n            break;\n        }\n"
                    "        if (i > %d) break;\n"
                    "        sum += weight * reflected(h, float3(albedo), g.p, g.n, sun_light(s, rand2()), NEAR_GROUND);\n"
                    "        weight *= albedo;\n        o = g.p;\n        d = cosine_sample(g.n, rand2());\n    }\n"
                    "    return sum.x / 4.0;\n}\n",
                bounces[i], bounces[i]);
            SltProgram *p = compile(source, NULL);
            set(p, "sky", &setting[i][0]), set(p, "sunlight", &setting[i][1]);
            set_bumps(p, 0.18);
            m[way] = mean(p, way ? 1 << 17 : 1 << 18, 3);
            base = base_of(p, "h");
            for (int k = 0; k < 3; k++) scalar[k] = base_of(p, names[k]);
            slt_program_free(p);
        }
        char what[64];
        snprintf(what, sizeof what, "setting %d", i);
        near_to(what, m[0].value, m[1].value, 5 * hypot(m[0].se, m[1].se) + 1e-3);
        for (int k = 0; k < 3; k++) {
            uint32_t c = scalar[k];
            snprintf(what, sizeof what, "setting %d, %s", i, names[k]);
            near_to(what, m[0].g[c], m[1].g[c], 5 * hypot(m[0].gse[c], m[1].gse[c]) + 0.01 * fabs(m[1].g[c]) + 2e-3);
        }
        for (int k = 0; k < 3; k++) {
            double g[2] = {0}, v = 0;
            for (int j = 0; j < 13; j++)
                for (int c = 0; c < 13; c++) {
                    uint32_t at = base + j * 13 + c;
                    double w = k == 0 ? 1 : k == 1 ? sin(1.3 * c) : cos(0.9 * j) * sin(0.7 * c + 1);
                    for (int way = 0; way < 2; way++) {
                        g[way] += w * m[way].g[at];
                        v += w * w * m[way].gse[at] * m[way].gse[at];
                    }
                }
            snprintf(what, sizeof what, "setting %d, heights %d", i, k);
            if (getenv("SALTUS_PRINT")) printf("  %s: %g %g +- %g\n", what, g[0], g[1], sqrt(v));
            near_to(what, g[0], g[1], 5 * sqrt(v) + 0.02 * fabs(g[1]) + 0.01);
        }
    }
}

/* A lit slope colours the flat ground before it. What comes from the slope is linear in its colour, so its derivative
 * tells it exactly: nothing else changes, with the same random numbers. */
static void test_bleeding(void **state) {
    (void)state;
    double light[2][2], slope[2][2];
    for (int bounces = 0; bounces < 2; bounces++) {
        char source[1024];
        snprintf(
            source, sizeof source,
            SCENE
            "param texture2D colour = zeros(8, 1, 3);\nshader float2 main(float2 x) {\n"
            "    Sun s = { normalize(float3(0.8, 0.1, 0.5)), float3(2.0), 0.05 };\n"
            "    return path_radiance(h, colour, float4(0.0, 0.0, 1.0, 1.0), s, float3(0.0), float3(0.0), float3(0.65 + 0.2 * x.x, 0.3 + 0.4 * x.y, 1.0), float3(0.0, 0.0, -1.0), %d).xy;\n}\n",
            bounces);
        SltProgram *p = compile(source, NULL);
        double v[13 * 13], texel[24];
        for (int i = 0; i < 169; i++) v[i] = fmax(0, 0.6 - 1.2 * (i % 13) / 12.0);
        set(p, "h", v);
        for (int red = 0; red < 2; red++) {
            for (int i = 0; i < 24; i++) texel[i] = i < 12 && i % 3 == 0 ? 0.9 * red : i < 12 ? 0.1 : 0.5;
            set(p, "colour", texel);
            double value[2], g[2 * 512];
            SltJob job = SLT_JOB_INIT;
            SltError err = {0};
            SltIntegral out = {.struct_size = sizeof out, .value = value, .gradient = g};
            uint32_t n = slt_float_count(p), base = base_of(p, "colour");
            assert_true(n <= 512);
            job.integral = true, job.samples = 1 << 14, job.threads = 1, job.seed = 7;
            if (slt_grad_integral(p, &job, &out, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
            light[bounces][red] = value[0];
            slope[bounces][red] = 0;
            for (int i = 0; i < 12; i += 3) slope[bounces][red] += 0.9 * g[base + i];
            for (int i = 0; i < 12; i += 3) assert_true(g[n + base + i] == 0); /* red does not make green */
        }
        slt_program_free(p);
    }
    assert_true(slope[0][0] == 0 && slope[0][1] == 0);
    near_to("no reflection", light[0][1], light[0][0], 1e-12);
    if (!(light[1][1] > 1.02 * light[1][0])) fail_msg("red %g, without %g", light[1][1], light[1][0]);
    near_to("reflected red", slope[1][1], light[1][1] - light[1][0], 1e-9);
    near_to("reflected red, from none", slope[1][0], light[1][1] - light[1][0], 1e-9);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_furnace),
        cmocka_unit_test(test_lights),
        cmocka_unit_test(test_two_ways),
        cmocka_unit_test(test_bleeding),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
