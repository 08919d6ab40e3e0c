/* saltus fit: parameters that make the image match its targets, or that minimise the integral. The fit itself is the
 * library's (saltus/fit.h); here are its options, its rounds and the pipe to a loss program. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"
#include "cli/fit.h"
/* ---- set-up */
static bool on_command_line(const Cli *c, const char *name) {
    for (uint32_t k = 0; k < c->nparams; k++)
        if (!strcmp(c->params[k].name, name)) return true;
    return false;
}

/* Wrong usage of the library is a mistake in the scene; other causes keep their status. */
static int fail_scene(Fit *f, SltError *err) {
    if (err->status == SLT_USAGE) err->status = SLT_INPUT;
    return cli_fail(f->c, err);
}

/* "grad": false of a part of a parameter: an element, a field, a field of all elements. */
static SltStatus leave_parts_out(Fit *f, SltError *err) {
    const char *names[CLI_MAX_LIST];
    uint32_t n = 0;
    for (uint32_t k = 0; k < f->scene.nparams; k++) {
        bool part = f->scene.params[k].grad == 0;
        for (uint32_t i = 0; i < slt_param_count(f->p) && part; i++)
            part = strcmp(f->p->prog->params[i].name, f->scene.params[k].name) != 0;
        if (part && n < CLI_MAX_LIST) names[n++] = f->scene.params[k].name;
    }
    SltStatus status = n ? api_enter_to_set(f->p, err) : SLT_OK;
    if (!n || status != SLT_OK) return status;
    status = api_wrt_without(f->p, names, n, err);
    api_release(f->p);
    return status;
}

/* Where a parameter has "grad": true, those that have it are optimised; else all but those with false. The command line
 * wins. */
SltStatus fit_choose_wrt(Fit *f, SltError *err) {
    const Scene *s = &f->scene;
    const char *names[CLI_MAX_LIST];
    uint32_t nnames = 0;
    if (f->c->nwrt) return slt_wrt(f->p, f->c->wrt, f->c->nwrt, err);
    for (uint32_t k = 0; k < s->nparams; k++)
        if (s->params[k].grad == 1 && nnames < CLI_MAX_LIST) names[nnames++] = s->params[k].name;
    bool any_grad = nnames > 0;
    for (uint32_t i = 0; i < slt_param_count(f->p) && !any_grad; i++) {
        SltParam q = SLT_PARAM_INIT;
        slt_param(f->p, i, &q);
        bool off = !q.differentiable || !q.fcount;
        for (uint32_t k = 0; k < s->nparams; k++) off |= s->params[k].grad == 0 && !strcmp(s->params[k].name, q.name);
        if (!off && nnames < CLI_MAX_LIST) names[nnames++] = q.name;
    }
    SltStatus status = s->nparams && nnames ? slt_wrt(f->p, names, nnames, err) : SLT_OK;
    return status == SLT_OK ? leave_parts_out(f, err) : status;
}

static int apply_scene_params(Fit *f) {
    SltError err = {0};
    for (uint32_t k = 0; k < f->scene.nparams; k++) {
        FitParam *q = &f->scene.params[k];
        SltParam found = SLT_PARAM_INIT;
        bool many = strstr(q->name, "[*]") != NULL; /* a pattern has no value */
        if (!many && slt_param_find(f->p, q->name, &found, &err) != SLT_OK) return fail_scene(f, &err);
        if (many && (q->value || q->file || q->mask || q->faces || q->smooth >= 0))
            return cli_error(SLT_INPUT, "params: `%s` is many parameters: of these \"lr\" and \"grad\"", q->name);
        bool set = !on_command_line(f->c, q->name);
        if (set && q->value && slt_set_text(f->p, q->name, q->value, &err) != SLT_OK) return fail_scene(f, &err);
        if (set && q->file) {
            char *at = cli_need(malloc(strlen(q->file) + 2));
            sprintf(at, "@%s", q->file);
            SltStatus status = slt_set_text(f->p, q->name, at, &err);
            free(at);
            if (status != SLT_OK) return cli_fail(f->c, &err);
        }
    }
    if (f->c->params_file) { /* to go on from: it wins over where the scene began */
        int status = cli_set_values(f->c, f->p);
        if (status != SLT_OK) return status;
    }
    return f->c->nwrt || fit_choose_wrt(f, &err) == SLT_OK ? SLT_OK : fail_scene(f, &err);
}

/* A rate for all, typed by somebody who wants it to change something, where every parameter has one of its own. */
static void warn_of_rate(const Fit *f) {
    uint32_t n = slt_float_count(f->p), open = 0;
    uint8_t *own = cli_need(calloc(n + 1, 1));
    for (uint32_t k = 0; k < f->opt.nrates; k++) {
        ParamPattern named;
        SltError ignored;
        if (f->rates[k].name && api_find_pattern(f->p, f->rates[k].name, NULL, &named, &ignored) == SLT_OK)
            program_mark(&named, own);
    }
    for (uint32_t i = 0; i < n; i++) open += slt_wrt_mask(f->p)[i] && !own[i];
    free(own);
    if (!open && n)
        cli_say(CLI_WARNING, "rate", NULL,
                "--lr %s changes nothing: every parameter has a rate of its own, which `--lr P=%s` changes",
                f->c->plain_lr, f->c->plain_lr);
}

/* From the general to the particular: a rate for all, the scene's, the command line's by name. */
static int collect_numbers(Fit *f) {
    Cli *c = f->c;
    SltFitOptions *o = &f->opt;
    f->rates = cli_need(calloc(c->nlr + f->scene.nparams + 1, sizeof *f->rates));
    f->smooth = cli_need(calloc(c->nsmooth + f->scene.nparams + 1, sizeof *f->smooth));
    f->masks = cli_need(calloc(f->scene.nparams + 1, sizeof *f->masks));
    o->rates = f->rates, o->smooth = f->smooth, o->rate_masks = f->masks;
    o->smooth_faces = c->faces, o->nsmooth_faces = c->nfaces;
    o->smooth_grids = c->grids, o->nsmooth_grids = c->ngrids;
    for (uint32_t k = 0; k < c->nlr; k++)
        if (!c->lr[k].name) f->rates[o->nrates++].value = strtod(c->lr[k].value, NULL);
    for (uint32_t k = 0; k < f->scene.nparams; k++) {
        const FitParam *q = &f->scene.params[k];
        bool given = false;
        for (uint32_t s = 0; s < c->nsmooth; s++) given |= c->smooth[s].name && !strcmp(c->smooth[s].name, q->name);
        if (q->lr >= 0) f->rates[o->nrates++] = (SltFitNumber){q->name, q->lr};
        if (q->smooth > 0 && !given) f->smooth[o->nsmooth++] = (SltFitNumber){q->name, q->smooth};
    }
    for (uint32_t k = 0; k < c->nlr; k++)
        if (c->lr[k].name) f->rates[o->nrates++] = (SltFitNumber){c->lr[k].name, strtod(c->lr[k].value, NULL)};
    if (c->plain_lr && !c->quiet) warn_of_rate(f);
    for (uint32_t k = 0; k < c->nsmooth; k++) {
        if (!c->smooth[k].name) return cli_usage(c, "--smooth wants P=LAMBDA");
        f->smooth[o->nsmooth++] = (SltFitNumber){c->smooth[k].name, strtod(c->smooth[k].value, NULL)};
    }
    for (uint32_t k = 0; k < f->scene.nparams; k++) {
        const FitParam *q = &f->scene.params[k];
        if (!q->mask) continue;
        SltError err = {0};
        Image im;
        ImageReadOptions raw = {.raw = true};
        if (image_read(q->mask, &raw, &im, &err) != SLT_OK) return cli_fail(c, &err);
        size_t cells = (size_t)im.width * (size_t)im.height;
        float *factors = cli_need(malloc((cells + 1) * sizeof *factors));
        for (size_t i = 0; i < cells; i++) factors[i] = im.data[i * (size_t)im.channels];
        f->masks[o->nrate_masks++] = (SltFitMask){q->name, (uint32_t)im.width, (uint32_t)im.height, factors};
        image_free(&im);
    }
    return SLT_OK;
}

/* ---- while it runs */
static SltStatus ask_program(void *user, const SltFitRequest *request, double *loss, float *adjoint, SltError *err) {
    Fit *f = user;
    const View *v = &f->scene.views[request->view];
    LossRequest q = {.iteration = request->iteration,
                     .view = request->view,
                     .views = request->views,
                     .width = request->pixels[0],
                     .height = request->pixels[1],
                     .channels = request->channels,
                     .target = v->target_path,
                     .mask = v->mask_path,
                     .deadline = f->c->max_seconds > 0 ? f->start + f->c->max_seconds : 0};
    return loss_exchange(f->loss, &q, request->image, loss, adjoint, err);
}

static bool iterated(void *user, const SltFitIteration *at) {
    Fit *f = user;
    uint32_t iters = f->c->iters;
    f->done = at->iteration;
    for (uint32_t i = 0; f->slopes && i < at->count; i++) f->slopes[at->index[i]] += fabs(at->gradient[i]);
    for (uint32_t i = 0; !f->moves && i < at->count; i++) f->moves = at->gradient[i] != 0;
    char detail[96];
    snprintf(detail, sizeof detail, "iteration %u of %u, loss %.6g", at->iteration, iters, at->loss);
    progress_update(&f->progress, (double)at->iteration / iters, detail);
    watch_keep();
    return false;
}

/* ---- the fit */
static void absolute(Scene *s, char **path) {
    char *full = *path ? realpath(*path, NULL) : NULL;
    if (full) *path = scene_keep(s, full);
}

static int report(Fit *f, const SltError *err) {
    return err->status == SLT_USAGE ? cli_usage(f->c, "%s", err->text) : cli_fail(f->c, err);
}

/* Whether there is anything to write: not after a fault, nor when the first loss failed. */
static bool has_outcome(const Fit *f, SltStatus status) {
    if (f->result.stop == SLT_FIT_FAILED && !f->result.iterations) return false;
    return status == SLT_OK || status == SLT_INTERRUPTED || status == SLT_CHECK_FAILED || status == SLT_LIMIT;
}

/* What a round adds to the result of all. */
static void add_result(Fit *f, SltFitResult *r) {
    SltFitResult *all = &f->result;
    uint32_t n = all->iterations;
    if (!n) all->initial_loss = r->initial_loss;
    if (r->iterations || !n) all->loss = r->loss;
    all->losses = cli_need(realloc(all->losses, (n + r->iterations + 1) * sizeof *all->losses));
    if (r->iterations) memcpy(all->losses + n, r->losses, r->iterations * sizeof *r->losses);
    all->iterations += r->iterations;
    all->stop = r->stop;
    memcpy(all->reason, r->reason, sizeof all->reason);
    free(r->losses);
}

static SltStatus begin(Fit *f, uint32_t iterations, SltFit **fit, SltError *err) {
    const Cli *c = f->c;
    f->opt.iterations = iterations, f->opt.first = f->first, f->opt.planned = c->iters;
    /* Of what is left, for all rounds. */
    if (f->round && c->max_seconds > 0) f->c->job.time_limit = fmax(f->start + c->max_seconds - cli_now(), 1e-3);
    if (f->scene.nrounds) f->slopes = cli_need(realloc(f->slopes, (slt_float_count(f->p) + 1) * sizeof *f->slopes));
    if (f->scene.nrounds) memset(f->slopes, 0, (slt_float_count(f->p) + 1) * sizeof *f->slopes);
    return slt_fit_begin(f->p, &f->opt, fit, err);
}

/* One round, of a fit without a program between rounds the only one. */
static SltStatus run_round(Fit *f, SltFit *fit, bool pictures, SltError *err) {
    SltFitResult r = SLT_FIT_RESULT_INIT;
    SltFitStop stop = SLT_FIT_RUNNING;
    SltError end_err = {0};
    SltStatus status = SLT_OK;
    if (pictures && !f->round && !f->c->resume) status = fit_take_pictures(f, fit, err);
    while (status == SLT_OK && stop == SLT_FIT_RUNNING) {
        status = slt_fit_step(fit, &stop, err);
        if (status == SLT_OK && pictures) status = fit_take_pictures(f, fit, err);
    }
    bool any = !f->round || f->done > f->first;
    if (f->best && any && fit_take_best(f, fit, &end_err) != SLT_OK && status == SLT_OK)
        status = end_err.status, *err = end_err;
    SltStatus ended = slt_fit_end(fit, &r, &end_err);
    add_result(f, &r);
    f->first += r.stop == SLT_FIT_CONVERGED ? f->opt.iterations : r.iterations; /* that round is over */
    for (uint32_t i = 0; f->slopes && r.iterations && i < slt_float_count(f->p); i++) f->slopes[i] /= r.iterations;
    if (!any) fit_revert(f);
    /* A fit that ends at its time limit, with a result, is no error. */
    bool limited = stop == SLT_FIT_INTERRUPTED || (stop == SLT_FIT_TIME_LIMIT && f->result.iterations);
    if (status != SLT_OK && limited) err->text[0] = 0;
    if (ended != SLT_OK) status = ended, *err = end_err;
    return status;
}
/* The program between two rounds, and the next round's beginning; whatever fails leaves what the last round made. */
static SltStatus next_round(Fit *f, const Round **then, SltFit **fit, SltError *err) {
    SltStatus status = fit_change(f, *then, err);
    bool begun = false;
    if (status == SLT_OK) {
        f->round_ends = cli_need(realloc(f->round_ends, (f->round + 1) * sizeof *f->round_ends));
        f->round_ends[f->round] = f->result.iterations;
        f->round++;
        status = begin(f, fit_round(f, then), fit, err);
        begun = status == SLT_OK;
        if (!begun && status != SLT_LIMIT) status = err->status = SLT_CHECK_FAILED;
    }
    if (begun) return SLT_OK;
    bool late = f->c->max_seconds > 0 && cli_now() > f->start + f->c->max_seconds;
    f->result.stop = status == SLT_INTERRUPTED     ? SLT_FIT_INTERRUPTED
                     : status == SLT_LIMIT && late ? SLT_FIT_TIME_LIMIT
                                                   : SLT_FIT_FAILED;
    if (f->result.stop != SLT_FIT_FAILED) err->text[0] = 0; /* there is a result */
    fit_revert(f);
    return status;
}

static SltStatus run_rounds(Fit *f, SltFit *fit, const Round *then, bool pictures, SltError *err) {
    SltError end_err = {0};
    SltStatus status = run_round(f, fit, pictures, err);
    while (status == SLT_OK && then && f->result.stop != SLT_FIT_STOPPED) {
        status = next_round(f, &then, &fit, err);
        if (status == SLT_OK) status = run_round(f, fit, pictures, err);
    }
    if (pictures && f->c->frames && fit_end_frames(f, &end_err) != SLT_OK && status == SLT_OK)
        status = end_err.status, *err = end_err;
    return status;
}

static int run(Fit *f) {
    Cli *c = f->c;
    SltFit *fit;
    SltError err = {0};
    const Round *then;
    SltStatus status = fit_wants_folder(c) ? fit_check_folder(f, &err) : SLT_OK; /* now, and not after hours */
    bool pictures = fit_wants_folder(c) && !c->minimize;
    if (c->frames && !pictures) return cli_usage(c, "--frames wants views, and a folder behind -o");
    if (f->scene.nrounds && (c->checkpoint || c->resume))
        return cli_usage(c, "a fit in rounds has no checkpoints: it cannot be resumed");
    if (status == SLT_OK && pictures) status = fit_create_pictures(f, &err);
    if (pictures || f->scene.nrounds) fit_create_best(f);
    if (status == SLT_OK) status = begin(f, fit_round(f, &then), &fit, &err);
    if (status != SLT_OK) return report(f, &err);
    f->start = cli_now();
    /* The loss program may run in another folder than the command. */
    for (uint32_t v = 0; c->loss_command && f->scene.loss_dir && v < f->scene.nviews; v++)
        absolute(&f->scene, &f->scene.views[v].target_path), absolute(&f->scene, &f->scene.views[v].mask_path);
    if (c->loss_command && !(f->loss = loss_start(c->loss_command, f->scene.loss_dir, c->loss_timeout, &err))) {
        slt_fit_end(fit, NULL, NULL);
        return report(f, &err);
    }
    progress_begin(&f->progress, c, "fit");
    status = run_rounds(f, fit, then, pictures, &err);
    if (c->first_seed && status == SLT_OK) return loss_stop(f->loss), SLT_OK; /* more are to come */
    progress_end(&f->progress);
    loss_stop(f->loss);
    if (status != SLT_OK && *err.text) report(f, &err);
    if (c->first_seed) return status;
    if (!has_outcome(f, status)) return status;
    if (!c->quiet) cli_tell(c, f->p);
    if (!c->quiet && !f->moves && f->result.initial_loss != 0)
        cli_say(
            CLI_WARNING, "still", NULL,
            "nothing moved: the loss has no derivative in anything that is optimised. None of it reaches the picture "
            "where the fit begins (outside, hidden, turned inside out), or what decides has no [Disc]");
    report_dropped(c, &f->stats);
    int written = fit_write_outputs(f);
    if (written == SLT_OK) written = status;
    return written == SLT_OK && f->stats.asserts ? SLT_CHECK_FAILED : written;
}

static int fit(Fit *f) {
    Cli *c = f->c;
    if (c->minimize) c->job.integral = true;
    int status = apply_scene_params(f);
    if (status == SLT_OK) status = fit_check_targets(f);
    if (status == SLT_OK) status = cli_prepare_job(c, f->p);
    if (status == SLT_OK) status = fit_read_targets(f);
    if (status == SLT_OK) status = fit_collect_views(f);
    if (status == SLT_OK) status = collect_numbers(f);
    if (status != SLT_OK) return status;
    f->opt.job = &c->job, f->opt.stats = &f->stats, f->opt.minimize = c->minimize;
    f->opt.optimizer = c->optimizer, f->opt.iterations = c->iters;
    f->opt.checkpoint = c->checkpoint ? c->checkpoint : c->resume, f->opt.every = c->every, f->opt.resume = c->resume;
    f->opt.iterated = iterated, f->opt.iterated_user = f;
    f->opt.metric = c->loss ? (SltFitMetric)cli_choice(CLI_LOSSES, c->loss) : SLT_FIT_L2;
    f->opt.huber_delta = c->huber_delta, f->opt.loss_entry = c->loss_entry;
    f->opt.views_per_step = c->views_per_step;
    f->opt.schedule = (SltFitSchedule)c->schedule, f->opt.decay = c->decay;
    f->opt.beta1 = c->beta1, f->opt.beta2 = c->beta2;
    if (c->loss_command) f->opt.loss = ask_program, f->opt.loss_user = f, f->opt.loss_name = c->loss_command;
    return run(f);
}

static int fit_once(Cli *c, double *loss) {
    Fit f = {.c = c, .opt = SLT_FIT_OPTIONS_INIT, .result = SLT_FIT_RESULT_INIT, .stats = SLT_STATS_INIT};
    int status = SLT_OK;
    const char *scene_file = c->file;
    if (scene_is(c->file)) {
        c->scene = scene_file;
        status = scene_read(c, scene_file, &f.scene);
        if (status == SLT_OK) c->file = f.scene.shader;
    }
    if (status == SLT_OK) status = fit_take_rounds(&f);
    SltError later = {0}; /* a target that cannot be read is reported behind the shader's own errors */
    uint32_t size[3] = {0};
    if (status == SLT_OK && fit_size_of_target(&f, size, &later) == SLT_OK && size[0])
        c->opt.size[0] = size[0], c->opt.size[1] = size[1];
    if (status == SLT_OK) status = cli_compile(c, &f.p);
    if (c->first_seed) c->output = NULL;
    if (status == SLT_OK) status = fit(&f);
    *loss = f.result.loss;
    fit_free_pictures(&f);
    for (uint32_t k = 0; k < f.opt.nrate_masks; k++) free((void *)f.masks[k].factors);
    free(f.views);
    free(f.masks);
    free(f.rates);
    free(f.smooth);
    free(f.result.losses);
    free(f.slopes);
    free(f.round_ends);
    free(f.kept);
    for (uint32_t k = 0; k < f.ntexts; k++) free(f.texts[k]);
    free(f.texts);
    slt_program_free(f.p);
    for (uint32_t k = 0; k < f.nentries; k++) slt_program_free(f.entries[k]);
    free(f.entries);
    if (c->file == f.scene.shader) c->file = scene_file;
    scene_free(&f.scene);
    return status;
}

int verb_fit(Cli *c) {
    double loss;
    return c->first_seed ? fit_seeds(c, fit_once) : fit_once(c, &loss);
}
