/* Scenes whose rays have depths: when two points with equal hashes lie on two sides of a silhouette after all. */
#ifndef SALTUS_SAMPLE_DEPTH_H
#define SALTUS_SAMPLE_DEPTH_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

enum { SPREAD_BUCKETS = 160 };
typedef struct Spread {
    uint64_t n, edges; /* edges: of lines */
    uint32_t count[SPREAD_BUCKETS];
    uint32_t odd[SPREAD_BUCKETS]; /* of lines: those that stand out beside their neighbours */
} Spread;
void spread_clear(Spread *s);
void spread_add(Spread *s, double difference);
/* The edges of a line of n vertices. */
void spread_line(Spread *s, const uint32_t *hash, const double *depth, uint64_t stride, uint32_t n);
/* Thresholds are differences of depth (about log2 of the distance along the ray) beyond which two neighbours are worth
 * a search. In an image they are this many times larger: edges asked in vain are what the boundary term of a terrain
 * costs, and what is lost are jumps of a few ordinary steps. */
#define DEPTH_COARSE 3.0
/* What is usual for these neighbours. */
double spread_threshold(const Spread *s);
/* That of edge e of a line of n vertices, from that of its tile and from the edges beside it. */
double depth_threshold(const uint32_t *hash, const double *depth, uint64_t stride, uint32_t e, uint32_t n,
                       double threshold);
/* An infinite depth (a ray that starts in the ground) is no jump. */
static inline bool depth_differs(double a, double b, double threshold) {
    double d = a < b ? b - a : a - b;
    return d > threshold && d < HUGE_VAL;
}

#endif
