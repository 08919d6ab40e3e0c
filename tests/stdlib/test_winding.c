/* winding.salt: angles and solid angles against other formulas, sums over closed curves and meshes, areas and their
 * derivatives through the boundary term. */
#include "tests/stdlib/table.h"

static double turn(const double *v) {
    double a = atan2(v[3] - v[1], v[2] - v[0] + 3), b = atan2(v[5] - v[1], v[4] - v[0] + 3);
    return (b - a) / (2 * M_PI);
}
/* L'Huilier's formula from the sides of the spherical triangle, signed by the side p lies on. */
static double solid(const double *v) {
    V3 p = v3(v), u[3];
    for (int i = 0; i < 3; i++)
        u[i] = sub3(add3(v3(v + 3 + 3 * i), (V3){i == 0 ? 3 : 0, i == 1 ? 3 : 0, i == 2 ? 3 : 0}), p);
    double det = dot3(u[0], cross3(u[1], u[2])), s[3], sum = 0, t = 1;
    for (int i = 0; i < 3; i++) {
        V3 a = unit3(u[i]), b = unit3(u[(i + 1) % 3]);
        sum += s[i] = 2 * asin(len3(sub3(a, b)) / 2);
    }
    t = tan(sum / 4);
    for (int i = 0; i < 3; i++) t *= tan((sum / 2 - s[i]) / 2);
    return copysign(4 * atan(sqrt(t)), det) / (4 * M_PI);
}
static double dipole(const double *v) {
    V3 r = sub3(add3(v3(v + 3), (V3){3, 0, 0}), v3(v));
    return dot3(r, v3(v + 6)) / (4 * M_PI * pow(len3(r), 3));
}
static double dipole2(const double *v) {
    double x = v[2] + 3 - v[0], y = v[3] - v[1];
    return (x * v[4] + y * v[5]) / (2 * M_PI * (x * x + y * y));
}
static double area(const double *v) { return (v[0] * v[3] - v[1] * v[2]) / 2; }

static const Case cases[] = {
    {.body = "[NoDisc] return winding(" VEC2(0) ", " VEC2(2) " + float2(3.0, 0.0), " VEC2(4) " + float2(3.0, 0.0));",
     .want = turn},
    {.body = "[NoDisc] return winding(" VEC3(0) ", " VEC3(3) " + float3(3.0, 0.0, 0.0), " VEC3(
         6) " + float3(0.0, 3.0, 0.0), " VEC3(9) " + float3(0.0, 0.0, 3.0));",
     .want = solid,
     .lo = -0.5,
     .hi = 0.5},
    {.body = "winding_dipole(" VEC3(0) ", " VEC3(3) " + float3(3.0, 0.0, 0.0), " VEC3(6) ")", .want = dipole},
    {.body = "winding_dipole(" VEC2(0) ", " VEC2(2) " + float2(3.0, 0.0), " VEC2(4) ")", .want = dipole2},
    {.body = "winding_area(" VEC2(0) ", " VEC2(2) ")", .want = area},
};

static void test_closed_forms(void **state) {
    (void)state;
    TABLE_RUN("winding", cases);
}

static double integral(const char *source, double *slope, double *se) {
    SltProgram *p = compile(source, NULL);
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    double value, g[64], e[64];
    SltIntegral out = {.struct_size = sizeof out, .value = &value, .gradient = g, .gradient_stderr = e};
    job.integral = true, job.samples = 1 << 15, job.threads = 1;
    if (slt_grad_integral(p, &job, &out, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
    uint32_t s = base_of(p, "s");
    *slope = g[s], *se = e[s];
    slt_program_free(p);
    return value;
}

#define CURVE(N, LIST)                                                                                         \
    "import winding;\nparam float s = 0.5;\n[Domain(-1.0, 1.0)] shader float main(float2 x) {\n"               \
    "    float2 c[" #N "] = { " LIST " }; float w = 0.0;\n"                                                    \
    "    for (int i = 0; i < " #N "; i++) { [Disc] w += winding(x, c[i], c[(i + 1) % " #N "]); }\n"

/* A square of half-width s; one with a notch; a bow tie, whose halves count +1 and -1. */
static void test_areas(void **state) {
    (void)state;
    static const struct {
        const char *source;
        double area, slope;
    } curves[] = {
        {CURVE(4, "float2(-s, -s), float2(s, -s), float2(s, s), float2(-s, s)") "return w; }\n", 1, 4},
        {CURVE(5, "float2(-s, -s), float2(s, -s), float2(s, s), float2(0.0, 0.0), float2(-s, s)") "return w; }\n", 0.75,
         3},
        {CURVE(4, "float2(-s, -s), float2(s, s), float2(s, -s), float2(-s, s)") "return w; }\n", 0, 0},
        {CURVE(4, "float2(-s, -s), float2(s, s), float2(s, -s), float2(-s, s)") "return winding_nonzero(w); }\n", 0.5,
         2},
        {CURVE(4, "float2(-s, -s), float2(s, s), float2(s, -s), float2(-s, s)") "return winding_even_odd(w); }\n", 0.5,
         2},
    };
    for (size_t i = 0; i < sizeof curves / sizeof *curves; i++) {
        double slope, se, got = integral(curves[i].source, &slope, &se);
        if (fabs(got - curves[i].area) > 1e-2 || fabs(slope - curves[i].slope) > 6 * se + 1e-2)
            fail_msg("curve %zu: area %.6g, slope %.6g +- %.2g", i, got, slope, se);
    }
}

/* An octahedron |x| + |y| + |z| < s from its eight faces: 4/3 s^3. */
static void test_volume(void **state) {
    (void)state;
    double slope, se,
        got =
            integral("import winding;\nparam float s = 0.8;\n[Domain(-1.0, 1.0)] shader float main(float3 x) {\n"
                     "    float w = 0.0;\n"
                     "    for (int i = 0; i < 8; i++) {\n"
                     "        int a = (i & 1) * 2 - 1, b = (i & 2) - 1, c = (i & 4) / 2 - 1;\n"
                     "        float3 p = float3(s * a, 0.0, 0.0), q = float3(0.0, s * b, 0.0), r = float3(0.0, 0.0, s "
                     "* c);\n"
                     "        if (a * b * c < 0) { float3 t = q; q = r; r = t; }\n"
                     "        [Disc] w += winding(x, p, q, r);\n"
                     "    }\n"
                     "    return w; }\n",
                     &slope, &se);
    if (fabs(got - 4.0 / 3 * 0.512) > 1e-2 || fabs(slope - 4 * 0.64) > 6 * se + 2e-2)
        fail_msg("volume %.6g, slope %.6g +- %.2g", got, slope, se);
}

/* Counting gives the same numbers. */
static void test_count(void **state) {
    (void)state;
    SltProgram *p = compile("import winding;\nparam float2 x = float2(0.0);\nparam float2 c[7] = { float2(-0.7, -0.6), "
                            "float2(0.9, -0.3), float2(-0.2, 0.8), float2(0.1, -0.9), float2(0.6, 0.7), float2(-0.8, "
                            "0.1), float2(0.8, 0.2) };\n"
                            "shader float2 main(float2 ignored) { float2 w = float2(0.0);\n"
                            "    for (int i = 0; i < 7; i++) { [NoDisc] w += float2(winding(x, c[i], c[(i + 1) % 7]), "
                            "winding_count(x, c[i], c[(i + 1) % 7])); } return w; }\n",
                            NULL);
    uint32_t seed = 2;
    bool some[5] = {false};
    for (int i = 0; i < 200; i++) {
        double x[2] = {2 * uniform(&seed) - 1, 2 * uniform(&seed) - 1}, v[2], g[64];
        set(p, "x", x);
        evaluate(p, v, g);
        assert_true(fabs(v[0] - v[1]) < 1e-12);
        if (fabs(v[1]) <= 2) some[(int)v[1] + 2] = true;
    }
    assert_true(some[2] && (some[1] || some[3]));
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_closed_forms),
        cmocka_unit_test(test_areas),
        cmocka_unit_test(test_volume),
        cmocka_unit_test(test_count),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
