/* The sampled half of brdf.salt: a mean over sampled directions is the integral over the hemisphere, its derivative in
 * the roughness too; coats lose energy. */
#include "tests/stdlib/fixture.h"

/* Mean over the domain, [channels], and its derivative in `roughness`. */
static void integrate(const char *source, uint32_t samples, double *value, double *slope) {
    SltProgram *p = compile(source, NULL);
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    double g[64] = {0};
    SltIntegral out = {.struct_size = sizeof out, .value = value, .gradient = g};
    job.integral = true, job.samples = samples, job.threads = 1;
    if (slt_grad_integral(p, &job, &out, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
    if (slope) {
        uint32_t n = slt_float_count(p), base = base_of(p, "roughness");
        for (uint32_t c = 0; c < 4 && c * n < 64; c++) slope[c] = g[c * n + base];
    }
    slt_program_free(p);
}

#define SPHERE                                                                                                                 \
    "import brdf;\nparam float roughness = 0.45;\n"                                                                            \
    "float3 from(float2 x) { return float3(sin(x.x) * cos(x.y), sin(x.x) * sin(x.y), cos(x.x)); }\n"

/* A smooth test function of the direction, so that a wrong density cannot hide. */
#define LOOK "float look(float3 l) { return 1.0 + 0.7 * l.x + 0.4 * l.y * l.y - 0.3 * l.z * l.x; }\n"

#define N "float3 n = normalize(float3(0.2, -0.1, 1.0)), v = normalize(float3(0.7, 0.1, 0.5));\n"

/* The integral of f(l) n.l over the hemisphere of n, in its own frame. */
#define QUADRATURE(f)                                                                                                          \
    SPHERE LOOK "[Domain(float2(0.0, 0.0), float2(0.5 * PI, TAU))] shader float3 main(float2 x) {\n" N                         \
                "    float3 l = from(x) * frame(n);\n    return " f " * clamped_dot(n, l) * sin(x.x) * look(l);\n}\n"

static void close_to(const char *what, double a, double b, double tolerance) {
    if (!(fabs(a - b) <= tolerance * fmax(1, fabs(b)))) fail_msg("%s: %.9g, wanted %.9g", what, a, b);
}

static void test_cosine(void **state) {
    (void)state;
    double a[3], b[3];
    integrate(QUADRATURE("float3(1.0)"), 1 << 16, a, NULL);
    integrate(SPHERE LOOK "shader float3 main(float2 x) {\n" N "    float3 l = cosine_sample(n, x);\n"
                          "    return float3(clamped_dot(n, l) / cosine_pdf(n, l) * look(l));\n}\n",
              1 << 16, b, NULL);
    close_to("cosine", b[0], a[0], 2e-3);
}

static void test_ggx(void **state) {
    (void)state;
    for (int i = 0; i < 2; i++) {
        double a[3], b[3], da[4], db[4];
        static const char *const full[2] = {
            SPHERE LOOK
            "[Domain(float2(0.0, 0.0), float2(0.5 * PI, TAU))] shader float3 main(float2 x) {\n" N
            "    float3 l = from(x) * frame(n);\n"
            "    return ggx(n, v, l, float3(0.1, 0.5, 0.9), roughness) * clamped_dot(n, l) * sin(x.x) * look(l);\n}\n",
            SPHERE LOOK
            "[Domain(float2(0.0, 0.0), float2(0.5 * PI, TAU))] shader float3 main(float2 x) {\n" N
            "    Material m = { float3(0.8, 0.2, 0.5), float3(0.1, 0.5, 0.9), roughness };\n"
            "    float3 l = from(x) * frame(n);\n    return material_brdf(m, n, v, l) * clamped_dot(n, l) * sin(x.x) * look(l);\n}\n"};
        static const char *const sampled[2] = {
            SPHERE LOOK
            "shader float3 main(float2 x) {\n" N "    float3 l = ggx_sample(n, v, roughness, x), sum = float3(0.0);\n"
            "    [NoDisc] if (dot(n, l) > 0.0) sum = ggx(n, v, l, float3(0.1, 0.5, 0.9), roughness) * dot(n, l) * look(l) / ggx_pdf(n, v, l, roughness);\n"
            "    return sum;\n}\n",
            SPHERE LOOK
            "shader float3 main(float2 x) {\n" N
            "    Material m = { float3(0.8, 0.2, 0.5), float3(0.1, 0.5, 0.9), roughness };\n"
            "    float3 l = material_sample(m, n, v, rand3()), sum = float3(0.0);\n"
            "    [NoDisc] if (dot(n, l) > 0.0) sum = material_brdf(m, n, v, l) * dot(n, l) * look(l) / material_pdf(m, n, v, l);\n"
            "    return sum;\n}\n"};
        integrate(full[i], 1 << 18, a, da);
        integrate(sampled[i], 1 << 18, b, db);
        for (int c = 0; c < 3; c++) {
            close_to(i ? "material" : "ggx", b[c], a[c], 4e-3);
            close_to(i ? "material, slope" : "ggx, slope", db[c], da[c], 1.5e-2);
        }
    }
}

/* White diffuse ground under a white coat reflects less than it gets, from every side and at every roughness; without a
 * coat, all of it. */
static void test_energy(void **state) {
    (void)state;
    static const double rough[] = {0.15, 0.3, 0.6, 1.0};
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 4; k++) {
            char source[2048];
            double v[3];
            snprintf(
                source, sizeof source,
                "import brdf;\nshader float3 main(float2 x) {\n"
                "    float3 n = float3(0.0, 0.0, 1.0), v = normalize(float3(%g, 0.0, 1.0)), l, sum = float3(0.0);\n"
                "    Material m[3] = { { float3(1.0), float3(0.04), %g }, { float3(1.0), float3(1.0), %g }, { float3(1.0), float3(0.0), 1.0 } };\n"
                "    for (int i = 0; i < 3; i++) {\n        l = material_sample(m[i], n, v, rand3());\n"
                "        [NoDisc] if (l.z > 0.0) sum[i] = material_brdf(m[i], n, v, l).x * l.z / material_pdf(m[i], n, v, l);\n    }\n"
                "    return sum;\n}\n",
                (double[]){0, 0.5, 1.5, 6}[k], rough[i], rough[i]);
            integrate(source, 1 << 15, v, NULL);
            for (int c = 0; c < 3; c++)
                if (!(v[c] > 0.2 && v[c] < 1.006))
                    fail_msg("roughness %g, view %d, material %d: %.6g", rough[i], k, c, v[c]);
        }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_cosine), cmocka_unit_test(test_ggx),
                                       cmocka_unit_test(test_energy)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
