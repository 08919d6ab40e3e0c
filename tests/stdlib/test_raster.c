/* raster.salt: projections, coverage and weights of projected triangles against rays in world space; Gaussians. */
#include "tests/stdlib/table.h"

static double edge(const double *v) { return (v[4] - v[2]) * (v[1] - v[3]) - (v[5] - v[3]) * (v[0] - v[2]); }
static double soft(const double *v) { return 1 / (1 + exp(-copysign(v[0] * v[0], v[0]) / 0.1)); }
/* The covariance of the form p^T C p, from the rotated axes. */
static double form(const double *v) {
    double c = cos(v[4]), s = sin(v[4]), x = c * v[0] + s * v[1], y = -s * v[0] + c * v[1];
    return v[2] * v[2] * x * x + v[3] * v[3] * y * y;
}
static double gauss(const double *v) {
    double c = cos(v[4]), s = sin(v[4]), x = c * v[0] + s * v[1], y = -s * v[0] + c * v[1];
    return exp(-0.5 * (x * x / (v[2] * v[2]) + y * y / (v[3] * v[3])));
}
/* R diag(s^2) R^T about the z axis. */
static double covariance(const double *v) {
    double c = cos(v[4]), s = sin(v[4]), x = c * v[0] + s * v[1], y = -s * v[0] + c * v[1];
    return v[2] * v[2] * x * x + v[3] * v[3] * y * y + 0.09 * v[5] * v[5];
}
/* The picture's covariance from differences of the projection. */
static double projected(const double *v) {
    double p[3] = {v[0], v[1], v[2] - 3}, j[2][3], h = 1e-4;
    for (int a = 0; a < 3; a++)
        for (int k = 0; k < 2; k++) {
            double up[3] = {p[0], p[1], p[2]}, down[3] = {p[0], p[1], p[2]};
            up[a] += h, down[a] -= h;
            j[k][a] = 1.5 * (up[k] / -up[2] - down[k] / -down[2]) / (2 * h);
        }
    double sum = 0, s[3] = {0.3, 0.5, 0.7};
    for (int a = 0; a < 3; a++) {
        double x = j[0][a], y = j[1][a];
        sum += s[a] * s[a] * (x * x + 2 * x * y + 3 * y * y);
    }
    return sum;
}

static const Case cases[] = {
    {.body = "edge_function(" VEC2(0) ", " VEC2(2) ", " VEC2(4) ")", .want = edge},
    {.body = "soft_coverage(v[0], 0.1)", .want = soft},
    {.body =
         "float3 c = splat_covariance(" VEC2(2) ", v[4]); return c.x * v[0] * v[0] + 2.0 * c.y * v[0] * v[1] + c.z * "
                                                "v[1] * v[1];",
     .want = form},
    {.body = "splat(" VEC2(0) ", splat_covariance(" VEC2(2) ", v[4]))", .want = gauss, .lo = 0.3, .hi = 1},
    {.body =
         "float3x3 r = float3x3(float3(cos(v[4]), -sin(v[4]), 0.0), float3(sin(v[4]), cos(v[4]), 0.0), float3(0.0, "
         "0.0, 1.0)); float3 x = float3(v[0], v[1], v[5]); return dot(x, mul(splat_covariance(r, float3(v[2], v[3], "
         "0.3)), x));",
     .want = covariance},
    {.body =
         "float3x3 c = float3x3(float3(0.09, 0.0, 0.0), float3(0.0, 0.25, 0.0), float3(0.0, 0.0, 0.49)); float3 q = "
         "splat_project(" VEC3(0) " - float3(0.0, 0.0, 3.0), c, 1.5); return q.x + 2.0 * q.y + 3.0 * q.z;",
     .want = projected},
};

static void test_closed_forms(void **state) {
    (void)state;
    TABLE_RUN("raster", cases);
}

/* A triangle in the world through the camera's matrices, at points of the picture, and the ray through that point: the
 * same hits, depths and weights; corners behind the eye too. */
static const char WORLD[] =
    "import raster;\nimport mesh;\nimport camera;\nparam float3 v[3] = init(zero);\nparam float2 at = float2(0.0);\n"
    "float3 zero(int i) { return float3(0.0); }\nconst float3 EYE = float3(0.3, 0.2, 2.0);\n"
    "const float3 UP = float3(0.0, 1.0, 0.0);\n"
    "Fragment fragment() {\n"
    "    float4x4 m = mul(perspective(1.1, 1.0, 0.1, 10.0), view_matrix(EYE, float3(0.0), UP));\n"
    "    return raster_triangle(at, mul(m, float4(v[0], 1.0)), mul(m, float4(v[1], 1.0)), mul(m, float4(v[2], 1.0)));\n"
    "}\n"
    "shader float4 raster(float2 x) { Fragment f = fragment(); return float4(f.w, f.weights); }\n"
    "shader float4 ray(float2 x) {\n"
    "    Camera c = look_at(EYE, float3(0.0), UP);\n"
    "    float3 d = camera_ray(c, at, 1.1), w;\n"
    "    float t = ray_triangle(EYE, d, v[0], v[1], v[2], w);\n"
    "    return float4(t * dot(d, c.forward), w);\n"
    "}\n"
    "shader float2 sides(float2 x) { Fragment f = fragment(); return float2(f.inside, f.turn); }\n";

static void test_triangle_against_ray(void **state) {
    (void)state;
    SltProgram *raster = compile(WORLD, "raster"), *ray = compile(WORLD, "ray"), *sides = compile(WORLD, "sides");
    assert_int_equal(slt_site_count(raster) + slt_site_count(sides), 0);
    uint32_t seed = 6;
    int hits = 0, misses = 0, behind = 0;
    for (int i = 0; i < 400; i++) {
        double v[9], at[2] = {2 * uniform(&seed) - 1, 2 * uniform(&seed) - 1}, a[4], b[4], s[2], ga[44], gb[44], gs[22];
        /* Up to beyond the eye, which is at z = 2. */
        for (int k = 0; k < 9; k++) v[k] = (k % 3 == 2 ? 3 : 1.5) * (2 * uniform(&seed) - 1);
        SltProgram *all[] = {raster, ray, sides};
        for (int k = 0; k < 3; k++) set(all[k], "v", v), set(all[k], "at", at);
        evaluate(raster, a, ga), evaluate(ray, b, gb), evaluate(sides, s, gs);
        double least = fmin(b[1], fmin(b[2], b[3]));
        if (fabs(least) < 1e-6) continue;
        bool hit = least > 0 && b[0] > 0;
        if (hit != (s[0] > 0)) fail_msg("%d: weight %.6g, depth %.6g, inside %.6g", i, least, b[0], s[0]);
        hits += hit, misses += !hit, behind += least > 0 && b[0] < 0;
        if (!hit) continue;
        for (int k = 0; k < 4; k++)
            if (fabs(a[k] - b[k]) > 1e-8 * (1 + fabs(b[k]))) fail_msg("%d[%d]: %.9g for %.9g", i, k, a[k], b[k]);
        for (int k = 0; k < 44; k++)
            if (fabs(ga[k] - gb[k]) > 1e-6 * (1 + fabs(gb[k])))
                fail_msg("%d: derivative %d %.9g for %.9g", i, k, ga[k], gb[k]);
    }
    assert_true(hits > 30 && misses > 100 && behind > 3);
    slt_program_free(raster), slt_program_free(ray), slt_program_free(sides);
}

/* `inside` is a distance in the picture: near an edge its gradient has length 1. */
static void test_inside_is_a_distance(void **state) {
    (void)state;
    SltProgram *p = compile(WORLD, "sides");
    double v[9] = {-0.5, -0.4, 0.3, 0.6, -0.5, -0.4, 0.1, 0.7, 0.2}, s[2], g[22];
    uint32_t seed = 9, base = base_of(p, "at");
    set(p, "v", v);
    for (int i = 0; i < 50; i++) {
        double at[2] = {uniform(&seed) - 0.5, uniform(&seed) - 0.5};
        set(p, "at", at), evaluate(p, s, g);
        assert_true(fabs(hypot(g[base], g[base + 1]) - 1) < 1e-9);
        assert_true(s[1] > 0); /* counter-clockwise */
    }
    slt_program_free(p);
}

/* near and far go to -1 and 1, the borders of the field of view to the borders of the picture; parallel views alike. */
static void test_projections(void **state) {
    (void)state;
    SltProgram *p = compile("import raster;\nparam float3 at = float3(0.0);\nparam float wide = 0.0;\nshader float4 "
                            "main(float2 x) { float4 q = mul(wide * perspective(1.2, 1.5, 0.5, 20.0) + (1.0 - wide) * "
                            "orthographic(2.0, 1.5, 0.5, 20.0), float4(at, 1.0)); return float4(q.xyz / q.w, q.w); }\n",
                            NULL);
    for (int k = 0; k < 2; k++)
        for (int far = 0; far < 2; far++) {
            double wide = k, z = far ? 20 : 0.5, y = k ? z * tan(0.6) : 2, at[3] = {1.5 * y, y, -z}, v[4], g[16];
            set(p, "wide", &wide), set(p, "at", at), evaluate(p, v, g);
            assert_true(fabs(v[0] - 1) < 1e-12 && fabs(v[1] - 1) < 1e-12 && fabs(v[2] - (far ? 1 : -1)) < 1e-9);
            assert_true(fabs(v[3] - (k ? z : 1)) < 1e-12);
        }
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_closed_forms),
        cmocka_unit_test(test_triangle_against_ray),
        cmocka_unit_test(test_inside_is_a_distance),
        cmocka_unit_test(test_projections),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
