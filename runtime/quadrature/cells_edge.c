/* Kernels on many points and boxes of many events, and what they prove of a cell. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

void cells_call(Cells *c, SltKernelKind kind, uint32_t n) {
    if (kind == SLT_K_BOUNDS || kind == SLT_K_EDGE_BOUNDS) c->counts->boxes += n;
    else c->counts->points += n;
    batch_call(c->b, kind, n);
}

static const Given nothing_given = {.n = 0};

static Probe *add_probe(Cells *c, const Event *e, const Given *given, const double x[3]) {
    if (!CELLS_ROOM(c, probe, 1)) return NULL;
    Probe *p = &c->probe[c->nprobe++];
    p->event = e, p->given = given, p->told = false;
    memcpy(p->x, x, sizeof p->x);
    return p;
}

Probe *cells_probe(Cells *c, const CellEdge *e, const double x[3]) { return add_probe(c, &e->event, &e->given, x); }

Probe *cells_probe_or_tell(Cells *c, const CellEdge *e, const double x[3]) {
    Probe *p = cells_probe(c, e, x);
    if (p && e->quadric.is) p->told = true, p->g = cells_on_quadric(&e->quadric, x, c->dim, p->dg);
    return p;
}

Probe *cells_probe_event(Cells *c, const Event *e, const double x[3]) { return add_probe(c, e, &nothing_given, x); }

Ask *cells_ask(Cells *c, const CellEdge *e, const double lo[3], const double hi[3]) {
    if (!CELLS_ROOM(c, ask, 1)) return NULL;
    Ask *a = &c->ask[c->nask++];
    a->event = &e->event, a->given = &e->given;
    memcpy(a->lo, lo, sizeof a->lo), memcpy(a->hi, hi, sizeof a->hi);
    return a;
}

/* What kernels of an event may ask for besides the loops around it. */
static void put_details(Cells *c, SltKernelKind kind, uint32_t i, const Event *e, const Given *given) {
    if (c->s->layout[kind].reads >> SLT_IN_BOUNDARY & 1) batch_set(c->b, SLT_IN_BOUNDARY, i, e->boundary);
    for (uint32_t end = 0; end < 2 && c->s->layout[kind].reads >> SLT_IN_WINDOW0 & 1; end++)
        batch_set(c->b, SLT_IN_WINDOW0 + end, i, e->window[end]);
    if (!(c->s->layout[kind].reads >> SLT_IN_GIVEN0 & 1)) return;
    uint32_t n = 0;
    for (uint32_t j = 0; j < given->n && n < SLT_GIVEN; j++) {
        if ((uint32_t)given->is[j].site >= c->s->nedges) continue; /* a choice, which is settled instead */
        batch_set_int(c->b, SLT_IN_GIVEN0 + n, i, 2 * (given->is[j].site + 1) + given->is[j].below);
        for (uint32_t d = 0; d < SLT_GIVEN_K; d++)
            batch_set_int(c->b, SLT_IN_GIVEN0_K0 + SLT_GIVEN_K * n + d, i, given->is[j].k[d]);
        n++;
    }
    for (; n < SLT_GIVEN; n++) batch_set_int(c->b, SLT_IN_GIVEN0 + n, i, 0);
}

static void put_event(Cells *c, SltKernelKind kind, uint32_t i, const Event *e, const Given *given) {
    for (uint32_t d = 0; d < c->depth; d++) batch_set_int(c->b, SLT_IN_K0 + d, i, e->k[d]);
    put_details(c, kind, i, e, given);
}

/* May two of them go through one call? */
typedef bool Together(const Cells *c, uint32_t i, uint32_t k);

/* order[]: 0 .. n - 1 so that equal sites stand together, and otherwise ascending. Returns where the group that starts
 * at `from` ends. Sites of one call are few: one scan for each. */
static uint32_t group(uint32_t *order, uint32_t from, uint32_t n, Together *together, const Cells *c) {
    uint32_t first = order[from], end = from + 1;
    while (end < n && together(c, first, order[end])) end++;
    for (uint32_t i = end; i < n; i++)
        if (together(c, first, order[i])) {
            uint32_t keep = order[end];
            order[end++] = order[i], order[i] = keep;
        }
    return end;
}
static bool probes_together(const Cells *c, uint32_t i, uint32_t k) {
    const Probe *p = &c->probe[i], *q = &c->probe[k];
    return p->event->site == q->event->site && (!c->prunes || cells_same_choices(c, p->given, q->given));
}
static bool asks_together(const Cells *c, uint32_t i, uint32_t k) {
    const Ask *p = &c->ask[i], *q = &c->ask[k];
    return p->event->site == q->event->site && (!c->prunes || cells_same_choices(c, p->given, q->given));
}

static bool ordered(Cells *c, uint32_t n) {
    if (!cells_grow(c, &c->order, &c->order_cap, n, sizeof *c->order)) return false;
    for (uint32_t i = 0; i < n; i++) c->order[i] = i;
    return true;
}

/* Probes are what most evaluations are: input by input, and below output by output. */
static void put_probes(Cells *c, SltKernelKind kind, const uint32_t *order, uint32_t n) {
    Batch *b = c->b;
    const Probe *probe = c->probe;
    for (uint32_t d = 0; d < c->dim; d++) {
        void *x = (void *)b->args.in[SLT_IN_X0 + d];
        if (b->f64)
            for (uint32_t i = 0; i < n; i++) ((double *)x)[i] = probe[order[i]].x[d];
        else
            for (uint32_t i = 0; i < n; i++) ((float *)x)[i] = (float)probe[order[i]].x[d];
    }
    for (uint32_t d = 0; d < c->depth; d++) {
        int32_t *k = (int32_t *)b->args.in[SLT_IN_K0 + d];
        for (uint32_t i = 0; i < n; i++) k[i] = probe[order[i]].event->k[d];
    }
    if (c->s->layout[kind].reads & (1ull << SLT_IN_BOUNDARY | 1ull << SLT_IN_WINDOW0 | 1ull << SLT_IN_GIVEN0))
        for (uint32_t i = 0; i < n; i++) put_details(c, kind, i, probe[order[i]].event, probe[order[i]].given);
    if (b->pixels)
        for (uint32_t i = 0; i < n; i++) batch_set_x(b, i, probe[order[i]].x);
}

static void take_probes(Cells *c, const uint32_t *order, uint32_t n) {
    const Batch *b = c->b;
    Probe *probe = c->probe;
    for (uint32_t k = 0; k <= c->dim; k++) {
        const void *v = k ? batch_out(b, SLT_OUT_G_DX, k - 1) : batch_out(b, SLT_OUT_G, 0);
        if (b->f64)
            for (uint32_t i = 0; i < n; i++) *(k ? &probe[order[i]].dg[k - 1] : &probe[order[i]].g) = ((double *)v)[i];
        else
            for (uint32_t i = 0; i < n; i++)
                *(k ? &probe[order[i]].dg[k - 1] : &probe[order[i]].g) = (double)((float *)v)[i];
    }
}

/* Do all active roots ask the same kernel call, and none for more than its loops and boundary? */
static bool are_plain(const Cells *c, uint32_t n) {
    if (c->prunes || c->b->pixels || c->s->layout[SLT_K_EDGE].reads & 1ull << SLT_IN_GIVEN0) return false;
    int32_t site = n ? c->root[c->active[0]].of->event.site : 0;
    for (uint32_t i = 1; i < n && c->s->nedges > 1; i++)
        if (c->root[c->active[i]].of->event.site != site) return false;
    return true;
}

bool cells_run_roots(Cells *c, uint32_t n) {
    if (!are_plain(c, n)) return false;
    Batch *b = c->b;
    bool levels = c->s->layout[SLT_K_EDGE].reads & 1ull << SLT_IN_BOUNDARY,
         lines = c->s->layout[SLT_K_EDGE].reads & 1ull << SLT_IN_WINDOW0;
    for (uint32_t from = 0; from < n; from += BATCH) {
        const uint32_t lanes = n - from < BATCH ? n - from : BATCH, *active = c->active + from;
        for (uint32_t i = 0; i < lanes; i++) {
            const Root *r = &c->root[active[i]];
            const int32_t *k = r->of->event.k;
            for (uint32_t d = 0; d < c->dim; d++) batch_set(b, SLT_IN_X0 + d, i, r->x[d]);
            for (uint32_t d = 0; d < c->depth; d++) batch_set_int(b, SLT_IN_K0 + d, i, k[d]);
            if (levels) batch_set(b, SLT_IN_BOUNDARY, i, r->of->event.boundary);
            for (uint32_t end = 0; end < 2 && lines; end++)
                batch_set(b, SLT_IN_WINDOW0 + end, i, r->of->event.window[end]);
        }
        b->args.site = c->root[active[0]].of->event.site;
        cells_call(c, SLT_K_EDGE, lanes);
        for (uint32_t i = 0; i < lanes; i++) {
            Root *r = &c->root[active[i]];
            r->g = batch_get(b, SLT_OUT_G, 0, i);
            for (uint32_t d = 0; d < c->dim; d++) r->dg[d] = batch_get(b, SLT_OUT_G_DX, d, i);
        }
    }
    return true;
}

static bool run_probes(Cells *c, SltKernelKind kind) {
    uint32_t n = 0;
    if (!cells_grow(c, &c->order, &c->order_cap, c->nprobe, sizeof *c->order)) return false;
    for (uint32_t i = 0; i < c->nprobe; i++)
        if (!c->probe[i].told) c->order[n++] = i;
    for (uint32_t from = 0, end; from < n; from = end) {
        end = group(c->order, from, n, probes_together, c);
        if (end - from > BATCH) end = from + BATCH;
        const Probe *first = &c->probe[c->order[from]];
        c->b->args.site = first->event->site;
        put_probes(c, kind, c->order + from, end - from);
        cells_give_choices(c, first->given, true);
        cells_call(c, kind, end - from);
        cells_give_choices(c, first->given, false);
        take_probes(c, c->order + from, end - from);
    }
    return true;
}

bool cells_run_probes(Cells *c) { return run_probes(c, SLT_K_EDGE); }

bool cells_run_site_probes(Cells *c) { return run_probes(c, SLT_K_SITE_GRAD); }

static void put_box(Cells *c, uint32_t i, const double lo[3], const double hi[3]) {
    batch_set_x(c->b, i, lo);
    for (uint32_t d = 0; d < c->dim; d++) batch_set(c->b, SLT_IN_H0 + d, i, hi[d]);
}

/* The whole line where an end is NaN. */
static void read_ends(const Batch *b, SltRole lo, SltRole hi, uint32_t k, uint32_t i, double ends[2]) {
    ends[0] = batch_get(b, lo, k, i), ends[1] = batch_get(b, hi, k, i);
    if (!(ends[0] <= ends[1])) ends[0] = -HUGE_VAL, ends[1] = HUGE_VAL;
}

bool cells_run_asks(Cells *c) {
    Batch *b = c->b;
    const uint32_t seconds = scene_outputs(c->s, SLT_K_EDGE_BOUNDS, SLT_OUT_DDG_LO);
    if (!ordered(c, c->nask)) return false;
    for (uint32_t from = 0, end; from < c->nask; from = end) {
        end = group(c->order, from, c->nask, asks_together, c);
        if (end - from > BATCH) end = from + BATCH;
        const Ask *first = &c->ask[c->order[from]];
        b->args.site = first->event->site;
        for (uint32_t i = from; i < end; i++) {
            const Ask *a = &c->ask[c->order[i]];
            put_box(c, i - from, a->lo, a->hi);
            put_event(c, SLT_K_EDGE_BOUNDS, i - from, a->event, a->given);
        }
        cells_give_choices(c, first->given, true);
        cells_call(c, SLT_K_EDGE_BOUNDS, end - from);
        cells_give_choices(c, first->given, false);
        for (uint32_t i = from; i < end; i++) {
            Ask *a = &c->ask[c->order[i]];
            read_ends(b, SLT_OUT_G_LO, SLT_OUT_G_HI, 0, i - from, a->g);
            for (uint32_t d = 0; d < c->dim; d++) read_ends(b, SLT_OUT_DG_LO, SLT_OUT_DG_HI, d, i - from, a->slope[d]);
            /* A kernel that cannot tell: then g must be far from 0 by what a hundred operations make. */
            double size = larger(fabs(a->g[0]), fabs(a->g[1])), ulp = c->b->f64 ? 0x1p-52 : 0x1p-23;
            a->error = batch_has(b, SLT_OUT_G_ERROR) ? batch_get(b, SLT_OUT_G_ERROR, 0, i - from) : 128 * ulp * size;
            a->state = (uint32_t)batch_get_int(b, SLT_OUT_G_STATE, 0, i - from);
            for (uint32_t k = 0; k < seconds; k++)
                read_ends(b, SLT_OUT_DDG_LO, SLT_OUT_DDG_HI, k, i - from, a->bend[k]);
            for (uint32_t d = 0; d < c->dim && seconds; d++)
                a->slope_error[d] = batch_get(b, SLT_OUT_DG_ERROR, d, i - from);
        }
    }
    return true;
}

bool cells_run_asks_about_centres(Cells *c) {
    if (!cells_run_asks(c)) return false;
    c->nprobe = 0;
    for (uint32_t i = 0; i < c->nask; i++) {
        Ask *a = &c->ask[i];
        bool told = a->g[0] > 0 || a->g[1] < 0 || a->state & SLT_EDGE_JUMPS;
        double centre[3] = {0};
        a->centre = told ? 0 : c->nprobe + 1;
        for (uint32_t d = 0; d < c->dim; d++) centre[d] = cells_round(c, a->lo[d] + 0.5 * (a->hi[d] - a->lo[d]));
        if (!told && !add_probe(c, a->event, a->given, centre)) return false;
    }
    return cells_run_probes(c);
}

/* The open events of box i of the last call, each integer of a rounding an event of its own. */
static void read_events(const Cells *c, Cell *cell, uint32_t i) {
    const Batch *b = c->b;
    int32_t open = batch_open(b, i);
    cell->nopen = open < 0 ? CELL_EVENTS + 1 : (uint32_t)open;
    cell->nedges = 0;
    cell->many = cell->nopen > CELL_EVENTS;
    if (cell->many && (c->prunes || batch_has(b, SLT_OUT_OPEN_FIRST))) return;
    /* An entry of the list counts as often as it has boundaries. */
    uint32_t named = scene_outputs(c->s, SLT_K_BOUNDS, SLT_OUT_OPEN_EDGE);
    for (uint32_t e = 0; e < named && cell->nedges < cell->nopen; e++) {
        Event event = {.site = batch_get_int(b, SLT_OUT_OPEN_EDGE, e, i)};
        if (event.site < 0) return;
        for (uint32_t d = 0; d < c->depth; d++) event.k[d] = batch_get_int(b, SLT_OUT_OPEN_K, e * c->depth + d, i);
        double first = 0, last = 0;
        bool rounds = c->s->edge_kind && c->s->edge_kind[event.site] != SLT_SITE_COMPARE;
        if (rounds && batch_has(b, SLT_OUT_OPEN_FIRST)) {
            first = batch_get(b, SLT_OUT_OPEN_FIRST, e, i), last = batch_get(b, SLT_OUT_OPEN_LAST, e, i);
            if (!(last >= first && last - first < CELL_EVENTS)) {
                cell->nopen = CELL_EVENTS + 1;
                return;
            }
        }
        for (double at = first; at <= last; at += 1) {
            if (cell->nedges == CELL_EVENTS) {
                cell->nopen = CELL_EVENTS + 1;
                return;
            }
            event.boundary = at;
            batch_read_line(b, e, i, &event);
            CellEdge *edge = &cell->edge[cell->nedges++];
            memset(edge, 0, sizeof *edge);
            edge->event = event;
        }
    }
}

/* What t (x - centre) adds with t in slope[] and x from `down` below the centre to `up` above it; an extent of 0 beside
 * an unknown slope is 0. */
static void add_change(const double slope[2], double down, double up, double sum[2], double *scale) {
    double low[2] = {up > 0 ? slope[0] * up : 0, down > 0 ? -slope[1] * down : 0};
    double high[2] = {up > 0 ? slope[1] * up : 0, down > 0 ? -slope[0] * down : 0};
    sum[0] += smaller(0, smaller(low[0], low[1])), sum[1] += larger(0, larger(high[0], high[1]));
    *scale += up + down > 0 ? (fabs(slope[0]) + fabs(slope[1])) * (up + down) : 0;
}

static bool has_bends(const Cells *c) { return scene_outputs(c->s, SLT_K_EDGE_BOUNDS, SLT_OUT_DDG_LO) > 0; }

/* Bounds of a second derivative, where they are known. */
static const double *bend_of(const Cells *c, const Ask *box, uint32_t d, uint32_t k) {
    static const uint8_t at[2][3][3] = {{{0, 1}, {1, 2}}, {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}}};
    return box->bend[at[c->dim > 2][d][k]];
}

/* Of the gradient: its components at the centre, and what second derivatives change them by. Of x - p and x - q, which
 * natural bounds take for independent, they know that the difference is constant. */
static void narrow_slopes(const Cells *c, CellEdge *e, const Ask *box, const Probe *centre) {
    if (!has_bends(c)) return;
    for (uint32_t d = 0; d < c->dim; d++) {
        double mean[2] = {centre->dg[d], centre->dg[d]}, scale = fabs(centre->dg[d]);
        for (uint32_t k = 0; k < c->dim; k++) {
            const double *bend = bend_of(c, box, d, k);
            double down = centre->x[k] - box->lo[k], up = box->hi[k] - centre->x[k];
            add_change(bend, down, up, mean, &scale);
        }
        double rounding = 2 * box->slope_error[d] + 0x1p-50 * scale;
        if (mean[0] - rounding > e->slope[d][0]) e->slope[d][0] = mean[0] - rounding; /* NaN is not */
        if (mean[1] + rounding < e->slope[d][1]) e->slope[d][1] = mean[1] + rounding;
    }
}

/* Where bounds of the slopes are so narrow that g departs from its tangent at the centre by no more than it rounds,
 * along the positions too; or where those of second derivatives are so of the quadric there. In f32 rounding is what
 * rules must see; and at a curve along an axis, which lies in the gap between two floats, g is what the program
 * computes.
 */
static void find_quadric(const Cells *c, CellEdge *e, const Ask *box, const Probe *centre) {
    Quadric *q = &e->quadric;
    q->is = false;
    if (!centre || !c->b->f64 || box->state) return;
    double apart = 0, bent = 0, rounding = box->error;
    for (uint32_t d = 0; d < c->dim; d++) {
        if (e->slope[d][0] == 0 && e->slope[d][1] == 0) return;
        double width = box->hi[d] - box->lo[d];
        apart += (e->slope[d][1] - e->slope[d][0]) * width;
        rounding += 0x1p-52 * fabs(centre->dg[d]) * larger(fabs(box->lo[d]), fabs(box->hi[d]));
        q->x[d] = centre->x[d], q->dg[d] = centre->dg[d];
        for (uint32_t k = 0; k < c->dim && has_bends(c); k++) {
            const double *bend = bend_of(c, box, d, k);
            q->bend[d][k] = 0.5 * (bend[0] + bend[1]);
            bent += (bend[1] - bend[0]) * width * (box->hi[k] - box->lo[k]);
        }
    }
    q->g = centre->g, q->flat = apart <= rounding; /* NaN is not */
    q->is = q->flat || (has_bends(c) && bent <= rounding);
}

/* The mean-value form, g(centre) + gradient(box) . (x - centre), bounds g without rounding: rounding is added at both
 * ends. */
void cells_meet(const Cells *c, CellEdge *e, const Ask *box) {
    const Probe *centre = box->centre ? &c->probe[box->centre - 1] : NULL;
    double g = centre ? centre->g : NAN, mean[2] = {g, g}, scale = fabs(g);
    for (uint32_t d = 0; d < 3; d++)
        for (int end = 0; end < 2; end++) e->slope[d][end] = d < c->dim ? box->slope[d][end] : 0;
    if (centre) narrow_slopes(c, e, box, centre);
    find_quadric(c, e, box, centre);
    e->state = box->state, e->error = box->error;
    bool smooth = !(box->state & SLT_EDGE_JUMPS);
    for (uint32_t d = 0; d < c->dim; d++) {
        double down = centre ? centre->x[d] - box->lo[d] : 0, up = centre ? box->hi[d] - centre->x[d] : 0;
        double a = e->slope[d][0], z = e->slope[d][1];
        e->rises[d] = (int8_t)(!smooth ? 0 : a > 0 && z < HUGE_VAL ? 1 : z < 0 && a > -HUGE_VAL ? -1 : 0);
        add_change(e->slope[d], down, up, mean, &scale);
    }
    double rounding = 2 * box->error + 0x1p-50 * scale;
    e->g[0] = box->g[0], e->g[1] = box->g[1];
    if (smooth && mean[0] - rounding > e->g[0]) e->g[0] = mean[0] - rounding;
    if (smooth && mean[1] + rounding < e->g[1]) e->g[1] = mean[1] + rounding;
    e->g[0] -= cells_doubt(e), e->g[1] += cells_doubt(e);
}

/* Is one of a cell's events of a site that is straight? Asked once in a tile, of the first cell that has one. */
static bool has_straight(Cells *c, const Cell *cell, bool *has) {
    *has = false;
    for (uint32_t e = 0; e < cell->nedges; e++) {
        uint32_t site = (uint32_t)cell->edge[e].event.site;
        if (site >= c->s->nsites) continue;
        if (!c->straight[site]) {
            CellEdge edge = cell->edge[e];
            c->nask = 0;
            if (!cells_ask(c, &edge, cell->box.lo, cell->box.hi) || !cells_run_asks(c)) return false;
            memcpy(edge.slope, c->ask[0].slope, sizeof edge.slope);
            for (uint32_t d = 0; d < c->dim; d++) edge.rises[d] = edge.slope[d][0] > 0 || edge.slope[d][1] < 0;
            c->straight[site] = cells_straight_axis(c, &edge) >= 0 ? SITE_STRAIGHT : SITE_BENT;
        }
        *has |= c->straight[site] == SITE_STRAIGHT;
    }
    return true;
}

enum { MANY_LEVEL = 3 }; /* of cells in which more events are open than are known */

/* A g that has no bounds may have them on both sides of where other decisions coincide: `(x.y - a.y) / (b.y - a.y)`
 * between a.y and b.y. Such cells are not refined, if they can be cut there;
 * nor small ones in which many are open, for these may lie on each other. */
static bool spare_straight(Cells *c, Cell *cell, uint32_t n) {
    for (uint32_t i = 0; i < n && c->straight; i++) {
        bool has, rays = c->rays;
        for (uint32_t e = 0; e < cell[i].nedges; e++) rays |= cells_is_ray(c->s, cell[i].edge[e].event.site);
        bool may = cell[i].many ? cell[i].level >= MANY_LEVEL : (cell[i].state & SLT_BOX_UNKNOWN) != 0;
        if (!may || !cell[i].refine || rays) continue;
        if (!has_straight(c, &cell[i], &has)) return false;
        if (has) cell[i].refine = false;
    }
    return true;
}

void cells_bound_boxes(Cells *c, Cell *cell, uint32_t n, uint32_t few_events) {
    Batch *b = c->b;
    for (uint32_t i = 0; i < n; i++) put_box(c, i, cell[i].box.lo, cell[i].box.hi);
    cells_call_bounds(c, n);
    for (uint32_t i = 0; i < n; i++) {
        cell[i].state = (uint32_t)batch_get_int(b, SLT_OUT_BOX_STATE, 0, i);
        for (uint32_t ch = 0; ch < c->s->channels; ch++)
            read_ends(b, SLT_OUT_F_LO, SLT_OUT_F_HI, ch, i, &cell[i].f[2 * ch]);
        read_events(c, &cell[i], i);
        cells_add_choices(c, &cell[i], i);
        /* What is not known may be so only because the box straddles a seam. */
        bool seam = false, ray = false, levels = true;
        for (uint32_t e = 0; e < cell[i].nedges; e++) {
            levels &= !e || cells_are_levels(&cell[i].edge[0].event, &cell[i].edge[e].event);
            seam |= (uint32_t)cell[i].edge[e].event.site >= c->s->nsites;
            ray |= cells_is_ray(c->s, cell[i].edge[e].event.site);
        }
        /* Pairs of curves cost more than smaller cells, but around points where many meet. */
        bool few = !cell[i].lonely && !seam && !levels && c->dim == 2;
        uint32_t most = few ? few_events : CELL_EVENTS;
        cell[i].refine = cell[i].nopen > most || (cell[i].state & SLT_BOX_UNKNOWN && !seam) || ray;
    }
}

void cells_bound_range(Cells *c, Cell *cell) { cells_bound_boxes(c, cell, 1, CELL_FEW_EVENTS); }

bool cells_bound_halves(Cells *c) {
    bool gives = c->s->layout[SLT_K_EDGE].reads >> SLT_IN_GIVEN0 & 1;
    if (c->nhalves && !lists_note(&c->lists, c->b)) return false;
    cells_bound_boxes(c, c->cell, c->nhalves, gives ? CELL_FEW_GIVEN : CELL_FEW_EVENTS);
    return lists_narrow(&c->lists, c->b, c->nhalves);
}

bool cells_bound_small(Cells *c) {
    Cell *small = c->cell + c->nhalves;
    uint32_t n = c->ncell - c->nhalves;
    uint64_t wanted = 0;
    if (!n) return true;
    if (!lists_note(&c->lists, c->b)) return false;
    cells_bound_boxes(c, small, n, CELL_FEW_EVENTS);
    for (uint32_t i = 0; i < n && c->lists.any; i++) wanted |= (uint64_t)(small[i].state || small[i].nopen) << i;
    return cells_keep_chunks(c, n, UINT64_MAX) && lists_split(&c->lists, c->b, n, wanted);
}

bool cells_close(Cells *c, Cell *cell, uint32_t n) {
    if (!spare_straight(c, cell, n)) return false;
    c->nask = 0;
    for (uint32_t i = 0; i < n; i++) {
        if (cell[i].refine || cell[i].done) continue;
        for (uint32_t e = 0; e < cell[i].nedges; e++)
            if (!cells_ask(c, &cell[i].edge[e], cell[i].box.lo, cell[i].box.hi)) return false;
    }
    if (!cells_run_asks_about_centres(c)) return false;
    uint32_t at = 0;
    for (uint32_t i = 0; i < n; i++) {
        if (cell[i].refine || cell[i].done) continue;
        uint32_t kept = 0;
        cell[i].nevents = cell[i].nedges, cell[i].same = 0;
        for (uint32_t e = 0; e < cell[i].nedges; e++) {
            CellEdge *edge = &cell[i].edge[e];
            const Ask *asked = &c->ask[at++];
            cells_meet(c, edge, asked);
            edge->before = (uint8_t)e;
            edge->same = cells_may_be_same(c, edge, asked->centre ? c->probe[asked->centre - 1].g : HUGE_VAL);
            cell[i].event[e] = edge->event;
            cell[i].sign[e] = edge->g[0] > 0 ? 1 : edge->g[1] < 0 ? -1 : 0; /* NaN is open */
            if (cell[i].sign[e]) continue;
            if (kept != e) cell[i].edge[kept] = *edge;
            kept++;
        }
        cell[i].nedges = kept;
    }
    return cells_close_same(c, cell, n) && cells_give(c, cell, n);
}

enum {
    VARIES = 4,      /* most that the slope along the height axis may vary in a cell, as a factor */
    VARIES_BENT = 64 /* of a g that bends, which smaller cells do not mend; pieces end where it does */
};

/* Most that g may change across a cell beside what it does along the height axis. Beyond, the curve stands so steep
 * over its base that the piece of it there is lost in the rounding of places: `6e-17 x + y` is no graph over y. */
#define STEEP 64

/* How much d_axis g varies on the cell, in parts of what it may; infinite where it may be 0, or is next to 0 beside the
 * slope along another axis. *steep: how often what g does along the height axis goes into what it does beside. */
static double varies(const Cell *cell, const CellEdge *e, uint32_t dim, uint32_t axis, double *steep) {
    *steep = HUGE_VAL;
    if (!e->rises[axis]) return HUGE_VAL;
    double a = fabs(e->slope[axis][0]), z = fabs(e->slope[axis][1]), climb = 0;
    for (uint32_t d = 0; d < dim; d++) {
        double far = larger(fabs(e->slope[d][0]), fabs(e->slope[d][1])) * (cell->box.end[d] - cell->box.lo[d]);
        if (d != axis) climb = larger(climb, far);
    }
    *steep = climb / (smaller(a, z) * (cell->box.end[axis] - cell->box.lo[axis]));
    if (!(*steep <= STEEP)) return HUGE_VAL;
    return larger(a, z) / smaller(a, z) / (e->state & SLT_EDGE_BENDS ? VARIES_BENT : VARIES);
}

int cells_straight_axis(const Cells *c, const CellEdge *e) {
    int axis = -1, moves = 0;
    for (uint32_t d = 0; d < c->dim; d++) {
        if (e->slope[d][0] == 0 && e->slope[d][1] == 0) continue;
        moves++, axis = (int)d;
    }
    return moves == 1 && e->rises[axis] ? axis : -1;
}

/* Are the two g the same, up to their sign? */
static bool is_same(const CellEdge *e, const CellEdge *f) {
    return (e->g[0] == f->g[0] && e->g[1] == f->g[1]) || (e->g[0] == -f->g[1] && e->g[1] == -f->g[0]);
}

/* Of a cell in which a g has no bounds a site on whose line another lies, where that is likely to be why. */
static int coinciding_edge(const Cells *c, const Cell *cell, int *axis) {
    bool unbounded = cell->many;
    for (uint32_t e = 0; e < cell->nedges; e++) unbounded |= (cell->edge[e].state & SLT_EDGE_JUMPS) != 0;
    for (uint32_t e = 1; e < cell->nedges && unbounded && !cell->curves_done; e++) {
        *axis = cells_straight_axis(c, &cell->edge[e]);
        for (uint32_t k = 0; k < e && *axis >= 0; k++)
            if (cells_straight_axis(c, &cell->edge[k]) == *axis && is_same(&cell->edge[k], &cell->edge[e]))
                return (int)e;
    }
    return -1;
}

/* Where on its axis a straight edge has its root. */
static double straight_root(const Cell *cell, const CellEdge *e, int axis) {
    double up = 0.5 * (e->slope[axis][0] + e->slope[axis][1]);
    return cell->box.lo[axis] - (up > 0 ? e->g[0] : e->g[1]) / up;
}

/* Are there two ways of one site, as a seam decides, that have their curves on the seam? What is between them, if they
 * come apart, is then to be looked for in a cell that has both. */
static bool parts_ways(const Cells *c, const Cell *cell, const CellEdge *seam, int axis) {
    double at = straight_root(cell, seam, axis);
    bool below = false, above = false;
    for (uint32_t e = 0; e < cell->nedges; e++) {
        const CellEdge *edge = &cell->edge[e];
        if ((uint32_t)edge->event.site >= c->s->nsites || cells_straight_axis(c, edge) != axis) continue;
        double near = 4 * (edge->error + seam->error) / fabs(edge->slope[axis][0]);
        for (uint32_t i = 0; i < edge->given.n; i++) {
            if (!event_same(&cell->event[edge->given.is[i].event], &seam->event)) continue;
            bool on = fabs(straight_root(cell, edge, axis) - at) <= near;
            below |= on && edge->given.is[i].below, above |= on && !edge->given.is[i].below;
        }
    }
    return below && above;
}

int cells_straight_edge(const Cells *c, const Cell *cell, int *axis) {
    int upset = -1, across = -1;
    for (uint32_t e = 0; e < cell->nedges; e++) {
        /* The curve of a site must have been integrated before the cell is cut along it. */
        int32_t edge = cell->edge[e].event.site;
        if (!cell->curves_done && (uint32_t)edge < c->s->nsites) continue;
        *axis = cells_straight_axis(c, &cell->edge[e]);
        if (*axis < 0) continue;
        if (!c->prunes && cell->axes && !cell->curves_done && parts_ways(c, cell, &cell->edge[e], *axis)) continue;
        if (c->dim > 2 || cell->curves_done || !cells_upsets(c, edge)) return (int)e;
        if (upset < 0) upset = (int)e, across = *axis;
    }
    if (upset < 0) return coinciding_edge(c, cell, axis);
    *axis = across;
    return upset; /* last, in a plane: f is compared at places of its face, which should look alike by then */
}

bool cells_choose_axes(const Cells *c, Cell *cell) {
    uint32_t common = 0;
    double least = HUGE_VAL, flattest = HUGE_VAL, steep;
    cell->axes = 0;
    for (uint32_t e = 0; e < cell->nedges; e++)
        if (cell->edge[e].state & SLT_EDGE_JUMPS) return false;
    for (uint32_t d = 0; d < c->dim; d++) {
        double worst = 0, steepest = 0;
        for (uint32_t e = 0; e < cell->nedges; e++) {
            worst = larger(worst, varies(cell, &cell->edge[e], c->dim, d, &steep));
            steepest = larger(steepest, steep);
        }
        if (worst < least || (worst == least && steepest < flattest)) least = worst, flattest = steepest, common = d;
    }
    cell->common = least <= 1;
    if (cell->common) { /* one axis for all saves work, and the volume needs it */
        for (uint32_t e = 0; e < cell->nedges; e++) cell->edge[e].axis = (int8_t)common;
        cell->axes = 1u << common;
        return true;
    }
    if (cell->curves_done || !(c->o->curves || c->o->seams)) return false;
    for (uint32_t e = 0; e < cell->nedges; e++) {
        CellEdge *edge = &cell->edge[e];
        /* A seam has no curve to integrate along, but to look along: that it does not jump is enough. */
        edge->axis = -1;
        if ((uint32_t)edge->event.site >= c->s->nsites && !cells_upsets(c, edge->event.site)) continue;
        edge->axis = 0;
        least = flattest = HUGE_VAL;
        for (uint32_t d = 0; d < c->dim; d++) {
            double v = varies(cell, edge, c->dim, d, &steep);
            if (v < least || (v == least && steep < flattest)) edge->axis = (int8_t)d, least = v, flattest = steep;
        }
        if (!(least <= 1)) {
            cell->axes = 0;
            return false;
        }
        cell->axes |= 1u << edge->axis;
    }
    return cell->axes != 0;
}
