/* Images: exact antialiasing, derivative images, and the gradient of an image weighed by an adjoint image. Cells end on
 * the lines where filters bend, so that the rules see smooth functions alone. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/inner.h"
#include "runtime/sample/alloc.h"

enum {
    PIXEL_PARTS = 16, /* of a pixel's side: the least cell */
    GRID_PARTS = 8,   /* into as many cells at least, where an error is wanted that all points do not reach */
    LEFT_PARTS = 8    /* by so much smaller is the least cell of the next sweep */
};
#define LIMIT 0x1p28 /* evaluations, where an error is wanted and nothing else is said */
#define DEARER 2.0 /* than the last sweep, at most, is the next one */

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

/* ---- until the error is small enough */
static bool wants_error(const SltJob *j) { return j->error > 0 || j->abs_error > 0; }

/* Pieces are cut where two rules of them differ by what matters in a pixel. */
static void aim(Sweep *p) {
    const SltJob *j = p->run->j;
    CellOptions *o = &p->options;
    double goal = fmin(fmax(j->error > 0 ? j->error : j->abs_error, p->run->s->f64 ? 1e-13 : 1e-7), 1e-2);
    if (j->gauss) return;
    o->gauss = (uint32_t)fmin(ceil(-0.5 * log10(goal)) + 2, SLT_GAUSS_MAX), o->coarse = o->gauss - 1;
    o->fixed = false, o->tolerance = goal / (double)p->run->grid.pixels;
}

/* More points, then smaller cells; false: neither is to be had. */
static bool finer(Sweep *p) {
    const Grid *g = &p->run->grid;
    CellOptions *o = &p->options;
    double ever = p->run->s->f64 ? 0x1p-34 : 0x1p-17,
           side = g->filter == SLT_FILTER_BOX ? g->side[0] : 0.5 * g->side[0];
    bool smaller = p->nleft && o->least > ever, more = !p->run->j->gauss && o->gauss < SLT_GAUSS_MAX;
    bool cut = !more && o->grid[0] * GRID_PARTS > side;
    if (smaller) o->least = fmax(o->least / LEFT_PARTS, ever);
    if (more) o->gauss += o->gauss + 2 > SLT_GAUSS_MAX ? 1 : 2;
    if (more && o->coarse) o->coarse = o->gauss - 1;
    o->tolerance *= 0.1;
    for (uint32_t d = 0; d < g->dim && cut; d++) o->grid[d] *= 0.5;
    return smaller || more || cut;
}

/* How far the images are from those of the sweep before, whose error that is, at the pixel where it is most; scale: of
 * the largest number in them. Without `before` nothing is known. They become `before`. */
static double apart(float *const *out, float *before, bool known, uint32_t n, uint64_t count, double *scale) {
    double most = 0;
    *scale = 0;
    for (uint32_t i = 0; i < n; i++)
        for (uint64_t k = 0; k < count; k++) {
            float *was = &before[i * count + k];
            double d = fabs((double)out[i][k] - *was), size = fabs((double)out[i][k]);
            if (d > most && d < HUGE_VAL) most = d;
            if (size > *scale && size < HUGE_VAL) *scale = size;
            *was = out[i][k];
        }
    return known ? fmax(most, 0.5 * (double)FLT_EPSILON * *scale) : INFINITY; /* pixels are floats */
}

/* The largest stated error of a gradient. */
static double worst(const Sweep *p, double *scale) {
    const SltScene *s = p->run->s;
    double most = *scale = 0;
    for (uint32_t i = 0; i < s->nfloats; i++) {
        if (s->active && !s->active[i]) continue;
        most = fmax(most, sums_error(&p->sums, i));
        *scale = fmax(*scale, fabs(p->sums.boundary[i] + p->sums.interior[i]));
    }
    return most;
}

static SltStatus clear_and_sweep(Sweep *p, float *const *out, uint32_t n, uint64_t count) {
    for (uint32_t i = 0; i < n; i++) memset(out[i], 0, count * sizeof(float));
    if (p->crossings) memset(p->crossings, 0, p->run->grid.pixels * sizeof(float));
    return sweep_run(p);
}

/* Sweeps with ever more points and smaller cells, where the job wants an error. out: n images; none: the gradient. */
static SltStatus sweep_images(Sweep *p, float *const *out, uint32_t n, SltStop *stop) {
    Run *r = p->run;
    const SltJob *j = r->j;
    uint64_t count = r->grid.pixels * r->s->channels;
    if (!wants_error(j)) {
        SltStatus st = clear_and_sweep(p, out, n, count);
        *stop = p->counts.spent ? SLT_STOP_EVALUATIONS : SLT_STOP_NONE;
        return st;
    }
    double limit = j->max_evaluations ? (double)j->max_evaluations : LIMIT, last = INFINITY;
    aim(p);
    float *before = alloc_zero(n * count + 1, sizeof *before);
    SltStatus st = before ? SLT_OK : status_fail(r->err, SLT_LIMIT, "out of memory");
    for (uint32_t sweep = 0, stalls = 0; st == SLT_OK; sweep++) {
        double began = (double)r->stats.evaluations, scale;
        p->budget = limit > began ? (uint64_t)(limit - began) : 1;
        r->pool.from = sweep ? 1 : 0, r->pool.to = 1; /* how many there will be is not known */
        if ((st = clear_and_sweep(p, out, n, count)) != SLT_OK) break;
        double error = n ? apart(out, before, sweep > 0, n, count, &scale) : worst(p, &scale);
        double used = (double)r->stats.evaluations;
        *stop = p->counts.spent ? SLT_STOP_EVALUATIONS : SLT_STOP_NONE;
        if (p->counts.spent || error <= fmax(j->error * scale, j->abs_error)) break;
        stalls = error > 0.5 * last ? stalls + 1 : 0, last = error;
        *stop = used + DEARER * (used - began) > limit ? SLT_STOP_EVALUATIONS : SLT_STOP_ROUNDING;
        if (*stop == SLT_STOP_EVALUATIONS || stalls >= 2 || !finer(p)) break;
    }
    free(before);
    return st;
}

SltStatus quadrature_image_end(Run *r, Sweep *p, SltStatus st, SltStop stop, SltStats *stats) {
    if (st == SLT_OK) quadrature_state(r, p), r->stats.stopped = stop;
    sweep_end(p);
    run_end(r, stats);
    return st;
}

SltStatus quadrature_render(const SltScene *s, const SltJob *j, float *out, SltStats *stats, SltError *err) {
    Run r;
    SltStop stop = SLT_STOP_NONE;
    SltStatus st = run_begin(&r, s, j, err);
    Sweep p = {.run = &r, .kind = SWEEP_RENDER, .out = &out, .options.volume = true};
    if (st == SLT_OK) st = sweep_begin(&p);
    if (st == SLT_OK) {
        quadrature_image_options(&p);
        st = sweep_images(&p, &out, 1, &stop);
        r.stats.seconds_interior = pool_now() - r.start;
    }
    return quadrature_image_end(&r, &p, st, stop, stats);
}

/* SLT_INTERIOR_SAMPLES: the interior as with the lattice, the boundary by quadrature. Is that wanted? Then the two
 * jobs. */
static bool split_job(const SltJob *j, SltJob *interior, SltJob *boundary) {
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
    if (split_job(j, &interior, &boundary))
        return forward_apart(s, &interior, &boundary, ndir, dirs, out, crossings, stats, err);
    Run r;
    SltStop stop = SLT_STOP_NONE;
    Directions d = {0};
    SltStatus st = run_begin(&r, s, j, err);
    Sweep p = {.run = &r, .kind = SWEEP_FORWARD, .dirs = &d, .out = out, .crossings = crossings};
    p.options.curves = !j->no_boundary && quadrature_has_boundary(s, SLT_K_SITE_JVP);
    p.options.seams = quadrature_compares_seams(s, j);
    p.options.volume = !j->no_interior && s->kernel[SLT_K_JVP];
    if (st == SLT_OK && !directions_init(&d, s, ndir, dirs)) st = status_fail(err, SLT_LIMIT, "out of memory");
    if (st == SLT_OK) st = sweep_begin(&p);
    if (st == SLT_OK) {
        quadrature_image_options(&p);
        st = sweep_images(&p, out, ndir, &stop);
        r.stats.seconds_boundary = pool_now() - r.start;
    }
    st = quadrature_image_end(&r, &p, st, stop, stats);
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
    if (split_job(j, &interior, &boundary))
        return reverse_apart(s, &interior, &boundary, adjoint, gradient, stderr_bound, stats, err);
    Run r;
    SltStop stop = SLT_STOP_NONE;
    SltStatus st = run_begin(&r, s, j, err);
    Sweep p = {.run = &r, .kind = SWEEP_REVERSE, .adjoint = adjoint, .errors = stderr_bound || wants_error(j)};
    p.options.curves = !j->no_boundary && quadrature_has_boundary(s, SLT_K_SITE_VJP);
    p.options.seams = quadrature_compares_seams(s, j);
    p.options.volume = !j->no_interior && s->kernel[SLT_K_VJP];
    if (st == SLT_OK) st = sweep_begin(&p);
    if (st == SLT_OK) {
        quadrature_image_options(&p);
        st = sweep_images(&p, NULL, 0, &stop);
        r.stats.seconds_boundary = pool_now() - r.start;
    }
    for (uint32_t i = 0; i < s->nfloats && st == SLT_OK; i++) {
        bool on = !s->active || s->active[i];
        gradient[i] = on ? p.sums.boundary[i] + p.sums.interior[i] : 0;
        if (stderr_bound) stderr_bound[i] = on ? sums_error(&p.sums, i) : 0;
    }
    return quadrature_image_end(&r, &p, st, stop, stats);
}
