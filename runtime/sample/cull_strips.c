/* Boxes of [Cull] iterations by strips: cull_strips.h. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/cull_strips.h"

/* Grows with x; outside of the domain that of the border. NaN: 0 */
static uint32_t strip_of(const CullStrips *s, int d, double x) {
    const double at = (x - s->lo[d]) * s->by[d];
    return at >= CULL_STRIPS - 1 ? CULL_STRIPS - 1 : at > 0 ? (uint32_t)at : 0;
}

bool cull_strips_make(CullStrips *s, const CullGrid *g) {
    *s = (CullStrips){0};
    if (!g->n || g->n > CULL_STRIPS_MOST) return true;
    const uint32_t words = (g->n + 63) / 64;
    const size_t set = (size_t)CULL_STRIPS * words;
    uint64_t *sets = alloc_zero(4 * set, sizeof *sets);
    if (!sets) return false;
    s->words = words;
    for (int d = 0; d < 2; d++) {
        s->lo[d] = g->lo[d], s->by[d] = CULL_STRIPS / g->side[d];
        s->from[d] = sets + 2 * (size_t)d * set, s->to[d] = s->from[d] + set;
    }
    for (uint32_t k = 0; k < g->n; k++) {
        const CullBox *b = &g->box[k];
        const uint32_t i = (uint32_t)g->number[k];
        for (int d = 0; d < 2; d++) {
            const uint32_t first = strip_of(s, d, b->lo[d]),
                           last = isnan(b->hi[d]) ? CULL_STRIPS - 1 : strip_of(s, d, b->hi[d]);
            s->from[d][first * words + i / 64] |= (uint64_t)1 << i % 64;
            s->to[d][last * words + i / 64] |= (uint64_t)1 << i % 64;
        }
    }
    for (int d = 0; d < 2; d++)
        for (size_t w = words; w < set; w++) {
            s->from[d][w] |= s->from[d][w - words];
            s->to[d][set - 1 - w] |= s->to[d][set - 1 - w + words];
        }
    return true;
}

void cull_strips_free(CullStrips *s) {
    free(s->from[0]);
    *s = (CullStrips){0};
}

int32_t cull_strips_find(const CullStrips *s, const double lo[2], const double hi[2], int32_t *items) {
    const uint64_t *set[4];
    int32_t n = 0;
    for (int d = 0; d < 2; d++) {
        set[2 * d] = s->from[d] + (size_t)strip_of(s, d, hi[d]) * s->words;
        set[2 * d + 1] = s->to[d] + (size_t)strip_of(s, d, lo[d]) * s->words;
    }
    for (uint32_t w = 0; w < s->words; w++)
        for (uint64_t left = set[0][w] & set[1][w] & set[2][w] & set[3][w]; left; left &= left - 1)
            items[n++] = (int32_t)(64 * w + (uint32_t)__builtin_ctzll(left));
    return n;
}
