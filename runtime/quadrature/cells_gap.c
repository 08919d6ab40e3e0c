/* Gaps between two floats in which a cell is cut at a seam. The curve of a site may lie in the very gap, as where
 * max(a, -b) bends where it is 0: the edge of a stem that has another beside it. Then the gap is the curve.
 *
 * Of its two faces bounds prove what they prove of any box. Where they are settled nothing changes along them, and one
 * place tells whether the region differs across the gap, and whose decision it is: that of a g which goes through 0
 * there. Elsewhere a face is cut where the curve of what is open crosses it. Which of the two pieces of a g that bends
 * in its curve tells how this moves? One whose slope has the sign by which g changes; if both have, their mean is
 * given, and the coarse rule has one of them: where they move alike that is the same. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

enum {
    AT_ONCE = 16,  /* gaps in hand, each with two faces */
    MOST = 512,    /* parts of the gaps of one cell */
    HALVINGS = 24, /* of a part on which the rules differ */
    BESIDE = 32,   /* units in the last place: there the slopes of g are those of its two pieces */
    NEAR_0 = 16    /* so many roundings of g, and steps of it from float to float, are no jump */
};
#define NARROW 0x1p-44 /* parts of the cell: a part of the gap that is shorter is nothing */
#define MOST_ALONG 64 /* the slope of g along the gap, in parts of that across it */

/* A part of the gap that a cell is cut in. */
typedef struct Gap {
    uint32_t cell;
    int8_t axis; /* across it */
    uint8_t halvings;
    Box box;
} Gap;

/* One place of a gap. [2]: on its near side and on its far side. */
typedef struct Place {
    const Gap *of;
    double x[3], weight; /* weight: measure of the base */
    uint8_t rule;
    uint32_t hash[2];
    double f[2][SLT_MAX_CHANNELS];
} Place;

/* A site that decides differently on the two sides. */
typedef struct Decided {
    const CellEdge *edge;
    bool rises;
    bool is_0[2]; /* g is, on the very face: which piece it has there is no matter of where its curve lies */
} Decided;

bool cells_add_gap(Cells *c, uint32_t cell, const Root *r) {
    const Cell *of = &c->cell[cell];
    bool any = false;
    for (uint32_t e = 0; e < of->nedges && c->o->curves && !of->curves_done; e++) {
        const CellEdge *edge = &of->edge[e];
        bool bends = edge->state & (SLT_EDGE_JUMPS | SLT_EDGE_BENDS);
        any |= (uint32_t)edge->event.site < c->s->nsites && (bends || cells_straight_axis(c, edge) == r->axis);
    }
    if (!any) return true;
    if (!CELLS_ROOM(c, gap, 1)) return false;
    Gap *g = &c->gap[c->ngap++];
    *g = (Gap){.cell = cell, .axis = r->axis, .box = of->box};
    g->box.lo[g->axis] = r->lo, g->box.hi[g->axis] = g->box.end[g->axis] = r->hi;
    return true;
}

static void leave(Cells *c, const Gap *g) { cells_leave(c, &g->box, c->cell[g->cell].f, 0); }

/* ---- faces */
static bool bound_faces(Cells *c, const Gap *g, uint32_t n) {
    if (!c->face && !(c->face = calloc(2 * AT_ONCE, sizeof *c->face))) return false;
    for (uint32_t i = 0; i < 2 * n; i++) {
        Cell *face = &c->face[i];
        const Gap *of = &g[i / 2];
        face->box = of->box, face->lonely = true, face->done = false;
        double at = i & 1 ? of->box.hi[of->axis] : of->box.lo[of->axis];
        face->box.lo[of->axis] = face->box.hi[of->axis] = face->box.end[of->axis] = at;
    }
    cells_bound_boxes(c, c->face, 2 * n, CELL_FEW_EVENTS);
    return cells_close(c, c->face, 2 * n);
}

/* What may change along a face: an edge, or NULL where that is not known. */
static bool is_settled(const Cells *c, const Cell *face, const CellEdge **edge) {
    *edge = NULL;
    if (face->refine || face->state & SLT_BOX_UNKNOWN) return false;
    for (uint32_t e = 0; e < face->nedges; e++) {
        const CellEdge *open = &face->edge[e];
        if ((uint32_t)open->event.site >= c->s->nsites && (c->o->flat || c->prunes)) continue; /* f may only bend */
        if (!*edge || !(open->state & SLT_EDGE_JUMPS)) *edge = open;
    }
    return !*edge;
}

/* The axis of the base along which alone an edge changes, and rises or falls; -1: there is none. */
static int axis_along(const Cells *c, const Gap *g, const CellEdge *e) {
    int axis = -1, moves = 0;
    for (uint32_t d = 0; d < c->dim; d++) {
        if ((int)d == g->axis || (e->slope[d][0] == 0 && e->slope[d][1] == 0)) continue;
        moves++, axis = (int)d;
    }
    return moves == 1 && e->rises[axis] && !(e->state & SLT_EDGE_JUMPS) ? axis : -1;
}

static int longest(const Cells *c, const Gap *g) {
    int axis = g->axis == 0 ? 1 : 0;
    for (uint32_t d = 0; d < c->dim; d++)
        if ((int)d != g->axis && g->box.end[d] - g->box.lo[d] > g->box.end[axis] - g->box.lo[axis]) axis = (int)d;
    return axis;
}

/* The parts of a gap on the two sides of (lo, hi) of an axis wait their turn, if there is anything in them. */
static bool cut(Cells *c, Gap g, int axis, double lo, double hi) {
    Cell *cell = &c->cell[g.cell];
    double least = NARROW * (cell->box.end[axis] - cell->box.lo[axis]);
    if (cell->cuts++ >= MOST || cells_spent(c)) {
        leave(c, &g);
        return true;
    }
    for (int part = 0; part < 2; part++) {
        Gap of = g;
        if (part) of.box.lo[axis] = hi;
        else of.box.hi[axis] = of.box.end[axis] = lo;
        if (!(of.box.end[axis] - of.box.lo[axis] > least)) continue;
        if (!CELLS_ROOM(c, gap, 1)) return false;
        c->gap[c->ngap++] = of;
    }
    return true;
}

static bool halve(Cells *c, Gap g) {
    int axis = longest(c, &g);
    double at = cells_round(c, 0.5 * (g.box.lo[axis] + g.box.end[axis]));
    g.halvings++;
    return cut(c, g, axis, at, at);
}

/* Keeps those of which both faces are settled, and cuts the others: at the root of what is open, if it can be found. */
static bool keep_settled(Cells *c, Gap *g, uint32_t *n) {
    uint32_t kept = 0, open = 0;
    Gap rest[AT_ONCE];
    int along[AT_ONCE];
    c->nroot = 0;
    for (uint32_t i = 0; i < *n; i++) {
        const CellEdge *edge[2] = {NULL};
        bool settled[2];
        for (int side = 0; side < 2; side++)
            settled[side] = is_settled(c, &c->face[2 * i + (uint32_t)side], &edge[side]);
        if (settled[0] && settled[1]) {
            g[kept++] = g[i];
            continue;
        }
        if (c->dim == 1) { /* nothing more can be asked of a point */
            leave(c, &g[i]);
            continue;
        }
        int side = edge[0] ? 0 : 1;
        const Cell *face = &c->face[2 * i + (uint32_t)side];
        along[open] = edge[side] ? axis_along(c, &g[i], edge[side]) : -1;
        if (along[open] >= 0) {
            double x[3] = {0};
            for (uint32_t d = 0; d < c->dim; d++) x[d] = cells_round(c, 0.5 * (face->box.lo[d] + face->box.hi[d]));
            if (!cells_root(c, face, edge[side], along[open], x, x[along[open]])) return false;
        }
        rest[open++] = g[i];
    }
    *n = kept;
    if (!cells_solve(c) || !cells_narrow(c)) return false;
    const Root *r = c->root;
    for (uint32_t i = 0; i < open; i++) {
        const Root *at = along[i] >= 0 ? r++ : NULL;
        bool found = at && at->lo < at->hi;
        if (!(found ? cut(c, rest[i], along[i], at->lo, at->hi) : halve(c, rest[i]))) return false;
    }
    return true;
}

/* ---- places */
static void take_places(Cells *c, Place *p, uint32_t n) {
    Batch *b = c->b;
    for (uint32_t from = 0; from < n; from += BATCH / 2) {
        uint32_t lanes = n - from < BATCH / 2 ? 2 * (n - from) : BATCH;
        for (uint32_t i = 0; i < lanes; i++) {
            const Gap *g = p[from + i / 2].of;
            double x[3];
            memcpy(x, p[from + i / 2].x, sizeof x);
            x[g->axis] = i & 1 ? g->box.hi[g->axis] : g->box.lo[g->axis];
            batch_set_x(b, i, x);
        }
        cells_call(c, SLT_K_SIDES, lanes);
        for (uint32_t i = 0; i < lanes; i++) {
            Place *at = &p[from + i / 2];
            at->hash[i & 1] = (uint32_t)batch_get_int(b, SLT_OUT_HASH, 0, i);
            for (uint32_t ch = 0; ch < c->s->channels; ch++) at->f[i & 1][ch] = batch_get(b, SLT_OUT_F, ch, i);
        }
    }
}

static void on_face(const Gap *g, const double at[3], int side, double x[3]) {
    memcpy(x, at, 3 * sizeof *x);
    x[g->axis] = side ? g->box.hi[g->axis] : g->box.lo[g->axis];
}

/* Beside the gap, where the rounding of g decides no longer. */
static void beside(const Cells *c, const Gap *g, const double at[3], int side, double x[3]) {
    const Box *box = &c->cell[g->cell].box;
    double from = side ? g->box.hi[g->axis] : g->box.lo[g->axis], scale = box->hi[g->axis] - box->lo[g->axis];
    memcpy(x, at, 3 * sizeof *x);
    x[g->axis] = fmax(box->lo[g->axis], fmin(box->hi[g->axis], cells_move(c, from, side ? BESIDE : -BESIDE, scale)));
}

static bool has_event(const CellEdge *edge, const Decided *d, uint32_t n) {
    bool has = false;
    for (uint32_t i = 0; i < n; i++) has |= event_same(&d[i].edge->event, &edge->event);
    return has;
}

/* The sites that decide differently on the two sides of a place, and whether there are some whose g jumps: those may be
 * asked only after a move. False where no other does; `memory` where that runs out. */
static bool find_decided(Cells *c, const Place *p, Decided *d, uint32_t *n, bool *odd, bool *memory) {
    const Gap *g = p->of;
    const Cell *cell = &c->cell[g->cell];
    uint32_t events = 0;
    Decided all[CELL_EDGES];
    c->nprobe = 0, *n = 0, *odd = cell->many;
    for (uint32_t e = 0; e < cell->nedges; e++) {
        const CellEdge *edge = &cell->edge[e];
        if ((uint32_t)edge->event.site >= c->s->nsites || has_event(edge, all, events)) continue;
        all[events++] = (Decided){.edge = edge};
        for (int side = 0; side < 2; side++) {
            double x[3];
            on_face(g, p->x, side, x);
            if (!cells_probe_event(c, &edge->event, x)) return *memory = false;
        }
    }
    if (!cells_run_probes(c)) return *memory = false;
    for (uint32_t e = 0; e < events; e++) {
        const Probe *lo = &c->probe[2 * e], *hi = lo + 1;
        if ((lo->g < 0) == (hi->g < 0)) continue;
        double slope = fmax(fabs(lo->dg[g->axis]), fabs(hi->dg[g->axis])), step = hi->x[g->axis] - lo->x[g->axis];
        if (!(fabs(hi->g - lo->g) <= NEAR_0 * (all[e].edge->error + slope * step))) { /* NaN is not */
            *odd = true;
            continue;
        }
        d[*n] = all[e];
        d[*n].rises = lo->g < 0, d[*n].is_0[0] = lo->g == 0, d[*n].is_0[1] = hi->g == 0;
        ++*n;
    }
    return *n > 0;
}

/* ---- crossings */
/* Gauss points of a rule on the base of a part, behind p; how many. */
static uint32_t add_places(const Cells *c, const Gap *g, uint8_t rule, Place *p) {
    uint32_t n = c->rule[rule].n, count = 1, most = c->dim < 3 ? GAUSS_MAX : 4;
    if (rule == CELL_COARSE && n) n = c->rule[CELL_FINE].n;
    n = n < most ? n : most;
    if (n > 2 && c->o->flat) n = 2;
    if (rule == CELL_COARSE && n > 1) n--;
    const GaussRule *of = &c->of[n];
    for (uint32_t d = 0; d + 1 < c->dim; d++) count *= n;
    for (uint32_t i = 0; i < count && n; i++) {
        uint32_t rest = i;
        p[i] = (Place){.of = g, .weight = 1, .rule = rule};
        for (uint32_t d = 0; d < c->dim; d++) {
            if ((int)d == g->axis) continue;
            double width = g->box.end[d] - g->box.lo[d];
            p[i].x[d] = cells_round(c, g->box.lo[d] + of->x[rest % n] * width);
            p[i].weight *= of->w[rest % n] * width;
            rest /= n;
        }
    }
    return n ? count : 0;
}

/* Do the rules agree on the jump? */
static bool agrees(const Cells *c, const Place *p, uint32_t n) {
    bool agree = true;
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        double sum[CELL_RULES] = {0}, most = 0, total = 0;
        for (uint32_t i = 0; i < n; i++) {
            double jump = p[i].f[1][ch] - p[i].f[0][ch];
            sum[p[i].rule] += p[i].weight * jump, total += p[i].weight * fabs(jump), most = fmax(most, fabs(jump));
        }
        double size = c->dim == 3 ? c->width * c->width : c->width;
        double least = fmax(c->o->tolerance * most * size, cells_rounding(c) * total);
        agree &= fabs(sum[CELL_FINE] - sum[CELL_COARSE]) <= least;
    }
    return agree;
}

static void emit(Cells *c, const Place *p, const Decided *d, const Probe *at, uint8_t rule, double part) {
    double weight = part * p->weight / fabs(at->dg[p->of->axis]);
    if (!isfinite(weight)) return;
    Crossing *x = cells_add_crossing(c, rule);
    uint32_t below = d->rises ? 0 : 1;
    x->event = d->edge->event, x->g = at->g, x->weight = weight;
    memcpy(x->x, at->x, sizeof x->x), memcpy(x->dg, at->dg, sizeof x->dg);
    for (uint32_t ch = 0; ch < c->s->channels; ch++)
        x->before[ch] = p->f[below][ch], x->jump[ch] = p->f[!below][ch] - p->f[below][ch];
    x->ha = p->hash[below], x->hb = p->hash[!below];
    x->axis = p->of->axis, x->rising = 1;
}

/* g and its slopes at n places, by place, site and side. */
static bool take_slopes(Cells *c, const Place *p, uint32_t n, const Decided *d, uint32_t sites) {
    c->nprobe = 0;
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t e = 0; e < sites; e++)
            for (int side = 0; side < 2; side++) {
                double x[3];
                if (d[e].is_0[side]) beside(c, p[i].of, p[i].x, side, x);
                else on_face(p[i].of, p[i].x, side, x);
                if (!cells_probe_event(c, &d[e].edge->event, x)) return false;
            }
    return cells_run_probes(c);
}

/* Does g change across the gap as fast as along it, or nearly? Of the top of an arc, at whose place another boundary
 * ends along the gap, one side has a slope that is next to nothing: a length of a few floats is divided by it. */
static bool is_across(const Cells *c, const double dg[3], int axis) {
    bool across = true;
    for (uint32_t d = 0; d < c->dim; d++) across &= fabs(dg[d]) <= MOST_ALONG * fabs(dg[axis]); /* NaN is not */
    return across;
}

/* by[]: at all of these places the piece of g on that side has the slope that its change asks for. */
static bool find_pieces(const Cells *c, const Place *p, uint32_t n, const Decided *d, uint32_t sites, uint32_t e,
                        bool by[2]) {
    by[0] = by[1] = true;
    for (uint32_t i = 0; i < n; i++)
        for (int side = 0; side < 2; side++) {
            const double *dg = c->probe[2 * (sites * i + e) + (uint32_t)side].dg, up = dg[p->of->axis];
            by[side] &= (d[e].rises ? up > 0 : up < 0) && is_across(c, dg, p->of->axis);
        }
    return by[0] || by[1];
}

/* Of several sites that lie there each may have all of the jump, or nothing. */
static bool emit_places(Cells *c, const Place *p, uint32_t n, const Decided *d, uint32_t sites) {
    bool by[CELL_EDGES][2], told = true;
    if (!take_slopes(c, p, n, d, sites)) return false;
    for (uint32_t e = 0; e < sites; e++) told &= find_pieces(c, p, n, d, sites, e, by[e]);
    if (!told) leave(c, p->of);
    const Probe *at = c->probe;
    for (uint32_t i = 0; i < n && told; i++)
        for (uint32_t e = 0; e < sites; e++) {
            bool both = by[e][0] && by[e][1], fine = p[i].rule == CELL_FINE;
            for (int side = 0; side < 2; side++, at++) {
                if (!by[e][side]) continue;
                if (fine) emit(c, &p[i], &d[e], at, CELL_FINE, (both ? 0.5 : 1) / sites);
                if (fine && sites > 1) emit(c, &p[i], &d[e], at, CELL_COARSE, (both ? 0.5 : 1) * (sites - 1) / sites);
                if (!fine && !(both && side)) emit(c, &p[i], &d[e], at, CELL_COARSE, 1.0 / sites);
            }
        }
    return true;
}

/* ---- several that lie there are untied: untie.h */
#define FREE 0.25 /* of a part: at its ends others meet it */

/* g of an event on both sides of a place. */
static bool probe_sides(Cells *c, const Place *p, const Event *event) {
    for (int side = 0; side < 2; side++) {
        double x[3];
        beside(c, p->of, p->x, side, x);
        if (!cells_probe_event(c, event, x)) return false;
    }
    return true;
}

/* by[]: on that side g has the slope that its change asks for. */
static bool has_slope(const Cells *c, const Probe at[2], int axis, bool by[2]) {
    for (int side = 0; side < 2; side++) {
        double up = at[side].dg[axis];
        by[side] = isfinite(up) && (at[0].g < at[1].g ? up > 0 : up < 0) && is_across(c, at[side].dg, axis);
    }
    return by[0] || by[1];
}

/* The crossing that a place is, of its first site; false: f does not jump. */
static bool make_crossing(const Cells *c, const Place *p, const Decided *d, const Probe *at, Crossing *x) {
    uint32_t below = d->rises ? 0 : 1;
    bool jumps = false;
    memset(x, 0, sizeof *x);
    x->event = d->edge->event, x->g = at->g;
    memcpy(x->x, at->x, sizeof x->x), memcpy(x->dg, at->dg, sizeof x->dg);
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        x->before[ch] = p->f[below][ch], x->jump[ch] = p->f[!below][ch] - p->f[below][ch];
        jumps |= x->jump[ch] != 0;
    }
    x->ha = p->hash[below], x->hb = p->hash[!below];
    x->axis = p->of->axis, x->rising = 1;
    return jumps;
}

/* One event's part of a place; at: its g on both sides. */
static void emit_home(Cells *c, const Crossing *x, const Place *p, const Tie *t, uint32_t e, const Probe at[2]) {
    bool by[2], both, fine = p->rule == CELL_FINE, unsure = t->kink || t->doubted;
    has_slope(c, at, x->axis, by);
    both = by[0] && by[1];
    for (int side = 0; side < 2; side++) {
        double up = at[side].dg[x->axis], along = up * x->dg[x->axis] < 0 ? -1 : 1;
        double weight = (both && fine ? 0.5 : 1) * p->weight / fabs(up);
        if (!by[side] || !isfinite(weight) || (both && side && !fine)) continue;
        for (int half = 0; half < 1 + (fine && unsure); half++) {
            Crossing *of = cells_add_crossing(c, half ? CELL_COARSE : p->rule);
            uint8_t cls = of->cls;
            *of = *x;
            of->cls = cls, of->event = t->event[e], of->g = at[side].g, of->weight = weight;
            memcpy(of->x, at[side].x, sizeof of->x), memcpy(of->dg, at[side].dg, sizeof of->dg);
            for (uint32_t ch = 0; ch < c->s->channels; ch++)
                of->jump[ch] = along * (half ? t->half[e][ch] : t->whole ? x->jump[ch] : t->jump[e][ch]);
        }
    }
}

/* The crossings that n places are, and at[] of which place each is; told: all have a slope. */
static bool make_crossings(Cells *c, const Place *p, uint32_t n, const Decided *d, Crossing *x, uint32_t *at,
                           uint32_t *crossings, bool *told) {
    c->nprobe = *crossings = 0;
    for (uint32_t i = 0; i < n; i++)
        if (!probe_sides(c, &p[i], &d->edge->event)) return false;
    if (!cells_run_probes(c)) return false;
    for (uint32_t i = 0; i < n; i++) {
        bool by[2];
        *told &= has_slope(c, &c->probe[2 * i], p->of->axis, by);
        if (make_crossing(c, &p[i], d, &c->probe[2 * i + by[1]], &x[*crossings])) at[(*crossings)++] = i;
    }
    return true;
}

/* told: whose the jumps are is known at all places, which are emitted. */
static bool emit_untied(Cells *c, const Place *p, uint32_t n, const Decided *d, bool *told) {
    Crossing x[UNTIE_MOST];
    Tie tie[UNTIE_MOST];
    double room[UNTIE_MOST], base = HUGE_VAL;
    uint32_t which[UNTIE_MOST], at[UNTIE_MOST], crossings;
    *told = false;
    if (n > UNTIE_MOST || c->prunes) return true;
    if (!cells_ready_to_tie(c)) return false;
    *told = c->apart != NULL;
    if (*told && !make_crossings(c, p, n, d, x, at, &crossings, told)) return false;
    if (!*told || !crossings) return true;
    for (uint32_t k = 0; k < c->dim; k++)
        if ((int)k != p->of->axis) base = fmin(base, p->of->box.end[k] - p->of->box.lo[k]);
    for (uint32_t i = 0; i < crossings; i++) which[i] = i, room[i] = FREE * base;
    if (!untie(c->untie, c->apart, x, which, crossings, room, tie)) return false;
    c->nprobe = 0;
    for (uint32_t i = 0; i < crossings; i++) {
        *told &= tie[i].n || tie[i].naway;
        for (uint32_t e = 0; e < tie[i].n; e++)
            if (!probe_sides(c, &p[at[i]], &tie[i].event[e])) return false;
    }
    if (!cells_run_site_probes(c)) return false;
    bool by[2];
    for (uint32_t k = 0; k < c->nprobe; k += 2) *told &= has_slope(c, &c->probe[k], p->of->axis, by);
    const Probe *probe = c->probe;
    for (uint32_t i = 0; i < crossings && *told; i++) {
        const Place *of = &p[at[i]];
        for (uint32_t e = 0; e < tie[i].n; e++, probe += 2) emit_home(c, &x[i], of, &tie[i], e, probe);
        cells_emit_away(c, &x[i], of->weight, of->rule, &tie[i]);
        if (tie[i].kink && of->rule == CELL_FINE) cells_count_kink(c, &x[i].event, x[i].x);
    }
    return true;
}

/* A part of which both faces are settled; in its middle f and the region are known. */
static bool integrate(Cells *c, const Place *middle) {
    enum { ROOM = 2 * GAUSS_MAX > 32 ? 2 * GAUSS_MAX : 32 };
    const Gap *g = middle->of;
    Place p[ROOM];
    Decided d[CELL_EDGES];
    uint32_t n, sites;
    bool odd, told = false, memory = true, compare = !c->o->fixed && c->rule[CELL_COARSE].n && c->dim > 1;
    if (middle->hash[0] == middle->hash[1]) return true;
    if (!find_decided(c, middle, d, &sites, &odd, &memory)) {
        if (memory) leave(c, g);
        return memory;
    }
    n = add_places(c, g, CELL_FINE, p), n += add_places(c, g, CELL_COARSE, p + n);
    take_places(c, p, n);
    if (compare && g->halvings < HALVINGS && !agrees(c, p, n) && !cells_spent(c)) return halve(c, *g);
    if ((odd || sites > 1) && !emit_untied(c, p, n, d, &told)) return false;
    if (told) return true;
    if (!odd) return emit_places(c, p, n, d, sites);
    leave(c, g);
    return true;
}

bool cells_integrate_gaps(Cells *c) {
    while (c->ngap) {
        Gap g[AT_ONCE];
        Place middle[AT_ONCE];
        uint32_t n = c->ngap < AT_ONCE ? c->ngap : AT_ONCE;
        c->ngap -= n;
        memcpy(g, c->gap + c->ngap, n * sizeof *g);
        if (!bound_faces(c, g, n) || !keep_settled(c, g, &n)) return false;
        for (uint32_t i = 0; i < n; i++) {
            middle[i] = (Place){.of = &g[i], .weight = 1};
            for (uint32_t d = 0; d < c->dim; d++)
                middle[i].x[d] = cells_round(c, 0.5 * (g[i].box.lo[d] + g[i].box.end[d]));
        }
        take_places(c, middle, n);
        for (uint32_t i = 0; i < n; i++)
            if (!integrate(c, &middle[i])) return false;
    }
    return true;
}
