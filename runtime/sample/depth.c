/* Telling apart vertices that hit the same terrain at different depths.
 *
 * Where a near ridge stands before far ground both rays hit, so no hash can differ: silhouettes end in cusps, and the
 * image minus its silhouettes is connected around them. What differs is the depth. The region kernel gives a signature
 * of it, continuous between silhouettes; two neighbours are candidates if their signatures are further apart than
 * smooth ground puts neighbours here. That is only a gate: a small threshold costs evaluations, a large one loses the
 * small jumps. `event` decides. */
#include <math.h>
#include <string.h>

#include "runtime/sample/depth.h"

enum {
    OCTAVE_STEPS = 4, /* buckets an octave: the median is good to a fifth, and needs no memory and no sorting */
    LOWEST = -24,     /* differences below 2^-24 are rounding, and have no bucket */
    FEW = 16,         /* fewer differences say nothing of what is usual here */
    ASKED = 8         /* one edge in so many may be asked in vain */
};
#define TIMES_MEDIAN 1.0
#define TIMES_NEIGHBOUR 1.5
#define FLOOR 0x1p-14 /* the least threshold: rounding of log2 t in single precision, with room for a sum of a few */

void spread_clear(Spread *s) { memset(s, 0, sizeof *s); }

/* The bucket of a difference; -1: none, for both rays went to the sky or the difference is rounding. */
static int bucket_of(double difference) {
    double a = fabs(difference);
    if (!(a >= ldexp(1, LOWEST)) || isinf(a)) return -1;
    int e;
    double m = frexp(a, &e); /* a = m 2^e, m in [1/2, 1) */
    int bucket = (e - 1 - LOWEST) * OCTAVE_STEPS + (int)((2 * m - 1) * OCTAVE_STEPS);
    return bucket < SPREAD_BUCKETS ? bucket : SPREAD_BUCKETS - 1;
}

/* The difference at `part` (0 to 1) of a bucket's width. */
static double bucket_value(int bucket, double part) {
    return ldexp(1 + (bucket % OCTAVE_STEPS + part) / OCTAVE_STEPS, bucket / OCTAVE_STEPS + LOWEST);
}

void spread_add(Spread *s, double difference) {
    int bucket = bucket_of(difference);
    if (bucket < 0) return;
    s->count[bucket]++;
    s->n++;
}

double spread_threshold(const Spread *s) {
    if (s->n < FEW) return FLOOR;
    uint64_t below = 0;
    int bucket = 0;
    for (; bucket < SPREAD_BUCKETS - 1; bucket++) {
        below += s->count[bucket];
        if (2 * below >= s->n) break;
    }
    double threshold = TIMES_MEDIAN * bucket_value(bucket, 0.5);
    /* Where the view grazes, the median hides most jumps. Where cells are large beside the spacing, few edges stand out
     * beside their neighbours, and a smaller threshold costs little. */
    if (s->edges) {
        uint64_t asked = 0;
        int least = SPREAD_BUCKETS;
        while (least > 0 && ASKED * (asked + s->odd[least - 1]) <= s->edges) asked += s->odd[--least];
        if (least < SPREAD_BUCKETS) threshold = fmin(threshold, bucket_value(least, 0));
    }
    return fmax(FLOOR, threshold);
}

/* The depth of ground seen at a grazing angle changes fast from vertex to vertex, but on both sides of an edge: there
 * the threshold is a multiple of the smaller step beside the edge. Jumps of about one size in three edges in a row are
 * taken for a slope; a finer lattice tells them apart. */
double depth_threshold(const uint32_t *hash, const double *depth, uint64_t stride, uint32_t e, uint32_t n,
                       double threshold) {
    if (e == 0 || e + 2 >= n) return threshold;
    const uint32_t *h = hash + (e - 1) * stride;
    const double *d = depth + (e - 1) * stride;
    if (h[0] != h[stride] || h[2 * stride] != h[3 * stride]) return threshold;
    double before = fabs(d[0] - d[stride]), after = fabs(d[2 * stride] - d[3 * stride]);
    double beside = TIMES_NEIGHBOUR * fmin(before, after);
    return beside > threshold && !isinf(beside) ? beside : threshold;
}

void spread_line(Spread *s, const uint32_t *hash, const double *depth, uint64_t stride, uint32_t n) {
    s->edges += n - 1;
    for (uint32_t v = 0; v + 1 < n; v++) {
        if (hash[v * stride] != hash[(v + 1) * stride]) continue;
        double difference = depth[v * stride] - depth[(v + 1) * stride];
        int bucket = bucket_of(difference);
        if (bucket < 0) continue;
        spread_add(s, difference);
        if (fabs(difference) > depth_threshold(hash, depth, stride, v, n, 0)) s->odd[bucket]++;
    }
}
