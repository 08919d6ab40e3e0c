/* What crossings that could not be integrated weigh: as much, one by one, as those that could; those of which it is
 * known what f jumps by, as much more or less as that is; for a parameter that moves none of those, as if it moved
 * them by as much as itself. f may change there by no more than it does everywhere: its decisions differ, and nobody
 * sees what they decide.
 *
 * The sum of what the others weigh, jumps of both signs alike, is not that of the derivative: of a disc's centre the
 * two halves of its edge cancel. The lines run once more with random signs: the mean square of such sums is the sum of
 * the squares, and by Cauchy and Schwarz its root, times that of the number, at least the sum of the sizes. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/boundary.h"

#define NOTHING 1e-9 /* of what moves most: rounding makes as much */

/* Static sites have a warning of their own, coinciding boundaries are integrated. */
static uint64_t lost_of(const SltStats *s) {
    uint64_t lost = 0;
    for (int d = 0; d < SLT_DROP_REASONS; d++)
        if (d != SLT_DROP_STATIC && d != SLT_DROP_COINCIDENT) lost += s->dropped[d];
    return lost;
}

/* Of the lost ones these were found and counted before they were dropped. */
static uint64_t kept_of(const SltStats *s) {
    uint64_t dropped =
        s->dropped[SLT_DROP_ZERO_GRADIENT] + s->dropped[SLT_DROP_INCONSISTENT] + s->dropped[SLT_DROP_NOT_FINITE];
    return s->crossings > dropped ? s->crossings - dropped : 0;
}

/* How many crossings of the size of those that were integrated. */
static double number_lost(const Run *r) {
    double all = (double)lost_of(&r->stats);
    if (!r->kept.n || !(r->kept.sum > 0)) return all;
    return fmax(all - (double)r->gone.n, 0) + r->gone.sum / (r->kept.sum / (double)r->kept.n);
}

/* What they weigh if they move by 1 as a parameter does: where nothing that was found tells how fast. Where it is not
 * known by how much f jumps, by as much as elsewhere. */
static void weigh_unknown(const Run *r, bool adjoint, uint32_t replicates, double most[SLT_MAX_CHANNELS]) {
    for (uint32_t c = 0; c < r->s->channels; c++) {
        double usual = adjoint ? 0 : r->kept.n ? r->kept.by[c] / (double)r->kept.n : 1;
        most[c] = (r->gone_along[c] + usual * r->parts_gone) / replicates;
    }
}

/* The sums of one run of the lines with random signs, squared, added to `squares`. */
static SltStatus add_squares(Run *r, Boundary *y, uint32_t n, uint64_t size, double *sums, double *squares) {
    double *targets[ACCUMS];
    for (uint32_t c = 0; c < n; c++) targets[c] = sums + (uint64_t)c * r->s->nfloats;
    y->targets = targets;
    memset(sums, 0, (uint64_t)n * r->s->nfloats * sizeof *sums);
    SltStatus st = boundary_run(y, y->adjoint ? SINK_REVERSE : SINK_INTEGRAL);
    /* Classes of a weighted image are sums of their own, each of some of its crossings. */
    for (uint64_t i = 0; i < (y->adjoint ? n * size : size); i++) squares[i % size] += sums[i] * sums[i];
    return st;
}

SltStatus lost_add(Run *r, const Boundary *of, uint32_t replicates, const Missed *missed, double *error) {
    uint32_t channels = r->s->channels, n = of->adjoint ? of->classes : 3 * channels;
    uint64_t size = (uint64_t)(of->adjoint ? 1 : channels) * r->s->nfloats, lost = lost_of(&r->stats),
             kept = kept_of(&r->stats);
    if ((!lost && !missed) || !error) return SLT_OK;
    double missing = number_lost(r), unknown[SLT_MAX_CHANNELS];
    weigh_unknown(r, of->adjoint != NULL, replicates, unknown);
    double *sums = alloc_zero((uint64_t)n * r->s->nfloats + size, sizeof *sums);
    if (!sums) return status_fail(r->err, SLT_LIMIT, "out of memory");
    double *squares = sums + (uint64_t)n * r->s->nfloats;
    SltStats before = r->stats;
    SltStatus st = SLT_OK;
    for (uint32_t i = 0; i < replicates && st == SLT_OK && kept; i++) {
        Boundary y = *of;
        y.replicate = i, y.replicates = replicates, y.any_sign = true, y.misses = false;
        st = add_squares(r, &y, n, size, sums, squares);
    }
    uint64_t evaluations = r->stats.evaluations;
    r->stats = before, r->stats.evaluations = evaluations;
    double largest = 0;
    for (uint64_t p = 0; p < size; p++) largest = fmax(largest, squares[p]);
    /* One replicate of n has kept / n crossings, and its sum is that of the whole boundary. */
    for (uint64_t p = 0; p < size; p++) {
        if (r->s->active && !r->s->active[p % r->s->nfloats]) continue;
        double found = sqrt((double)kept / replicates * squares[p] / replicates);
        bool tells = squares[p] > NOTHING * NOTHING * largest;
        error[p] += !kept ? HUGE_VAL : tells ? missing / (double)kept * found : unknown[p / r->s->nfloats];
        double most = missed && kept ? missed->number / (double)kept * found : 0;
        if (most <= 0 || most <= fabs(missed->told[p])) continue;
        error[p] += most - fabs(missed->told[p]);
        missed->told[p] = copysign(most, missed->gradient[p]);
    }
    free(sums);
    return st;
}
