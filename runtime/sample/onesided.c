/* Where boundaries coincide and move apart, or one lies on the domain's border, the integral has a derivative to each
 * side of the parameters, and none there. What crossings tell of that (coincide.c, kink.c) is told of two boundaries,
 * pair by pair. Of all there may be, three of which one is seen, the edge of a polygon and its neighbours, centres that
 * go any way, this says more: the same integral is asked beside the parameters, where it has a derivative. Few
 * parameters go one by one, forth and back: those are its two one-sided derivatives; many go all at once, along some
 * directions. The middle is given, and half of how far they are apart is stated.
 *
 * That is done where crossings have told of a kink, where two sites have one g (twins.c), where a boundary lies on
 * the border: the region is another beyond it, some units in the last place away; or where nothing was found at all, as
 * of a box that has no height. In the latter three cases one direction is tried first. Elsewhere nothing is asked
 * twice.
 */
#include "runtime/sample/onesided.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "runtime/base/rng.h"
#include "runtime/quadrature/inner.h"
#include "runtime/sample/alloc.h"
#include "runtime/sample/derived.h"
#include "runtime/sample/difference.h"
#include "runtime/sample/run.h"

enum {
    ONE_BY_ONE = 16, /* parameters that go by themselves, else there are so many */
    DIRECTIONS = 4,
    MOST_FLOATS = 1 << 16,   /* a program with more is not asked, */
    LEAST_SAMPLES = 1 << 12, /* and of fewer samples, or lines, nobody expects it to cost no more */
    ENOUGH = 1 << 16,        /* of what cells may cost, in samples of a lattice that costs as much, */
    LOOK = 1 << 12,          /* and where there may be no kink at all */
    PLACES = 6,              /* of a face of the domain */
    BEYOND = 8               /* units in the last place */
};
/* How far a parameter of size 1 goes: beyond rounding, and so little that what the integral bends by is none. */
#define STEP_F64 0x1p-14
#define STEP_F32 0x1p-12
#define NEARER 0.25 /* of a step, where something may grow from nothing: */
#define GROWS 0.7   /* of what derivatives were remains of a kink, and not of that */
#define ZERO 1e-12  /* as cos(pi / 2) is */
#define ASIDE 0.125 /* of that the others go with one: what coincides among them must not hide it */
#define BENT 0x1p-6 /* of the largest derivative: less is no kink, but a curve that turns fast */
#define SURE 2.0    /* stated errors of the moved integrals */
#define MORE 1.1    /* some directions do not meet all there are */

typedef struct Sides {
    const SltScene *s;
    uint32_t moves;
    bool one_by_one;
    bool alike;  /* the same lines and samples in all moves: their errors are alike, and differences no part of these */
    bool told;   /* crossings have told of a kink */
    bool few;    /* lines: where nothing was found few tell whether there is something */
    double part; /* of the step that is gone */
    uint64_t n;  /* channels * nfloats */
    double *lo, *hi, *error; /* [n] */
    double *gradient, *own;  /* [n]: of one move, and its error */
    uint32_t *parameter;     /* one_by_one: [moves / 2] */
} Sides;

static bool is_active(const SltScene *s, uint32_t p) { return !s->active || s->active[p]; }

/* ---- is there one? */
/* Points of a face, inside and beyond it, in pairs; how many. */
static uint32_t put_face(Batch *b, uint32_t axis, int end) {
    static const double part[3] = {0.7548776662466927, 0.5698402909980532, 0.3819660112501051};
    const SltScene *s = b->s;
    uint32_t n = s->dim > 1 ? PLACES : 1;
    double at = end ? s->hi[axis] : s->lo[axis], size = fmax(fabs(s->lo[axis]), fabs(s->hi[axis]));
    double by = BEYOND * size * (s->f64 ? DBL_EPSILON : (double)FLT_EPSILON);
    for (uint32_t i = 0; i < 2 * n; i++) {
        double x[3] = {0};
        for (uint32_t d = 0; d < s->dim; d++) x[d] = s->lo[d] + (s->hi[d] - s->lo[d]) * fmod(part[d] * (1 + i / 2), 1);
        x[axis] = at + ((i & 1) == (uint32_t)end ? by : -by);
        batch_set_x(b, i, x);
        batch_set_stream(b, i, 0, 0);
    }
    return n;
}

/* A place of a face of the domain at which the region ends. */
static bool ends_on_face(Batch *b, uint32_t axis, int end, SltPlace *at) {
    uint32_t n = put_face(b, axis, end), ends = 0;
    batch_call(b, SLT_K_REGION, 2 * n);
    for (uint32_t i = 0; i < n; i++) {
        if (batch_get_int(b, SLT_OUT_HASH, 0, 2 * i) == batch_get_int(b, SLT_OUT_HASH, 0, 2 * i + 1)) continue;
        if (ends++) continue;
        *at = (SltPlace){.known = true};
        for (uint32_t d = 0; d < b->s->dim; d++)
            for (int side = 0; side < 2; side++) {
                const void *x = b->args.in[SLT_IN_X0 + d];
                double v = b->f64 ? ((const double *)x)[2 * i + (uint32_t)side]
                                  : (double)((const float *)x)[2 * i + (uint32_t)side];
                (side ? at->beyond : at->x)[d] = v;
            }
    }
    return ends > (n > 1);
}

/* May a kink be where no crossing has told of one? at: on the border, if that is why. alike: boundaries are one, and
 * rise the same way; those that do not may be the two sides of a band, thinner than rounding, which is none. */
static SltStatus suspect(const SltScene *s, const SltJob *j, SltPlace *at, bool *may, bool *alike, SltStats *stats,
                         SltError *err) {
    Run r;
    SltStats own = SLT_STATS_INIT;
    SltStatus st = run_begin(&r, s, j, err);
    if (st == SLT_OK) st = run_workers(&r, 1, 0, SINK_NONE);
    if (st == SLT_OK && s->kernel[SLT_K_SITE] && !twins_begin(&r)) st = status_fail(err, SLT_LIMIT, "out of memory");
    for (uint32_t d = 0; d < s->dim && st == SLT_OK; d++)
        for (int end = 0; end < 2 && !at->known; end++)
            if (!ends_on_face(&r.worker[0].batch, d, end, at)) at->known = false;
    for (uint32_t i = 0; i < s->nsites && r.tied; i++) *may |= r.tied[i] > 0, *alike |= r.tied[i] >= TWINS_ALIKE;
    *may |= at->known;
    if (st == SLT_OK) run_collect(&r, &r.worker[0]);
    run_end(&r, &own);
    stats->evaluations += own.evaluations;
    return st;
}

/* ---- beside it */
static bool sides_begin(Sides *q, const SltScene *s, bool look) {
    uint32_t active = 0;
    for (uint32_t p = 0; p < scene_params(s); p++) active += is_active(s, p);
    *q = (Sides){
        .s = s, .part = 1, .n = (uint64_t)s->channels * s->nfloats, .one_by_one = !look && active <= ONE_BY_ONE};
    q->moves = look ? 2 : 2 * (q->one_by_one ? active : DIRECTIONS);
    q->parameter = alloc_zero(active, sizeof *q->parameter);
    q->lo = alloc_zero(5 * q->n, sizeof *q->lo);
    if (!q->lo || !q->parameter) return false;
    q->hi = q->lo + q->n, q->error = q->hi + q->n, q->gradient = q->error + q->n, q->own = q->gradient + q->n;
    for (uint32_t p = 0, k = 0; p < scene_params(s) && q->one_by_one; p++)
        if (is_active(s, p)) q->parameter[k++] = p;
    return true;
}

static void sides_end(Sides *q) { free(q->lo), free(q->parameter); }

/* What is small and no 0 is a width, which keeps its sign. */
static double step_of(const SltScene *s, uint32_t p) {
    double v = fabs(s->f64 ? ((const double *)s->params)[p] : (double)((const float *)s->params)[p]);
    double step = (s->f64 ? STEP_F64 : STEP_F32) * fmax(0.1, v);
    return v > ZERO ? fmin(step, 0.5 * v) : step;
}

/* The scene after one of the moves. */
static bool move(const Sides *q, uint32_t seed, uint32_t which, Moved *to) {
    const SltScene *s = q->s;
    double sign = which & 1 ? -1 : 1, *dir = alloc_zero(s->nfloats, sizeof *dir);
    uint32_t mine = q->one_by_one ? q->parameter[which / 2] : UINT32_MAX;
    for (uint32_t p = 0; p < s->nfloats && dir; p++) {
        uint32_t u[4];
        rng_block(seed, RNG_COINCIDE, DIRECTIONS + which / 2, p, u);
        if (!is_active(s, p)) continue;
        dir[p] = q->part * step_of(s, p) * (p == mine ? 1 : (u[1] & 1 ? 1 : -1) * (0.5 + 0.5 * rng_unit(u[0])));
        if (q->one_by_one && p != mine) dir[p] *= ASIDE;
    }
    bool memory = dir && scene_move(to, s, dir, 0, sign);
    if (!dir) memset(to, 0, sizeof *to);
    free(dir);
    return memory;
}

static void take(Sides *q, uint32_t which) {
    for (uint64_t i = 0; i < q->n; i++) {
        bool own = !q->one_by_one || i % q->s->nfloats == q->parameter[which / 2],
             first = !(q->one_by_one ? which & 1 : which);
        if (!own) continue;
        q->lo[i] = first ? q->gradient[i] : fmin(q->lo[i], q->gradient[i]);
        q->hi[i] = first ? q->gradient[i] : fmax(q->hi[i], q->gradient[i]);
        q->error[i] = first ? q->own[i] : fmax(q->error[i], q->own[i]);
    }
}

/* Of lines all moves together have as many as the integral itself had; what has come apart is thin, and cells stop when
 * they are done. */
static SltStatus run_moves(Sides *q, const SltJob *job, SltEstimator by, SltStats *stats, SltError *err) {
    SltJob j = *job;
    double start = pool_now();
    SltStatus st = SLT_OK;
    q->alike = by != SLT_EST_QUADRATURE;
    j.estimator = by, j.error = j.abs_error = 0, j.progress = NULL;
    if (q->alike && q->few) {
        j.samples = LEAST_SAMPLES, j.segments = j.segments ? LEAST_SAMPLES : 0;
    } else if (q->alike) {
        j.samples = j.samples / q->moves > LEAST_SAMPLES ? j.samples / q->moves : LEAST_SAMPLES;
        if (j.segments) j.segments = j.segments / q->moves > LEAST_SAMPLES ? j.segments / q->moves : LEAST_SAMPLES;
    } else {
        j.samples = q->moves > 2 ? ENOUGH : LOOK, j.segments = j.segments ? j.samples : 0;
    }
    for (uint32_t m = 0; m < q->moves && st == SLT_OK; m++) {
        SltIntegral out = SLT_INTEGRAL_INIT;
        SltStats own = SLT_STATS_INIT;
        Moved moved;
        if (job->time_limit > 0) j.time_limit = fmax(job->time_limit - (pool_now() - start), DBL_MIN);
        out.gradient = q->gradient, out.gradient_stderr = q->own;
        if (!move(q, j.seed, m, &moved)) st = status_fail(err, SLT_LIMIT, "out of memory");
        else if (q->alike) st = slt_estimate_sampled(&moved.scene, &j, &out, &own, err);
        else st = quadrature_integral(&moved.scene, &j, &out, NULL, &own, err);
        moved_free(&moved);
        stats->evaluations += own.evaluations;
        if (st == SLT_OK) take(q, m);
    }
    return st;
}

/* Where the two sides are apart: the middle, and half of that. */
static bool give(const Sides *q, SltIntegral *out) {
    bool any = false;
    for (uint32_t c = 0; c < q->s->channels; c++) {
        uint64_t from = (uint64_t)c * q->s->nfloats;
        double most = 0;
        for (uint64_t i = from; i < from + q->s->nfloats; i++)
            if (isfinite(q->lo[i]) && isfinite(q->hi[i])) most = fmax(most, fmax(fabs(q->lo[i]), fabs(q->hi[i])));
        for (uint64_t i = from; i < from + q->s->nfloats; i++) {
            double half = 0.5 * (q->hi[i] - q->lo[i]), middle = 0.5 * (q->hi[i] + q->lo[i]);
            if (!(half > BENT * most) || !isfinite(half)) continue; /* NaN is not */
            bool sure = half > SURE * q->error[i];
            if (!sure && !(q->alike && q->told)) continue;
            out->gradient_stderr[i] = fmax(out->gradient_stderr[i], half * (q->one_by_one ? 1 : MORE));
            any |= sure;
            /* What crossings have told is as good a middle, and known better. */
            if (!sure || fabs(out->gradient[i] - middle) <= 0.5 * half) continue;
            if (out->boundary) out->boundary[i] += middle - out->gradient[i];
            out->gradient[i] = middle, out->gradient_stderr[i] += q->error[i];
        }
    }
    return any;
}

/* Nothing was found at all: what there may be has no width where the parameters are. */
static bool is_empty(const SltScene *s, const SltIntegral *out) {
    for (uint64_t i = 0; i < (uint64_t)s->channels * s->nfloats; i++)
        if (is_active(s, (uint32_t)(i % s->nfloats)) && (out->gradient[i] != 0 || out->gradient_stderr[i] != 0))
            return false;
    return true;
}

/* Forth and back along one direction, so much of a step: the largest by which derivatives differ, 0 if surely none do.
 */
static SltStatus look(const SltScene *s, const SltJob *j, SltEstimator by, bool few, double part, double *differ,
                      SltStats *stats, SltError *err) {
    Sides q;
    double most = 0;
    SltStatus st = sides_begin(&q, s, true) ? SLT_OK : status_fail(err, SLT_LIMIT, "out of memory");
    q.few = few, q.part = part;
    if (st == SLT_OK) st = run_moves(&q, j, by, stats, err);
    *differ = 0;
    for (uint64_t i = 0; i < q.n && st == SLT_OK; i++) most = fmax(most, fmax(fabs(q.lo[i]), fabs(q.hi[i])));
    for (uint64_t i = 0; i < q.n && st == SLT_OK; i++)
        if (q.hi[i] - q.lo[i] > 2 * fmax(BENT * most, SURE * q.error[i])) *differ = fmax(*differ, q.hi[i] - q.lo[i]);
    sides_end(&q);
    return st;
}

/* Of what was not there at all, as a disc of radius 0, derivatives grow as it does, and are 0 to both sides. */
static SltStatus look_where_empty(const SltScene *s, const SltJob *j, SltEstimator by, double differ, bool *may,
                                  SltStats *stats, SltError *err) {
    double nearer;
    SltStatus st = look(s, j, by, true, NEARER, &nearer, stats, err);
    *may = nearer > GROWS * differ;
    return st;
}

SltStatus onesided_add(const SltScene *s, const SltJob *j, SltEstimator by, SltIntegral *out, SltStats *stats,
                       SltError *err) {
    SltPlace border = {.known = false};
    uint64_t *counted = &stats->dropped[SLT_DROP_COINCIDENT];
    bool has = s->nsites && s->nfloats && s->nfloats <= MOST_FLOATS && s->kernel[SLT_K_REGION], may = *counted > 0,
         alike = false;
    SltStatus st = SLT_OK;
    Sides q;
    if (!has || !out->gradient || !out->gradient_stderr || j->no_boundary || j->max_evaluations || s->uses_rand)
        return SLT_OK;
    bool told = may, empty = is_empty(s, out);
    if (!may) st = suspect(s, j, &border, &may, &alike, stats, err);
    may |= empty;
    if (st == SLT_OK && may && !told) {
        double differ = 0;
        st = look(s, j, by, empty, 1, &differ, stats, err), may = differ > 0;
        if (st == SLT_OK && may && empty) st = look_where_empty(s, j, by, differ, &may, stats, err);
    }
    if (st != SLT_OK || !may) return st;
    if (!sides_begin(&q, s, false)) st = status_fail(err, SLT_LIMIT, "out of memory");
    q.told = told;
    if (st == SLT_OK) st = run_moves(&q, j, by, stats, err);
    if (st == SLT_OK && give(&q, out) && !*counted && (border.known || alike || empty))
        ++*counted, place_least(&stats->dropped_at[SLT_DROP_COINCIDENT], &border);
    sides_end(&q);
    return st;
}
