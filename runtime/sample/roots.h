/* Brackets of roots, many side by side: what Chandrupatla's method asks next, and what the answer makes of them.
 * Compiled for each instruction set with fill.h, the same bits from all. */
#ifndef SALTUS_SAMPLE_ROOTS_H
#define SALTUS_SAMPLE_ROOTS_H

#include <stdint.h>

/* Most brackets; behind those in use, up to a whole vector of others is read and written. The eight more keep the
 * arrays from sharing cache lines that take each other's place. */
enum { ROOTS = 512, ROOTS_ROOM = ROOTS + 8 };

/* By bracket; see Item in search.h. */
typedef struct Roots {
    double x1[ROOTS_ROOM], x2[ROOTS_ROOM], x3[ROOTS_ROOM], f1[ROOTS_ROOM], f2[ROOTS_ROOM], f3[ROOTS_ROOM];
    double tol[ROOTS_ROOM], next[ROOTS_ROOM];
    int64_t left[ROOTS_ROOM], exact[ROOTS_ROOM]; /* exact: 0 or -1 */
    int64_t go[ROOTS_ROOM];                      /* roots_step: 0: the bracket is small enough, or -1 */
} Roots;

#endif
