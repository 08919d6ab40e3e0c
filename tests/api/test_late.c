/* Kernels that are compiled when first called, those of lines, where cells integrate; and kernels of derivatives that
 * are kept. */
#include "bindings/c/api.h"
#include "tests/api/program.h"

static const char disc[] = "[Range(0.1, 0.9)] param float r = 0.5;\n"
                           "[Domain(-1.0, 1.0)] shader float main(float2 x) {\n"
                           "    float f = 0.25;\n"
                           "    [Disc] if (length(x) < r) f = 1.0;\n"
                           "    return f;\n"
                           "}\n";
/* Where the discs touch cells stay open, whatever their size: lines take over. */
static const char touching[] = "param float r = 0.5;\n"
                               "[Domain(-1.0, 1.0)] shader float main(float2 x) {\n"
                               "    float f = 0.25;\n"
                               "    [Disc] if (length(x - float2(0.5, 0.0)) < r) f = 1.0;\n"
                               "    [Disc] if (length(x + float2(0.5, 0.0)) < r) f = 0.5;\n"
                               "    [Disc] if (sin(40.0 * x.y) * x.x < 0.3 * rand()) f += 0.125;\n"
                               "    return f;\n"
                               "}\n";

static double gradient_of(SltProgram *p, SltEstimator estimator, uint32_t threads) {
    SltJob job = SLT_JOB_INIT;
    SltError err;
    double gradient[1];
    SltIntegral out = SLT_INTEGRAL_INIT;
    out.gradient = gradient;
    job.integral = true, job.samples = 1 << 12, job.estimator = estimator, job.threads = threads;
    assert_ok(slt_grad_integral(p, &job, &out, NULL, &err));
    return *gradient;
}

/* Of an integral f comes with its adjoints: that of the value waits on. */
static void only_value_waits(const SltProgram *p) {
    assert_int_equal(p->late.n, 1);
    assert_int_equal(p->late.kind[0], SLT_K_VALUE);
    assert_ptr_equal(p->scene.kernel[K_VALUE], slt_kernel_late);
}

/* A certified gradient calls none of them; an image calls that of the value, which is compiled alone, and has the bits
 * of a program that compiled all at once. */
static void wait_until_called(void **state) {
    (void)state;
    SltError err;
    SltProgram *p = compile(disc), *fresh = compile(disc);
    gradient_of(p, SLT_EST_QUADRATURE, 1);
    const uint32_t waited = p->late.n;
    assert_true(waited > 1);
    assert_ptr_equal(p->scene.kernel[K_VALUE], slt_kernel_late);
    assert_null(p->module_of[K_VALUE]);
    float late[16 * 16], now[16 * 16];
    SltJob job = SLT_JOB_INIT;
    job.size[0] = job.size[1] = 16;
    assert_ok(slt_render(p, &job, late, NULL, &err));
    assert_int_equal(p->late.n, waited - 1);
    assert_ptr_not_equal(p->scene.kernel[K_VALUE], slt_kernel_late);
    assert_ptr_equal(p->scene.kernel[K_EVENT], slt_kernel_late);
    assert_non_null(p->module_of[K_VALUE]);
    assert_ok(slt_render(fresh, &job, now, NULL, &err));
    assert_memory_equal(late, now, sizeof now);
    slt_program_free(p), slt_program_free(fresh);
}

/* Made by a thread of the estimate that calls them first, they are in their place behind it. */
static void made_in_an_estimate(void **state) {
    (void)state;
    double by_threads[2];
    for (uint32_t t = 0; t < 2; t++) {
        SltProgram *p = compile(touching);
        by_threads[t] = gradient_of(p, SLT_EST_QUADRATURE, 1 + 7 * t);
        only_value_waits(p);
        assert_ptr_not_equal(p->scene.kernel[K_EVENT], slt_kernel_late);
        assert_non_null(p->module_of[K_EVENT]);
        assert_null(p->late.kernel[K_EVENT]);
        slt_program_free(p);
    }
    assert_true(by_threads[0] == by_threads[1] && by_threads[0] != 0);
}

/* What forgets kernels forgets those that wait; what asks for lines gets them at once. */
static void forgotten_and_asked_for(void **state) {
    (void)state;
    SltError err;
    static const char *const wrt[] = {"r"};
    SltProgram *p = compile(disc), *fresh = compile(disc);
    gradient_of(p, SLT_EST_QUADRATURE, 1);
    assert_ok(slt_wrt(p, wrt, 1, &err));
    double lines = gradient_of(p, SLT_EST_LATTICE, 2);
    only_value_waits(p);
    assert_true(lines == gradient_of(fresh, SLT_EST_LATTICE, 1));
    api_free_kernels(p);
    assert_true(gradient_of(p, SLT_EST_QUADRATURE, 2) == gradient_of(fresh, SLT_EST_QUADRATURE, 1));
    slt_program_free(p), slt_program_free(fresh);
}

/* What both estimators need is compiled with bounds, in a module of its own; edges are in the module of bounds only
 * where cells look likely. */
static void soon(void **state) {
    (void)state;
    static const char many[] =
        "param float r = 0.01;\n"
        "[Domain(-1.0, 1.0)] shader float main(float2 x) {\n"
        "    float f = 0.0;\n"
        "    for (int i = 0; i < 200; i++) [Disc] if (length(x - 0.005 * float(i)) < r) f = 1.0;\n"
        "    return f;\n"
        "}\n";
    static const int both[] = {K_REGION, K_SIDES, K_SITE_VJP};
    for (int i = 0; i < 2; i++) {
        SltProgram *p = compile(i ? many : disc);
        gradient_of(p, SLT_EST_AUTO, 2);
        assert_non_null(p->module_of[K_BOUNDS]);
        for (size_t k = 0; k < sizeof both / sizeof *both; k++) {
            assert_non_null(p->module_of[both[k]]);
            assert_ptr_equal(p->module_of[both[k]], p->modules[1]);
        }
        assert_ptr_equal(p->module_of[K_BOUNDS], p->modules[0]);
        assert_true((p->module_of[K_EDGE] == p->module_of[K_BOUNDS]) == (i == 0));
        slt_program_free(p);
    }
}

static void no_line(void *user, const char *line, const double *values, uint32_t n) {
    (void)user, (void)line, (void)values, (void)n;
    fail();
}

/* Who listens to what a shader prints that prints nothing: its values come from the reverse kernel all the same. */
static void nothing_printed(void **state) {
    (void)state;
    uint64_t evaluations[2];
    double gradient[2], value[2];
    for (int listens = 0; listens < 2; listens++) {
        SltProgram *p = compile(touching);
        SltJob job = SLT_JOB_INIT;
        SltStats stats = SLT_STATS_INIT;
        SltError err;
        SltIntegral out = SLT_INTEGRAL_INIT;
        out.gradient = &gradient[listens], out.value = &value[listens];
        job.integral = true, job.samples = 1 << 10, job.estimator = SLT_EST_LATTICE;
        if (listens) assert_ok(slt_set_print(p, no_line, NULL, &err));
        assert_ok(slt_grad_integral(p, &job, &out, &stats, &err));
        evaluations[listens] = stats.evaluations;
        slt_program_free(p);
    }
    assert_int_equal(evaluations[0], evaluations[1]);
    assert_true(gradient[0] == gradient[1] && value[0] == value[1]);
}

/* Turns between a few things that are differentiated compile nothing again, and give what a fresh program gives. */
static void turns(void **state) {
    (void)state;
    SltError err;
    static const char source[] = "param float r = 0.5;\nparam float2 c = float2(0.1, 0.0);\nparam float a = 0.5;\n"
                                 "[Domain(-1.0, 1.0)] shader float main(float2 x) {\n"
                                 "    float f = 0.25 * a;\n"
                                 "    [Disc] if (length(x - c) < r) f = a * a;\n"
                                 "    return f;\n"
                                 "}\n";
    static const char *const names[6][1] = {{"r"}, {"c"}, {"a"}, {"c.x"}, {"c.y"}, {"r"}};
    SltJob job = SLT_JOB_INIT;
    float adjoint[16 * 16];
    double before[6][4], now[4];
    for (int i = 0; i < 256; i++) adjoint[i] = 1 + (float)(i % 7);
    job.size[0] = job.size[1] = 16, job.estimator = SLT_EST_LATTICE, job.threads = 1;
    SltProgram *p = compile(source);
    for (uint32_t few = 2; few <= 6; few += 2) { /* two, four, and more than are kept */
        uint32_t modules = 0;
        for (uint32_t round = 0; round < 3; round++)
            for (uint32_t i = 0; i < few; i++) {
                SltProgram *fresh = few == 2 || round ? NULL : compile(source);
                assert_ok(slt_wrt(p, names[i], 1, &err));
                assert_ok(slt_grad_adjoint(p, &job, adjoint, now, NULL, NULL, &err));
                if (!round) memcpy(before[i], now, sizeof now);
                assert_memory_equal(now, before[i], sizeof now);
                if (fresh) {
                    assert_ok(slt_wrt(fresh, names[i], 1, &err));
                    assert_ok(slt_grad_adjoint(fresh, &job, adjoint, before[i], NULL, NULL, &err));
                    assert_memory_equal(now, before[i], sizeof now);
                }
                slt_program_free(fresh);
                if (round == 1 && !i) modules = p->nmodules;
                if (round && few <= 4) assert_int_equal(p->nmodules, modules);
            }
    }
    slt_program_free(p);
}

/* Kernels that will run for milliseconds have one vector a value, but for those that add up adjoints in place: so each
 * bit is the same. Discs of a loop have theirs in the log, where an event is known. */
static void few_samples(void **state) {
    (void)state;
    static const char *const source[2] = {
        disc, "float radius(int i) { return 0.1 + 0.01 * float(i); }\nparam float r[40] = init(radius);\n"
              "[Domain(-1.0, 1.0)] shader float main(float2 x) {\n"
              "    float f = 0.0;\n"
              "    for (int i = 0; i < 40; i++) [Disc] if (length(x - 0.02 * float(i)) < r[i]) f += r[i];\n"
              "    return f;\n"
              "}\n"};
    for (int i = 0; i < 2; i++) {
        SltProgram *few = compile(source[i]), *many = compile(source[i]);
        double gradient[2][40];
        few->few_samples = true;
        for (int k = 0; k < 2; k++) {
            SltProgram *p = k ? few : many;
            SltIntegral out = SLT_INTEGRAL_INIT;
            SltJob job = SLT_JOB_INIT;
            SltError err;
            out.gradient = gradient[k];
            job.integral = true, job.samples = 1 << 10, job.estimator = SLT_EST_LATTICE;
            assert_ok(slt_grad_integral(p, &job, &out, NULL, &err));
            assert_int_equal(p->compiled_few[K_REGION], k);
            assert_int_equal(p->compiled_few[K_SITE_VJP], k && i);
            assert_int_equal(p->compiled_few[K_VJP], k && !i); /* of the one disc f moves with nothing */
        }
        assert_memory_equal(gradient[0], gradient[1], (i ? 40 : 1) * sizeof *gradient[0]);
        slt_program_free(few), slt_program_free(many);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(wait_until_called),
                                       cmocka_unit_test(made_in_an_estimate),
                                       cmocka_unit_test(forgotten_and_asked_for),
                                       cmocka_unit_test(soon),
                                       cmocka_unit_test(nothing_printed),
                                       cmocka_unit_test(turns),
                                       cmocka_unit_test(few_samples)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
