/* Events whose g others change.
 *
 * The g of an event may jump, or bend, on the curves of others that are open in the cell too. Then it has an edge for
 * each way in which these decide: with their decisions given (variant_given.c) g is smooth, in all of the cell, and the
 * edge is a curve like any other. Where the others decide so, and there alone, it is the g of the program. So what it
 * has on the other side of their curves drops out, piece by piece, and pieces end at these curves as they do where any
 * two meet.
 *
 * All points at which the event may change are found: inside a part of the cell in which the others decide alike, on
 * the edge for that; between two parts, on the curve of another event. That one must be integrated: through a seam a g
 * may bend, but it must not jump. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

/* What becomes of an edge if one more event is given: two asks, or one where the sign of that event's g is known. */
typedef struct Trial {
    uint32_t cell, edge, ways;
    CellEdge way[2];
} Trial;

bool cells_are_levels(const Event *e, const Event *f) {
    return e->site == f->site && e->boundary != f->boundary && !memcmp(e->k, f->k, sizeof e->k);
}

bool cells_contradict(const CellEdge *e, const CellEdge *f) {
    if (!e->given.n && !f->given.n) return cells_are_levels(&e->event, &f->event); /* of one function */
    for (uint32_t i = 0; i < e->given.n; i++)
        for (uint32_t j = 0; j < f->given.n; j++)
            if (e->given.is[i].event == f->given.is[j].event && e->given.is[i].below != f->given.is[j].below)
                return true;
    return event_same(&e->event, &f->event);
}

/* ---- which events are given */
static bool is_given(const CellEdge *e, uint32_t event) {
    for (uint32_t i = 0; i < e->given.n; i++)
        if (e->given.is[i].event == event) return true;
    return false;
}

static bool is_rounding(const Cells *c, int32_t site) {
    if ((uint32_t)site >= c->s->nedges || !c->s->edge_kind) return false;
    return c->s->edge_kind[site] >= SLT_SITE_FLOOR && c->s->edge_kind[site] <= SLT_SITE_FMOD;
}

/* May the boundary of a rounding be given? Its number takes the place of the last index, and where there are others in
 * the cell two signs do not tell what the integer is. */
static bool may_give_boundary(const Cell *cell, uint32_t event) {
    const Event *f = &cell->event[event];
    for (uint32_t i = 0; i < cell->nevents; i++)
        if (cells_are_levels(&cell->event[i], f)) return false;
    return !f->k[SLT_GIVEN_K - 1] && fabs(f->boundary) < 0x1p30;
}

/* May this event be given to the edge? In deep loops kernels cannot. */
static bool may_give(const Cells *c, const Cell *cell, const CellEdge *e, uint32_t event) {
    const Event *f = &cell->event[event];
    if (is_given(e, event) || event_same(f, &e->event)) return false;
    bool choice = (uint32_t)f->site >= c->s->nedges;
    bool rounds = is_rounding(c, f->site),
         compares = !c->s->edge_kind || choice || c->s->edge_kind[f->site] == SLT_SITE_COMPARE;
    if (!compares && !(rounds && may_give_boundary(cell, event))) return false;
    for (uint32_t d = SLT_GIVEN_K; d < c->depth; d++)
        if (f->k[d]) return false;
    bool site = (uint32_t)f->site < c->s->nsites;
    return site || cell->sign[event] || !(e->state & SLT_EDGE_JUMPS);
}

/* The last one before the edge that may be given, for what comes last overrides what came before; false: there is none,
 * or no need. */
static bool next_event(const Cells *c, const Cell *cell, CellEdge *e, uint32_t *event) {
    if (!(e->state & (SLT_EDGE_JUMPS | SLT_EDGE_BENDS))) return false;
    if (e->given.n == (c->prunes ? CELL_GIVEN : SLT_GIVEN)) return false;
    while (e->before > 0)
        if (may_give(c, cell, e, --e->before)) {
            *event = e->before;
            return true;
        }
    return false;
}

static CellEdge with_given(const Cells *c, const Cell *cell, const CellEdge *e, uint32_t event, bool below) {
    CellEdge way = *e;
    uint32_t n = way.given.n++;
    const Event *f = &cell->event[event];
    way.given.is[n].site = f->site, way.given.is[n].event = (uint8_t)event, way.given.is[n].below = below;
    for (uint32_t d = 0; d < SLT_GIVEN_K; d++) way.given.is[n].k[d] = f->k[d];
    if (is_rounding(c, f->site)) way.given.is[n].k[SLT_GIVEN_K - 1] = (int32_t)floor(f->boundary);
    return way;
}

/* ---- trials */
static bool add_trials(Cells *c, Cell *cell, uint32_t n) {
    c->ntrial = 0;
    for (uint32_t i = 0; i < n; i++) {
        if (cell[i].refine || cell[i].done) continue;
        for (uint32_t e = 0; e < cell[i].nedges; e++) {
            uint32_t event;
            if (!next_event(c, &cell[i], &cell[i].edge[e], &event)) continue;
            if (!CELLS_ROOM(c, trial, 1)) return false;
            int sign = cell[i].sign[event];
            Trial *t = &c->trial[c->ntrial++];
            *t = (Trial){.cell = i, .edge = e, .ways = sign ? 1 : 2};
            t->way[0] = with_given(c, &cell[i], &cell[i].edge[e], event, sign <= 0);
            if (!sign) t->way[1] = with_given(c, &cell[i], &cell[i].edge[e], event, false);
        }
    }
    return true;
}

static bool ask_trials(Cells *c, const Cell *cell) {
    c->nask = 0;
    for (uint32_t i = 0; i < c->ntrial; i++) {
        const Trial *t = &c->trial[i];
        const Box *box = &cell[t->cell].box;
        for (uint32_t w = 0; w < t->ways; w++)
            if (!cells_ask(c, &t->way[w], box->lo, box->hi)) return false;
    }
    return cells_run_asks_about_centres(c);
}

static bool differs(const CellEdge *e, const CellEdge *f) {
    return e->state != f->state || memcmp(e->g, f->g, sizeof e->g) || memcmp(e->slope, f->slope, sizeof e->slope);
}

/* ---- iterations that nowhere in the cell are the nearest
 *
 * Of a loop that keeps the iteration with the least key (SltScene.edge_argmin) all that is left in the end is the one
 * that took over last. One that is that nowhere in the cell can be left out, be it that it never takes over, or that a
 * later one always does so after it. Ways tell. A key that is refused by what was kept without others, or by one of
 * these, is refused by what was kept with them, which is less. And one by which an iteration takes over even if another
 * one has just done so, and nobody between, shows that this other one is never the last. */

static int taking_over(const Cells *c, const Event *e) {
    return c->s->edge_argmin && (uint32_t)e->site < c->s->nedges ? c->s->edge_argmin[e->site] : 0;
}

/* The event of the cell that such a way shows to be of no account; -1: none. */
static int left_out(const Cells *c, const Cell *cell, const CellEdge *way) {
    int takes = taking_over(c, &way->event), sign = way->g[0] > 0 ? 1 : way->g[1] < 0 ? -1 : 0, last = -1;
    uint32_t taken = 0;
    if (!takes || !sign) return -1;
    for (uint32_t i = 0; i < way->given.n; i++) {
        uint32_t event = way->given.is[i].event;
        bool same = cell->event[event].site == way->event.site;
        if (!same && !cell->sign[event]) return -1; /* its own key may hang on that */
        if (same && way->given.is[i].below == (takes < 0)) taken++, last = (int)event;
    }
    if (sign == takes) return taken == 1 ? last : -1;
    for (uint32_t i = 0; i < cell->nevents; i++)
        if (event_same(&cell->event[i], &way->event)) return (int)i;
    return -1;
}

/* Drops the edges of the event, and those of others where it takes over. */
static void leave_out(const Cells *c, Cell *cell, uint32_t event) {
    int takes = taking_over(c, &cell->event[event]);
    uint32_t kept = 0;
    cell->sign[event] = (int8_t)-takes;
    for (uint32_t e = 0; e < cell->nedges; e++) {
        const CellEdge *edge = &cell->edge[e];
        bool drop = event_same(&edge->event, &cell->event[event]);
        for (uint32_t i = 0; i < edge->given.n; i++)
            drop |= edge->given.is[i].event == event && edge->given.is[i].below == (takes < 0);
        if (drop) continue;
        if (kept != e) cell->edge[kept] = *edge;
        kept++;
    }
    cell->nedges = kept;
}

/* The ways take the place of the edge, but for those of which bounds prove that they have no curve in the cell. */
static void put_ways(Cell *cell, const Trial *t) {
    const CellEdge *edge = &cell->edge[t->edge];
    CellEdge open[2];
    uint32_t n = 0;
    bool same = true;
    for (uint32_t w = 0; w < t->ways; w++) {
        const CellEdge *way = &t->way[w];
        same &= !differs(way, edge);
        if (way->g[0] > 0 || way->g[1] < 0) continue;
        open[n] = *way;
        /* What was passed over because the edge jumps may be given now. */
        if (edge->state & ~way->state & SLT_EDGE_JUMPS) open[n].before = (uint8_t)cell->nevents;
        n++;
    }
    if (same || cell->nedges - 1 + n > CELL_EDGES) return;
    memmove(&cell->edge[t->edge + n], &cell->edge[t->edge + 1], (cell->nedges - t->edge - 1) * sizeof *cell->edge);
    memcpy(&cell->edge[t->edge], open, n * sizeof *open);
    cell->nedges = cell->nedges - 1 + n;
}

bool cells_give(Cells *c, Cell *cell, uint32_t n) {
    if (!c->prunes && !(c->s->layout[SLT_K_EDGE_BOUNDS].reads >> SLT_IN_GIVEN0 & 1)) return true;
    for (;;) {
        if (!add_trials(c, cell, n)) return false;
        if (!c->ntrial) return true;
        if (!ask_trials(c, cell)) return false;
        const Ask *a = c->ask;
        for (uint32_t i = 0; i < c->ntrial; i++)
            for (uint32_t w = 0; w < c->trial[i].ways; w++) cells_meet(c, &c->trial[i].way[w], a++);
        /* From the last to the first: edges that are put in move those behind. */
        for (uint32_t i = c->ntrial; i-- > 0;) put_ways(&cell[c->trial[i].cell], &c->trial[i]);
        for (uint32_t i = 0; i < c->ntrial && c->s->edge_argmin; i++)
            for (uint32_t w = 0; w < c->trial[i].ways; w++) {
                Cell *of = &cell[c->trial[i].cell];
                int event = left_out(c, of, &c->trial[i].way[w]);
                if (event >= 0) leave_out(c, of, (uint32_t)event);
            }
    }
}

/* ---- where it holds what is given */
double cells_nearly_0(const Cells *c, const Box *box, double error, const double dg[3]) {
    double slope = 0, size = 0, width = 0;
    for (uint32_t d = 0; d < c->dim; d++) {
        slope = larger(slope, fabs(dg[d]));
        size = larger(size, larger(fabs(box->lo[d]), fabs(box->hi[d])));
        width += box->end[d] - box->lo[d];
    }
    return smaller(2 * error + slope * size * (c->b->f64 ? 0x1p-48 : 0x1p-20), cells_reach(c->b->f64) * slope * width);
}

static double error_of(const Cell *cell, uint32_t event) {
    double error = 0;
    for (uint32_t e = 0; e < cell->nedges; e++)
        if (event_same(&cell->edge[e].event, &cell->event[event])) error = larger(error, cell->edge[e].error);
    return error;
}

/* Does the sign that is given differ from place to place in the cell? */
static bool must_hold(const Cell *cell, const CellEdge *e, uint32_t i) { return !cell->sign[e->given.is[i].event]; }

/* The edge of given i of e that has nothing else given than e has, and is a quadric; NULL: there is none. */
static const CellEdge *quadric_of_given(const Cell *cell, const CellEdge *e, uint32_t i) {
    for (uint32_t o = 0; o < cell->nedges; o++) {
        const CellEdge *f = &cell->edge[o];
        bool fits = f->quadric.is && event_same(&f->event, &cell->event[e->given.is[i].event]);
        for (uint32_t j = 0; fits && j < f->given.n; j++) {
            bool has = false;
            for (uint32_t k = 0; k < e->given.n; k++)
                has |= e->given.is[k].event == f->given.is[j].event && e->given.is[k].below == f->given.is[j].below;
            fits = has;
        }
        if (fits) return f;
    }
    return NULL;
}

/* g of given i of the curve at its root. With what else is given: where that does not hold, the curve is dropped all
 * the same. */
static Probe *probe_given(Cells *c, const Cell *cell, const Root *r, uint32_t i) {
    const CellEdge *f = quadric_of_given(cell, r->of, i);
    return f ? cells_probe_or_tell(c, f, r->x) : cells_probe_event(c, &cell->event[r->of->given.is[i].event], r->x);
}

bool cells_drop_wrong(Cells *c) {
    c->nprobe = 0;
    for (uint32_t i = 0; i < c->nroot; i++) {
        const Root *r = &c->root[i];
        const Cell *cell = &c->cell[c->piece[c->column[r->column].piece].cell];
        for (uint32_t j = 0; j < r->of->given.n; j++)
            if (must_hold(cell, r->of, j) && !probe_given(c, cell, r, j)) return false;
    }
    if (!cells_run_probes(c)) return false;
    const Probe *p = c->probe;
    for (uint32_t i = 0; i < c->nroot; i++) {
        const Root *r = &c->root[i];
        Piece *piece = &c->piece[c->column[r->column].piece];
        const Cell *cell = &c->cell[piece->cell];
        for (uint32_t j = 0; j < r->of->given.n; j++) {
            if (!must_hold(cell, r->of, j)) continue;
            double beyond = r->of->given.is[j].below ? p->g : -p->g;
            if (beyond > 0 && /* by more than rounding */
                beyond > cells_nearly_0(c, &cell->box, error_of(cell, r->of->given.is[j].event), p->dg))
                piece->present &= ~(1u << r->edge);
            p++;
        }
    }
    return true;
}
