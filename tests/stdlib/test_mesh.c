/* mesh.salt: triangles, rays and rotations against other formulas; nearest points against a search. */
#include "tests/stdlib/table.h"

static double area3(const double *v) { return len3(cross3(sub3(v3(v + 3), v3(v)), sub3(v3(v + 6), v3(v)))) / 2; }
static double normal(const double *v) { return unit3(cross3(sub3(v3(v + 3), v3(v)), sub3(v3(v + 6), v3(v)))).y; }
static double det2(const double *a, const double *b, const double *c) {
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}
static double area2(const double *v) { return det2(v, v + 2, v + 4) / 2; }
static double weight2(const double *v) {
    double c[2] = {v[6] + 4, v[7]}, b[2] = {v[4], v[5] + 4};
    return det2(v + 2, v, c) / det2(v + 2, b, c);
}
/* p = a + s (b - a) + t (c - a) + q n, so the weights are 1 - s - t, s, t. */
static double weight3(const double *v) { return (1 - v[9] - v[10]) + 2 * v[9] + 3 * v[10]; }
static double ray_t(const double *v) {
    V3 n = cross3(sub3(v3(v + 3), v3(v)), sub3(v3(v + 6), v3(v)));
    return dot3(n, sub3(v3(v), v3(v + 9))) / dot3(n, v3(v + 12));
}
static double volume(const double *v) { return dot3(v3(v), cross3(v3(v + 3), v3(v + 6))) / 6; }
static double cotangent(const double *v) {
    V3 b = sub3(v3(v + 3), v3(v)), c = sub3(v3(v + 6), v3(v));
    return 1 / tan(acos(dot3(b, c) / (len3(b) * len3(c))));
}
/* Half the area times |grad f|^2, of the linear f on the triangle. */
static double dirichlet(const double *v) {
    V3 b = sub3(v3(v + 3), v3(v)), c = sub3(v3(v + 6), v3(v)), n = cross3(b, c);
    double p = v[10] - v[9], q = v[11] - v[9];
    V3 g = mul3(1 / dot3(n, n), add3(mul3(p, cross3(c, n)), mul3(q, cross3(n, b))));
    return 0.25 * len3(n) * dot3(g, g);
}
static double umbrella(const double *v) { return v[0] - v[3] / 5; }
/* Rodrigues' rotation of v[4..] about v[0..] by v[3]. */
static double turned(const double *v) {
    V3 k = unit3(v3(v)), x = v3(v + 4);
    V3 r = add3(mul3(cos(v[3]), x), add3(mul3(sin(v[3]), cross3(k, x)), mul3((1 - cos(v[3])) * dot3(k, x), k)));
    return r.x + 2 * r.y + 3 * r.z;
}

#define ABC VEC3(0) ", " VEC3(3) ", " VEC3(6)
#define SUM "float3(1.0, 2.0, 3.0)"
static const Case cases[] = {
    {.body = "triangle_area(" ABC ")", .want = area3},
    {.body = "0.5 * length(triangle_cross(" ABC "))", .want = area3},
    {.body = "triangle_normal(" ABC ").y", .want = normal},
    {.body = "triangle_area(" VEC2(0) ", " VEC2(2) ", " VEC2(4) ")", .want = area2},
    {.body = "barycentric(" VEC2(0) ", " VEC2(2) ", " VEC2(4) " + float2(0.0, 4.0), " VEC2(6) " + float2(4.0, 0.0)).y",
     .want = weight2},
    {.body = "float3 a = " VEC3(0) ", b = " VEC3(3) ", c = " VEC3(
         6) "; return dot(" SUM ", barycentric(a + v[9] * (b - "
            "a) + v[10] * (c - a) + v[11] * cross(b - a, c - a), a, b, c));",
     .want = weight3},
    {.body = "float3 w; float t = ray_triangle(" VEC3(9) ", " VEC3(12) ", " ABC ", w); return t;", .want = ray_t},
    {.body = "mesh_volume(" ABC ")", .want = volume},
    {.body = "cotangent(" ABC ")", .want = cotangent},
    {.body = "dirichlet(" ABC ", v[9], v[10], v[11])", .want = dirichlet},
    {.body = "umbrella(" VEC3(0) ", " VEC3(3) ", 5.0).x", .want = umbrella},
    {.body = "dot(" SUM ", quaternion_rotate(quaternion(" VEC3(0) ", v[3]), " VEC3(4) "))", .want = turned},
    {.body = "dot(" SUM ", mul(quaternion_matrix(1.7 * quaternion(" VEC3(0) ", v[3])), " VEC3(4) "))", .want = turned},
    {.body = "float4 q = quaternion_mul(quaternion(" VEC3(0) ", 0.7 * v[3]), quaternion(" VEC3(
         0) ", 0.3 * v[3])); return "
            "dot(" SUM ", quaternion_rotate(q, " VEC3(4) "));",
     .want = turned},
};

static void test_closed_forms(void **state) {
    (void)state;
    TABLE_RUN("mesh", cases);
}

/* The weights of a ray's hit give back the point. */
static void test_ray(void **state) {
    (void)state;
    SltProgram *p =
        compile("import mesh;\nparam float3 v[5] = init(zero);\nfloat3 zero(int i) { return float3(0.0); }\n"
                "shader float3 main(float2 x) { float3 w; float t = ray_triangle(v[0], v[1], v[2], v[3], v[4], "
                "w); return v[0] + t * v[1] - (w.x * v[2] + w.y * v[3] + w.z * v[4]); }\n",
                NULL);
    uint32_t seed = 3;
    for (int i = 0; i < 50; i++) {
        double v[15], d[3], g[45];
        for (int k = 0; k < 15; k++) v[k] = 2 * uniform(&seed) - 1;
        set(p, "v", v), evaluate(p, d, g);
        for (int a = 0; a < 3; a++) assert_true(fabs(d[a]) < 1e-9);
        for (int k = 0; k < 45; k++) assert_true(fabs(g[k]) < 1e-7);
    }
    slt_program_free(p);
}

static void test_nearest(void **state) {
    (void)state;
    SltProgram *p =
        compile("import mesh;\nparam float3 v[4] = init(zero);\nfloat3 zero(int i) { return float3(0.0); }\n"
                "shader float2 main(float2 x) { return float2(triangle_distance(v[0], v[1], v[2], v[3]), "
                "length(v[0] - triangle_nearest(v[0], v[1], v[2], v[3]))); }\n",
                NULL);
    assert_int_equal(slt_site_count(p), 0);
    uint32_t seed = 8;
    for (int i = 0; i < 60; i++) {
        double v[12], got[2], g[24], best = INFINITY;
        for (int k = 0; k < 12; k++) v[k] = (k < 3 ? 2 : 1) * (2 * uniform(&seed) - 1);
        set(p, "v", v), evaluate(p, got, g);
        enum { N = 400 };
        for (int a = 0; a <= N; a++)
            for (int b = 0; a + b <= N; b++) {
                double s = (double)a / N, t = (double)b / N;
                V3 q = add3(mul3(1 - s - t, v3(v + 3)), add3(mul3(s, v3(v + 6)), mul3(t, v3(v + 9))));
                best = fmin(best, len3(sub3(v3(v), q)));
            }
        if (got[0] > best + 1e-12 || got[0] < best - 6e-3) fail_msg("distance %.9g, searched %.9g", got[0], best);
        double norm = sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]);
        if (fabs(norm - 1) > 1e-9) fail_msg("|gradient| = %.12g at a distance of %.9g", norm, got[0]);
    }
    slt_program_free(p);
}

/* Two faces folded about an edge: the angle is the fold. */
static void test_dihedral(void **state) {
    (void)state;
    SltProgram *p =
        compile("import mesh;\nparam float fold = 0.0;\nshader float main(float2 x) { return "
                "dihedral(float3(0.0), float3(1.0, 0.0, 0.0), float3(0.3, 1.0, 0.0), float3(0.6, -cos(fold), "
                "-sin(fold))); }\n",
                NULL);
    for (double fold = -3; fold < 3.1; fold += 0.5) {
        double v, g;
        set(p, "fold", &fold), evaluate(p, &v, &g);
        if (fabs(v - fold) > 1e-12 || fabs(g - 1) > 1e-9) fail_msg("fold %.3g: %.9g, derivative %.9g", fold, v, g);
    }
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_closed_forms),
        cmocka_unit_test(test_ray),
        cmocka_unit_test(test_nearest),
        cmocka_unit_test(test_dihedral),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
