/* Choices between two values that are the same all over a cell, but for rounding: `max(a, b)` of two distances to one
 * edge. Bounds never see which is the larger, and need not: either will do. For the derivatives that is so where the
 * two move alike; where they do not g has a kink there in the parameters, which cells_kinks.c looks for. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

#define SYMMETRIC 0x1p-6

bool cells_is_bend(const Cells *c, int32_t edge) {
    if ((uint32_t)edge >= c->s->nedges) return true; /* a choice of a straight-line program */
    return c->s->edge_bends && c->s->edge_bends[edge];
}

/* Do bounds see its value change in the cell? */
static bool moves(const Cells *c, const CellEdge *e) {
    bool any = false;
    for (uint32_t d = 0; d < c->dim; d++) any |= e->slope[d][0] != 0 || e->slope[d][1] != 0;
    return any;
}

/* Of the difference of two values that come about alike bounds reach as far below 0 as above; of one that is next to 0
 * at most places and large at few, as `exp(1e8 * d) - 0`, they do not. */
static bool is_symmetric(const double ends[2]) {
    return ends[0] <= 0 && ends[1] >= 0 && fabs(ends[0] + ends[1]) <= SYMMETRIC * (ends[1] - ends[0]);
}

bool cells_may_be_same(const Cells *c, const CellEdge *e, double centre) {
    if (!cells_is_bend(c, e->event.site) || e->state & SLT_EDGE_JUMPS) return false;
    if (!moves(c, e)) return true;
    if (e->state & SLT_EDGE_BENDS) return false; /* places tell nothing of those between them */
    bool flat = true;
    for (uint32_t d = 0; d < c->dim; d++)
        flat &= c->prunes ? e->slope[d][0] <= 0 && e->slope[d][1] >= 0 : is_symmetric(e->slope[d]);
    return flat && fabs(centre) <= 2 * e->error;
}

static bool is_asked(const Cells *c, const Cell *cell, const CellEdge *e) {
    return !cell->refine && !cell->done && e->same && moves(c, e);
}

/* A place near a corner. The corners themselves are round numbers, where a wave may be 0 by chance. */
static void near_corner(const Cells *c, const Box *box, uint32_t k, double x[3]) {
    static const double aside[3] = {0.0937, 0.0711, 0.0523};
    memset(x, 0, 3 * sizeof *x);
    for (uint32_t d = 0; d < c->dim; d++) {
        double by = c->prunes ? 0 : aside[d] * (1 + 0.37 * k) * (box->hi[d] - box->lo[d]);
        x[d] = cells_round(c, k >> d & 1 ? box->hi[d] - by : box->lo[d] + by);
    }
}

/* Of a distance that is taken twice bounds do not see that the difference has no slope: places are to tell. */
static bool ask_places(Cells *c, Cell *cell, uint32_t n) {
    uint32_t corners = 1u << c->dim;
    c->nprobe = 0;
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t e = 0; e < cell[i].nedges; e++)
            for (uint32_t k = 0; k < corners && is_asked(c, &cell[i], &cell[i].edge[e]); k++) {
                double x[3];
                near_corner(c, &cell[i].box, k, x);
                if (!cells_probe(c, &cell[i].edge[e], x)) return false;
            }
    if (!cells_run_probes(c)) return false;
    const Probe *p = c->probe;
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t e = 0; e < cell[i].nedges; e++) {
            CellEdge *edge = &cell[i].edge[e];
            if (!is_asked(c, &cell[i], edge)) continue;
            uint32_t below = 0, above = 0;
            for (uint32_t k = 0; k < corners; k++, p++) {
                edge->same &= fabs(p->g) <= 2 * edge->error;
                below += p->g < 0, above += p->g > 0;
            }
            edge->sense = below == corners ? -1 : above == corners ? 1 : 0;
        }
    return true;
}

static void close_same(const Cells *c, Cell *cell) {
    uint32_t kept = 0, open = 0;
    for (uint32_t e = 0; e < cell->nedges; e++) {
        const CellEdge *edge = &cell->edge[e];
        if (edge->same) { /* its two sides differ by nothing but rounding: either will do */
            cell->sign[edge->before] = edge->sense < 0 ? -1 : 1, cell->same |= 1ull << edge->before;
            continue;
        }
        open += (uint32_t)edge->event.site >= c->s->nedges;
        if (kept != e) cell->edge[kept] = *edge;
        kept++;
    }
    cell->nedges = kept;
    cell->refine |= open > CELL_CHOICES;
}

bool cells_close_same(Cells *c, Cell *cell, uint32_t n) {
    bool any = c->prunes;
    for (uint32_t i = 0; i < n && !any; i++)
        for (uint32_t e = 0; e < cell[i].nedges; e++) any |= cell[i].edge[e].same;
    if (!any) return true;
    if (!ask_places(c, cell, n)) return false;
    for (uint32_t i = 0; i < n; i++)
        if (!cell[i].refine && !cell[i].done) close_same(c, &cell[i]);
    return true;
}
