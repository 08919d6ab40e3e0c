/* Stretches: what bounds prove of a function along them, and halves until there is nothing to prove. */
#include <math.h>

#include "runtime/quadrature/cells_stretch.h"

/* In all of a cell: of two curves that are one but for rounding signs change by chance, on ever more stretches. */
enum { HALVINGS = 10, HALVED_MOST = 1024 };

Stretch *stretch_add(Cells *c, const Stretch *from) {
    if (!CELLS_ROOM(c, stretch, 1)) return NULL;
    c->stretch[c->nstretch] = *from;
    return &c->stretch[c->nstretch++];
}

/* ---- intervals */
static void divide(const double a[2], const double b[2], double r[2]) { /* b does not hold 0 */
    double q[4] = {a[0] / b[0], a[0] / b[1], a[1] / b[0], a[1] / b[1]};
    r[0] = smaller(smaller(q[0], q[1]), smaller(q[2], q[3])), r[1] = larger(larger(q[0], q[1]), larger(q[2], q[3]));
}

/* The least that a function can be on a stretch of this width that has these values at its ends and at least and at
 * most these slopes between. */
static double least(double width, const double value[2], const double slope[2]) {
    double spread = slope[1] - slope[0];
    if (!(spread < HUGE_VAL)) return -HUGE_VAL;
    if (!(spread > 0)) return smaller(value[0], value[1]);
    double t = (value[0] - value[1] + slope[1] * width) / spread;
    if (!(t > 0 && t < width)) return smaller(value[0], value[1]);
    return smaller(value[0] + slope[0] * t, smaller(value[0], value[1]));
}
static double most(double width, const double value[2], const double slope[2]) {
    const double v[2] = {-value[0], -value[1]}, s[2] = {-slope[1], -slope[0]};
    return -least(width, v, s);
}

void cells_slope_along(const double a[3][2], const double f[3][2], int base, int axis, double climb[2],
                       double slope[2]) {
    divide(a[base], a[axis], climb);
    double keep = climb[0];
    climb[0] = -climb[1], climb[1] = -keep;
    double p = f[axis][0] * climb[0], q = f[axis][0] * climb[1], r = f[axis][1] * climb[0], t = f[axis][1] * climb[1];
    double rounding = 0x1p-48 * (fabs(p) + fabs(q) + fabs(r) + fabs(t) + fabs(f[base][0]) + fabs(f[base][1]));
    slope[0] = f[base][0] + smaller(smaller(p, q), smaller(r, t)) - rounding;
    slope[1] = f[base][1] + larger(larger(p, q), larger(r, t)) + rounding;
    if (!(rounding < HUGE_VAL)) slope[0] = -HUGE_VAL, slope[1] = HUGE_VAL;
}

/* ---- what is proven of a stretch */
void stretch_judge(Stretch *s, double error) { /* error: of the function's values */
    double width = s->at[1] - s->at[0];
    bool up[2] = {s->value[0] >= 0, s->value[1] >= 0};
    /* A function that is the same all along has no root to cut at, be it 0. */
    if (s->slope[0] == 0 && s->slope[1] == 0) s->state = DONE;
    else if (up[0] == up[1] && (s->slope[0] >= 0 || s->slope[1] <= 0)) s->state = DONE;
    else if (s->slope[0] > 0 || s->slope[1] < 0) s->state = up[0] == up[1] ? DONE : ROOT;
    else if (least(width, s->value, s->slope) > error || most(width, s->value, s->slope) < -error) s->state = DONE;
}

/* Bounds of the function on the stretch itself, where those of the cell do not suffice. */
static bool ask_more(Cells *c) {
    c->nask = 0;
    for (uint32_t i = 0; i < c->nstretch; i++) {
        Stretch *s = &c->stretch[i];
        const Cell *cell = &c->cell[s->cell];
        if (s->state != OPEN || cell->refine) continue;
        const CellEdge *e = curve_of(c, s);
        int axis = e->axis;
        double lo[3], hi[3];
        place(cell, axis, s->at[0], s->height[0], lo), place(cell, axis, s->at[1], s->height[0], hi);
        if (s->other == FACE) {
            if (!cells_ask(c, e, lo, hi)) return false;
            continue;
        }
        double width = s->at[1] - s->at[0];
        lo[axis] = fmax(cell->box.lo[axis], cells_move(c, least(width, s->height, s->climb), -4, 0));
        hi[axis] = fmin(cell->box.hi[axis], cells_move(c, most(width, s->height, s->climb), 4, 0));
        if (!(lo[axis] <= hi[axis])) lo[axis] = cell->box.lo[axis], hi[axis] = cell->box.hi[axis];
        lo[axis] = cells_round(c, lo[axis]), hi[axis] = cells_round(c, hi[axis]);
        if (!cells_ask(c, e, lo, hi) || !cells_ask(c, tested(c, s), lo, hi)) return false;
    }
    if (!cells_run_asks(c)) return false;
    const Ask *a = c->ask;
    for (uint32_t i = 0; i < c->nstretch; i++) {
        Stretch *s = &c->stretch[i];
        if (s->state != OPEN || c->cell[s->cell].refine) continue;
        const CellEdge *e = curve_of(c, s);
        const Ask *f = a;
        if (s->other == FACE) {
            const double *slope = a[0].slope[base_axis(&c->cell[s->cell], e->axis)];
            s->slope[0] = fmax(s->slope[0], slope[0]), s->slope[1] = fmin(s->slope[1], slope[1]);
            a += 1;
        } else {
            double climb[2], slope[2], steep[3][2];
            for (uint32_t d = 0; d < c->dim;
                 d++) /* never worse than on the whole cell, where the height axis was chosen */
                steep[d][0] = fmax(a[0].slope[d][0], e->slope[d][0]),
                steep[d][1] = fmin(a[0].slope[d][1], e->slope[d][1]);
            f = a + 1;
            cells_slope_along(steep, f->slope, base_axis(&c->cell[s->cell], e->axis), e->axis, climb, slope);
            s->climb[0] = fmax(s->climb[0], climb[0]), s->climb[1] = fmin(s->climb[1], climb[1]);
            s->slope[0] = fmax(s->slope[0], slope[0]), s->slope[1] = fmin(s->slope[1], slope[1]);
            a += 2;
        }
        if (f->state & SLT_EDGE_JUMPS) {
            c->cell[s->cell].refine = true;
            continue;
        }
        if (f->g[0] > 0 || f->g[1] < 0) s->state = DONE;
        else stretch_judge(s, 2 * f->error);
    }
    return true;
}

bool stretch_heights(Cells *c, uint32_t first, int ends) {
    c->nroot = 0;
    for (uint32_t i = first; i < c->nstretch; i++) {
        Stretch *s = &c->stretch[i];
        const CellEdge *e = curve_of(c, s);
        const Box *box = &c->cell[s->cell].box;
        for (int end = 0; end < 2 && s->other != FACE; end++) {
            double x[3];
            if (!(ends >> end & 1) || s->known[end]) continue;
            if (e->quadric.is && c->dim == 2) {
                double h = /* in a plane of 3D it says too little */
                    cells_height_on_quadric(e, base_axis(&c->cell[s->cell], e->axis), s->at[end]);
                s->known[end] = h >= box->lo[e->axis] && h <= box->hi[e->axis]; /* NaN is not */
                if (s->known[end]) s->height[end] = h;
                if (s->known[end]) continue;
            }
            place(&c->cell[s->cell], e->axis, s->at[end], 0, x);
            Root *r = cells_root(c, &c->cell[s->cell], e, e->axis, x, s->height[end]);
            if (!r) return false;
            r->turns = HUGE_VAL;
        }
    }
    if (!cells_solve(c)) return false;
    const Root *r = c->root;
    for (uint32_t i = first; i < c->nstretch; i++) {
        Stretch *s = &c->stretch[i];
        for (int end = 0; end < 2 && s->other != FACE; end++)
            if (ends >> end & 1 && !s->known[end]) s->height[end] = (r++)->x[curve_of(c, s)->axis];
    }
    return true;
}

bool stretch_values(Cells *c, uint32_t first, int ends) {
    c->nprobe = 0;
    for (uint32_t i = first; i < c->nstretch; i++) {
        const Stretch *s = &c->stretch[i];
        for (int end = 0; end < 2; end++) {
            double x[3];
            if (!(ends >> end & 1)) continue;
            place(&c->cell[s->cell], curve_of(c, s)->axis, s->at[end], s->height[end], x);
            if (!ask_unless_told(c, tested(c, s), x)) return false;
        }
    }
    if (!cells_run_probes(c)) return false;
    const Probe *next = c->probe;
    for (uint32_t i = first; i < c->nstretch; i++) {
        Stretch *s = &c->stretch[i];
        for (int end = 0; end < 2; end++) {
            double x[3];
            Probe own;
            if (!(ends >> end & 1)) continue;
            place(&c->cell[s->cell], curve_of(c, s)->axis, s->at[end], s->height[end], x);
            s->value[end] = tell_or_next(c, tested(c, s), x, &own, &next)->g;
        }
    }
    return true;
}

/* Does the function change its sign along it? Where it bends on the very curve that the stretch follows, as a running
 * minimum does where three regions meet, its slope is never proven to have one sign, however short the stretch. */
static bool crosses(const Stretch *s) { return (s->value[0] >= 0) != (s->value[1] >= 0); }

/* No longer than rounding lets places on it be told apart. */
static bool is_tiny(const Cells *c, const Stretch *s) {
    enum { ULPS = 16 };
    const Cell *cell = &c->cell[s->cell];
    int base = base_axis(cell, curve_of(c, s)->axis);
    double ulp = (c->b->f64 ? 0x1p-52 : 0x1p-23) * larger(fabs(s->at[0]), fabs(s->at[1]));
    return s->at[1] - s->at[0] <= larger(ULPS * ulp, NARROW * (cell->box.end[base] - cell->box.lo[base]));
}

/* Halves every open stretch: the far half is appended. One across which the sign changes is followed down to where
 * numbers end, which is far cheaper than smaller cells. */
bool stretch_halve(Cells *c) {
    uint32_t n = c->nstretch;
    for (uint32_t i = 0; i < n; i++) {
        Stretch *s = &c->stretch[i];
        const Cell *cell = &c->cell[s->cell];
        if (s->state != OPEN || cell->refine) continue;
        double mid = cells_round(c, 0.5 * (s->at[0] + s->at[1]));
        bool inside = mid > s->at[0] && mid < s->at[1];
        if (crosses(s)) s->halvings = 0;
        else s->halvings++;
        if (!inside || is_tiny(c, s)) {
            s->state = !crosses(s) ? DONE : s->other == FACE ? ROOT : MET;
            s->x[0] = mid, s->x[1] = 0.5 * (s->height[0] + s->height[1]);
            continue;
        }
        if (s->halvings > HALVINGS || ++c->cell[s->cell].halved > HALVED_MOST) {
            c->cell[s->cell].refine = true;
            continue;
        }
        Stretch far = *s;
        far.at[0] = mid;
        far.known[0] = false;
        if (s->other != FACE) far.height[0] = 0.5 * (s->height[0] + s->height[1]);
        if (!stretch_add(c, &far)) return false;
    }
    if (!stretch_heights(c, n, STRETCH_NEAR) || !stretch_values(c, n, STRETCH_NEAR)) return false;
    for (uint32_t i = 0, j = n; i < n; i++) {
        Stretch *s = &c->stretch[i];
        if (s->state != OPEN || c->cell[s->cell].refine) continue;
        s->at[1] = c->stretch[j].at[0], s->height[1] = c->stretch[j].height[0], s->value[1] = c->stretch[j].value[0];
        j++;
    }
    return true;
}

bool stretch_isolate(Cells *c) {
    for (;;) {
        uint32_t open = 0;
        if (!ask_more(c)) return false;
        for (uint32_t i = 0; i < c->nstretch; i++)
            open += c->stretch[i].state == OPEN && !c->cell[c->stretch[i].cell].refine;
        if (!open) return true;
        if (!stretch_halve(c)) return false;
    }
}
