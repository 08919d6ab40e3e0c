/* slt_eval: f at given points, whatever their number and wherever they are; print(). */
#include <math.h>

#include "tests/api/program.h"

static const char disc[] = "param float r = 0.5;\n"
                           "param int k = 3;\n"
                           "[Domain(-1.0, 1.0)] shader float3 main(float2 x) {\n"
                           "    float f = 0.0;\n"
                           "    [Disc] if (length(x) < r) f = 1.0;\n"
                           "    return float3(f, x.x + 2.0 * x.y, float(k));\n"
                           "}\n";
static const char noisy[] = "[Domain(0.0, 1.0)] shader float2 main(float x) { return float2(rand(), rand()); }\n";

/* Points far outside the domain are points like others. */
static double place(uint64_t i, uint32_t d) { return 3 * sin(0.37 * (double)i + 1.3 * d); }

static void values(void **state) {
    (void)state;
    SltError err;
    for (int form = 0; form < 4; form++) {
        SltOptions opt = SLT_OPTIONS_INIT;
        opt.f64 = form & 1, opt.interpret = form & 2;
        SltProgram *p = compile_with(disc, opt);
        uint64_t counts[] = {0, 1, 63, 64, 1025, opt.interpret ? 3000 : 1000000};
        for (size_t c = 0; c < sizeof counts / sizeof *counts; c++) {
            uint64_t n = counts[c];
            double *x = malloc((2 * n + 1) * sizeof *x), *out[2];
            for (uint64_t i = 0; i < 2 * n; i++) x[i] = place(i / 2, i % 2);
            for (uint32_t t = 0; t < 2; t++) {
                SltJob job = SLT_JOB_INIT;
                SltStats stats = SLT_STATS_INIT;
                job.threads = 1 + 3 * t;
                out[t] = malloc((3 * n + 1) * sizeof *out[t]);
                out[t][3 * n] = 12345;
                assert_ok(slt_eval(p, &job, n, x, NULL, out[t], &stats, &err));
                assert_int_equal(stats.samples, n);
                assert_int_equal(stats.evaluations, n);
                assert_true(out[t][3 * n] == 12345);
            }
            assert_memory_equal(out[0], out[1], 3 * n * sizeof **out);
            for (uint64_t i = 0; i < n; i++) {
                double u = x[2 * i], v = x[2 * i + 1], eps = opt.f64 ? 1e-14 : 1e-5;
                if (fabs(hypot(u, v) - 0.5) > 1e-5) assert_true(out[0][3 * i] == (hypot(u, v) < 0.5 ? 1 : 0));
                assert_true(fabs(out[0][3 * i + 1] - (u + 2 * v)) < eps);
                assert_true(out[0][3 * i + 2] == 3);
            }
            free(x), free(out[0]), free(out[1]);
        }
        slt_program_free(p);
    }
}

/* NaN and infinities go in; what comes out is the shader's. */
static void strange_points(void **state) {
    (void)state;
    static const char *const sources[] = {
        disc,
        "[Extent(0, 0, 1, 1)] [Height(0.5, 0.0)] param heightfield h = zeros(9, 9);\n"
        "shader float3 main(float2 x) {\n"
        "    [NoDisc] Hit v = h.trace(float3(x, 2.0), float3(0.1, 0.2, -1.0), 0.0, 1e9);\n"
        "    return float3(v.hit ? v.t : 0.0, h.height(x), h.normal(x).x);\n"
        "}\n",
        "import noise;\n"
        "shader float3 main(float2 x) {\n"
        "    float a[5];\n"
        "    for (int i = 0; i < 5; i++) a[i] = float(i);\n"
        "    return float3(a[int(x.x) % 5 < 0 ? 0 : int(x.x) % 5], voronoi(x).y, floor(x.y));\n"
        "}\n"};
    static const double strange[] = {NAN, -NAN, INFINITY, -INFINITY, 1e300, -1e300, 1e38, 5e-324, -0.0, 0.5};
    enum { N = sizeof strange / sizeof *strange };
    double x[N * N][2], out[N * N][3];
    SltError err;
    for (int i = 0; i < N * N; i++) x[i][0] = strange[i / N], x[i][1] = strange[i % N];
    for (size_t s = 0; s < sizeof sources / sizeof *sources; s++)
        for (int form = 0; form < 4; form++) {
            SltOptions opt = SLT_OPTIONS_INIT;
            opt.f64 = form & 1, opt.interpret = form & 2;
            SltProgram *p = compile_with(sources[s], opt);
            SltStats stats = SLT_STATS_INIT;
            assert_ok(slt_eval(p, NULL, N * N, *x, NULL, *out, &stats, &err));
            assert_int_equal(stats.samples, N * N);
            slt_program_free(p);
        }
}

/* rand() at a point is a matter of the seed and the point's stream alone. */
static void streams(void **state) {
    (void)state;
    enum { N = 4000 };
    static double x[N], all[N][2], some[N / 2][2], other[N][2];
    static uint32_t odd[N / 2];
    double sum = 0;
    SltError err;
    SltProgram *p = compile(noisy);
    SltJob job = SLT_JOB_INIT;
    for (int i = 0; i < N; i++) x[i] = (double)i / N;
    for (uint32_t i = 0; i < N / 2; i++) odd[i] = 2 * i + 1;
    assert_ok(slt_eval(p, &job, N, x, NULL, *all, NULL, &err));
    assert_ok(slt_eval(p, &job, N / 2, x, odd, *some, NULL, &err));
    for (int i = 0; i < N / 2; i++) assert_memory_equal(some[i], all[2 * i + 1], sizeof *some);
    job.seed = 1;
    assert_ok(slt_eval(p, &job, N, x, NULL, *other, NULL, &err));
    for (int i = 0; i < N; i++) {
        for (int c = 0; c < 2; c++) assert_true(all[i][c] >= 0 && all[i][c] < 1), sum += all[i][c] / (2 * N);
        assert_true(all[i][0] != all[i][1]);
        assert_memory_not_equal(all[i], other[i], sizeof *all);
        if (i) assert_memory_not_equal(all[i], all[i - 1], sizeof *all);
    }
    assert_true(fabs(sum - 0.5) < 0.02);
    slt_program_free(p);
}

static void refused(void **state) {
    (void)state;
    double x[2] = {0, 0}, out[3];
    SltError err;
    SltOptions opt = SLT_OPTIONS_INIT;
    opt.rgba8 = true;
    SltProgram *p = compile_with(disc, opt);
    assert_int_equal(slt_eval(p, NULL, 1, x, NULL, out, NULL, &err), SLT_USAGE);
    slt_program_free(p);
    p = compile(disc);
    volatile int cancel = 1;
    SltJob job = SLT_JOB_INIT;
    job.cancel = &cancel;
    assert_int_equal(slt_eval(p, &job, 1, x, NULL, out, NULL, &err), SLT_INTERRUPTED);
    assert_ok(slt_eval(p, NULL, 1, x, NULL, out, NULL, NULL));
    slt_program_free(p);
    opt = SLT_OPTIONS_INIT;
    opt.stdlib_dir = SALTUS_STDLIB_BUILD;
    assert_int_equal(slt_compile_string("shader float main(float2 x) { return y; }", "t", &opt, &p), SLT_PROGRAM);
    assert_int_equal(slt_eval(p, NULL, 1, x, NULL, out, NULL, &err), SLT_USAGE);
    assert_int_equal(slt_set_floats(p, 0, 0, NULL, &err), SLT_USAGE);
    assert_int_equal(slt_wrt(p, NULL, 0, &err), SLT_USAGE);
    assert_null(slt_params_json(p));
    assert_int_equal(slt_dim(p) + slt_channels(p) + slt_float_count(p) + slt_param_count(p) + slt_site_count(p), 0);
    slt_program_free(p);
}

typedef struct Lines {
    char text[4][64];
    double value[4];
    uint32_t n;
} Lines;

static void keep(void *user, const char *line, const double *values, uint32_t n) {
    Lines *k = user;
    assert_true(k->n < 4 && n == 2);
    snprintf(k->text[k->n], sizeof k->text[0], "%s", line);
    k->value[k->n++] = values[1];
}

static void prints(void **state) {
    (void)state;
    static const char source[] = "shader float main(float x) {\n"
                                 "    print(\"x {} and {}.\", x, 2.0 * x);\n"
                                 "    return x;\n"
                                 "}\n";
    double x[2] = {0.25, 0.75}, out[2];
    SltError err;
    for (int interpret = 0; interpret < 2; interpret++) {
        SltOptions opt = SLT_OPTIONS_INIT;
        opt.interpret = interpret;
        SltProgram *p = compile_with(source, opt);
        Lines lines = {0};
        assert_ok(slt_eval(p, NULL, 2, x, NULL, out, NULL, &err));
        assert_ok(slt_set_print(p, keep, &lines, &err));
        assert_ok(slt_eval(p, NULL, 2, x, NULL, out, NULL, &err));
        assert_int_equal(lines.n, 2);
        assert_string_equal(lines.text[0], "x 0.25 and 0.5.");
        assert_string_equal(lines.text[1], "x 0.75 and 1.5.");
        assert_true(lines.value[0] == 0.5 && lines.value[1] == 1.5);
        assert_ok(slt_set_print(p, NULL, NULL, &err));
        assert_ok(slt_eval(p, NULL, 2, x, NULL, out, NULL, &err));
        assert_int_equal(lines.n, 2);
        slt_program_free(p);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(values), cmocka_unit_test(strange_points),
                                       cmocka_unit_test(streams), cmocka_unit_test(refused), cmocka_unit_test(prints)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
