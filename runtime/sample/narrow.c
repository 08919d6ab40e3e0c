/* Lists of a tile, shortened: narrow.h. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/narrow.h"

enum {
    LEAST = 16, /* iterations of a tile: to ask about fewer takes as long as to run them */
    IDLE = 15,  /* tiles, after one that did not pay */
    BOX = 24    /* samples that an iteration on a box costs */
};

bool narrow_serves(const SltScene *s) {
    bool noted = false;
    if (s->dim != 2 || s->call || !s->kernel[SLT_K_BOUNDS] || !s->list_noted) return false;
    for (uint32_t i = 0; i < s->nlists; i++) noted |= s->list_noted[i] != 0;
    return noted;
}

bool narrow_init(Narrowed *k, const SltScene *s) {
    memset(k, 0, sizeof *k);
    if (!narrow_serves(s)) return true;
    k->whole = alloc_zero(s->nlists, sizeof *k->whole), k->of = alloc_zero(s->nlists, sizeof *k->of);
    k->note = alloc_zero(s->nlists, sizeof *k->note);
    return k->whole && k->of && k->note;
}

void narrow_free(Narrowed *k) {
    free(k->whole), free(k->of), free((void *)k->note), free(k->notes), free(k->keep), free(k->items), free(k->some);
    memset(k, 0, sizeof *k);
}

static bool room(Narrowed *k, uint64_t n) {
    if (n <= k->cap) return true;
    uint64_t cap = n + n / 2;
    free(k->notes), free(k->keep), free(k->items), free(k->some);
    k->notes = malloc(cap * sizeof *k->notes), k->keep = malloc(cap * sizeof *k->keep);
    k->items = malloc(cap * sizeof *k->items), k->some = malloc(cap * sizeof *k->some);
    bool memory = k->notes && k->keep && k->items && k->some;
    k->cap = memory ? cap : 0;
    return memory;
}

/* How many iterations of a list may be asked about; of one that `bounds` does not note, none. */
static uint32_t length(const Narrowed *k, const SltScene *s, uint32_t list) {
    if (!s->list_noted[list]) return 0;
    return k->current && k->current[list].count >= 0 ? (uint32_t)k->current[list].count : s->list_count[list];
}

static void ask(Narrowed *k, Batch *b, const NarrowParts *p) {
    /* Positions are rounded to the program's precision before a kernel sees them. */
    const double eps = 2 * (b->f64 ? DBL_EPSILON : (double)FLT_EPSILON);
    const double step = (p->x[1] - p->x[0]) / NARROW_COLUMNS;
    for (uint32_t i = 0; i < p->rows * NARROW_COLUMNS; i++) {
        const uint32_t column = i % NARROW_COLUMNS, row = i / NARROW_COLUMNS;
        const double lo[2] = {p->x[0] + column * step, p->y[row][0]},
                     hi[2] = {column + 1 < NARROW_COLUMNS ? lo[0] + step : p->x[1], p->y[row][1]};
        for (uint32_t d = 0; d < 2; d++) {
            const double slack = eps * fmax(fabs(lo[d]), fabs(hi[d]));
            batch_set(b, SLT_IN_X0 + d, i, lo[d] - slack), batch_set(b, SLT_IN_H0 + d, i, hi[d] + slack);
        }
    }
    b->args.note = k->note;
    batch_call(b, SLT_K_BOUNDS, p->rows * NARROW_COLUMNS);
    b->evaluations -= p->rows * NARROW_COLUMNS; /* none of f */
    b->args.note = NULL;
}

/* Of all iterations of all parts so many are kept. */
static bool pays(const NarrowParts *p, uint64_t all, uint64_t kept) {
    const uint64_t cost = p->rows * NARROW_COLUMNS * BOX;
    return kept <= all / 8 * 7 &&
           (!p->samples || (double)(all - kept) * (double)p->samples > (double)all * (double)cost);
}

bool narrow_tile(Narrowed *k, Batch *b, const NarrowParts *p) {
    const SltScene *s = b->s;
    const uint32_t parts = p->rows * NARROW_COLUMNS, all = (uint32_t)(((uint64_t)1 << parts) - 1);
    uint64_t n = 0, at = 0;
    k->rows = 0, k->current = b->args.cull;
    if (!k->note || (b->pool && pool_stop_reason(b->pool) != SLT_OK)) return true;
    for (uint32_t i = 0; i < s->nlists; i++) n += length(k, s, i);
    if (n < LEAST) return true;
    if (k->idle) return k->idle--, true;
    if (!room(k, n)) return false;
    memset(k->notes, 0, n * sizeof *k->notes);
    for (uint32_t i = 0; i < s->nlists; at += length(k, s, i++)) k->note[i] = k->notes + at;
    ask(k, b, p);
    at = 0;
    uint64_t kept = 0;
    for (uint32_t i = 0; i < s->nlists; i++) {
        const int32_t *item = k->current ? k->current[i].items : NULL;
        const uint32_t len = length(k, s, i);
        const uint64_t first = at;
        uint32_t hidden = 0;
        k->whole[i] = k->current ? k->current[i] : (SltCullList){NULL, -1};
        if (!s->list_noted[i]) continue;
        for (uint32_t j = len; j-- > 0; hidden |= (uint32_t)k->note[i][j].must) k->note[i][j].may &= all & ~hidden;
        for (uint32_t j = 0; j < len; j++)
            if (k->note[i][j].may) {
                k->keep[at] = (uint32_t)k->note[i][j].may, k->items[at++] = item ? item[j] : (int32_t)j;
                kept += (uint32_t)__builtin_popcountll(k->note[i][j].may);
            }
        k->whole[i] = (SltCullList){k->items + first, (int32_t)(at - first)};
    }
    k->idle = pays(p, n * parts, kept) ? 0 : IDLE;
    k->rows = p->rows;
    return true;
}

void narrow_end(Narrowed *k, Batch *b) {
    if (k->rows) b->args.cull = k->current;
    k->rows = 0;
}

void narrow_rows(Narrowed *k, Batch *b, uint32_t first, uint32_t last) {
    const SltScene *s = b->s;
    if (!k->rows) return;
    const uint32_t wanted =
        (uint32_t)(((uint64_t)1 << (last + 1) * NARROW_COLUMNS) - ((uint64_t)1 << first * NARROW_COLUMNS));
    int32_t *to = k->some;
    for (uint32_t i = 0; i < s->nlists; i++) {
        k->of[i] = k->whole[i];
        if (!s->list_noted[i]) continue;
        int32_t *from = to;
        for (int32_t j = 0; j < k->whole[i].count; j++) {
            const int64_t at = k->whole[i].items + j - k->items;
            *to = k->items[at], to += (k->keep[at] & wanted) != 0;
        }
        k->of[i] = (SltCullList){from, (int32_t)(to - from)};
    }
    b->args.cull = k->of;
}
