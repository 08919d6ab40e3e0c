/* What rounding makes of roots. g as computed is a little off g without rounding, and places are floats: a curve lies
 * by so much elsewhere than its roots, which changes its length, its slopes, and where one piece of it ends and the
 * next begins. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

/* What rounding makes of a root, in parts of its bound and of its size: little or much, by chance. What all roots of a
 * closed curve do alike may cancel. */
static const double moved[2][2] = {{0.25, 0x1p-24}, {1.25, 0x1.4p-22}};

static bool by_chance(const double x[3]) {
    uint64_t bits[3], all;
    memcpy(bits, x, sizeof bits);
    all = (bits[0] * 3 + bits[1] * 5 + bits[2] * 7) * 0x9e3779b97f4a7c15u;
    return (all ^ all >> 29) * 0xbf58476d1ce4e5b9u >> 63;
}

/* In f32 rounding moves roots by more than rules err: those of the coarse rule go as far as it may to where g > 0, so
 * that the distance of the two rules tells what comes of it. */
static bool move_roots(Cells *c, const Column *from, const Column *to) {
    c->nprobe = 0;
    for (int pass = 0; pass < 2; pass++) {
        const Probe *at = c->probe;
        for (const Column *k = from; k < to; k++)
            for (uint32_t i = 0; i < k->nroots && k->rule == CELL_COARSE; i++) {
                Root *r = &c->root[k->first + i];
                double x[3], slope = fabs(r->dg[r->axis]), error = larger(r->of->error, fabs(r->g));
                if (!r->wanted || !(slope > 0)) continue;
                if (pass) {
                    memcpy(r->x, at->x, sizeof r->x), memcpy(r->dg, at->dg, sizeof r->dg);
                    at++;
                    continue;
                }
                memcpy(x, r->x, sizeof x);
                const double *by = moved[by_chance(x)];
                double far = larger(by[0] * error / slope, by[1] * fabs(x[r->axis]));
                double to = cells_round(c, x[r->axis] + (r->rises > 0 ? far : -far));
                x[r->axis] = smaller(larger(to, r->ends_at[0]), r->ends_at[1]);
                if (!cells_probe(c, r->of, x)) return false;
            }
        if (!pass && !cells_run_probes(c)) return false;
    }
    return true;
}

/* In f32 the site's own slope at a root, as rounded, is not that of the edge, which is a level of a wave: what it is
 * divided by is rounded likewise. */
static bool take_own_slopes(Cells *c, const Column *from, const Column *to) {
    c->nprobe = 0;
    for (const Column *k = from; k < to; k++)
        for (uint32_t i = k->first; i < k->first + k->nroots; i++)
            if (c->root[i].wanted && cells_is_wave(c->s, c->root[i].of->event.site) &&
                !cells_probe(c, c->root[i].of, c->root[i].x))
                return false;
    if (!cells_run_site_probes(c)) return false;
    const Probe *at = c->probe;
    for (const Column *k = from; k < to; k++)
        for (uint32_t i = k->first; i < k->first + k->nroots; i++) {
            Root *r = &c->root[i];
            if (r->wanted && cells_is_wave(c->s, r->of->event.site)) memcpy(r->dg, (at++)->dg, sizeof r->dg);
        }
    return true;
}

/* ---- what that does to a curve */
#define USUAL 0.25 /* of the bound of what g rounds by, which assumes the worst and is doubled, */
#define APART 0.25 /* and of that again where two cells look for one place: they meet much the same roundings */
#define SHORT 0x1p-11 /* of a piece: where curves meet rounding is told of those that it may change by more */
#define MUCH 0x1p-5 /* likewise: and it is none of many that may cancel */
#define WHOLE 0x1p-11 /* likewise: where curves meet so flatly the bound is met, as all that is there is rounded alike */
#define BENT 4.0 /* more than slopes may vary in a cell, in parts: then bounds of them are loose */

/* How far from the root the curve may lie: by what g rounds, and by what is left of it where places end. */
static double place_error(const Root *r, double steep) { return (USUAL * r->of->error + fabs(r->g)) / steep; }

/* Over a root's gradient: 1 / the least length on which the normal turns, or g steepens, in the cell. */
static double bend_of(const Cells *c, const CellEdge *e, double width, double steep) {
    double change = 0;
    for (uint32_t d = 0; d < c->dim; d++) change = larger(change, e->slope[d][1] - e->slope[d][0]);
    return smaller(change / steep, BENT) / width;
}

/* How long a piece of the base is on which two cells, of which the curve leaves the one and enters the other, may
 * disagree; k: the column that is next to that end. */
static double end_error(const Cells *c, const Piece *p, uint32_t edge, const Column *k) {
    double length = p->at[p->base][1] - p->at[p->base][0];
    for (uint32_t i = k->first; i < k->first + k->nroots; i++) {
        const Root *r = &c->root[i];
        double half = (c->b->f64 ? 0x1p-53 : 0x1p-24) * fabs(r->x[p->base]);
        if (r->edge == edge) return smaller(APART * place_error(r, fabs(r->dg[p->base])) + half, 0.5 * length);
    }
    return 0;
}

/* The same of any other end, which is a float, and where curves meet, as the tangents there tell. */
static double meeting_error(const Cells *c, const Piece *p, int end) {
    double length = p->at[p->base][1] - p->at[p->base][0];
    double unit = (c->b->f64 ? 0x1p-52 : 0x1p-23) * fabs(p->at[p->base][end]);
    double spread = p->meet[end] ? p->spread[end] : 0;
    return smaller((spread > WHOLE * length ? 1 : USUAL) * spread + unit, 0.5 * length); /* NaN is not */
}

static const Root *root_of(const Cells *c, const Column *k, uint32_t edge) {
    for (uint32_t i = k->first; i < k->first + k->nroots; i++)
        if (c->root[i].edge == edge) return &c->root[i];
    return NULL;
}

/* How long the part at the end of a piece is on which rounding hides in which order two curves lie, which come nearer
 * to each other towards that end: `last` is the column that is next to it, and `before` the one before. */
static double hidden_end(const Cells *c, const Piece *p, int end, const Column *last, const Column *before,
                         const uint32_t edge[2]) {
    const Root *r[2] = {root_of(c, last, edge[0]), root_of(c, last, edge[1])};
    const Root *s[2] = {root_of(c, before, edge[0]), root_of(c, before, edge[1])};
    if (!r[0] || !r[1] || !s[0] || !s[1]) return 0;
    double near = fabs(r[0]->x[p->axis] - r[1]->x[p->axis]), far = fabs(s[0]->x[p->axis] - s[1]->x[p->axis]);
    double opens = (far - near) / fabs(before->x[p->base] - last->x[p->base]);
    double rest = fabs(last->x[p->base] - p->at[p->base][end]), at_end = larger(near - opens * rest, 0);
    double noise = USUAL * (r[0]->of->error / fabs(r[0]->dg[p->axis]) + r[1]->of->error / fabs(r[1]->dg[p->axis]));
    return opens > 0 && noise > at_end ? (noise - at_end) / opens : 0; /* NaN is not */
}

/* Of each edge of a piece, in parts of its base; more: where it is much. */
static void find_end_errors(const Cells *c, const Piece *p, const Column *from, const Column *to, double *error,
                            double *more) {
    for (uint32_t e = 0; e < CELL_EDGES; e++) error[e] = more[e] = 0;
    if (p->base < 0) return;
    double length = p->at[p->base][1] - p->at[p->base][0];
    while (to > from + 1 && to[-1].rule == CELL_COARSE) to--;
    for (int end = 0; end < 2; end++) {
        const Column *last = end ? to - 1 : from, *before = end ? to - 2 : from + 1;
        if (p->leaving[end] >= 0) error[p->leaving[end]] += end_error(c, p, (uint32_t)p->leaving[end], last) / length;
        double meets = p->within[end] ? 0 : meeting_error(c, p, end) / length;
        uint32_t set = p->meet[end] ? p->meet[end] : p->present, e;
        while (meets > SHORT && cells_take_edge(&set, &e)) (meets > MUCH ? more : error)[e] += meets;
        for (uint32_t i = 1; i < last->nroots && to > from + 1; i++)
            for (uint32_t j = 0; j < i; j++) {
                const uint32_t edge[2] = {c->root[last->first + i].edge, c->root[last->first + j].edge};
                double hidden = smaller(hidden_end(c, p, end, last, before, edge) / length, 0.5);
                double *by = hidden > MUCH ? more : error;
                if (hidden > SHORT) by[edge[0]] += hidden, by[edge[1]] += hidden;
            }
    }
}

/* width: of the longest side of the cell. */
static void blur_root(Cells *c, const Column *k, Root *r, double width, double ends) {
    double steep = 0, most = 0;
    for (uint32_t d = 0; d < c->dim; d++) steep += r->dg[d] * r->dg[d];
    steep = sqrt(steep);
    if (!r->wanted || !(steep > 0)) return;
    /* Bounds may know nothing of how g rounds (`pow` near 0): yet the root is on its line. */
    double line = (r->ends_at[1] - r->ends_at[0]) * fabs(r->dg[r->axis]) / steep;
    double place = smaller(place_error(r, steep), line), weight = k->weight / fabs(r->dg[r->axis]) * steep;
    double bent = place * bend_of(c, r->of, width, steep);
    if (!(bent < HUGE_VAL)) return;
    r->blur = bent + ends;
    if (k->rule == CELL_COARSE) return;
    const Sides *s = cells_sides(c, r);
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        double jump = fabs(s->f[1][ch] - s->f[0][ch]);
        c->counts->moved[ch] += weight * place * jump, most = larger(most, jump);
    }
    c->counts->weighed += weight * most, c->counts->blurred += weight * most * bent;
}

/* All of a piece by the same chance; but what a short one is off by much is by none, for of two of them, the ends of a
 * thin band, chance would often make nothing. */
static void blur_piece(Cells *c, const Column *from, const Column *to) {
    const Piece *p = &c->piece[from->piece];
    const Box *box = &c->cell[p->cell].box;
    double ends[CELL_EDGES], more[CELL_EDGES], middle[3] = {0}, width = 0;
    find_end_errors(c, p, from, to, ends, more);
    for (uint32_t d = 0; d < c->dim; d++) width = larger(width, box->end[d] - box->lo[d]);
    for (uint32_t d = 0; d < c->dim; d++) middle[d] = p->at[d][0] + p->at[d][1];
    double sign = by_chance(middle) ? -1 : 1;
    for (const Column *k = from; k < to; k++)
        for (uint32_t i = k->first; i < k->first + k->nroots; i++) {
            blur_root(c, k, &c->root[i], width, ends[c->root[i].edge]);
            c->root[i].blur = sign * c->root[i].blur + more[c->root[i].edge];
        }
}

/* Of the two ends of an arc: how long they may be, in parts of its base. */
static double ends_of_arc(const Piece *p, const CellEdge *e, const ArcPoint *a, uint32_t n) {
    double length = p->at[p->base][1] - p->at[p->base][0], error = 0;
    for (int end = 0; end < 2 && n; end++) {
        if (p->leaving[end] != (int8_t)p->only) continue;
        const ArcPoint *at = end ? a + n - 1 : a;
        double half = 0x1p-53 * fabs(at->x[p->base]), off = APART * USUAL * e->error / fabs(at->dg[p->base]);
        error += smaller(off + half, 0.5 * length) / length;
    }
    return error;
}

/* The same as blur_piece, of points at which g is 0. */
void cells_round_arc(Cells *c, const Piece *p, const Arc *arc) {
    const Cell *cell = &c->cell[p->cell];
    const CellEdge *e = &cell->edge[p->only];
    const Sides *s = cells_sides_of(c, &p->edge[p->only]);
    ArcPoint *a = &c->arc_point[arc->first];
    double high = cell->box.hi[p->axis] - cell->box.lo[p->axis], middle[3] = {0}, change = 0, width = 0;
    double ends = ends_of_arc(p, e, a, arc->n[CELL_FINE]), most = 0, length = 0, moved = 0, bends = 0;
    for (uint32_t d = 0; d < 2; d++) {
        change = larger(change, e->slope[d][1] - e->slope[d][0]);
        width = larger(width, cell->box.end[d] - cell->box.lo[d]), middle[d] = p->at[d][0] + p->at[d][1];
    }
    const double sign = by_chance(middle) ? -1 : 1;
    for (uint32_t i = 0; i < arc->n[CELL_FINE] + arc->n[CELL_COARSE]; i++, a++) {
        double up = fabs(a->dg[p->axis]), steep = sqrt(a->dg[0] * a->dg[0] + a->dg[1] * a->dg[1]);
        double off = smaller(USUAL * e->error, high * up);
        double bent = off / steep * smaller(change / steep, BENT) / width, weight = a->weight / up;
        if (!(bent < HUGE_VAL)) continue;
        if (i >= arc->n[CELL_FINE]) a->weight *= 1 + sign * (bent + ends);
        else length += weight * steep, moved += weight * off, bends += weight * steep * bent;
    }
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        double jump = fabs(s->f[1][ch] - s->f[0][ch]);
        c->counts->moved[ch] += moved * jump, most = larger(most, jump);
    }
    c->counts->weighed += length * most, c->counts->blurred += bends * most;
}

bool cells_round_roots(Cells *c, const Column *from, const Column *to) {
    if (!c->b->f64 && c->rule[CELL_COARSE].n && !move_roots(c, from, to)) return false;
    if (!c->b->f64 && c->waves && !take_own_slopes(c, from, to)) return false;
    for (const Column *end; from < to; from = end) {
        end = from + 1;
        while (end < to && end->piece == from->piece) end++;
        blur_piece(c, from, end);
    }
    return true;
}

/* ---- and to the parts between curves */
/* How far along its line the curve may be from a root; where it may be anywhere on it, no farther. */
static double off_along(const Root *r) {
    return smaller(place_error(r, fabs(r->dg[r->axis])), r->ends_at[1] - r->ends_at[0]);
}

void cells_moved_parts(const Cells *c, const Column *k, double longer[CELL_EDGES + 1]) {
    for (uint32_t i = 0; i <= k->nroots; i++) longer[i] = 0;
    for (uint32_t i = 0; i < k->nroots && !c->b->f64; i++) {
        const Root *root = &c->root[k->first], *r = &root[i];
        if (!r->wanted || !r->sides) continue;
        const Sides *s = cells_sides(c, r);
        double jump = 0, off = off_along(r), at = r->x[r->axis];
        uint32_t below = 0; /* the part that ends at the root */
        for (uint32_t ch = 0; ch < c->s->channels; ch++) jump += s->f[1][ch] - s->f[0][ch];
        for (uint32_t j = 0; j < k->nroots; j++) {
            double other = root[j].x[r->axis];
            below += other < at || (other == at && j < i);
        }
        if (jump < 0 || (!(jump > 0) && below & 1)) off = -off;
        if (!(fabs(off) < HUGE_VAL)) continue;
        longer[below] += off, longer[below + 1] -= off;
    }
}
