/* Where cells have done what they could and state a wide error all the same: would lines and samples state less? */
#include <math.h>
#include <stdlib.h>

#include "runtime/quadrature/inner.h"
#include "runtime/sample/alloc.h"

/* Lattices of so many times fewer lines and samples tell. The first may be so coarse that it misses what the whole one
 * resolves, and state that; then the next is asked. */
static const uint32_t pilots[] = {32, 8};
#define PILOT_RATE 0.75 /* the errors of lines fall with about this power of their number */
#define WIDE 0x1p-8   /* of the largest component: nobody asks where less is stated */
#define FALLEN 16.0    /* samples on what cells have left, or lines see nothing of it */
#define WORSE 2.0     /* than the lattice's must the error of cells be */

static double widest(const SltScene *s, const double *error) {
    double most = 0;
    for (uint64_t i = 0; i < (uint64_t)s->channels * s->nfloats; i++)
        if (!s->active || s->active[i % s->nfloats]) most = fmax(most, isnan(error[i]) ? INFINITY : error[i]);
    return most;
}

/* Lines that do not find what cells have found are blind to it, and their error is. */
static bool agrees(const SltScene *s, const double *a, const double *a_error, const double *b, const double *b_error) {
    for (uint64_t i = 0; i < (uint64_t)s->channels * s->nfloats; i++) {
        bool on = !s->active || s->active[i % s->nfloats];
        if (on && !(fabs(a[i] - b[i]) <= a_error[i] + 2 * b_error[i])) return false;
    }
    return true;
}

/* Lines that met nothing state 0 +- 0. Of boundaries that cells have met, and of what they have left between the lines,
 * as a disc of 1e-6, that tells nothing. */
static bool is_blind(const double *pilot, uint64_t n, const SltStats *cells, uint64_t samples) {
    for (uint64_t i = 0; i < n; i++)
        if (pilot[i] != 0) return false;
    return cells->crossings || (cells->left > 0 && cells->left * (double)samples < FALLEN);
}

SltStatus quadrature_turns(const SltScene *s, const SltJob *job, const double *gradient, const double *error,
                           double scale, bool *turned, SltStats *stats, SltError *err) {
    uint64_t n = (uint64_t)s->channels * s->nfloats;
    double cells = widest(s, error);
    SltJob j = *job;
    if (job->max_evaluations || !(cells > WIDE * scale)) return SLT_OK;
    /* Of boundaries that coincide, where the derivative has a kink, and of jumps that nothing tracks cells see more
     * than lines: what they state is that. */
    if (stats->dropped[SLT_DROP_COINCIDENT] || stats->upset > 0) return SLT_OK;
    j.estimator = SLT_EST_LATTICE;
    double *pilot = alloc_zero(2 * n, sizeof *pilot);
    if (!pilot) return status_fail(err, SLT_LIMIT, "out of memory");
    SltStatus st = SLT_OK;
    bool seen = true;
    for (size_t i = 0; i < sizeof pilots / sizeof *pilots && st == SLT_OK && seen && !*turned; i++) {
        SltIntegral out = SLT_INTEGRAL_INIT;
        SltStats own = SLT_STATS_INIT;
        j.samples = job->samples / pilots[i] + 1;
        if (job->segments) j.segments = job->segments / pilots[i] + 1;
        out.gradient = pilot, out.gradient_stderr = pilot + n;
        st = slt_estimate_sampled(s, &j, &out, &own, err);
        stats->evaluations += own.evaluations;
        seen = st == SLT_OK && agrees(s, gradient, error, pilot, pilot + n);
        *turned = seen && !is_blind(pilot, 2 * n, stats, j.samples) &&
                  WORSE * widest(s, pilot + n) * pow(pilots[i], -PILOT_RATE) < cells;
    }
    free(pilot);
    return st;
}
