/* Do the two rules agree on the curves of a piece? */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

/* What rounding or a singularity keeps apart would be cut without end. */
enum { PIECE_STEEP = 4, PIECE_HALVINGS = 24, PIECE_PARTS = 1024, CELL_CUTS = 512 };

static void middle(const Cells *c, const Piece *p, double x[3]) {
    for (uint32_t d = 0; d < c->dim; d++) x[d] = 0.5 * (p->at[d][0] + p->at[d][1]);
}

static double length_of(const Piece *p) { return p->base < 0 ? 0 : p->at[p->base][1] - p->at[p->base][0]; }

static void add_moments(const Cells *c, const Sides *s, const double by[4], double sum[SLT_MAX_CHANNELS][4],
                        double *most, double *total) {
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        double jump = s->f[1][ch] - s->f[0][ch];
        *most = larger(*most, fabs(jump)), *total += by[0] * fabs(jump);
        for (uint32_t d = 0; d <= c->dim; d++) sum[ch][d] += jump * by[d];
    }
}

/* The integral of |jump| along the curve that the rule gives, by channel, and its moments in the position on the piece.
 * The length of the curve's element is that of the tangent in the middle times (d_k g there) / d_k g: what the
 * derivatives of the integral are made of. */
static void measure_curve(const Cells *c, const Piece *p, const Column *from, const Column *to, uint32_t edge,
                          bool alike, double sum[CELL_RULES][SLT_MAX_CHANNELS][4], double *most, double *total) {
    double moment[CELL_RULES][4] = {{0}}; /* where f jumps by as much all along the curve */
    const PieceEdge *e = &p->edge[edge];
    double mid[3] = {0}, half[3] = {1, 1, 1}, tangent = 1;
    middle(c, p, mid);
    if (p->base >= 0) {
        half[p->base] = 0.5 * (p->at[p->base][1] - p->at[p->base][0]);
        tangent += e->dg[p->base] * e->dg[p->base] / (e->dg[p->axis] * e->dg[p->axis]);
    }
    mid[p->axis] = e->height;
    half[p->axis] = 0.5 * (c->cell[p->cell].box.end[p->axis] - c->cell[p->cell].box.lo[p->axis]);
    tangent = sqrt(tangent);
    for (const Column *k = from; k < to; k++)
        for (uint32_t i = 0; i < k->nroots; i++) {
            const Root *r = &c->root[k->first + i];
            if (r->edge != edge) continue;
            double w = k->weight * tangent * fabs(e->dg[p->axis] / r->dg[p->axis]), by[4] = {w};
            for (uint32_t d = 0; d < c->dim; d++) by[1 + d] = w * (r->x[d] - mid[d]) / half[d];
            if (alike)
                for (uint32_t d = 0; d <= c->dim; d++) moment[k->rule][d] += by[d];
            else add_moments(c, cells_sides(c, r), by, sum[k->rule], most, total);
        }
    for (int r = 0; r < CELL_RULES && alike; r++)
        add_moments(c, &c->sides[e->sides - 1], moment[r], sum[r], most, total);
}

void cells_note_bend(const Cells *c, Piece *p, double apart) {
    uint32_t coarse = cells_rule_of(c, p, CELL_COARSE)->n;
    double floor = c->b->f64 ? 0x1p-40 : 0x1p-16; /* what rounding may make of it, moments of thin pieces included */
    double most = powf((float)larger(apart, floor), 0.5f / (float)coarse) / length_of(p);
    p->bend = apart > floor || !(c->bend > 0) ? most : smaller(0.5 * c->bend, most);
}

/* Do the rules agree on the curves of a piece? Sets its bend. alike: f is taken to jump by as much as in the middle. */
static bool curves_agree(const Cells *c, Piece *p, const Column *from, const Column *to, bool alike) {
    double apart = 0;
    bool agree = true;
    for (uint32_t set = p->present, e; cells_take_edge(&set, &e);) {
        double sum[CELL_RULES][SLT_MAX_CHANNELS][4], most = 0, total = 0;
        if (!p->edge[e].open) continue;
        for (int r = 0; r < CELL_RULES; r++) memset(sum[r], 0, c->s->channels * sizeof *sum[r]);
        measure_curve(c, p, from, to, e, alike, sum, &most, &total);
        double least = larger(c->o->tolerance * most * c->width, cells_rounding(c) * total);
        for (uint32_t ch = 0; ch < c->s->channels; ch++)
            for (uint32_t m = 0; m <= c->dim; m++) {
                double d = fabs(sum[CELL_FINE][ch][m] - sum[CELL_COARSE][ch][m]);
                agree &= d <= least;
                if (total > 0) apart = larger(apart, d / total);
            }
    }
    if (p->base >= 0) cells_note_bend(c, p, apart);
    return agree;
}

static bool is_last(Cells *c, const Piece *p) {
    return p->halvings >= PIECE_HALVINGS || p->parts >= (c->dim > 1 ? PIECE_PARTS / 16 : PIECE_PARTS) ||
           c->cell[p->cell].cuts >= CELL_CUTS || cells_spent(c);
}

void cells_drop_bent(Cells *c, uint32_t first, uint32_t n) {
    bool may = !c->o->fixed && !c->o->flat && c->rule[CELL_COARSE].n && c->dim == 2;
    for (uint32_t i = 0; i < n; i++) {
        Piece *p = &c->piece[first + i];
        const Column *from = &c->column[c->first_column[i]], *to = &c->column[c->first_column[i + 1]];
        p->last = c->dim < 3 && is_last(c, p); /* pieces of solids are not cut */
        p->agrees = !may || p->last || p->arc || p->base < 0 || curves_agree(c, p, from, to, true);
        if (p->agrees || from == to) continue;
        for (uint32_t r = from->first, end = to[-1].first + to[-1].nroots; r < end; r++)
            c->root[r].wanted = false, c->root[r].tie = 0;
    }
}

void cells_compare_curves(Cells *c, uint32_t first, uint32_t n, bool compare) {
    for (uint32_t i = 0; i < n; i++) {
        Piece *p = &c->piece[first + i];
        const Column *from = &c->column[c->first_column[i]], *to = &c->column[c->first_column[i + 1]];
        p->smooth = true;
        if (!p->agrees) continue;
        if (compare && p->arc) p->agrees = cells_arc_agrees(c, p, &p->smooth);
        else if (compare && c->dim > 1) p->agrees = curves_agree(c, p, from, to, c->o->flat);
        if (compare && p->alone && !p->arc) p->smooth = cells_borders_agree(c, p, from, to);
    }
}
