/* Random sums of second differences of lines: sketch.h. */
#include <math.h>
#include <stdbool.h>

#include "runtime/base/rng.h"
#include "runtime/sample/sketch.h"

static uint32_t mix(uint32_t h) {
    h = (h ^ h >> 16) * 0x7feb352du;
    h = (h ^ h >> 15) * 0x846ca68bu;
    return h ^ h >> 16;
}

void sketch_weights(const Sketch *k, const double x[3], int axis, double weight[SKETCHES]) {
    static const double difference[3] = {1, -2, 1};
    uint32_t across = 1 - (uint32_t)axis, n = k->lines[across], key = k->seed * 0x85ebca6bu + across * 0x9e3779b9u;
    double at = round((x[across] - k->lo[across]) / k->step[across] - k->phase[across]);
    uint32_t line = at > 0 ? (uint32_t)fmin(at, n - 1.0) : 0;
    for (uint32_t i = 0; i < SKETCHES; i++) weight[i] = 0;
    for (uint32_t i = 0; i < 3; i++) {
        uint32_t middle = (uint32_t)(((uint64_t)line + n + i - 1) % n), own = mix(key ^ middle * 2);
        /* Neighbours go to different sketches, by an order that changes from block to block, and no two weigh alike:
         * else the two ends of one edge would cancel whenever their distance fits. The mean square is 1. */
        double size = sqrt(0.25 + 1.5 * rng_unit(own));
        weight[(middle + mix(key ^ (middle / SKETCHES * 2 + 1))) % SKETCHES] +=
            difference[i] * (own & 1 ? size : -size);
    }
}

/* Multiples of the two numbers of the R2 sequence come nearest to integers, both at once, at this recurrence's: no two
 * points that are so many apart are farther from each other than 0.8 / sqrt(F). */
Sketch sketch_spread(uint32_t lines, uint32_t seed) {
    Sketch k = {.seed = seed, .lines = {lines, lines}};
    uint64_t f[5] = {1, 2, 3, 4, 5};
    while (f[4] <= lines / 8) {
        uint64_t next = f[2] + f[3];
        for (int i = 0; i < 4; i++) f[i] = f[i + 1];
        f[4] = next;
    }
    for (int i = 0; i < SKETCH_WAYS; i++) k.apart[i] = f[2 + i];
    return k;
}

/* Each way from line to line sees the edges across it; a line goes one of them by chance. Lines beside an edge do not
 * err by chance but make up for each other along it: the variance of their sum is about a twenty-fourth of the mean
 * square of these differences. */
void sketch_weights_spread(const Sketch *k, uint32_t line, int axis, double weight[SKETCHES]) {
    uint32_t key = k->seed * 0x85ebca6bu + (uint32_t)axis * 0x9e3779b9u;
    for (uint32_t i = 0; i < SKETCHES; i++) weight[i] = 0;
    for (uint32_t way = 0; way < SKETCH_WAYS; way++) {
        uint64_t apart = k->apart[way], lines = k->lines[0];
        if (apart >= lines) continue;
        double size = sqrt((double)lines / (double)(lines - apart));
        for (int end = 0; end < 2; end++) {
            if (end ? line < apart : line + apart >= lines) continue;
            uint32_t own = mix(key ^ mix((uint32_t)(end ? line - apart : line)));
            if (own / 64 % SKETCH_WAYS != way) continue;
            weight[own / 2 % SKETCHES] += (end ? -1 : 1) * (own & 1 ? size : -size);
        }
    }
}

void sketch_variances(const double *sketch, uint64_t stride, uint32_t replicates, uint32_t n, double *variance) {
    const bool power_of_two = !(replicates & (replicates - 1));
    const double part = 1.0 / replicates;
    for (uint32_t i = 0; i < n; i++) variance[i] = 0;
    for (uint32_t q = 0; q < SKETCHES; q++) {
        const double *of = sketch + q * stride;
        if (power_of_two) /* the same, in less time */
            for (uint32_t i = 0; i < n; i++) variance[i] += of[i] * part * (of[i] * part);
        else
            for (uint32_t i = 0; i < n; i++) variance[i] += of[i] / replicates * (of[i] / replicates);
    }
    for (uint32_t i = 0; i < n; i++) variance[i] /= 24; /* a jump counts twice, and errs by its twelfth */
}
