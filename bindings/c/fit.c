/* Fitting: one evaluation of the loss an iteration, one step of the optimiser, and what must be saved between them.
 *
 * Only the floats that are differentiated form the optimiser's vector. An optimiser that compares losses gets one seed
 * for all iterations, any other a new one each time. Everything that decides the result is in the checkpoint, so a
 * resumed fit gives the same bits. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"
#include "runtime/base/threads.h"
#include "runtime/optimise/optimise.h"
#include "saltus/fit.h"

enum { MAX_VALUES = 1 << 28 }; /* floats of an image */
/* Flipped in the seed of the derivative after a loss of the caller's, so that its samples are others than those of the
 * image from which the adjoint came. */
enum { OTHER_SAMPLES = 0x40000000 };

/* A parameter that has another value in one view: where it lies, and that value. */
typedef struct OwnValue {
    ParamRef at;
    double *floats;
    int32_t *ints;
} OwnValue;

typedef struct View {
    const float *target, *mask; /* the caller's */
    OwnValue *values;
    uint32_t nvalues;
} View;

struct SltFit {
    SltProgram *p;
    SltFitOptions opt; /* strings and lists in it are read by slt_fit_begin only */
    SltJob job;
    char *checkpoint, key[256];
    View *views;
    uint32_t nviews;
    Optimiser *optimiser;
    OptimiseMethod method;
    uint32_t n, *index;     /* the active floats */
    double *gradient, *all; /* [n]; [nfloats], with minimize [channels][nfloats] */
    double *own_floats;     /* [nfloats], and own_ints [nints]: values in the view in hand */
    int32_t *own_ints;
    double *losses; /* [losses_cap] */
    size_t losses_cap;
    size_t nvalues;         /* floats of an image */
    float *image;           /* of the first view, the latest */
    float *other, *adjoint; /* with opt.loss: the image of any other view; the answer */
    uint32_t iteration;     /* how many are done: the length of losses */
    double start;           /* by pool_now() */
    SltFitStop stop;
    char reason[512];
    bool unsaved; /* the checkpoint could not be written, and is not tried again */
};

const char *slt_fit_optimizer(uint32_t index) {
    return index < OPTIMISE_METHODS ? optimise_name((OptimiseMethod)index) : NULL;
}

/* ---- set-up */
static SltStatus find_param(const SltProgram *p, const char *name, const char *what, ParamRef *at, SltError *err) {
    if (!name) return status_fail(err, SLT_USAGE, "%s: it has no name", what);
    return api_find(p, name, SLT_USAGE, what, at, err);
}

static SltStatus out_of_memory(SltError *err) { return status_fail(err, SLT_LIMIT, "out of memory for a fit"); }

/* Reads the caller's options, which may be of another version, and checks that they make one problem. */
static SltStatus take_options(SltFit *f, const SltFitOptions *given, SltError *err) {
    SltFitOptions *o = &f->opt;
    *o = SLT_FIT_OPTIONS_INIT;
    f->job = SLT_JOB_INIT;
    if (!api_struct_read(o, sizeof *o, given)) return api_struct_unknown(err, "SltFitOptions");
    if (o->job && !api_struct_read(&f->job, sizeof f->job, o->job)) return api_struct_unknown(err, "SltJob");
    f->job.progress = NULL, f->job.floats = NULL, f->job.ints = NULL;
    if (o->minimize && (o->nviews || o->loss))
        return status_fail(err, SLT_USAGE, "a fit that minimises the integral has no views and no other loss");
    if (o->nviews && !o->views) return status_fail(err, SLT_USAGE, "%u views of a fit, but no list of them", o->nviews);
    if (!o->minimize && !o->nviews && !o->loss)
        return status_fail(err, SLT_USAGE, "a fit wants views, a loss, or to minimise the integral");
    if (!optimise_find(o->optimizer ? o->optimizer : "adam", &f->method))
        return status_fail(err, SLT_USAGE, "there is no optimiser `%s`", o->optimizer);
    if (o->history > INT32_MAX || o->patience > INT32_MAX || o->max_failures > INT32_MAX)
        return status_fail(err, SLT_USAGE, "a history, patience or number of failures of the fit is out of range");
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

static bool room_for_losses(SltFit *f, size_t n) {
    if (n <= f->losses_cap) return true;
    size_t cap = n + n / 2 + 64;
    double *more = realloc(f->losses, cap * sizeof *more);
    if (more) f->losses = more, f->losses_cap = cap;
    return more != NULL;
}

static void *copy_of(const void *from, size_t count, size_t size) {
    void *to = malloc((count + 1) * size);
    if (to && count) memcpy(to, from, count * size);
    return to;
}

/* Reads a value that a parameter has in one view, and puts the common value back. */
static SltStatus read_value(SltProgram *p, const SltSet *set, OwnValue *v, SltError *err) {
    SltStatus status = find_param(p, set->name, "value of a view", &v->at, err);
    for (uint32_t i = 0; status == SLT_OK && i < v->at.fcount; i++)
        if (p->wrt[v->at.fbase + i])
            status =
                status_fail(err, SLT_INPUT, "`%s` is optimised; a view cannot give it a value of its own", set->name);
    if (status == SLT_OK) {
        v->floats = copy_of(p->floats + v->at.fbase, v->at.fcount, sizeof(double));
        v->ints = copy_of(p->ints + v->at.ibase, v->at.icount, sizeof(int32_t));
        if (!v->floats || !v->ints) return out_of_memory(err);
        status = api_set_text(p, set->name, set->value, err);
    }
    if (status == SLT_OK) {
        for (uint32_t i = 0; i < v->at.fcount; i++) {
            double own = p->floats[v->at.fbase + i];
            p->floats[v->at.fbase + i] = v->floats[i], v->floats[i] = own;
        }
        for (uint32_t i = 0; i < v->at.icount; i++) {
            int32_t own = p->ints[v->at.ibase + i];
            p->ints[v->at.ibase + i] = v->ints[i], v->ints[i] = own;
        }
        api_params_changed(p, v->at.fbase, v->at.fcount);
    }
    /* A view's values are data, as a scene file is: a bad one is bad input. */
    if (status == SLT_USAGE) status = SLT_INPUT, err->status = SLT_INPUT;
    return status;
}

static SltStatus read_views(SltFit *f, SltError *err) {
    f->nviews = f->opt.minimize ? 0 : f->opt.nviews ? f->opt.nviews : 1;
    f->views = calloc(f->nviews + 1, sizeof *f->views);
    if (!f->views) return out_of_memory(err);
    const char *at = (const char *)f->opt.views;
    for (uint32_t i = 0; i < f->opt.nviews; i++, at += f->opt.views->struct_size) {
        SltFitView given = SLT_FIT_VIEW_INIT;
        if (!api_struct_read(&given, sizeof given, at)) return api_struct_unknown(err, "SltFitView");
        View *v = &f->views[i];
        *v = (View){.target = given.target, .mask = given.mask};
        if (!given.target && !f->opt.loss) return status_fail(err, SLT_USAGE, "view %u has no target", i);
        v->values = calloc(given.nvalues + 1, sizeof *v->values);
        if (!v->values) return out_of_memory(err);
        while (v->nvalues < given.nvalues) {
            uint32_t k = v->nvalues++;
            SltStatus status = read_value(f->p, &given.values[k], &v->values[k], err);
            if (status != SLT_OK) return status;
        }
    }
    return SLT_OK;
}

/* The calls of a view get the program's parameters with the view's own values among them. */
static void use_view(SltFit *f, const View *v, SltJob *job) {
    job->floats = NULL, job->ints = NULL;
    if (!v->nvalues) return;
    memcpy(f->own_floats, f->p->floats, f->p->prog->nfloats * sizeof(double));
    memcpy(f->own_ints, f->p->ints, f->p->prog->nints * sizeof(int32_t));
    for (uint32_t k = 0; k < v->nvalues; k++) {
        const OwnValue *o = &v->values[k];
        memcpy(f->own_floats + o->at.fbase, o->floats, o->at.fcount * sizeof(double));
        memcpy(f->own_ints + o->at.ibase, o->ints, o->at.icount * sizeof(int32_t));
    }
    job->floats = f->own_floats, job->ints = f->own_ints;
}

static SltStatus find_grid(SltFit *f, const SltFitNumber *smooth, OptimiseGrid *g, SltError *err) {
    ParamRef at;
    SltStatus status = find_param(f->p, smooth->name, "smoothing", &at, err);
    if (status != SLT_OK) return status;
    const Type *t = at.type;
    uint32_t w = 1, h = 1, channels = 1;
    if (param_is_image(at.param)) {
        w = at.param->tex_w, h = at.param->tex_h, channels = at.param->tex_c;
    } else if (t->kind == T_ARRAY) {
        const Type *inner = t->elem;
        w = t->n;
        if (inner->kind == T_ARRAY) h = w, w = inner->n, inner = inner->elem;
        channels = type_components(inner);
        if (!type_is_float(inner))
            return status_fail(err, SLT_USAGE, "`%s` cannot be smoothed: a grid of floats or vectors is wanted",
                               smooth->name);
    } else {
        return status_fail(err, SLT_USAGE, "`%s` cannot be smoothed: a texture or an array is wanted", smooth->name);
    }
    uint32_t first = UINT32_MAX;
    for (uint32_t i = 0; i < f->n; i++)
        if (f->index[i] == at.fbase) first = i;
    if (first == UINT32_MAX || first + at.fcount > f->n || f->index[first + at.fcount - 1] != at.fbase + at.fcount - 1)
        return status_fail(err, SLT_USAGE, "`%s` cannot be smoothed: it is not optimised", smooth->name);
    *g = (OptimiseGrid){.offset = first,
                        .width = (int)w,
                        .height = (int)h,
                        .channels = (int)channels,
                        .stride_x = channels,
                        .stride_y = (size_t)w * channels,
                        .stride_c = 1,
                        .lambda = smooth->value};
    return SLT_OK;
}

static SltStatus set_rate(const SltFit *f, const SltFitNumber *given, double *rate, SltError *err) {
    ParamRef at = {.fcount = f->p->prog->nfloats};
    SltStatus status = given->name ? find_param(f->p, given->name, "learning rate", &at, err) : SLT_OK;
    for (uint32_t i = 0; status == SLT_OK && i < f->n; i++)
        if (f->index[i] >= at.fbase && f->index[i] < at.fbase + at.fcount) rate[i] = given->value;
    return status;
}

static SltStatus apply_mask(const SltFit *f, const SltFitMask *m, double *rate, SltError *err) {
    ParamRef at;
    SltStatus status = find_param(f->p, m->name, "mask", &at, err);
    if (status != SLT_OK) return status;
    uint64_t cells = (uint64_t)m->width * m->height;
    bool resource = param_is_image(at.param);
    if (!m->factors ||
        (resource ? m->width != at.param->tex_w || m->height != at.param->tex_h : !cells || at.fcount % cells))
        return status_fail(err, SLT_INPUT, "the mask of `%s` is %u x %u, but there are %u number%s%s", m->name,
                           m->width, m->height, at.fcount, at.fcount == 1 ? "" : "s",
                           resource ? " in another shape" : "");
    uint64_t each = cells ? at.fcount / cells : 1;
    for (uint32_t i = 0; i < f->n; i++) {
        if (f->index[i] < at.fbase || f->index[i] >= at.fbase + at.fcount) continue;
        uint64_t cell = (f->index[i] - at.fbase) / each;
        double factor = (double)m->factors[cell];
        if (!(factor >= 0) || isinf(factor))
            return status_fail(
                err, SLT_INPUT, "the mask of `%s` is %g in row %llu, column %llu; numbers from 0 (held) are wanted",
                m->name, factor, (unsigned long long)(cell / m->width), (unsigned long long)(cell % m->width));
        rate[i] *= factor;
    }
    return SLT_OK;
}

/* Bounds and scales are [Range] and [Log] of the declarations. */
static SltStatus make_optimiser(SltFit *f, SltError *err) {
    const SltFitOptions *o = &f->opt;
    size_t n = f->n;
    double *store = malloc(4 * n * sizeof *store);
    uint8_t *log = calloc(n, 1);
    OptimiseGrid *grids = calloc((size_t)o->nsmooth + 1, sizeof *grids);
    SltStatus status = store && log && grids ? SLT_OK : out_of_memory(err);
    double *start = store, *rate = store + n, *lo = store + 2 * n, *hi = store + 3 * n;
    for (uint32_t i = 0; status == SLT_OK && i < n; i++) {
        start[i] = f->p->floats[f->index[i]];
        rate[i] = optimise_rate(f->method);
        lo[i] = -INFINITY, hi[i] = INFINITY;
        for (uint32_t k = 0; k < f->p->prog->nparams; k++) {
            const Param *q = &f->p->prog->params[k];
            if (f->index[i] < q->fbase || f->index[i] >= q->fbase + q->fcount) continue;
            if (q->attrs.has_range) lo[i] = q->attrs.lo, hi[i] = q->attrs.hi;
            log[i] = q->attrs.log;
        }
    }
    for (uint32_t k = 0; status == SLT_OK && k < o->nrates; k++) status = set_rate(f, &o->rates[k], rate, err);
    for (uint32_t k = 0; status == SLT_OK && k < o->nrate_masks; k++)
        status = apply_mask(f, &o->rate_masks[k], rate, err);
    for (uint32_t k = 0; status == SLT_OK && k < o->nsmooth; k++) status = find_grid(f, &o->smooth[k], &grids[k], err);
    if (status == SLT_OK) {
        OptimiseConfig config = {.n = n,
                                 .method = f->method,
                                 .start = start,
                                 .learning_rate = rate,
                                 .lo = lo,
                                 .hi = hi,
                                 .log = log,
                                 .grids = grids,
                                 .grid_count = (int)o->nsmooth,
                                 .beta1 = o->beta1,
                                 .beta2 = o->beta2,
                                 .epsilon = o->epsilon,
                                 .momentum = o->momentum,
                                 .history = (int)o->history,
                                 .gradient_tolerance = o->gradient_tolerance,
                                 .loss_tolerance = o->loss_tolerance,
                                 .patience = (int)o->patience,
                                 .max_failures = (int)o->max_failures};
        f->optimiser = optimise_create(&config, err);
        if (!f->optimiser) status = err->status;
    }
    free(store);
    free(log);
    free(grids);
    return status;
}

/* ---- checkpoints: the losses so far go with the optimiser's state */
static uint32_t mix_double(uint32_t h, double v) {
    uint32_t words[2];
    memcpy(words, &v, sizeof words);
    return ir_mix(ir_mix(h, words[0]), words[1]);
}

/* The key of a checkpoint: a hash of shader, fixed parameters, targets, masks, values of the views and what the loss
 * is. */
static void hash_problem(Session *s, void *arg) {
    SltFit *f = arg;
    ArenaMark mark = arena_mark(&s->scratch);
    uint32_t h = 1;
    for (const char *c = ir_print_string(f->p->prog->primal, &s->scratch); *c; c++) h = ir_mix(h, (uint8_t)*c);
    arena_reset(&s->scratch, mark);
    for (uint32_t i = 0; i < f->p->prog->nfloats; i++)
        if (!f->p->wrt[i]) h = mix_double(h, f->p->floats[i]);
    for (uint32_t i = 0; i < f->p->prog->nints; i++) h = ir_mix(h, (uint32_t)f->p->ints[i]);
    h = ir_mix(h, f->job.no_interior | f->job.no_boundary << 1 | (f->opt.loss != NULL) << 2 | f->opt.minimize << 3);
    for (uint32_t v = 0; v < f->nviews; v++) {
        const View *view = &f->views[v];
        for (size_t i = 0; view->mask && i < f->nvalues; i++) h = mix_double(h, (double)view->mask[i]);
        for (size_t i = 0; view->target && i < f->nvalues; i++) {
            uint32_t bits;
            memcpy(&bits, &view->target[i], sizeof bits);
            h = ir_mix(h, bits);
        }
        for (uint32_t k = 0; k < view->nvalues; k++) {
            const OwnValue *o = &view->values[k];
            for (uint32_t i = 0; i < o->at.fcount; i++) h = mix_double(h, o->floats[i]);
            for (uint32_t i = 0; i < o->at.icount; i++) h = ir_mix(h, (uint32_t)o->ints[i]);
        }
    }
    for (const char *c = f->opt.loss ? f->opt.loss_name : NULL; c && *c; c++) h = ir_mix(h, (uint8_t)*c);
    snprintf(f->key, sizeof f->key,
             "saltus fit %08x %ux%u spp %u samples %llu segments %llu seed %u filter %d estimator %d optimizer %s", h,
             f->job.size[0], f->job.size[1], f->job.spp, (unsigned long long)f->job.samples,
             (unsigned long long)f->job.segments, f->job.seed, (int)f->job.filter, (int)f->job.estimator,
             optimise_name(f->method));
}

static SltStatus prepare_checkpoint(SltFit *f, SltError *err) {
    const SltFitOptions *o = &f->opt;
    if (!o->checkpoint && !o->resume) return SLT_OK;
    int unwound = session_protect(f->p->session, hash_problem, f);
    if (unwound) return status_fail(err, (SltStatus)unwound, "%s", f->p->session->unwind_text);
    if (o->checkpoint && !(f->checkpoint = strdup(o->checkpoint))) return out_of_memory(err);
    if (!o->resume) return SLT_OK;
    void *losses = NULL;
    size_t size = 0;
    SltStatus status = optimise_load(f->optimiser, o->resume, f->key, &losses, &size, err);
    if (status != SLT_OK) return status;
    f->iteration = (uint32_t)(size / sizeof *f->losses);
    if (!room_for_losses(f, f->iteration)) status = out_of_memory(err);
    else if (f->iteration) memcpy(f->losses, losses, f->iteration * sizeof *f->losses);
    free(losses);
    return status;
}

static SltStatus save(SltFit *f, SltError *err) {
    if (!f->checkpoint || f->unsaved) return SLT_OK;
    size_t size = f->iteration * sizeof *f->losses;
    SltStatus status = optimise_save(f->optimiser, f->checkpoint, f->key, f->losses, size, err);
    f->unsaved = status != SLT_OK;
    return status;
}

/* ---- beginning and ending */
static void free_fit(SltFit *f) {
    optimise_free(f->optimiser);
    for (uint32_t v = 0; f->views && v < f->nviews; v++) {
        for (uint32_t k = 0; k < f->views[v].nvalues; k++)
            free(f->views[v].values[k].floats), free(f->views[v].values[k].ints);
        free(f->views[v].values);
    }
    free(f->views);
    free(f->checkpoint);
    free(f->index);
    free(f->gradient);
    free(f->all);
    free(f->own_floats);
    free(f->own_ints);
    free(f->losses);
    free(f->image);
    free(f->other);
    free(f->adjoint);
    free(f);
}

static SltStatus allocate(SltFit *f, SltError *err) {
    size_t nf = slt_float_count(f->p), rows = f->opt.minimize ? slt_channels(f->p) : 1;
    f->index = calloc(nf + 1, sizeof *f->index);
    f->all = calloc(rows * (nf + 1), sizeof *f->all);
    f->own_floats = calloc(nf + 1, sizeof *f->own_floats);
    f->own_ints = calloc(slt_int_count(f->p) + 1, sizeof *f->own_ints);
    if (!f->opt.minimize) f->image = calloc(f->nvalues, sizeof *f->image);
    if (f->opt.loss)
        f->other = calloc(f->nvalues, sizeof *f->other), f->adjoint = calloc(f->nvalues, sizeof *f->adjoint);
    if (!f->index || !f->all || !f->own_floats || !f->own_ints || (!f->opt.minimize && !f->image) ||
        (f->opt.loss && (!f->other || !f->adjoint)))
        return out_of_memory(err);
    for (uint32_t i = 0; i < nf; i++)
        if (f->p->wrt[i]) f->index[f->n++] = i;
    if (!f->n) return status_fail(err, SLT_USAGE, "there is nothing to optimise: no differentiable parameter");
    f->gradient = calloc(f->n, sizeof *f->gradient);
    return f->gradient ? SLT_OK : out_of_memory(err);
}

/* Here and below: the program is held. */
static SltStatus begin(SltProgram *p, const SltFitOptions *options, SltFit **out, SltError *err) {
    if (atomic_load(&p->fitted))
        return status_fail(err, SLT_USAGE, "a fit of this program is under way: slt_fit_end first");
    SltFit *f = calloc(1, sizeof *f);
    if (!f) return out_of_memory(err);
    f->p = p;
    SltStatus status = take_options(f, options, err);
    if (status == SLT_OK) status = read_views(f, err);
    if (status == SLT_OK) status = allocate(f, err);
    if (status == SLT_OK) status = make_optimiser(f, err);
    if (status == SLT_OK) status = prepare_checkpoint(f, err);
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
static void set_active(SltFit *f, const double *x) {
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
    SltStatus status = save(f, err);
    double best;
    const double *x = optimise_best(f->optimiser, &best);
    if (isfinite(best)) set_active(f, x);
    if (result && api_struct_sized(result)) fill_result(f, result);
    atomic_store(&f->p->fitted, false);
    free_fit(f);
    return status;
}

/* ---- one evaluation */
/* The caller gets the image and gives its loss and adjoint image; the derivative of the image is then taken with other
 * samples, so that the noise in the adjoint is independent of the noise in the derivative. */
static SltStatus callers_loss(SltFit *f, const SltJob *job, uint32_t view, double *loss, SltError *err) {
    float *image = view == 0 ? f->image : f->other;
    SltFitRequest q = {.struct_size = sizeof q,
                       .iteration = f->iteration,
                       .view = view,
                       .views = f->nviews,
                       .pixels = {job->size[0], job->size[1], job->size[2]},
                       .channels = slt_channels(f->p),
                       .image = image};
    SltStatus status = slt_render(f->p, job, image, f->opt.stats, err);
    if (status == SLT_OK) status = f->opt.loss(f->opt.loss_user, &q, loss, f->adjoint, err);
    /* The optimiser steps back from a loss of NaN, and wants no gradient there. */
    if (status != SLT_OK || isnan(*loss)) return status;
    SltJob other = *job;
    other.seed ^= OTHER_SAMPLES;
    return slt_grad_adjoint(f->p, &other, f->adjoint, f->all, NULL, f->opt.stats, err);
}

static SltStatus evaluate_integral(SltFit *f, SltJob *job, double *loss, SltError *err) {
    uint32_t nf = slt_float_count(f->p);
    double *value = f->all + (size_t)slt_channels(f->p) * nf;
    SltIntegral out = SLT_INTEGRAL_INIT;
    out.value = value, out.gradient = f->all;
    job->replicates = 1;
    SltStatus status = slt_grad_integral(f->p, job, &out, f->opt.stats, err);
    for (uint32_t k = 0; status == SLT_OK && k < slt_channels(f->p); k++) {
        *loss += value[k];
        for (uint32_t i = 0; i < f->n; i++) f->gradient[i] += f->all[(size_t)k * nf + f->index[i]];
    }
    return status;
}

/* The mean over the views of the loss at the optimiser's point, into *loss and f->gradient. */
static SltStatus evaluate(SltFit *f, double *loss, SltError *err) {
    SltStatus status = SLT_OK;
    SltJob job = f->job;
    set_active(f, optimise_parameters(f->optimiser));
    if (!optimise_wants_same_loss(f->method)) job.seed += 0x9e3779b9u * (f->iteration + 1);
    memset(f->gradient, 0, f->n * sizeof *f->gradient);
    *loss = 0;
    if (f->opt.minimize) return evaluate_integral(f, &job, loss, err);
    for (uint32_t v = 0; v < f->nviews && status == SLT_OK; v++) {
        const View *view = &f->views[v];
        double one = 0;
        job.seed += v;
        use_view(f, view, &job);
        if (f->opt.loss) status = callers_loss(f, &job, v, &one, err);
        else
            status = slt_grad_loss(f->p, &job, view->target, view->mask, &one, f->all, NULL, v == 0 ? f->image : NULL,
                                   f->opt.stats, err);
        if (status != SLT_OK) break;
        *loss += one / f->nviews;
        for (uint32_t i = 0; i < f->n; i++) f->gradient[i] += f->all[f->index[i]] / f->nviews;
    }
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
                          .iteration = f->iteration,
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

static SltStatus step(SltFit *f, SltError *err) {
    double loss = 0, limit = f->job.time_limit;
    SltStatus status = SLT_OK;
    if (limit > 0 && pool_now() - f->start > limit) status = status_fail(err, SLT_LIMIT, "the time limit was reached");
    if (status == SLT_OK && !room_for_losses(f, (size_t)f->iteration + 1))
        return stopped(f, SLT_FIT_FAILED, out_of_memory(err), err->text);
    if (status == SLT_OK) status = evaluate(f, &loss, err);
    if (status == SLT_INTERRUPTED || (f->job.cancel && *f->job.cancel))
        return stopped(f, SLT_FIT_INTERRUPTED, status_fail(err, SLT_INTERRUPTED, "interrupted"), "interrupted");
    if (status == SLT_LIMIT && limit > 0) return stopped(f, SLT_FIT_TIME_LIMIT, status, err->text);
    if (status != SLT_OK) return stopped(f, SLT_FIT_FAILED, status, err->text);
    f->losses[f->iteration++] = loss;
    bool enough = tell(f, loss);
    OptimiseState state = optimise_step(f->optimiser, loss, f->gradient);
    if (f->opt.every && f->iteration % f->opt.every == 0 && (status = save(f, err)) != SLT_OK)
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
