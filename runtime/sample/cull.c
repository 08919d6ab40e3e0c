/* Boxes of [Cull] iterations, from the program's own bounds function, and lists for a rectangle. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/cull.h"

void cull_free(CullBoxes *c) {
    for (uint32_t i = 0; i < c->n && c->box; i++) free(c->box[i]);
    free(c->box);
    memset(c, 0, sizeof *c);
}

SltStatus cull_boxes(CullBoxes *c, const SltScene *s, SltError *err) {
    memset(c, 0, sizeof *c);
    if (!s->ncull || !s->cull_bounds || s->dim != 2 || s->call) return SLT_OK;
    for (uint32_t i = 0; i < s->ncull; i++)
        if (!s->cull_bounds[i]) return SLT_OK; /* not compiled: every iteration runs */
    Batch b;
    if (!batch_init(&b, s, NULL) || !(c->box = alloc_zero(s->ncull, sizeof *c->box))) goto memory;
    c->n = s->ncull, c->nlists = s->nlists > s->ncull ? s->nlists : s->ncull, c->count = s->cull_count;
    for (uint32_t i = 0; i < c->n; i++) {
        uint32_t count = c->count[i];
        double *box = c->box[i] = malloc(((size_t)count + 1) * 4 * sizeof *box);
        if (!box) goto memory;
        for (uint32_t from = 0; from < count; from += BATCH) {
            uint32_t n = count - from < BATCH ? count - from : BATCH;
            for (uint32_t l = 0; l < n; l++) batch_set_int(&b, SLT_IN_ITERATION, l, (int32_t)(from + l));
            batch_call_cull(&b, i, n);
            for (uint32_t l = 0; l < n; l++)
                for (uint32_t e = 0; e < 4; e++) box[4 * (size_t)(from + l) + e] = batch_get(&b, SLT_OUT_BOX, e, l);
        }
    }
    batch_free(&b);
    return SLT_OK;
memory:
    batch_free(&b);
    cull_free(c);
    return status_fail(err, SLT_LIMIT, "out of memory");
}

bool cull_lists_init(CullLists *l, const CullBoxes *c) {
    memset(l, 0, sizeof *l);
    if (!c->n) return true;
    l->list = alloc_zero(c->nlists, sizeof *l->list), l->items = alloc_zero(c->n, sizeof *l->items);
    if (!l->list || !l->items) return false;
    for (uint32_t i = 0; i < c->nlists; i++) l->list[i].count = -1;
    for (uint32_t i = 0; i < c->n; i++)
        if (!(l->items[i] = malloc(((size_t)c->count[i] + 1) * sizeof *l->items[i]))) return false;
    return true;
}

void cull_lists_free(CullLists *l, const CullBoxes *c) {
    for (uint32_t i = 0; i < c->n && l->items; i++) free(l->items[i]);
    free(l->list), free(l->items);
    memset(l, 0, sizeof *l);
}

void cull_select(const CullBoxes *c, CullLists *l, Batch *b, const double lo[3], const double hi[3]) {
    b->args.cull = NULL;
    if (!c->n) return;
    /* Positions are rounded to the program's precision before the kernel sees them. */
    double eps = b->f64 ? DBL_EPSILON : (double)FLT_EPSILON, slack[2];
    for (int d = 0; d < 2; d++) slack[d] = 2 * eps * fmax(fabs(lo[d]), fabs(hi[d]));
    for (uint32_t i = 0; i < c->n; i++) {
        int32_t n = 0;
        const double *box = c->box[i];
        for (uint32_t k = 0; k < c->count[i]; k++, box += 4) {
            /* Comparisons with NaN are false: a box of NaN is kept. */
            bool out = box[0] > hi[0] + slack[0] || box[2] < lo[0] - slack[0] || box[1] > hi[1] + slack[1] ||
                       box[3] < lo[1] - slack[1];
            l->items[i][n] = (int32_t)k;
            n += !out;
        }
        l->list[i] = (SltCullList){l->items[i], n};
    }
    b->args.cull = l->list;
}
