/* Points on curves whose g has a kink in the parameters (kink.c): half of each moves as after either move, and the two
 * rules differ by half of how much these do. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/sweep.h"

enum { TOGETHER = 32, ASIDE = 1024 /* steps */ };

/* The weights again, for the slopes of g after the move; those without one leave. */
static uint32_t weigh(Sink *k, Crossing *c, uint32_t n) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < n; i++) {
        double was = c[i].weight * fabs(c[i].dg[c[i].axis]);
        if (coincide_weigh(k, &c[i], 1) && c[i].dg[c[i].axis] != 0)
            c[i].weight = was / fabs(c[i].dg[c[i].axis]), c[kept++] = c[i];
    }
    return kept;
}

static void put(SweepWorker *v, const Crossing *at, uint32_t n, bool back) {
    Crossing c[TOGETHER];
    for (uint32_t i = 0; i < n; i++) c[i] = at[i], c[i].ga = c[i].gb = 0;
    n = weigh(&v->w->sink, c, n);
    for (uint32_t i = 0; i < n; i++) c[i].weight *= 0.5;
    sink_put_weighed(&v->w->sink, c, n);
    if (!v->sweep->errors || at->cls != CELL_FINE) return;
    for (uint32_t i = 0; i < n; i++) c[i].cls = CELL_COARSE, c[i].weight *= back ? -1 : 1;
    sink_put_weighed(&v->w->sink, c, n);
}

uint32_t sweep_kinks(SweepWorker *v, Crossing *c, uint32_t n) {
    Sink *k = &v->w->sink;
    Batch *b = k->b;
    const SltCullList *lists = b->args.cull;
    uint64_t order[BATCH];
    bool keep[BATCH];
    uint32_t kept = 0;
    double width = 0;
    k->coincide.apart = cells_apart(v->cells);
    if (!k->coincide.apart) return n;
    for (uint32_t d = 0; d < b->s->dim; d++) width = fmax(width, b->s->hi[d] - b->s->lo[d]);
    for (uint32_t i = 0; i < n; i++) {
        keep[i] = true, order[i] = (uint64_t)(uint32_t)c[i].event.site << 32 | i;
        memset(c[i].direction, 0, sizeof c[i].direction);
        c[i].ga = c[i].gb = c[i].bracket = c[i].base = c[i].rand0 = 0, c[i].stream = 0, c[i].owner = 0;
        c[i].direction[c[i].axis] = ASIDE * k->coincide.apart->step * width; /* for coincide_aside */
    }
    sort_keys(order, n);
    kink_settle(k, c, order, keep, n);
    for (uint32_t m = 0; m < UNTIE_WAYS; m++) {
        const Kinks *q = &k->coincide.kinks;
        if (!q->n[m / 2]) continue;
        untie_use(b, &k->coincide.apart->move[m].scene), b->args.cull = NULL;
        for (uint32_t i = 0; i < q->n[m / 2]; i += TOGETHER)
            put(v, q->at[m / 2] + i, q->n[m / 2] - i < TOGETHER ? q->n[m / 2] - i : TOGETHER, m & 1);
        untie_use(b, b->s), b->args.cull = lists;
    }
    k->coincide.apart = NULL;
    bool gone[BATCH] = {false};
    for (uint32_t i = 0; i < n; i++) gone[(uint32_t)order[i]] = !keep[i];
    for (uint32_t i = 0; i < n; i++)
        if (!gone[i]) c[kept++] = c[i];
    return kept;
}
