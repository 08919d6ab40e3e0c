/* Which instruction set fills samples, and what needs none: streams. */
#include <string.h>

#include "runtime/base/cpu.h"
#include "runtime/sample/fill.h"

uint32_t fill_all(const Fill *all[3]) {
    uint32_t n = 0;
    all[n++] = &fill_plain;
#if defined(__x86_64__)
    if (cpu_has_avx2()) all[n++] = &fill_avx2;
    if (cpu_has_avx512()) all[n++] = &fill_avx512;
#endif
    return n;
}

const Fill *fill_best(void) {
    const Fill *all[3];
    return all[fill_all(all) - 1];
}

enum { BLOCKS = 128 };

/* Blocks that are still to be drawn, and what of them goes where. */
typedef struct Drawing {
    uint32_t n, lane[BLOCKS + FILL_OVER];
    uint64_t counter[BLOCKS + FILL_OVER], words[2][BLOCKS + FILL_OVER];
    uint8_t first[BLOCKS], count[BLOCKS]; /* words */
} Drawing;

static int32_t *draw(const Fill *f, const FillStreams *s, Drawing *d, int32_t *to) {
    uint64_t *const words[2] = {d->words[0], d->words[1]};
    f->blocks(s->seed ^ (uint32_t)s->purpose * 0x85ebca6bu, RNG_STREAM, d->n, d->lane, d->counter, words);
    for (uint32_t i = 0; i < d->n; i++) {
        const uint64_t low = d->words[0][i], high = d->words[1][i];
        const int32_t v[4] = {(int32_t)low, (int32_t)(low >> 32), (int32_t)high, (int32_t)(high >> 32)};
        if (d->count[i] == 4) memcpy(to, v, sizeof v);
        else
            for (uint32_t k = 0; k < d->count[i]; k++) to[k] = v[d->first[i] + k];
        to += d->count[i];
    }
    d->n = 0;
    return to;
}

/* Of runs of one sample each. */
static void draw_single(const Fill *f, const FillStreams *s, uint32_t runs, const uint64_t *owner,
                        const uint64_t *first, int32_t *to) {
    Drawing d; /* long, and set as it is used */
    uint64_t *const words[2] = {d.words[0], d.words[1]};
    for (uint32_t from = 0; from < runs; from += BLOCKS) {
        const uint32_t n = runs - from < BLOCKS ? runs - from : BLOCKS;
        for (uint32_t i = 0; i < n; i++)
            d.lane[i] = s->lane ^ (uint32_t)(first[from + i] >> 2) * 0x9e3779b9u,
            d.counter[i] = owner[from + i] << 24 ^ first[from + i] >> 2;
        f->blocks(s->seed ^ (uint32_t)s->purpose * 0x85ebca6bu, RNG_STREAM, n, d.lane, d.counter, words);
        for (uint32_t i = 0; i < n; i++) {
            const uint64_t two = first[from + i] & 2 ? d.words[1][i] : d.words[0][i];
            to[from + i] = (int32_t)(first[from + i] & 1 ? two >> 32 : two);
        }
    }
}

void fill_streams(const Fill *f, const FillStreams *s, uint32_t runs, const uint32_t *count, const uint64_t *owner,
                  const uint64_t *first, int32_t *to) {
    if (!count) {
        draw_single(f, s, runs, owner, first, to);
        return;
    }
    Drawing d; /* long, and set as it is used */
    d.n = 0;
    for (uint32_t r = 0; r < runs; r++) {
        uint64_t at = first[r];
        for (uint32_t left = count[r]; left;) {
            uint32_t word = (uint32_t)(at & 3), here = s->stride > 1 ? 1 : left < 4 - word ? left : 4 - word;
            d.lane[d.n] = s->lane ^ (uint32_t)(at >> 2) * 0x9e3779b9u, d.counter[d.n] = owner[r] << 24 ^ at >> 2;
            d.first[d.n] = (uint8_t)word, d.count[d.n] = (uint8_t)here;
            left -= here, at += s->stride > 1 ? s->stride : here;
            if (++d.n == BLOCKS) to = draw(f, s, &d, to);
        }
    }
    draw(f, s, &d, to);
}
