/* The library's fit: the same bits as the command on the same problem, resumed or in one go; what callbacks see and
 * decide; every way in which it ends. */
#include <math.h>
#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>

#include "tests/scratch.h"

#include <jansson.h>

#include "runtime/image/image.h"
#include "saltus/fit.h"

enum { W = 20, H = 12, CHANNELS = 3, VALUES = W * H * CHANNELS, DISCS = 4 };

/* Discs over paper; `light` is what a view sees of its own. */
static const char discs[] = "struct Disc { float2 centre; float radius; float3 ink; };\n"
                            "Disc place(int i) {\n"
                            "    Disc d = { float2(0.2 + 0.2 * i, 0.3 + 0.1 * i), 0.15, float3(0.2 * i, 0.5, 0.8) };\n"
                            "    return d;\n"
                            "}\n"
                            "param Disc discs[4] = init(place);\n"
                            "[Range(0.0, 1.0)] param float3 paper = float3(0.8, 0.8, 0.7);\n"
                            "[NoDiff] param float light = 1.0;\n"
                            "shader float3 main(float2 x) {\n"
                            "    float3 c = paper;\n"
                            "    for (int i = 0; i < 4; i++) {\n"
                            "        [Disc] if (length(x - discs[i].centre) < discs[i].radius) c = discs[i].ink;\n"
                            "    }\n"
                            "    return light * c;\n"
                            "}\n";
static const char bowl[] =
    "param float a = 0.1;\n"
    "[Range(0.0, 0.6)] param float b = 0.2;\n"
    "shader float main(float2 x) { return (a - 0.75) * (a - 0.75) + (b - 0.9) * (b - 0.9) * x.y; }\n";

static float targets[2][VALUES], mask[VALUES];

static SltProgram *compile(const char *source) {
    SltOptions opt = SLT_OPTIONS_INIT;
    SltProgram *p;
    opt.stdlib_dir = SALTUS_STDLIB_BUILD, opt.seed = 5;
    if (slt_compile_string(source, "t.salt", &opt, &p) != SLT_OK)
        fail_msg("%s%s", slt_diagnostics_text(p), slt_last_error(p));
    return p;
}

static SltJob image_job(void) {
    SltJob job = SLT_JOB_INIT;
    job.size[0] = W, job.size[1] = H, job.spp = 4, job.seed = 5, job.threads = 2;
    return job;
}

static void put_image(const char *name, float *pixels) {
    SltError err = {0};
    Image im = {.width = W, .height = H, .channels = CHANNELS, .data = pixels};
    assert_int_equal(image_write(scratch_path(name), &im, NULL, &err), SLT_OK);
}

static int set_up(void **state) {
    if (access(SALTUS_BIN, X_OK) != 0 || scratch_make(state) != 0) return -1;
    SltProgram *p = compile(discs);
    SltJob job = image_job();
    SltError err = {0};
    job.spp = 16;
    for (int v = 0; v < 2; v++)
        if (slt_set_text(p, "discs[1].centre", v ? "[0.3, 0.6]" : "[0.5, 0.6]", &err) != SLT_OK ||
            slt_set_text(p, "paper", "[0.9, 0.6, 0.5]", &err) != SLT_OK ||
            slt_render(p, &job, targets[v], NULL, &err) != SLT_OK)
            fail_msg("%s", err.text);
    for (int i = 0; i < VALUES; i++) mask[i] = i % (W * CHANNELS) < W * CHANNELS / 2 ? 1 : 0.25f;
    slt_program_free(p);
    scratch_put("discs.salt", discs);
    scratch_put("bowl.salt", bowl);
    put_image("t0.pfm", targets[0]);
    put_image("t1.pfm", targets[1]);
    put_image("mask.pfm", mask);
    return 0;
}

/* Two views, one with a mask, the other with a value of its own. */
static const SltSet dimmed[] = {{"light", "0.9"}};
static SltFitView views[2];
static SltFitOptions two_views(const SltJob *job) {
    SltFitOptions o = SLT_FIT_OPTIONS_INIT;
    views[0] = views[1] = SLT_FIT_VIEW_INIT;
    views[0].target = targets[0], views[0].mask = mask;
    views[1].target = targets[1], views[1].values = dimmed, views[1].nvalues = 1;
    o.job = job, o.views = views, o.nviews = 2, o.iterations = 7;
    return o;
}
static const char scene[] =
    "{\"shader\": \"discs.salt\", \"size\": [20, 12], \"spp\": 4, \"seed\": 5,"
    " \"views\": [{\"target\": \"t0.pfm\", \"mask\": \"mask.pfm\"}, {\"target\": \"t1.pfm\", \"params\": {\"light\": 0.9}}]}";

/* What the command prints as one JSON object. */
static json_t *command(const char *line) {
    static char out[1 << 16];
    if (scratch_run(out, sizeof out, line) != 0) fail_msg("%s: %s", line, out);
    json_error_t e;
    json_t *j = json_loads(strchr(out, '{'), JSON_DISABLE_EOF_CHECK, &e);
    if (!j) fail_msg("%s: %s", e.text, out);
    return j;
}

static void assert_same_fit(const SltProgram *p, const SltFitResult *r, json_t *j) {
    json_t *losses = json_object_get(j, "losses");
    assert_int_equal(json_array_size(losses), r->iterations);
    for (uint32_t i = 0; i < r->iterations; i++) {
        double want = json_number_value(json_array_get(losses, i));
        if (memcmp(&want, &r->losses[i], sizeof want) != 0)
            fail_msg("loss %u is %.17g, the command's %.17g", i, r->losses[i], want);
    }
    double best = json_number_value(json_object_get(j, "loss"));
    assert_memory_equal(&best, &r->loss, sizeof best);
    char *text = slt_params_json(p);
    json_t *params = json_loads(text, 0, NULL);
    assert_true(json_equal(params, json_object_get(j, "params")));
    json_decref(params);
    free(text);
}

static void fit(SltProgram *p, const SltFitOptions *o, SltFitResult *r) {
    SltError err = {0};
    SltStats stats = SLT_STATS_INIT;
    SltFitOptions counted = *o;
    counted.stats = &stats;
    *r = SLT_FIT_RESULT_INIT;
    if (slt_fit(p, &counted, r, &err) != SLT_OK) fail_msg("%s", err.text);
    assert_true(stats.samples > 0);
}

static void same_as_the_command(void **state) {
    (void)state;
    scratch_put("scene.json", scene);
    const char *name;
    for (uint32_t k = 0; (name = slt_fit_optimizer(k)); k++) {
        char line[256];
        SltProgram *p = compile(discs);
        SltJob job = image_job();
        SltFitOptions o = two_views(&job);
        SltFitNumber rates[] = {{NULL, 0.02}, {"paper", 0.05}, {"discs[2]", 0.01}};
        SltFitResult r;
        o.optimizer = name, o.rates = rates, o.nrates = 3;
        fit(p, &o, &r);
        assert_int_equal(r.iterations, 7);
        assert_int_equal(r.stop, SLT_FIT_ITERATIONS);
        assert_true(r.loss < r.initial_loss);
        snprintf(line, sizeof line,
                 "saltus fit scene.json --optimizer %s --lr '0.02,paper=0.05,discs[2]=0.01' --iters 7 --json", name);
        json_t *j = command(line);
        assert_same_fit(p, &r, j);
        json_decref(j);
        free(r.losses);
        slt_program_free(p);
    }
    assert_null(slt_fit_optimizer(UINT32_MAX));
}

static void minimised_integral(void **state) {
    (void)state;
    SltProgram *p = compile(bowl);
    SltJob job = image_job();
    SltFitOptions o = SLT_FIT_OPTIONS_INIT;
    SltFitNumber rates[] = {{"a", 0.2}};
    SltFitResult r;
    job.samples = 1024;
    o.job = &job, o.minimize = true, o.optimizer = "lbfgs", o.rates = rates, o.nrates = 1;
    fit(p, &o, &r);
    assert_int_equal(r.stop, SLT_FIT_CONVERGED);
    assert_true(r.reason[0] != 0);
    json_t *j = command("saltus fit bowl.salt --minimize --optimizer lbfgs --lr a=0.2 --samples 1024 --seed 5 --json");
    assert_same_fit(p, &r, j);
    json_decref(j);
    free(r.losses);
    slt_program_free(p);
}

/* What `iterated` saw, and when it stops. */
typedef struct Watch {
    uint32_t calls, stop_at;
    double losses[64], best;
    volatile int cancel;
    uint32_t cancel_at;
    SltProgram *p;
} Watch;

static bool watch(void *user, const SltFitIteration *at) {
    Watch *w = user;
    w->losses[w->calls++] = at->loss;
    w->best = at->best;
    for (uint32_t i = 0; w->p && i < at->count; i++) {
        assert_true(slt_wrt_mask(w->p)[at->index[i]]);
        assert_true(slt_floats(w->p)[at->index[i]] == at->parameters[i]);
        assert_true(isfinite(at->gradient[i]));
    }
    assert_non_null(at->image);
    if (w->calls == w->cancel_at) w->cancel = 1;
    return at->iteration == w->stop_at;
}

static void stopped_and_resumed(void **state) {
    (void)state;
    scratch_put("scene.json", scene);
    for (uint32_t k = 0; slt_fit_optimizer(k); k++) {
        SltJob job = image_job();
        SltFitOptions o = two_views(&job);
        SltFitResult whole, first, rest;
        Watch w = {.stop_at = 3};
        char checkpoint[512], line[256];
        snprintf(checkpoint, sizeof checkpoint, "%s", scratch_path("c.bin"));
        o.optimizer = slt_fit_optimizer(k);
        SltProgram *p = compile(discs);
        fit(p, &o, &whole);
        slt_program_free(p);
        /* Stopped by the callback. */
        p = w.p = compile(discs);
        o.checkpoint = checkpoint, o.every = 2, o.iterated = watch, o.iterated_user = &w;
        fit(p, &o, &first);
        assert_int_equal(first.stop, SLT_FIT_STOPPED);
        assert_int_equal(first.iterations, 3);
        assert_int_equal(w.calls, 3);
        assert_memory_equal(w.losses, whole.losses, 3 * sizeof(double));
        assert_true(w.best == first.loss);
        slt_program_free(p);
        /* On from there, in steps, with fewer threads. */
        p = w.p = compile(discs);
        job.threads = 1, w.stop_at = 0, w.calls = 0;
        o.checkpoint = NULL, o.resume = checkpoint;
        SltFit *f;
        SltError err = {0};
        SltFitStop stop = SLT_FIT_RUNNING;
        uint32_t steps = 0;
        assert_int_equal(slt_fit_begin(p, &o, &f, &err), SLT_OK);
        assert_int_equal(slt_wrt(p, NULL, 0, &err), SLT_USAGE); /* it would take the ground away */
        for (; stop == SLT_FIT_RUNNING; steps++) assert_int_equal(slt_fit_step(f, &stop, &err), SLT_OK);
        assert_int_equal(steps, 4);
        assert_int_equal(slt_fit_step(f, &stop, &err), SLT_OK); /* nothing to do */
        rest = SLT_FIT_RESULT_INIT;
        assert_int_equal(slt_fit_end(f, &rest, &err), SLT_OK);
        assert_int_equal(slt_wrt(p, NULL, 0, &err), SLT_OK);
        assert_int_equal(rest.stop, SLT_FIT_ITERATIONS);
        assert_int_equal(rest.iterations, 7);
        assert_memory_equal(rest.losses, whole.losses, 7 * sizeof(double));
        /* The command goes on from the library's checkpoint too. */
        snprintf(line, sizeof line, "saltus fit scene.json --optimizer %s --iters 7 --resume c.bin --json",
                 o.optimizer);
        json_t *j = command(line);
        assert_same_fit(p, &rest, j);
        json_decref(j);
        slt_program_free(p);
        free(whole.losses);
        free(first.losses);
        free(rest.losses);
    }
}

/* How far fits were when they said so, and when they are to stop. */
typedef struct Heard {
    uint32_t calls, cancel_at;
    double last;
    volatile int cancel;
} Heard;

static void hear(void *user, double fraction) {
    Heard *h = user;
    assert_true(fraction >= h->last && fraction < 1);
    h->last = fraction;
    if (++h->calls == h->cancel_at) h->cancel = 1;
}

/* While estimates run, not only between them: what stops a fit there need not wait for the end of a long one. */
static void progress_and_cancel_within(void **state) {
    (void)state;
    SltProgram *p = compile(discs);
    SltJob job = image_job();
    SltFitOptions o = two_views(&job);
    SltFitResult r = SLT_FIT_RESULT_INIT;
    SltError err = {0};
    Heard h = {0};
    job.threads = 1, job.progress = hear, job.progress_user = &h;
    o.iterations = 4;
    assert_int_equal(slt_fit(p, &o, &r, &err), SLT_OK);
    assert_true(h.calls > 4 && h.last == 0.75);
    free(r.losses);
    h = (Heard){.cancel_at = 1};
    r = SLT_FIT_RESULT_INIT;
    job.cancel = &h.cancel, job.spp = 4096;
    assert_int_equal(slt_fit(p, &o, &r, &err), SLT_INTERRUPTED);
    assert_int_equal(r.iterations, 0);
    free(r.losses);
    slt_program_free(p);
}

static void cancelled(void **state) {
    (void)state;
    SltProgram *p = compile(discs);
    SltJob job = image_job();
    SltFitOptions o = two_views(&job);
    SltFitResult r = SLT_FIT_RESULT_INIT;
    SltError err = {0};
    Watch w = {.cancel_at = 2, .p = p};
    job.cancel = &w.cancel;
    o.iterated = watch, o.iterated_user = &w;
    assert_int_equal(slt_fit(p, &o, &r, &err), SLT_INTERRUPTED);
    assert_int_equal(r.stop, SLT_FIT_INTERRUPTED);
    assert_int_equal(r.iterations, 2);
    assert_string_equal(err.text, "interrupted");
    free(r.losses);
    job.cancel = NULL, job.time_limit = 1e-9;
    r = SLT_FIT_RESULT_INIT;
    assert_int_equal(slt_fit(p, &o, &r, &err), SLT_LIMIT);
    assert_int_equal(r.stop, SLT_FIT_TIME_LIMIT);
    free(r.losses);
    /* Given up between two steps. */
    SltFit *f;
    SltFitStop stop;
    job.time_limit = 0, o.iterated = NULL;
    assert_int_equal(slt_fit_begin(p, &o, &f, NULL), SLT_OK);
    assert_int_equal(slt_fit_step(f, &stop, NULL), SLT_OK);
    r = SLT_FIT_RESULT_INIT;
    assert_int_equal(slt_fit_end(f, &r, NULL), SLT_OK);
    assert_int_equal(r.stop, SLT_FIT_STOPPED);
    assert_int_equal(r.iterations, 1);
    free(r.losses);
    assert_int_equal(slt_fit_end(NULL, NULL, NULL), SLT_OK);
    slt_program_free(p);
}

/* The squared difference from a target, as the program below has it. */
typedef struct Teacher {
    uint32_t calls, fail_at, nan_at;
} Teacher;

static SltStatus teach(void *user, const SltFitRequest *q, double *loss, float *adjoint, SltError *err) {
    Teacher *t = user;
    assert_int_equal(q->iteration * q->views + q->view, t->calls);
    assert_int_equal(q->pixels[0] * q->pixels[1] * q->pixels[2] * q->channels, VALUES);
    if (++t->calls == t->fail_at) {
        snprintf(err->text, sizeof err->text, "no more chalk");
        return err->status = SLT_CHECK_FAILED;
    }
    *loss = 0;
    for (int i = 0; i < VALUES; i++) {
        double d = (double)q->image[i] - (double)targets[q->view][i];
        *loss += d * d;
        adjoint[i] = (float)(2 * d / VALUES);
    }
    *loss /= VALUES;
    if (t->calls == t->nan_at) *loss = NAN;
    return SLT_OK;
}

static const char teacher[] = "import json, sys\n"
                              "from array import array\n"
                              "def pfm(path):\n"
                              "    head, data = open(path, 'rb').read().split(b'\\n-1.0\\n', 1)\n"
                              "    w, h = map(int, head.split(b'\\n')[1].split())\n"
                              "    v = array('f', data)\n"
                              "    return [x for y in reversed(range(h)) for x in v[3 * y * w:3 * (y + 1) * w]]\n"
                              "for line in sys.stdin.buffer:\n"
                              "    q = json.loads(line)\n"
                              "    n = q['width'] * q['height'] * q['channels']\n"
                              "    image = array('f', sys.stdin.buffer.read(4 * n))\n"
                              "    d = [a - b for a, b in zip(image, pfm(q['target']))]\n"
                              "    loss = 0.0\n"
                              "    for x in d:\n"
                              "        loss += x * x\n"
                              "    sys.stdout.buffer.write(json.dumps({'loss': loss / n}).encode() + b'\\n')\n"
                              "    sys.stdout.buffer.write(array('f', [2 * x / n for x in d]).tobytes())\n"
                              "    sys.stdout.buffer.flush()\n";

static void losses_of_the_callers(void **state) {
    (void)state;
    SltProgram *p = compile(discs);
    SltJob job = image_job();
    SltFitOptions o = two_views(&job);
    SltFitResult r = SLT_FIT_RESULT_INIT;
    SltError err = {0};
    Teacher t = {0};
    views[0].target = views[0].mask = views[1].target = NULL;
    o.loss = teach, o.loss_user = &t, o.loss_name = "python3 teacher.py", o.iterations = 5;
    fit(p, &o, &r);
    assert_int_equal(t.calls, 10);
    assert_true(r.loss < r.initial_loss);
    if (system("python3 -c '' 2>/dev/null") == 0) {
        scratch_put("teacher.py", teacher);
        scratch_put("taught.json", scene);
        json_t *j = command("saltus fit taught.json --loss-command 'python3 teacher.py' --iters 5 --json");
        assert_same_fit(p, &r, j);
        json_decref(j);
    }
    free(r.losses);
    /* A loss of NaN is stepped back from; a failing one ends the fit, and the best so far stays. */
    t = (Teacher){.nan_at = 5};
    o.nviews = 1;
    fit(p, &o, &r);
    assert_true(isnan(r.losses[4]) && isfinite(r.loss));
    free(r.losses);
    t = (Teacher){.fail_at = 4};
    r = SLT_FIT_RESULT_INIT;
    assert_int_equal(slt_fit(p, &o, &r, &err), SLT_CHECK_FAILED);
    assert_int_equal(r.stop, SLT_FIT_FAILED);
    assert_int_equal(r.iterations, 3);
    assert_string_equal(err.text, "no more chalk");
    assert_string_equal(r.reason, "no more chalk");
    free(r.losses);
    /* Without views there is one, as the program is. */
    t = (Teacher){0};
    o.views = NULL, o.nviews = 0;
    fit(p, &o, &r);
    free(r.losses);
    slt_program_free(p);
}

static void assert_refused(SltProgram *p, const SltFitOptions *o, SltStatus status, const char *text) {
    SltFitResult r = SLT_FIT_RESULT_INIT;
    SltError err = {0};
    assert_int_equal(slt_fit(p, o, &r, &err), status);
    assert_int_equal(r.stop, SLT_FIT_FAILED);
    if (!strstr(err.text, text)) fail_msg("`%s` lacks `%s`", err.text, text);
    free(r.losses);
    assert_int_equal(slt_fit(p, o, NULL, NULL), status);
}

static void refusals(void **state) {
    (void)state;
    SltProgram *p = compile(discs);
    SltJob job = image_job();
    char *before = slt_params_json(p);
    SltFitOptions o = two_views(&job);
    o.minimize = true;
    assert_refused(p, &o, SLT_USAGE, "no views");
    o = SLT_FIT_OPTIONS_INIT;
    assert_refused(p, &o, SLT_USAGE, "wants views");
    o = two_views(&job), o.struct_size = 0;
    assert_refused(p, &o, SLT_USAGE, "SltFitOptions");
    o = two_views(&job), views[1].struct_size = 0;
    assert_refused(p, &o, SLT_USAGE, "SltFitView");
    o = two_views(&job), o.optimizer = "best";
    assert_refused(p, &o, SLT_USAGE, "`best`");
    o = two_views(&job), views[1].target = NULL;
    assert_refused(p, &o, SLT_USAGE, "view 1");
    /* Sizes. */
    o = two_views(&job), job.size[1] = 0;
    assert_refused(p, &o, SLT_USAGE, "empty");
    job.size[0] = job.size[1] = 1 << 20;
    assert_refused(p, &o, SLT_LIMIT, "2^28");
    job = image_job();
    /* Names. */
    SltFitNumber number = {"discz", 0.1};
    o = two_views(&job), o.rates = &number, o.nrates = 1;
    assert_refused(p, &o, SLT_USAGE, "`discs`");
    o = two_views(&job), o.smooth = &number, o.nsmooth = 1;
    assert_refused(p, &o, SLT_USAGE, "`discs`");
    number.name = "paper";
    assert_refused(p, &o, SLT_USAGE, "a texture or an array");
    number.name = NULL;
    assert_refused(p, &o, SLT_USAGE, "no name");
    number.name = "paper", number.value = -1;
    o = two_views(&job), o.rates = &number, o.nrates = 1;
    assert_refused(p, &o, SLT_USAGE, "learning rate");
    SltSet own[] = {{"light", "0.9"}, {"lihgt", "0.9"}};
    o = two_views(&job), views[1].values = own, views[1].nvalues = 2;
    assert_refused(p, &o, SLT_INPUT, "`light`");
    own[1] = (SltSet){"light", "bright"};
    assert_refused(p, &o, SLT_INPUT, "bright");
    own[1] = (SltSet){"paper", "[1, 1, 1]"};
    assert_refused(p, &o, SLT_INPUT, "is optimised");
    /* Masks. */
    static const float factors[] = {1, 0, 0.5f, -1};
    SltFitMask m = {"discs", 3, 5, factors};
    o = two_views(&job), o.rate_masks = &m, o.nrate_masks = 1;
    assert_refused(p, &o, SLT_INPUT, "3 x 5");
    m.width = 4, m.height = 1;
    assert_refused(p, &o, SLT_INPUT, "column 3");
    m.name = "disks";
    assert_refused(p, &o, SLT_USAGE, "`discs`");
    /* Files. */
    o = two_views(&job), o.resume = "/nonexistent/c.bin";
    assert_refused(p, &o, SLT_INPUT, "c.bin");
    o = two_views(&job), o.checkpoint = "/nonexistent/c.bin", o.every = 1;
    assert_refused(p, &o, SLT_OUTPUT, "c.bin");
    o.iterations = 0;
    SltError err = {0};
    assert_int_equal(slt_fit(p, &o, NULL, &err), SLT_OUTPUT);
    slt_program_free(p);
    p = compile(discs);
    /* Another problem's checkpoint. */
    SltFitResult r;
    char checkpoint[512];
    snprintf(checkpoint, sizeof checkpoint, "%s", scratch_path("other.bin"));
    o = two_views(&job), o.checkpoint = checkpoint, o.iterations = 1;
    fit(p, &o, &r);
    free(r.losses);
    o.resume = checkpoint, views[0].target = targets[1];
    assert_refused(p, &o, SLT_INPUT, "belongs to");
    slt_program_free(p);
    /* Nothing was changed where nothing ran. */
    p = compile(discs);
    o = two_views(&job), views[1].values = own, views[1].nvalues = 2;
    assert_refused(p, &o, SLT_INPUT, "is optimised");
    char *after = slt_params_json(p);
    assert_string_equal(before, after);
    free(before);
    free(after);
    /* Nothing to optimise. */
    slt_program_free(p);
    p = compile("shader float main(float2 x) { return x.x; }");
    o = SLT_FIT_OPTIONS_INIT, o.minimize = true;
    assert_refused(p, &o, SLT_USAGE, "nothing to optimise");
    slt_program_free(p);
}

static void bad_targets(void **state) {
    (void)state;
    SltProgram *p = compile(discs);
    SltJob job = image_job();
    SltFitOptions o = two_views(&job);
    SltFitResult r = SLT_FIT_RESULT_INIT;
    SltError err = {0};
    static float nan_target[VALUES];
    for (int i = 0; i < VALUES; i++) nan_target[i] = i == 17 ? NAN : 0.5f;
    views[1].target = nan_target;
    assert_int_equal(slt_fit(p, &o, &r, &err), SLT_CHECK_FAILED);
    assert_int_equal(r.stop, SLT_FIT_FAILED);
    assert_int_equal(r.iterations, 1);
    assert_true(isnan(r.initial_loss));
    assert_non_null(strstr(err.text, "at the start is not finite"));
    free(r.losses);
    slt_program_free(p);
}

/* Rates and their masks: 0 holds to the bit; tolerances end a fit. */
static void held_and_tolerances(void **state) {
    (void)state;
    SltProgram *p = compile(discs);
    SltJob job = image_job();
    SltFitOptions o = two_views(&job);
    SltFitResult r;
    static const float factors[DISCS] = {0, 1, 1, 0.5f};
    SltFitMask m = {"discs", DISCS, 1, factors};
    SltParam q = SLT_PARAM_INIT;
    o.rate_masks = &m, o.nrate_masks = 1;
    double before[64];
    assert_int_equal(slt_param_find(p, "discs", &q, NULL), SLT_OK);
    memcpy(before, slt_floats(p) + q.fbase, q.fcount * sizeof *before);
    fit(p, &o, &r);
    uint32_t each = q.fcount / DISCS;
    assert_memory_equal(before, slt_floats(p) + q.fbase, each * sizeof *before);
    assert_memory_not_equal(before + each, slt_floats(p) + q.fbase + each, each * sizeof *before);
    free(r.losses);
    o.loss_tolerance = 0.9, o.patience = 2, o.iterations = UINT32_MAX;
    fit(p, &o, &r);
    assert_int_equal(r.stop, SLT_FIT_CONVERGED);
    assert_non_null(strstr(r.reason, "over 2 iterations"));
    free(r.losses);
    slt_program_free(p);
}

/* ---- a fit holds its program */
typedef struct Meddler {
    SltProgram *p;
    SltFit *fit;
    SltStatus set, text, wrt, step, another, look;
} Meddler;

static bool meddle(void *user, const SltFitIteration *at) {
    Meddler *m = user;
    double ten = 10;
    float pixels[4 * CHANNELS];
    SltJob small = SLT_JOB_INIT;
    SltFitOptions o = SLT_FIT_OPTIONS_INIT;
    SltFitStop stop;
    (void)at;
    small.size[0] = small.size[1] = 2, small.spp = 1;
    o.job = &small, o.minimize = true;
    m->set = slt_set_floats(m->p, 0, 1, &ten, NULL);
    m->text = slt_set_text(m->p, "light", "2", NULL);
    m->wrt = slt_wrt(m->p, NULL, 0, NULL);
    m->another = slt_fit(m->p, &o, NULL, NULL);
    m->look = slt_render(m->p, &small, pixels, NULL, NULL);
    if (m->fit) m->step = slt_fit_step(m->fit, &stop, NULL);
    slt_program_free(m->p);
    return false;
}

typedef struct Looker {
    SltProgram *p;
    atomic_bool go, end, ended;
    atomic_uint refused, others;
} Looker;

static void *keep_looking(void *user) {
    Looker *l = user;
    float pixels[4 * CHANNELS];
    SltJob small = SLT_JOB_INIT;
    small.size[0] = small.size[1] = 2, small.spp = 1, small.threads = 1;
    while (!atomic_load(&l->go)) sched_yield();
    while (!atomic_load(&l->end))
        atomic_fetch_add(slt_render(l->p, &small, pixels, NULL, NULL) == SLT_USAGE ? &l->refused : &l->others, 1);
    atomic_store(&l->ended, true);
    return NULL;
}

/* The looker begins in the first iteration, and has been refused before the second; it ends in the last. */
static bool let_look(void *user, const SltFitIteration *at) {
    Looker *l = user;
    atomic_store(&l->go, true);
    while (!atomic_load(&l->refused)) sched_yield();
    if (at->iteration < 7) return false;
    atomic_store(&l->end, true);
    while (!atomic_load(&l->ended)) sched_yield();
    return false;
}

static void held_by_a_fit(void **state) {
    (void)state;
    SltJob job = image_job();
    SltFitOptions o = two_views(&job);
    SltFitResult quiet, disturbed = SLT_FIT_RESULT_INIT;
    SltError err = {.status = SLT_LIMIT, .text = "of another call"};
    SltProgram *p = compile(discs);
    fit(p, &o, &quiet);
    slt_program_free(p);
    /* From callbacks: looking is served, changing is not. */
    p = compile(discs);
    Meddler m = {.p = p};
    SltFitStop stop = SLT_FIT_RUNNING;
    o.iterated = meddle, o.iterated_user = &m;
    assert_int_equal(slt_fit_begin(p, &o, &m.fit, &err), SLT_OK);
    assert_string_equal(err.text, "");
    while (stop == SLT_FIT_RUNNING) assert_int_equal(slt_fit_step(m.fit, &stop, &err), SLT_OK);
    assert_int_equal(slt_fit_end(m.fit, &disturbed, &err), SLT_OK);
    assert_int_equal(m.look, SLT_OK);
    SltStatus refused[] = {m.set, m.text, m.wrt, m.step, m.another};
    for (int i = 0; i < 5; i++) assert_int_equal(refused[i], SLT_USAGE);
    assert_int_equal(disturbed.iterations, quiet.iterations);
    assert_memory_equal(disturbed.losses, quiet.losses, quiet.iterations * sizeof(double));
    free(disturbed.losses);
    /* From another thread: the looker is refused, not the fit. */
    slt_program_free(p);
    p = compile(discs);
    Looker l = {.p = p};
    o.iterated = let_look, o.iterated_user = &l;
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, keep_looking, &l), 0);
    disturbed = SLT_FIT_RESULT_INIT;
    SltStatus status = slt_fit(p, &o, &disturbed, &err);
    atomic_store(&l.go, true), atomic_store(&l.end, true);
    pthread_join(thread, NULL);
    assert_int_equal(status, SLT_OK);
    assert_true(atomic_load(&l.refused) > 0);
    assert_int_equal(atomic_load(&l.others), 0); /* none was served */
    assert_memory_equal(disturbed.losses, quiet.losses, quiet.iterations * sizeof(double));
    free(quiet.losses);
    free(disturbed.losses);
    slt_program_free(p);
}

/* A checkpoint belongs to all that makes the losses; one with more iterations than are wanted stays what it is. */
static void whose_checkpoint(void **state) {
    (void)state;
    SltJob job = image_job();
    SltFitOptions o = two_views(&job);
    SltFitResult whole, part;
    SltError err = {0};
    char checkpoint[512];
    snprintf(checkpoint, sizeof checkpoint, "%s", scratch_path("whose.bin"));
    SltProgram *p = compile(discs);
    fit(p, &o, &whole);
    slt_program_free(p);
    p = compile(discs);
    o.checkpoint = checkpoint, o.iterations = 4;
    fit(p, &o, &part);
    free(part.losses);
    slt_program_free(p);
    p = compile(discs);
    o.resume = checkpoint, o.iterations = 2;
    part = SLT_FIT_RESULT_INIT;
    assert_int_equal(slt_fit(p, &o, &part, &err), SLT_OK);
    assert_int_equal(part.iterations, 4);
    assert_memory_equal(part.losses, whole.losses, 4 * sizeof(double));
    free(part.losses);
    slt_program_free(p);
    p = compile(discs);
    o.checkpoint = NULL, o.iterations = 7;
    fit(p, &o, &part);
    assert_int_equal(part.iterations, 7);
    assert_memory_equal(part.losses, whole.losses, 7 * sizeof(double));
    free(part.losses);
    slt_program_free(p);
    free(whole.losses);
    /* Another value of what is held, and a derivative without its jumps. */
    for (int k = 0; k < 2; k++) {
        SltFit *f;
        p = compile(discs);
        if (k == 0) assert_int_equal(slt_set_text(p, "light", "0.5", &err), SLT_OK);
        job.no_boundary = k == 1;
        assert_int_equal(slt_fit_begin(p, &o, &f, &err), SLT_INPUT);
        slt_program_free(p);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(same_as_the_command),
        cmocka_unit_test(minimised_integral),
        cmocka_unit_test(stopped_and_resumed),
        cmocka_unit_test(cancelled),
        cmocka_unit_test(losses_of_the_callers),
        cmocka_unit_test(refusals),
        cmocka_unit_test(bad_targets),
        cmocka_unit_test(held_and_tolerances),
        cmocka_unit_test(progress_and_cancel_within),
        cmocka_unit_test(held_by_a_fit),
        cmocka_unit_test(whose_checkpoint),
    };
    return cmocka_run_group_tests(tests, set_up, scratch_drop);
}
