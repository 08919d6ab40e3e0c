/* Where cells have done what they could and state a wide error all the same: would lines and samples state less? */
#include <math.h>
#include <stdlib.h>

#include "runtime/quadrature/inner.h"
#include "runtime/sample/alloc.h"

enum { PILOT = 32 }; /* a lattice of so many times fewer lines and samples tells; */
#define PILOT_RATE 0.75 /* the errors of lines fall with about this power of their number */
#define WIDE 0x1p-6   /* of the largest component: nobody asks where less is stated */
#define WORSE 3.0     /* than the lattice's must the error of cells be */

typedef struct Widest {
    double error, scale;
} Widest;

static Widest widest(const SltScene *s, const double *gradient, const double *error) {
    Widest w = {0};
    for (uint64_t i = 0; i < (uint64_t)s->channels * s->nfloats; i++) {
        if (s->active && !s->active[i % s->nfloats]) continue;
        w.error = fmax(w.error, isnan(error[i]) ? INFINITY : error[i]), w.scale = fmax(w.scale, fabs(gradient[i]));
    }
    return w;
}

/* Lines that do not find what cells have found are blind to it, and their error is. */
static bool agrees(const SltScene *s, const double *a, const double *a_error, const double *b, const double *b_error) {
    for (uint64_t i = 0; i < (uint64_t)s->channels * s->nfloats; i++) {
        bool on = !s->active || s->active[i % s->nfloats];
        if (on && !(fabs(a[i] - b[i]) <= a_error[i] + 2 * b_error[i])) return false;
    }
    return true;
}

SltStatus quadrature_turns(const SltScene *s, const SltJob *job, const double *gradient, const double *error,
                           bool *turned, SltStats *stats, SltError *err) {
    uint64_t n = (uint64_t)s->channels * s->nfloats;
    Widest cells = widest(s, gradient, error);
    SltJob j = *job;
    /* Where boundaries coincide the derivative has a kink, of which cells see more than lines, and the error is that.
     */
    if (job->max_evaluations || stats->dropped[SLT_DROP_COINCIDENT] || !(cells.error > WIDE * cells.scale))
        return SLT_OK;
    j.estimator = SLT_EST_LATTICE, j.samples = j.samples / PILOT + 1;
    if (j.segments) j.segments = j.segments / PILOT + 1;
    double *pilot = alloc_zero(2 * n, sizeof *pilot);
    if (!pilot) return status_fail(err, SLT_LIMIT, "out of memory");
    SltIntegral out = SLT_INTEGRAL_INIT;
    SltStats own = SLT_STATS_INIT;
    out.gradient = pilot, out.gradient_stderr = pilot + n;
    SltStatus st = slt_estimate_sampled(s, &j, &out, &own, err);
    stats->evaluations += own.evaluations;
    double lattice = widest(s, pilot, pilot + n).error * pow(PILOT, -PILOT_RATE);
    *turned = st == SLT_OK && WORSE * lattice < cells.error && agrees(s, gradient, error, pilot, pilot + n);
    free(pilot);
    return st;
}
