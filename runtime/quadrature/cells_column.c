/* Pieces of the base become columns at Gauss points, and these roots, crossings and points of the volume. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

/* ---- what goes out */
static void flush_points(Cells *c, CellRule r) {
    uint32_t n = c->npoint[r];
    c->npoint[r] = 0;
    if (n) c->sink->volume(c->sink->user, c->point[r], n, r, &c->within);
}

void cells_emit_point(Cells *c, const double x[3], double weight, CellRule rule) {
    if (c->npoint[rule] == BATCH) flush_points(c, rule);
    CellPoint *p = &c->point[rule][c->npoint[rule]++];
    memcpy(p->x, x, sizeof p->x);
    p->weight = weight;
}

static void flush_crossings(Cells *c) {
    uint32_t n = c->ncrossing;
    c->ncrossing = 0;
    if (n) c->sink->curve(c->sink->user, c->crossing, n);
}

void cells_flush(Cells *c) {
    flush_crossings(c);
    for (int r = 0; r < CELL_RULES; r++) flush_points(c, (CellRule)r);
}

/* ---- columns */
static Column *add_column(Cells *c, uint32_t piece, uint8_t rule, const double x[3], double weight) {
    if (!CELLS_ROOM(c, column, 1)) return NULL;
    Column *k = &c->column[c->ncolumn++];
    *k = (Column){.piece = piece, .rule = rule, .weight = weight, .first = c->nroot};
    for (uint32_t d = 0; d < c->dim; d++) k->x[d] = cells_round(c, x[d]);
    return k;
}

/* The root of an edge in the column that was added last; the search begins at `guess`. */
static bool add_root(Cells *c, Column *k, uint32_t edge, double guess) {
    const Piece *p = &c->piece[k->piece];
    const Cell *cell = &c->cell[p->cell];
    Root *r = cells_root(c, cell, &cell->edge[edge], p->axis, k->x, guess);
    if (!r) return false;
    r->column = (uint32_t)(k - c->column), r->edge = (uint8_t)edge;
    k->nroots++;
    return true;
}

/* ---- pieces */
/* Bit by edge: those whose curve is asked for along this axis. */
static uint32_t asked(const Cells *c, const Piece *p) {
    const Cell *cell = &c->cell[p->cell];
    uint32_t bits = 0;
    for (uint32_t e = 0; e < cell->nedges; e++)
        if (cell->edge[e].axis == p->axis && (c->o->volume || (uint32_t)cell->edge[e].event.site < c->s->nsites))
            bits |= 1u << e;
    return bits;
}

static void middle(const Cells *c, const Piece *p, double x[3]) {
    for (uint32_t d = 0; d < c->dim; d++) x[d] = 0.5 * (p->at[d][0] + p->at[d][1]);
}

/* Which curves are there: g has different signs at the two ends of the column above the middle. */
static bool find_present(Cells *c, uint32_t first) {
    c->nprobe = 0;
    for (uint32_t i = first; i < c->npiece; i++) {
        Piece *p = &c->piece[i];
        const Cell *cell = &c->cell[p->cell];
        double x[3] = {0};
        middle(c, p, x);
        p->present = asked(c, p);
        for (uint32_t e = 0; e < cell->nedges; e++)
            for (int s = 0; s < 2 && p->present >> e & 1; s++) {
                x[p->axis] = s ? cell->box.hi[p->axis] : cell->box.lo[p->axis];
                if (!cells_probe(c, &cell->edge[e].event, x)) return false;
            }
    }
    if (!cells_run_probes(c)) return false;
    const Probe *at = c->probe;
    for (uint32_t i = first; i < c->npiece; i++) {
        Piece *p = &c->piece[i];
        for (uint32_t e = 0; e < CELL_EVENTS; e++) {
            if (!(p->present >> e & 1)) continue;
            double up = c->cell[p->cell].edge[e].rises[p->axis];
            if (!(up * at[0].g <= 0 && up * at[1].g >= 0)) p->present &= ~(1u << e);
            at += 2;
        }
    }
    return true;
}

static bool is_site(const Cells *c, const Piece *p, uint32_t e) {
    return (uint32_t)c->cell[p->cell].edge[e].event.site < c->s->nsites;
}

/* Curves that lie on each other, as far as rounding lets one tell, are one: a condition that is asked twice, an edge
 * that two shapes share. The first site stands for all of them; the jump there is that of all together. */
static void find_twins(Cells *c, const Column *k) {
    Piece *p = &c->piece[k->piece];
    const Cell *cell = &c->cell[p->cell];
    double width = cell->box.end[p->axis] - cell->box.lo[p->axis];
    double size = fmax(fabs(cell->box.lo[p->axis]), fabs(cell->box.hi[p->axis]));
    for (uint32_t i = 1; i < k->nroots; i++)
        for (uint32_t j = 0; j < i; j++) {
            Root *r = &c->root[k->first + i], *s = &c->root[k->first + j];
            if (!(p->present >> r->edge & 1) || !(p->present >> s->edge & 1)) continue;
            double error = 2 * cell->edge[r->edge].error / fabs(r->dg[p->axis]) +
                           2 * cell->edge[s->edge].error / fabs(s->dg[p->axis]);
            double same = fmin(error + size * (c->b->f64 ? 0x1p-49 : 0x1p-21), 0x1p-16 * width);
            if (!(fabs(r->x[p->axis] - s->x[p->axis]) <= same)) continue;
            bool later = is_site(c, p, s->edge) || !is_site(c, p, r->edge);
            p->present &= ~(1u << (later ? r->edge : s->edge));
            (later ? s : r)->twin = true;
        }
}

/* The column above the middle of each piece: where the curves are there, and which of them change the region. */
static bool look_at_middles(Cells *c, uint32_t first) {
    c->ncolumn = c->nroot = 0;
    for (uint32_t i = first; i < c->npiece; i++) {
        const Piece *p = &c->piece[i];
        double x[3] = {0};
        middle(c, p, x);
        Column *k = add_column(c, i, CELL_FINE, x, 0);
        if (!k) return false;
        for (uint32_t e = 0; e < CELL_EVENTS; e++)
            if (p->present >> e & 1 && !add_root(c, k, e, NAN)) return false;
    }
    if (!cells_solve(c)) return false;
    for (uint32_t i = 0; i < c->ncolumn; i++) find_twins(c, &c->column[i]);
    for (uint32_t i = 0; i < c->nroot; i++) {
        Root *r = &c->root[i];
        if (!(c->piece[c->column[r->column].piece].present >> r->edge & 1)) continue;
        r->wanted = c->o->curves && is_site(c, &c->piece[c->column[r->column].piece], r->edge);
    }
    if (!cells_take_sides(c)) return false;
    for (uint32_t i = 0; i < c->nroot; i++) {
        const Root *r = &c->root[i];
        Piece *p = &c->piece[c->column[r->column].piece];
        PieceEdge *e = &p->edge[r->edge];
        if (!(p->present >> r->edge & 1)) continue;
        e->twin = r->twin, e->height = r->x[p->axis];
        for (uint32_t d = 0; d < c->dim; d++) e->slope[d] = -r->dg[d] / r->dg[p->axis];
        e->open = r->wanted && r->hash[0] != r->hash[1];
        if (!e->open && !c->o->volume) p->present &= ~(1u << r->edge);
    }
    return true;
}

/* The columns of a piece and rule: in 1D the one there is, else at Gauss points of the base. */
static bool add_columns(Cells *c, uint32_t piece, CellRule rule) {
    const GaussRule *g = &c->rule[rule];
    uint32_t n[3] = {1, 1, 1};
    if (!g->n) return true;
    for (uint32_t d = 0; d < c->dim; d++)
        if (d != (uint32_t)c->piece[piece].axis) n[d] = g->n;
    for (uint32_t z = 0; z < n[2]; z++)
        for (uint32_t y = 0; y < n[1]; y++)
            for (uint32_t i = 0; i < n[0]; i++) {
                const Piece *p = &c->piece[piece];
                const uint32_t at[3] = {i, y, z};
                double x[3] = {0}, mid[3] = {0}, weight = 1;
                middle(c, p, mid);
                for (uint32_t d = 0; d < c->dim; d++) {
                    if (d == (uint32_t)p->axis) continue;
                    x[d] = p->at[d][0] + g->x[at[d]] * (p->at[d][1] - p->at[d][0]);
                    weight *= g->w[at[d]] * (p->at[d][1] - p->at[d][0]);
                }
                Column *k = add_column(c, piece, (uint8_t)rule, x, weight);
                if (!k) return false;
                for (uint32_t e = 0; e < CELL_EVENTS; e++) {
                    if (!(p->present >> e & 1)) continue;
                    double height = p->edge[e].height;
                    for (uint32_t d = 0; d < c->dim; d++)
                        if (d != (uint32_t)p->axis) height += p->edge[e].slope[d] * (x[d] - mid[d]);
                    if (!add_root(c, k, e, height)) return false;
                    c->root[c->nroot - 1].twin = p->edge[e].twin;
                }
            }
    return true;
}

static void emit_crossing(Cells *c, const Root *r) {
    const Column *k = &c->column[r->column];
    uint32_t below = r->rises > 0 ? 0 : 1; /* the side where g < 0 */
    if (c->ncrossing == BATCH) flush_crossings(c);
    Crossing *x = &c->crossing[c->ncrossing++];
    memset(x, 0, sizeof *x);
    x->event = *r->event;
    memcpy(x->x, r->x, sizeof x->x), memcpy(x->dg, r->dg, sizeof x->dg);
    x->g = r->g;
    x->weight = k->weight / fabs(r->dg[r->axis]);
    for (uint32_t ch = 0; ch < c->s->channels; ch++)
        x->before[ch] = r->f[below][ch], x->jump[ch] = r->f[!below][ch] - r->f[below][ch];
    x->ha = r->hash[below], x->hb = r->hash[!below];
    x->axis = r->axis, x->rising = 1, x->cls = k->rule;
}

/* Gauss points on a column, between one root and the next. */
static void fill_column(Cells *c, const Column *k) {
    const Piece *p = &c->piece[k->piece];
    const Box *box = &c->cell[p->cell].box;
    const GaussRule *g = &c->rule[k->rule];
    double x[3], from = box->lo[p->axis], heights[CELL_EVENTS + 1];
    uint32_t n = 0;
    for (uint32_t i = 0; i < k->nroots; i++) {
        double h = c->root[k->first + i].x[p->axis];
        uint32_t at = n++;
        for (; at && heights[at - 1] > h; at--) heights[at] = heights[at - 1];
        heights[at] = h;
    }
    heights[n++] = box->end[p->axis];
    memcpy(x, k->x, sizeof x);
    for (uint32_t i = 0; i < n; from = heights[i++])
        for (uint32_t q = 0; q < g->n && heights[i] > from; q++) {
            x[p->axis] = from + g->x[q] * (heights[i] - from);
            cells_emit_point(c, x, k->weight * g->w[q] * (heights[i] - from), (CellRule)k->rule);
        }
}

bool cells_integrate(Cells *c) {
    if (!c->npiece) return true;
    if (!find_present(c, 0) || !look_at_middles(c, 0)) return false;
    c->ncolumn = c->nroot = 0;
    for (uint32_t i = 0; i < c->npiece; i++)
        for (int r = 0; r < CELL_RULES; r++)
            if ((c->piece[i].present || c->o->volume) && !add_columns(c, i, (CellRule)r)) return false;
    if (!cells_solve(c)) return false;
    for (uint32_t i = 0; i < c->nroot; i++)
        c->root[i].wanted = c->piece[c->column[c->root[i].column].piece].edge[c->root[i].edge].open;
    if (!cells_take_sides(c)) return false;
    for (uint32_t i = 0; i < c->ncolumn; i++) {
        const Column *k = &c->column[i];
        for (uint32_t r = 0; r < k->nroots; r++)
            if (c->root[k->first + r].wanted) emit_crossing(c, &c->root[k->first + r]);
        if (c->o->volume) fill_column(c, k);
    }
    return true;
}
