/* Layers: f that climbs so steeply next to a curve that no point of either rule meets it. The rules then agree, on what
 * is beside it. What f is on the two sides of the curve tells. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

#define BEYOND 1.5      /* times the range of what points have met, and more, lies f next to the curve, */
#define MATTERS 0x1p-6  /* by more than this part of the jump */

/* Is a place of a column between two heights? */
static bool is_on(const Piece *p, const Spot *s, const double part[2]) {
    return s->x[p->axis] >= part[0] && s->x[p->axis] <= part[1];
}

/* How many places on a column are halfway between f far from the root and f next to it. */
static uint32_t count_climbing(const Piece *p, const Spot *from, const Spot *to, const double part[2], uint32_t ch,
                               const double range[2]) {
    uint32_t n = 0;
    double quarter = 0.25 * (range[1] - range[0]);
    for (const Spot *s = from; s < to; s++)
        n += is_on(p, s, part) && s->f[ch] > range[0] + quarter && s->f[ch] < range[1] - quarter;
    return n;
}

/* By how much f lies outside of what was met on one side of the root: 0 where that is no more than a climb there. Where
 * it was more once, and columns are finer next to the root, the climb must be seen. */
static double outside(const Cells *c, const Piece *p, const Column *k, const Root *r, int side, uint32_t ch) {
    const Spot *from = c->spot + k->spots[0], *to = c->spot + k->spots[1];
    const Sides *s = cells_sides(c, r);
    const Box *box = &c->cell[p->cell].box;
    double at = r->x[p->axis], part[2] = {side ? at : box->lo[p->axis], side ? box->end[p->axis] : at};
    double met[2] = {HUGE_VAL, -HUGE_VAL}, f = s->f[side][ch], least = MATTERS * fabs(s->f[1][ch] - s->f[0][ch]);
    for (uint32_t i = k->first; i < k->first + k->nroots; i++) { /* up to the next curve */
        double h = c->root[i].x[p->axis];
        if (h < at) part[0] = larger(part[0], side ? at : h);
        if (h > at) part[1] = smaller(part[1], side ? h : at);
    }
    for (const Spot *q = from; q < to; q++)
        if (is_on(p, q, part)) met[0] = smaller(met[0], q->f[ch]), met[1] = larger(met[1], q->f[ch]);
    if (!(met[0] <= met[1])) return 0;
    double off = larger(met[0] - f, f - met[1]), range[2] = {smaller(met[0], f), larger(met[1], f)};
    if (off > BEYOND * (met[1] - met[0]) + least) return off;
    bool seen = !p->layered || !(range[1] - range[0] > least);
    return seen || count_climbing(p, from, to, part, ch, range) >= CELL_CLIMBING ? 0 : range[1] - range[0];
}

double cells_layer(Cells *c, const Piece *p, const Column *from, const Column *to, bool count) {
    double most = 0;
    for (const Column *k = from; k < to && !c->o->flat; k++)
        for (uint32_t i = k->first; i < k->first + k->nroots && k->rule == CELL_FINE; i++) {
            const Root *r = &c->root[i];
            if (!r->wanted || !r->sides || r->twin || r->band) continue;
            double steep = 0;
            for (uint32_t d = 0; d < c->dim; d++) steep += r->dg[d] * r->dg[d];
            double length = k->weight * sqrt(steep) / fabs(r->dg[r->axis]);
            for (uint32_t ch = 0; ch < c->s->channels; ch++)
                for (int side = 0; side < 2; side++) {
                    double off = outside(c, p, k, r, side, ch);
                    most = larger(most, off);
                    if (count) c->counts->upset_jump[ch] += off * length;
                }
        }
    return most;
}
