/* Random sums of second differences of lines: sketch.h. */
#include <math.h>

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

double sketch_variance(const double sketch[SKETCHES]) {
    double sum = 0;
    for (uint32_t i = 0; i < SKETCHES; i++) sum += sketch[i] * sketch[i];
    return sum / 24; /* a jump counts twice, and errs by its twelfth */
}
