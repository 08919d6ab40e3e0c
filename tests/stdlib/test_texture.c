/* texture.salt: interpolation against the same sums in C, across borders; grids, mappings, patterns and their means. */
#include "tests/stdlib/table.h"

static double mirror(const double *v) {
    double u = 3 * v[0], f = u - 2 * floor(u / 2);
    return f > 1 ? 2 - f : f;
}
static double bilinear(const double *v) {
    return (1 - v[0]) * (1 - v[1]) * v[2] + v[0] * (1 - v[1]) * v[3] + (1 - v[0]) * v[1] * v[4] + v[0] * v[1] * v[5];
}
static double trilinear(const double *v) {
    double sum = 0;
    for (int i = 0; i < 8; i++) {
        double w = 1;
        for (int a = 0; a < 3; a++) w *= i >> a & 1 ? v[a] : 1 - v[a];
        sum += w * v[3 + i];
    }
    return sum;
}
static double trilinear_slope(const double *v) {
    double w[16], h = 1e-3, sum = 0;
    for (int a = 0; a < 3; a++) {
        memcpy(w, v, sizeof w);
        w[a] = v[a] + h, sum += (a + 1) * trilinear(w) / (2 * h);
        w[a] = v[a] - h, sum -= (a + 1) * trilinear(w) / (2 * h);
    }
    return sum;
}
/* B-spline weights by their definition: the convolution of four boxes, as truncated powers. */
static double bspline_weight(double d) {
    double sum = 0, c[5] = {1, -4, 6, -4, 1};
    for (int k = 0; k < 5; k++) sum += c[k] * pow(fmax(0, d + 2 - k), 3) / 6;
    return sum;
}
static double bspline(const double *v) {
    double sum = 0;
    for (int k = 0; k < 4; k++) sum += bspline_weight(v[0] + 1 - k) * v[1 + k];
    return sum;
}
/* Catmull and Rom: the cubic with the inner values and half the differences of the neighbours as slopes. */
static double catmull(const double *v) {
    double t = v[0], a = v[2], b = v[3], m = (v[3] - v[1]) / 2, n = (v[4] - v[2]) / 2;
    return (2 * t * t * t - 3 * t * t + 1) * a + (t * t * t - 2 * t * t + t) * m + (3 * t * t - 2 * t * t * t) * b +
           (t * t * t - t * t) * n;
}
static double grid(const double *v) {
    double q = fmin(1, fmax(0, v[0])) * 3;
    int i = q >= 3 ? 2 : (int)q;
    return v[4 + i] + (q - i) * (v[5 + i] - v[4 + i]);
}
static double sphere_back(const double *v) { return unit3(v3(v)).y; }
static double sphere_u(const double *v) { return 0.5 + atan2(v[1], v[0]) / (2 * M_PI); }
static double stripe_mean(const double *v) {
    double sum = 0, from = 2 * v[0] - 0.15, to = 2 * v[0] + 0.15;
    for (int n = -6; n < 6; n++) sum += fmax(0, fmin(to, n + 0.4) - fmax(from, n));
    return sum / 0.3;
}

static const Case cases[] = {
    {.body = "uv_mirror(float2(3.0 * v[0])).x", .want = mirror},
    {.body = "bilinear(" VEC2(0) ", v[2], v[3], v[4], v[5])", .want = bilinear},
    {.body = "trilinear(" VEC3(0) ", " VEC4(3) ", " VEC4(7) ")", .want = trilinear},
    {.body = "dot(trilinear_gradient(" VEC3(0) ", " VEC4(3) ", " VEC4(7) "), float3(1.0, 2.0, 3.0))",
     .want = trilinear_slope},
    {.body = "dot(weights_bspline(v[0]), " VEC4(1) ")", .want = bspline, .lo = 0.01, .hi = 0.99},
    {.body = "dot(weights_catmull(v[0]), " VEC4(1) ")", .want = catmull, .lo = 0.01, .hi = 0.99},
    {.body = "GridCell2 c = grid_cell(" VEC2(0) ", int2(4)); float g[4] = {v[4], v[5], v[6], v[7]}; return "
                                                "bilinear(c.w, g[c.at.x], g[c.at.x + 1], g[c.at.x], g[c.at.x + 1]);",
     .want = grid},
    {.body = "GridCell3 c = grid_cell(" VEC3(0) ", int3(4)); float g[4] = {v[4], v[5], v[6], v[7]}; return "
                                                "lerp(g[c.at.x], g[c.at.x + 1], c.w.x);",
     .want = grid},
    {.body = "uv_sphere_direction(uv_sphere(normalize(" VEC3(0) "))).y", .want = sphere_back},
    {.body = "uv_sphere(normalize(" VEC3(0) ")).x", .want = sphere_u, .lo = 0.1, .hi = 1},
    {.body = "stripes_filtered(2.0 * v[0], 0.4, 0.3)", .want = stripe_mean},
};

static void test_closed_forms(void **state) {
    (void)state;
    TABLE_RUN("texture", cases);
}

enum { W = 4, H = 3 };
static double texel(const double *t, int x, int y, bool repeat) {
    if (repeat) x = ((x % W) + W) % W, y = ((y % H) + H) % H;
    else x = x < 0 ? 0 : x >= W ? W - 1 : x, y = y < 0 ? 0 : y >= H ? H - 1 : y;
    return t[(H - 1 - y) * W + x];
}
static double hat(double d) { return fmax(0, 1 - fabs(d)); }
static double catmull_weight(double d) {
    d = fabs(d);
    return d < 1 ? 1 - 2.5 * d * d + 1.5 * d * d * d : d < 2 ? 2 - 4 * d + 2.5 * d * d - 0.5 * d * d * d : 0;
}
static double sampled(const double *t, double u, double v, double (*weight)(double), bool repeat) {
    double x = u * W - 0.5, y = v * H - 0.5, sum = 0;
    for (int j = (int)floor(y) - 2; j <= (int)floor(y) + 3; j++)
        for (int i = (int)floor(x) - 2; i <= (int)floor(x) + 3; i++)
            sum += weight(x - i) * weight(y - j) * texel(t, i, j, repeat);
    return sum;
}

/* Everywhere, on borders of texels and of copies too: values, continuity, and the derivative in uv. */
static void test_sampling(void **state) {
    (void)state;
    SltProgram *p = compile("import texture;\nparam texture2D t = zeros(4, 3, 1);\nparam float2 uv = float2(0.0);\n"
                            "shader float4 main(float2 x) { return float4(texture_repeat(t, uv).x, texture_bspline(t, "
                            "uv).x, texture_catmull(t, uv).x, texture_triplanar(t, float3(uv, 0.3), float3(0.6, 0.0, "
                            "0.8), 2.0).x); }\n",
                            NULL);
    assert_int_equal(slt_site_count(p), 0);
    double texels[W * H], g[4][W * H + 2], ignored[4][W * H + 2], v[4], up[4];
    uint32_t seed = 11, base = base_of(p, "uv");
    for (int i = 0; i < W * H; i++) texels[i] = uniform(&seed);
    set(p, "t", texels);
    for (int i = 0; i < 120; i++) {
        double uv[2] = {3 * uniform(&seed) - 1, 3 * uniform(&seed) - 1};
        if (i % 3 == 0) uv[i / 3 % 2] = round(8 * uv[i / 3 % 2]) / 8;
        set(p, "uv", uv), evaluate(p, v, &g[0][0]);
        double weights = 0.36 + 0.64 + 1e-12, want[4] = {sampled(texels, uv[0], uv[1], hat, true),
                                                         sampled(texels, uv[0], uv[1], bspline_weight, false),
                                                         sampled(texels, uv[0], uv[1], catmull_weight, false), 0};
        want[3] = (0.36 * sampled(texels, uv[1], 0.3, hat, true) + 1e-12 * sampled(texels, 0.3, uv[0], hat, true) +
                   0.64 * sampled(texels, uv[0], uv[1], hat, true)) /
                  weights;
        for (int k = 0; k < 4; k++)
            if (fabs(v[k] - want[k]) > 1e-9)
                fail_msg("%d at (%.9g, %.9g): %.12g, wanted %.12g", k, uv[0], uv[1], v[k], want[k]);
        for (int a = 0; a < 2; a++) {
            double q[2] = {uv[0], uv[1]}, h = 1e-6, down[4];
            q[a] = uv[a] + h, set(p, "uv", q), evaluate(p, up, &ignored[0][0]);
            q[a] = uv[a] - h, set(p, "uv", q), evaluate(p, down, &ignored[0][0]);
            for (int k = 0; k < 4; k++) {
                if (fabs(up[k] - v[k]) > 1e-4) fail_msg("%d jumps at (%.9g, %.9g)", k, uv[0], uv[1]);
                double fd = (up[k] - down[k]) / (2 * h), bent = fabs(up[k] + down[k] - 2 * v[k]) / h;
                if (fabs(fd - g[k][base + (uint32_t)a]) > 1e-4 + bent)
                    fail_msg("%d: derivative %.9g, differences %.9g", k, g[k][base + (uint32_t)a], fd);
            }
        }
    }
    slt_program_free(p);
}

/* A filtered checkerboard is the mean of the sharp one over the box; the sharp one has its sites where it is tagged. */
static void test_checker(void **state) {
    (void)state;
    SltProgram *p =
        compile("import texture;\nparam float2 at = float2(0.3, 0.8);\nparam float2 w = float2(0.7, 0.4);\n"
                "shader float2 main(float2 x) { float2 q = at + (x - 0.5) * w; [Disc] float c = checker(q); "
                "return float2(c, checker_filtered(at, w)); }\n",
                NULL);
    assert_int_equal(slt_site_count(p), 2);
    uint32_t seed = 4;
    for (int i = 0; i < 6; i++) {
        double at[2] = {4 * uniform(&seed) - 2, 4 * uniform(&seed) - 2}, v[2], g[2][4], se[2][4];
        set(p, "at", at);
        SltJob job = SLT_JOB_INIT;
        SltError err = {0};
        SltIntegral out = {.struct_size = sizeof out, .value = v, .gradient = &g[0][0], .gradient_stderr = &se[0][0]};
        job.integral = true, job.samples = 1 << 14, job.threads = 1;
        assert_int_equal(slt_grad_integral(p, &job, &out, NULL, &err), SLT_OK);
        if (fabs(v[0] - v[1]) > 6e-3) fail_msg("mean %.6g, filtered %.6g", v[0], v[1]);
        for (int a = 0; a < 4; a++)
            if (fabs(g[0][a] - g[1][a]) > 6 * se[0][a] + 1e-2)
                fail_msg("derivative %d: %.6g +- %.2g, filtered %.6g", a, g[0][a], se[0][a], g[1][a]);
    }
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_closed_forms),
        cmocka_unit_test(test_sampling),
        cmocka_unit_test(test_checker),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
