/* What untie.c and untie_away.c share. */
#ifndef SALTUS_SAMPLE_UNTIE_INNER_H
#define SALTUS_SAMPLE_UNTIE_INNER_H

#include <math.h>

#include "runtime/sample/untie.h"

/* What a crossing consists of after one move. */
typedef struct Order {
    uint32_t n;
    bool whole; /* its parts make up the jump */
    Event event[UNTIE_EVENTS];
    double x[UNTIE_EVENTS][3], jump[UNTIE_EVENTS][SLT_MAX_CHANNELS];
    double moment[SLT_MAX_CHANNELS], far; /* sum of jumps times how far they have gone; the farthest of them */
} Order;

/* Of the crossing's g. */
static inline double untie_steepness(const Batch *b, const Crossing *c) {
    double square = 0;
    for (uint32_t d = 0; d < b->s->dim; d++) square += c->dg[d] * c->dg[d];
    return sqrt(square);
}

/* untie_away.c. Of the events of ties those whose g has no root as near as reach[] to the crossing become parts of
 * moves. The batch sees the parameters of its scene, before and after. */
void untie_away(Batch *b, const Apart *apart, const Crossing *c, const uint32_t *which, uint32_t n,
                Order (*order)[UNTIE_WAYS], const double *reach, Tie *tie);

#endif
