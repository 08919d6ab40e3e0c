/* One function a question: how interior and boundary terms, halves and replicates make an answer. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/inner.h"
#include "runtime/sample/alloc.h"
#include "runtime/sample/bars.h"
#include "runtime/sample/boundary.h"
#include "runtime/sample/chance.h"
#include "runtime/sample/derived.h"
#include "runtime/sample/depth.h"
#include "runtime/sample/fill.h"
#include "runtime/sample/interior.h"
#include "runtime/sample/onesided.h"
#include "runtime/sample/search.h"

const char *const slt_drop_names[SLT_DROP_REASONS] = {"zero_gradient", "not_finite", "inconsistent", "no_event",
                                                      "no_root",       "static",     "depth",        "coincident"};

double slt_estimate_ulps(const SltScene *s, const SltJob *j) {
    double least = HUGE_VAL, replicates = j->replicates ? j->replicates : 4;
    double lines = pow(boundary_segments(j) / (j->integral ? replicates : 1) / s->dim, 1.0 / s->dim);
    for (uint32_t d = 0; d < s->dim && !s->f64; d++) {
        double spacing = (s->hi[d] - s->lo[d]) / fmax(1, lines * (j->integral ? 1 : j->size[d]));
        double far = fmax(FLT_MIN, fmax(fabs(s->lo[d]), fabs(s->hi[d]))); /* below it floats are evenly spaced */
        least = fmin(least, spacing / ((double)FLT_EPSILON * far));
    }
    return least;
}

static SltStatus need_image(const SltJob *j, const char *what, SltError *err) {
    if (!j->integral) return SLT_OK;
    return status_fail(err, SLT_USAGE, "%s needs an image, not an integral", what);
}

/* One sample tells all of a pixel. Of an integral cells know the same, and more, where the program has bounds. */
static bool is_told(const SltScene *s, const SltJob *j) {
    return s->pixelwise && (s->boundless || !j->integral || slt_estimate_by_differences(j->estimator));
}

bool slt_estimate_has_choice(const SltScene *s, const SltJob *j) {
    return j->estimator == SLT_EST_AUTO && !is_told(s, j) && quadrature_hopes(s, j);
}

bool slt_estimate_hopes(const SltScene *s, const SltJob *j, uint64_t events) { return quadrature_likely(s, j, events); }

SltEstimator slt_estimate_choose(const SltScene *s, const SltJob *j, SltStats *stats) {
    if (j->estimator != SLT_EST_AUTO) return j->estimator;
    return quadrature_choose(s, j, stats) == SLT_EST_LATTICE ? SLT_EST_LATTICE : SLT_EST_AUTO;
}

/* The job with an estimator that the scene has the kernels for; `own` is room for it. */
static const SltJob *settle(const SltScene *s, const SltJob *j, SltJob *own, SltStats *stats) {
    if (is_told(s, j)) {
        *own = *j;
        if (!slt_estimate_by_differences(j->estimator)) own->estimator = SLT_EST_LATTICE;
        own->interior = SLT_INTERIOR_SAMPLES;
        own->samples = own->replicates = own->spp = 1, own->centred = true;
        return own;
    }
    if (j->estimator != SLT_EST_AUTO && j->estimator != SLT_EST_QUADRATURE) return j;
    *own = *j;
    if (!quadrature_can(s)) own->estimator = SLT_EST_LATTICE;
    else if (j->estimator == SLT_EST_AUTO)
        own->estimator =
            quadrature_choose(s, j, stats) == SLT_EST_LATTICE ? SLT_EST_LATTICE : quadrature_try(s, j, stats);
    return own;
}

static SltStatus render_integral(const SltScene *s, const SltJob *j, float *out, SltStats *stats, SltError *err) {
    double value[SLT_MAX_CHANNELS] = {0};
    SltIntegral i = SLT_INTEGRAL_INIT;
    i.value = value;
    SltStatus st = quadrature_integral(s, j, &i, NULL, stats, err);
    for (uint32_t c = 0; c < s->channels && st == SLT_OK; c++) out[c] = (float)value[c];
    return st;
}

SltStatus slt_estimate_render(const SltScene *s, const SltJob *j, int half, float *out, SltStats *stats,
                              SltError *err) {
    Run r;
    SltJob own;
    if (j->estimator == SLT_EST_QUADRATURE || j->interior == SLT_INTERIOR_QUADRATURE || is_told(s, j))
        j = settle(s, j, &own, stats);
    bool cells = half == 0 && j->interior != SLT_INTERIOR_SAMPLES && !(j->centred && !j->integral);
    if (j->estimator == SLT_EST_QUADRATURE && cells)
        return j->integral ? render_integral(s, j, out, stats, err) : quadrature_render(s, j, out, stats, err);
    SltStatus st = run_begin(&r, s, j, err);
    if (st == SLT_OK && half == 0 && j->integral) {
        double value[SLT_MAX_CHANNELS] = {0};
        st = interior_integral(&r, 1, j->samples, value, NULL, NULL);
        for (uint32_t c = 0; c < s->channels && st == SLT_OK; c++) out[c] = (float)value[c];
    } else if (st == SLT_OK) {
        st = interior_image(&r, (uint32_t)half, out);
    }
    r.stats.seconds_interior = pool_now() - r.start;
    run_end(&r, stats);
    return st;
}

/* Both halves of the samples of an image. */
static SltStatus render_halves(const SltScene *s, const SltJob *j, float *const half[2], SltStats *stats,
                               SltError *err) {
    Run r;
    SltStatus st = run_begin(&r, s, j, err);
    if (st == SLT_OK) st = interior_halves(&r, half);
    r.stats.seconds_interior = pool_now() - r.start;
    run_end(&r, stats);
    return st;
}

/* ---- forward */
SltStatus slt_estimate_forward(const SltScene *s, const SltJob *j, uint32_t ndir, const double *const *dirs,
                               float *const *out, float *crossings, SltStats *stats, SltError *err) {
    SltStatus st = need_image(j, "a derivative image", err);
    if (st != SLT_OK || !ndir) return st;
    if (slt_estimate_by_differences(j->estimator)) return difference_forward(s, j, ndir, dirs, out, stats, err);
    SltJob own;
    j = settle(s, j, &own, stats);
    if (j->estimator == SLT_EST_QUADRATURE) return quadrature_forward(s, j, ndir, dirs, out, crossings, stats, err);
    Run r;
    Directions d = {0};
    st = run_begin(&r, s, j, err);
    uint64_t size = r.grid.pixels * s->channels;
    if (st == SLT_OK && !directions_init(&d, s, ndir, dirs)) st = status_fail(err, SLT_LIMIT, "out of memory");
    if (st == SLT_OK) {
        for (uint32_t i = 0; i < ndir; i++) memset(out[i], 0, size * sizeof(float));
        if (crossings) memset(crossings, 0, r.grid.pixels * sizeof(float));
        double split = j->no_boundary || !s->kernel[SLT_K_REGION] ? 1 : j->no_interior ? 0 : 0.6, t = pool_now();
        r.pool.to = split;
        if (!j->no_interior) st = interior_forward(&r, &d, out);
        r.stats.seconds_interior = pool_now() - t, t = pool_now();
        r.pool.from = split, r.pool.to = 1;
        Boundary y = {
            .run = &r, .segments = boundary_segments(j), .out = out, .crossings = crossings, .dirs = &d, .classes = 1};
        if (st == SLT_OK && !j->no_boundary) st = boundary_run(&y, SINK_FORWARD);
        /* A few are steep for other reasons. */
        if (4 * r.rims > r.steep) r.stats.singular = (double)r.rims / (double)r.steep;
        run_forget_few(&r);
        r.stats.seconds_boundary = pool_now() - t;
    }
    run_end(&r, stats);
    directions_free(&d);
    return st;
}

/* ---- reverse */
enum { PARTS_MOST = 1 << 12, PARTS_EVER = 1 << 18 }; /* parameters whose parts are looked at tile by tile; at all */

/* Adds the sums of n interleaved parts to total, and to variance that of the total as if the parts were independent:
 * they repel each other, so this is an upper bound. */
static void combine(double *const *part, uint32_t n, double *total, double *variance, uint32_t nfloats) {
    for (uint32_t p = 0; p < nfloats; p++) {
        double sum = 0;
        for (uint32_t c = 0; c < n; c++) sum += part[c][p];
        total[p] += sum;
        if (!variance || n < 2) continue;
        double v = 0, mean = sum / n;
        for (uint32_t c = 0; c < n; c++) v += (part[c][p] - mean) * (part[c][p] - mean);
        variance[p] += v * n / (n - 1);
    }
}

/* Sums that are whole, of which errors are told by how they differ: derivatives in derived arrays differ together. */
static SltStatus pull_rows(const SltScene *s, double *const *row, uint32_t n, SltError *err) {
    for (uint32_t k = 0; k < n; k++)
        if (!derived_pull(s, row[k])) return status_fail(err, SLT_LIMIT, "out of memory");
    return SLT_OK;
}

static void clear_parts(double *const *part, uint32_t n, uint32_t nfloats) {
    for (uint32_t c = 0; c < n; c++) memset(part[c], 0, nfloats * sizeof *part[c]);
}

static void mask_inactive(const SltScene *s, double *v) {
    if (!v || !s->active || !memchr(s->active, 0, s->nfloats)) return;
    for (uint32_t p = 0; p < s->nfloats; p++) v[p] = s->active[p] ? v[p] : 0;
}

/* Into to[0] the mean of two adjoints, into to[1] how far it is off. They may be the same images. */
static void mean_and_noise(const float *const adjoint[2], uint64_t n, float *const to[2]) {
    for (uint64_t i = 0; i < n; i++) {
        const float a = adjoint[0][i], b = adjoint[1][i];
        to[0][i] = 0.5f * (a + b), to[1][i] = 0.5f * (a - b);
    }
}

enum { LOSS_ROW = 4096 /* numbers that are summed before they join the sum */ };
enum { OF_POINTS = 8 /* samples for each point of chance.c, which is asked four times */ };

/* What only a loss knows. */
typedef struct OfLoss {
    float *const *spare;    /* two images that may be overwritten once the adjoints have served, which these may be */
    const float *least;     /* NULL, or what an adjoint is off at least for a jump of 1, */
    float least_all;        /* where it is the same everywhere; 0: not known */
    const PixelLoss *pixel; /* NULL, or what makes the adjoint */
} OfLoss;

static SltStatus reverse(const SltScene *s, const SltJob *j, const float *const adjoint[2], const OfLoss *loss,
                         double *gradient, double *stderr_bound, SltStats *stats, SltError *err) {
    bool halves = adjoint[0] != adjoint[1];
    Run r;
    uint32_t classes = stderr_bound && !is_told(s, j) ? COSETS : 1;
    double *part[COSETS] = {0}, *missed = NULL, *smooth = NULL; /* smooth: without the boundary term */
    float *own[2] = {NULL, NULL}, *const *images = loss->spare ? loss->spare : own; /* mean and noise of the adjoints */
    uint8_t *starved = NULL;
    Boundary of = {0};
    Parts tiles = {0}, *parts = NULL;
    SltStatus st = run_begin(&r, s, j, err);
    if (st != SLT_OK) {
        run_end(&r, stats);
        return st;
    }
    uint64_t size = r.grid.pixels * s->channels;
    bool memory = true;
    /* With one class the gradient itself is its sum. */
    if (classes == 1) part[0] = gradient;
    for (uint32_t c = 0; c < classes && classes > 1; c++)
        memory &= (part[c] = alloc_zero(s->nfloats, sizeof **part)) != NULL;
    if (classes > 1) memory &= (missed = alloc_zero(s->nfloats, sizeof *missed)) != NULL;
    if (classes > 1 && (halves || s->uses_rand) && s->nfloats <= PARTS_EVER)
        memory &= parts_init(&tiles, s, s->nfloats > PARTS_MOST || s->nderived), parts = &tiles;
    for (uint32_t k = 0; k < 2 && halves && !loss->spare && !j->no_boundary; k++)
        memory &= (own[k] = malloc(size * sizeof(float))) != NULL;
    if (classes > 1 && s->uses_rand)
        memory &= (smooth = alloc_zero(s->nfloats, sizeof *smooth)) && (starved = alloc_zero(s->nfloats, 1));
    memset(gradient, 0, s->nfloats * sizeof *gradient);
    if (stderr_bound) memset(stderr_bound, 0, s->nfloats * sizeof *stderr_bound);
    if (!memory) st = status_fail(err, SLT_LIMIT, "out of memory");
    double t = pool_now(), split = j->no_boundary || !s->kernel[SLT_K_REGION] ? 1 : j->no_interior ? 0 : 0.7;
    r.pool.from = 0, r.pool.to = split;
    if (st == SLT_OK && !j->no_interior) {
        PartsOf parts_of = {.spread = halves ? 0 : classes, .pairs = halves ? classes : 0};
        double *targets[2 * COSETS];
        for (uint32_t c = 0; c < 2 * COSETS; c++) targets[c] = part[parts && halves ? 0 : c % classes];
        st = interior_reverse(&r, adjoint, classes, targets, parts, parts ? parts_of : (PartsOf){0}, loss->pixel);
        if (st == SLT_OK && parts && parts->whole && !parts_settle(parts, &parts_of, targets))
            st = status_fail(err, SLT_LIMIT, "out of memory");
    }
    if (st == SLT_OK) st = pull_rows(s, part, classes, err);
    if (st == SLT_OK && classes > 1) combine(part, classes, gradient, parts ? NULL : stderr_bound, s->nfloats);
    if (smooth) memcpy(smooth, gradient, s->nfloats * sizeof *smooth);
    r.stats.seconds_interior = pool_now() - t, t = pool_now();
    r.pool.from = split, r.pool.to = 1;
    if (st == SLT_OK && !j->no_boundary) {
        if (halves) mean_and_noise(adjoint, size, images);
        const float *noise = parts && halves ? images[1] : NULL;
        /* On one line every crossing is exact: there is no spread to measure. */
        uint32_t own = s->dim == 1 && !s->uses_rand ? 1 : classes;
        bool apart = parts && s->uses_rand; /* of other lattices tiles are parts of one */
        if (classes > 1) clear_parts(part, classes, s->nfloats);
        double *targets[COSETS + 1 + PARTS_NOISE] = {0};
        memcpy(targets, part, own * sizeof *part);
        targets[own] = missed;
        Boundary y = {.run = &r,
                      .segments = boundary_segments(j),
                      .adjoint = halves ? images[0] : adjoint[0],
                      .classes = own,
                      .misses = classes > 1,
                      .noise = {noise, loss->least},
                      .least = loss->least_all,
                      .parts = parts,
                      .parts_of = {.spread = apart ? own : 0, .noise = noise ? own + 1 : 0},
                      .targets = targets};
        st = boundary_run(&y, SINK_REVERSE);
        if (st == SLT_OK && parts && parts->whole && !parts_settle(parts, &y.parts_of, targets))
            st = status_fail(err, SLT_LIMIT, "out of memory");
        if (st == SLT_OK) st = pull_rows(s, targets, own + (missed != NULL), err);
        for (uint32_t c = 0; c < own && starved; c++)
            for (uint32_t p = 0; p < s->nfloats; p++) starved[p] |= part[c][p] == 0;
        if (st == SLT_OK && classes > 1) combine(part, own, gradient, apart ? NULL : stderr_bound, s->nfloats);
        of = y, of.classes = classes, of.parts = NULL, of.noise[0] = NULL;
    }
    for (uint32_t p = 0; p < s->nfloats && stderr_bound && missed; p++)
        stderr_bound[p] = sqrt(stderr_bound[p] + (parts && memory ? parts_variance(parts, p) : 0)) + fabs(missed[p]);
    if (st == SLT_OK && !j->no_boundary) st = lost_add(&r, &of, 1, NULL, stderr_bound);
    if (st == SLT_OK && !j->no_boundary && smooth) {
        Chance c = {.adjoint = of.adjoint,
                    .interior = smooth,
                    .gradient = gradient,
                    .error = stderr_bound,
                    .starved = starved,
                    .points = r.grid.pixels * (j->spp ? j->spp : 1) / OF_POINTS};
        st = chance_add(&r, &c);
    }
    r.stats.seconds_boundary = pool_now() - t;
    mask_inactive(s, gradient), mask_inactive(s, stderr_bound);
    for (uint32_t c = 0; c < classes && classes > 1; c++) free(part[c]);
    free(own[0]), free(own[1]), free(missed), free(smooth), free(starved), parts_free(&tiles);
    run_forget_few(&r);
    run_end(&r, stats);
    return st;
}

static SltStatus weighted(const SltScene *s, const SltJob *j, const float *const adjoint[2], const OfLoss *loss,
                          double *gradient, double *stderr_bound, SltStats *stats, SltError *err) {
    SltStatus st = need_image(j, "the gradient of a weighted image", err);
    if (st != SLT_OK) return st;
    if (slt_estimate_by_differences(j->estimator))
        return difference_reverse(s, j, adjoint, gradient, stderr_bound, stats, err);
    SltJob own;
    j = settle(s, j, &own, stats);
    if (j->estimator == SLT_EST_QUADRATURE && adjoint[0] == adjoint[1])
        return quadrature_reverse(s, j, adjoint[0], gradient, stderr_bound, stats, err);
    return reverse(s, j, adjoint, loss, gradient, stderr_bound, stats, err);
}

SltStatus slt_estimate_reverse(const SltScene *s, const SltJob *j, const float *const adjoint[2], double *gradient,
                               double *stderr_bound, SltStats *stats, SltError *err) {
    const OfLoss none = {0};
    return weighted(s, j, adjoint, &none, gradient, stderr_bound, stats, err);
}

/* Errors that too few samples or lines cannot tell. */
static void unknown_errors(const SltScene *s, double *error, uint64_t n, bool components) {
    for (uint64_t i = 0; i < n && error; i++)
        if (!components || !s->active || s->active[i % s->nfloats]) error[i] = HUGE_VAL;
}

SltStatus slt_estimate_loss(const SltScene *s, const SltJob *j, const float *target, const float *mask, double *loss,
                            double *gradient, double *stderr_bound, float *image, SltStats *stats, SltError *err) {
    SltStatus st = need_image(j, "a loss", err);
    if (st != SLT_OK) return st;
    SltJob own;
    const bool told = is_told(s, j);
    j = settle(s, j, &own, stats);
    if (j->estimator == SLT_EST_QUADRATURE && j->interior != SLT_INTERIOR_SAMPLES && gradient && !stderr_bound &&
        j->filter == SLT_FILTER_BOX && !j->max_evaluations)
        return quadrature_loss(s, j, target, mask, loss, gradient, image, stats, err);
    /* Exact pixels have no variance, and need no halves. One sample a pixel has no second half: the adjoint comes from
     * the same sample, and the loss is biased by the variance of the image. */
    bool exact = j->centred || (j->estimator == SLT_EST_QUADRATURE && j->interior != SLT_INTERIOR_SAMPLES),
         halves = j->spp > 1 && !exact;
    /* Tile by tile, each looked at once: what geometries have found for the value serves the derivative. */
    const bool once = told && gradient && !j->no_interior && s->ngeometries && s->kernel[SLT_K_VJP] && !prune_can(s) &&
                      !slt_estimate_by_differences(j->estimator);
    uint64_t pixels = 1;
    for (uint32_t d = 0; d < s->dim; d++) pixels *= j->size[d];
    uint64_t n = pixels * s->channels;
    float *half[2] = {malloc(n * sizeof(float)), halves || once ? malloc(n * sizeof(float)) : NULL};
    /* Halves may agree, and half a sample of a jump is lost all the same. */
    const bool bounded = halves && gradient && stderr_bound;
    float *least = bounded && mask ? malloc(n * sizeof *least) : NULL;
    if (!half[0] || ((halves || once) && !half[1]) || (bounded && mask && !least)) {
        free(half[0]), free(half[1]), free(least);
        return status_fail(err, SLT_LIMIT, "out of memory");
    }
    if (once) {
        const PixelLoss of = {.target = target, .mask = mask, .image = half[0], .adjoint = half[1]};
        const float *adjoint[2] = {half[1], half[1]};
        st = reverse(s, j, adjoint, &(OfLoss){.pixel = &of}, gradient, stderr_bound, stats, err);
    } else {
        st = halves ? render_halves(s, j, half, stats, err) : slt_estimate_render(s, j, 0, half[0], stats, err);
    }
    if (st == SLT_OK) {
        double sum = 0;
        for (uint64_t i = 0; i < n && image; i++)
            image[i] = halves ? (float)(0.5 * ((double)half[0][i] + (double)half[1][i])) : half[0][i];
        for (uint64_t i = 0; i < n && least; i++) least[i] = (float)((double)mask[i] / (double)n / j->spp);
        for (uint64_t i = 0; i < n; i += LOSS_ROW) {
            const uint64_t row = n - i < LOSS_ROW ? n - i : LOSS_ROW;
            sum += fill_best()->residuals(half[0] + i, halves ? half[1] + i : NULL, target + i, mask ? mask + i : NULL,
                                          row, (double)n);
        }
        if (loss) *loss = sum / (double)n;
    }
    const float *adjoint[2] = {half[0], halves ? half[1] : half[0]};
    if (st == SLT_OK && gradient && !once) {
        SltStats seen = stats ? *stats : (SltStats){0};
        const OfLoss of = {.spare = halves ? half : NULL,
                           .least = least,
                           .least_all = bounded && !mask ? (float)(1 / (double)n / j->spp) : 0};
        st = weighted(s, j, adjoint, &of, gradient, stderr_bound, stats, err);
        if (stats) stats->truncated = seen.truncated, stats->asserts = seen.asserts; /* the same samples again */
        if (st == SLT_OK && !halves && !exact) unknown_errors(s, stderr_bound, s->nfloats, true);
    }
    free(half[0]), free(half[1]), free(least);
    return st;
}

/* ---- integral */
static bool wants_gradient(const SltIntegral *out) {
    return out->gradient || out->gradient_stderr || out->interior || out->boundary || out->missed_estimate;
}

/* In single precision weights of crossings may be denormals: where the domain is tiny, or a jump. */
static void least_of_weights(const Run *r, double segments, uint32_t replicates, SltIntegral *out) {
    const SltScene *s = r->s;
    double line = 1, widest = 0; /* the least cross-section that a line stands for */
    for (uint32_t d = 0; d < s->dim; d++) line *= s->hi[d] - s->lo[d], widest = fmax(widest, s->hi[d] - s->lo[d]);
    line *= 1 / widest / pow(segments / s->dim, (s->dim - 1.0) / s->dim);
    for (uint32_t c = 0; c < s->channels; c++) {
        uint64_t first = (uint64_t)c * s->nfloats;
        bars_add_denormals(out->gradient + first, s->nfloats, (double)r->kept.n / replicates,
                           r->kept.by[c] / (double)r->kept.n * line, out->gradient_stderr + first);
    }
}

/* Lines may meet what all samples have missed, a shell of a millionth of the domain: these then agree, and know no
 * error. It is no less than what one sample weighs that falls where f has jumped as it does at crossings. */
static void least_of_value(const Run *r, double *value_stderr) {
    double volume = 1;
    for (uint32_t d = 0; d < r->s->dim; d++) volume *= r->s->hi[d] - r->s->lo[d];
    for (uint32_t c = 0; c < r->s->channels; c++)
        value_stderr[c] =
            fmax(value_stderr[c], r->kept.by[c] / (double)r->kept.n * volume / fmax(1, (double)r->j->samples));
}

/* Of an integral. Lines starve where a replicate has met nothing. */
static SltStatus ask_chance(Run *r, const Replicates *k, SltIntegral *out) {
    if (!r->s->uses_rand || !out->gradient || !out->gradient_stderr || k->n < 2) return SLT_OK;
    uint8_t *starved = alloc_zero(k->size + 1, 1);
    double *smooth = alloc_zero(k->size + 1, sizeof *smooth),
           *mean = out->boundary ? NULL : alloc_zero(k->size + 1, sizeof *mean);
    if (!starved || !smooth || (!out->boundary && !mean)) {
        free(starved), free(smooth), free(mean);
        return status_fail(r->err, SLT_LIMIT, "out of memory");
    }
    bars_of_rows(k->interior, NULL, k->n, k->size, NULL, smooth);
    if (mean) bars_of_rows(k->boundary, NULL, k->n, k->size, mean, NULL);
    bars_add_counts(mean ? mean : out->boundary, k->size, (double)r->kept.n, k->n, out->gradient_stderr);
    for (uint64_t row = 0; row < k->n * k->size; row++) starved[row % k->size] |= k->boundary[row] == 0;
    Chance c = {.boundary = mean ? mean : out->boundary,
                .gradient = out->gradient,
                .error = out->gradient_stderr,
                .smooth = smooth,
                .starved = starved,
                .points = r->j->samples / OF_POINTS};
    SltStatus st = chance_add(r, &c);
    free(starved), free(smooth), free(mean);
    return st;
}

/* The boundary terms of all replicates. */
static SltStatus all_boundaries(Run *r, const Replicates *k) {
    const SltScene *s = r->s;
    Boundary *y = alloc_zero(k->n, sizeof *y);
    double **targets = alloc_zero((uint64_t)k->n * ACCUMS, sizeof *targets);
    SltStatus st = SLT_OK;
    if (!y || !targets) st = status_fail(r->err, SLT_LIMIT, "out of memory");
    for (uint32_t i = 0; i < k->n && st == SLT_OK; i++) {
        double **to = targets + (uint64_t)i * ACCUMS;
        for (uint32_t c = 0; c < s->channels; c++) {
            to[c] = k->boundary + i * k->size + (uint64_t)c * s->nfloats;
            to[s->channels + c] = k->missed + i * k->size + (uint64_t)c * s->nfloats;
            to[2 * s->channels + c] = k->half + (uint64_t)c * s->nfloats;
            for (uint32_t q = 0; q < SKETCHES && k->sketch; q++)
                to[(3 + q) * s->channels + c] = k->sketch + q * k->size + (uint64_t)c * s->nfloats;
        }
        y[i] = (Boundary){.run = r,
                          .replicate = i,
                          .replicates = k->n,
                          .segments = boundary_segments(r->j) / k->n,
                          .targets = to,
                          .classes = 1};
    }
    if (st == SLT_OK) st = boundary_run_all(y, k->n, SINK_INTEGRAL);
    free(y), free(targets);
    return st;
}

/* The smooth part of an integral, by samples. */
typedef struct Smooth {
    Run run; /* a copy, with counts of its own */
    uint32_t replicates;
    uint64_t samples; /* of each */
    double *value, *gradient;
    Tails *tails;
    SltStatus status;
    SltError err;
    bool begun, aside;
    SideWork work;
} Smooth;

static void sample(void *arg) {
    Smooth *m = arg;
    const double t = pool_now();
    m->status = interior_integral(&m->run, m->replicates, m->samples, m->value, m->gradient, m->tails);
    m->run.stats.seconds_interior += pool_now() - t;
}

/* No more samples than these, whatever comes of them. */
static bool is_one_go(const SltJob *j) { return !(j->error > 0 || j->abs_error > 0) && !j->max_evaluations; }

/* Few samples, which are no work for several threads, may run beside lines, which say how far they are; not those that
 * print: that is for one thread at a time. */
static SltStatus smooth_begin(Smooth *m, const Run *r, bool lines) {
    enum { WORTH = 1 << 21 }; /* instructions, which take longer than a thread to begin */
    const bool small = interior_is_small(r, m->replicates, m->samples),
               worth = (double)m->samples * m->replicates * r->s->work > WORTH;
    m->run = *r, m->run.err = &m->err, m->run.pool.progress = NULL, m->begun = true;
    m->work = (SideWork){.run = sample, .arg = m};
    m->aside = lines && small && worth && !r->s->print && side_add(r->s->side, &m->work);
    if (is_one_go(r->j)) side_last(r->s->side);
    if (m->aside) return SLT_OK;
    m->run.pool.progress = r->pool.progress, m->run.pool.to = 0.7;
    sample(m);
    return m->status;
}

/* st: what became of the lines. */
static SltStatus smooth_end(Smooth *m, Run *r, SltStatus st) {
    if (!m->begun) return st;
    side_finish(r->s->side, &m->work);
    stats_add(&r->stats, &m->run.stats);
    if (m->status != SLT_OK && r->err) *r->err = m->err;
    return m->status != SLT_OK ? m->status : st;
}

/* Lines and samples, as many as the job says. */
static SltStatus sampled_once(const SltScene *s, const SltJob *j, SltIntegral *out, SltStats *stats, SltError *err) {
    Run r;
    bool gradient = wants_gradient(out);
    Replicates k = {.n = j->replicates  ? j->replicates
                         : s->uses_rand ? 8
                                        : 4,
                    .size = gradient ? (uint64_t)s->channels * s->nfloats : 0};
    Tails tails = {0};
    SltStatus st = run_begin(&r, s, j, err);
    if (st == SLT_OK && gradient && out->gradient_stderr && !tails_init(&tails, s))
        st = status_fail(err, SLT_LIMIT, "out of memory");
    if (st == SLT_OK) {
        k.value = alloc_zero(k.n * (size_t)s->channels, sizeof(double));
        k.interior = alloc_dense(k.n * k.size + 1, sizeof(double)),
        k.boundary = alloc_dense(k.n * k.size + 1, sizeof(double));
        k.missed = alloc_dense(k.n * k.size + 1, sizeof(double));
        k.half = alloc_dense(k.size + 1, sizeof(double));
        if (boundary_in_order(&r) && gradient && !(k.sketch = alloc_dense(SKETCHES * k.size, sizeof(double))))
            st = status_fail(err, SLT_LIMIT, "out of memory");
        r.met = s->met;
        if (r.met) r.met[s->nsites] = 1;
        if (!k.value || !k.interior || !k.boundary || !k.missed || !k.half)
            st = status_fail(err, SLT_LIMIT, "out of memory");
    }
    Smooth smooth = {.replicates = k.n,
                     .samples = (j->samples + k.n - 1) / k.n,
                     .value = k.value,
                     .gradient = gradient && !j->no_interior ? k.interior : NULL,
                     .tails = &tails};
    const bool lines = gradient && !j->no_boundary;
    if (st == SLT_OK) st = smooth_begin(&smooth, &r, lines);
    double t = pool_now();
    if (st == SLT_OK && lines) {
        r.pool.from = smooth.aside ? 0 : 0.7, r.pool.to = 1;
        st = all_boundaries(&r, &k);
    }
    r.stats.seconds_boundary += pool_now() - t;
    st = smooth_end(&smooth, &r, st);
    for (uint64_t row = 0; st == SLT_OK && gradient && row < (uint64_t)k.n * s->channels; row++) {
        double *of[] = {k.interior + row * s->nfloats, k.boundary + row * s->nfloats, k.missed + row * s->nfloats};
        st = pull_rows(s, of, 3, err);
    }
    for (uint32_t c = 0; st == SLT_OK && gradient && c < s->channels; c++) {
        double *half = k.half + (uint64_t)c * s->nfloats;
        st = pull_rows(s, &half, 1, err);
        for (uint32_t q = 0; st == SLT_OK && k.sketch && q < SKETCHES; q++) {
            double *sketch = k.sketch + q * k.size + (uint64_t)c * s->nfloats;
            st = pull_rows(s, &sketch, 1, err);
        }
    }
    if (st == SLT_OK) {
        for (uint64_t row = 0; gradient && row < (uint64_t)k.n * s->channels; row++) {
            mask_inactive(s, k.interior + row * s->nfloats), mask_inactive(s, k.boundary + row * s->nfloats);
            mask_inactive(s, k.missed + row * s->nfloats);
        }
        bars_of_rows(k.value, NULL, k.n, s->channels, out->value, out->value_stderr);
        if (r.kept.n && out->value_stderr) least_of_value(&r, out->value_stderr);
        bool apart = boundary_in_order(&r);
        bars_of_rows(k.interior, k.boundary, k.n, k.size, out->gradient, apart ? NULL : out->gradient_stderr);
        if (apart && out->gradient_stderr) {
            bars_of_rows(k.interior, NULL, k.n, k.size, NULL, out->gradient_stderr);
            bars_add_boundary(&k, s->dim == 3 ? BARS_SPACE : BARS_PLANE, out->gradient_stderr);
            for (uint32_t c = 0; c < s->channels; c++)
                mask_inactive(s, out->gradient_stderr + (uint64_t)c * s->nfloats);
        }
        bars_of_rows(k.interior, NULL, k.n, k.size, out->interior, NULL);
        bars_of_rows(k.boundary, NULL, k.n, k.size, out->boundary, NULL);
        for (uint64_t i = 0; i < k.size && out->gradient_stderr; i++) out->gradient_stderr[i] += fabs(k.half[i]) / k.n;
        if (out->gradient_stderr) bars_add_missed(&k, out->missed_estimate, out->gradient_stderr);
        else bars_of_rows(k.missed, NULL, k.n, k.size, out->missed_estimate, NULL);
        if (out->gradient && out->gradient_stderr)
            r.stats.singular =
                tails_add(&tails, (double)r.stats.samples, k.n, s->nfloats, out->gradient, out->gradient_stderr);
        bool few_samples = k.n > 1 && (j->samples + k.n - 1) / k.n < BARS_FEWEST,
             few_lines = k.n > 1 && !j->no_boundary && s->nsites && boundary_segments(j) / k.n < BARS_FEWEST;
        if (few_samples) unknown_errors(s, out->value_stderr, s->channels, false);
        if ((few_samples && !j->no_interior) || few_lines) unknown_errors(s, out->gradient_stderr, k.size, true);
        if (gradient && !j->no_boundary) {
            Boundary of = {.run = &r, .segments = boundary_segments(j) / k.n, .classes = 1};
            Missed missed = {.told = out->missed_estimate, .gradient = out->gradient};
            bool asks = missed.told && missed.gradient && out->gradient_stderr;
            if (asks) st = finer_missed(&r, &of, k.n, &missed.number);
            if (st == SLT_OK) st = lost_add(&r, &of, k.n, missed.number > 0 ? &missed : NULL, out->gradient_stderr);
            if (st == SLT_OK) st = ask_chance(&r, &k, out);
        }
        if (!s->f64 && r.kept.n && out->gradient_stderr && out->gradient)
            least_of_weights(&r, boundary_segments(j) / k.n, k.n, out);
        /* Bars that overflow, of slopes as small as 1e-40, are not known either. */
        for (uint64_t i = 0; i < k.size && out->gradient_stderr && out->gradient; i++)
            if (isnan(out->gradient_stderr[i]) && isfinite(out->gradient[i])) out->gradient_stderr[i] = HUGE_VAL;
        out->replicates = true;
    }
    if (s->followed) *s->followed = (double)r.followed / k.n;
    free(k.value), free(k.interior), free(k.boundary), free(k.missed), free(k.half), free(k.sketch);
    tails_free(&tails);
    run_forget_few(&r);
    run_end(&r, stats);
    return st;
}

double slt_estimate_beyond(const SltScene *s, const SltJob *j, const SltIntegral *out) {
    bool gradient = out->gradient && out->gradient_stderr;
    const double *v = gradient ? out->gradient : out->value, *e = gradient ? out->gradient_stderr : out->value_stderr;
    uint64_t n = (uint64_t)s->channels * (gradient ? s->nfloats : 1);
    double error = 0, scale = 0;
    if (!(j->error > 0 || j->abs_error > 0) || !v || !e) return 0;
    for (uint64_t i = 0; i < n; i++) {
        if (gradient && s->active && !s->active[i % s->nfloats]) continue;
        error = fmax(error, isfinite(e[i]) ? e[i] : HUGE_VAL), scale = fmax(scale, fabs(v[i]));
    }
    return error > 0 ? error / fmax(j->error * scale, j->abs_error) : 0;
}

#define TRIAL 0x1p-6        /* of the samples, at most: what all cost, where there may be too many; */
#define TRIAL_LEAST 0x1p-10 /* at least; lines that are few meet more for each sample: no budget is overspent so */
#define DEAR 8.0            /* most that crossings cost beside samples and vertices, or there is a trial, */
#define DEAREST 256.0       /* which may itself cost this */

/* Takes as many samples and lines as `limit` evaluations allow; *used: those of a trial that tells. none: no more than
 * the trial's, whose result is in `all`. */
static SltStatus fit_samples(const SltScene *s, SltJob *j, double limit, SltIntegral *all, SltStats *stats,
                             double *used, bool *none, SltError *err) {
    bool gradient = wants_gradient(all);
    double cheap = quadrature_lattice(s, j, gradient && !j->no_boundary, gradient && !j->no_interior);
    double trial = fmin(TRIAL, fmax(TRIAL_LEAST, limit / (DEAREST * cheap)));
    if (DEAR * cheap <= limit) return SLT_OK;
    SltJob few = *j;
    few.samples = (uint64_t)(trial * (double)j->samples) + 1, few.segments = (uint64_t)(trial * (double)j->segments);
    if (j->segments && !few.segments) few.segments = 1;
    SltStats own = SLT_STATS_INIT;
    SltStatus st = sampled_once(s, &few, all, &own, err);
    *used = (double)own.evaluations;
    double part = fmin(1, trial * fmax(0, limit - *used) / fmax(*used, 1));
    *none = part <= trial;
    if (*none) stats_add(stats, &own);
    else if (stats) stats->evaluations += own.evaluations;
    j->samples = (uint64_t)(part * (double)j->samples) + 1;
    if (j->segments) j->segments = (uint64_t)(part * (double)j->segments) + 1;
    return st;
}

/* Errors of lines fall with about the 3/4th power of their number, those of random samples with its root. */
#define RATE 0.75
#define LIMIT 0x1p28 /* evaluations, where the job has none */

SltStatus slt_estimate_sampled(const SltScene *s, const SltJob *job, SltIntegral *out, SltStats *stats, SltError *err) {
    SltJob j = *job;
    SltIntegral all = *out;
    uint64_t n = (uint64_t)s->channels * s->nfloats;
    bool gradient = wants_gradient(out);
    const bool all_theirs = (!gradient || (all.gradient && all.gradient_stderr)) && all.value && all.value_stderr;
    double *room = alloc_zero(all_theirs ? 0 : 2 * (n + s->channels), sizeof *room), limit = LIMIT, used = 0;
    if (!room) return status_fail(err, SLT_LIMIT, "out of memory");
    if (gradient && !all.gradient) all.gradient = room;
    if (gradient && !all.gradient_stderr) all.gradient_stderr = room + n;
    if (!all.value) all.value = room + 2 * n;
    if (!all.value_stderr) all.value_stderr = room + 2 * n + s->channels;
    if (j.max_evaluations) limit = (double)j.max_evaluations;
    if (j.error > 0 || j.abs_error > 0) { /* enough to begin with */
        uint64_t fewest = (uint64_t)BARS_FEWEST * (j.replicates > 8 ? j.replicates : 8);
        if (j.samples < fewest) j.samples = fewest;
        if (j.segments && j.segments < fewest) j.segments = fewest;
    }
    SltStop stop = SLT_STOP_NONE;
    bool none = false;
    SltStatus st = j.max_evaluations ? fit_samples(s, &j, limit, &all, stats, &used, &none, err) : SLT_OK;
    bool fewer = j.samples < job->samples || j.segments < job->segments;
    if (none && st == SLT_OK && slt_estimate_beyond(s, &j, &all) > 1) stop = SLT_STOP_EVALUATIONS;
    while (st == SLT_OK && !none) {
        SltStats own = SLT_STATS_INIT;
        st = sampled_once(s, &j, &all, &own, err);
        stats_add(stats, &own);
        double beyond = st == SLT_OK ? slt_estimate_beyond(s, &j, &all) : 0, cost = (double)own.evaluations;
        if (beyond <= 1) break;
        used += cost;
        if (fewer || used + cost * pow(beyond, 1 / RATE) > limit) { /* there is no hope */
            stop = SLT_STOP_EVALUATIONS;
            break;
        }
        double more = fmin(fmax(pow(beyond, 1 / RATE), 2), 16);
        j.samples = (uint64_t)(more * (double)j.samples) + 1;
        if (j.segments) j.segments = (uint64_t)(more * (double)j.segments) + 1;
    }
    if (stats) stats->stopped = stop;
    out->replicates = all.replicates, out->mixed = all.mixed;
    free(room);
    return st;
}

/* by: whose answer it is. */
static SltStatus integral_once(const SltScene *s, const SltJob *job, SltIntegral *out, SltEstimator *by,
                               SltStats *stats, SltError *err) {
    SltJob own;
    bool choice = job->estimator == SLT_EST_AUTO, turned = false;
    const SltJob *j = settle(s, job, &own, stats);
    *by = j->estimator;
    if (*by == SLT_EST_QUADRATURE) {
        SltStatus done = quadrature_integral(s, j, out, choice ? &turned : NULL, stats, err);
        if (!turned) {
            if (s->met) s->met[s->nsites] = 0; /* what lines have met in cells is no matter */
            return done;
        }
        *by = own.estimator = SLT_EST_LATTICE;
    }
    return slt_estimate_sampled(s, j, out, stats, err);
}

SltStatus slt_estimate_integral(const SltScene *s, const SltJob *job, SltIntegral *out, SltStats *stats,
                                SltError *err) {
    SltJob copy = *job, told;
    SltStats own = SLT_STATS_INIT;
    SltEstimator by;
    copy.integral = true;
    for (uint64_t i = 0; i < (uint64_t)s->channels * s->nfloats && out->left_bound; i++)
        out->left_bound[i] = NAN; /* cells prove more */
    if (slt_estimate_by_differences(copy.estimator))
        return difference_integral(s, settle(s, &copy, &told, stats), out, stats, err);
    SltStatus st = integral_once(s, &copy, out, &by, &own, err);
    if (st == SLT_OK) st = onesided_add(s, &copy, by, out, &own, err);
    stats_add(stats, &own);
    return st;
}

/* ---- one segment */
SltStatus slt_estimate_crossing(const SltScene *s, const double a[3], const double b[3], uint32_t stream,
                                SltCrossing *out, SltError *err) {
    SltJob j = {.integral = true};
    Run r;
    memset(out, 0, sizeof *out);
    out->site = -1, out->drop = -1;
    SltStatus st = run_begin(&r, s, &j, err);
    if (st != SLT_OK || !s->kernel[SLT_K_REGION] || !s->kernel[SLT_K_EVENT] || !s->kernel[SLT_K_SIDES] ||
        !s->kernel[SLT_K_SITE] || !s->kernel[SLT_K_SITE_GRAD] || !s->nsites) {
        run_end(&r, NULL);
        return st;
    }
    st = run_workers(&r, 1, 0, SINK_KEEP);
    if (st == SLT_OK) {
        Worker *w = &r.worker[0];
        Segment seg = {.tb = 1, .base = 1, .axis = -1, .stream = (int32_t)stream, .rand0 = 0.5};
        for (uint32_t d = 0; d < s->dim; d++) seg.a[d] = a[d], seg.b[d] = b[d];
        for (uint32_t i = 0; i < 2; i++)
            batch_set_x(&w->batch, i, i ? seg.b : seg.a), batch_set_stream(&w->batch, i, seg.stream, seg.rand0);
        batch_call(&w->batch, SLT_K_REGION, 2);
        Mark ma = batch_mark(&w->batch, 0), mb = batch_mark(&w->batch, 1);
        double threshold = HUGE_VAL;
        if (scene_outputs(s, SLT_K_REGION, SLT_OUT_DEPTH)) {
            /* One segment alone does not say which differences of depth are usual: the smallest threshold costs a few
             * evaluations. */
            Spread none;
            spread_clear(&none);
            threshold = spread_threshold(&none);
        }
        if (search_differ(ma, mb, threshold)) finder_add(&w->finder, &seg, ma, mb, threshold);
        finder_run(&w->finder, true);
        for (int d = 0; d < SLT_DROP_REASONS && !w->sink.nkept; d++)
            if (w->finder.dropped[d]) out->drop = d;
        if (w->sink.nkept) {
            Crossing *first = &w->sink.kept[0];
            for (uint64_t i = 1; i < w->sink.nkept; i++)
                if (w->sink.kept[i].t < first->t) first = &w->sink.kept[i];
            uint64_t order = 0;
            bool keep;
            w->batch.args.site = first->event.site;
            sink_weigh(&w->sink, first, &order, 1, &keep);
            out->found = true, out->t = first->t, out->g = first->g, out->site = first->event.site;
            memcpy(out->x, first->x, sizeof out->x), memcpy(out->dg, first->dg, sizeof out->dg),
                memcpy(out->k, first->event.k, sizeof out->k);
            for (uint32_t c = 0; c < s->channels; c++)
                out->f_before[c] = first->before[c], out->f_after[c] = first->before[c] + first->jump[c];
            for (int d = 0; d < SLT_DROP_REASONS && !keep; d++)
                if (w->finder.dropped[d]) out->drop = d;
        }
        if (w->finder.failed || w->sink.failed) st = status_fail(err, SLT_LIMIT, "out of memory");
    }
    run_end(&r, NULL);
    return st;
}
