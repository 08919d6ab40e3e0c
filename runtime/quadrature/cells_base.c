/* The bases of curved cells in pieces (2D, and planes of 3D): cut where a curve leaves the cell through the faces at
 * the two ends of its height axis, and where curves meet. Both are roots along stretches of the base
 * (cells_stretch.h). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/cells_stretch.h"

enum { MEET_STEPS = 24, STEEP = 4 };
#define LAST 0x1p-54 /* parts of a cell */

static bool add_cut(Cells *c, const Cut *cut) {
    if (!CELLS_ROOM(c, cut, 1)) return false;
    c->cut[c->ncut++] = *cut;
    return true;
}

/* ---- where curves leave the cell */
/* Both ends of all stretches, which are whole faces. */
static bool take_corners(Cells *c) {
    c->nprobe = 0;
    for (uint32_t i = 0; i < c->nstretch; i++) {
        const Stretch *s = &c->stretch[i];
        const CellEdge *e = curve_of(c, s);
        for (int end = 0; end < 2; end++) {
            double x[3];
            if (e->quadric.is) continue;
            place(&c->cell[s->cell], e->axis, s->at[end], s->height[end], x);
            if (!cells_probe(c, e, x)) return false;
        }
    }
    if (!cells_run_probes(c)) return false;
    const Probe *next = c->probe;
    for (uint32_t i = 0; i < c->nstretch; i++) {
        Stretch *s = &c->stretch[i];
        Cell *cell = &c->cell[s->cell];
        CellEdge *e = &cell->edge[s->edge];
        int base = base_axis(cell, e->axis);
        for (int end = 0; end < 2; end++) {
            double x[3];
            Probe own;
            place(cell, e->axis, s->at[end], s->height[end], x);
            const Probe *p = tell_or_next(c, e, x, &own, &next);
            s->value[end] = p->g;
            e->corner[i & 1][end] = (Corner){p->g, p->dg[base], p->dg[e->axis]};
        }
    }
    return true;
}

static bool is_whole(const Cell *cell, const Stretch *s, int base) {
    return s->at[0] <= cell->box.lo[base] && s->at[1] >= cell->box.hi[base];
}

/* What is known of stretch i, a face, when roots are isolated and solved: r is its root, or NULL. */
static void note_face(Cells *c, uint32_t i, const Root *r) {
    const Stretch *s = &c->stretch[i];
    Cell *cell = &c->cell[s->cell];
    CellEdge *e = &cell->edge[s->edge];
    int base = base_axis(cell, e->axis);
    const Corner *k = e->corner[i & 1];
    double near = larger(2 * e->error, cells_doubt(e));
    bool clear = fabs(k[0].g) > near && fabs(k[1].g) > near; /* NaN is not */
    e->sure[i & 1] = is_whole(cell, s, base) && clear && (r != NULL) == ((k[0].g < 0) != (k[1].g < 0));
    if (r) e->leaves[i & 1] = r->x[base];
}

double cells_height_on_quadric(const CellEdge *e, int base, double s) {
    const Quadric *q = &e->quadric;
    const int axis = e->axis;
    double by = s - q->x[base], g = q->g + q->dg[base] * by, slope = q->dg[axis];
    if (q->flat) return q->x[axis] - g / slope;
    g += 0.5 * q->bend[base][base] * by * by, slope += q->bend[base][axis] * by;
    return q->x[axis] - 2 * g / (slope + e->rises[axis] * sqrt(slope * slope - 2 * q->bend[axis][axis] * g));
}

/* Where the cubics through the corners are 0. */
double cells_height_by_corners(const Cell *cell, const CellEdge *e, int base, double s) {
    if (!e->sure[0] || !e->sure[1]) return NAN;
    if (e->quadric.is) return cells_height_on_quadric(e, base, s);
    double lo = cell->box.lo[base], width = cell->box.hi[base] - lo, t = (s - lo) / width, u = 1 - t, g[2], up[2];
    double ends[2] = {cell->box.lo[e->axis], cell->box.hi[e->axis]};
    for (int face = 0; face < 2; face++) {
        const Corner *k = e->corner[face];
        g[face] = u * u * (1 + 2 * t) * k[0].g + t * t * (1 + 2 * u) * k[1].g +
                  t * u * width * (u * k[0].along - t * k[1].along);
        up[face] = u * k[0].up + t * k[1].up;
    }
    return cells_cubic_root(ends, g, up, cells_between(ends, g, up));
}

bool cells_told_by_corners(const CellEdge *e, double s, bool *present) {
    if (!e->sure[0] || !e->sure[1]) return false;
    bool side[2];
    for (int face = 0; face < 2; face++) {
        const Corner *k = e->corner[face];
        bool leaves = (k[0].g < 0) != (k[1].g < 0);
        side[face] = (leaves && s > e->leaves[face] ? k[1].g : k[0].g) > 0;
    }
    *present = side[0] != side[1] && side[1] == (e->rises[e->axis] > 0);
    return true;
}

/* Tiles end a little inside of the domain. A curve that leaves through such an end goes on to the border: far, where it
 * runs along it. Twice as far as its tangent says, as a curve that touches the border does. */
static double beyond_of(const Cells *c, const Stretch *s, const Root *r) {
    int axis = curve_of(c, s)->axis, base = r->axis;
    double lo = s->height[0] - c->lo[axis], hi = c->hi[axis] - s->height[0];
    double strip = smaller(lo, hi), size = larger(fabs(c->lo[axis]), fabs(c->hi[axis]));
    if (!(strip <= (c->b->f64 ? 0x1p-50 : 0x1p-21) * size)) return 0;
    double beyond = 2 * strip * fabs(r->dg[axis] / r->dg[base]);
    return beyond < c->hi[base] - c->lo[base] ? beyond : 0; /* NaN is not */
}

static bool cut_at_faces(Cells *c, uint32_t first) {
    c->nstretch = 0;
    for (uint32_t i = first; i < c->ncell; i++) {
        Cell *cell = &c->cell[i];
        for (uint32_t e = 0; cell->axes && e < cell->nedges; e++) {
            const CellEdge *edge = &cell->edge[e];
            if (edge->axis < 0) continue;
            int base = base_axis(cell, edge->axis);
            for (int8_t face = 0; face < 2; face++) {
                Stretch s = {.cell = i, .edge = (int8_t)e, .other = FACE};
                s.at[0] = cell->box.lo[base], s.at[1] = cell->box.hi[base];
                s.height[0] = s.height[1] = face ? cell->box.hi[edge->axis] : cell->box.lo[edge->axis];
                s.slope[0] = edge->slope[base][0], s.slope[1] = edge->slope[base][1];
                if (!stretch_add(c, &s)) return false;
            }
        }
    }
    uint32_t faces = c->nstretch; /* halves of them come behind */
    if (!take_corners(c)) return false;
    for (uint32_t i = 0; i < c->nstretch; i++) stretch_judge(&c->stretch[i], 2 * curve_of(c, &c->stretch[i])->error);
    if (!stretch_isolate(c)) return false;
    c->nroot = 0;
    for (uint32_t i = 0; i < c->nstretch; i++) {
        const Stretch *s = &c->stretch[i];
        const Cell *cell = &c->cell[s->cell];
        if (s->state != ROOT || cell->refine) continue;
        const CellEdge *e = curve_of(c, s);
        int base = base_axis(cell, e->axis);
        double x[3], part = s->value[0] / (s->value[0] - s->value[1]);
        double guess = s->at[0] + part * (s->at[1] - s->at[0]);
        if (i < faces && is_whole(cell, s, base)) {
            const Corner *k = e->corner[i & 1];
            double slope[2] = {k[0].along, k[1].along}, both = cells_between(s->at, s->value, slope);
            if (both > s->at[0] && both < s->at[1]) guess = cells_cubic_root(s->at, s->value, slope, both);
        }
        place(cell, e->axis, s->at[0], s->height[0], x);
        Root *r = cells_root(c, cell, e, base, x, 0);
        if (!r) return false;
        r->lo = s->at[0], r->hi = s->at[1], r->ends[0] = r->ends[1] = true, r->rises = s->value[1] >= 0 ? 1 : -1;
        r->x[base] = cells_round(c, smaller(larger(guess, s->at[0]), s->at[1]));
        r->turns = HUGE_VAL;
    }
    if (!cells_solve(c)) return false;
    const Root *r = c->root;
    for (uint32_t i = 0; i < c->nstretch; i++) {
        const Stretch *s = &c->stretch[i];
        if (c->cell[s->cell].refine) continue;
        if (i < faces) note_face(c, i, s->state == ROOT ? r : NULL);
        if (s->state != ROOT) continue;
        int8_t axis = curve_of(c, s)->axis;
        /* Where the curve is steep the last floats of the base are many of its height. */
        bool steep = !(fabs(r->dg[r->axis]) <= STEEP * fabs(r->dg[axis]));
        Cut cut = {.cell = s->cell, .axis = axis, .edge = s->edge, .at = r->x[r->axis]};
        cut.edges = 1u << s->edge;
        cut.up = s->height[0] >= c->cell[s->cell].box.hi[axis];
        cut.beyond = beyond_of(c, s, r), cut.height = steep ? NAN : s->height[0];
        if (!add_cut(c, &cut)) return false;
        r++;
    }
    return true;
}

/* ---- where curves meet */
static int by_place(const void *a, const void *b) {
    const Cut *p = a, *q = b;
    if (p->cell != q->cell) return p->cell < q->cell ? -1 : 1;
    if (p->axis != q->axis) return p->axis < q->axis ? -1 : 1;
    return (p->at > q->at) - (p->at < q->at);
}

/* On faces of a solid an event may have an axis to look along, and be no graph. */
static bool is_graph(const CellEdge *e) { return e->axis >= 0 && e->rises[e->axis]; }

/* Every part of the base between cuts where the curve of an edge is the same one, or is not there. */
static bool add_arcs(Cells *c, uint32_t i, uint32_t first_cut, uint32_t cuts) {
    const Cell *cell = &c->cell[i];
    for (uint32_t e = 0; e < cell->nedges; e++) {
        int axis = cell->edge[e].axis, base = base_axis(cell, axis);
        if (!is_graph(&cell->edge[e])) continue;
        Stretch s = {.cell = i, .edge = (int8_t)e, .other = ARC};
        s.at[0] = cell->box.lo[base];
        for (uint32_t k = 0; k <= cuts; k++) {
            const Cut *cut = k < cuts ? &c->cut[first_cut + k] : NULL;
            if (cut && (cut->axis != axis || cut->edge != (int8_t)e)) continue;
            s.at[1] = cut ? cut->at : cell->box.hi[base];
            s.known[1] = cut && !isnan(cut->height);
            if (s.known[1]) s.height[1] = cut->height;
            if (s.at[1] > s.at[0] && !stretch_add(c, &s)) return false;
            s.at[0] = s.at[1], s.height[0] = s.height[1], s.known[0] = s.known[1];
        }
    }
    return true;
}

/* In place of each arc one stretch for every other event; each pair once, on the curve of one that has an axis. */
static bool add_pairs(Cells *c) {
    uint32_t arcs = c->nstretch;
    for (uint32_t i = 0; i < arcs; i++) {
        Stretch s = c->stretch[i];
        const Cell *cell = &c->cell[s.cell];
        for (uint32_t o = 0; o < cell->nedges; o++) {
            if (o == (uint32_t)s.edge || (o < (uint32_t)s.edge && is_graph(&cell->edge[o]))) continue;
            if (cells_contradict(&cell->edge[o], &cell->edge[s.edge])) continue;
            s.other = (int8_t)o;
            cells_slope_along(cell->edge[s.edge].slope, cell->edge[o].slope, base_axis(cell, cell->edge[s.edge].axis),
                              cell->edge[s.edge].axis, s.climb, s.slope);
            if (!stretch_add(c, &s)) return false;
        }
    }
    c->nstretch -= arcs;
    memmove(c->stretch, c->stretch + arcs, c->nstretch * sizeof *c->stretch);
    return true;
}

/* Drops stretches above whose middle the curve is not in the cell. */
static bool keep_present(Cells *c) {
    bool present;
    c->nprobe = 0;
    for (uint32_t i = 0; i < c->nstretch; i++) {
        Stretch *s = &c->stretch[i];
        const Cell *cell = &c->cell[s->cell];
        const CellEdge *e = curve_of(c, s);
        const Box *box = &cell->box;
        int base = base_axis(cell, e->axis);
        double x[3], middle = cells_round(c, 0.5 * (s->at[0] + s->at[1]));
        if (cells_told_by_corners(e, middle, &present)) {
            s->state = present ? OPEN : DONE;
            for (int end = 0; end < 2; end++)
                if (!s->known[end]) s->height[end] = cells_height_by_corners(cell, e, base, s->at[end]);
            continue;
        }
        s->state = ROOT; /* to be asked */
        for (int side = 0; side < 2; side++) {
            place(&c->cell[s->cell], e->axis, middle, side ? box->hi[e->axis] : box->lo[e->axis], x);
            if (!cells_probe_or_tell(c, e, x)) return false;
        }
    }
    if (!cells_run_probes(c)) return false;
    uint32_t kept = 0;
    const Probe *p = c->probe;
    for (uint32_t i = 0; i < c->nstretch; i++) {
        Stretch *s = &c->stretch[i];
        if (s->state == ROOT) {
            s->state = cells_spans(curve_of(c, s), curve_of(c, s)->axis, p[0].g, p[1].g) ? OPEN : DONE;
            p += 2;
        }
        if (s->state == OPEN) c->stretch[kept++] = *s;
    }
    c->nstretch = kept;
    return true;
}

/* Are the two curves one? At both ends of a stretch and in its middle they are as near as rounding lets one tell. */
static bool drop_coinciding(Cells *c) {
    c->nroot = 0;
    for (uint32_t i = 0; i < c->nstretch; i++) {
        const Stretch *s = &c->stretch[i];
        const CellEdge *e = curve_of(c, s);
        if (s->state != OPEN) continue;
        double x[3];
        place(&c->cell[s->cell], e->axis, cells_round(c, s->at[0] + 0.382 * (s->at[1] - s->at[0])), 0, x);
        if (!cells_root(c, &c->cell[s->cell], e, e->axis, x, 0.5 * (s->height[0] + s->height[1]))) return false;
        c->root[c->nroot - 1].turns = HUGE_VAL;
    }
    if (!cells_solve(c)) return false;
    c->nprobe = 0;
    const Root *r = c->root;
    for (uint32_t i = 0; i < c->nstretch; i++)
        if (c->stretch[i].state == OPEN && !cells_probe_or_tell(c, tested(c, &c->stretch[i]), (r++)->x)) return false;
    if (!cells_run_probes(c)) return false;
    const Probe *p = c->probe;
    for (uint32_t i = 0; i < c->nstretch; i++) {
        Stretch *s = &c->stretch[i];
        if (s->state != OPEN) continue;
        double same = cells_nearly_0(c, &c->cell[s->cell].box, tested(c, s)->error, p->dg);
        if (fabs(p->g) <= same && fabs(s->value[0]) <= same && fabs(s->value[1]) <= same) s->state = DONE;
        p++;
    }
    return true;
}

/* Does the next step, which Newton's method makes as small beside this one as this is beside the one before, squared,
 * come to nothing? Not where a slope jumps. */
static bool is_last_step(const Cells *c, Stretch *s, const Box *box, double ds, double dh) {
    int axis = curve_of(c, s)->axis, base = base_axis(&c->cell[s->cell], axis);
    double step = larger(ds / (box->end[base] - box->lo[base]), dh / (box->end[axis] - box->lo[axis]));
    double next = step * step * step / (s->step * s->step);
    s->step = step;
    return c->b->f64 && next <= LAST && !((curve_of(c, s)->state | tested(c, s)->state) & SLT_EDGE_BENDS);
}

/* Newton's method in both coordinates for the one place of a stretch where the two curves meet. Those that do not
 * converge there become open again, half as long. */
static bool find_meetings(Cells *c, bool *again) {
    *again = false;
    uint32_t n = 0;
    if (!cells_grow(c, &c->active, &c->active_cap, c->nstretch, sizeof *c->active)) return false;
    for (uint32_t i = 0; i < c->nstretch; i++) {
        Stretch *s = &c->stretch[i];
        if (s->state != ROOT || c->cell[s->cell].refine) continue;
        double part = s->value[0] / (s->value[0] - s->value[1]);
        s->x[0] = s->at[0] + part * (s->at[1] - s->at[0]);
        s->x[1] = s->height[0] + part * (s->height[1] - s->height[0]);
        s->step = 1;
        c->active[n++] = i;
    }
    for (int step = 0; step < MEET_STEPS && n; step++) {
        c->nprobe = 0;
        for (uint32_t i = 0; i < n; i++) {
            const Stretch *s = &c->stretch[c->active[i]];
            const CellEdge *e = curve_of(c, s);
            double x[3];
            place(&c->cell[s->cell], e->axis, cells_round(c, s->x[0]), cells_round(c, s->x[1]), x);
            if (!ask_unless_told(c, e, x) || !ask_unless_told(c, tested(c, s), x)) return false;
        }
        if (!cells_run_probes(c)) return false;
        uint32_t kept = 0;
        const Probe *next = c->probe;
        for (uint32_t i = 0; i < n; i++) {
            Stretch *s = &c->stretch[c->active[i]];
            const Box *box = &c->cell[s->cell].box;
            double x[3];
            Probe own[2];
            place(&c->cell[s->cell], curve_of(c, s)->axis, cells_round(c, s->x[0]), cells_round(c, s->x[1]), x);
            const Probe *p = tell_or_next(c, curve_of(c, s), x, &own[0], &next);
            const Probe *q = tell_or_next(c, tested(c, s), x, &own[1], &next);
            int axis = curve_of(c, s)->axis, base = base_axis(&c->cell[s->cell], axis);
            double det = p->dg[base] * q->dg[axis] - p->dg[axis] * q->dg[base];
            double ds = (p->g * q->dg[axis] - q->g * p->dg[axis]) / det,
                   dh = (q->g * p->dg[base] - p->g * q->dg[base]) / det;
            s->spread[0] = fabs(q->dg[axis] / det), s->spread[1] = fabs(p->dg[axis] / det);
            double unit = c->b->f64 ? 0x1p51 : 0x1p22, tiny = larger(fabs(s->at[0]), fabs(s->at[1])) / unit,
                   slack = 16 * tiny + 0x1p-30 * (s->at[1] - s->at[0]);
            double to = s->x[0] - ds, height = s->x[1] - dh;
            bool inside = to >= s->at[0] - slack && to <= s->at[1] + slack; /* NaN is not */
            double far = fabs(ds) / tiny;
            far = larger(far, fabs(dh) * unit / larger(fabs(box->lo[axis]), fabs(box->hi[axis])));
            bool converged = far <= 1 || (step > 6 && far <= 64) || is_last_step(c, s, box, fabs(ds), fabs(dh));
            s->x[0] = smaller(larger(to, s->at[0]), s->at[1]);
            s->x[1] = smaller(larger(height, box->lo[axis]), box->hi[axis]);
            if (inside && converged) continue;
            c->active[kept++] = c->active[i];
        }
        n = kept;
    }
    for (uint32_t i = 0; i < n; i++) c->stretch[c->active[i]].state = OPEN, *again = true;
    return true;
}

/* What both g round by there, which may be far less than all over the cell. In f64 that is little everywhere. */
static bool ask_at_meetings(Cells *c) {
    c->nask = 0;
    for (uint32_t i = 0; i < c->nstretch; i++) {
        const Stretch *s = &c->stretch[i];
        double x[3];
        if (s->state != ROOT || c->cell[s->cell].refine) continue;
        place(&c->cell[s->cell], curve_of(c, s)->axis, cells_round(c, s->x[0]), cells_round(c, s->x[1]), x);
        Ask *a = cells_ask(c, curve_of(c, s), x, x), *b = a ? cells_ask(c, tested(c, s), x, x) : NULL;
        if (!b) return false;
        c->ask[c->nask - 2].error = curve_of(c, s)->error, c->ask[c->nask - 1].error = tested(c, s)->error;
    }
    return c->b->f64 || !c->nask || cells_run_asks(c);
}

static bool cut_at_meetings(Cells *c, uint32_t first) {
    if (c->ncut) qsort(c->cut, c->ncut, sizeof *c->cut, by_place);
    c->nstretch = 0;
    uint32_t at = 0;
    for (uint32_t i = first; i < c->ncell; i++) {
        uint32_t from = at;
        while (at < c->ncut && c->cut[at].cell == i) at++;
        if (c->cell[i].axes && !c->cell[i].refine && c->cell[i].nedges > 1 && !add_arcs(c, i, from, at - from))
            return false;
    }
    if (!c->nstretch) return true;
    if (!keep_present(c) || !stretch_heights(c, 0, STRETCH_BOTH)) return false;
    if (!add_pairs(c) || !stretch_values(c, 0, STRETCH_BOTH)) return false;
    for (uint32_t i = 0; i < c->nstretch; i++) stretch_judge(&c->stretch[i], 2 * tested(c, &c->stretch[i])->error);
    if (!drop_coinciding(c)) return false;
    for (bool again = true; again;) {
        if (!stretch_isolate(c) || !find_meetings(c, &again)) return false;
        if (again && !stretch_halve(c)) return false;
        for (uint32_t i = 0; again && i < c->nstretch; i++)
            if (c->stretch[i].state == OPEN) stretch_judge(&c->stretch[i], 2 * tested(c, &c->stretch[i])->error);
    }
    if (!ask_at_meetings(c)) return false;
    for (uint32_t i = 0, k = 0; i < c->nstretch; i++) {
        const Stretch *s = &c->stretch[i];
        if ((s->state != ROOT && s->state != MET) || c->cell[s->cell].refine) continue;
        int axis = curve_of(c, s)->axis, other = tested(c, s)->axis;
        bool met = s->state == MET;
        Cut cut = {.cell = s->cell, .axis = (int8_t)axis, .edge = -1, .at = s->x[0]};
        cut.spread =
            met ? s->at[1] - s->at[0] : c->ask[2 * k].error * s->spread[0] + c->ask[2 * k + 1].error * s->spread[1];
        k += !met;
        cut.edges = 1u << s->edge | 1u << s->other;
        if (!add_cut(c, &cut)) return false;
        cut.axis = (int8_t)other, cut.at = s->x[1];
        if (met) cut.spread = fabs(s->height[1] - s->height[0]);
        if (other >= 0 && other != axis && !add_cut(c, &cut)) return false;
    }
    return true;
}

/* ---- pieces between the cuts */
static bool add_piece(Cells *c, uint32_t i, int axis, int base, double from, double to, const Cut *begin,
                      const Cut *end) {
    if (!CELLS_ROOM(c, piece, 1)) return false;
    const Cell *cell = &c->cell[i];
    Piece *p = &c->piece[c->npiece++];
    memset(p, 0, offsetof(Piece, edge)); /* edges that are present get theirs */
    p->cell = i, p->axis = (int8_t)axis, p->base = (int8_t)base, p->parts = 1;
    p->graded = c->o->volume && cell->state & SLT_BOX_ROUGH;
    for (uint32_t d = 0; d < c->dim; d++) p->at[d][0] = p->at[d][1] = cell->box.lo[d];
    if (base >= 0) p->at[base][0] = from, p->at[base][1] = to;
    p->leaving[0] = p->leaving[1] = -1;
    const Cut *cut[2] = {begin, end};
    for (int i = 0; i < 2; i++) {
        if (!cut[i]) continue;
        p->leaving[i] = cut[i]->edge, p->beyond[i] = cut[i]->beyond, p->up[i] = cut[i]->up;
        p->meet[i] = cut[i]->edge < 0 ? cut[i]->edges : 0, p->spread[i] = cut[i]->spread;
    }
    return true;
}

static bool add_pieces(Cells *c, uint32_t first) {
    const Cut *cut = c->cut, *end = c->ncut ? cut + c->ncut : cut;
    for (uint32_t i = first; i < c->ncell; i++) {
        const Cell *cell = &c->cell[i];
        for (int axis = 0; axis < (int)c->dim; axis++) {
            bool wanted = cell->axes >> axis & 1 && !cell->refine;
            if (axis == cell->slice) continue;
            int base = base_axis(cell, axis);
            const Cut *last = NULL;
            uint32_t begins = 0;
            double from = cell->box.lo[base], narrow = NARROW * (cell->box.end[base] - from);
            for (; cut < end && cut->cell == i && cut->axis == axis; cut++) {
                if (!wanted || !(cut->at - from > narrow) || !(cell->box.end[base] - cut->at > narrow)) {
                    begins |= cut->edges;
                    continue;
                }
                if (!add_piece(c, i, axis, base, from, cut->at, last, cut)) return false;
                c->piece[c->npiece - 1].begins = begins;
                from = cut->at, last = cut, begins = cut->edges;
            }
            if (!wanted) continue;
            if (!add_piece(c, i, axis, base, from, cell->box.end[base], last, NULL)) return false;
            c->piece[c->npiece - 1].begins = begins;
        }
    }
    return true;
}

bool cells_cut_planes(Cells *c, uint32_t first) {
    c->ncut = 0;
    if (!cut_at_faces(c, first) || !cut_at_meetings(c, first)) return false;
    if (c->ncut) qsort(c->cut, c->ncut, sizeof *c->cut, by_place);
    return true;
}

bool cells_cut_bases(Cells *c, uint32_t first) {
    c->npiece = 0;
    if (c->dim > 1) return cells_cut_planes(c, first) && add_pieces(c, first);
    for (uint32_t i = first; i < c->ncell; i++)
        if (c->cell[i].axes && !add_piece(c, i, 0, -1, 0, 0, NULL, NULL)) return false;
    return true;
}

/* What lies between the end of the cell and the border of the domain is no more than an error. */
void cells_emit_beyond(Cells *c, const Piece *p) {
    for (int end = 0; end < 2; end++) {
        if (!(p->beyond[end] > 0) || p->leaving[end] < 0) continue;
        const PieceEdge *e = &p->edge[p->leaving[end]];
        if (!(p->present >> p->leaving[end] & 1) || !e->open) continue;
        const CellEdge *edge = &c->cell[p->cell].edge[p->leaving[end]];
        Root r = {.of = edge, .g = e->g, .sides = e->sides, .axis = p->axis, .rises = edge->rises[p->axis]};
        for (uint32_t d = 0; d < c->dim; d++) r.x[d] = 0.5 * (p->at[d][0] + p->at[d][1]);
        r.x[p->axis] = e->height;
        memcpy(r.dg, e->dg, sizeof r.dg);
        Crossing *x = cells_add_crossing(c, CELL_COARSE);
        cells_crossing(c, &r, x);
        x->weight = p->beyond[end] / fabs(e->dg[p->axis]);
    }
}
