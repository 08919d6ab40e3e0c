/* Who may use a program: one call at a time. A second one is told so, whether it comes from another thread or from a
 * callback; different programs do not meet. */
#include <math.h>
#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>

#include "tests/api/program.h"

static const char source[] = "param float r = 0.5;\n"
                             "[Domain(-1.0, 1.0)] shader float main(float2 x) {\n"
                             "    float f = 0.0;\n"
                             "    [Disc] if (length(x) < r) f = 1.0;\n"
                             "    print(\"{}\", f);\n"
                             "    return f;\n"
                             "}\n";

enum { SIDE = 64, THREADS = 4 };

/* Everything that touches what changes, while another call is under way. */
static void assert_busy(SltProgram *p) {
    SltError err = {0};
    SltParam q = SLT_PARAM_INIT;
    SltIntegral whole = SLT_INTEGRAL_INIT;
    SltCrossing c = SLT_CROSSING_INIT;
    SltDiagnostic d = SLT_DIAGNOSTIC_INIT;
    double x[3] = {0}, out[1];
    float image[1];
    uint32_t pixels[1];
    const double *dirs[1] = {x};
    float *images[1] = {image};
    SltJob job = SLT_JOB_INIT;
    job.size[0] = job.size[1] = 1;
    assert_int_equal(slt_eval(p, &job, 1, x, NULL, out, NULL, &err), SLT_USAGE);
    assert_non_null(strstr(err.text, "in use"));
    assert_int_equal(err.status, SLT_USAGE);
    assert_int_equal(slt_render(p, &job, image, NULL, NULL), SLT_USAGE);
    assert_int_equal(slt_render_rgba8(p, &job, pixels, NULL, &err), SLT_USAGE);
    assert_int_equal(slt_grad_images(p, &job, 1, dirs, images, NULL, NULL, &err), SLT_USAGE);
    assert_int_equal(slt_grad_adjoint(p, &job, image, out, NULL, NULL, &err), SLT_USAGE);
    assert_int_equal(slt_grad_loss(p, &job, image, NULL, out, out, NULL, NULL, NULL, &err), SLT_USAGE);
    assert_int_equal(slt_grad_integral(p, &job, &whole, NULL, &err), SLT_USAGE);
    assert_int_equal(slt_crossing(p, NULL, x, x, 0, &c, &err), SLT_USAGE);
    assert_int_equal(slt_set_floats(p, 0, 1, x, &err), SLT_USAGE);
    assert_int_equal(slt_set_ints(p, 0, 0, NULL, &err), SLT_USAGE);
    assert_int_equal(slt_set_text(p, "r", "0.25", &err), SLT_USAGE);
    assert_int_equal(slt_set_params_json(p, "{}", "t", &err), SLT_USAGE);
    assert_int_equal(slt_param_find(p, "r", &q, &err), SLT_USAGE);
    assert_int_equal(slt_wrt(p, NULL, 0, &err), SLT_USAGE);
    assert_int_equal(slt_set_print(p, NULL, NULL, &err), SLT_USAGE);
    assert_null(slt_params_json(p));
    assert_int_equal(slt_diagnostic_count(p), 0);
    assert_false(slt_diagnostic(p, 0, &d));
    assert_string_equal(slt_diagnostics_text(p), "");
    assert_string_equal(slt_diagnostics_json(p), "");
    slt_program_free(p);
    /* What does not change may be asked. */
    assert_int_equal(slt_dim(p), 2);
    assert_int_equal(slt_channels(p), 1);
    assert_true(slt_param(p, 0, &q) && !strcmp(q.name, "r"));
    assert_true(slt_floats(p)[0] == 0.5);
}

typedef struct Caller {
    SltProgram *p;
    atomic_int calls;
} Caller;

static void on_progress(void *user, double fraction) {
    Caller *c = user;
    (void)fraction;
    if (!atomic_fetch_add(&c->calls, 1)) assert_busy(c->p);
}

static void on_print(void *user, const char *line, const double *values, uint32_t n) {
    Caller *c = user;
    (void)line, (void)values, (void)n;
    if (!atomic_fetch_add(&c->calls, 1)) assert_busy(c->p);
}

static void callbacks(void **state) {
    (void)state;
    SltError err;
    Caller c = {.p = compile(source)};
    float image[SIDE * SIDE], again[SIDE * SIDE];
    SltJob job = SLT_JOB_INIT;
    job.size[0] = job.size[1] = SIDE, job.threads = 1;
    assert_ok(slt_render(c.p, &job, again, NULL, &err));
    job.progress = on_progress, job.progress_user = &c;
    assert_ok(slt_render(c.p, &job, image, NULL, &err));
    assert_true(c.calls > 0);
    assert_memory_equal(image, again, sizeof image);
    job.progress = NULL, c.calls = 0;
    assert_ok(slt_set_print(c.p, on_print, &c, &err));
    assert_ok(slt_render(c.p, &job, image, NULL, &err));
    assert_int_equal(c.calls, SIDE * SIDE * 4);
    assert_memory_equal(image, again, sizeof image);
    slt_program_free(c.p);
}

/* One call is held in its callback while another thread tries. */
typedef struct Held {
    SltProgram *p;
    atomic_bool inside, go;
    SltStatus status;
} Held;

static void hold(void *user, double fraction) {
    Held *h = user;
    (void)fraction;
    atomic_store(&h->inside, true);
    while (!atomic_load(&h->go)) sched_yield();
}

static void *render_held(void *user) {
    Held *h = user;
    float image[SIDE * SIDE];
    SltJob job = SLT_JOB_INIT;
    job.size[0] = job.size[1] = SIDE, job.threads = 2, job.progress = hold, job.progress_user = h;
    h->status = slt_render(h->p, &job, image, NULL, NULL);
    return NULL;
}

static void two_threads(void **state) {
    (void)state;
    SltError err;
    Held h = {.p = compile(source)};
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, render_held, &h), 0);
    while (!atomic_load(&h.inside)) sched_yield();
    assert_busy(h.p);
    atomic_store(&h.go, true);
    pthread_join(thread, NULL);
    assert_int_equal(h.status, SLT_OK);
    double x[2] = {0, 0}, out;
    assert_ok(slt_eval(h.p, NULL, 1, x, NULL, &out, NULL, &err));
    assert_true(out == 1);
    slt_program_free(h.p);
}

/* Many at once on one program: each call is done whole or refused. Then each with a program of its own: all are done.
 */
typedef struct Racer {
    SltProgram *p;
    pthread_t thread;
    const float *want;
    int done, refused, wrong;
} Racer;

static void *race(void *user) {
    Racer *r = user;
    float image[SIDE * SIDE];
    SltJob job = SLT_JOB_INIT;
    job.size[0] = job.size[1] = SIDE, job.threads = 1;
    for (int i = 0; i < 40; i++) {
        double half = 0.5;
        SltStatus s = i % 4 == 1 ? slt_set_floats(r->p, 0, 1, &half, NULL) : slt_render(r->p, &job, image, NULL, NULL);
        if (s == SLT_OK) r->done++;
        else if (s == SLT_USAGE) r->refused++;
        else r->wrong++;
        if (s == SLT_OK && i % 4 != 1 && memcmp(image, r->want, sizeof image) != 0) r->wrong++;
    }
    return NULL;
}

static void races(void **state) {
    (void)state;
    SltError err;
    static float want[SIDE * SIDE];
    SltJob job = SLT_JOB_INIT;
    job.size[0] = job.size[1] = SIDE;
    SltProgram *shared = compile(source);
    for (int own = 0; own < 2; own++) {
        Racer racer[THREADS] = {0};
        int done = 0;
        if (!own) assert_ok(slt_render(shared, &job, want, NULL, &err));
        for (int t = 0; t < THREADS; t++) racer[t] = (Racer){.p = own ? compile(source) : shared, .want = want};
        for (int t = 0; t < THREADS; t++) assert_int_equal(pthread_create(&racer[t].thread, NULL, race, &racer[t]), 0);
        for (int t = 0; t < THREADS; t++) {
            pthread_join(racer[t].thread, NULL);
            assert_int_equal(racer[t].wrong, 0);
            assert_int_equal(racer[t].done + racer[t].refused, 40);
            if (own) assert_int_equal(racer[t].refused, 0), slt_program_free(racer[t].p);
            done += racer[t].done;
        }
        assert_true(done > 0);
    }
    slt_program_free(shared);
}

/* What lines step over and the scale are found out beside an estimate, if threads may be used and bounds are there:
 * here from the second call on. Nobody can tell from the answer. */
enum { PARAMETERS = 3 };
typedef struct Answer {
    double value, value_stderr, row[5][PARAMETERS];
    uint64_t evaluations;
    int out_of_range;
} Answer;

static Answer ask(SltProgram *p, uint32_t threads) {
    Answer a;
    SltError err;
    SltIntegral i = SLT_INTEGRAL_INIT;
    SltStats stats = SLT_STATS_INIT;
    SltJob job = SLT_JOB_INIT;
    memset(&a, 0, sizeof a); /* they are compared as bytes */
    i.value = &a.value, i.value_stderr = &a.value_stderr, i.gradient = a.row[0], i.gradient_stderr = a.row[1];
    i.interior = a.row[2], i.boundary = a.row[3], i.missed_estimate = a.row[4];
    job.estimator = SLT_EST_LATTICE, job.samples = job.segments = 4096, job.threads = threads;
    assert_ok(slt_grad_integral(p, &job, &i, &stats, &err));
    a.evaluations = stats.evaluations, a.out_of_range = stats.out_of_range;
    return a;
}

static void beside(void **state) {
    (void)state;
    /* Bands that lines step over; of so tiny a picture squares of lengths vanish in single precision. */
    static const char of[] = "param float r = 0.5;\n"
                             "param float w = 1e-5;\n"
                             "param float a = 0.1;\n"
                             "[Domain(-%s, %s)] shader float main(float2 x) {\n"
                             "    float f = 0.0;\n"
                             "    for (int i = 0; i < 100; i++) {\n"
                             "        float2 y = x - float2(a * (float(i) - 50.0), 0.0) * %s;\n"
                             "        [Disc] if (abs(length(y) - r * %s) < w * %s) f += 1.0;\n"
                             "    }\n"
                             "    return f;\n"
                             "}\n";
    for (int tiny = 0; tiny < 2; tiny++) {
        char text[1024];
        const char *side = tiny ? "1e-30" : "1.0";
        snprintf(text, sizeof text, of, side, side, side, side, side);
        SltProgram *p = compile(text);
        const Answer first = ask(p, 2);
        assert_true(tiny ? first.out_of_range < 0 : !first.out_of_range);
        const Answer alone = ask(p, 1), again = ask(p, 2);
        assert_memory_equal(&again, &alone, sizeof alone);
        assert_memory_equal(again.row, first.row, sizeof first.row);
        /* They have met hardly one of the bands, and bounds say so. */
        if (!tiny) assert_true(first.row[1][0] > fabs(first.row[0][0]) || first.row[4][1] != 0);
        slt_program_free(p);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(callbacks), cmocka_unit_test(two_threads),
                                       cmocka_unit_test(races), cmocka_unit_test(beside)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
