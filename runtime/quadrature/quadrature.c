/* Integrals over the domain: sweeps until the stated error is small enough. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/effort.h"
#include "runtime/sample/alloc.h"

#define TURNING 0.4     /* of what the lattice costs: what cells may cost before it is seen what they leave over, */
#define TURNED_LEFT 0.02 /* and the share beyond which the lattice is turned to */
#define EDGES 0x1p-16 /* share that rounding may take from the measure of all cells */
#define MARCH_MOST 100.0 /* evaluations for a segment, beyond which curves of shadows are not followed: each costs a
                          * quarter of the time of one of lines without gaps, of which there are 8 to 60 */

bool quadrature_may(const SltScene *s) {
    if (s->uses_rand) return false;
    /* A [SkipLoop] boundary is one of many iterations, which bounds know one by one. */
    for (uint32_t i = 0; i < s->nsites && s->site_skips; i++)
        if (s->site_skips[i]) return false;
    return true;
}

bool quadrature_can(const SltScene *s) {
    if (!quadrature_may(s) || !s->kernel[SLT_K_BOUNDS]) return false;
    /* Choices of chunks are edges too, of which a program without sites has no kernels. */
    return !(s->nedges || s->chunked) ||
           (s->kernel[SLT_K_EDGE] && s->kernel[SLT_K_EDGE_BOUNDS] && s->kernel[SLT_K_SIDES]);
}

bool quadrature_has_boundary(const SltScene *s, SltKernelKind last) {
    return s->nsites && s->kernel[SLT_K_REGION] && s->kernel[SLT_K_EVENT] && s->kernel[SLT_K_SIDES] &&
           s->kernel[SLT_K_SITE] && s->kernel[SLT_K_SITE_GRAD] && s->kernel[last];
}

bool quadrature_compares_seams(const SltScene *s, const SltJob *j) { return !j->no_boundary && s->edge_upsets; }

void quadrature_state(Run *r, const Sweep *p) {
    SltStats *t = &r->stats;
    const SltScene *s = r->s;
    t->cells = true;
    t->settled = p->counts.settled, t->curved = p->counts.curved, t->left = p->counts.left;
    t->upset = fmin(p->counts.upset, 1), t->upset_line = 0;
    /* No error is stated that would say so. */
    if (p->kind == SWEEP_FORWARD && p->counts.rim_jump > 0) t->singular = p->counts.rim_jump / p->counts.rough_jump;
    if (p->counts.upset_edge && s->edge_line) t->upset_line = s->edge_line[p->counts.upset_edge - 1];
    /* Sums round, and tiles end two floats inside of the domain. */
    double all = t->settled + t->curved;
    bool whole = all > 1 || (!(t->left > 0) && all > 1 - EDGES);
    t->certified = fmax(0, (whole ? 1 : all) - t->upset - p->counts.banded);
    t->left_bound = isfinite(p->left_bound) ? p->left_bound : NAN;
    t->boxes = p->counts.boxes, t->samples = p->counts.points;
}

/* Where tiles cancel, errors need not be less than what is asked for beside this part of them: of a derivative that is
 * 0, no part of it would do. */
#define CANCELS 0x1p-7

/* The largest stated error of the gradient, or without one of the value: the rules' part and that of what is left. */
static void errors_of(const Sweep *p, bool gradient, double *rules, double *left, double *scale) {
    const SltScene *s = p->run->s;
    const Sums *m = &p->sums;
    *rules = *left = *scale = 0;
    for (uint32_t c = 0; c < s->channels && !gradient; c++) {
        *rules = fmax(*rules, p->f_error[c]), *left = fmax(*left, 2 * sqrt(p->f_variance[c]) + p->f_hidden[c]);
        *scale = fmax(*scale, fabs(p->f[c]));
    }
    /* Millions of components, most of them 0: each of these is a comparison, which is false of NaN. */
    double fine = 0, hidden = 0, largest = 0;
    for (uint32_t row = 0; gradient && row < m->rows; row++)
        for (uint32_t q = 0; q < m->nfloats; q++) {
            size_t at = (size_t)row * m->nfloats + q;
            if (s->active && !s->active[q]) continue;
            double error = m->error[at], sum = fabs(m->boundary[at] + m->interior[at]), size = CANCELS * m->size[at];
            if (error > fine) fine = error;
            if (m->variance[at] > 0) hidden = fmax(hidden, sums_error(m, at) - error);
            if (sum > largest) largest = sum;
            if (size > largest) largest = size;
        }
    if (gradient) *rules = fine, *left = hidden, *scale = largest;
}

/* Derivatives are millions where parameters are many, and pages of what they are put into may be untouched: threads
 * share that. */
enum { PART = 1 << 15 };
typedef struct Putting {
    const Sweep *p;
    SltIntegral *out;
} Putting;

static bool put_part(void *user, uint32_t worker, uint64_t part) {
    const Sweep *p = ((Putting *)user)->p;
    SltIntegral *out = ((Putting *)user)->out;
    const Sums *m = &p->sums;
    const uint8_t *active = p->run->s->active;
    size_t all = (size_t)m->rows * m->nfloats, to = part * PART + PART < all ? part * PART + PART : all;
    uint32_t q = (uint32_t)(part * PART % m->nfloats);
    (void)worker;
    for (size_t at = part * PART; at < to; at++) {
        bool on = !active || active[q];
        double b = on ? m->boundary[at] : 0, i = on ? m->interior[at] : 0;
        if (out->gradient) out->gradient[at] = b + i;
        if (out->gradient_stderr) {
            double error = on ? sums_error(m, at) : 0;
            out->gradient_stderr[at] = isnan(error) && isfinite(b + i) ? HUGE_VAL : error;
        }
        if (out->interior) out->interior[at] = i;
        if (out->boundary) out->boundary[at] = b;
        /* A page of zeros that none has written to costs no memory. */
        if (out->missed_estimate && out->missed_estimate[at] != 0) out->missed_estimate[at] = 0;
        if (out->left_bound && on && p->mixed) out->left_bound[at] = NAN;
        else if (out->left_bound && out->left_bound[at] != 0) out->left_bound[at] = 0;
        q = q + 1 < m->nfloats ? q + 1 : 0;
    }
    return true;
}
static void no_merge(void *user, uint32_t worker, uint64_t part) { (void)user, (void)worker, (void)part; }

static void put(const Sweep *p, SltIntegral *out) {
    const SltScene *s = p->run->s;
    out->replicates = false, out->mixed = p->mixed;
    for (uint32_t c = 0; c < s->channels; c++) {
        if (out->value) out->value[c] = p->f[c];
        if (out->value_stderr) out->value_stderr[c] = p->f_error[c] + 2 * sqrt(p->f_variance[c]) + p->f_hidden[c];
    }
    uint64_t parts = ((uint64_t)p->sums.rows * p->sums.nfloats + PART - 1) / PART;
    PoolOptions pool = {.threads = parts < p->run->threads ? (uint32_t)parts : p->run->threads}; /* nothing stops it */
    pool_run(&pool, parts, put_part, no_merge, &(Putting){p, out}, NULL);
}

double quadrature_segments(const SltJob *j) {
    if (j->segments) return (double)j->segments;
    return j->integral ? (double)(j->samples ? j->samples : 1) : (double)(j->spp ? j->spp : 1);
}

double quadrature_lattice(const SltScene *s, const SltJob *j, bool boundary, bool interior) {
    double pixels = 1, samples = (double)(j->integral ? j->samples : j->spp);
    for (uint32_t d = 0; d < s->dim && !j->integral; d++) pixels *= j->size[d];
    return pixels * ((boundary ? quadrature_segments(j) / s->dim : 0) + samples * (1 + (interior ? s->channels : 0)));
}

/* Nothing to hope for: the lattice does it all, and the answer says so. */
static SltStatus by_lattice(const SltScene *s, const SltJob *job, SltIntegral *out, SltStats *stats, SltError *err) {
    SltJob j = *job;
    SltStats own = SLT_STATS_INIT;
    j.estimator = SLT_EST_LATTICE;
    SltStatus st = slt_estimate_sampled(s, &j, out, &own, err);
    own.cells = true, own.left = 1, own.left_bound = NAN;
    out->mixed = true;
    stats_add(stats, &own);
    return st;
}

/* SLT_INTERIOR_SAMPLES: value and interior from samples, as with the lattice; the boundary is added to them. */
static SltStatus with_samples(const SltScene *s, const SltJob *job, SltIntegral *out, bool *turned, SltStats *stats,
                              SltError *err) {
    SltJob j = *job;
    size_t n = (size_t)s->channels * s->nfloats;
    double *boundary = alloc_zero(n, sizeof *boundary), *error = alloc_zero(n, sizeof *error);
    SltIntegral own = SLT_INTEGRAL_INIT;
    own.boundary = boundary, own.gradient_stderr = error, own.left_bound = out->left_bound;
    j.interior = SLT_INTERIOR_AUTO, j.no_interior = true;
    SltStatus st = boundary && error ? quadrature_integral(s, &j, &own, turned, stats, err)
                                     : status_fail(err, SLT_LIMIT, "out of memory");
    if (turned && *turned) {
        free(boundary), free(error);
        return st;
    }
    SltStats cells = stats ? *stats : (SltStats){0};
    j = *job, j.no_boundary = true, j.estimator = SLT_EST_LATTICE, j.error = j.abs_error = 0;
    SltIntegral smooth = *out;
    smooth.left_bound = NULL;
    if (st == SLT_OK) st = slt_estimate_integral(s, &j, &smooth, stats, err);
    for (size_t i = 0; i < n && st == SLT_OK; i++) {
        if (out->gradient) out->gradient[i] += boundary[i];
        if (out->gradient_stderr) out->gradient_stderr[i] += error[i];
        if (out->boundary) out->boundary[i] = boundary[i];
    }
    out->mixed = own.mixed, out->replicates = false;
    stats_of_cells(stats, &cells);
    if (stats && st == SLT_OK && slt_estimate_beyond(s, job, out) > 1) stats->stopped = SLT_STOP_EVALUATIONS;
    free(boundary), free(error);
    return st;
}

static bool wants_gradient(const SltIntegral *out) {
    return out->gradient || out->gradient_stderr || out->interior || out->boundary;
}

/* The lattice takes over: of cells what they cost remains. */
static void forget(SltStats *own, const SltScene *s, SltIntegral *out) {
    *own = (SltStats){.struct_size = own->struct_size, .evaluations = own->evaluations, .seconds = own->seconds};
    out->mixed = false;
    for (uint64_t i = 0; out->left_bound && i < (uint64_t)s->channels * s->nfloats; i++) out->left_bound[i] = NAN;
}

SltStatus quadrature_integral(const SltScene *s, const SltJob *job, SltIntegral *out, bool *turned, SltStats *stats,
                              SltError *err) {
    SltJob j = *job;
    Run r;
    SltStats own = SLT_STATS_INIT;
    SltIntegral all = *out;
    double *room = NULL, size = 0;
    j.integral = true;
    bool gradient = wants_gradient(out), value = out->value || out->value_stderr;
    if (j.interior == SLT_INTERIOR_SAMPLES && !(j.no_interior && !value))
        return with_samples(s, &j, out, turned, stats, err);
    Outlook outlook = quadrature_outlook(s, &j, stats);
    if (outlook.no_memory) return status_fail(err, SLT_LIMIT, "out of memory");
    if (outlook.unproven > QUADRATURE_HOPELESS) return by_lattice(s, &j, out, stats, err);
    SltStatus st = run_begin(&r, s, &j, err);
    bool asks = turned && gradient && !(j.error > 0 || j.abs_error > 0) && !quadrature_marches(s, &j);
    if (asks && !(room = alloc_zero(2 * (size_t)s->channels * s->nfloats, sizeof *room)))
        st = status_fail(err, SLT_LIMIT, "out of memory");
    if (asks && !all.gradient) all.gradient = room;
    if (asks && !all.gradient_stderr) all.gradient_stderr = room + (size_t)s->channels * s->nfloats;
    Sweep p = {.run = &r, .kind = SWEEP_INTEGRAL, .errors = true, .marches = quadrature_marches(s, &j)};
    bool boundary = gradient && !j.no_boundary && quadrature_has_boundary(s, SLT_K_SITE_VJP);
    p.interior = gradient && !j.no_interior && s->kernel[SLT_K_VJP];
    p.segments = boundary ? quadrature_segments(&j) : 0, p.samples = (double)j.samples;
    p.options.curves = boundary, p.options.volume = p.interior || value;
    p.options.seen = outlook.seen;
    p.options.seams = gradient && quadrature_compares_seams(s, &j);
    double lattice = quadrature_lattice(s, &j, boundary, p.interior);
    Effort e;
    SltStop stop = SLT_STOP_NONE;
    if (st == SLT_OK) st = sweep_begin(&p);
    if (st == SLT_OK) effort_begin(&e, &r, lattice, outlook);
    if (st == SLT_OK && p.marches) effort_marches(&e, &p);
    while (st == SLT_OK) {
        double rules, left, scale;
        uint64_t before = r.stats.evaluations;
        effort_apply(&e, &p, before);
        p.options.fewer =
            !e.sweeps || (s->dim < 3 && (!p.interior || s->rigid)); /* else derivatives may need what f does not */
        bool trial = turned && !e.wanted && !e.sweeps;
        p.cells_budget = trial && !p.marches ? (uint64_t)(TURNING * lattice) : 0;
        p.only_if_left = trial && !p.marches ? TURNED_LEFT : HUGE_VAL; /* of shares, which round */
        r.pool.from = e.sweeps ? 1 : 0, r.pool.to = 1;                 /* how many sweeps there will be is not known */
        p.only_if_cost = trial && p.marches ? MARCH_MOST * p.segments : 0;
        if ((st = sweep_run(&p)) != SLT_OK) break;
        if (p.gave_up) {
            *turned = true;
            break;
        }
        errors_of(&p, gradient, &rules, &left, &scale);
        if (effort_took(&e, rules, left)) put(&p, &all), quadrature_state(&r, &p), size = scale;
        uint64_t used = r.stats.evaluations;
        if (!effort_more(&e, &p, rules, left, scale, used, used - before, &stop)) break;
    }
    r.stats.stopped = stop, r.stats.seconds_boundary = pool_now() - r.start;
    sweep_end(&p);
    run_end(&r, &own);
    out->replicates = all.replicates, out->mixed = all.mixed;
    if (st == SLT_OK && asks && !*turned)
        st = quadrature_turns(s, &j, all.gradient, all.gradient_stderr, size, turned, &own, err);
    if (turned && *turned) forget(&own, s, out);
    stats_add(stats, &own);
    free(room);
    return st;
}
