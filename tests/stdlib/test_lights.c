/* light.salt: falloff and shading by formula, lamps with an area against sums over them, harmonics against each other.
 */
#include "tests/stdlib/table.h"

static double clamp01(double x) { return fmin(1, fmax(0, x)); }
static double falloff(const double *v) { return 1 / fmax(v[0] * v[0], 0.04); }
static double ranged(const double *v) {
    double w = clamp01(1 - pow(fabs(v[0]) / 0.8, 4));
    return w * w / (v[0] * v[0] + 1);
}
static double spot(const double *v) {
    double t = clamp01((v[0] - 0.3) / 0.5);
    return t * t * (3 - 2 * t);
}
/* n = v[0..], view = v[3..], light = v[6..], each of unit length. */
static double lambert(const double *v) { return fmax(0, dot3(unit3(v3(v)), unit3(v3(v + 6)))); }
static double wrapped(const double *v) { return fmax(0, dot3(unit3(v3(v)), unit3(v3(v + 6))) + 0.5) / 1.5; }
static double phong(const double *v) {
    V3 n = unit3(v3(v)), l = unit3(v3(v + 6));
    V3 r = sub3(mul3(2 * dot3(n, l), n), l);
    return pow(fmax(1e-20, dot3(r, unit3(v3(v + 3)))), 6);
}
static double blinn(const double *v) {
    V3 h = unit3(add3(unit3(v3(v + 3)), unit3(v3(v + 6))));
    return 14 / (8 * M_PI) * pow(fmax(1e-20, dot3(unit3(v3(v)), h)), 6);
}
/* Oren and Nayar with angles as they wrote it. */
static double oren(const double *v) {
    V3 n = unit3(v3(v)), e = unit3(v3(v + 3)), l = unit3(v3(v + 6));
    double a = acos(dot3(n, l)), b = acos(dot3(n, e)), s2 = 0.16;
    V3 le = sub3(l, mul3(cos(a), n)), ve = sub3(e, mul3(cos(b), n));
    double phi = dot3(le, ve) / (len3(le) * len3(ve));
    return cos(a) *
           (1 - 0.5 * s2 / (s2 + 0.33) + 0.45 * s2 / (s2 + 0.09) * fmax(0, phi) * sin(fmax(a, b)) * tan(fmin(a, b)));
}
static double rim(const double *v) { return pow(1 - fmax(0, dot3(unit3(v3(v)), unit3(v3(v + 3)))), 3); }

#define UNITS "normalize(" VEC3(0) "), normalize(" VEC3(3) "), normalize(" VEC3(6) ")"
static const Case cases[] = {
    {.body = "light_falloff(v[0] * v[0], 0.04)", .want = falloff},
    {.body = "light_falloff_range(abs(v[0]), 0.8)", .want = ranged},
    {.body = "light_spot(float3(v[0], 0.0, 0.0), float3(1.0, 0.0, 0.0), 0.8, 0.3)", .want = spot},
    {.body = "shade_lambert(normalize(" VEC3(0) "), normalize(" VEC3(6) "))", .want = lambert},
    {.body = "shade_wrap(normalize(" VEC3(0) "), normalize(" VEC3(6) "), 0.5)", .want = wrapped},
    {.body = "shade_phong(" UNITS ", 6.0)", .want = phong},
    {.body = "shade_blinn(" UNITS ", 6.0)", .want = blinn, .lo = 0.1, .hi = 1},
    {.body = "shade_oren(" UNITS ", 0.4)", .want = oren, .lo = 0.1, .hi = 1},
    {.body = "shade_rim(normalize(" VEC3(0) "), normalize(" VEC3(3) "), 3.0)", .want = rim},
};

static void test_closed_forms(void **state) {
    (void)state;
    TABLE_RUN("light", cases);
}

/* ---- lamps: a sum over directions of (n . w)+ where the lamp is seen */

static double ball_sum(V3 n, V3 c, double r) {
    /* Over the cap of directions within asin(r / d) of c. */
    double d = len3(c), sum = 0, cap = 1 - sqrt(1 - r * r / d / d);
    V3 z = unit3(c), x = unit3(cross3(z, fabs(z.x) < 0.9 ? (V3){1, 0, 0} : (V3){0, 1, 0})), y = cross3(z, x);
    enum { N = 600 };
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            double h = 1 - cap * (i + 0.5) / N, a = 2 * M_PI * (j + 0.5) / N, s = sqrt(1 - h * h);
            V3 w = add3(mul3(h, z), add3(mul3(s * cos(a), x), mul3(s * sin(a), y)));
            sum += fmax(0, dot3(n, w));
        }
    return sum * 2 * M_PI * cap / N / N;
}

static void test_ball(void **state) {
    (void)state;
    SltProgram *p = compile("import light;\nparam float3 n = float3(0.0, 0.0, 1.0);\nparam float3 c = float3(0.0);\n"
                            "param float r = 1.0;\nshader float main(float2 x) { return lamp_ball(float3(0.0), "
                            "normalize(n), c, r); }\n",
                            NULL);
    /* High up, across the horizon, almost below it, below it, near. */
    static const double centres[][4] = {
        {0.3, 0.2, 2, 0.7}, {1.5, 0, 0.3, 0.7}, {1.5, 0, -0.5, 0.7}, {0, 1, -2, 0.5}, {0.2, 0.1, 1.1, 1}};
    for (size_t i = 0; i < sizeof centres / sizeof *centres; i++) {
        const double *c = centres[i];
        double got, g[7], h = 1e-5, up, down, ignored[7];
        set(p, "c", c), set(p, "r", &c[3]);
        evaluate(p, &got, g);
        double want = ball_sum((V3){0, 0, 1}, v3(c), c[3]);
        if (fabs(got - want) > 2e-4) fail_msg("ball %zu: %.9g, wanted %.9g", i, got, want);
        for (int a = 0; a < 4; a++) {
            double q[4] = {c[0], c[1], c[2], c[3]};
            q[a] = c[a] + h, set(p, "c", q), set(p, "r", &q[3]), evaluate(p, &up, ignored);
            q[a] = c[a] - h, set(p, "c", q), set(p, "r", &q[3]), evaluate(p, &down, ignored);
            uint32_t at = a < 3 ? base_of(p, "c") + (uint32_t)a : base_of(p, "r");
            if (fabs((up - down) / (2 * h) - g[at]) > 1e-5) fail_msg("ball %zu: derivative %d is %.9g", i, a, g[at]);
        }
    }
    slt_program_free(p);
}

static double rectangle_sum(V3 n, V3 corner, V3 u, V3 v) {
    double sum = 0;
    V3 m = cross3(u, v);
    enum { N = 800 };
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            V3 q = add3(corner, add3(mul3((i + 0.5) / N, u), mul3((j + 0.5) / N, v)));
            double r = len3(q);
            sum += fmax(0, dot3(n, q)) * fmax(0, -dot3(m, q)) / (r * r * r * r);
        }
    return sum / N / N;
}

static void test_rectangle(void **state) {
    (void)state;
    SltProgram *p = compile("import light;\nparam float3 corner = float3(0.0);\nparam float3 u = float3(0.0);\n"
                            "param float3 v = float3(0.0);\nshader float main(float2 x) { return "
                            "lamp_rectangle(float3(0.0), float3(0.0, 0.0, 1.0), corner, u, v); }\n",
                            NULL);
    /* Above, turned away, with two corners below the horizon, with one, with three, all below. */
    static const double lamps[][9] = {
        {-0.5, -0.5, 1, 0, 1, 0, 1, 0, 0},        {-0.5, -0.5, 1, 1, 0, 0, 0, 1, 0},
        {1, -0.5, -0.4, 0, 0, 1, 0, 1.2, 0},      {1, -0.5, -0.1, 0.1, -0.2, 1, 0, 1, 0.5},
        {1, -0.5, -0.9, 0.1, -0.2, 1, 0, 1, 0.5}, {1, -0.5, -2, 0, 0, 1, 0, 1, 0},
    };
    for (size_t i = 0; i < sizeof lamps / sizeof *lamps; i++) {
        const double *l = lamps[i];
        double got, g[9], up, down, ignored[9], h = 1e-5;
        static const char *names[] = {"corner", "u", "v"};
        for (int k = 0; k < 3; k++) set(p, names[k], l + 3 * k);
        evaluate(p, &got, g);
        /* The language's order makes it shine towards u x v; from the other side it is dark. */
        double want = rectangle_sum((V3){0, 0, 1}, v3(l), v3(l + 3), v3(l + 6));
        if (fabs(got - want) > 2e-4) fail_msg("lamp %zu: %.9g, wanted %.9g", i, got, want);
        for (int a = 0; a < 9; a++) {
            double q[9];
            memcpy(q, l, sizeof q);
            q[a] = l[a] + h, set(p, names[a / 3], q + a / 3 * 3), evaluate(p, &up, ignored);
            q[a] = l[a] - h, set(p, names[a / 3], q + a / 3 * 3), evaluate(p, &down, ignored);
            set(p, names[a / 3], l + a / 3 * 3);
            double got_slope = g[base_of(p, names[a / 3]) + (uint32_t)(a % 3)];
            if (fabs((up - down) / (2 * h) - got_slope) > 1e-5)
                fail_msg("lamp %zu: derivative %d is %.9g, differences %.9g", i, a, got_slope, (up - down) / (2 * h));
        }
    }
    slt_program_free(p);
}

/* Harmonics are orthonormal over the sphere; the irradiance of the radiance that they describe is its integral. */
static void test_harmonics(void **state) {
    (void)state;
    SltProgram *p = compile("import light;\nparam float3 d = float3(0.0, 0.0, 1.0);\nparam float3 c[9] = init(zero);\n"
                            "float3 zero(int i) { return float3(0.0); }\n"
                            "shader float2 main(float2 x) { return float2(harmonic_radiance(c, d).x, "
                            "harmonic_irradiance(c, d).x); }\n",
                            NULL);
    enum { N = 60 };
    double c[27], sums[9][9] = {{0}}, irradiance = 0;
    V3 n = unit3((V3){0.3, -0.5, 0.7});
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            double z = -1 + 2 * (i + 0.5) / N, a = 2 * M_PI * (j + 0.5) / N, s = sqrt(1 - z * z), y[9], v[2], g[64];
            double d[3] = {s * cos(a), s * sin(a), z}, w = 4 * M_PI / N / N, light = 0;
            set(p, "d", d);
            for (int k = 0; k < 9; k++) y[k] = 0;
            /* The derivative by coefficient k is basis function k. */
            evaluate(p, v, g);
            for (int k = 0; k < 9; k++) y[k] = g[base_of(p, "c") + 3 * (uint32_t)k], light += (k + 1) * y[k];
            for (int k = 0; k < 9; k++)
                for (int l = 0; l < 9; l++) sums[k][l] += w * y[k] * y[l];
            irradiance += w * light * fmax(0, dot3(n, v3(d)));
        }
    for (int k = 0; k < 9; k++)
        for (int l = 0; l < 9; l++) assert_true(fabs(sums[k][l] - (k == l)) < 5e-3);
    double d[3] = {n.x, n.y, n.z}, v[2], g[64];
    for (int k = 0; k < 9; k++) c[3 * k] = k + 1, c[3 * k + 1] = c[3 * k + 2] = 0;
    set(p, "d", d), set(p, "c", c), evaluate(p, v, g);
    if (fabs(v[1] - irradiance) > 1e-2) fail_msg("irradiance %.6g, wanted %.6g", v[1], irradiance);
    slt_program_free(p);
}

/* A cel-shaded ramp: the thresholds are sites of the tagged call, and move the mean. */
static void test_cel(void **state) {
    (void)state;
    SltProgram *p =
        compile("import light;\nparam float2 edge = float2(0.3, 0.6);\nshader float3 main(float2 x) { [Disc] "
                "float3 c = cel(x.x, edge, float3(0.0), float3(0.5), float3(2.0)); return c; }\n",
                NULL);
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    double v[3], g[6], se[6];
    SltIntegral out = {.struct_size = sizeof out, .value = v, .gradient = g, .gradient_stderr = se};
    job.integral = true, job.samples = 1 << 15, job.threads = 1;
    assert_int_equal(slt_grad_integral(p, &job, &out, NULL, &err), SLT_OK);
    assert_int_equal(slt_site_count(p), 2);
    assert_true(fabs(v[0] - 0.95) < 1e-2);
    assert_true(fabs(g[0] + 0.5) < 6 * se[0] + 1e-3 && fabs(g[1] + 1.5) < 6 * se[1] + 1e-3);
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_closed_forms), cmocka_unit_test(test_ball), cmocka_unit_test(test_rectangle),
        cmocka_unit_test(test_harmonics),    cmocka_unit_test(test_cel),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
