/* Layers: f that climbs so steeply next to a curve, or in a corner of a box on which it is smooth, that no point of
 * either rule meets it. The rules then agree, on what is beside it. What f is on the two sides of a curve tells, and of
 * a box its bounds. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

/* ---- beside curves */
#define BEYOND 1.5      /* times the range of what points have met, and more, lies f next to the curve, */
#define MATTERS 0x1p-6  /* by more than this part of the jump */

/* What the fine rule has met on a column between two heights. */
static bool range_met(const Piece *p, const Column *k, const Spot *from, const Spot *to, const double part[2],
                      uint32_t ch, double met[2]) {
    met[0] = HUGE_VAL, met[1] = -HUGE_VAL;
    for (const Spot *s = from; s < to; s++) {
        if (s->rule != CELL_FINE || (p->base >= 0 && s->x[p->base] != k->x[p->base])) continue;
        if (s->x[p->axis] < part[0] || s->x[p->axis] > part[1]) continue;
        met[0] = smaller(met[0], s->f[ch]), met[1] = larger(met[1], s->f[ch]);
    }
    return met[0] <= met[1];
}

/* By how much f lies outside of what was met on one side of the root: 0 where that is no more than a climb there. */
static double outside(const Cells *c, const Piece *p, const Column *k, const Root *r, int side, const Spot *from,
                      const Spot *to, uint32_t ch) {
    const Sides *s = cells_sides(c, r);
    const Box *box = &c->cell[p->cell].box;
    double at = r->x[p->axis], part[2] = {side ? at : box->lo[p->axis], side ? box->end[p->axis] : at}, met[2];
    for (uint32_t i = k->first; i < k->first + k->nroots; i++) { /* up to the next curve */
        double h = c->root[i].x[p->axis];
        if (h < at) part[0] = larger(part[0], side ? at : h);
        if (h > at) part[1] = smaller(part[1], side ? h : at);
    }
    if (!range_met(p, k, from, to, part, ch, met)) return 0;
    double f = s->f[side][ch], off = larger(met[0] - f, f - met[1]);
    return off > BEYOND * (met[1] - met[0]) + MATTERS * fabs(s->f[1][ch] - s->f[0][ch]) ? off : 0;
}

double cells_layer(Cells *c, const Piece *p, const Column *from, const Column *to, const Spot *first, const Spot *end,
                   bool count) {
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
                    double off = outside(c, p, k, r, side, first, end, ch);
                    most = larger(most, off);
                    if (count) c->counts->upset_jump[ch] += off * length;
                }
        }
    return most;
}

/* ---- in boxes */
enum {
    LOOSE = 64,
    HUNT = 1 << 14
}; /* bounds beyond what was met, by this factor; evaluations of a tile for that, at first */
#define LARGE 0.25                /* part of what f may be: by so much it may vary */

bool cells_hides_peak(Cells *c, const Smooth *s, const Spot *first, const Spot *end) {
    if (c->lists.any || c->prunes || (c->o->budget && c->o->budget < HUNT)) return false; /* a trial counts cells */
    if (c->hunted > HUNT + (c->b->evaluations - c->began) / 4) return false;
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        double lo = s->f[2 * ch], hi = s->f[2 * ch + 1], met[2] = {HUGE_VAL, -HUGE_VAL};
        for (const Spot *p = first; p < end; p++) met[0] = smaller(met[0], p->f[ch]), met[1] = larger(met[1], p->f[ch]);
        if (!(hi - lo < HUGE_VAL) || !(met[0] <= met[1])) continue;
        if (hi - lo <= LOOSE * (met[1] - met[0]) || hi - lo <= LARGE * larger(fabs(lo), fabs(hi))) continue;
        c->hunted += 2 * (uint64_t)(end - first);
        return true;
    }
    return false;
}

uint32_t cells_hunt(Cells *c, const Smooth *s, double f[2][2 * SLT_MAX_CHANNELS]) {
    Batch *b = c->b;
    uint32_t best = 0;
    double least = HUGE_VAL;
    for (uint32_t i = 0; i < 2 * c->dim; i++) {
        double lo[3], hi[3], middle = cells_round(c, 0.5 * (s->lo[i / 2] + s->end[i / 2]));
        memcpy(lo, s->lo, sizeof lo), memcpy(hi, s->hi, sizeof hi);
        *(i & 1 ? &lo[i / 2] : &hi[i / 2]) = middle;
        batch_set_x(b, i, lo);
        for (uint32_t d = 0; d < c->dim; d++) batch_set(b, SLT_IN_H0 + d, i, hi[d]);
    }
    c->hunted += 2 * c->dim;
    cells_call(c, SLT_K_BOUNDS, 2 * c->dim);
    for (uint32_t d = 0; d < c->dim; d++) {
        double sum = 0, longest = s->end[d] - s->lo[d];
        for (uint32_t i = 2 * d; i < 2 * d + 2; i++)
            for (uint32_t ch = 0; ch < c->s->channels; ch++)
                sum += batch_get(b, SLT_OUT_F_HI, ch, i) - batch_get(b, SLT_OUT_F_LO, ch, i);
        for (uint32_t e = 0; e < c->dim; e++) longest = larger(longest, s->end[e] - s->lo[e]);
        sum *= 1 - 1e-3 * (s->end[d] - s->lo[d]) / longest; /* of equals the longest side */
        if (!(sum < least)) continue;
        least = sum, best = d;
        for (uint32_t i = 0; i < 2; i++)
            for (uint32_t ch = 0; ch < c->s->channels; ch++) {
                f[i][2 * ch] = batch_get(b, SLT_OUT_F_LO, ch, 2 * d + i);
                f[i][2 * ch + 1] = batch_get(b, SLT_OUT_F_HI, ch, 2 * d + i);
            }
    }
    return best;
}
