/* Crossings on which another boundary lies. The scenes with moved parameters are the run's, the crossings in question a
 * sink's. */
#ifndef SALTUS_SAMPLE_COINCIDE_H
#define SALTUS_SAMPLE_COINCIDE_H

#include "runtime/sample/difference.h"
#include "runtime/sample/finder.h"

enum { COINCIDE_MAX = 8, COINCIDE_WAYS = 4 };
typedef struct Coincide {
    const Moved *apart;                                    /* [COINCIDE_WAYS], or NULL: nothing is looked for */
    uint32_t n, which[COINCIDE_MAX], stands[COINCIDE_MAX]; /* crossings to ask, and how many each stands for */
    double way[COINCIDE_MAX][COINCIDE_WAYS];
} Coincide;
typedef struct Run Run;
typedef struct Sink Sink;

/* Before the first crossing, and when all is done. Crossings order[from..to) of `all`, of one site and with their
 * gradients; then the count, when all groups have been given. */
bool coincide_begin(Run *r, double bracket); /* of roots, in parts of the domain */
void coincide_end(Run *r);
void coincide_group(Sink *k, const Crossing *c, const uint64_t *order, const bool *keep, uint32_t from, uint32_t to,
                    uint32_t all);
void coincide_count(Sink *k, const Crossing *c);

#endif
