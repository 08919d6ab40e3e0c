/* Where f changes faster than its own slope says, and no decision does: jumps made by arithmetic, as d / abs(d), and
 * ramps narrower than the samples, as tanh(1e6 * d). Nothing integrates the first, and samples, or Gauss points, that
 * lie beside the second see a derivative of 0 on both sides of it.
 *
 * After an estimate f is looked at on a few lines through the domain, at about one point for every fifty that the
 * estimate took. Where neighbours of one region differ by more than their neighbours do, the change is halved; one that
 * stays together in a 256th of the segment, and moves with the parameters, is kept. What a ramp adds to the derivative
 * is then known from its own slope, and compared with what the estimate found: one that it has seen is forgotten. */
#ifndef SALTUS_SAMPLE_STEEP_H
#define SALTUS_SAMPLE_STEEP_H

#include "runtime/sample/estimate.h"

enum { STEEP_PLACES = 8 };
typedef struct SteepPlace {
    double a[3], b[3]; /* two points of one line between which f changes */
    double rand[2];    /* the random number `number` there */
    uint32_t number;
    double change;  /* by so much, in its channel; not finite: by more than any number */
    int32_t stream; /* of random numbers at both */
    bool jump;      /* a and b are neighbours, nearly: no slope is to be seen */
    bool peak;      /* f is larger, or smaller, by that at a than on all lines; b: beside it */
} SteepPlace;
typedef struct Steep {
    uint32_t n; /* the first of them, the steepest; 0: there is nothing of the kind */
    SteepPlace place[STEEP_PLACES];
    double share; /* of the lines' segments, those that hold one */
    /* The caller's: is this change known of otherwise? It is then no matter of ours. NULL: none is. */
    bool (*known)(void *user, const SteepPlace *place);
    /* As SltScene.call, with the Steep for user: f, and the hash of its regions, where SLT_IN_RAND0 holds the random
     * number `number`. NULL: only number 0 is varied. */
    void (*call)(void *user, int kind, SltKernelArgs *args, uint32_t n);
    uint32_t numbers; /* a bit for each that is worth it */
    uint32_t number;
    void *user;
} Steep;

/* Does nothing for what f cannot be asked about: rays that are no shadows, and programs whose f is one number between
 * its boundaries. `out` (NULL in image mode) is the estimate, whose stated errors grow by what it has not seen; `spent`
 * the evaluations that it took. Counts go to stats. */
SltStatus slt_estimate_steep(const SltScene *s, const SltJob *j, SltIntegral *out, uint64_t spent, Steep *steep,
                             SltStats *stats, SltError *err);

#endif
