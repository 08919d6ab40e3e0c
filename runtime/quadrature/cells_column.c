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

/* The root of an edge in the column that was added last; it starts from the height that the middle of the piece
 * foretells. */
static bool add_root(Cells *c, Column *k, uint32_t edge, double guess) {
    if (!CELLS_ROOM(c, root, 1)) return false;
    const Piece *p = &c->piece[k->piece];
    const Box *box = &c->cell[p->cell].box;
    Root *r = &c->root[c->nroot++];
    memset(r, 0, sizeof *r);
    r->column = (uint32_t)(k - c->column), r->edge = (uint8_t)edge;
    r->lo = box->lo[p->axis], r->hi = box->hi[p->axis];
    r->x = cells_round(c, guess > r->lo && guess < r->hi ? guess : 0.5 * (r->lo + r->hi));
    k->nroots++;
    return true;
}

static const CellEdge *root_edge(const Cells *c, const Root *r, int *axis) {
    const Piece *p = &c->piece[c->column[r->column].piece];
    *axis = p->axis;
    return &c->cell[p->cell].edge[r->edge];
}

static Probe *probe_root(Cells *c, const Root *r, double height) {
    int axis;
    const CellEdge *e = root_edge(c, r, &axis);
    double x[3];
    memcpy(x, c->column[r->column].x, sizeof x);
    x[axis] = height;
    return cells_probe(c, &e->event, x);
}

enum { NEWTON = 64, NARROW = 4 /* units in the last place to each side of a root */ };

/* Newton's method in a bracket, for all roots at once: where a step leaves the bracket, or steps do not shrink, the
 * bracket is halved. Leaves the last point where g was taken in x, g and dg. */
static bool solve(Cells *c) {
    uint32_t active = c->nroot;
    uint32_t *left;
    if (!cells_grow(c, &c->active, &c->active_cap, active, sizeof *c->active)) return false;
    left = c->active;
    for (uint32_t i = 0; i < active; i++) left[i] = i, c->root[i].step = HUGE_VAL;
    for (int round = 0; round < NEWTON && active; round++) {
        c->nprobe = 0;
        for (uint32_t i = 0; i < active; i++)
            if (!probe_root(c, &c->root[left[i]], c->root[left[i]].x)) return false;
        if (!cells_run_probes(c)) return false;
        uint32_t kept = 0;
        for (uint32_t i = 0; i < active; i++) {
            Root *r = &c->root[left[i]];
            const Probe *p = &c->probe[i];
            int axis;
            bool below = (root_edge(c, r, &axis)->rises[axis] > 0) == (p->g < 0);
            r->g = p->g;
            memcpy(r->dg, p->dg, sizeof r->dg);
            *(below ? &r->lo : &r->hi) = r->x;
            double to = r->x - p->g / p->dg[axis], step = fabs(to - r->x);
            double unit = (c->b->f64 ? 0x1p-52 : 0x1p-23) * fmax(fabs(r->lo), fabs(r->hi));
            if (p->g == 0 || step <= unit || r->hi - r->lo <= 2 * unit) continue;
            if (!(to > r->lo && to < r->hi) || !(step <= 0.5 * r->step)) to = r->lo + 0.5 * (r->hi - r->lo);
            r->step = fabs(to - r->x);
            to = cells_round(c, to);
            if (to == r->x) continue;
            r->x = to;
            left[kept++] = left[i];
        }
        active = kept;
    }
    return true;
}

/* f and the hash on the two sides of roots, of those where `wanted`. The sides are next to the root, and g has
 * different signs there: where the region is the same, the distance grows until it has. */
static bool take_sides(Cells *c) {
    Batch *b = c->b;
    uint32_t n = 0;
    if (!cells_grow(c, &c->active, &c->active_cap, c->nroot, sizeof *c->active)) return false;
    for (uint32_t i = 0; i < c->nroot; i++)
        if (c->root[i].wanted) c->active[n++] = i;
    for (double far = NARROW; n; far *= 8) {
        for (uint32_t from = 0; from < n; from += BATCH / 2) {
            uint32_t m = n - from < BATCH / 2 ? n - from : BATCH / 2;
            for (uint32_t i = 0; i < m; i++) {
                Root *r = &c->root[c->active[from + i]];
                const Column *k = &c->column[r->column];
                const Piece *p = &c->piece[k->piece];
                const Box *box = &c->cell[p->cell].box;
                double x[3], lo = box->lo[p->axis], hi = box->hi[p->axis];
                memcpy(x, k->x, sizeof x);
                r->side[0] = fmax(lo, cells_move(c, r->x, -far, hi - lo));
                r->side[1] = fmin(hi, cells_move(c, r->x, far, hi - lo));
                for (uint32_t s = 0; s < 2; s++) x[p->axis] = r->side[s], batch_set_x(b, 2 * i + s, x);
            }
            cells_call(c, SLT_K_SIDES, 2 * m);
            for (uint32_t i = 0; i < 2 * m; i++) {
                Root *r = &c->root[c->active[from + i / 2]];
                r->hash[i & 1] = (uint32_t)batch_get_int(b, SLT_OUT_HASH, 0, i);
                for (uint32_t ch = 0; ch < c->s->channels; ch++) r->f[i & 1][ch] = batch_get(b, SLT_OUT_F, ch, i);
            }
        }
        if (far > 0x1p20) return true;
        c->nprobe = 0;
        uint32_t same = 0;
        for (uint32_t i = 0; i < n; i++) {
            Root *r = &c->root[c->active[i]];
            if (r->hash[0] != r->hash[1]) continue;
            for (int s = 0; s < 2; s++)
                if (!probe_root(c, r, r->side[s])) return false;
            c->active[same++] = c->active[i];
        }
        if (!cells_run_probes(c)) return false;
        n = 0;
        for (uint32_t i = 0; i < same; i++) {
            const Root *r = &c->root[c->active[i]];
            int axis;
            double up = root_edge(c, r, &axis)->rises[axis], lo = up * c->probe[2 * i].g,
                   hi = up * c->probe[2 * i + 1].g;
            const Box *box = &c->cell[c->piece[c->column[r->column].piece].cell].box;
            bool ends = r->side[0] <= box->lo[axis] && r->side[1] >= box->hi[axis];
            if (!(lo < 0 && hi > 0) && !ends) c->active[n++] = c->active[i];
        }
    }
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
    if (!solve(c)) return false;
    for (uint32_t i = 0; i < c->nroot; i++) {
        Root *r = &c->root[i];
        r->wanted = c->o->curves && is_site(c, &c->piece[c->column[r->column].piece], r->edge);
    }
    if (!take_sides(c)) return false;
    for (uint32_t i = 0; i < c->nroot; i++) {
        const Root *r = &c->root[i];
        Piece *p = &c->piece[c->column[r->column].piece];
        PieceEdge *e = &p->edge[r->edge];
        e->height = r->x;
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
                }
            }
    return true;
}

static void emit_crossing(Cells *c, const Root *r) {
    const Column *k = &c->column[r->column];
    int axis;
    const CellEdge *e = root_edge(c, r, &axis);
    uint32_t below = e->rises[axis] > 0 ? 0 : 1; /* the side where g < 0 */
    if (c->ncrossing == BATCH) flush_crossings(c);
    Crossing *x = &c->crossing[c->ncrossing++];
    memset(x, 0, sizeof *x);
    x->event = e->event;
    memcpy(x->x, k->x, sizeof x->x), memcpy(x->dg, r->dg, sizeof x->dg);
    x->x[axis] = r->x, x->g = r->g;
    x->weight = k->weight / fabs(r->dg[axis]);
    for (uint32_t ch = 0; ch < c->s->channels; ch++)
        x->before[ch] = r->f[below][ch], x->jump[ch] = r->f[!below][ch] - r->f[below][ch];
    x->ha = r->hash[below], x->hb = r->hash[!below];
    x->axis = (int8_t)axis, x->rising = 1, x->cls = k->rule;
}

/* Gauss points on a column, between one root and the next. */
static void fill_column(Cells *c, const Column *k) {
    const Piece *p = &c->piece[k->piece];
    const Box *box = &c->cell[p->cell].box;
    const GaussRule *g = &c->rule[k->rule];
    double x[3], from = box->lo[p->axis], heights[CELL_EVENTS + 1];
    uint32_t n = 0;
    for (uint32_t i = 0; i < k->nroots; i++) {
        double h = c->root[k->first + i].x;
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
    if (!solve(c)) return false;
    for (uint32_t i = 0; i < c->nroot; i++)
        c->root[i].wanted = c->piece[c->column[c->root[i].column].piece].edge[c->root[i].edge].open;
    if (!take_sides(c)) return false;
    for (uint32_t i = 0; i < c->ncolumn; i++) {
        const Column *k = &c->column[i];
        for (uint32_t r = 0; r < k->nroots; r++)
            if (c->root[k->first + r].wanted) emit_crossing(c, &c->root[k->first + r]);
        if (c->o->volume) fill_column(c, k);
    }
    return true;
}
