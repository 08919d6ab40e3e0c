/* Losses of a fit against differences of what they say they are, of exact pixels, where nothing is random. */
#include <math.h>

#include "saltus/fit.h"
#include "tests/api/program.h"

enum { W = 9, H = 7, CHANNELS = 3, VALUES = W * H * CHANNELS };

static const char disc[] = "param float2 centre = float2(0.45, 0.52);\n"
                           "param float radius = 0.3;\n"
                           "param float3 ink = float3(0.2, 0.5, 0.8);\n"
                           "shader float3 main(float2 x) {\n"
                           "    float3 c = float3(0.7 * x.x, 0.6, 0.4 + 0.2 * x.y);\n"
                           "    [Disc] if (length(x - centre) < radius) c = ink + 0.1 * x.y;\n"
                           "    return c;\n"
                           "}\n";
static float target[VALUES], mask[VALUES];

static SltProgram *in_f64(const char *source) {
    SltOptions opt = SLT_OPTIONS_INIT;
    opt.f64 = true;
    return compile_with(source, opt);
}

static SltJob exact_job(void) {
    SltJob job = SLT_JOB_INIT;
    job.size[0] = W, job.size[1] = H, job.estimator = SLT_EST_QUADRATURE, job.interior = SLT_INTERIOR_QUADRATURE;
    job.abs_error = 1e-9;
    return job;
}

static int set_up(void **state) {
    (void)state;
    for (int i = 0; i < VALUES; i++) target[i] = 0.5f + 0.4f * sinf(0.7f * (float)i), mask[i] = i % 5 ? 1 : 0.25f;
    return 0;
}

/* The loss and the gradient of the first iteration. */
typedef struct First {
    double loss, gradient[16];
    uint32_t count;
} First;

static bool first(void *user, const SltFitIteration *at) {
    First *f = user;
    f->loss = at->loss, f->count = at->count;
    assert_true(at->count <= 16);
    memcpy(f->gradient, at->gradient, at->count * sizeof *f->gradient);
    return true;
}

static First evaluate(SltProgram *p, SltFitOptions o) {
    First f = {0};
    SltError err = {0};
    o.iterated = first, o.iterated_user = &f;
    if (slt_fit(p, &o, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
    return f;
}

static double said(SltFitMetric metric, double delta, const float *image) {
    double sum = 0;
    for (int i = 0; i < VALUES; i++) {
        double d = fabs((double)image[i] - (double)target[i]);
        double v = metric == SLT_FIT_L2   ? d * d
                   : metric == SLT_FIT_L1 ? d
                   : d < delta            ? d * d / 2
                                          : delta * (d - delta / 2);
        sum += (double)mask[i] * v / VALUES;
    }
    return sum;
}

static double loss_at(SltProgram *p, const SltJob *job, SltFitMetric metric, double delta, uint32_t which,
                      double step) {
    static float image[VALUES];
    SltError err = {0};
    double x[16];
    SltJob own = *job;
    memcpy(x, slt_floats(p), slt_float_count(p) * sizeof *x);
    x[which] += step;
    own.floats = x;
    if (slt_render(p, &own, image, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
    return said(metric, delta, image);
}

static void metrics_agree_with_differences(void **state) {
    (void)state;
    static const struct {
        SltFitMetric metric;
        double delta;
    } cases[] = {{SLT_FIT_L2, 0}, {SLT_FIT_L1, 0}, {SLT_FIT_HUBER, 0}, {SLT_FIT_HUBER, 0.02}, {SLT_FIT_HUBER, 10}};
    SltJob job = exact_job();
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        SltProgram *p = in_f64(disc);
        SltFitView view = SLT_FIT_VIEW_INIT;
        SltFitOptions o = SLT_FIT_OPTIONS_INIT;
        view.target = target, view.mask = mask;
        o.job = &job, o.views = &view, o.nviews = 1, o.metric = cases[k].metric, o.huber_delta = cases[k].delta;
        double delta = cases[k].delta > 0 ? cases[k].delta : 0.1, h = 2e-4;
        First f = evaluate(p, o);
        assert_float_equal(f.loss, loss_at(p, &job, o.metric, delta, 0, 0), 1e-7);
        assert_int_equal(f.count, 6);
        for (uint32_t i = 0; i < f.count; i++) {
            double d = (loss_at(p, &job, o.metric, delta, i, h) - loss_at(p, &job, o.metric, delta, i, -h)) / (2 * h);
            if (!(fabs(d - f.gradient[i]) < 2e-4))
                fail_msg("metric %d, delta %g: d/d%u is %.8f by differences, %.8f", (int)o.metric, delta, i, d,
                         f.gradient[i]);
        }
        slt_program_free(p);
    }
}

static void metrics_refused(void **state) {
    (void)state;
    SltProgram *p = in_f64(disc);
    SltError err = {0};
    SltJob job = exact_job();
    SltFitView view = SLT_FIT_VIEW_INIT;
    SltFitOptions o = SLT_FIT_OPTIONS_INIT;
    view.target = target;
    o.job = &job, o.views = &view, o.nviews = 1, o.metric = (SltFitMetric)3;
    assert_int_equal(slt_fit(p, &o, NULL, &err), SLT_USAGE);
    o.metric = SLT_FIT_HUBER, o.huber_delta = -1;
    assert_int_equal(slt_fit(p, &o, NULL, &err), SLT_USAGE);
    o = SLT_FIT_OPTIONS_INIT;
    o.job = &job, o.minimize = true, o.metric = SLT_FIT_L1;
    assert_int_equal(slt_fit(p, &o, NULL, &err), SLT_USAGE);
    slt_program_free(p);
}

/* Two entries of one source. The first view is of the second, which also has a parameter of its own. */
static const char two[] = "param float2 centre = float2(0.45, 0.52);\n"
                          "param float radius = 0.3;\n"
                          "param float wide = 1.5;\n"
                          "[NoDiff] param float gain = 0.8;\n"
                          "float soft(float3 image, float3 target) {\n"
                          "    float3 d = image - target;\n"
                          "    return wide * sqrt(dot(d, d) + 0.01) + image.x * target.y;\n"
                          "}\n"
                          "shader float3 main(float2 x) {\n"
                          "    float3 c = float3(0.7 * x.x, 0.6, 0.4 + 0.2 * x.y);\n"
                          "    [Disc] if (length(x - centre) < radius) c = gain * float3(0.2, 0.5, x.x);\n"
                          "    return c;\n"
                          "}\n"
                          "shader float2 flat(float2 x) {\n"
                          "    float2 c = float2(0.2, x.y);\n"
                          "    [Disc] if (x.x < centre.x + radius * x.y) c = float2(0.5, 0.1) * wide * gain;\n"
                          "    return c;\n"
                          "}\n";

static SltProgram *entry(const char *name) {
    SltOptions opt = SLT_OPTIONS_INIT;
    opt.f64 = true, opt.entry = name;
    return compile_with(two, opt);
}

static void draw(SltProgram *p, const SltJob *job, float *image) {
    SltError err = {0};
    if (slt_render(p, job, image, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
}

static void set(SltProgram *p, uint32_t which, double v) {
    SltError err = {0};
    if (slt_set_floats(p, which, 1, &v, &err) != SLT_OK) fail_msg("%s", err.text);
}

/* The loss of `soft` by hand; float 3 is `wide`. */
static double soft_at(SltProgram *p, const SltJob *job, uint32_t which, double step) {
    static float image[VALUES];
    double old = slt_floats(p)[which], sum = 0;
    set(p, which, old + step);
    draw(p, job, image);
    for (int i = 0; i < W * H; i++) {
        double dot = 0.01;
        for (int c = 0; c < 3; c++) dot += pow((double)image[3 * i + c] - (double)target[3 * i + c], 2);
        sum += slt_floats(p)[3] * sqrt(dot) + (double)image[3 * i] * (double)target[3 * i + 1];
    }
    set(p, which, old);
    return sum / (W * H);
}

static void entries_agree_with_differences(void **state) {
    (void)state;
    SltProgram *p = entry("main");
    SltJob job = exact_job();
    SltFitView view = SLT_FIT_VIEW_INIT;
    SltFitOptions o = SLT_FIT_OPTIONS_INIT;
    view.target = target;
    o.job = &job, o.views = &view, o.nviews = 1, o.loss_entry = "soft";
    First f = evaluate(p, o);
    assert_float_equal(f.loss, soft_at(p, &job, 0, 0), 1e-7);
    assert_int_equal(f.count, 4);
    for (uint32_t i = 0; i < f.count; i++) {
        double h = 2e-4, d = (soft_at(p, &job, i, h) - soft_at(p, &job, i, -h)) / (2 * h);
        if (!(fabs(d - f.gradient[i]) < 2e-4)) fail_msg("d%u: %.8f by differences, %.8f", i, d, f.gradient[i]);
    }
    SltError err = {0};
    o.loss_entry = "hard";
    assert_int_equal(slt_fit(p, &o, NULL, &err), SLT_USAGE);
    assert_non_null(strstr(err.text, "float hard(float3 image, float3 target)"));
    o.loss_entry = "soft(image) + 1";
    assert_int_equal(slt_fit(p, &o, NULL, &err), SLT_USAGE);
    o.loss_entry = "soft", o.metric = SLT_FIT_L1;
    assert_int_equal(slt_fit(p, &o, NULL, &err), SLT_USAGE);
    slt_program_free(p);
}

static double both_at(SltProgram *p, SltProgram *q, const SltJob *job, const float *flat, uint32_t which, double step) {
    static float image[VALUES];
    double old[2] = {slt_floats(p)[which], slt_floats(q)[which]}, sum[2] = {0, 0};
    set(p, which, old[0] + step), set(q, which, old[0] + step), set(q, 4, 0.6); /* gain, in that view */
    draw(q, job, image);
    for (int i = 0; i < W * H * 2; i++) sum[0] += pow((double)image[i] - (double)flat[i], 2) / (W * H * 2);
    draw(p, job, image);
    for (int i = 0; i < VALUES; i++) sum[1] += pow((double)image[i] - (double)target[i], 2) / VALUES;
    set(p, which, old[0]), set(q, which, old[1]);
    return (sum[0] + sum[1]) / 2;
}

static void views_of_other_entries(void **state) {
    (void)state;
    static float flat[W * H * 2];
    SltProgram *p = entry("main"), *q = entry("flat");
    SltJob job = exact_job();
    SltFitView views[2] = {SLT_FIT_VIEW_INIT, SLT_FIT_VIEW_INIT};
    SltSet dim = {"gain", "0.6"};
    SltFitOptions o = SLT_FIT_OPTIONS_INIT;
    SltError err = {0};
    memcpy(flat, target, sizeof flat);
    views[0].target = flat, views[0].program = q, views[0].values = &dim, views[0].nvalues = 1;
    views[1].target = target;
    o.job = &job, o.views = views, o.nviews = 2;
    set(q, 1, 0.9); /* the fit's value counts */
    First f = evaluate(p, o);
    assert_float_equal(f.loss, both_at(p, q, &job, flat, 0, 0), 1e-7);
    for (uint32_t i = 0; i < f.count; i++) {
        double h = 2e-4, d = (both_at(p, q, &job, flat, i, h) - both_at(p, q, &job, flat, i, -h)) / (2 * h);
        if (!(fabs(d - f.gradient[i]) < 2e-4)) fail_msg("d%u: %.8f by differences, %.8f", i, d, f.gradient[i]);
    }
    /* While the fit lasts the view's program is its own too. */
    SltFit *fit;
    assert_int_equal(slt_fit_begin(p, &o, &fit, &err), SLT_OK);
    assert_int_equal(slt_wrt(q, NULL, 0, &err), SLT_USAGE);
    slt_program_free(q);
    assert_int_equal(slt_fit_end(fit, NULL, &err), SLT_OK);
    assert_int_equal(slt_wrt(q, NULL, 0, &err), SLT_OK);
    /* Images of other shapes have no one loss function, other parameters of the same name no one value. */
    o.loss_entry = "soft";
    assert_int_equal(slt_fit(p, &o, NULL, &err), SLT_USAGE);
    o.loss_entry = NULL, views[0].program = in_f64("param float3 centre = float3(0.5);\n"
                                                   "shader float main(float2 x) { return centre.x; }\n");
    assert_int_equal(slt_fit(p, &o, NULL, &err), SLT_USAGE);
    assert_non_null(strstr(err.text, "`centre` has another shape"));
    slt_program_free(views[0].program);
    slt_program_free(p);
    slt_program_free(q);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(metrics_agree_with_differences), cmocka_unit_test(metrics_refused),
        cmocka_unit_test(entries_agree_with_differences), cmocka_unit_test(views_of_other_entries)};
    return cmocka_run_group_tests(tests, set_up, NULL);
}
