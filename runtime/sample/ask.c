/* Edges to be looked at. Plain loops over rows, without decisions: compilers write them in vectors. */
#include <math.h>
#include <string.h>

#include "runtime/sample/ask.h"

typedef struct Row {
    Worker *w;
    uint64_t first; /* vertex */
    uint32_t n;
    uint64_t s; /* stride of the axis */
} Row;

static void ends_differ(const Row *r, uint32_t axis, double threshold) {
    const Worker *w = r->w;
    const uint32_t n = r->n;
    uint8_t *restrict ask = w->ask + r->first;
    const uint32_t *a = w->hash + r->first, *b = a + r->s;
    for (uint32_t i = 0; i < n; i++) ask[i] = a[i] != b[i];
    if (w->face) {
        a = w->face + r->first, b = a + r->s;
        for (uint32_t i = 0; i < n; i++) ask[i] |= a[i] != b[i];
    }
    if (w->depth) {
        const double *c = w->depth + r->first, *d = c + r->s;
        for (uint32_t i = 0; i < n; i++) { /* depth_differs */
            const double by = fabs(c[i] - d[i]);
            ask[i] |= (uint8_t)((by > threshold) & (by < HUGE_VAL));
        }
    }
    if (w->finder.proves) {
        const uint8_t *settled = w->settled + r->first;
        for (uint32_t i = 0; i < n; i++) ask[i] |= !(settled[i] >> axis & 1);
    }
}

/* |g| of one event falls towards the edge from both sides. */
static void may_be_near(const Row *r) {
    const Worker *w = r->w;
    const uint32_t n = r->n;
    uint8_t *restrict ask = w->ask + r->first;
    const uint32_t *key = w->near_key + r->first, *next = key + r->s;
    const float *a = w->near_g + r->first - r->s, *b = a + r->s, *c = b + r->s, *d = c + r->s;
    for (uint32_t i = 0; i < n; i++)
        ask[i] |= (uint8_t)(((key[i] == next[i]) & (b[i] < a[i]) & (d[i] > c[i])) ? ASK_NEAR : 0);
}

/* Of a row of edges, the first of which has number e along the axis; step: 1, or 0 where all have it. Beside a border
 * slopes come from elsewhere, and vertices may lie on it. */
static void near_row(const Row *r, const AskTile *t, uint32_t axis, uint32_t e, uint32_t step) {
    enum { BESIDE = 2 };
    const uint32_t n = t->n[axis], inner = n > BESIDE ? n - 1 - BESIDE : 0; /* edges [1, inner] have both neighbours */
    uint8_t *ask = r->w->ask + r->first;
    if (step) {
        uint32_t from = e < 1 ? 1 - e : 0, to = e + r->n > inner + 1 ? inner + 1 > e ? inner + 1 - e : 0 : r->n;
        Row part = *r;
        part.first += from, part.n = to > from ? to - from : 0;
        may_be_near(&part);
        for (uint32_t i = 0; i < r->n; i++)
            if ((t->at_start[axis] && e + i < BESIDE) || (t->at_end[axis] && e + i + 1 + BESIDE >= n))
                ask[i] |= ASK_NEAR;
        return;
    }
    if (e >= 1 && e <= inner) may_be_near(r);
    if ((t->at_start[axis] && e < BESIDE) || (t->at_end[axis] && e + 1 + BESIDE >= n))
        for (uint32_t i = 0; i < r->n; i++) ask[i] |= ASK_NEAR;
}

void ask_edges(Worker *w, const AskTile *t, uint32_t axis, double threshold) {
    uint32_t from[3] = {0}, to[3] = {t->n[0], t->n[1], t->n[2]};
    from[axis] = t->from[axis], to[axis] = t->to[axis];
    memset(w->ask, 0, (uint64_t)t->n[0] * t->n[1] * t->n[2]);
    for (uint32_t z = from[2]; z < to[2]; z++)
        for (uint32_t y = from[1]; y < to[1]; y++) {
            const uint64_t line = y * t->stride[1] + z * t->stride[2]; /* of axis 0 */
            const Row row = {w, line + from[0], to[0] - from[0], t->stride[axis]};
            ends_differ(&row, axis, threshold);
            if (w->near_g) near_row(&row, t, axis, axis == 0 ? from[0] : axis == 1 ? y : z, axis == 0);
            const uint8_t *ask = w->ask + row.first;
            uint8_t any = 0;
            for (uint32_t i = 0; i < row.n; i++) any |= ask[i];
            if (!any) continue;
            if (axis == 0) {
                w->ask[line] |= (uint8_t)(any << 2);
            } else { /* vertices 0 of the lines of the other axes lie in a row, too */
                uint8_t *lines = w->ask + (axis == 1 ? z * t->stride[2] : y * t->stride[1]);
                for (uint32_t i = 0; i < row.n; i++) lines[i] |= (uint8_t)((ask[i] & (ASK_EDGE | ASK_NEAR)) << 2);
            }
        }
}
