/* Parts of a tie whose boundary is there only after a move. Where a polygon is counted by the edges that a ray crosses,
 * and an edge has a.y = b.y, the comparisons with a.y and with b.y coincide along it; that which moves with the edge,
 * `x.x < (b.x - a.x) * (x.y - a.y) / (b.y - a.y) + a.x`, is asked between the two alone: 0 / 0 as long as nothing has
 * moved. After a move it has a root, and there g has the slopes of the edge, however small the move was. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "runtime/sample/untie_inner.h"

typedef struct Ask { /* g of an event beside a crossing */
    const Crossing *c;
    const Event *event;
    Away *away; /* whose place it is; NULL: the crossing's own */
    double x[3], g, dg[3];
    bool done;
} Ask;
enum {
    ASKS = UNTIE_MOST * (UNTIE_EVENTS > UNTIE_AWAY / 2 ? UNTIE_EVENTS : UNTIE_AWAY / 2),
    STEPS = 3, /* from what the search has found to the root */
    NEAR = 4   /* units in the last place, to both sides of it: rounding of g moves it about as far */
};

/* g and its gradient, with the parameters in use. */
static void ask(Batch *b, Ask *a, uint32_t n) {
    uint32_t lane[ASKS];
    for (uint32_t i = 0; i < n; i++) a[i].done = false;
    for (uint32_t from = 0; from < n; from++) {
        uint32_t lanes = 0;
        if (a[from].done) continue;
        b->args.site = a[from].event->site;
        for (uint32_t i = from; i < n; i++) {
            if (a[i].done || a[i].event->site != b->args.site) continue;
            batch_set_x(b, lanes, a[i].x);
            batch_set_stream(b, lanes, a[i].c->stream, a[i].c->rand0);
            batch_set_event(b, lanes, a[i].event);
            a[i].done = true, lane[lanes++] = i;
        }
        batch_call(b, SLT_K_SITE_GRAD, lanes);
        for (uint32_t i = 0; i < lanes; i++) {
            a[lane[i]].g = batch_get(b, SLT_OUT_G, 0, i);
            for (uint32_t d = 0; d < b->s->dim; d++) a[lane[i]].dg[d] = batch_get(b, SLT_OUT_G_DX, d, i);
        }
    }
}

/* Has g a root no farther away than this? */
static bool has_root(const Batch *b, const Ask *a, double reach) {
    double square = 0;
    for (uint32_t d = 0; d < b->s->dim; d++) square += a->dg[d] * a->dg[d];
    return square > 0 && isfinite(square) && fabs(a->g) <= sqrt(square) * reach;
}

/* Along the gradient of the crossing's g. */
static void go(const Batch *b, Ask *a, double by) {
    double steep = untie_steepness(b, a->c);
    for (uint32_t d = 0; d < b->s->dim; d++) a->x[d] += by * a->c->dg[d] / steep;
}

/* To where g is 0, as its slope says. */
static void go_to_root(const Batch *b, Ask *a) {
    double along = 0, steep = untie_steepness(b, a->c);
    for (uint32_t d = 0; d < b->s->dim; d++) along += a->dg[d] * a->c->dg[d] / steep;
    go(b, a, -a->g / along);
}

/* Of a tie's event e, which has no boundary where the parameters are: its parts by move. False: too many. */
static bool go_away(const Order order[UNTIE_WAYS], uint32_t channels, Tie *t, uint32_t e) {
    uint32_t pairs = 0;
    for (uint32_t m = 0; m < UNTIE_WAYS; m += 2) pairs += order[m].whole && order[m + 1].whole;
    for (uint32_t m = 0; m < UNTIE_WAYS; m++) {
        const Order *o = &order[m];
        if (!o->whole || !order[m ^ 1].whole) continue;
        for (uint32_t i = 0; i < o->n; i++) {
            if (!event_same(&o->event[i], &t->event[e])) continue;
            if (t->naway == UNTIE_AWAY) return false;
            Away *a = &t->away[t->naway++];
            *a = (Away){.event = t->event[e], .move = m};
            memcpy(a->x[0], o->x[i], sizeof a->x[0]);
            for (uint32_t ch = 0; ch < channels; ch++) {
                a->jump[ch] = 0.5 * o->jump[i][ch] / pairs;
                a->half[ch] = ((m == t->between[0]) - (m == t->between[1])) * 0.5 * o->jump[i][ch];
            }
        }
    }
    return true;
}

/* The slopes at two places beside the root. False: there is none. */
static bool settle_away(const Batch *b, Away *a, const Ask ends[2]) {
    bool found = true;
    for (int end = 0; end < 2; end++) {
        memcpy(a->x[end], ends[end].x, sizeof a->x[end]), memcpy(a->dg[end], ends[end].dg, sizeof a->dg[end]);
        a->g[end] = ends[end].g;
        found &= has_root(b, &ends[end], HUGE_VAL);
    }
    a->part[0] = fmax(0, fmin(1, a->g[1] / (a->g[1] - a->g[0]))), a->part[1] = 1 - a->part[0];
    return found && isfinite(a->g[0]) && isfinite(a->g[1]);
}

/* All places of one move. */
static void find_roots_away(Batch *b, const Crossing *c, const uint32_t *which, uint32_t n, uint32_t move, Tie *tie) {
    Ask asks[ASKS];
    uint32_t count = 0;
    double size = 0;
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t k = 0; k < tie[i].naway; k++) {
            Away *a = &tie[i].away[k];
            if (a->move != move) continue;
            for (int end = 0; end < 2; end++) {
                asks[count] = (Ask){.c = &c[which[i]], .event = &a->event, .away = a};
                memcpy(asks[count++].x, a->x[0], sizeof a->x[0]);
            }
        }
    for (int s = 0; s < STEPS && count; s++) {
        ask(b, asks, count);
        for (uint32_t i = 0; i < count; i++) go_to_root(b, &asks[i]);
    }
    for (uint32_t d = 0; d < b->s->dim; d++) size = fmax(size, fmax(fabs(b->s->lo[d]), fabs(b->s->hi[d])));
    for (uint32_t i = 0; i < count; i++)
        go(b, &asks[i], (i & 1 ? NEAR : -NEAR) * size * (b->f64 ? DBL_EPSILON : FLT_EPSILON));
    if (count) ask(b, asks, count);
    for (uint32_t i = 0; i < count; i += 2)
        if (!settle_away(b, asks[i].away, &asks[i])) asks[i].away->part[0] = NAN;
}

void untie_away(Batch *b, const Apart *apart, const Crossing *c, const uint32_t *which, uint32_t n,
                Order (*order)[UNTIE_WAYS], const double *reach, Tie *tie) {
    Ask asks[ASKS];
    uint32_t count = 0, at = 0;
    bool any = false;
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t e = 0; e < tie[i].n; e++) {
            asks[count] = (Ask){.c = &c[which[i]], .event = &tie[i].event[e]};
            memcpy(asks[count++].x, c[which[i]].x, sizeof asks[0].x);
        }
    if (count) ask(b, asks, count);
    for (uint32_t i = 0; i < n; i++) {
        Tie *t = &tie[i];
        uint32_t kept = 0, events = t->n;
        bool room = true;
        for (uint32_t e = 0; e < events; e++) {
            if (!has_root(b, &asks[at++], reach[i])) {
                room &= go_away(order[i], b->s->channels, t, e);
                continue;
            }
            t->event[kept] = t->event[e];
            memmove(t->jump[kept], t->jump[e], sizeof t->jump[e]),
                memmove(t->half[kept], t->half[e], sizeof t->half[e]);
            kept++;
        }
        any |= kept < events;
        t->n = kept, t->whole &= kept == events;
        if (!room) t->n = t->naway = 0;
    }
    for (uint32_t m = 0; m < UNTIE_WAYS && any; m++) {
        untie_use(b, &apart->move[m].scene);
        find_roots_away(b, c, which, n, m, tie);
    }
    if (any) untie_use(b, b->s);
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t k = 0; k < tie[i].naway; k++)
            if (isnan(tie[i].away[k].part[0])) tie[i].n = tie[i].naway = 0;
}
