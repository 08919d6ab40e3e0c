/* Depths of rays: do two points with equal hashes lie on two sides of a silhouette after all?
 *
 * The depth of a point is about log2 of the distances at which its rays hit (SLT_OUT_DEPTH), and differences and
 * thresholds have that unit. Two neighbours whose depths differ by more than a threshold are worth a search. */
#ifndef SALTUS_SAMPLE_DEPTH_H
#define SALTUS_SAMPLE_DEPTH_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

/* How differences between neighbours with equal hashes are spread: a histogram by magnitude. */
enum { SPREAD_BUCKETS = 160 };
typedef struct Spread {
    uint64_t n;                     /* differences counted */
    uint64_t edges;                 /* edges of the lines that spread_line was given */
    uint32_t count[SPREAD_BUCKETS]; /* differences */
    uint32_t odd[SPREAD_BUCKETS];   /* of them those of edges that stand out beside the edges next to them */
} Spread;
void spread_clear(Spread *s);
void spread_add(Spread *s, double difference);
/* Adds the edges of a line of n vertices, hash and depth of vertex v at [v * stride]. */
void spread_line(Spread *s, const uint32_t *hash, const double *depth, uint64_t stride, uint32_t n);
/* The threshold that is usual for these neighbours. */
double spread_threshold(const Spread *s);
/* In an image thresholds are this many times larger: the boundary term of a terrain costs what edges asked in vain
 * cost, and what is lost are jumps of a few ordinary steps. */
#define DEPTH_COARSE 3.0
/* The threshold of edge e of a line of n vertices, given that of its tile: higher where the edges beside it are steep.
 */
double depth_threshold(const uint32_t *hash, const double *depth, uint64_t stride, uint32_t e, uint32_t n,
                       double threshold);
/* Are depths a and b further apart than the threshold? An infinite depth (a ray that starts in the ground) is no jump.
 */
static inline bool depth_differs(double a, double b, double threshold) {
    double d = a < b ? b - a : a - b;
    return d > threshold && d < HUGE_VAL;
}

#endif
