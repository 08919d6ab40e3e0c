/* Derivatives to the two sides where the integral has none. onesided.c. */
#ifndef SALTUS_SAMPLE_ONESIDED_H
#define SALTUS_SAMPLE_ONESIDED_H

#include "runtime/sample/estimate.h"

/* After an integral by `by`: where its parameters may be those of a kink, its derivatives become the middle of those
 * beside, and their errors reach both. Adds to the counts; a kink that nobody has counted is, where it was looked for.
 */
SltStatus onesided_add(const SltScene *s, const SltJob *j, SltEstimator by, SltIntegral *out, SltStats *stats,
                       SltError *err);

#endif
