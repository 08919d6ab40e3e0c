/* Steps: f that climbs so steeply, away from curves, that points of both rules lie before and behind it alone. They
 * agree on the integral of f, nearly, and see nothing of its derivative. Bounds tell: of boxes on which f is smooth,
 * and of the parts of curved cells between their curves. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

enum {
    LOOSE = 8,     /* bounds beyond what was met, by this factor: worth a closer look. */
    LOOSER = 64,   /* of a pixel, which has the bounds of its cell */
    HUNT = 1 << 14 /* evaluations of a tile for that, at first */
};
#define VARIES 0x1p-6 /* part of f: by so much it may vary unseen */
#define KEEPS 0.8     /* part of the range of f on a box that a small part of the box keeps where f is steep */

/* What places of a box have met, by channel. */
typedef struct Met {
    double f[2][SLT_MAX_CHANNELS];
    uint32_t between[SLT_MAX_CHANNELS]; /* how often f was in the middle half of that */
} Met;

static void meet(const Cells *c, Met *m, const double *f) {
    for (uint32_t ch = 0; ch < c->s->channels; ch++)
        m->f[0][ch] = smaller(m->f[0][ch], f[ch]), m->f[1][ch] = larger(m->f[1][ch], f[ch]);
}

static void begin_to_meet(const Cells *c, Met *m) {
    for (uint32_t ch = 0; ch < c->s->channels; ch++)
        m->f[0][ch] = HUGE_VAL, m->f[1][ch] = -HUGE_VAL, m->between[ch] = 0;
}

/* Once all are met. */
static void count_between(const Cells *c, Met *m, const double *f) {
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        double quarter = 0.25 * (m->f[1][ch] - m->f[0][ch]);
        m->between[ch] += f[ch] > m->f[0][ch] + quarter && f[ch] < m->f[1][ch] - quarter;
    }
}

/* By more than a small part of what f is here, and by any of what it is elsewhere? */
static bool varies(const Cells *c, double low, double high) {
    double tiny = c->b->f64 ? 0x1p-24 : 0x1p-14;
    return high - low > larger(VARIES * larger(fabs(low), fabs(high)), tiny * c->most);
}

/* May f be steep in the box, with bounds f[], where points do not tell? They have met less than bounds allow; or what f
 * is before a step and behind it, and hardly anything between: then its integral is about right, and derivatives know
 * nothing of the step. */
static bool is_suspect(const Cells *c, const double *f, const Met *m, double loose) {
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        double low = f[2 * ch], high = f[2 * ch + 1], range = m->f[1][ch] - m->f[0][ch];
        if (!(high - low < HUGE_VAL) || !(range >= 0)) continue;
        if (high - low > loose * range && varies(c, low, high)) return true;
        if (varies(c, m->f[0][ch], m->f[1][ch]) && m->between[ch] < CELL_CLIMBING) return true;
    }
    return false;
}

static Met met_by(const Cells *c, const Spot *first, const Spot *end) {
    Met m;
    begin_to_meet(c, &m);
    for (const Spot *p = first; p < end; p++) meet(c, &m, p->f);
    for (const Spot *p = first; p < end; p++) count_between(c, &m, p->f);
    return m;
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
        if (varies(c, low, high) && kept > KEEPS * range && range > LOOSER * rounding) return true;
    }
    return false;
}

/* Bounds of any box may be asked where none need lists or chunks of their own. */
bool cells_may_ask(const Cells *c) { return !c->lists.any && !c->prunes && !c->o->trial; }

static bool may_hunt(const Cells *c) {
    return cells_may_ask(c) && c->hunted <= HUNT + (c->b->evaluations - c->began) / 4;
}

bool cells_doubts(Cells *c, const Smooth *s, const Spot *first, const Spot *end) {
    Met met = met_by(c, first, end);
    return cells_may_ask(c) && is_suspect(c, s->f, &met, c->o->grid[0] > 0 ? LOOSER : LOOSE);
}

bool cells_hides_peak(Cells *c, const Smooth *s, const Spot *first, const Spot *end) {
    if (!may_hunt(c)) return false;
    Met met = met_by(c, first, end);
    /* A pixel has the bounds of its cell. */
    if (!is_suspect(c, s->f, &met, c->o->grid[0] > 0 ? LOOSER : LOOSE) || !is_steep(c, s->lo, s->end, s->f))
        return false;
    c->hunted += 2 * (uint64_t)(end - first);
    return true;
}

/* The section of a box for a step in it; 0 of a box between two curves that meet in one float. */
static double section_of(const Cells *c, const Smooth *s, double *side) {
    double measure = 1;
    *side = HUGE_VAL;
    for (uint32_t d = 0; d < c->dim; d++) measure *= s->end[d] - s->lo[d], *side = smaller(*side, s->end[d] - s->lo[d]);
    return *side > 0 ? measure / *side : 0;
}

void cells_state_hidden(Cells *c, const Smooth *s, const Spot *first, const Spot *end, bool agree) {
    double side, section = section_of(c, s, &side);
    if (!cells_may_ask(c)) return;
    Met met = met_by(c, first, end);
    bool doubt = is_suspect(c, s->f, &met, LOOSER);
    for (uint32_t ch = 0; ch < c->s->channels && !agree; ch++) doubt |= varies(c, met.f[0][ch], met.f[1][ch]);
    if (!doubt || !is_steep(c, s->lo, s->end, s->f)) return;
    for (uint32_t ch = 0; ch < c->s->channels; ch++)
        c->counts->upset_jump[ch] += (s->f[2 * ch + 1] - s->f[2 * ch]) * section;
}

#define OFTEN 0.125 /* of rounding, what of it is left when points add up */

void cells_state_rounding(Cells *c, const Smooth *s, const Spot *first, const Spot *end) {
    double side, section = section_of(c, s, &side), far = 0;
    if (c->b->f64 || !(section > 0)) return;
    for (uint32_t d = 0; d < c->dim; d++) far = larger(far, larger(fabs(s->lo[d]), fabs(s->end[d])));
    double part = OFTEN * 0x1p-24 * far / side;
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        double met[2] = {HUGE_VAL, -HUGE_VAL};
        for (const Spot *p = first; p < end; p++) met[0] = smaller(met[0], p->f[ch]), met[1] = larger(met[1], p->f[ch]);
        if (met[1] > met[0]) c->counts->upset_jump[ch] += (met[1] - met[0]) * section * part;
    }
}

/* How many curves of a piece are below a place: those are nearly straight, or the piece would be cut. */
static uint32_t part_of(const Piece *p, const double x[3]) {
    uint32_t below = 0;
    for (uint32_t set = p->present, e; cells_take_edge(&set, &e);) {
        const PieceEdge *edge = &p->edge[e];
        double h = edge->height;
        if (p->base >= 0)
            h -= edge->dg[p->base] / edge->dg[p->axis] * (x[p->base] - 0.5 * (p->at[p->base][0] + p->at[p->base][1]));
        below += h < x[p->axis];
    }
    return below;
}

/* A part of a piece, between curves, and a box in it that no curve touches. */
typedef struct Part {
    double lo[3], hi[3];
    Met met;
} Part;

/* Sets the boxes of all parts; of those that have hardly any hi < lo along the axis. */
static void part_boxes(Cells *c, const Piece *p, const Column *from, const Column *to, Part *part, uint32_t parts) {
    const Box *box = &c->cell[p->cell].box;
    const int axis = p->axis, base = p->base;
    for (uint32_t i = 0; i < parts; i++) {
        memcpy(part[i].lo, box->lo, sizeof box->lo), memcpy(part[i].hi, box->hi, sizeof box->hi);
        if (base >= 0) part[i].lo[base] = p->at[base][0], part[i].hi[base] = p->at[base][1];
    }
    for (const Column *k = from; k < to; k++) {
        double ends[CELL_EDGES + 1], climb = 0;
        uint32_t n = cells_part_ends(c, k, ends);
        for (uint32_t i = 0; base >= 0 && i < k->nroots; i++) {
            const Root *r = &c->root[k->first + i];
            climb = larger(climb, fabs(r->dg[base] / r->dg[axis]));
        }
        /* As far as the column is from the end of the base a curve climbs on. */
        double reach = base < 0 ? 0 : 1.5 * climb * smaller(p->at[base][1] - k->x[base], k->x[base] - p->at[base][0]);
        for (uint32_t i = 0; i + 1 < n && i + 1 < parts; i++) {
            part[i].hi[axis] = smaller(part[i].hi[axis], ends[i] - reach);
            part[i + 1].lo[axis] = larger(part[i + 1].lo[axis], ends[i] + reach);
        }
    }
    for (uint32_t i = 0; i < parts; i++) {
        part[i].lo[axis] = cells_next(c, cells_round(c, part[i].lo[axis]), HUGE_VAL);
        part[i].hi[axis] = cells_next(c, cells_round(c, part[i].hi[axis]), -HUGE_VAL);
    }
}

/* What the spots of each part have met, and the sides of the curves beside it. */
static void meet_parts(Cells *c, const Piece *p, const Column *from, const Column *to, const Spot *first,
                       const Spot *end, Part *part, uint32_t parts) {
    for (uint32_t i = 0; i < parts; i++) begin_to_meet(c, &part[i].met);
    for (const Spot *s = first; s < end; s++) meet(c, &part[part_of(p, s->x)].met, s->f);
    for (const Column *k = from; k < to; k++)
        for (uint32_t i = 0; i < k->nroots; i++) {
            const Root *r = &c->root[k->first + i];
            if (!r->sides || r->twin || r->band) continue;
            for (uint32_t up = 0; up < 2 && i + up < parts; up++) meet(c, &part[i + up].met, cells_sides(c, r)->f[up]);
        }
    for (const Spot *s = first; s < end; s++) count_between(c, &part[part_of(p, s->x)].met, s->f);
}

/* A part of a piece that is to be asked about, and what bounds of its box say. */
struct Beside {
    uint32_t piece;
    bool steep; /* may be */
    Part part;
    double f[2 * SLT_MAX_CHANNELS];
};

bool cells_ask_beside(Cells *c, uint32_t i, const Column *from, const Column *to) {
    const Piece *p = &c->piece[i];
    const Cell *cell = &c->cell[p->cell];
    Part part[CELL_EDGES + 1];
    const uint32_t parts = (uint32_t)__builtin_popcount(p->present) + 1;
    if (c->dim > 2 || !may_hunt(c)) return true;
    part_boxes(c, p, from, to, part, parts);
    meet_parts(c, p, from, to, c->spot + p->spots[0], c->spot + p->spots[1], part, parts);
    double least = 0x1p-6 * (cell->box.end[p->axis] - cell->box.lo[p->axis]);
    for (uint32_t k = 0; k < parts; k++) {
        if (!(part[k].hi[p->axis] - part[k].lo[p->axis] > least)) continue;
        if (!is_suspect(c, cell->f, &part[k].met, LOOSE)) continue;
        if (!CELLS_ROOM(c, beside, 1)) return false;
        c->beside[c->nbeside++] = (struct Beside){.piece = i, .part = part[k]};
    }
    return true;
}

/* Bounds of the boxes of beside[0 .. n). */
static void bound_beside(Cells *c, struct Beside *beside, uint32_t n) {
    Batch *b = c->b;
    for (uint32_t i = 0; i < n; i++) {
        batch_set_x(b, i, beside[i].part.lo);
        for (uint32_t d = 0; d < c->dim; d++) batch_set(b, SLT_IN_H0 + d, i, beside[i].part.hi[d]);
    }
    c->hunted += n;
    cells_call(c, SLT_K_BOUNDS, n);
    for (uint32_t i = 0; i < n; i++) {
        double *f = beside[i].f;
        for (uint32_t ch = 0; ch < c->s->channels; ch++)
            f[2 * ch] = batch_get(b, SLT_OUT_F_LO, ch, i), f[2 * ch + 1] = batch_get(b, SLT_OUT_F_HI, ch, i);
        bool settled = !batch_open(b, i) && !batch_get_int(b, SLT_OUT_BOX_STATE, 0, i);
        beside[i].steep = settled && is_suspect(c, f, &beside[i].part.met, LOOSE);
    }
}

void cells_find_hidden(Cells *c) {
    for (uint32_t from = 0; from < c->nbeside; from += BATCH)
        bound_beside(c, c->beside + from, c->nbeside - from < BATCH ? c->nbeside - from : BATCH);
    for (uint32_t i = 0; i < c->nbeside; i++) {
        const struct Beside *b = &c->beside[i];
        Piece *p = &c->piece[b->piece];
        if (p->hides || !b->steep || !is_steep(c, b->part.lo, b->part.hi, b->f)) continue;
        p->hides = true, c->hunted += p->spots[1] - p->spots[0];
    }
    c->nbeside = 0;
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
