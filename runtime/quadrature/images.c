/* Images: exact antialiasing, derivative images, and the gradient of an image weighed by an adjoint image. Cells end on
 * the lines where filters bend, so that the rules see smooth functions alone. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/inner.h"
#include "runtime/sample/alloc.h"

enum { PIXEL_PARTS = 16 }; /* of a pixel's side: the least cell */

/* Points along each side of a cell: in a pixel without an edge one more, squared or cubed, than samples are asked for.
 */
static uint32_t points_of(const SltJob *j, uint32_t dim) {
    if (j->gauss) return j->gauss;
    double n = 1 + round(pow(j->spp ? j->spp : 1, 1.0 / dim));
    return n < 2 ? 2 : n > SLT_GAUSS_MAX ? SLT_GAUSS_MAX : (uint32_t)n;
}

void quadrature_image_options(Sweep *p) {
    const Grid *g = &p->run->grid;
    const SltJob *j = p->run->j;
    CellOptions *o = &p->options;
    o->gauss = points_of(j, g->dim), o->coarse = p->errors ? o->gauss > 1 ? o->gauss - 1 : 2 : 0, o->fixed = true;
    o->least = 1;
    for (uint32_t d = 0; d < g->dim; d++) {
        o->grid[d] = g->filter == SLT_FILTER_BOX ? g->side[d] : 0.5 * g->side[d];
        o->grid_lo[d] = g->lo[d];
        o->least = fmin(o->least, 1.0 / ((double)PIXEL_PARTS * g->n[d]));
    }
    p->segments = quadrature_segments(j) * (double)g->pixels, p->samples = (double)j->spp * (double)g->pixels;
    p->budget = j->max_evaluations, p->left_share = 0.25, p->only_if_left = 1;
}

SltStatus quadrature_image_end(Run *r, Sweep *p, SltStatus st, SltStats *stats) {
    if (st == SLT_OK) quadrature_state(r, p), r->stats.stopped = p->counts.spent ? SLT_STOP_EVALUATIONS : SLT_STOP_NONE;
    sweep_end(p);
    run_end(r, stats);
    return st;
}

SltStatus quadrature_render(const SltScene *s, const SltJob *j, float *out, SltStats *stats, SltError *err) {
    Run r;
    SltStatus st = run_begin(&r, s, j, err);
    Sweep p = {.run = &r, .kind = SWEEP_RENDER, .out = &out, .options.volume = true};
    if (st == SLT_OK) st = sweep_begin(&p);
    if (st == SLT_OK) {
        quadrature_image_options(&p);
        memset(out, 0, r.grid.pixels * s->channels * sizeof *out);
        st = sweep_run(&p);
        r.stats.seconds_interior = pool_now() - r.start;
    }
    return quadrature_image_end(&r, &p, st, stats);
}

/* SLT_INTERIOR_SAMPLES: the interior as with the lattice, the boundary by quadrature. Is that wanted? Then the two
 * jobs. */
static bool apart(const SltJob *j, SltJob *interior, SltJob *boundary) {
    if (j->interior != SLT_INTERIOR_SAMPLES || j->no_interior) return false;
    *interior = *boundary = *j;
    interior->no_boundary = true, interior->estimator = SLT_EST_LATTICE;
    boundary->no_interior = true;
    return true;
}

static SltStatus forward_apart(const SltScene *s, const SltJob *interior, const SltJob *boundary, uint32_t ndir,
                               const double *const *dirs, float *const *out, float *crossings, SltStats *stats,
                               SltError *err) {
    uint64_t n = s->channels;
    for (uint32_t d = 0; d < s->dim; d++) n *= interior->size[d];
    float *own = malloc(n * sizeof *own);
    SltStatus st = own ? slt_estimate_forward(s, interior, ndir, dirs, out, NULL, stats, err)
                       : status_fail(err, SLT_LIMIT, "out of memory");
    for (uint32_t d = 0; d < ndir && st == SLT_OK; d++) {
        st = quadrature_forward(s, boundary, 1, dirs + d, &own, d ? NULL : crossings, stats, err);
        for (uint64_t i = 0; i < n && st == SLT_OK; i++) out[d][i] += own[i];
    }
    free(own);
    return st;
}

SltStatus quadrature_forward(const SltScene *s, const SltJob *j, uint32_t ndir, const double *const *dirs,
                             float *const *out, float *crossings, SltStats *stats, SltError *err) {
    SltJob interior, boundary;
    if (apart(j, &interior, &boundary))
        return forward_apart(s, &interior, &boundary, ndir, dirs, out, crossings, stats, err);
    Run r;
    Directions d = {0};
    SltStatus st = run_begin(&r, s, j, err);
    Sweep p = {.run = &r, .kind = SWEEP_FORWARD, .dirs = &d, .out = out, .crossings = crossings};
    p.options.curves = !j->no_boundary && quadrature_has_boundary(s, SLT_K_SITE_JVP);
    p.options.volume = !j->no_interior && s->kernel[SLT_K_JVP];
    if (st == SLT_OK && !directions_init(&d, s, ndir, dirs)) st = status_fail(err, SLT_LIMIT, "out of memory");
    if (st == SLT_OK) st = sweep_begin(&p);
    if (st == SLT_OK) {
        quadrature_image_options(&p);
        for (uint32_t i = 0; i < ndir; i++) memset(out[i], 0, r.grid.pixels * s->channels * sizeof(float));
        if (crossings) memset(crossings, 0, r.grid.pixels * sizeof(float));
        st = sweep_run(&p);
        r.stats.seconds_boundary = pool_now() - r.start;
    }
    st = quadrature_image_end(&r, &p, st, stats);
    directions_free(&d);
    return st;
}

static SltStatus reverse_apart(const SltScene *s, const SltJob *interior, const SltJob *boundary, const float *adjoint,
                               double *gradient, double *stderr_bound, SltStats *stats, SltError *err) {
    const float *both[2] = {adjoint, adjoint};
    double *own = alloc_zero(s->nfloats, sizeof *own), *error = alloc_zero(s->nfloats, sizeof *error);
    SltStatus st = own && error ? slt_estimate_reverse(s, interior, both, own, stderr_bound ? error : NULL, stats, err)
                                : status_fail(err, SLT_LIMIT, "out of memory");
    if (st == SLT_OK) st = quadrature_reverse(s, boundary, adjoint, gradient, stderr_bound, stats, err);
    for (uint32_t i = 0; i < s->nfloats && st == SLT_OK; i++) {
        gradient[i] += own[i];
        if (stderr_bound) stderr_bound[i] += error[i];
    }
    free(own), free(error);
    return st;
}

SltStatus quadrature_reverse(const SltScene *s, const SltJob *j, const float *adjoint, double *gradient,
                             double *stderr_bound, SltStats *stats, SltError *err) {
    SltJob interior, boundary;
    if (apart(j, &interior, &boundary))
        return reverse_apart(s, &interior, &boundary, adjoint, gradient, stderr_bound, stats, err);
    Run r;
    SltStatus st = run_begin(&r, s, j, err);
    Sweep p = {.run = &r, .kind = SWEEP_REVERSE, .adjoint = adjoint, .errors = stderr_bound != NULL};
    p.options.curves = !j->no_boundary && quadrature_has_boundary(s, SLT_K_SITE_VJP);
    p.options.volume = !j->no_interior && s->kernel[SLT_K_VJP];
    if (st == SLT_OK) st = sweep_begin(&p);
    if (st == SLT_OK) {
        quadrature_image_options(&p);
        st = sweep_run(&p);
        r.stats.seconds_boundary = pool_now() - r.start;
    }
    for (uint32_t i = 0; i < s->nfloats && st == SLT_OK; i++) {
        bool on = !s->active || s->active[i];
        gradient[i] = on ? p.sums.boundary[i] + p.sums.interior[i] : 0;
        if (stderr_bound) stderr_bound[i] = on ? sums_error(&p.sums, 0, i) : 0;
    }
    return quadrature_image_end(&r, &p, st, stats);
}
