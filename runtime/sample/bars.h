/* From replicates to means and the bars beside them: two bars hold 95.4 % of the answers, as of a normal deviate. Plain
 * arithmetic on arrays of the caller. */
#ifndef SALTUS_SAMPLE_BARS_H
#define SALTUS_SAMPLE_BARS_H

#include <stdint.h>

typedef struct Replicates {
    uint32_t n;
    uint64_t size;                        /* channels * nfloats */
    double *value;                        /* [n][channels] */
    double *interior, *boundary, *missed; /* [n][size] */
    double *half;                         /* [size]: the sum over all, of what boundaries that coincide leave open */
    double *sketch;                       /* [SKETCHES][size]: of the sum over all replicates; NULL: none */
} Replicates;
/* By how much the standard error of the mean of n is too small a bar: Student's t with n - 1 degrees of freedom. */
double bars_factor(uint32_t n);
/* Of n independent rows of `size` numbers, to which `other` is added when not NULL: the mean into `mean`, its bar into
 * `error`; either may be NULL. */
void bars_of_rows(const double *rows, const double *other, uint32_t n, uint64_t size, double *mean, double *error);
/* Parts of the spread of replicates that belong to the error of their lines, measured: tests/bench/coverage.py. */
/* Samples, or lines, of a replicate below which all may have missed what there is: the spread says nothing. */
enum { BARS_FEWEST = 4 };
#define BARS_PLANE 0.3
#define BARS_SPACE 0.05
/* Add the error of the boundary term (sketches are due), and what is missed of it, to bars of the interior; mean: of
 * what is missed, where it is wanted. */
void bars_add_boundary(const Replicates *k, double part, double *error);
void bars_add_missed(const Replicates *k, double *mean, double *error);
/* Weights of crossings that are denormals in single precision are off by half a step of those each, all alike: of the
 * derivatives [nfloats] of one channel, with so many crossings a replicate, each of about so much for a speed of 1. */
void bars_add_denormals(const double *gradient, uint32_t nfloats, double crossings, double weight, double *error);

/* Where random numbers decide: each of so many crossings, of all replicates, is met or not, and replicates that have
 * met equally many agree by chance. Half a crossing a replicate is the least of their error, for boundary terms [size].
 */
void bars_add_counts(const double *boundary, uint64_t size, double crossings, uint32_t replicates, double *error);

#endif
