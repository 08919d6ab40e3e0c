/* mlp.salt: neurons and activations by formula, also where exp would overflow; encodings; the spread of first weights;
 * a binary neuron whose boundary moves. */
#include "tests/stdlib/table.h"

static double dot_of(const double *w, const double *x, int n) {
    double sum = 0;
    for (int i = 0; i < n; i++) sum += w[i] * x[i];
    return sum;
}
static double neuron2(const double *v) { return v[2] + dot_of(v, v + 3, 2); }
static double neuron3(const double *v) { return v[3] + dot_of(v, v + 4, 3); }
static double neuron4(const double *v) { return v[4] + dot_of(v, v + 5, 4); }
static double repeated(const double *v, int n) { /* w[i] = v[i % 7], x[i] = v[i % 5 + 8] */
    double sum = v[15];
    for (int i = 0; i < n; i++) sum += v[i % 7] * v[i % 5 + 8];
    return sum;
}
static double neuron8(const double *v) { return repeated(v, 8); }
static double neuron16(const double *v) { return repeated(v, 16); }
static double neuron32(const double *v) { return repeated(v, 32); }
static double neuron64(const double *v) { return repeated(v, 64); }
static double relu(const double *v) { return fmax(0, v[0]) + 2 * fmax(0, v[1]); }
static double leaky(const double *v) { return v[0] > 0 ? v[0] : 0.1 * v[0]; }
static double sigmoid(const double *v) { return 1 / (1 + exp(-4 * v[0])); }
static double softplus(const double *v) { return log1p(exp(-fabs(40 * v[0]))) + fmax(0, 40 * v[0]); }
static double silu(const double *v) { return v[0] / (1 + exp(-v[0])); }
static double gelu(const double *v) { return v[0] * 0.5 * erfc(-v[0] / sqrt(2)); }
static double elu(const double *v) { return v[0] > 0 ? v[0] : expm1(v[0]); }
static double siren(const double *v) { return sin(30 * v[0]); }
static double bump(const double *v) { return exp(-v[0] * v[0] / 0.18); }
static double fourier(const double *v) { return sin(8 * M_PI * v[0]) + 2 * cos(8 * M_PI * v[0]); }

#define ARRAYS(n)                                                                                  \
    "float w[" #n "]; float x[" #n "]; for (int i = 0; i < " #n "; i++) { w[i] = v[i % 7]; x[i] = " \
    "v[i % 5 + 8]; } return neuron(w, v[15], x);"
static const Case cases[] = {
    {.body = "neuron(" VEC2(0) ", v[2], " VEC2(3) ")", .want = neuron2},
    {.body = "neuron(" VEC3(0) ", v[3], " VEC3(4) ")", .want = neuron3},
    {.body = "neuron(" VEC4(0) ", v[4], " VEC4(5) ")", .want = neuron4},
    {.body = "float w[2] = {v[0], v[1]}, x[2] = {v[3], v[4]}; return neuron(w, v[2], x);", .want = neuron2},
    {.body = "float w[3] = {v[0], v[1], v[2]}, x[3] = {v[4], v[5], v[6]}; return neuron(w, v[3], x);", .want = neuron3},
    {.body = "float w[4] = {v[0], v[1], v[2], v[3]}, x[4] = {v[5], v[6], v[7], v[8]}; return neuron(w, v[4], x);",
     .want = neuron4},
    {.body = ARRAYS(8), .want = neuron8},
    {.body = ARRAYS(16), .want = neuron16},
    {.body = ARRAYS(32), .want = neuron32},
    {.body = ARRAYS(64), .want = neuron64},
    {.body = "relu(v[0]) + relu(float4(v[1])).z * 2.0", .want = relu},
    {.body = "leaky_relu(v[0], 0.1)", .want = leaky},
    {.body = "0.5 * sigmoid(4.0 * v[0]) + 0.5 * sigmoid(4.0 * " VEC4(0) ").x", .want = sigmoid},
    {.body = "softplus(40.0 * v[0])", .want = softplus},
    {.body = "silu(v[0])", .want = silu},
    {.body = "gelu(v[0])", .want = gelu},
    {.body = "elu(v[0])", .want = elu},
    {.body = "siren(v[0], 30.0)", .want = siren, .lo = -0.1, .hi = 0.1},
    {.body = "bump(v[0], 0.3)", .want = bump},
    {.body = "dot(fourier(v[0], 3), float2(1.0, 2.0))", .want = fourier, .lo = -0.2, .hi = 0.2},
};

static void test_closed_forms(void **state) {
    (void)state;
    TABLE_RUN("mlp", cases);
}

/* No infinity and no NaN far out, in values and derivatives. */
static void test_far_out(void **state) {
    (void)state;
    SltProgram *p =
        compile("import mlp;\nparam float v = 0.0;\nshader float4 main(float2 x) { return float4(sigmoid(v), "
                "softplus(v), silu(v), elu(v)); }\n",
                NULL);
    for (int k = 0; k < 2; k++) {
        double at = k ? 1e5 : -1e5, v[4], g[4], want[4] = {k, k * 1e5, k * 1e5, k ? 1e5 : -1}, slope[4] = {0, k, k, k};
        set(p, "v", &at), evaluate(p, v, g);
        for (int i = 0; i < 4; i++) {
            if (!(fabs(v[i] - want[i]) < 1e-9)) fail_msg("%d at %g: %g", i, at, v[i]);
            if (!(fabs(g[i] - slope[i]) < 1e-9)) fail_msg("derivative %d at %g: %g", i, at, g[i]);
        }
    }
    slt_program_free(p);
}

/* Rows of a table of features: as Mueller et al. compute them. */
static void test_rows(void **state) {
    (void)state;
    SltProgram *p = compile("import mlp;\nparam int3 c = int3(0);\nshader float2 main(float2 x) { return "
                            "float2(feature_row(c.xy, 16384), feature_row(c, 5000)); }\n",
                            NULL);
    SltParam q = SLT_PARAM_INIT;
    SltError err = {0};
    assert_int_equal(slt_param_find(p, "c", &q, &err), SLT_OK);
    uint32_t seed = 5;
    for (int i = 0; i < 40; i++) {
        int32_t c[3];
        double v[2], g[2];
        for (int a = 0; a < 3; a++) c[a] = (int32_t)(2000 * uniform(&seed)) - 1000;
        assert_int_equal(slt_set_ints(p, q.ibase, 3, c, &err), SLT_OK);
        evaluate(p, v, g);
        uint32_t h = (uint32_t)c[0] ^ ((uint32_t)c[1] * 2654435761u);
        assert_true(v[0] == h % 16384 && v[1] == (h ^ ((uint32_t)c[2] * 805459861u)) % 5000);
    }
    slt_program_free(p);
}

/* First weights fill their interval: the mean is 0, the mean square a third of its square. */
static void test_first_weights(void **state) {
    (void)state;
    SltProgram *p =
        compile("import mlp;\nfloat a(int i) { return he(6); }\nfloat b(int i) { return glorot(8, 16); }\n"
                "float c(int i) { return siren_first(5); }\nfloat d(int i) { return siren_weight(24, 30.0); }\n"
                "param float wa[4000] = init(a);\nparam float wb[4000] = init(b);\nparam float wc[4000] = "
                "init(c);\nparam float wd[4000] = init(d);\n"
                "shader float main(float2 x) { return wa[0] + wb[0] + wc[0] + wd[0]; }\n",
                NULL);
    static const char *names[] = {"wa", "wb", "wc", "wd"};
    double limits[] = {1, 0.5, 0.2, 0.5 / 30};
    for (int k = 0; k < 4; k++) {
        double sum = 0, square = 0, largest = 0;
        const double *w = slt_floats(p) + base_of(p, names[k]);
        for (int i = 0; i < 4000; i++) {
            double q = w[i] / limits[k];
            sum += q, square += q * q, largest = fmax(largest, fabs(q));
        }
        assert_true(largest <= 1 && largest > 0.99);
        assert_true(fabs(sum / 4000) < 0.04 && fabs(square / 4000 - 1.0 / 3) < 0.02);
    }
    slt_program_free(p);
}

/* A binary neuron, tagged at its call: 1 where x < a + b y, so the mean is a + b / 2. */
static void test_heaviside(void **state) {
    (void)state;
    SltProgram *p = compile("import mlp;\nparam float2 w = float2(-1.0, 0.2);\nparam float b = 0.4;\nshader float "
                            "main(float2 x) { [Disc] return heaviside(neuron(w, b, x)); }\n",
                            NULL);
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    double v, g[3], se[3];
    SltIntegral out = {.struct_size = sizeof out, .value = &v, .gradient = g, .gradient_stderr = se};
    job.integral = true, job.samples = 1 << 15, job.threads = 1;
    assert_int_equal(slt_grad_integral(p, &job, &out, NULL, &err), SLT_OK);
    assert_int_equal(slt_site_count(p), 1);
    uint32_t w = base_of(p, "w"), b = base_of(p, "b");
    /* x < (b + w1 y) / -w0: the mean is (b + w1 / 2) / -w0. */
    double want[3];
    want[b] = 1, want[w + 1] = 0.5, want[w] = 0.5;
    assert_true(fabs(v - 0.5) < 1e-2);
    for (int i = 0; i < 3; i++)
        if (fabs(g[i] - want[i]) > 6 * se[i] + 1e-3) fail_msg("derivative %d: %.6g +- %.2g", i, g[i], se[i]);
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_closed_forms),  cmocka_unit_test(test_far_out),   cmocka_unit_test(test_rows),
        cmocka_unit_test(test_first_weights), cmocka_unit_test(test_heaviside),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
