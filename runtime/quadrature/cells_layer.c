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
    LOOSE = 8,     /* bounds beyond what was met, by this factor: worth a closer look. */
    LOOSER = 64,   /* of a pixel, which has the bounds of its cell */
    FEW = 2,       /* places, by both rules, on a climb from a quarter of its height to three */
    HUNT = 1 << 14 /* evaluations of a tile for that, at first */
};
#define VARIES 0x1p-6 /* part of what f may be: by so much it may vary unseen */
#define KEEPS 0.8     /* and this part of it a small part of the box keeps where f is steep */

static bool is_inside(const Cells *c, const Spot *s, const double lo[3], const double hi[3]) {
    bool inside = true;
    for (uint32_t d = 0; d < c->dim && lo; d++) inside &= s->x[d] >= lo[d] && s->x[d] <= hi[d];
    return inside;
}

/* May f be steep in the box, with bounds f[], where points do not tell? They have met less than bounds allow; or what f
 * is before a step and behind it, and nothing between: then its integral is about right, and derivatives know nothing
 * of the step. */
static bool is_suspect(const Cells *c, const double *f, const Spot *first, const Spot *end, const double lo[3],
                       const double hi[3], double loose) {
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        double low = f[2 * ch], high = f[2 * ch + 1], met[2] = {HUGE_VAL, -HUGE_VAL};
        for (const Spot *p = first; p < end; p++)
            if (is_inside(c, p, lo, hi)) met[0] = smaller(met[0], p->f[ch]), met[1] = larger(met[1], p->f[ch]);
        double range = met[1] - met[0], quarter = 0.25 * range;
        if (!(high - low < HUGE_VAL) || !(range >= 0)) continue;
        if (high - low > loose * range && high - low > VARIES * larger(fabs(low), fabs(high))) return true;
        if (!(range > VARIES * larger(fabs(met[0]), fabs(met[1])))) continue;
        uint32_t between = 0;
        for (const Spot *p = first; p < end; p++)
            between += p->f[ch] > met[0] + quarter && p->f[ch] < met[1] - quarter && is_inside(c, p, lo, hi);
        if (between < FEW) return true;
    }
    return false;
}

/* Where f is steep on a small part of a box, one of the boxes that halves along all axes make keeps nearly all of the
 * range that bounds allow; where bounds are only loose, or f is not steep, each has half. What they allow at a single
 * point is rounding. */
static bool is_steep(Cells *c, const double lo[3], const double end[3], const double *f) {
    Batch *b = c->b;
    const uint32_t n = 1u << c->dim; /* and the middle */
    for (uint32_t i = 0; i <= n; i++) {
        double from[3] = {0};
        for (uint32_t d = 0; d < c->dim; d++) {
            double middle = cells_round(c, 0.5 * (lo[d] + end[d]));
            bool upper = i >> d & 1, lower = !upper && i < n;
            from[d] = lower ? lo[d] : middle;
            batch_set(b, SLT_IN_H0 + d, i, upper ? end[d] : middle);
        }
        batch_set_x(b, i, from);
    }
    c->hunted += n + 1;
    cells_call(c, SLT_K_BOUNDS, n + 1);
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        double low = HUGE_VAL, high = -HUGE_VAL, kept = 0, rounding = 0;
        if (!(f[2 * ch + 1] - f[2 * ch] < HUGE_VAL)) continue;
        for (uint32_t i = 0; i <= n; i++) {
            double lo_f = batch_get(b, SLT_OUT_F_LO, ch, i), hi_f = batch_get(b, SLT_OUT_F_HI, ch, i);
            rounding = hi_f - lo_f; /* in the end of the middle */
            if (i < n) low = smaller(low, lo_f), high = larger(high, hi_f), kept = larger(kept, rounding);
        }
        double range = high - low; /* f[] may be that of a larger box */
        if (range > VARIES * larger(fabs(low), fabs(high)) && kept > KEEPS * range && range > LOOSER * rounding)
            return true;
    }
    return false;
}

static bool may_hunt(const Cells *c) {
    return !c->lists.any && !c->prunes && !c->o->trial && c->hunted <= HUNT + (c->b->evaluations - c->began) / 4;
}

bool cells_hides_peak(Cells *c, const Smooth *s, const Spot *first, const Spot *end) {
    if (!may_hunt(c) || !is_suspect(c, s->f, first, end, NULL, NULL, c->o->grid[0] > 0 ? LOOSER : LOOSE)) return false;
    if (!is_steep(c, s->lo, s->end, s->f)) return false;
    c->hunted += 2 * (uint64_t)(end - first);
    return true;
}

void cells_state_hidden(Cells *c, const Smooth *s, const Spot *first, const Spot *end) {
    double section = 1, shortest = HUGE_VAL;
    if (!may_hunt(c) || !is_suspect(c, s->f, first, end, NULL, NULL, LOOSER) || !is_steep(c, s->lo, s->end, s->f))
        return;
    for (uint32_t d = 0; d < c->dim; d++)
        section *= s->end[d] - s->lo[d], shortest = smaller(shortest, s->end[d] - s->lo[d]);
    for (uint32_t ch = 0; ch < c->s->channels; ch++)
        c->counts->upset_jump[ch] += (s->f[2 * ch + 1] - s->f[2 * ch]) * section / shortest;
}

/* The box of part i of a piece: between curve i - 1 and curve i, away from both. False: there is hardly any. */
static bool part_box(Cells *c, const Piece *p, const Column *from, const Column *to, uint32_t i, double lo[3],
                     double hi[3]) {
    const Box *box = &c->cell[p->cell].box;
    double least = box->lo[p->axis], most = box->end[p->axis];
    memcpy(lo, box->lo, sizeof box->lo), memcpy(hi, box->hi, sizeof box->hi);
    if (p->base >= 0) lo[p->base] = p->at[p->base][0], hi[p->base] = p->at[p->base][1];
    for (const Column *k = from; k < to; k++) {
        double ends[CELL_EDGES + 1];
        uint32_t n = cells_part_ends(c, k, ends);
        if (i >= n) return false;
        if (i) least = larger(least, ends[i - 1]);
        if (i + 1 < n) most = smaller(most, ends[i]);
    }
    /* Columns are not at the ends of the base. */
    lo[p->axis] = least, hi[p->axis] = most;
    for (uint32_t set = p->present, e; p->base >= 0 && cells_take_edge(&set, &e);) {
        const PieceEdge *edge = &p->edge[e];
        double half = 0.5 * (hi[p->base] - lo[p->base]), climb = edge->dg[p->base] / edge->dg[p->axis];
        double reach = 1.25 * fabs(climb) * half;
        if (!(reach < HUGE_VAL)) return false;
        if (edge->height < 0.5 * (least + most)) lo[p->axis] = larger(lo[p->axis], edge->height + reach);
        else hi[p->axis] = smaller(hi[p->axis], edge->height - reach);
    }
    lo[p->axis] = cells_next(c, cells_round(c, lo[p->axis]), HUGE_VAL);
    hi[p->axis] = cells_next(c, cells_round(c, hi[p->axis]), -HUGE_VAL);
    return hi[p->axis] - lo[p->axis] > 0x1p-6 * (box->end[p->axis] - box->lo[p->axis]);
}

/* A box beside curves. */
typedef struct Beside {
    bool near; /* next to one */
    double lo[3], hi[3], f[2 * SLT_MAX_CHANNELS];
} Beside;

/* Those beside the curves of a piece, in as many parts as its columns are cut in, of which bounds of the cell do not
 * tell that points have met what there is. How many. */
static uint32_t suspects(Cells *c, const Piece *p, const Column *from, const Column *to, const Spot *first,
                         const Spot *end, Beside *box, uint32_t room) {
    uint32_t n = 0, parts = (uint32_t)__builtin_popcount(p->present) + 1;
    Beside whole;
    for (uint32_t i = 0; i < parts; i++) {
        if (!part_box(c, p, from, to, i, whole.lo, whole.hi)) continue;
        double length = whole.hi[p->axis] - whole.lo[p->axis];
        for (uint32_t k = 0; k < p->parts && n < room; k++) {
            Beside *b = &box[n];
            *b = whole, b->near = (k == 0 && i > 0) || (k + 1 == p->parts && i + 1 < parts);
            double begin = cells_part_begins(p, k), past = cells_part_begins(p, k + 1);
            if (k) b->lo[p->axis] = cells_round(c, whole.lo[p->axis] + begin * length);
            if (k + 1 < p->parts) b->hi[p->axis] = cells_round(c, whole.lo[p->axis] + past * length);
            n += is_suspect(c, c->cell[p->cell].f, first, end, b->lo, b->hi, LOOSE);
        }
    }
    return n;
}

Hidden cells_hides_beside(Cells *c, const Piece *p, const Column *from, const Column *to, const Spot *first,
                          const Spot *end) {
    enum { MOST = 32 };
    Batch *b = c->b;
    Beside box[MOST];
    if (c->dim > 2 || !may_hunt(c)) return HIDES_NOTHING;
    uint32_t n = suspects(c, p, from, to, first, end, box, MOST), kept = 0;
    if (!n) return HIDES_NOTHING;
    for (uint32_t i = 0; i < n; i++) {
        batch_set_x(b, i, box[i].lo);
        for (uint32_t d = 0; d < c->dim; d++) batch_set(b, SLT_IN_H0 + d, i, box[i].hi[d]);
    }
    c->hunted += n;
    cells_call(c, SLT_K_BOUNDS, n);
    for (uint32_t i = 0; i < n; i++) {
        if (batch_get_int(b, SLT_OUT_OPEN, 0, i) || batch_get_int(b, SLT_OUT_BOX_STATE, 0, i)) continue;
        Beside *k = &box[kept];
        *k = box[i];
        for (uint32_t ch = 0; ch < c->s->channels; ch++)
            k->f[2 * ch] = batch_get(b, SLT_OUT_F_LO, ch, i), k->f[2 * ch + 1] = batch_get(b, SLT_OUT_F_HI, ch, i);
        kept += is_suspect(c, k->f, first, end, k->lo, k->hi, LOOSE);
    }
    for (uint32_t i = 0; i < kept; i++)
        if (is_steep(c, box[i].lo, box[i].hi, box[i].f)) {
            c->hunted += (uint64_t)(end - first);
            return box[i].near && c->dim > 1 ? HIDES_NEAR : HIDES_AWAY;
        }
    return HIDES_NOTHING;
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
