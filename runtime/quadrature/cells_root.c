/* Roots of g along lines, many at once, and f on their two sides. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

enum {
    STEPS = 100,
    NOISE = 256 /* units in the last place */,
    NARROW = 4,  /* units in the last place from a root to each of its sides, */
    ASIDE = 256, /* and where f is flat, which is the same there: no root is so far from where it was taken to be */
    FAR = 4,     /* and so many times farther f is taken once more where it may be a root there, or steep: */
    LOOKED = 16  /* of so many roots one is looked at */
};
#define SURE 0x1p-27     /* parts of a line: so short a step of Newton's method leads to the last floats */
#define MOST_FAR 0x1p20 /* units from a root to its sides */

/* Changes of f between floats beside a root, in parts of its jump: what matters, and what may be no straight line. */
#define STEEP 0x1p-15
#define STEEP_F64 0x1p-40
#define BENDS 0x1p-2

static double unit(const Cells *c, const Root *r) {
    return (c->b->f64 ? 0x1p-52 : 0x1p-23) * larger(fabs(r->lo), fabs(r->hi));
}

Root *cells_root(Cells *c, const Cell *cell, const CellEdge *e, int axis, const double x[3], double guess) {
    if (!CELLS_ROOM(c, root, 1)) return NULL;
    Root *r = &c->root[c->nroot++];
    r->ends[0] = r->ends[1] = r->wanted = r->twin = r->band = r->solved = r->waits =
        false; /* its other members come later */
    r->column = r->sides = r->between = r->tie = r->other = 0, r->edge = 0, r->blur = 0;
    r->noise = e->error, r->of = e, r->axis = (int8_t)axis, r->rises = e->rises[axis];
    memcpy(r->x, x, sizeof r->x);
    r->lo = r->ends_at[0] = cell->box.lo[axis], r->hi = r->ends_at[1] = cell->box.hi[axis];
    r->x[axis] = r->guess = cells_round(c, guess > r->lo && guess < r->hi ? guess : 0.5 * (r->lo + r->hi));
    r->turns = 0;
    r->slack = c->b->f64 && !(e->state & SLT_EDGE_BENDS) ? 0 : -1; /* a slope that jumps is no cubic's */
    r->step = HUGE_VAL, r->before[0] = r->before[1] = r->dg_before[axis] = NAN;
    return r;
}

double cells_cubic_root(const double x[2], const double g[2], const double slope[2], double at) {
    enum { STEPS = 2 };
    double width = x[1] - x[0], t = (at - x[0]) / width, p = slope[0] * width, q = slope[1] * width;
    double b = 3 * (g[1] - g[0]) - 2 * p - q, a = p + q - 2 * (g[1] - g[0]);
    for (int i = 0; i < STEPS; i++) {
        double off = g[0] + t * (p + t * (b + t * a));
        if (fabs(off) <= 0x1p-50 * fabs(p)) break;
        t -= off / (p + t * (2 * b + t * 3 * a));
    }
    double to = x[0] + t * width;
    return to > x[0] && to < x[1] ? to : at; /* NaN is not */
}

/* The slope of the cubic with these values and slopes at two places, at another one. */
static double slope_at(const double x[2], const double g[2], const double slope[2], double at) {
    double width = x[1] - x[0], t = (at - x[0]) / width, mean = (g[1] - g[0]) / width;
    return slope[0] * (1 - t) * (1 - 3 * t) + slope[1] * t * (3 * t - 2) + 6 * t * (1 - t) * mean;
}

/* Is `to` near enough that nothing more need be asked? Newton's step alone errs by the square of its length, in parts
 * of the line, on which slopes change by as much as they may in a cell; the cubic through the place before by that
 * times the square of the distance of the two, its slope by a length less. So a step of SURE leaves nothing of the
 * place, and of the slope as much as its own length. */
static bool ends_here(const Cells *c, Root *r, double newton, double both) {
    double line = r->ends_at[1] - r->ends_at[0], x = r->x[r->axis], dg = r->dg[r->axis];
    double step = fabs(newton - x), back = fabs(x - r->before[0]), off = step * back * back, all = line * line;
    bool last = off <= 0.25 * unit(c, r) * all; /* NaN is not */
    double slack = r->turns > 0 ? 0 : r->slack * line;
    bool cubic = (last || off <= slack * all) && step <= back;
    double to = cubic ? both : newton;
    bool sure = step <= smaller(SURE, r->turns) * line;
    if (!cubic && !sure && !(step <= slack)) return false;
    if (!(to >= r->ends_at[0] && to <= r->ends_at[1])) return false;
    /* Of two near places g tells less than it rounds: a slope there is better carried on from the slopes alone. */
    double noise = 6 * r->of->error / fabs(dg) * step / (back * back), straight = step * back / all;
    bool curved = noise + off / (line * all) <= straight;
    for (uint32_t d = 0; cubic && d < c->dim; d++)
        if (d == (uint32_t)r->axis && curved)
            r->dg[d] = slope_at((double[2]){r->before[0], x}, (double[2]){r->before[1], r->g},
                                (double[2]){r->dg_before[d], dg}, to);
        else r->dg[d] += (r->dg[d] - r->dg_before[d]) / (x - r->before[0]) * (to - x);
    r->x[r->axis] = cells_round(c, to), r->g = 0;
    c->counts->loose |= !(cubic && last) && r->turns < HUGE_VAL;
    return true;
}

/* The next place to take g at; false: the one where it was taken is the root. A Newton step that leaves the bracket
 * goes to an end of the line where g has not been taken yet; else, and where steps do not shrink, the bracket is
 * halved. */
static bool advance(const Cells *c, Root *r) {
    double x = r->x[r->axis], to = x - r->g / r->dg[r->axis], shortest = unit(c, r);
    bool below = (r->rises > 0) == (r->g < 0);
    if (below) r->lo = x, r->ends[0] = true;
    else r->hi = x, r->ends[1] = true;
    /* Close to the root steps end where the rounding of g does. */
    double step = fabs(to - x);
    bool noise = step <= NOISE * shortest && !(step <= 0.25 * r->step);
    if (r->g == 0 || step <= shortest || noise || r->hi - r->lo <= 2 * shortest) return false;
    /* Two places tell more than one: of order 2.7 instead of 2. */
    double dg = r->dg[r->axis], both = NAN;
    if (!isnan(r->before[0]))
        both = cells_between((double[2]){r->before[0], x}, (double[2]){r->before[1], r->g},
                             (double[2]){r->dg_before[r->axis], dg});
    if (r->slack >= 0 && ends_here(c, r, to, both)) return false;
    if (fabs(both - to) <= 0.5 * step) to = both;
    r->before[0] = x, r->before[1] = r->g;
    memcpy(r->dg_before, r->dg, sizeof r->dg);
    bool at_end = false;
    if (to <= r->lo && !r->ends[0]) to = r->lo, at_end = true;
    else if (to >= r->hi && !r->ends[1]) to = r->hi, at_end = true;
    else if (!(to > r->lo && to < r->hi) || !(fabs(to - x) <= 0.5 * r->step)) to = r->lo + 0.5 * (r->hi - r->lo);
    r->step = at_end ? HUGE_VAL : fabs(to - x);
    to = cells_round(c, to);
    if (to == x) return false; /* beyond the line's end by rounding, or the bracket has no room */
    r->x[r->axis] = to;
    return true;
}

/* g of the n active roots where they are now. */
static bool probe_roots(Cells *c, uint32_t n) {
    uint32_t told = 0;
    for (uint32_t i = 0; i < n; i++) {
        Root *r = &c->root[c->active[i]];
        if (r->of->quadric.is) told++, r->g = cells_on_quadric(&r->of->quadric, r->x, c->dim, r->dg);
    }
    if (told == n || (!told && cells_run_roots(c, n))) return true;
    c->nprobe = 0;
    for (uint32_t i = 0; i < n; i++) {
        const Root *r = &c->root[c->active[i]];
        if (!r->of->quadric.is && !cells_probe(c, r->of, r->x)) return false;
    }
    if (!cells_run_probes(c)) return false;
    const Probe *at = c->probe;
    for (uint32_t i = 0; i < n; i++) {
        Root *r = &c->root[c->active[i]];
        if (r->of->quadric.is) continue;
        r->g = at->g;
        memcpy(r->dg, (at++)->dg, sizeof r->dg);
    }
    return true;
}

/* Of a quadric the root is known at once. False: it is not on the line, or is wanted to the last floats. */
static bool solve_quadric(const Cells *c, Root *r) {
    const Quadric *q = &r->of->quadric;
    if (!q->is || r->slack < 0) return false;
    double dg[3], g = cells_on_quadric(q, r->x, c->dim, dg), slope = dg[r->axis], by = -g / slope;
    if (!q->flat) by = -2 * g / (slope + r->rises * sqrt(slope * slope - 2 * q->bend[r->axis][r->axis] * g));
    double to = r->x[r->axis] + by;
    if (!(to >= r->lo && to <= r->hi)) return false; /* NaN is not */
    for (uint32_t d = 0; d < c->dim; d++) r->dg[d] = dg[d] + (q->flat ? 0 : q->bend[d][r->axis] * by);
    r->x[r->axis] = to, r->g = 0;
    return true;
}

bool cells_solve(Cells *c) {
    uint32_t n = 0;
    if (!cells_grow(c, &c->active, &c->active_cap, c->nroot, sizeof *c->active)) return false;
    for (uint32_t i = 0; i < c->nroot; i++) {
        Root *r = &c->root[i];
        if (r->solved || r->waits) continue;
        r->solved = solve_quadric(c, r);
        if (!r->solved) c->active[n++] = i;
    }
    for (int step = 0; step < STEPS && n; step++) {
        if (!probe_roots(c, n)) return false;
        uint32_t kept = 0;
        for (uint32_t i = 0; i < n; i++) {
            Root *r = &c->root[c->active[i]];
            r->solved = !advance(c, r);
            if (!r->solved) c->active[kept++] = c->active[i];
        }
        n = kept;
    }
    return true;
}

/* Is x on the near side of where g changes its sign? */
static bool near_side(const Root *r, double g) { return (g < 0) == (r->rises > 0); }

/* g at lo (place 0) and hi (1), or only between (2), of the n active roots. */
static bool probe_bracket(Cells *c, uint32_t n, bool middle) {
    c->nprobe = 0;
    for (uint32_t i = 0; i < n; i++) {
        const Root *r = &c->root[c->active[i]];
        double x[3];
        memcpy(x, r->x, sizeof x);
        for (int end = 0; end < (middle ? 1 : 2); end++) {
            x[r->axis] = middle ? cells_round(c, r->lo + 0.5 * (r->hi - r->lo)) : end ? r->hi : r->lo;
            if (!cells_probe(c, r->of, x)) return false;
        }
    }
    return cells_run_probes(c);
}

bool cells_narrow(Cells *c) {
    uint32_t n = 0;
    if (!cells_grow(c, &c->active, &c->active_cap, 2 * c->nroot, sizeof *c->active)) return false;
    for (uint32_t i = 0; i < c->nroot; i++) c->active[n++] = i;
    for (double far = NARROW; n; far *= 8) { /* places on the two sides */
        for (uint32_t i = 0; i < n; i++) {
            Root *r = &c->root[c->active[i]];
            r->lo = fmax(r->ends_at[0], cells_move(c, r->x[r->axis], -far, 0));
            r->hi = fmin(r->ends_at[1], cells_move(c, r->x[r->axis], far, 0));
        }
        if (!probe_bracket(c, n, false)) return false;
        uint32_t kept = 0;
        for (uint32_t i = 0; i < n; i++) {
            Root *r = &c->root[c->active[i]];
            if (near_side(r, c->probe[2 * i].g) && !near_side(r, c->probe[2 * i + 1].g)) continue;
            if (far < 0x1p40) c->active[kept++] = c->active[i];
            else r->hi = r->lo;
        }
        n = kept;
    }
    for (uint32_t i = 0; i < c->nroot; i++) c->active[n++] = i;
    while (n) {
        uint32_t kept = 0;
        for (uint32_t i = 0; i < n; i++) {
            const Root *r = &c->root[c->active[i]];
            if (cells_next(c, r->lo, HUGE_VAL) < r->hi) c->active[kept++] = c->active[i];
        }
        n = kept;
        if (!probe_bracket(c, n, true)) return false;
        for (uint32_t i = 0; i < n; i++) {
            Root *r = &c->root[c->active[i]];
            *(near_side(r, c->probe[i].g) ? &r->lo : &r->hi) = c->probe[i].x[r->axis];
        }
    }
    return true;
}

static const Box *root_box(const Cells *c, const Root *r) {
    return &c->cell[c->piece[c->column[r->column].piece].cell].box;
}

/* Where sides end: at the ends of the cell, and halfway to other curves, of which `reach` tells the nearest. What lies
 * beyond one is not this one's. */
static void find_reach(const Cells *c, const Root *r, double reach[2]) {
    const Column *k = &c->column[r->column];
    const Piece *p = &c->piece[k->piece];
    const Box *box = &c->cell[p->cell].box;
    double at = r->x[r->axis];
    reach[0] = box->lo[r->axis], reach[1] = box->hi[r->axis];
    for (uint32_t i = 0; i < k->nroots; i++) {
        const Root *other = &c->root[k->first + i];
        if (other->edge == r->edge || !(p->present >> other->edge & 1)) continue;
        double to = other->x[r->axis], middle = cells_round(c, at + 0.5 * (to - at));
        if (middle > reach[0] && middle < at && to < middle) reach[0] = middle;
        if (middle < reach[1] && middle > at && to > middle) reach[1] = middle;
    }
}

/* The lowest and the highest of those that a root stands for. */
static void find_ends(const Cells *c, const Root *r, double ends[2]) {
    const Column *k = &c->column[r->column];
    ends[0] = ends[1] = r->x[r->axis];
    for (uint32_t i = k->first; r->twin && i < k->first + k->nroots; i++) {
        double x = c->root[i].x[r->axis];
        if (!c->root[i].other || &c->root[c->root[i].other - 1] != r) continue;
        ends[0] = smaller(ends[0], x), ends[1] = larger(ends[1], x);
    }
}

/* A root that ended where cubics say lies within ASIDE of there. */
static double least_far(const Cells *c, const Root *r) {
    bool apart = !r->twin && !r->band && r->slack >= 0;
    return c->b->f64 && (c->o->flat || apart) ? (double)ASIDE / NARROW : 1;
}

static void call_sides(Cells *c, const uint32_t *active, uint32_t n, double far) {
    Batch *b = c->b;
    for (uint32_t i = 0; i < n; i++) {
        const Root *r = &c->root[active[i]];
        const Box *box = root_box(c, r);
        double x[3], width = box->hi[r->axis] - box->lo[r->axis], d = far * least_far(c, r) * (r->twin ? 16 : 1),
                     reach[2], ends[2];
        double *at = c->sides[r->sides - 1].at;
        /* What f changes by from the root to there is more than rounding in f32: the rules differ by as much. */
        if (!c->b->f64 && c->column[r->column].rule == CELL_COARSE) d *= 2;
        memcpy(x, r->x, sizeof x);
        find_reach(c, r, reach);
        find_ends(c, r, ends);
        double doubt = r->of->event.line ? 2 * cells_doubt(r->of) / fabs(r->dg[r->axis]) : 0;
        at[0] = larger(reach[0], smaller(cells_round(c, ends[0] - doubt), cells_move(c, ends[0], -d, width)));
        at[1] = smaller(reach[1], larger(cells_round(c, ends[1] + doubt), cells_move(c, ends[1], d, width)));
        for (uint32_t s = 0; s < 2; s++) x[r->axis] = at[s], batch_set_x(b, 2 * i + s, x);
    }
    cells_call(c, SLT_K_SIDES, 2 * n);
    for (uint32_t i = 0; i < 2 * n; i++) {
        Sides *s = &c->sides[c->root[active[i / 2]].sides - 1];
        s->hash[i & 1] = (uint32_t)batch_get_int(b, SLT_OUT_HASH, 0, i);
        for (uint32_t ch = 0; ch < c->s->channels; ch++) s->f[i & 1][ch] = batch_get(b, SLT_OUT_F, ch, i);
    }
}

/* The rounding of g matters less than its slope, from the root to both of its sides: what the program decides there is
 * no chance. */
static bool is_sure(const Root *r, const Sides *s) {
    double reach = smaller(r->x[r->axis] - s->at[0], s->at[1] - r->x[r->axis]);
    return fabs(r->dg[r->axis]) * reach > 2 * r->of->error;
}

/* Has g the signs that it should have at the sides, as probed? Where the region differs, at those that are no ends of
 * the cell; where it does not, beyond what the program, which may round a comparison in another way, takes for 0. */
static bool has_signs(const Cells *c, const Root *r, const Probe at[2]) {
    const Sides *s = cells_sides(c, r);
    const Box *box = root_box(c, r);
    double lo = r->rises * at[0].g, hi = r->rises * at[1].g;
    bool begins = s->at[0] <= box->lo[r->axis], ends = s->at[1] >= box->hi[r->axis];
    if (s->hash[0] != s->hash[1]) return (lo < 0 || begins) && (hi > 0 || ends);
    double noise = cells_nearly_0(c, box, r->of->error, r->dg);
    return (lo < -noise && hi > noise) || (begins && ends);
}

/* f at FAR times the distance of a side, from which f is carried on to the root. It may climb from there like a root of
 * the distance, of which the nearest floats see a good part: twice what is near less what is far has no such part. Else
 * f is straight. */
static double carried_on(const Root *r, double near, double far, double f_near, double f_far, bool rough) {
    if (rough) return 2 * f_near - f_far;
    return f_near + (f_near - f_far) * (near - r->x[r->axis]) / (far - near);
}

/* Does f change between near and far by more than these parts of its jump? */
static bool is_steep(const Cells *c, const Sides *s, uint32_t side, const double far[SLT_MAX_CHANNELS], double parts) {
    double unit = c->b->f64 ? 0x1p-52 : 0x1p-23;
    bool steep = false;
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        double jump = fabs(s->f[1][ch] - s->f[0][ch]), f = s->f[side][ch];
        steep |= fabs(far[ch] - f) > parts * jump + 8 * unit * fabs(f);
    }
    return steep;
}

static bool is_rough(const Cells *c, const Root *r) {
    return c->cell[c->piece[c->column[r->column].piece].cell].state & SLT_BOX_ROUGH;
}

#define RIM 0x1p-6     /* of a jump: by that f changes so near to it where it is a small power of the distance, */
#define RIM_MOST 0.74 /* and by no more: 4^0.4 - 1 */

/* Of active[0..n). only_look: f stays what it is. Returns whether it is steep anywhere. */
static bool take_far(Cells *c, uint32_t n, bool only_look) {
    Batch *b = c->b;
    bool steep = false;
    for (uint32_t from = 0; from < n; from += BATCH / 2) {
        uint32_t lanes = n - from < BATCH / 2 ? 2 * (n - from) : BATCH;
        double place[BATCH];
        for (uint32_t i = 0; i < lanes; i++) {
            const Root *r = &c->root[c->active[from + i / 2]];
            const Box *box = root_box(c, r);
            double x[3], at = cells_sides(c, r)->at[i & 1], far = r->x[r->axis] + FAR * (at - r->x[r->axis]);
            memcpy(x, r->x, sizeof x);
            place[i] = x[r->axis] = far >= box->lo[r->axis] && far <= box->hi[r->axis] ? cells_round(c, far) : at;
            batch_set_x(b, i, x);
        }
        cells_call(c, SLT_K_SIDES, lanes);
        for (uint32_t i = 0; i < lanes; i++) {
            const Root *r = &c->root[c->active[from + i / 2]];
            Sides *s = &c->sides[r->sides - 1];
            double at = s->at[i & 1], f[SLT_MAX_CHANNELS];
            if (s->hash[i & 1] != (uint32_t)batch_get_int(b, SLT_OUT_HASH, 0, i)) continue; /* another curve is near */
            for (uint32_t ch = 0; ch < c->s->channels; ch++) f[ch] = batch_get(b, SLT_OUT_F, ch, i);
            steep |= is_steep(c, s, i & 1, f, c->b->f64 ? STEEP_F64 : STEEP);
            /* By so much f may also bend: then the two rules, of which one keeps its sides, differ by all of it. */
            bool bends = !is_rough(c, r) && c->column[r->column].rule == CELL_COARSE && is_steep(c, s, i & 1, f, BENDS);
            for (uint32_t ch = 0; ch < c->s->channels && !only_look && is_rough(c, r) && place[i] != at; ch++) {
                double jump = fabs(s->f[1][ch] - s->f[0][ch]), part = fabs(f[ch] - s->f[i & 1][ch]) / jump;
                c->counts->rough_jump += jump;
                if (part > RIM && part < RIM_MOST) c->counts->rim_jump += jump;
            }
            for (uint32_t ch = 0; ch < c->s->channels && !only_look && !bends && place[i] != at; ch++) {
                double v = carried_on(r, at, place[i], s->f[i & 1][ch], f[ch], is_rough(c, r));
                if (isfinite(v)) s->f[i & 1][ch] = v;
            }
        }
    }
    return steep;
}

/* f on the sides becomes f at the root where it may be rough, and where some roots show that it is steep. */
static void extrapolate_sides(Cells *c, uint32_t known) {
    uint32_t n = 0, smooth = 0;
    for (uint32_t i = 0; i < c->nroot && !c->o->flat; i++) {
        const Root *r = &c->root[i];
        if (r->wanted && r->sides > known && !r->twin && !is_rough(c, r) && smooth++ % LOOKED == 0) c->active[n++] = i;
    }
    bool steep = take_far(c, n, true);
    n = 0;
    for (uint32_t i = 0; i < c->nroot && !c->o->flat; i++) {
        const Root *r = &c->root[i];
        if (r->wanted && r->sides > known && (is_rough(c, r) || (steep && !r->twin))) c->active[n++] = i;
    }
    take_far(c, n, false);
}

static bool probe_sides(Cells *c, const Root *r) {
    double x[3];
    memcpy(x, r->x, sizeof x);
    for (int s = 0; s < 2; s++) {
        x[r->axis] = cells_sides(c, r)->at[s];
        if (!cells_probe(c, r->of, x)) return false;
    }
    return true;
}

static bool is_wave_site(const Cells *c, const Root *r) {
    return (uint32_t)r->of->event.site < c->s->nsites && cells_is_wave(c->s, r->of->event.site);
}

/* Keeps those of active[0..*n) that lack their signs. A level of a wave tells its sides apart where the wave itself,
 * flat near its crests, rounds: that too is asked, for by it the program decides. In f32 the two rules tell. */
static bool keep_unsigned(Cells *c, uint32_t *n) {
    uint32_t kept = 0, waves = 0, *wave = c->active + c->nroot;
    if (!cells_run_probes(c)) return false;
    for (uint32_t i = 0; i < *n; i++) {
        const Root *r = &c->root[c->active[i]];
        bool wrong = !has_signs(c, r, c->probe + 2 * i);
        if (!wrong && c->b->f64 && is_wave_site(c, r)) wave[waves++] = c->active[i];
        if (wrong) c->active[kept++] = c->active[i];
    }
    c->nprobe = 0;
    for (uint32_t i = 0; i < waves; i++)
        if (!probe_sides(c, &c->root[wave[i]])) return false;
    if (waves && !cells_run_site_probes(c)) return false;
    for (uint32_t i = 0; i < waves; i++)
        if (!has_signs(c, &c->root[wave[i]], c->probe + 2 * i)) c->active[kept++] = wave[i];
    *n = kept;
    return true;
}

/* The sides are next to the root, and g has different signs there: the distance grows until it is so, at last to the
 * ends of the column, where it must be. */
bool cells_take_sides(Cells *c) {
    uint32_t n = 0, known = c->nsides;
    if (!cells_grow(c, &c->active, &c->active_cap, 2 * c->nroot, sizeof *c->active)) return false;
    for (uint32_t i = 0; i < c->nroot; i++)
        if (c->root[i].wanted && !c->root[i].sides) {
            if (!CELLS_ROOM(c, sides, 1)) return false;
            c->root[i].sides = ++c->nsides;
            c->active[n++] = i;
        }
    for (double far = NARROW; n; far *= 8) {
        if (far > MOST_FAR) far = HUGE_VAL;
        for (uint32_t from = 0; from < n; from += BATCH / 2)
            call_sides(c, c->active + from, n - from < BATCH / 2 ? n - from : BATCH / 2, far);
        if (far == HUGE_VAL) break;
        uint32_t asked = 0;
        c->nprobe = 0;
        for (uint32_t i = 0; i < n; i++) {
            const Root *r = &c->root[c->active[i]];
            if (r->of->event.line || is_sure(r, cells_sides(c, r))) continue; /* lines are, as far as they can be */
            if (!probe_sides(c, r)) return false;
            c->active[asked++] = c->active[i];
        }
        n = asked;
        if (!keep_unsigned(c, &n)) return false;
    }
    extrapolate_sides(c, known);
    return true;
}
