/* The error of a weighted image's derivatives from what tiles err by, where tiles err independently: a few dozen of
 * them tell it better than four sums of all. Each tile gives the spread of its interleaved parts (COSETS), where
 * rand() is called; of a loss the differences between its two halves, of samples and of the adjoints that the other
 * half gives; and the square of what the adjoints' own noise weighs. One per call, used in `merge` alone. */
#ifndef SALTUS_SAMPLE_PARTS_H
#define SALTUS_SAMPLE_PARTS_H

#include "runtime/sample/accum.h"

typedef struct Parts {
    const SltScene *s;
    uint32_t nfloats;
    bool whole;                /* all tiles are one, since parameters are many or pulled: parts_settle is due */
    double *sum;               /* [PARTS_SUMS][nfloats]: of one tile, 0 between tiles */
    double *variance, *square; /* [nfloats]: over tiles, of the variance and its square by its degrees of freedom */
} Parts;
enum { PARTS_NOISE = 8, PARTS_SUMS = COSETS + PARTS_NOISE };
/* Which buffers of an Accum are parts of one whole. Of pairs each two are estimates of one sum. */
typedef struct PartsOf {
    uint32_t spread; /* the first so many buffers, or */
    uint32_t pairs;  /* the first two times so many */
    uint32_t
        noise; /* the first of PARTS_NOISE buffers, each of what errs by itself and is no part of the answer; or 0 */
} PartsOf;
/* False when memory runs out. */
bool parts_init(Parts *p, const SltScene *s, bool whole);
void parts_free(Parts *p);
/* Instead of accum_merge. */
void parts_merge(Parts *p, Accum *a, const PartsOf *of, double *const *targets);
/* After all tiles, where `whole`; pulls derived arrays. False when memory runs out. */
bool parts_settle(Parts *p, const PartsOf *of, double *const *targets);
/* The square of the bar. */
double parts_variance(const Parts *p, uint32_t parameter);

#endif
