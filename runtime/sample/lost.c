/* What crossings that could not be integrated weigh: as much, one by one, as those that could.
 *
 * The sum of what the others weigh, jumps of both signs alike, is not that of the derivative: of a disc's centre the
 * two halves of its edge cancel. The lines run once more with random signs: the mean square of such sums is the sum of
 * the squares, and by Cauchy and Schwarz its root, times that of the number, at least the sum of the sizes. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/boundary.h"

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

SltStatus lost_add(Run *r, double segments, uint32_t replicates, double *error) {
    uint64_t size = (uint64_t)r->s->channels * r->s->nfloats, lost = lost_of(&r->stats), kept = kept_of(&r->stats);
    if (!lost || !error) return SLT_OK;
    double *sums = alloc_zero(4 * size, sizeof *sums), *squares = sums + 3 * size, *targets[ACCUMS];
    if (!sums) return status_fail(r->err, SLT_LIMIT, "out of memory");
    for (uint32_t c = 0; c < 3 * r->s->channels; c++) targets[c] = sums + (uint64_t)c * r->s->nfloats;
    SltStats before = r->stats;
    SltStatus st = SLT_OK;
    for (uint32_t i = 0; i < replicates && st == SLT_OK && kept; i++) {
        Boundary y = {.run = r,
                      .replicate = i,
                      .replicates = replicates,
                      .segments = segments,
                      .targets = targets,
                      .classes = 1,
                      .any_sign = true};
        memset(sums, 0, 3 * size * sizeof *sums);
        st = boundary_run(&y, SINK_INTEGRAL);
        for (uint64_t p = 0; p < size; p++) squares[p] += sums[p] * sums[p];
    }
    uint64_t evaluations = r->stats.evaluations;
    r->stats = before, r->stats.evaluations = evaluations;
    /* One replicate of n has kept / n crossings, and its sum is that of the whole boundary. */
    for (uint64_t p = 0; p < size; p++) {
        bool moves = !r->s->active || r->s->active[p % r->s->nfloats];
        double found = sqrt((double)kept / replicates * squares[p] / replicates);
        if (moves) error[p] += kept ? (double)lost / (double)kept * found : HUGE_VAL;
    }
    free(sums);
    return st;
}
