/* saltus fit: parameters that make the image match its targets, or that minimise the integral.
 *
 * Only the floats that are differentiated form the optimiser's vector. Adam and SGD take a new seed each iteration,
 * L-BFGS keeps one: its line search needs a fixed function. Everything that decides the result is in the checkpoint, so
 * a resumed run gives the same bits. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "cli/fit.h"
#include "cli/loss.h"
#include "runtime/optimise/optimise.h"

enum { FRAMES = 6 };
/* Flipped in the seed of the derivative behind an external loss: its samples are others than those of the image that
 * the adjoint came from. */
enum { OTHER_SAMPLES = 0x40000000 };

typedef struct Fit {
    Cli *c;
    SltProgram *p;
    Scene scene;
    Optimiser *o;
    uint32_t n, *index;     /* active floats */
    double *gradient, *all; /* [n], [nfloats] */
    double *losses;
    uint32_t iteration, nlosses;
    bool keep_seed;
    float *image;            /* of the first view, the latest */
    LossProgram *loss;       /* external; NULL: squared differences */
    float *handed, *adjoint; /* the image given to it, and its answer */
    Image frames[FRAMES];
    uint32_t nframes;
    uint32_t seed;
    double start;
    char key[256];
    const char *stopped; /* NULL: before there was anything to keep */
} Fit;

/* ---- set-up */
static int find_grid(Fit *f, const char *name, double lambda, OptimiseGrid *g) {
    ParamRef ref;
    const char *why = NULL;
    if (!program_find(f->p->prog, name, &ref, &why)) return cli_usage(f->c, "--smooth: %s", why ? why : name);
    const Type *t = ref.type;
    uint32_t w = 1, h = 1, channels = 1;
    if (param_is_image(ref.param)) {
        w = ref.param->tex_w, h = ref.param->tex_h, channels = ref.param->tex_c;
    } else if (t->kind == T_ARRAY) {
        const Type *inner = t->elem;
        w = t->n;
        if (inner->kind == T_ARRAY) h = w, w = inner->n, inner = inner->elem;
        channels = type_components(inner);
        if (!type_is_float(inner)) return cli_usage(f->c, "--smooth %s: a grid of floats or vectors is wanted", name);
    } else {
        return cli_usage(f->c, "--smooth %s: a texture or an array is wanted", name);
    }
    uint32_t first = UINT32_MAX;
    for (uint32_t i = 0; i < f->n; i++)
        if (f->index[i] == ref.fbase) first = i;
    if (first == UINT32_MAX || first + ref.fcount > f->n ||
        f->index[first + ref.fcount - 1] != ref.fbase + ref.fcount - 1)
        return cli_usage(f->c, "--smooth %s: it is not optimised", name);
    *g = (OptimiseGrid){.offset = first,
                        .width = (int)w,
                        .height = (int)h,
                        .channels = (int)channels,
                        .stride_x = channels,
                        .stride_y = (size_t)w * channels,
                        .stride_c = 1,
                        .lambda = lambda};
    return SLT_OK;
}

static int set_rate(Fit *f, double *rate, const char *name, double value) {
    ParamRef ref;
    const char *why = NULL;
    if (!name) {
        for (uint32_t i = 0; i < f->n; i++) rate[i] = value;
        return SLT_OK;
    }
    if (!program_find(f->p->prog, name, &ref, &why)) return cli_usage(f->c, "--lr: %s", why ? why : name);
    for (uint32_t i = 0; i < f->n; i++)
        if (f->index[i] >= ref.fbase && f->index[i] < ref.fbase + ref.fcount) rate[i] = value;
    return SLT_OK;
}

/* The learning rates of a parameter times its mask: 0 holds, 1 moves, between is slower. */
static int apply_mask(Fit *f, double *rate, const FitParam *q) {
    Cli *c = f->c;
    SltParam at;
    SltError err = {0};
    Image im;
    ImageReadOptions raw = {.raw = true};
    if (slt_param_find(f->p, q->name, &at, &err) != SLT_OK || image_read(q->mask, &raw, &im, &err) != SLT_OK)
        return cli_fail(c, &err);
    /* Arrays have the shape of a picture too: rows of columns. */
    uint64_t cells = (uint64_t)im.width * (uint64_t)im.height;
    uint64_t w = at.tex_w, h = at.tex_h;
    SltStatus status = SLT_OK;
    bool resource = at.is_texture || at.is_heightfield;
    if (resource ? (uint64_t)im.width != w || (uint64_t)im.height != h : cells == 0 || at.fcount % cells)
        status = status_fail(&err, SLT_INPUT, "%s is %d x %d, but `%s` has %u number%s%s", q->mask, im.width, im.height,
                             q->name, at.fcount, at.fcount == 1 ? "" : "s", resource ? " in another shape" : "");
    uint64_t each = cells ? at.fcount / cells : 1;
    for (uint32_t i = 0; status == SLT_OK && i < f->n; i++) {
        if (f->index[i] < at.fbase || f->index[i] >= at.fbase + at.fcount) continue;
        uint64_t cell = (f->index[i] - at.fbase) / each;
        double m = (double)im.data[cell * (uint64_t)im.channels];
        if (!(m >= 0) || isinf(m))
            status =
                status_fail(&err, SLT_INPUT,
                            "%s: the mask of `%s` is %g in row %llu, column %llu; numbers from 0 (held) are wanted",
                            q->mask, q->name, m, (unsigned long long)(cell / (uint64_t)im.width),
                            (unsigned long long)(cell % (uint64_t)im.width));
        rate[i] *= m;
    }
    image_free(&im);
    return status == SLT_OK ? SLT_OK : cli_fail(c, &err);
}

static int make_optimiser(Fit *f) {
    Cli *c = f->c;
    uint32_t n = f->n;
    double *store = calloc(4 * (size_t)n + 1, sizeof *store);
    uint8_t *log = calloc(n + 1, 1);
    OptimiseGrid grids[CLI_MAX_LIST];
    int ngrids = 0, status = store && log ? SLT_OK : SLT_LIMIT;
    double *start = store, *rate = store + n, *lo = store + 2 * (size_t)n, *hi = store + 3 * (size_t)n;
    for (uint32_t i = 0; status == SLT_OK && i < n; i++) {
        start[i] = slt_floats(f->p)[f->index[i]];
        rate[i] = !strcmp(c->optimizer, "lbfgs") ? 0.1 : 0.01;
        lo[i] = -INFINITY, hi[i] = INFINITY;
        for (uint32_t k = 0; k < f->p->prog->nparams; k++) {
            const Param *q = &f->p->prog->params[k];
            if (f->index[i] < q->fbase || f->index[i] >= q->fbase + q->fcount) continue;
            if (q->attrs.has_range) lo[i] = q->attrs.lo, hi[i] = q->attrs.hi;
            log[i] = q->attrs.log;
        }
    }
    /* From the general to the particular: a rate for all, the scene's, the command line's by name. */
    for (uint32_t k = 0; status == SLT_OK && k < c->nlr; k++)
        if (!c->lr[k].name) status = set_rate(f, rate, NULL, strtod(c->lr[k].value, NULL));
    for (uint32_t k = 0; status == SLT_OK && k < f->scene.nparams; k++) {
        const FitParam *q = &f->scene.params[k];
        bool given = false;
        for (uint32_t s = 0; s < c->nsmooth; s++) given |= c->smooth[s].name && !strcmp(c->smooth[s].name, q->name);
        if (q->lr >= 0) status = set_rate(f, rate, q->name, q->lr);
        if (status == SLT_OK && q->smooth > 0 && !given) status = find_grid(f, q->name, q->smooth, &grids[ngrids++]);
    }
    for (uint32_t k = 0; status == SLT_OK && k < c->nlr; k++)
        if (c->lr[k].name) status = set_rate(f, rate, c->lr[k].name, strtod(c->lr[k].value, NULL));
    for (uint32_t k = 0; status == SLT_OK && k < f->scene.nparams; k++)
        if (f->scene.params[k].mask) status = apply_mask(f, rate, &f->scene.params[k]);
    for (uint32_t k = 0; status == SLT_OK && k < c->nsmooth; k++)
        if (!c->smooth[k].name) status = cli_usage(c, "--smooth wants P=LAMBDA");
        else status = find_grid(f, c->smooth[k].name, strtod(c->smooth[k].value, NULL), &grids[ngrids++]);
    if (status == SLT_OK) {
        OptimiseMethod method = !strcmp(c->optimizer, "sgd")     ? OPTIMISE_SGD
                                : !strcmp(c->optimizer, "lbfgs") ? OPTIMISE_LBFGS
                                                                 : OPTIMISE_ADAM;
        OptimiseConfig config = {.n = n,
                                 .method = method,
                                 .start = start,
                                 .learning_rate = rate,
                                 .lo = lo,
                                 .hi = hi,
                                 .log = log,
                                 .grids = grids,
                                 .grid_count = ngrids};
        SltError err = {0};
        f->keep_seed = method == OPTIMISE_LBFGS;
        f->o = optimise_create(&config, &err);
        if (!f->o) status = cli_fail(c, &err);
    }
    free(store);
    free(log);
    return status;
}

static bool on_command_line(const Cli *c, const char *name) {
    for (uint32_t k = 0; k < c->nparams; k++)
        if (!strcmp(c->params[k].name, name)) return true;
    return false;
}

static int apply_scene_params(Fit *f) {
    SltError err = {0};
    const char *names[CLI_MAX_LIST];
    uint32_t nnames = 0;
    bool any_grad = false;
    for (uint32_t k = 0; k < f->scene.nparams; k++) any_grad |= f->scene.params[k].grad == 1;
    for (uint32_t k = 0; k < f->scene.nparams; k++) {
        FitParam *q = &f->scene.params[k];
        SltParam found;
        if (slt_param_find(f->p, q->name, &found, &err) != SLT_OK) return err.status = SLT_INPUT, cli_fail(f->c, &err);
        bool set = !on_command_line(f->c, q->name);
        if (set && q->value && slt_set_text(f->p, q->name, q->value, &err) != SLT_OK)
            return err.status = SLT_INPUT, cli_fail(f->c, &err);
        if (set && q->file) {
            char *at = malloc(strlen(q->file) + 2);
            if (!at) return SLT_LIMIT;
            sprintf(at, "@%s", q->file);
            SltStatus status = slt_set_text(f->p, q->name, at, &err);
            free(at);
            if (status != SLT_OK) return cli_fail(f->c, &err);
        }
        if (q->grad == 1 && nnames < CLI_MAX_LIST) names[nnames++] = q->name;
    }
    /* "grad": true names what is optimised; otherwise everything but what says false. */
    if (f->c->nwrt) return SLT_OK;
    if (!any_grad)
        for (uint32_t i = 0; i < f->p->prog->nparams; i++) {
            const Param *q = &f->p->prog->params[i];
            bool off = !q->differentiable || !q->fcount;
            for (uint32_t k = 0; k < f->scene.nparams; k++)
                off |= f->scene.params[k].grad == 0 && !strcmp(f->scene.params[k].name, q->name);
            if (!off && nnames < CLI_MAX_LIST) names[nnames++] = q->name;
        }
    if (f->scene.nparams && nnames && slt_wrt(f->p, names, nnames, &err) != SLT_OK)
        return err.status = SLT_INPUT, cli_fail(f->c, &err);
    return SLT_OK;
}

static void *copy_of(const void *from, size_t count, size_t size) {
    void *to = malloc(2 * (count + 1) * size);
    if (to) memcpy(to, from, count * size), memcpy((char *)to + (count + 1) * size, from, count * size);
    return to;
}

/* Reads the values of a view's own parameters, once, and puts the common ones back. */
static int read_view_values(Fit *f, View *v) {
    SltProgram *p = f->p;
    SltError err = {0};
    v->values = calloc(v->nparams + 1, sizeof *v->values);
    if (!v->values) return fputs("saltus: out of memory\n", stderr), SLT_LIMIT;
    for (uint32_t k = 0; k < v->nparams; k++) {
        ViewValue *o = &v->values[k];
        const char *name = v->params[k].name;
        if (slt_param_find(p, name, &o->at, &err) != SLT_OK) return err.status = SLT_INPUT, cli_fail(f->c, &err);
        for (uint32_t i = 0; i < o->at.fcount; i++)
            if (slt_wrt_mask(p)[o->at.fbase + i]) {
                fprintf(stderr, "saltus: `%s` is optimised; a view cannot give it a value of its own\n", name);
                return SLT_INPUT;
            }
        o->floats = copy_of(slt_floats(p) + o->at.fbase, o->at.fcount, sizeof(double));
        o->ints = copy_of(slt_ints(p) + o->at.ibase, o->at.icount, sizeof(int32_t));
        if (!o->floats || !o->ints) return fputs("saltus: out of memory\n", stderr), SLT_LIMIT;
        o->base_floats = o->floats + o->at.fcount + 1, o->base_ints = o->ints + o->at.icount + 1;
        if (slt_set_text(p, name, v->params[k].value, &err) != SLT_OK)
            return err.status = err.status == SLT_USAGE ? SLT_INPUT : err.status, cli_fail(f->c, &err);
        memcpy(o->floats, slt_floats(p) + o->at.fbase, o->at.fcount * sizeof(double));
        if (o->at.icount) memcpy(o->ints, slt_ints(p) + o->at.ibase, o->at.icount * sizeof(int32_t));
        slt_set_floats(p, o->at.fbase, o->at.fcount, o->base_floats, &err);
        slt_set_ints(p, o->at.ibase, o->at.icount, o->base_ints, &err);
    }
    return SLT_OK;
}

static void use_view(Fit *f, const View *v, bool own) {
    for (uint32_t k = 0; k < v->nparams; k++) {
        const ViewValue *o = &v->values[k];
        slt_set_floats(f->p, o->at.fbase, o->at.fcount, own ? o->floats : o->base_floats, NULL);
        slt_set_ints(f->p, o->at.ibase, o->at.icount, own ? o->ints : o->base_ints, NULL);
    }
}

static int read_targets(Fit *f) {
    Cli *c = f->c;
    int status = SLT_OK;
    if (c->target && f->scene.nviews) return cli_usage(c, "--target and the scene's views were both given");
    if (c->minimize && c->loss_command) return cli_usage(c, "--minimize and --loss-command are two losses");
    if (c->target || (c->loss_command && !f->scene.nviews)) {
        f->scene.views = calloc(1, sizeof *f->scene.views);
        if (!f->scene.views) return SLT_LIMIT;
        f->scene.nviews = 1;
        f->scene.views[0].target_path = (char *)c->target;
    }
    if (!f->scene.nviews && !c->minimize)
        return cli_usage(c, "fit wants --target IMAGE, --minimize, --loss-command PROGRAM, or a scene with views");
    if (f->scene.nviews && c->minimize) return cli_usage(c, "--minimize has no target");
    if (c->minimize) return SLT_OK;
    for (uint32_t v = 0; status == SLT_OK && v < f->scene.nviews; v++) status = read_view_values(f, &f->scene.views[v]);
    if (status != SLT_OK || c->loss_command) return status;
    /* Without --size the first target decides. */
    if (!c->size_given) {
        SltError err = {0};
        Image im;
        if (image_read(f->scene.views[0].target_path, NULL, &im, &err) != SLT_OK) return cli_fail(c, &err);
        c->job.size[0] = (uint32_t)im.width, c->job.size[1] = (uint32_t)im.height, c->job.size[2] = 1;
        image_free(&im);
    }
    for (uint32_t v = 0; v < f->scene.nviews; v++) {
        status = cli_read_image(c, f->p, f->scene.views[v].target_path, true, &f->scene.views[v].target);
        if (status == SLT_OK && f->scene.views[v].mask_path) {
            float *mask = NULL;
            status = cli_read_image(c, f->p, f->scene.views[v].mask_path, true, &mask);
            f->scene.views[v].mask = mask;
        }
        if (status != SLT_OK) return status;
    }
    return SLT_OK;
}

/* ---- one evaluation */
/* The optimised floats lie in runs: whole parameters, mostly. */
static void set_active(Fit *f, const double *x) {
    for (uint32_t i = 0, n; i < f->n; i += n) {
        for (n = 1; i + n < f->n && f->index[i + n] == f->index[i] + n; n++) {
        }
        slt_set_floats(f->p, f->index[i], n, x + i, NULL);
    }
}

/* The image goes out, the loss and its adjoint image come back; the derivative of the image is then taken with other
 * samples, so that what noise did to the adjoint is independent of what it does to the derivative. */
static SltStatus external_loss(Fit *f, const SltJob *job, uint32_t view, double *loss, SltStats *stats, SltError *err) {
    Cli *c = f->c;
    const View *v = &f->scene.views[view];
    LossRequest q = {.iteration = f->iteration,
                     .view = view,
                     .views = f->scene.nviews,
                     .width = job->size[0],
                     .height = job->size[1],
                     .channels = slt_channels(f->p),
                     .target = v->target_path,
                     .mask = v->mask_path,
                     .deadline = c->max_seconds > 0 ? f->start + c->max_seconds : 0};
    float *image = view == 0 ? f->image : f->handed;
    SltStatus s = slt_render(f->p, job, image, stats, err);
    if (s == SLT_OK) s = loss_exchange(f->loss, &q, image, loss, f->adjoint, err);
    if (s != SLT_OK || isnan(*loss))
        return s; /* the optimiser steps back from what is no number: it wants no gradient there */
    SltJob other = *job;
    other.seed ^= OTHER_SAMPLES;
    return slt_grad_adjoint(f->p, &other, f->adjoint, f->all, NULL, stats, err);
}

static SltStatus evaluate(Fit *f, double *loss, SltStats *total, SltError *err) {
    Cli *c = f->c;
    uint32_t nf = slt_float_count(f->p), ch = slt_channels(f->p);
    const double *x = optimise_parameters(f->o);
    set_active(f, x);
    SltJob job = c->job;
    job.seed = f->keep_seed ? f->seed : f->seed + 0x9e3779b9u * (f->iteration + 1);
    for (uint32_t i = 0; i < f->n; i++) f->gradient[i] = 0;
    *loss = 0;
    SltStats stats = {0};
    SltStatus status = SLT_OK;
    if (c->minimize) {
        double value[4];
        job.integral = true;
        job.replicates = 1;
        SltIntegral out = {.value = value, .gradient = f->all};
        status = slt_grad_integral(f->p, &job, &out, &stats, err);
        for (uint32_t k = 0; status == SLT_OK && k < ch; k++) {
            *loss += value[k];
            for (uint32_t i = 0; i < f->n; i++) f->gradient[i] += f->all[(size_t)k * nf + f->index[i]];
        }
        total->samples += stats.samples, total->truncated += stats.truncated, total->asserts += stats.asserts;
        return status;
    }
    for (uint32_t v = 0; v < f->scene.nviews && status == SLT_OK; v++) {
        View *view = &f->scene.views[v];
        double one = 0;
        job.seed += v;
        use_view(f, view, true);
        if (f->loss) status = external_loss(f, &job, v, &one, &stats, err);
        else
            status = slt_grad_loss(f->p, &job, view->target, view->mask, &one, f->all, NULL, v == 0 ? f->image : NULL,
                                   &stats, err);
        use_view(f, view, false);
        if (status != SLT_OK) break;
        *loss += one / f->scene.nviews;
        for (uint32_t i = 0; i < f->n; i++) f->gradient[i] += f->all[f->index[i]] / f->scene.nviews;
        total->samples += stats.samples, total->crossings += stats.crossings, total->truncated += stats.truncated,
            total->asserts += stats.asserts;
        for (int r = 0; r < SLT_DROP_REASONS; r++) total->dropped[r] += stats.dropped[r];
    }
    return status;
}

static void keep_frame(Fit *f) {
    if (!f->image || f->nframes >= FRAMES) return;
    uint32_t ch = slt_channels(f->p);
    Image *im = &f->frames[f->nframes];
    SltError err = {0};
    if (image_create(im, (int)f->c->job.size[0], (int)f->c->job.size[1], (int)ch, &err) != SLT_OK) return;
    memcpy(im->data, f->image, (size_t)im->width * (size_t)im->height * ch * sizeof(float));
    f->nframes++;
}

/* ---- checkpoints: the losses so far are the blob */
static void make_key(Fit *f) {
    char *ir = ir_print_string(f->p->prog->primal, &f->p->session->module);
    uint32_t h = 1;
    for (const char *s = ir; *s; s++) h = ir_mix(h, (uint8_t)*s);
    for (uint32_t v = 0; v < f->scene.nviews; v++) {
        size_t values = (size_t)f->c->job.size[0] * f->c->job.size[1] * slt_channels(f->p);
        const uint32_t *bits = (const uint32_t *)f->scene.views[v].target;
        for (size_t i = 0; bits && i < values; i++) h = ir_mix(h, bits[i]);
        for (uint32_t k = 0; k < f->scene.views[v].nparams; k++) {
            const ViewValue *o = &f->scene.views[v].values[k];
            const uint32_t *words = (const uint32_t *)o->floats;
            for (size_t i = 0; i < 2 * (size_t)o->at.fcount; i++) h = ir_mix(h, words[i]);
            for (size_t i = 0; i < o->at.icount; i++) h = ir_mix(h, (uint32_t)o->ints[i]);
        }
    }
    for (const char *s = f->c->loss_command; s && *s; s++) h = ir_mix(h, (uint8_t)*s);
    snprintf(f->key, sizeof f->key,
             "saltus fit %08x %ux%u spp %u samples %llu segments %llu seed %u filter %d estimator %d optimizer %s", h,
             f->c->job.size[0], f->c->job.size[1], f->c->job.spp, (unsigned long long)f->c->job.samples,
             (unsigned long long)f->c->job.segments, f->seed, (int)f->c->job.filter, (int)f->c->job.estimator,
             f->c->optimizer);
}

static SltStatus save(Fit *f, SltError *err) {
    return f->c->checkpoint
               ? optimise_save(f->o, f->c->checkpoint, f->key, f->losses, f->nlosses * sizeof *f->losses, err)
               : SLT_OK;
}

static SltStatus resume(Fit *f, SltError *err) {
    void *blob = NULL;
    size_t size = 0;
    SltStatus status = optimise_load(f->o, f->c->resume, f->key, &blob, &size, err);
    if (status != SLT_OK) return status;
    f->nlosses = (uint32_t)(size / sizeof *f->losses);
    if (f->nlosses > f->c->iters) f->nlosses = f->c->iters;
    if (blob) memcpy(f->losses, blob, f->nlosses * sizeof *f->losses);
    f->iteration = f->nlosses;
    free(blob);
    return SLT_OK;
}

/* ---- the loop */
static int run(Fit *f, SltStats *total) {
    Cli *c = f->c;
    SltError err = {0};
    Progress pr;
    progress_begin(&pr, c, "fit");
    f->stopped = "iters";
    int status = SLT_OK;
    while (f->iteration < c->iters) {
        double loss;
        if (c->max_seconds > 0 && cli_now() - f->start > c->max_seconds) {
            f->stopped = "interrupted";
            status = SLT_LIMIT;
            break;
        }
        SltStatus s = evaluate(f, &loss, total, &err);
        if (s == SLT_INTERRUPTED || cli_interrupted()) {
            f->stopped = "interrupted";
            status = SLT_INTERRUPTED;
            break;
        }
        if (s == SLT_LIMIT && c->max_seconds > 0 && f->nlosses) {
            f->stopped = "interrupted";
            status = SLT_LIMIT;
            break;
        }
        /* The loss program failed: what is best so far is kept, as after an interrupt. */
        if (s == SLT_CHECK_FAILED || (s == SLT_LIMIT && f->loss)) {
            status = cli_fail(c, &err);
            f->stopped = f->nlosses ? "failed" : NULL;
            break;
        }
        if (s != SLT_OK) {
            progress_end(&pr);
            return cli_fail(c, &err);
        }
        f->losses[f->nlosses++] = loss;
        f->iteration++;
        if (f->nframes < FRAMES - 1 && (f->iteration - 1) * (uint64_t)(FRAMES - 1) >= (uint64_t)f->nframes * c->iters)
            keep_frame(f);
        OptimiseState state = optimise_step(f->o, loss, f->gradient);
        char detail[96];
        snprintf(detail, sizeof detail, "iteration %u of %u, loss %.6g", f->iteration, c->iters, loss);
        progress_update(&pr, (double)f->iteration / c->iters, detail);
        if (c->checkpoint && f->iteration % c->every == 0 && save(f, &err) != SLT_OK) {
            progress_end(&pr);
            return cli_fail(c, &err);
        }
        if (state == OPTIMISE_CONVERGED) {
            f->stopped = "converged";
            break;
        }
        if (state == OPTIMISE_FAILED) {
            progress_end(&pr);
            fprintf(stderr, "saltus: the fit failed: %s\n", optimise_reason(f->o));
            f->stopped = "failed";
            status = SLT_CHECK_FAILED;
            break;
        }
    }
    progress_end(&pr);
    if (save(f, &err) != SLT_OK) return cli_fail(c, &err);
    return status;
}

/* ---- outputs */
static SltStatus join(char *out, size_t size, const char *dir, const char *name, SltError *err) {
    if (snprintf(out, size, "%s/%s", dir, name) >= (int)size)
        return status_fail(err, SLT_OUTPUT, "%s/%s: the path is too long", dir, name);
    return SLT_OK;
}

/* A height map as a person reads one: its relief under a sun in the north west, tinted by height. */
static SltStatus write_relief(const char *path, const Param *q, const Image *h, SltError *err) {
    int w = h->width, n = h->height;
    double wide = q->attrs.has_extent ? q->attrs.extent[2] - q->attrs.extent[0] : 1,
           high = q->attrs.has_extent ? q->attrs.extent[3] - q->attrs.extent[1] : 1;
    double scale = q->attrs.has_height ? q->attrs.height_scale : 1, lo = INFINITY, hi = -INFINITY;
    uint8_t *rgb = malloc((size_t)w * (size_t)n * 3);
    if (!rgb) return status_fail(err, SLT_LIMIT, "out of memory");
    for (size_t i = 0; i < (size_t)w * (size_t)n; i++)
        lo = fmin(lo, (double)h->data[i]), hi = fmax(hi, (double)h->data[i]);
    for (int y = 0; y < n; y++)
        for (int x = 0; x < w; x++) {
            int x0 = x > 0 ? x - 1 : 0, x1 = x + 1 < w ? x + 1 : x, y0 = y > 0 ? y - 1 : 0, y1 = y + 1 < n ? y + 1 : y;
            const float *v = h->data;
            double at = (double)v[(size_t)y * (size_t)w + (size_t)x];
            double gx =
                scale *
                ((double)v[(size_t)y * (size_t)w + (size_t)x1] - (double)v[(size_t)y * (size_t)w + (size_t)x0]) /
                (x1 - x0) * (w - 1) / wide;
            double gy =
                scale *
                ((double)v[(size_t)y0 * (size_t)w + (size_t)x] - (double)v[(size_t)y1 * (size_t)w + (size_t)x]) /
                (y1 - y0) * (n - 1) / high;
            double light = (gx * 0.5 - gy * 0.5 + 0.7071) / sqrt(gx * gx + gy * gy + 1);
            uint8_t tint[3];
            colormap_sequential(hi > lo ? (at - lo) / (hi - lo) : 0.5, tint);
            for (int k = 0; k < 3; k++)
                rgb[((size_t)y * (size_t)w + (size_t)x) * 3 + (size_t)k] =
                    (uint8_t)(fmin(fmax(light, 0) + 0.15, 1) * tint[k] + 0.5);
        }
    SltStatus s = image_write_png8(path, w, n, 3, rgb, err);
    free(rgb);
    return s;
}

/* Every texture and heightfield that was optimised: NAME.exr to go on with, NAME.png to look at. */
static SltStatus write_grids(Fit *f, SltError *err) {
    char path[4096], name[512];
    for (uint32_t k = 0; k < f->p->prog->nparams; k++) {
        const Param *q = &f->p->prog->params[k];
        if (!param_is_image(q) || !q->fcount || !slt_wrt_mask(f->p)[q->fbase]) continue;
        Image im;
        SltStatus s = image_create(&im, (int)q->tex_w, (int)q->tex_h, (int)q->tex_c, err);
        if (s != SLT_OK) return s;
        for (uint32_t i = 0; i < q->fcount; i++) im.data[i] = (float)slt_floats(f->p)[q->fbase + i];
        snprintf(name, sizeof name, "%.500s.exr", q->name);
        s = join(path, sizeof path, f->c->output, name, err);
        if (s == SLT_OK) s = image_write(path, &im, NULL, err);
        snprintf(name, sizeof name, "%.500s.png", q->name);
        if (s == SLT_OK) s = join(path, sizeof path, f->c->output, name, err);
        if (s == SLT_OK) s = q->is_geometry ? write_relief(path, q, &im, err) : image_write(path, &im, NULL, err);
        image_free(&im);
        if (s != SLT_OK) return s;
    }
    return SLT_OK;
}

static SltStatus write_folder(Fit *f, const char *json, SltError *err) {
    char path[4096];
    const char *dir = f->c->output;
    uint32_t ch = slt_channels(f->p);
    if (mkdir(dir, 0777) != 0 && errno != EEXIST)
        return status_fail_errno(err, SLT_OUTPUT, errno, "cannot make the folder %s", dir);
    SltStatus s = join(path, sizeof path, dir, "fitted.json", err);
    if (s == SLT_OK) s = file_write_atomic(path, json, strlen(json), err);
    double *x = malloc((f->nlosses + 1) * sizeof *x);
    for (uint32_t i = 0; x && i < f->nlosses; i++) x[i] = i + 1;
    PlotSeries series = {.name = "loss", .x = x, .y = f->losses, .count = (int)f->nlosses};
    PlotOptions plot = {.title = "loss", .x_label = "iteration", .y_label = "loss", .log_y = true};
    char *svg = s == SLT_OK && x && f->nlosses ? plot_svg(&plot, &series, 1, err) : NULL;
    if (svg && (s = join(path, sizeof path, dir, "loss.svg", err)) == SLT_OK)
        s = file_write_atomic(path, svg, strlen(svg), err);
    free(svg);
    free(x);
    char *csv = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&csv, &size);
    if (out) {
        fputs("iteration,loss\n", out);
        for (uint32_t i = 0; i < f->nlosses; i++) fprintf(out, "%u,%.17g\n", i + 1, f->losses[i]);
        fclose(out);
        if (s == SLT_OK && (s = join(path, sizeof path, dir, "loss.csv", err)) == SLT_OK)
            s = file_write_atomic(path, csv, size, err);
        free(csv);
    }
    if (s == SLT_OK) s = write_grids(f, err);
    if (s != SLT_OK || f->c->minimize) return s;
    /* The image of the best parameters. */
    Image im;
    if ((s = image_create(&im, (int)f->c->job.size[0], (int)f->c->job.size[1], (int)ch, err)) != SLT_OK) return s;
    SltJob job = f->c->job;
    job.cancel = NULL;
    use_view(f, &f->scene.views[0], true);
    s = slt_render(f->p, &job, im.data, NULL, err);
    use_view(f, &f->scene.views[0], false);
    for (uint32_t k = 0; k < ch; k++) image_set_name(&im, (int)k, report_channel(ch, k));
    report_metadata(&im, f->c, f->p);
    if (s == SLT_OK && (s = join(path, sizeof path, dir, "image.exr", err)) == SLT_OK)
        s = image_write(path, &im, NULL, err);
    if (s == SLT_OK && (s = join(path, sizeof path, dir, "image.png", err)) == SLT_OK)
        s = image_write(path, &im, NULL, err);
    const Image *strip[FRAMES + 2];
    int n = 0;
    for (uint32_t k = 0; k < f->nframes; k++) strip[n++] = &f->frames[k];
    strip[n++] = &im;
    Image target = {.width = im.width, .height = im.height, .channels = im.channels, .data = f->scene.views[0].target},
          film;
    if (target.data) strip[n++] = &target;
    if (s == SLT_OK && image_film_strip(strip, n, 4, &film, err) == SLT_OK) {
        if ((s = join(path, sizeof path, dir, "strip.png", err)) == SLT_OK) s = image_write(path, &film, NULL, err);
        image_free(&film);
    }
    image_free(&im);
    return s;
}

static int write_outputs(Fit *f) {
    SltError err = {0};
    char *json = slt_params_json(f->p);
    SltStatus s = json ? SLT_OK : status_fail(&err, SLT_LIMIT, "out of memory");
    if (s == SLT_OK && f->c->output) {
        size_t n = strlen(f->c->output);
        if (n > 5 && !strcmp(f->c->output + n - 5, ".json"))
            s = file_write_atomic(f->c->output, json, strlen(json), &err);
        else s = write_folder(f, json, &err);
    }
    if (s == SLT_OK && f->c->json) {
        double best = NAN;
        optimise_best(f->o, &best);
        fputs("{\"initial_loss\": ", stdout);
        json_number(stdout, f->nlosses ? f->losses[0] : NAN);
        fputs(", \"loss\": ", stdout);
        json_number(stdout, f->nlosses ? best : NAN);
        fputs(", \"losses\": [", stdout);
        for (uint32_t i = 0; i < f->nlosses; i++) fputs(i ? ", " : "", stdout), json_number(stdout, f->losses[i]);
        printf("], \"iterations\": %u, \"seconds\": ", f->nlosses);
        json_number(stdout, cli_now() - f->start);
        printf(", \"stopped\": \"%s\", \"params\": %s, \"outputs\": [", f->stopped, json);
        if (f->c->output) json_text(stdout, f->c->output);
        fputs("], ", stdout);
        report_warnings_json(stdout, f->p);
        fputs("}\n", stdout);
    } else if (s == SLT_OK) {
        double best = NAN;
        optimise_best(f->o, &best);
        printf("loss %.6g -> %.6g in %u iterations, %.1f s (%s)\n", f->nlosses ? f->losses[0] : NAN, best, f->nlosses,
               cli_now() - f->start, f->stopped);
        if (!f->c->output) fputs(json, stdout);
    }
    free(json);
    return s == SLT_OK ? SLT_OK : cli_fail(f->c, &err);
}

static void absolute(Scene *s, char **path) {
    char *full = *path ? realpath(*path, NULL) : NULL;
    if (full) *path = scene_keep(s, full);
}

static int fit(Fit *f) {
    Cli *c = f->c;
    SltError err = {0};
    if (c->minimize) c->job.integral = true;
    int status = apply_scene_params(f);
    if (status == SLT_OK) status = read_targets(f);
    if (status == SLT_OK) status = cli_prepare_job(c, f->p);
    if (status != SLT_OK) return status;
    uint32_t nf = slt_float_count(f->p);
    f->seed = c->job.seed;
    f->index = calloc(nf + 1, sizeof *f->index);
    f->gradient = calloc(nf + 1, sizeof *f->gradient);
    f->all = calloc((size_t)nf * 4 + 1, sizeof *f->all);
    f->losses = calloc((size_t)c->iters + 1, sizeof *f->losses);
    if (!c->minimize)
        f->image = calloc((size_t)c->job.size[0] * c->job.size[1] * slt_channels(f->p) + 1, sizeof *f->image);
    size_t pixels = (size_t)c->job.size[0] * c->job.size[1] * slt_channels(f->p);
    if (c->loss_command)
        f->handed = calloc(pixels + 1, sizeof *f->handed), f->adjoint = calloc(pixels + 1, sizeof *f->adjoint);
    if (c->loss_command && (!f->handed || !f->adjoint)) return fputs("saltus: out of memory\n", stderr), SLT_LIMIT;
    if (!f->index || !f->gradient || !f->all || !f->losses || (!c->minimize && !f->image))
        return fputs("saltus: out of memory\n", stderr), SLT_LIMIT;
    for (uint32_t i = 0; i < nf; i++)
        if (slt_wrt_mask(f->p)[i]) f->index[f->n++] = i;
    if (!f->n) return cli_usage(c, "there is nothing to optimise: no differentiable parameter");
    status = make_optimiser(f);
    if (status != SLT_OK) return status;
    make_key(f);
    if (c->resume) {
        if (!c->checkpoint) c->checkpoint = c->resume;
        if (resume(f, &err) != SLT_OK) return cli_fail(c, &err);
    }
    f->start = cli_now();
    /* The program may run in another folder than we do. */
    for (uint32_t v = 0; c->loss_command && f->scene.loss_dir && v < f->scene.nviews; v++)
        absolute(&f->scene, &f->scene.views[v].target_path), absolute(&f->scene, &f->scene.views[v].mask_path);
    if (c->loss_command && !(f->loss = loss_start(c->loss_command, f->scene.loss_dir, c->loss_timeout, &err)))
        return cli_fail(c, &err);
    SltStats total = {0};
    int ran = run(f, &total);
    loss_stop(f->loss);
    f->loss = NULL;
    if (!f->stopped) return ran;
    if (ran != SLT_OK && ran != SLT_INTERRUPTED && ran != SLT_CHECK_FAILED && ran != SLT_LIMIT) return ran;
    double best;
    const double *x = optimise_best(f->o, &best);
    if (isfinite(best)) set_active(f, x);
    report_dropped(c, &total);
    status = write_outputs(f);
    if (status == SLT_OK) status = ran;
    return status == SLT_OK && total.asserts ? SLT_CHECK_FAILED : status;
}

int verb_fit(Cli *c) {
    Fit f = {.c = c};
    int status = SLT_OK;
    cli_catch_interrupt(c);
    const char *scene_file = c->file;
    if (scene_is(c->file)) {
        status = scene_read(c, scene_file, &f.scene);
        if (status == SLT_OK) c->file = f.scene.shader;
    }
    if (status == SLT_OK) status = cli_compile(c, &f.p);
    if (status == SLT_OK) status = fit(&f);
    loss_stop(f.loss);
    if (f.o) optimise_free(f.o);
    free(f.handed);
    free(f.adjoint);
    for (uint32_t k = 0; k < f.nframes; k++) image_free(&f.frames[k]);
    free(f.index);
    free(f.gradient);
    free(f.all);
    free(f.losses);
    free(f.image);
    slt_program_free(f.p);
    if (c->file == f.scene.shader) c->file = scene_file;
    scene_free(&f.scene);
    return status;
}
