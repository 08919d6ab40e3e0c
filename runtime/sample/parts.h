/* The error of a weighted image's derivatives where tiles err independently, as they do where rand() is called: the
 * spread of the interleaved parts (COSETS) of each tile, added up tile by tile. A few dozen of them tell it better than
 * four sums of all. One per call, used in `merge` alone. */
#ifndef SALTUS_SAMPLE_PARTS_H
#define SALTUS_SAMPLE_PARTS_H

#include "runtime/sample/accum.h"

typedef struct Parts {
    uint32_t n, nfloats;
    double *sum;               /* [n][nfloats]: of one tile, 0 between tiles */
    double *variance, *square; /* [nfloats]: the sum over tiles of the variance of each, and of its square */
} Parts;
/* False when memory runs out. */
bool parts_init(Parts *p, uint32_t n, uint32_t nfloats);
void parts_free(Parts *p);
/* Instead of accum_merge. The first n of the targets are those of the parts. */
void parts_merge(Parts *p, Accum *a, double *const *targets);
/* The square of the bar. */
double parts_variance(const Parts *p, uint32_t parameter);

#endif
