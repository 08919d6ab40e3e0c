/* The error of lines that are evenly spaced, from the lines themselves. The lattices of all replicates together are one
 * family of lines an axis, and their mean is in error by what their sums do between lines: a family with a random
 * shift errs, where a sum jumps by a, by a / sqrt(12) spacings, and less where it only bends. The second differences of
 * neighbouring lines' sums see both: twice a squared for a jump.
 *
 * Sums by line are too many to keep where there are many parameters. SKETCHES random sums of all second differences are
 * kept instead, each with a random sign and each in one of them: the mean of their squares is the same, and a
 * crossing needs only its own line to know how often it counts in each. Differences go round: the shift is one of a
 * period, and what differs between the two ends of the domain is in error like a jump.
 *
 * In a volume lines go through points of one sequence (scanline.c). Of these, too, neighbours differ where an edge
 * passes between them, and each line near an edge is inside or outside of it by chance. Which are neighbours the
 * sequence says: those a few fixed numbers apart. */
#ifndef SALTUS_SAMPLE_SKETCH_H
#define SALTUS_SAMPLE_SKETCH_H

#include <stdint.h>

enum { SKETCHES = 6, SKETCH_WAYS = 3 /* from a line to its neighbours in a volume */ };

typedef struct Sketch {
    double lo[2], step[2], phase[2]; /* by the axis across which lines lie: line i is at lo + (i + phase) * step */
    uint32_t lines[2], seed;         /* lines[0] 0: no sketches */
    uint64_t apart[SKETCH_WAYS];     /* of a volume: how far neighbours are apart among lines[0] lines; else 0 */
} Sketch;
/* How often what is found at x, on a line along `axis`, counts in each sketch. */
void sketch_weights(const Sketch *k, const double x[3], int axis, double weight[SKETCHES]);
/* The same of line number `line` of a volume. */
void sketch_weights_spread(const Sketch *k, uint32_t line, int axis, double weight[SKETCHES]);
/* For lines through so many points of the R2 sequence. */
Sketch sketch_spread(uint32_t lines, uint32_t seed);
/* The variances of n components of the sum over all lines, from the sketches of that sum, sketch[q * stride +
 * component], which are those of all replicates together. */
void sketch_variances(const double *sketch, uint64_t stride, uint32_t replicates, uint32_t n, double *variance);

#endif
