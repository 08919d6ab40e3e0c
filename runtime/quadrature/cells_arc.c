/* Arcs: pieces of one curve whose g is a quadric, with f constant on both its sides. All there is to know of one comes
 * from a closed form and two colours, with no column and no root: of overlapping discs most points lie on such. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

static bool may_be_arc(const Cells *c, const Piece *p) {
    if (!p->alone || p->base < 0 || p->graded || !c->b->f64 || !(p->present >> p->only & 1)) return false;
    const PieceEdge *e = &p->edge[p->only];
    const Cell *cell = &c->cell[p->cell];
    return cell->edge[p->only].quadric.is && cell->slice < 0 && e->open && e->sides && !e->twin && !e->band &&
           !e->tie && !e->upset;
}

/* The curve above a place of the base. False: it is not in the cell there, be it by rounding. */
static bool find_point(const Cell *cell, const CellEdge *e, int base, int axis, ArcPoint *a) {
    const Quadric *q = &e->quadric;
    double along = a->x[base] - q->x[base], g = q->g + q->dg[base] * along, slope = q->dg[axis], by;
    a->dg[base] = q->dg[base], a->dg[axis] = slope;
    if (q->flat) by = -g / slope;
    else {
        g += 0.5 * q->bend[base][base] * along * along, slope += q->bend[base][axis] * along;
        a->dg[axis] = e->rises[axis] * sqrt(slope * slope - 2 * q->bend[axis][axis] * g);
        by = -2 * g / (slope + a->dg[axis]);
        a->dg[base] += q->bend[base][base] * along + q->bend[base][axis] * by;
    }
    a->x[axis] = q->x[axis] + by;
    return a->x[axis] >= cell->box.lo[axis] && a->x[axis] <= cell->box.hi[axis]; /* NaN is not */
}

/* The integral along the curve, in parts of the tangent in the middle (cells_column.c), its moments in the position on
 * the piece, and what it adds to the area below it. */
static void add_sums(const Cells *c, const Piece *p, Arc *arc) {
    const Cell *cell = &c->cell[p->cell];
    const PieceEdge *e = &p->edge[p->only];
    const int base = p->base, axis = p->axis, across = cell->border_axis;
    const double middle = 0.5 * (p->at[base][0] + p->at[base][1]), climb = e->dg[base] / e->dg[axis];
    const double tangent = sqrt(1 + climb * climb) * fabs(e->dg[axis]);
    const double wide = 2 / (p->at[base][1] - p->at[base][0]), high = 2 / (cell->box.end[axis] - cell->box.lo[axis]);
    const ArcPoint *a = &c->arc_point[arc->first];
    for (int r = 0; r < CELL_RULES; r++) {
        double length = 0, along = 0, up = 0, area = 0, size = 0;
        for (uint32_t i = 0; i < arc->n[r]; i++, a++) {
            double w = a->weight * tangent / fabs(a->dg[axis]);
            double normal = across == axis ? 1 : a->dg[across] / a->dg[axis];
            double part = a->weight * (a->x[across] - cell->box.lo[across]) * normal;
            length += w, along += w * (a->x[base] - middle), up += w * (a->x[axis] - e->height);
            area += part, size += fabs(part);
        }
        arc->moment[r][0] = length, arc->moment[r][1] = along * wide, arc->moment[r][2] = up * high;
        arc->area[r] = area, arc->size += size;
    }
}

bool cells_add_arc(Cells *c, Piece *p, bool *is) {
    *is = false, p->arc = 0;
    if (!may_be_arc(c, p)) return true;
    const Cell *cell = &c->cell[p->cell];
    if (!CELLS_ROOM(c, arc, 1) || !CELLS_ROOM(c, arc_point, 2 * GAUSS_MAX)) return false;
    Arc *arc = &c->arc[c->narc];
    *arc = (Arc){.first = c->narc_point};
    double length = p->at[p->base][1] - p->at[p->base][0];
    for (int r = 0; r < CELL_RULES; r++) {
        const GaussRule *g = cells_rule_of(c, p, (CellRule)r);
        ArcPoint *a = &c->arc_point[c->narc_point];
        arc->n[r] = g->n, c->narc_point += g->n;
        for (uint32_t i = 0; i < g->n; i++, a++) {
            double pace = 1, at = p->turn > 0 ? cells_along_base(p, g->x[i], &pace) : g->x[i];
            a->x[p->base] = p->at[p->base][0] + at * length, a->weight = cell->weight * g->w[i] * pace * length;
            if (!find_point(cell, &cell->edge[p->only], p->base, p->axis, a)) {
                c->narc_point = arc->first;
                return true;
            }
        }
    }
    add_sums(c, p, arc);
    p->arc = ++c->narc;
    return *is = true;
}

bool cells_arc_agrees(const Cells *c, Piece *p, bool *areas) {
    const Arc *arc = &c->arc[p->arc - 1];
    const Sides *s = cells_sides_of(c, &p->edge[p->only]);
    double most = 0, total = 0, apart = 0;
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        double jump = fabs(s->f[1][ch] - s->f[0][ch]);
        most = larger(most, jump), total += jump;
    }
    total *= arc->moment[CELL_FINE][0] + arc->moment[CELL_COARSE][0];
    for (int m = 0; m < 3; m++)
        apart = larger(apart, most * fabs(arc->moment[CELL_FINE][m] - arc->moment[CELL_COARSE][m]));
    cells_note_bend(c, p, total > 0 ? apart / total : 0);
    *areas = fabs(arc->area[CELL_FINE] - arc->area[CELL_COARSE]) <=
             larger(c->o->tolerance * c->volume, cells_part_noise(c, arc->size));
    return apart <= larger(c->o->tolerance * most * c->width, cells_rounding(c) * total);
}

void cells_emit_arc(Cells *c, const Piece *p) {
    const Arc *arc = &c->arc[p->arc - 1];
    const CellEdge *edge = &c->cell[p->cell].edge[p->only];
    const Sides *s = cells_sides_of(c, &p->edge[p->only]);
    const uint32_t below = edge->rises[p->axis] > 0 ? 0 : 1; /* the side where g < 0 */
    const ArcPoint *a = &c->arc_point[arc->first];
    cells_round_arc(c, p, arc);
    for (int r = 0; r < CELL_RULES; r++)
        for (uint32_t i = 0; i < arc->n[r]; i++, a++) {
            Crossing *x = cells_add_crossing(c, (uint8_t)r);
            x->event = edge->event;
            for (uint32_t d = 0; d < 2; d++) x->x[d] = a->x[d], x->dg[d] = a->dg[d];
            for (uint32_t ch = 0; ch < c->s->channels; ch++)
                x->before[ch] = s->f[below][ch], x->jump[ch] = s->f[!below][ch] - s->f[below][ch];
            x->g = 0, x->ha = s->hash[below], x->hb = s->hash[!below];
            x->axis = p->axis, x->rising = 1;
            x->weight = a->weight / fabs(a->dg[p->axis]);
        }
    cells_add_borders(c, p, arc->area, arc->size);
}
