/* The optimiser of a fit: learning rates, bounds, scales and smoothing of its floats. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bindings/c/fit_inner.h"

static SltStatus find_grid(SltFit *f, const SltFitNumber *smooth, OptimiseGrid *g, SltError *err) {
    ParamRef at;
    SltStatus status = fit_find_param(f->p, smooth->name, "smoothing", &at, err);
    if (status != SLT_OK) return status;
    const Type *t = at.type;
    uint32_t w = 1, h = 1, channels = 1;
    if (param_is_image(at.param) && at.param->tex_d)
        return status_fail(err, SLT_USAGE, "`%s` cannot be smoothed: a grid of two dimensions is wanted", smooth->name);
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
    uint32_t nfloats = f->p->prog->nfloats;
    ParamPattern named;
    uint8_t *mark = calloc(nfloats + 1, 1);
    SltStatus status = mark ? SLT_OK : fit_out_of_memory(err);
    if (mark && !given->name) memset(mark, 1, nfloats);
    else if (mark && (status = api_find_pattern(f->p, given->name, "learning rate", &named, err)) == SLT_OK)
        program_mark(&named, mark);
    for (uint32_t i = 0; status == SLT_OK && i < f->n; i++)
        if (mark[f->index[i]]) rate[i] = given->value;
    free(mark);
    return status;
}

static SltStatus apply_mask(const SltFit *f, const SltFitMask *m, double *rate, SltError *err) {
    ParamRef at;
    SltStatus status = fit_find_param(f->p, m->name, "mask", &at, err);
    if (status != SLT_OK) return status;
    uint64_t cells = (uint64_t)m->width * m->height;
    bool resource = param_is_image(at.param);
    uint64_t rows = (uint64_t)at.param->tex_h * (at.param->tex_d ? at.param->tex_d : 1); /* slices below each other */
    if (!m->factors || (resource ? m->width != at.param->tex_w || m->height != rows : !cells || at.fcount % cells))
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

/* Bounds and scales: [Range] and [Log] of the declarations. */
static SltStatus read_limits(const SltFit *f, double *lo, double *hi, uint8_t *log, SltError *err) {
    uint32_t at = 0;
    for (uint32_t k = 0; k < f->p->prog->nparams; k++) {
        const Param *q = &f->p->prog->params[k];
        uint32_t first = at;
        while (at < f->n && f->index[at] < q->fbase + q->fcount) at++;
        if (at == first) continue;
        double *bounds = malloc(2 * (size_t)q->fcount * sizeof *bounds);
        uint8_t *logs = malloc(q->fcount);
        if (bounds && logs) program_limits(q, bounds, bounds + q->fcount, logs);
        for (uint32_t i = first; bounds && logs && i < at; i++) {
            uint32_t own = f->index[i] - q->fbase;
            lo[i] = bounds[own], hi[i] = bounds[q->fcount + own], log[i] = logs[own];
        }
        bool ok = bounds && logs;
        free(bounds), free(logs);
        if (!ok) return fit_out_of_memory(err);
    }
    return SLT_OK;
}

SltStatus fit_make_optimiser(SltFit *f, SltError *err) {
    const SltFitOptions *o = &f->opt;
    size_t n = f->n;
    double *store = malloc(4 * n * sizeof *store);
    uint8_t *log = calloc(n, 1);
    OptimiseGrid *grids = calloc((size_t)o->nsmooth + 1, sizeof *grids);
    SltStatus status = store && log && grids ? SLT_OK : fit_out_of_memory(err);
    double *start = store, *rate = store + n, *lo = store + 2 * n, *hi = store + 3 * n;
    for (uint32_t i = 0; status == SLT_OK && i < n; i++) {
        start[i] = f->p->floats[f->index[i]];
        rate[i] = optimise_rate(f->method);
    }
    if (status == SLT_OK) status = read_limits(f, lo, hi, log, err);
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
