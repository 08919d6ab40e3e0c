/* How a fit steps: schedules of the learning rates, rates by pattern, some views an iteration. */
#include <math.h>
#include <unistd.h>

#include "saltus/fit.h"
#include "tests/api/program.h"

enum { STEPS = 24 };

static const char bowl[] =
    "param float a = 0.1;\n"
    "param float b = 0.9;\n"
    "shader float main(float2 x) { return (a - 0.75) * (a - 0.75) + 2.0 * (b - 0.3) * (b - 0.3); }\n";

typedef struct Path {
    uint32_t n;
    double at[STEPS][2], gradient[STEPS][2];
} Path;

static bool walked(void *user, const SltFitIteration *i) {
    Path *p = user;
    memcpy(p->at[p->n], i->parameters, sizeof *p->at);
    memcpy(p->gradient[p->n++], i->gradient, sizeof *p->gradient);
    return false;
}

static SltJob one_pixel(void) {
    SltJob job = SLT_JOB_INIT;
    job.size[0] = job.size[1] = 4, job.spp = 1, job.samples = 64;
    return job;
}

static void schedules(void **state) {
    (void)state;
    static const struct {
        SltFitSchedule schedule;
        double decay;
    } cases[] = {{SLT_FIT_CONSTANT, 0}, {SLT_FIT_EXPONENTIAL, 0.8}, {SLT_FIT_COSINE, 0}};
    SltJob job = one_pixel();
    for (size_t k = 0; k < 3; k++) {
        SltProgram *p = compile(bowl);
        SltFitNumber rate = {NULL, 0.05};
        SltFitOptions o = SLT_FIT_OPTIONS_INIT;
        SltError err;
        Path path = {0};
        o.job = &job, o.minimize = true, o.optimizer = "sgd", o.rates = &rate, o.nrates = 1, o.iterations = STEPS;
        o.schedule = cases[k].schedule, o.decay = cases[k].decay;
        o.iterated = walked, o.iterated_user = &path;
        assert_ok(slt_fit(p, &o, NULL, &err));
        assert_int_equal(path.n, STEPS);
        for (int i = 0; i + 1 < STEPS; i++) {
            double factor = k == 0 ? 1 : k == 1 ? pow(0.8, i) : (1 + cos(M_PI * i / STEPS)) / 2;
            for (int c = 0; c < 2; c++)
                assert_float_equal(path.at[i + 1][c] - path.at[i][c], -0.05 * factor * path.gradient[i][c], 1e-7);
        }
        o.optimizer = "lbfgs", o.iterated = NULL;
        assert_int_equal(slt_fit(p, &o, NULL, NULL), k ? SLT_USAGE : SLT_OK);
        o.optimizer = "adam", o.schedule = SLT_FIT_EXPONENTIAL, o.decay = 1.5;
        assert_int_equal(slt_fit(p, &o, NULL, NULL), SLT_USAGE);
        slt_program_free(p);
    }
}

/* A fit in rounds goes on with the schedule and the random numbers where the last round ended. */
static void rounds(void **state) {
    (void)state;
    static const char noise[] = "param float a = 0.8;\nshader float main(float2 x) { return a * a * rand(); }\n";
    SltJob job = one_pixel();
    SltProgram *p = compile(noise);
    SltFitNumber rate = {NULL, 0};
    SltFitOptions o = SLT_FIT_OPTIONS_INIT;
    SltFitResult whole = SLT_FIT_RESULT_INIT, part = SLT_FIT_RESULT_INIT;
    SltError err;
    o.job = &job, o.minimize = true, o.optimizer = "sgd", o.rates = &rate, o.nrates = 1, o.iterations = 8;
    assert_ok(slt_fit(p, &o, &whole, &err));
    o.iterations = 5, o.first = 3;
    assert_ok(slt_fit(p, &o, &part, &err));
    assert_memory_equal(whole.losses + 3, part.losses, 5 * sizeof *part.losses);
    assert_true(part.losses[0] != part.losses[1]);
    free(whole.losses), free(part.losses);
    slt_program_free(p);

    p = compile(bowl);
    Path path = {0};
    rate.value = 0.05, o.schedule = SLT_FIT_COSINE, o.planned = 20, o.iterated = walked, o.iterated_user = &path;
    assert_ok(slt_fit(p, &o, NULL, &err));
    assert_int_equal(path.n, 5);
    for (int i = 0; i + 1 < 5; i++) {
        double factor = (1 + cos(M_PI * (i + 3) / 20)) / 2;
        assert_float_equal(path.at[i + 1][0] - path.at[i][0], -0.05 * factor * path.gradient[i][0], 1e-7);
    }
    o.planned = 7;
    assert_int_equal(slt_fit(p, &o, NULL, NULL), SLT_USAGE);
    o.planned = 0, o.first = UINT32_MAX - 2;
    assert_int_equal(slt_fit(p, &o, NULL, NULL), SLT_USAGE);
    slt_program_free(p);
}

static const char discs[] = "struct Disc { float2 centre; float radius; float3 ink; };\n"
                            "param Disc discs[3] = {{float2(0.3), 0.2, float3(0.5)}, {float2(0.5), 0.2, float3(0.2)},\n"
                            "                       {float2(0.7), 0.2, float3(0.9)}};\n"
                            "[NoDiff] param float light = 1.0;\n"
                            "shader float3 main(float2 x) {\n"
                            "    float3 c = float3(0.1);\n"
                            "    for (int i = 0; i < 3; i++) {\n"
                            "        [Disc] if (length(x - discs[i].centre) < discs[i].radius) c = discs[i].ink;\n"
                            "    }\n"
                            "    return light * c;\n"
                            "}\n";

static void patterns(void **state) {
    (void)state;
    SltProgram *p = compile(discs);
    SltJob job = one_pixel();
    static float target[4 * 4 * 3];
    SltFitView view = SLT_FIT_VIEW_INIT;
    SltFitNumber rates[] = {{"discs[*].centre", 0}, {"discs[*].ink[*]", 0.2}, {"discs[1].ink", 0}};
    SltFitOptions o = SLT_FIT_OPTIONS_INIT;
    SltError err;
    double before[18];
    view.target = target;
    o.job = &job, o.views = &view, o.nviews = 1, o.iterations = 3, o.rates = rates, o.nrates = 3;
    memcpy(before, slt_floats(p), sizeof before);
    assert_ok(slt_fit(p, &o, NULL, &err));
    for (int i = 0; i < 18; i++) {
        bool held = i % 6 < 2 || (i / 6 == 1 && i % 6 >= 3);
        if ((slt_floats(p)[i] == before[i]) != held)
            fail_msg("float %d is %g, it was %g", i, slt_floats(p)[i], before[i]);
    }
    rates[0].name = "discs[*].center";
    assert_int_equal(slt_fit(p, &o, NULL, &err), SLT_USAGE);
    assert_non_null(strstr(err.text, "did you mean `centre`"));
    rates[0].name = "light[*]";
    assert_int_equal(slt_fit(p, &o, NULL, &err), SLT_USAGE);
    /* What is differentiated, too. */
    const char *names[] = {"discs[*].centre.y", "discs[2].ink"};
    assert_ok(slt_wrt(p, names, 2, &err));
    for (int i = 0; i < 18; i++) assert_int_equal(slt_wrt_mask(p)[i], i % 6 == 1 || (i / 6 == 2 && i % 6 >= 3));
    slt_program_free(p);
}

/* The loss of view v is v + 1 + 0.01 times the iteration. */
typedef struct Seen {
    uint32_t count[5], last[40], n;
} Seen;

static SltStatus graded(void *user, const SltFitRequest *q, double *loss, float *adjoint, SltError *err) {
    (void)err;
    Seen *s = user;
    s->count[q->view]++;
    s->last[q->iteration] |= 1u << q->view;
    if (q->iteration >= s->n) s->n = q->iteration + 1;
    for (uint32_t i = 0; i < q->pixels[0] * q->pixels[1] * q->channels; i++) adjoint[i] = 0.01f;
    *loss = q->view + 1 + 0.01 * q->iteration;
    return SLT_OK;
}

static void some_views(void **state) {
    (void)state;
    SltJob job = one_pixel();
    SltFitView views[5];
    SltSet light[5];
    static const char *const values[] = {"0.6", "0.7", "0.8", "0.9", "1"};
    SltFitOptions o = SLT_FIT_OPTIONS_INIT;
    SltFitResult whole = SLT_FIT_RESULT_INIT, rest = SLT_FIT_RESULT_INIT;
    SltError err;
    Seen seen = {0}, again = {0};
    char file[64];
    job.seed = 9;
    for (int v = 0; v < 5; v++) {
        light[v] = (SltSet){"light", values[v]};
        views[v] = SLT_FIT_VIEW_INIT, views[v].values = &light[v], views[v].nvalues = 1;
    }
    o.job = &job, o.views = views, o.nviews = 5, o.views_per_step = 2, o.iterations = 40;
    o.loss = graded, o.loss_user = &seen;
    SltProgram *p = compile(discs);
    assert_ok(slt_fit(p, &o, &whole, &err));
    slt_program_free(p);
    double latest[5] = {0};
    for (uint32_t i = 0; i < 40; i++) {
        double sum = 0;
        int n = 0;
        assert_int_equal(__builtin_popcount(seen.last[i]), 2);
        for (int v = 0; v < 5; v++) {
            if (seen.last[i] >> v & 1) latest[v] = v + 1 + 0.01 * i;
            if (latest[v] > 0) sum += latest[v], n++;
        }
        assert_float_equal(whole.losses[i], sum / n, 1e-12);
    }
    for (int v = 0; v < 5; v++) assert_in_range(seen.count[v], 8, 24); /* 16 each; 2.6 standard deviations */
    /* In two goes: the same choice, the same losses. */
    snprintf(file, sizeof file, "%s", "fit_steps_XXXXXX");
    int fd = mkstemp(file);
    assert_true(fd >= 0);
    close(fd);
    p = compile(discs);
    o.loss_user = &again, o.checkpoint = file, o.iterations = 17;
    assert_ok(slt_fit(p, &o, NULL, &err));
    slt_program_free(p);
    p = compile(discs);
    o.checkpoint = NULL, o.resume = file, o.iterations = 40;
    assert_ok(slt_fit(p, &o, &rest, &err));
    assert_memory_equal(again.last, seen.last, sizeof seen.last);
    assert_memory_equal(rest.losses, whole.losses, 40 * sizeof(double));
    o.views_per_step = 3;
    assert_int_equal(slt_fit(p, &o, NULL, &err), SLT_INPUT);
    o.resume = NULL, o.views_per_step = 6;
    assert_int_equal(slt_fit(p, &o, NULL, &err), SLT_USAGE);
    o.views_per_step = 2, o.optimizer = "lbfgs";
    assert_int_equal(slt_fit(p, &o, NULL, &err), SLT_USAGE);
    remove(file);
    free(whole.losses);
    free(rest.losses);
    slt_program_free(p);
}

/* The image of a view, now and at the best; looking changes nothing. */
static void images_between_steps(void **state) {
    (void)state;
    SltJob job = one_pixel();
    static float target[4 * 4 * 3], image[2][4 * 4 * 3], want[4 * 4 * 3];
    SltFitView views[2] = {SLT_FIT_VIEW_INIT, SLT_FIT_VIEW_INIT};
    SltSet light = {"light", "0.5"};
    SltFitOptions o = SLT_FIT_OPTIONS_INIT;
    SltFitResult seen = SLT_FIT_RESULT_INIT, unseen = SLT_FIT_RESULT_INIT;
    SltFitStop stop;
    SltError err;
    SltFit *fit;
    views[0].target = views[1].target = target;
    views[1].values = &light, views[1].nvalues = 1;
    o.job = &job, o.views = views, o.nviews = 2, o.iterations = 4;
    SltProgram *p = compile(discs);
    assert_ok(slt_fit_begin(p, &o, &fit, &err));
    do {
        assert_ok(slt_fit_step(fit, &stop, &err));
        for (int v = 0; v < 2; v++) assert_ok(slt_fit_image(fit, (uint32_t)v, false, NULL, image[v], &err));
        assert_ok(slt_render(p, &job, want, NULL, &err));
        assert_memory_equal(image[0], want, sizeof want);
        for (int i = 0; i < 48; i++) assert_float_equal(image[1][i], 0.5f * want[i], 1e-6);
        assert_int_equal(slt_fit_image(fit, 2, false, NULL, image[0], &err), SLT_USAGE);
        assert_ok(slt_fit_image(fit, 0, true, NULL, image[0], &err));
    } while (stop == SLT_FIT_RUNNING);
    assert_ok(slt_fit_end(fit, &seen, &err));
    assert_ok(slt_render(p, &job, want, NULL, &err));
    assert_memory_equal(image[0], want, sizeof want); /* the program has the best */
    slt_program_free(p);
    p = compile(discs);
    assert_ok(slt_fit(p, &o, &unseen, &err));
    assert_memory_equal(seen.losses, unseen.losses, 4 * sizeof(double));
    free(seen.losses);
    free(unseen.losses);
    slt_program_free(p);
}

/* [Range] and [Log] of fields, of a whole array of structs, and of both: a field's range comes first. */
static void limits_of_fields(void **state) {
    (void)state;
    static const char source[] =
        "const float MOST = 0.4;\n"
        "struct Inner { [Log] float scale; float free; };\n"
        "struct Spot { [Range(0.1, MOST)] float2 at; int n; [Range(0.0, 1.0)] float ink, paper; Inner inner[2]; };\n"
        "Spot place(int i) { Spot s; s.at = float2(0.3); s.n = i; s.ink = 0.9; s.paper = 0.9;\n"
        "    s.inner[0].scale = 1.0; s.inner[1].scale = 1.0; s.inner[0].free = 1.0; s.inner[1].free = 1.0; return s; }\n"
        "[Range(-9.0, 9.0)] param Spot spots[3] = init(place);\n"
        "shader float main(float2 x) { float f = 0.0;\n"
        "    for (int i = 0; i < 3; i++) f -= spots[i].at.x + spots[i].at.y + spots[i].ink - spots[i].paper\n"
        "        + spots[i].inner[0].scale + spots[i].inner[1].free;\n"
        "    return f; }\n";
    SltProgram *p = compile(source);
    SltJob job = one_pixel();
    SltFitNumber rate = {NULL, 0.5};
    SltFitOptions o = SLT_FIT_OPTIONS_INIT;
    SltError err;
    SltParam spots = param(p, "spots"), field = SLT_PARAM_INIT;
    assert_true(slt_param_field(&spots, 0, &field) && field.has_range && fabs(field.lo - 0.1) < 1e-7 &&
                fabs(field.hi - 0.4) < 1e-7);
    o.job = &job, o.minimize = true, o.optimizer = "sgd", o.rates = &rate, o.nrates = 1, o.iterations = 2;
    assert_ok(slt_fit(p, &o, NULL, &err));
    for (int i = 0; i < 3; i++) {
        const double *v = slt_floats(p) + 8 * i;
        assert_true(v[0] == field.hi && v[1] == field.hi); /* to the end of its range */
        assert_true(v[2] == 1 && fabs(v[3] - 0.4) < 1e-6); /* the range of both, of which one is far away */
        assert_float_equal(v[4], exp(0.5), 1e-6);          /* a step of 0.5 of its logarithm */
        assert_true(v[5] == 1 && v[6] == 1 && fabs(v[7] - 1.5) < 1e-6); /* in the range of the array */
    }
    o.iterations = 40;
    assert_ok(slt_fit(p, &o, NULL, &err));
    assert_true(slt_floats(p)[4] == 9 && slt_floats(p)[7] == 9);
    slt_program_free(p);
}

/* A step of SGD under smoothing is (I + lambda L)^-2 of the gradient: undone here, edge by edge. */
static void unsmooth(double v[24], double lambda, const int (*edges)[2], int n) {
    for (int times = 0; times < 2; times++) {
        double w[24];
        memcpy(w, v, sizeof w);
        for (int e = 0; e < n; e++) {
            double d = lambda * (v[edges[e][0]] - v[edges[e][1]]);
            w[edges[e][0]] += d, w[edges[e][1]] -= d;
        }
        memcpy(v, w, sizeof w);
    }
}

static void smoothed(const char *source, const SltSet *faces, const SltSet *flat, uint32_t channels,
                     const int (*edges)[2], int nedges) {
    SltProgram *p = compile(source);
    SltJob job = one_pixel();
    SltFitNumber rate = {NULL, 0.01}, smooth = {"v", 3};
    SltFitOptions o = SLT_FIT_OPTIONS_INIT;
    SltError err;
    double before[24];
    o.job = &job, o.minimize = true, o.optimizer = "sgd", o.rates = &rate, o.nrates = 1, o.iterations = 2;
    o.smooth = &smooth, o.nsmooth = 1, o.smooth_faces = faces, o.nsmooth_faces = faces != NULL;
    o.smooth_grids = flat, o.nsmooth_grids = flat != NULL;
    assert_int_equal(slt_float_count(p), 24);
    memcpy(before, slt_floats(p), sizeof before);
    assert_ok(slt_fit(p, &o, NULL, &err));
    for (uint32_t c = 0; c < channels; c++) {
        double step[24] = {0};
        for (uint32_t i = 0; i * channels < 24; i++)
            step[i] = (slt_floats(p)[i * channels + c] - before[i * channels + c]) / -0.01;
        unsmooth(step, 3, edges, nedges);
        for (uint32_t i = 0; i * channels < 24; i++) assert_float_equal(step[i], i * channels + c + 1.0, 1e-4);
    }
    slt_program_free(p);
}

static void smooth_volumes_and_meshes(void **state) {
    (void)state;
    /* [2][3][4]: x is the last. The gradient of number i is i + 1. */
    int grid[64][2], n = 0;
    for (int i = 0; i < 24; i++) {
        if (i % 4 < 3) grid[n][0] = i, grid[n++][1] = i + 1;
        if (i / 4 % 3 < 2) grid[n][0] = i, grid[n++][1] = i + 4;
        if (i / 12 < 1) grid[n][0] = i, grid[n++][1] = i + 12;
    }
    smoothed("float zero(int i, int j, int k) { return 0.0; }\n"
             "param float v[2][3][4] = init(zero);\n"
             "shader float main(float2 x) { float f = 0.0;\n"
             "    for (int i = 0; i < 24; i++) f += v[i / 12][i / 4 % 3][i % 4] * (i + 1);\n"
             "    return f; }\n",
             NULL, NULL, 1, grid, n);
    static const char list[] = "float zero(int i) { return 0.0; }\n"
                               "param float v[24] = init(zero);\n"
                               "shader float main(float2 x) { float f = 0.0;\n"
                               "    for (int i = 0; i < 24; i++) f += v[i] * (i + 1);\n"
                               "    return f; }\n";
    SltSet flat = {"v", "4x3x2"};
    smoothed(list, NULL, &flat, 1, grid, n);
    static const char mesh[] = "float3 zero(int i) { return float3(0.0); }\n"
                               "param float3 v[8] = init(zero);\n"
                               "param int3 f[3] = {int3(0, 1, 2), int3(2, 1, 3), int3(4, 5, 6)};\n"
                               "shader float main(float2 x) { float s = 0.0;\n"
                               "    for (int i = 0; i < 24; i++) s += v[i / 3][i % 3] * (i + 1);\n"
                               "    return s; }\n";
    static const int edges[][2] = {{0, 1}, {1, 2}, {2, 0}, {1, 3}, {3, 2}, {4, 5}, {5, 6}, {6, 4}};
    SltSet faces = {"v", "f"};
    smoothed(mesh, &faces, NULL, 3, edges, 8);
    /* Faces that are none. */
    SltProgram *p = compile(mesh);
    SltFitNumber smooth = {"v", 3};
    SltFitOptions o = SLT_FIT_OPTIONS_INIT;
    SltError err;
    int32_t far = 8;
    o.minimize = true, o.smooth = &smooth, o.nsmooth = 1, o.smooth_faces = &faces, o.nsmooth_faces = 1;
    assert_ok(slt_set_ints(p, 4, 1, &far, &err));
    assert_int_equal(slt_fit(p, &o, NULL, &err), SLT_INPUT);
    assert_non_null(strstr(err.text, "face 1 of `f` has the vertex 8"));
    faces.value = "v";
    assert_int_equal(slt_fit(p, &o, NULL, &err), SLT_USAGE);
    slt_program_free(p);
    static const char *const wrong[] = {"4x3", "4x3x3", "4x3x2x1", "4x3x2 ", "24", "", "x"};
    p = compile(list);
    o.smooth_faces = NULL, o.nsmooth_faces = 0, o.smooth_grids = &flat, o.nsmooth_grids = 1;
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        flat.value = wrong[i];
        assert_int_equal(slt_fit(p, &o, NULL, &err), SLT_USAGE);
        assert_non_null(strstr(err.text, "`v` is no grid of"));
    }
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(schedules),
                                       cmocka_unit_test(patterns),
                                       cmocka_unit_test(some_views),
                                       cmocka_unit_test(images_between_steps),
                                       cmocka_unit_test(rounds),
                                       cmocka_unit_test(limits_of_fields),
                                       cmocka_unit_test(smooth_volumes_and_meshes)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
