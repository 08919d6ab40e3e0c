/* Heavy tails of the interior term.
 *
 * Beside a place where f is a small power of the distance, its derivative is 1 / distance to the power of nearly 1:
 * integrable, but its square is not. Sums of samples then hang on the few that lie nearest, what lies nearer still is a
 * part of the integral that no sample has, and replicates, which all lack it, agree. The largest sums of small groups
 * of samples tell by which power they grow, and so what the rest may be. A Tails belongs to one estimate. */
#ifndef SALTUS_SAMPLE_TAILS_H
#define SALTUS_SAMPLE_TAILS_H

#include "runtime/sample/accum.h"

enum { TAIL_CALL = 128 }; /* samples of a call, whose lanes hold a group each */
/* Of a component: the sums of the first groups; then distances from their median, and the largest. */
typedef struct TailSums {
    bool known;
    uint32_t n;
    double middle, least, beyond;
} TailSums;
typedef struct Tails {
    uint32_t channels, components, width;
    uint32_t *parameter; /* [components]: those that move something */
    uint64_t seen;       /* groups */
    TailSums *of;        /* [channels][components] */
    double *sum;
} Tails;
/* Of a tile, in its worker. */
typedef struct TailTile {
    uint32_t n, cap;
    double *before; /* [channels][components][width] */
    float *sum;     /* [cap][channels][components] */
} TailTile;
/* False: memory ran out. Nothing is looked at where parameters are many. */
bool tails_init(Tails *t, const SltScene *s);
void tails_free(Tails *t);
void tails_free_tile(TailTile *tile);
bool tails_wanted(const Tails *t);
/* In `work`: a tile of at most so many calls begins; after each call for TAIL_CALL samples; in `merge`. */
bool tails_begin(const Tails *t, TailTile *tile, uint32_t calls);
void tails_take(const Tails *t, TailTile *tile, const Accum *a);
void tails_merge(Tails *t, TailTile *tile);
/* What samples do not tell of a derivative that is the mean of replicates, with `samples` in all: joins
 * error[channels][nfloats]. Returns the largest, as a part of the largest of gradient[channels][nfloats]. */
double tails_add(Tails *t, double samples, uint32_t replicates, uint32_t nfloats, const double *gradient,
                 double *error);

#endif
