/* The optimiser of a fit: learning rates, bounds, scales and smoothing of its floats. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bindings/c/fit_inner.h"

/* The pairs of neighbours in a grid of three dimensions. */
static uint32_t *grid_edges(uint32_t w, uint32_t h, uint32_t d, size_t *n) {
    uint32_t *edges = malloc((size_t)w * h * d * 6 * sizeof *edges), *to = edges;
    for (uint32_t i = 0; edges && i < w * h * d; i++) {
        uint32_t x = i % w, y = i / w % h, z = i / w / h;
        if (x + 1 < w) *to++ = i, *to++ = i + 1;
        if (y + 1 < h) *to++ = i, *to++ = i + w;
        if (z + 1 < d) *to++ = i, *to++ = i + w * h;
    }
    *n = edges ? (size_t)(to - edges) / 2 : 0;
    return edges;
}

/* The sides of triangles, so many integers. */
static uint32_t *sides_of(const int32_t *faces, uint32_t n, size_t *nedges) {
    uint32_t *to = malloc((2 * (size_t)n + 1) * sizeof *to);
    for (uint32_t i = 0; to && i < n; i++) {
        const int32_t *face = faces + i / 3 * 3;
        to[2 * (size_t)i] = (uint32_t)face[i % 3], to[2 * (size_t)i + 1] = (uint32_t)face[(i + 1) % 3];
    }
    *nedges = to ? n : 0;
    return to;
}

/* The edges of the faces that the parameter `name` lists, for a mesh of so many vertices. */
static SltStatus list_edges(const SltFit *f, const char *name, uint32_t vertices, uint32_t **edges, size_t *n,
                            SltError *err) {
    ParamRef at;
    SltStatus status = fit_find_param(f->p, name, "faces of a mesh", &at, err);
    if (status != SLT_OK) return status;
    if (at.fcount || at.icount < 3 || at.icount % 3)
        return status_fail(err, SLT_USAGE, "`%s` is no list of faces: it has %u integers and %u floats", name,
                           at.icount, at.fcount);
    const int32_t *faces = f->p->ints + at.ibase;
    for (uint32_t i = 0; i < at.icount; i++)
        if (faces[i] < 0 || (uint32_t)faces[i] >= vertices)
            return status_fail(err, SLT_INPUT, "face %u of `%s` has the vertex %d, and there are %u", i / 3, name,
                               faces[i], vertices);
    *edges = sides_of(faces, at.icount, n);
    return *edges ? SLT_OK : fit_out_of_memory(err);
}

/* The edges that the grid has instead of its four neighbours, malloc'd; none of a plain grid. */
static SltStatus find_edges(const SltFit *f, const char *name, const Param *of, const uint32_t size[3], OptimiseGrid *g,
                            SltError *err) {
    uint32_t *edges = NULL;
    SltStatus status = SLT_OK;
    if (of->is_mesh) {
        g->edges = sides_of(f->p->ints + of->tbase, 3 * of->sym->nfaces, &g->nedges);
        return g->edges ? SLT_OK : fit_out_of_memory(err);
    }
    for (uint32_t k = 0; k < f->opt.nsmooth_faces && status == SLT_OK && !edges; k++)
        if (f->opt.smooth_faces[k].name && !strcmp(f->opt.smooth_faces[k].name, name))
            status = list_edges(f, f->opt.smooth_faces[k].value, size[0] * size[1] * size[2], &edges, &g->nedges, err);
    if (status == SLT_OK && !edges && size[2] > 1) {
        edges = grid_edges(size[0], size[1], size[2], &g->nedges);
        if (!edges) status = fit_out_of_memory(err);
    }
    g->edges = edges;
    return status;
}

/* The sizes of a list that is a grid, where the options say so. */
static SltStatus find_sizes(const SltFit *f, const char *name, uint32_t size[3], SltError *err) {
    for (uint32_t k = 0; k < f->opt.nsmooth_grids; k++) {
        const SltSet *g = &f->opt.smooth_grids[k];
        unsigned n[3] = {1, 1, 1};
        int end = 0, whole = g->value ? (int)strlen(g->value) : 0;
        if (!g->name || strcmp(g->name, name) != 0) continue;
        bool read = g->value && ((sscanf(g->value, "%ux%u%n", &n[0], &n[1], &end) == 2 && end == whole) ||
                                 (sscanf(g->value, "%ux%ux%u%n", &n[0], &n[1], &n[2], &end) == 3 && end == whole));
        if (!read || size[1] > 1 || size[2] > 1 || (double)n[0] * n[1] * n[2] != size[0])
            return status_fail(err, SLT_USAGE, "`%s` is no grid of %s in one list: it has %u elements%s", name,
                               read ? g->value : "WxH or WxHxD", size[0], size[1] > 1 ? " of lists" : "");
        memcpy(size, n, sizeof n);
        break; /* the first: a scene's come behind those of the command line */
    }
    return SLT_OK;
}

static SltStatus find_grid(SltFit *f, const SltFitNumber *smooth, OptimiseGrid *g, SltError *err) {
    ParamRef at;
    SltStatus status = fit_find_param(f->p, smooth->name, "smoothing", &at, err);
    if (status != SLT_OK) return status;
    const Type *t = at.type;
    uint32_t size[3] = {1, 1, 1}, channels = 1;
    if (param_is_image(at.param)) {
        size[0] = at.param->tex_w, size[1] = at.param->tex_h, channels = at.param->tex_c;
        if (at.param->tex_d) size[2] = at.param->tex_d;
    } else if (t->kind == T_ARRAY) {
        for (int d = 0; d < 3 && t->kind == T_ARRAY; d++, t = t->elem)
            size[2] = size[1], size[1] = size[0], size[0] = t->n; /* the outermost is the slowest */
        channels = type_components(t);
        if (!type_is_float(t) || at.fcount != size[0] * size[1] * size[2] * channels)
            return status_fail(
                err, SLT_USAGE,
                "`%s` cannot be smoothed: a grid of floats or vectors, of up to three dimensions, is wanted",
                smooth->name);
        status = find_sizes(f, smooth->name, size, err);
        if (status != SLT_OK) return status;
    } else {
        return status_fail(err, SLT_USAGE, "`%s` cannot be smoothed: a texture or an array is wanted", smooth->name);
    }
    uint32_t first = UINT32_MAX;
    for (uint32_t i = 0; i < f->n; i++)
        if (f->index[i] == at.fbase) first = i;
    if (first == UINT32_MAX || first + at.fcount > f->n || f->index[first + at.fcount - 1] != at.fbase + at.fcount - 1)
        return status_fail(err, SLT_USAGE, "`%s` cannot be smoothed: it is not optimised", smooth->name);
    *g = (OptimiseGrid){.offset = first,
                        .width = (int)size[0],
                        .height = (int)(size[1] * size[2]),
                        .channels = (int)channels,
                        .stride_x = channels,
                        .stride_y = (size_t)size[0] * channels,
                        .stride_c = 1,
                        .lambda = smooth->value};
    return find_edges(f, smooth->name, at.param, size, g, err);
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

/* The optimiser would refuse these by number: here they have names. */
static SltStatus check_start(const SltFit *f, const double *start, const double *lo, const double *hi,
                             const uint8_t *log, SltError *err) {
    for (uint32_t i = 0; i < f->n; i++) {
        double at = isfinite(start[i]) ? fmin(fmax(start[i], lo[i]), hi[i]) : start[i];
        if (isfinite(at) && (!log[i] || at > 0)) continue;
        const Param *q = f->p->prog->params;
        while (f->index[i] < q->fbase || f->index[i] >= q->fbase + q->fcount) q++;
        char which[48] = "";
        if (q->fcount > 1) snprintf(which, sizeof which, " (number %u of %u)", f->index[i] - q->fbase + 1, q->fcount);
        if (isfinite(at))
            return status_fail(err, SLT_USAGE, "`%s`%s is [Log] and starts at %g: a fit begins above 0", q->name, which,
                               at);
        return status_fail(err, SLT_USAGE, "`%s`%s starts at %g: a fit begins at finite values", q->name, which, at);
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
    if (status == SLT_OK) status = check_start(f, start, lo, hi, log, err);
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
                                 .zeros = 8,
                                 .max_failures = (int)o->max_failures};
        f->optimiser = optimise_create(&config, err);
        if (!f->optimiser) status = err->status;
    }
    free(store);
    free(log);
    for (uint32_t k = 0; grids && k < o->nsmooth; k++) free((void *)grids[k].edges);
    free(grids);
    return status;
}
