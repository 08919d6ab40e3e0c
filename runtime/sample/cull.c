/* Boxes of [Cull] iterations, from the program's own bounds function, and lists for a rectangle or a few samples. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/cull.h"

void cull_free(CullBoxes *c) {
    for (uint32_t i = 0; i < c->n && c->grid; i++) cull_grid_free(&c->grid[i]);
    for (uint32_t i = 0; i < c->n && c->strips; i++) cull_strips_free(&c->strips[i]);
    free(c->grid), free(c->strips);
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
    bool memory = batch_init_few(&b, s, NULL, most) && box && (c->grid = alloc_zero(s->ncull, sizeof *c->grid));
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

bool cull_by_parts(CullBoxes *c) {
    if (c->strips || !c->n) return true;
    if (!(c->strips = alloc_zero(c->n, sizeof *c->strips))) return false;
    for (uint32_t i = 0; i < c->n; i++)
        if (!cull_strips_make(&c->strips[i], &c->grid[i])) return false;
    return true;
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
    if (c->strips) {
        l->part = alloc_zero(c->nlists, sizeof *l->part), l->part_item = alloc_zero(c->n, sizeof *l->part_item);
        if (!l->part || !l->part_item) return false;
        memcpy(l->part, l->list, c->nlists * sizeof *l->part);
        for (uint32_t i = 0; i < c->n; i++)
            if (!(l->part_item[i] = malloc(((size_t)c->count[i] + 1) * sizeof *l->part_item[i]))) return false;
    }
    l->found = alloc_zero(words(most), sizeof *l->found), l->some = alloc_zero(words(words(most)), sizeof *l->some);
    return l->found && l->some;
}

void cull_lists_free(CullLists *l, const CullBoxes *c) {
    for (uint32_t i = 0; i < c->n && l->items; i++) free(l->items[i]);
    for (uint32_t i = 0; i < c->n && l->part_item; i++) free(l->part_item[i]);
    free(l->list), free(l->items), free(l->found), free(l->some), free(l->part), free(l->part_item);
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
    b->args.cull = l->list, b->lists = l, l->of = c;
}

bool cull_may_part(const Batch *b) {
    enum { LEAST = 32 }; /* iterations, which take longer than a list to make */
    const CullLists *l = b->lists;
    if (!l || !l->part || b->args.cull != l->list || b->args.note) return false;
    int64_t n = 0;
    for (uint32_t i = 0; i < l->of->n; i++) n += l->of->strips[i].words ? l->list[i].count : 0;
    return n >= LEAST;
}

/* What is least of a, and greatest of b, of n floats; up to FOLD - 1 more are read and count. NaN does not. */
enum { FOLD = 8 };
#define RANGE(name, type)                                                                         \
    static void name(const type *a, const type *b, uint32_t n, double *least, double *most) {     \
        type lo[FOLD], hi[FOLD];                                                                  \
        for (uint32_t k = 0; k < FOLD; k++) lo[k] = (type)HUGE_VAL, hi[k] = (type)-HUGE_VAL;      \
        for (uint32_t i = 0; i < n; i += FOLD)                                                    \
            for (uint32_t k = 0; k < FOLD; k++) {                                                 \
                lo[k] = a[i + k] < lo[k] ? a[i + k] : lo[k];                                      \
                hi[k] = b[i + k] > hi[k] ? b[i + k] : hi[k];                                      \
            }                                                                                     \
        for (uint32_t k = 1; k < FOLD; k++) {                                                     \
            lo[0] = lo[k] < lo[0] ? lo[k] : lo[0], hi[0] = hi[k] > hi[0] ? hi[k] : hi[0];         \
        }                                                                                         \
        *least = (double)lo[0], *most = (double)hi[0];                                            \
    }
RANGE(range_f32, float)
RANGE(range_f64, double)
#undef RANGE

static void range_of(const Batch *b, uint32_t near, uint32_t far, uint32_t n, double *least, double *most) {
    if (b->f64) range_f64(batch_row(b, near, 0), batch_row(b, far, 0), n, least, most);
    else range_f32(batch_row(b, near, 0), batch_row(b, far, 0), n, least, most);
}

void cull_part(Batch *b, uint32_t n, bool boxes) {
    const CullLists *l = b->lists;
    double lo[2], hi[2];
    for (uint32_t d = 0; d < 2; d++) {
        const uint32_t near = SLT_IN_X0 + d, far = boxes ? SLT_IN_H0 + d : near;
        const uint64_t asked = (uint64_t)1 << near | (uint64_t)1 << far;
        lo[d] = -HUGE_VAL, hi[d] = HUGE_VAL; /* where the kernel does not look, it may be anywhere */
        if ((b->layout->reads & asked) == asked) range_of(b, near, far, n, &lo[d], &hi[d]);
    }
    for (uint32_t i = 0; i < l->of->n; i++)
        l->part[i] = l->of->strips[i].words
                         ? (SltCullList){l->part_item[i], cull_strips_find(&l->of->strips[i], lo, hi, l->part_item[i])}
                         : l->list[i];
    b->args.cull = l->part;
}
