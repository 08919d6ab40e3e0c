/* How hard a sweep tries, and how hard the next one should. */
#ifndef SALTUS_QUADRATURE_EFFORT_H
#define SALTUS_QUADRATURE_EFFORT_H

#include "runtime/quadrature/inner.h"

typedef struct Effort {
    bool wanted, given;        /* an error was asked for; a number of evaluations was */
    double relative, absolute; /* what was asked for; 0: not */
    bool fixed, f64, marches;  /* marches: as in Sweep */
    uint32_t gauss, parts;     /* points of the fine rule; by how much tiles are smaller than at first */
    uint32_t few;              /* as in CellOptions */
    double tolerance, least;   /* as in CellOptions */
    double left_share, deeper; /* as in Sweep */
    uint64_t limit, stage;     /* evaluations in all, and of the next sweep */
    uint32_t sweeps, stalls;
    double best, last, fell; /* errors: the least so far, that of the last sweep, and in parts of the one before */
    double left, work;       /* of the last sweep: the error of what is left, and what its cells cost */
} Effort;
/* lattice: evaluations that it would spend. */
void effort_begin(Effort *e, const Run *r, double lattice, Outlook outlook);
/* Of a sweep that follows curves: cells as many across as the square root of the segments; what they leave costs most.
 */
void effort_marches(Effort *e, const Sweep *p);
/* The sweep's options and budget; `used`: evaluations so far. */
void effort_apply(const Effort *e, Sweep *p, uint64_t used);
/* After a sweep whose largest error is rules + left, of numbers whose largest is `scale`. Is it the best so far? */
bool effort_took(Effort *e, double rules, double left);
/* Is another sweep worth while? If not, `stop` says what ended it. cost: evaluations of the last sweep. */
bool effort_more(Effort *e, const Sweep *p, double rules, double left, double scale, uint64_t used, uint64_t cost,
                 SltStop *stop);

#endif
