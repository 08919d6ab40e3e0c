/* Crossings on which another boundary lies: coincide.c says how they are told. The run owns the scenes with moved
 * parameters, a sink the crossings in question. */
#ifndef SALTUS_SAMPLE_COINCIDE_H
#define SALTUS_SAMPLE_COINCIDE_H

#include "runtime/sample/difference.h"
#include "runtime/sample/finder.h"

enum {
    COINCIDE_MAX = 8, /* crossings asked, of one batch */
    COINCIDE_WAYS = 4 /* moves of the parameters: two directions, forth and back */
};
typedef struct Coincide {
    const Moved *apart; /* [COINCIDE_WAYS]: scenes with moved parameters; NULL: nothing is looked for */
    uint32_t n, which[COINCIDE_MAX], stands[COINCIDE_MAX]; /* crossings to ask, and how many each stands for */
    double way[COINCIDE_MAX][COINCIDE_WAYS]; /* how far each one's boundary goes with each move, along its segment */
} Coincide;
typedef struct Run Run;
typedef struct Sink Sink;

/* Before the first crossing: moves the parameters. bracket: how well roots are known, in parts of the domain. False
 * when memory runs out. */
bool coincide_begin(Run *r, double bracket);
void coincide_end(Run *r);
/* Chooses among crossings order[from..to) of a batch of `all`: they are of one site and have their gradients; those
 * with keep[] false are passed over. */
void coincide_group(Sink *k, const Crossing *c, const uint64_t *order, const bool *keep, uint32_t from, uint32_t to,
                    uint32_t all);
/* When all groups of a batch have been given: asks the chosen crossings, and counts SLT_DROP_COINCIDENT. */
void coincide_count(Sink *k, const Crossing *c);

#endif
