/* Fitting: one evaluation of the loss an iteration, one step of the optimiser, and what must be saved between them.
 *
 * Only the floats that are differentiated form the optimiser's vector. An optimiser that compares losses gets one seed
 * for all iterations, any other a new one each time. Everything that decides the result is in the checkpoint, so a
 * resumed fit gives the same bits. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bindings/c/fit_inner.h"

enum { MAX_VALUES = 1 << 28 }; /* floats of an image */
const char *slt_fit_optimizer(uint32_t index) {
    return index < OPTIMISE_METHODS ? optimise_name((OptimiseMethod)index) : NULL;
}

/* ---- set-up */
SltStatus fit_find_param(const SltProgram *p, const char *name, const char *what, ParamRef *at, SltError *err) {
    if (!name) return status_fail(err, SLT_USAGE, "%s: it has no name", what);
    return api_find(p, name, SLT_USAGE, what, at, err);
}

SltStatus fit_out_of_memory(SltError *err) { return status_fail(err, SLT_LIMIT, "out of memory for a fit"); }

/* While an estimate runs: how far the fit is, in iterations. */
static void progressed(void *user, double of_estimate) {
    const SltFit *f = user;
    (void)of_estimate;
    f->progress(f->progress_user, (double)f->iteration / f->opt.iterations);
}

/* Reads the caller's options, which may be of another version, and checks that they make one problem. */
static SltStatus take_options(SltFit *f, const SltFitOptions *given, SltError *err) {
    SltFitOptions *o = &f->opt;
    *o = SLT_FIT_OPTIONS_INIT;
    f->job = SLT_JOB_INIT;
    if (!api_struct_read(o, sizeof *o, given)) return api_struct_unknown(err, "SltFitOptions");
    if (o->job && !api_struct_read(&f->job, sizeof f->job, o->job)) return api_struct_unknown(err, "SltJob");
    f->job.floats = NULL, f->job.ints = NULL;
    if (f->job.progress) {
        f->progress = f->job.progress, f->progress_user = f->job.progress_user;
        f->job.progress = progressed, f->job.progress_user = f;
    }
    if (o->minimize && (o->nviews || o->loss))
        return status_fail(err, SLT_USAGE, "a fit that minimises the integral has no views and no other loss");
    if (o->nviews && !o->views) return status_fail(err, SLT_USAGE, "%u views of a fit, but no list of them", o->nviews);
    if (!o->minimize && !o->nviews && !o->loss)
        return status_fail(err, SLT_USAGE, "a fit wants views, a loss, or to minimise the integral");
    if (!optimise_find(o->optimizer ? o->optimizer : "adam", &f->method))
        return status_fail(err, SLT_USAGE, "there is no optimiser `%s`", o->optimizer);
    if (o->history > INT32_MAX || o->patience > INT32_MAX || o->max_failures > INT32_MAX)
        return status_fail(err, SLT_USAGE, "a history, patience or number of failures of the fit is out of range");
    if ((unsigned)o->metric > SLT_FIT_HUBER || !(o->huber_delta >= 0) || isinf(o->huber_delta))
        return status_fail(err, SLT_USAGE, "the metric %d of a fit, delta %g, is none", (int)o->metric, o->huber_delta);
    if (o->loss_entry && (o->metric != SLT_FIT_L2 || o->minimize || o->loss))
        return status_fail(err, SLT_USAGE, "a loss entry stands alone, and here is another loss");
    if (o->loss_entry && !o->nviews) return status_fail(err, SLT_USAGE, "a loss entry wants views with targets");
    if (o->metric != SLT_FIT_L2 && (o->minimize || o->loss))
        return status_fail(err, SLT_USAGE, "a metric compares an image with its target, and here is another loss");
    if (!o->huber_delta) o->huber_delta = 0.1;
    if (o->iterations > UINT32_MAX - o->first || (o->planned && o->planned < o->first + o->iterations))
        return status_fail(err, SLT_USAGE, "a round of a fit from evaluation %u on, %u of them, and %u are planned",
                           o->first, o->iterations, o->planned);
    if (!o->planned) o->planned = o->first + o->iterations;
    bool compares = optimise_wants_same_loss(f->method);
    if (o->schedule && compares)
        return status_fail(err, SLT_USAGE, "%s finds the lengths of its steps: it takes no schedule of learning rates",
                           optimise_name(f->method));
    if ((unsigned)o->schedule > SLT_FIT_COSINE)
        return status_fail(err, SLT_USAGE, "there is no schedule of learning rates %d", (int)o->schedule);
    if (o->schedule == SLT_FIT_EXPONENTIAL && !(o->decay > 0 && o->decay <= 1))
        return status_fail(err, SLT_USAGE, "a decay above 0, at most 1, is wanted, not %g", o->decay);
    if (o->views_per_step > o->nviews || (o->views_per_step && compares))
        return status_fail(err, SLT_USAGE, "%u views an iteration%s", o->views_per_step,
                           compares ? ": this optimiser compares losses, and wants all" : ", and there are fewer");
    if (o->views_per_step == o->nviews) o->views_per_step = 0;
    f->job.integral = o->minimize;
    double values = slt_channels(f->p);
    for (uint32_t d = 0; d < 3; d++) {
        if (o->minimize || d >= slt_dim(f->p)) f->job.size[d] = 1;
        values *= f->job.size[d];
    }
    if (o->minimize && !f->job.samples) f->job.samples = 1u << 18;
    if (values < 1 || values > MAX_VALUES)
        return status_fail(err, values < 1 ? SLT_USAGE : SLT_LIMIT, "an image of %u x %u x %u with %u channels is %s",
                           f->job.size[0], f->job.size[1], f->job.size[2], slt_channels(f->p),
                           values < 1 ? "empty" : "larger than 2^28 values");
    f->nvalues = (size_t)values;
    return SLT_OK;
}

bool fit_room_for_losses(SltFit *f, size_t n) {
    if (n <= f->losses_cap) return true;
    size_t cap = n + n / 2 + 64;
    double *more = realloc(f->losses, cap * sizeof *more);
    if (more) f->losses = more, f->losses_cap = cap;
    return more != NULL;
}
/* ---- beginning and ending */
static void free_fit(SltFit *f) {
    optimise_free(f->optimiser);
    fit_free_views(f);
    fit_entry_free(f);
    free(f->checkpoint);
    free(f->index);
    free(f->gradient);
    free(f->all);
    free(f->joined);
    free(f->latest);
    free(f->drawn);
    free(f->own_floats);
    free(f->own_ints);
    free(f->losses);
    free(f->image);
    free(f->other);
    free(f->adjoint);
    free(f);
}

static SltStatus allocate(SltFit *f, SltError *err) {
    size_t nf = slt_float_count(f->p), ni = slt_int_count(f->p), rows = f->opt.minimize ? slt_channels(f->p) : 1;
    for (uint32_t v = 0; v < f->nviews; v++) {
        if (slt_float_count(f->views[v].p) > nf) nf = slt_float_count(f->views[v].p);
        if (slt_int_count(f->views[v].p) > ni) ni = slt_int_count(f->views[v].p);
    }
    f->index = calloc(nf + 1, sizeof *f->index);
    f->all = calloc(rows * (nf + 1), sizeof *f->all);
    f->own_floats = calloc(nf + 1, sizeof *f->own_floats);
    f->joined = calloc(nf + 1, sizeof *f->joined);
    f->latest = malloc((f->nviews + 1) * sizeof *f->latest);
    f->drawn = calloc(f->nviews + 1, 1);
    for (uint32_t v = 0; f->latest && v < f->nviews; v++) f->latest[v] = NAN;
    f->own_ints = calloc(ni + 1, sizeof *f->own_ints);
    if (!f->opt.minimize) f->image = calloc(f->nvalues, sizeof *f->image);
    if (fit_wants_adjoint(f))
        f->other = calloc(f->nvalues, sizeof *f->other), f->adjoint = calloc(f->nvalues, sizeof *f->adjoint);
    if (!f->index || !f->all || !f->latest || !f->drawn || !f->joined || !f->own_floats || !f->own_ints ||
        (!f->opt.minimize && !f->image) || (fit_wants_adjoint(f) && (!f->other || !f->adjoint)))
        return fit_out_of_memory(err);
    for (uint32_t i = 0; i < slt_float_count(f->p); i++)
        if (f->p->wrt[i]) f->index[f->n++] = i;
    if (!f->n) return status_fail(err, SLT_USAGE, "there is nothing to optimise: no differentiable parameter");
    f->gradient = calloc(f->n, sizeof *f->gradient);
    return f->gradient ? SLT_OK : fit_out_of_memory(err);
}

/* Here and below: the program is held. */
static SltStatus begin(SltProgram *p, const SltFitOptions *options, SltFit **out, SltError *err) {
    if (atomic_load(&p->fitted))
        return status_fail(err, SLT_USAGE, "a fit of this program is under way: slt_fit_end first");
    SltFit *f = calloc(1, sizeof *f);
    if (!f) return fit_out_of_memory(err);
    f->p = p;
    SltStatus status = take_options(f, options, err);
    if (status == SLT_OK) status = fit_read_views(f, err);
    if (status == SLT_OK) status = allocate(f, err);
    if (status == SLT_OK && f->opt.loss_entry) status = fit_entry_begin(f, f->opt.loss_entry, err);
    if (status == SLT_OK) status = fit_make_optimiser(f, err);
    if (status == SLT_OK) status = fit_prepare_checkpoint(f, err);
    if (status != SLT_OK) {
        free_fit(f);
        return status;
    }
    atomic_store(&p->fitted, true);
    f->start = pool_now();
    f->stop = f->iteration < f->opt.iterations ? SLT_FIT_RUNNING : SLT_FIT_ITERATIONS;
    *out = f;
    return SLT_OK;
}

/* The optimised floats lie in runs: whole parameters, mostly. */
void fit_set_active(SltFit *f, const double *x) {
    for (uint32_t i = 0, n; i < f->n; i += n) {
        for (n = 1; i + n < f->n && f->index[i + n] == f->index[i] + n; n++) {
        }
        memcpy(f->p->floats + f->index[i], x + i, n * sizeof *x);
        api_params_changed(f->p, f->index[i], n);
    }
}

static void fill_result(SltFit *f, SltFitResult *result) {
    SltFitResult r = SLT_FIT_RESULT_INIT;
    r.stop = f->stop, r.iterations = f->iteration;
    r.initial_loss = r.loss = NAN;
    if (f->iteration) r.initial_loss = f->losses[0], optimise_best(f->optimiser, &r.loss);
    r.losses = f->losses, f->losses = NULL;
    memcpy(r.reason, f->reason, sizeof r.reason);
    api_struct_write(result, &r, sizeof r);
}

static SltStatus end(SltFit *f, SltFitResult *result, SltError *err) {
    if (f->stop == SLT_FIT_RUNNING) f->stop = SLT_FIT_STOPPED;
    SltStatus status = fit_save(f, err);
    double best;
    const double *x = optimise_best(f->optimiser, &best);
    if (isfinite(best)) fit_set_active(f, x);
    if (result && api_struct_sized(result)) fill_result(f, result);
    atomic_store(&f->p->fitted, false);
    free_fit(f);
    return status;
}

/* ---- the loop */
static SltStatus stopped(SltFit *f, SltFitStop stop, SltStatus status, const char *reason) {
    f->stop = stop;
    snprintf(f->reason, sizeof f->reason, "%s", reason);
    return status;
}

static bool tell(const SltFit *f, double loss) {
    if (!f->opt.iterated) return false;
    SltFitIteration at = {.struct_size = sizeof at,
                          .iteration = fit_number(f),
                          .count = f->n,
                          .index = f->index,
                          .parameters = optimise_parameters(f->optimiser),
                          .gradient = f->gradient,
                          .loss = loss,
                          .image = f->image};
    optimise_best(f->optimiser, &at.best);
    if (loss < at.best) at.best = loss;
    return f->opt.iterated(f->opt.iterated_user, &at);
}

/* The factor of the learning rates for the step behind so many evaluations. */
static double scheduled(const SltFitOptions *o, uint32_t done) {
    if (o->schedule == SLT_FIT_EXPONENTIAL) return pow(o->decay, done - 1.0);
    if (o->schedule == SLT_FIT_COSINE) return (1 + cos(M_PI * (done - 1.0) / o->planned)) / 2;
    return 1;
}

static SltStatus step(SltFit *f, SltError *err) {
    double loss = 0, limit = f->job.time_limit;
    SltStatus status = SLT_OK;
    if (limit > 0 && pool_now() - f->start > limit) status = status_fail(err, SLT_LIMIT, "the time limit was reached");
    if (status == SLT_OK && !fit_room_for_losses(f, (size_t)f->iteration + 1))
        return stopped(f, SLT_FIT_FAILED, fit_out_of_memory(err), err->text);
    if (status == SLT_OK) status = fit_evaluate(f, &loss, err);
    if (status == SLT_INTERRUPTED || (f->job.cancel && __atomic_load_n(f->job.cancel, __ATOMIC_RELAXED)))
        return stopped(f, SLT_FIT_INTERRUPTED, status_fail(err, SLT_INTERRUPTED, "interrupted"), "interrupted");
    if (status == SLT_LIMIT && limit > 0) return stopped(f, SLT_FIT_TIME_LIMIT, status, err->text);
    if (status != SLT_OK) return stopped(f, SLT_FIT_FAILED, status, err->text);
    f->losses[f->iteration++] = loss;
    bool enough = tell(f, loss);
    optimise_set_rate(f->optimiser, scheduled(&f->opt, fit_number(f)));
    OptimiseState state = optimise_step(f->optimiser, loss, f->gradient);
    if (f->opt.every && f->iteration % f->opt.every == 0 && (status = fit_save(f, err)) != SLT_OK)
        return stopped(f, SLT_FIT_FAILED, status, err->text);
    const char *why = optimise_reason(f->optimiser);
    if (state == OPTIMISE_FAILED)
        return stopped(f, SLT_FIT_FAILED, status_fail(err, SLT_CHECK_FAILED, "the fit failed: %s", why), why);
    if (state == OPTIMISE_CONVERGED) return stopped(f, SLT_FIT_CONVERGED, SLT_OK, why);
    if (enough) return stopped(f, SLT_FIT_STOPPED, SLT_OK, "");
    if (f->iteration == f->opt.iterations) f->stop = SLT_FIT_ITERATIONS;
    return SLT_OK;
}

/* ---- the functions: each holds the program while it runs */
SltStatus slt_fit_begin(SltProgram *p, const SltFitOptions *options, SltFit **out, SltError *err) {
    SltError mine = {0};
    *out = NULL;
    if (!err) err = &mine;
    SltStatus status = api_hold(p, err);
    if (status != SLT_OK) return status;
    status = begin(p, options, out, err);
    api_let_go(p);
    return status;
}

SltStatus slt_fit_step(SltFit *f, SltFitStop *stop, SltError *err) {
    SltError mine = {0};
    if (!err) err = &mine;
    SltStatus status = api_hold(f->p, err);
    *stop = f->stop;
    if (status != SLT_OK) return status;
    if (f->stop == SLT_FIT_RUNNING) status = step(f, err);
    *stop = f->stop;
    api_let_go(f->p);
    return status;
}

static SltStatus draw_view(SltFit *f, uint32_t view, bool best, const SltJob *job, float *image, SltError *err) {
    SltJob own = f->job;
    double loss = 0;
    const double *x = best ? optimise_best(f->optimiser, &loss) : optimise_parameters(f->optimiser);
    if (view >= f->nviews) return status_fail(err, SLT_USAGE, "the fit has %u views, and no view %u", f->nviews, view);
    if (job && !api_struct_read(&own, sizeof own, job)) return api_struct_unknown(err, "SltJob");
    fit_set_active(f, isfinite(loss) ? x : optimise_parameters(f->optimiser));
    fit_use_view(f, &f->views[view], &own);
    SltStatus status = slt_render(f->views[view].p, &own, image, f->opt.stats, err);
    fit_set_active(f, optimise_parameters(f->optimiser));
    return status;
}

SltStatus slt_fit_image(SltFit *f, uint32_t view, bool best, const SltJob *job, float *image, SltError *err) {
    SltError mine = {0};
    if (!err) err = &mine;
    SltStatus status = api_hold(f->p, err);
    if (status != SLT_OK) return status;
    status = draw_view(f, view, best, job, image, err);
    api_let_go(f->p);
    return status;
}

SltStatus slt_fit_end(SltFit *f, SltFitResult *result, SltError *err) {
    SltError mine = {0};
    if (!f) return SLT_OK;
    if (!err) err = &mine;
    SltProgram *p = f->p;
    SltStatus status = api_hold(p, err);
    if (status != SLT_OK) return status;
    status = end(f, result, err);
    api_let_go(p);
    return status;
}

SltStatus slt_fit(SltProgram *p, const SltFitOptions *options, SltFitResult *result, SltError *err) {
    SltError mine = {0};
    SltFit *f;
    if (!err) err = &mine;
    if (result && !api_struct_sized(result)) return api_struct_unknown(err, "SltFitResult");
    SltStatus status = api_hold(p, err);
    bool held = status == SLT_OK;
    if (held) status = begin(p, options, &f, err);
    if (status != SLT_OK) {
        SltFitResult none = SLT_FIT_RESULT_INIT;
        none.stop = SLT_FIT_FAILED;
        none.initial_loss = none.loss = NAN;
        snprintf(none.reason, sizeof none.reason, "%s", err->text);
        if (result) api_struct_write(result, &none, sizeof none);
        if (held) api_let_go(p);
        return status;
    }
    while (status == SLT_OK && f->stop == SLT_FIT_RUNNING) status = step(f, err);
    SltError why = *err;
    SltStatus ended = end(f, result, err);
    api_let_go(p);
    if (ended == SLT_OK) *err = why;
    return ended == SLT_OK ? status : ended;
}
