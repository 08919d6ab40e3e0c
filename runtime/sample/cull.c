/* Boxes of [Cull] iterations, from the program's own bounds function, and lists for a rectangle. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/cull.h"

void cull_free(CullBoxes *c) {
    for (uint32_t i = 0; i < c->n && c->grid; i++) cull_grid_free(&c->grid[i]);
    free(c->grid);
    memset(c, 0, sizeof *c);
}

static void ask_boxes(Batch *b, uint32_t loop, uint32_t count, CullBox *box) {
    for (uint32_t from = 0; from < count; from += BATCH) {
        uint32_t n = count - from < BATCH ? count - from : BATCH;
        for (uint32_t l = 0; l < n; l++) batch_set_int(b, SLT_IN_ITERATION, l, (int32_t)(from + l));
        batch_call_cull(b, loop, n);
        for (uint32_t l = 0; l < n; l++)
            for (uint32_t d = 0; d < 2; d++) {
                box[from + l].lo[d] = batch_get(b, SLT_OUT_BOX, d, l);
                box[from + l].hi[d] = batch_get(b, SLT_OUT_BOX, 2 + d, l);
            }
    }
}

SltStatus cull_boxes(CullBoxes *c, const SltScene *s, SltError *err) {
    memset(c, 0, sizeof *c);
    if (!s->ncull || !s->cull_bounds || s->dim != 2 || s->call) return SLT_OK;
    uint32_t most = 0;
    for (uint32_t i = 0; i < s->ncull; i++) {
        if (!s->cull_bounds[i]) return SLT_OK; /* not compiled: every iteration runs */
        if (s->cull_count[i] > most) most = s->cull_count[i];
    }
    Batch b;
    CullBox *box = malloc(((size_t)most + 1) * sizeof *box);
    bool memory = batch_init(&b, s, NULL) && box && (c->grid = alloc_zero(s->ncull, sizeof *c->grid));
    if (memory) c->n = s->ncull, c->nlists = s->nlists > s->ncull ? s->nlists : s->ncull, c->count = s->cull_count;
    for (uint32_t i = 0; i < c->n && memory; i++) {
        ask_boxes(&b, i, c->count[i], box);
        memory = cull_grid_make(&c->grid[i], s, box, c->count[i]);
    }
    batch_free(&b), free(box);
    if (memory) return SLT_OK;
    cull_free(c);
    return status_fail(err, SLT_LIMIT, "out of memory");
}

static uint32_t words(uint32_t bits) { return bits / 64 + 1; }

bool cull_lists_init(CullLists *l, const CullBoxes *c) {
    memset(l, 0, sizeof *l);
    if (!c->n) return true;
    uint32_t most = 0;
    l->list = alloc_zero(c->nlists, sizeof *l->list), l->items = alloc_zero(c->n, sizeof *l->items);
    if (!l->list || !l->items) return false;
    for (uint32_t i = 0; i < c->nlists; i++) l->list[i].count = -1;
    for (uint32_t i = 0; i < c->n; i++) {
        if (!(l->items[i] = malloc(((size_t)c->count[i] + 1) * sizeof *l->items[i]))) return false;
        if (c->count[i] > most) most = c->count[i];
    }
    l->found = alloc_zero(words(most), sizeof *l->found), l->some = alloc_zero(words(words(most)), sizeof *l->some);
    return l->found && l->some;
}

void cull_lists_free(CullLists *l, const CullBoxes *c) {
    for (uint32_t i = 0; i < c->n && l->items; i++) free(l->items[i]);
    free(l->list), free(l->items), free(l->found), free(l->some);
    memset(l, 0, sizeof *l);
}

/* The numbers of the bits that are set, in order; they are cleared. */
static int32_t take_found(CullLists *l, uint32_t count, int32_t *items) {
    int32_t n = 0;
    for (uint32_t s = 0; s < words(words(count)); s++)
        for (; l->some[s]; l->some[s] &= l->some[s] - 1) {
            uint32_t w = 64 * s + (uint32_t)__builtin_ctzll(l->some[s]);
            for (; l->found[w]; l->found[w] &= l->found[w] - 1)
                items[n++] = (int32_t)(64 * w + (uint32_t)__builtin_ctzll(l->found[w]));
        }
    return n;
}

void cull_select(const CullBoxes *c, CullLists *l, Batch *b, const double lo[3], const double hi[3]) {
    b->args.cull = NULL;
    if (!c->n) return;
    /* Positions are rounded to the program's precision before the kernel sees them. */
    double eps = b->f64 ? DBL_EPSILON : (double)FLT_EPSILON, least[2], most[2];
    for (int d = 0; d < 2; d++) {
        double slack = 2 * eps * fmax(fabs(lo[d]), fabs(hi[d]));
        least[d] = lo[d] - slack, most[d] = hi[d] + slack;
    }
    for (uint32_t i = 0; i < c->n; i++) {
        cull_grid_find(&c->grid[i], least, most, l->found, l->some);
        l->list[i] = (SltCullList){l->items[i], take_found(l, c->count[i], l->items[i])};
    }
    b->args.cull = l->list;
}
