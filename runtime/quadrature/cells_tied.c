/* Curves that lie on each other, as far as rounding lets one tell, are integrated as one; but what jumps there need not
 * be the first one's, nor all of it one's: untie.c. Whose it is does not change along a piece. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

/* How far parameters are moved: far beyond the rounding of roots, and not as far as the next curve. */
#define STEP_F64 0x1p-26
#define STEP_F32 0x1p-14

#define ROOM 0.25 /* of a piece: at its ends other curves meet it */

bool cells_ready_to_tie(Cells *c) {
    /* Where no site moves only the two sides of seams are asked for, and there is nothing to search with. */
    if (!c->s->kernel[SLT_K_SITE] || !c->s->kernel[SLT_K_REGION]) return true;
    if (!c->apart && !apart_new(c->s, 0, c->b->f64 ? STEP_F64 : STEP_F32, &c->apart)) return false;
    return c->untie || (c->untie = untie_new(c->b));
}

/* Other boundaries are near, as where two touch, and moves do not tell: each of those that lie here may have all of the
 * jump, or nothing. */
static void share(const Cells *c, const Root *r, const Crossing *x, Tie *t) {
    const Column *k = &c->column[r->column];
    bool others = false;
    t->event[0] = x->event, t->n = 1;
    for (uint32_t i = k->first; i < k->first + k->nroots && t->n < UNTIE_EVENTS; i++) {
        const Event *event = &c->root[i].of->event;
        if (!c->root[i].other || &c->root[c->root[i].other - 1] != r) continue;
        bool counts = (uint32_t)event->site < c->s->nsites; /* and once, however many pieces its g has there */
        others |= counts;
        for (uint32_t e = 0; e < t->n; e++) counts &= !event_same(event, &t->event[e]);
        if (counts) t->event[t->n++] = *event;
    }
    if (!others) t->n = 0;
    for (uint32_t e = 0; e < t->n; e++)
        for (uint32_t ch = 0; ch < c->s->channels; ch++)
            t->jump[e][ch] = x->jump[ch] / t->n, t->half[e][ch] = x->jump[ch] * (t->n - 1) / t->n;
}

bool cells_tie(Cells *c, uint32_t n) {
    if (!cells_ready_to_tie(c)) return false;
    for (uint32_t from = 0; from < n && c->apart; from += UNTIE_MOST) {
        uint32_t most = n - from < UNTIE_MOST ? n - from : UNTIE_MOST, which[UNTIE_MOST];
        Crossing x[UNTIE_MOST];
        double room[UNTIE_MOST];
        Tie tie[UNTIE_MOST];
        memset(x, 0, sizeof x);
        for (uint32_t i = 0; i < most; i++) {
            const Root *r = &c->root[c->active[from + i]];
            const Piece *p = &c->piece[c->column[r->column].piece];
            cells_crossing(c, r, &x[i]);
            which[i] = i, room[i] = p->base < 0 ? HUGE_VAL : ROOM * (p->at[p->base][1] - p->at[p->base][0]);
        }
        if (!untie(c->untie, c->apart, x, which, most, room, tie)) return false;
        for (uint32_t i = 0; i < most; i++) {
            Root *r = &c->root[c->active[from + i]];
            if (tie[i].untold) share(c, r, &x[i], &tie[i]);
            /* Of several pieces of one g the program takes one, which may not be that of the edge. */
            bool own = !r->of->given.n && tie[i].whole && event_same(&tie[i].event[0], &x[i].event);
            if ((!tie[i].n && !tie[i].naway) || own) continue;
            if (!CELLS_ROOM(c, tie, 1)) return false;
            c->tie[c->ntie++] = tie[i];
            r->tie = c->ntie;
        }
    }
    return true;
}

/* One event's part of the crossing x, with its own g, whose gradient may point the other way. */
static void emit_part(Cells *c, const Crossing *x, const Column *k, const Tie *t, uint32_t e, const Probe *p) {
    double along = p->dg[x->axis] * x->dg[x->axis] < 0 ? -1 : 1, weight = k->weight / fabs(p->dg[x->axis]);
    if (!isfinite(weight)) return;
    /* The lower rule is off by as much as the orders leave open: so their distance says it. */
    for (int half = 0; half < 1 + ((t->kink || t->doubted || t->untold) && k->rule == CELL_FINE); half++) {
        Crossing *part = cells_add_crossing(c, half ? CELL_COARSE : k->rule);
        uint8_t rule = part->cls;
        *part = *x;
        part->cls = rule, part->event = t->event[e], part->g = p->g, part->weight = weight;
        memcpy(part->dg, p->dg, sizeof part->dg);
        for (uint32_t ch = 0; ch < c->s->channels; ch++)
            part->jump[ch] = along * (half ? t->half[e][ch] : t->whole ? x->jump[ch] : t->jump[e][ch]);
    }
}

void cells_emit_away(Cells *c, const Crossing *x, double base, uint8_t rule, const Tie *t) {
    for (uint32_t e = 0; e < t->naway; e++)
        for (int end = 0; end < 2; end++) {
            const Away *a = &t->away[e];
            double up = a->dg[end][x->axis], along = up * x->dg[x->axis] < 0 ? -1 : 1, weight = base / fabs(up);
            if (!(a->part[end] > 0) || !isfinite(weight)) continue;
            for (int half = 0; half < 1 + (rule == CELL_FINE); half++) {
                Crossing *part = cells_add_crossing(c, half ? CELL_COARSE : rule);
                uint8_t cls = part->cls;
                *part = *x;
                part->cls = cls, part->event = a->event, part->g = a->g[end], part->weight = weight;
                part->apart = c->apart, part->move = (uint8_t)(1 + a->move);
                memcpy(part->x, a->x[end], sizeof part->x), memcpy(part->dg, a->dg[end], sizeof part->dg);
                for (uint32_t ch = 0; ch < c->s->channels; ch++)
                    part->jump[ch] = along * a->part[end] * (half ? a->half[ch] : a->jump[ch]);
            }
        }
}

bool cells_emit_tied(Cells *c, const Column *from, const Column *to) {
    c->nprobe = 0;
    for (const Column *k = from; k < to; k++)
        for (uint32_t i = 0; i < k->nroots; i++) {
            const Root *r = &c->root[k->first + i];
            const Tie *t = r->wanted && r->tie ? &c->tie[r->tie - 1] : NULL;
            for (uint32_t e = 0; t && e < t->n; e++)
                if (!cells_probe_event(c, &t->event[e], r->x)) return false;
        }
    if (!cells_run_site_probes(c)) return false;
    const Probe *p = c->probe;
    for (const Column *k = from; k < to; k++)
        for (uint32_t i = 0; i < k->nroots; i++) {
            const Root *r = &c->root[k->first + i];
            if (!r->wanted || !r->tie) continue;
            const Tie *t = &c->tie[r->tie - 1];
            Crossing x = {.event = {0}};
            cells_crossing(c, r, &x);
            if (t->hidden) cells_count_hidden(c, r);
            else if (t->kink && k->rule == CELL_FINE) cells_count_kink(c, &r->of->event, r->x);
            for (uint32_t e = 0; e < t->n; e++) emit_part(c, &x, k, t, e, p++);
            cells_emit_away(c, &x, k->weight, k->rule, t);
        }
    return true;
}
