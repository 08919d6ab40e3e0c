/* What benchmarks of rays share. */
#include "rays.h"

#include <stdlib.h>
#include <time.h>

double bench_now(void) {
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

uint32_t bench_random(uint64_t *state) { /* PCG32 */
    uint64_t s = *state;
    *state = s * 6364136223846793005ull + 1442695040888963407ull;
    uint32_t x = (uint32_t)(((s >> 18) ^ s) >> 27), rot = (uint32_t)(s >> 59);
    return x >> rot | x << (-rot & 31);
}

void rays_pixel(uint32_t k, uint32_t size, uint32_t *x, uint32_t *y) {
    uint32_t tile = k / 64, sub = k / 16 % 4, in = k % 16;
    *x = tile % (size / 8) * 8 + sub % 2 * 4 + in % 4, *y = tile / (size / 8) * 8 + sub / 2 * 4 + in / 4;
}

void rays_free(Rays *r) {
    free(r->ray);
    *r = (Rays){0};
}

float *rays_blocks(const Rays *r, uint32_t width) {
    float *b = aligned_alloc(64, sizeof(float) * 8 * r->count);
    for (uint32_t k = 0; k < r->count; k++) {
        float *at = b + (size_t)(k / width) * 8 * width + k % width;
        const Ray *s = &r->ray[k];
        float row[8] = {s->o[0], s->o[1], s->o[2], s->d[0], s->d[1], s->d[2], s->t0, s->t1};
        for (int c = 0; c < 8; c++) at[(size_t)c * width] = row[c];
    }
    return b;
}
