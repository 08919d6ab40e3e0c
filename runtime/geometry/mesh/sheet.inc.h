/* Windows across which one sheet of faces goes, the most of a fine mesh: eight pairs of a window and a triangle at a
 * time, without decisions. Include behind cover.inc.h.
 *
 * What a triangle has of the window [0, 1]^2 is bordered by parts of its edges' lines, and by parts of the window's
 * border. A line g = 0 is P + at (g_t, -g_s), with the triangle on its left: half-planes narrow `at` to [from, to]. By
 * Green area and moments are sums over these parts; along the border they are differences of what belongs to the way
 * from corner (0, 0) on, where a triangle that has this corner goes around once more. From its other face a line has
 * the same bits, all negated.
 *
 * If each part of an edge inside the window is that of two of the triangles, one on either side, these cover all of the
 * window equally often: once, if their areas sum to 1. Then nothing more needs to be split (told_sheet). */
#define LEAST_AREA 1e-5 /* less is measured by corners: here rounding is that of the window */
#define JOINED 1e-13    /* two lines have a corner in common to within this */

INLINE D8 which(L8 m, D8 a, D8 b) { return (D8)((m & (L8)a) | (~m & (L8)b)); }

typedef struct Sums {
    D8 area, s, t;
} Sums;

/* Of the way along the border from (0, 0) to a place on it, times `sign`. */
INLINE void add_border(Sums *to, L8 where, double sign, D8 s, D8 t, L8 by_t, L8 top, L8 right) {
    const D8 none = {0}, one = none + 1, half = none + 0.5;
    const D8 area = which(by_t, which(top, 1 - 0.5 * s, none), which(right, 0.5 * t, one)),
             of_s = which(by_t, which(top, half, none), which(right, 0.5 * t, half)),
             of_t = which(by_t, which(top, 0.5 - 0.5 * s, none), which(right, none, half));
    to->area += sign * which(where, area, none);
    to->s += sign * which(where, of_s, none), to->t += sign * which(where, of_t, none);
}

static void measure_parts(const PartLines *of, uint32_t n, Parts *p) {
    const D8 none = {0};
    D8 gs[3], gt[3], gc[3], at_s[3], at_t[3], end[3][4];
    L8 inside = ~(L8){0}, bad = {0}, there[3], in_by[3][3], out_by[3][3];
    Sums sum = {none, none, none};
    for (int e = 0; e < 3; e++) {
        gs[e] = *(const Wide *)&of->g[e][0][n], gt[e] = *(const Wide *)&of->g[e][1][n];
        gc[e] = *(const Wide *)&of->g[e][2][n];
        const D8 k = -gc[e] / (gs[e] * gs[e] + gt[e] * gt[e]);
        at_s[e] = k * gs[e], at_t[e] = k * gt[e];
        inside &= under(none, gc[e]);
    }
    for (int e = 0; e < 3; e++) {
        const D8 ds = gt[e], dt = -gs[e], by_ds = 1 / ds, by_dt = 1 / dt;
        const D8 s0 = -at_s[e] * by_ds, s1 = (1 - at_s[e]) * by_ds, t0 = -at_t[e] * by_dt, t1 = (1 - at_t[e]) * by_dt;
        const D8 s_from = lower(s0, s1), s_to = higher(s0, s1), t_from = lower(t0, t1), t_to = higher(t0, t1);
        const L8 in_t = under(s_from, t_from), out_t = under(t_to, s_to);
        D8 from = which(in_t, t_from, s_from), to = which(out_t, t_to, s_to);
        for (int f = 0; f < 3; f++) {
            in_by[e][f] = out_by[e][f] = (L8){0};
            if (f == e) continue;
            const D8 slope = gs[f] * ds + gt[f] * dt, at = -(gs[f] * at_s[e] + gt[f] * at_t[e] + gc[f]) / slope;
            const L8 up = under(none, slope), down = under(slope, none), in = up & under(from, at),
                     out = down & under(at, to);
            bad |= ~(up | down);
            from = which(in, at, from), to = which(out, at, to);
            for (int k = 0; k < f; k++) in_by[e][k] &= ~in, out_by[e][k] &= ~out;
            in_by[e][f] = in, out_by[e][f] = out;
        }
        there[e] = under(from, to);
        const D8 a[2] = {at_s[e] + from * ds, at_t[e] + from * dt}, b[2] = {at_s[e] + to * ds, at_t[e] + to * dt};
        const L8 in = there[e] & ~(in_by[e][0] | in_by[e][1] | in_by[e][2]),
                 out = there[e] & ~(out_by[e][0] | out_by[e][1] | out_by[e][2]);
        const D8 size_s = a[0] * a[0] + a[0] * b[0] + b[0] * b[0], size_t_ = a[1] * a[1] + a[1] * b[1] + b[1] * b[1];
        sum.area += which(there[e], 0.5 * (a[0] * b[1] - a[1] * b[0]), none);
        sum.s += which(there[e], (b[1] - a[1]) * size_s * (1.0 / 6), none);
        sum.t -= which(there[e], (b[0] - a[0]) * size_t_ * (1.0 / 6), none);
        add_border(&sum, in, 1, a[0], a[1], in_t, under(dt, none), under(ds, none));
        add_border(&sum, out, -1, b[0], b[1], out_t, under(none, dt), under(none, ds));
        end[e][0] = a[0], end[e][1] = a[1], end[e][2] = b[0], end[e][3] = b[1];
        for (int k = 0; k < 4; k++) *(Wide *)p->end[e][k] = end[e][k];
        *(Wide *)p->weight[e] = to - from;
        p->there[e] = (uint8_t)bits_D8(there[e]);
    }
    uint32_t apart = 0;
    for (int e = 0; e < 3; e++)
        for (int f = 0; f < 3; f++) {
            if (e == f) continue;
            const L8 out = there[e] & out_by[e][f], in = there[f] & in_by[f][e];
            D8 s = end[e][2] - end[f][0], t = end[e][3] - end[f][1], far_s, far_t;
            size_of(&s, &far_s), size_of(&t, &far_t);
            bad |= out ^ in;
            apart |= bits_D8(out) & ~(upto(far_s, all_D8(JOINED)) & upto(far_t, all_D8(JOINED)));
        }
    const D8 area = sum.area + which(inside, none + 1, none), by = 1 / area;
    *(Wide *)p->area = area;
    *(Wide *)p->centre[0] = (sum.s + which(inside, none + 0.5, none)) * by;
    *(Wide *)p->centre[1] = (sum.t + which(inside, none + 0.5, none)) * by;
    p->good = (uint8_t)(bits_D8(~bad) & ~apart & upto(all_D8(LEAST_AREA), area) & upto(area, all_D8(1)));
}

/* Lines of the edges of a triangle for windows of a row, from number n on: as many as of `who`, and room for eight. */
INLINE void add_parts(Store *store, const Near *near, const Found *f, const D8 u[3], const D8 v[3], uint32_t who,
                      bool alike, uint32_t n) {
    PartLines *to = &store->lines;
    n -= to->measured;
    for (int e = 0; e < 3; e++) {
        if (alike) {
            for (int k = 0; k < 2; k++) *(Wide *)&to->g[e][k][n] = all_D8(near->along[e][k]);
        } else {
            D8 s, t;
            dot8(u, near->normal[e], &s), dot8(v, near->normal[e], &t);
            pack(who, s, &to->g[e][0][n]), pack(who, t, &to->g[e][1][n]);
        }
        pack(who, *(const Wide *)f->c[e], &to->g[e][2][n]);
    }
}

/* Measures all parts up to number *n; more have another number then. False: out of memory. */
static bool measure_sheets(Search *s, uint32_t *n) {
    Store *store = s->store;
    PartLines *from = &store->lines;
    const uint32_t more = *n - from->measured, first = from->measured / 8, chunks = (more + 7) / 8;
    if (!window_room(store, &store->parts.data, first, &store->parts.room, chunks, sizeof *store->parts.data))
        return false;
    for (int e = 0; e < 3; e++)
        for (int k = 0; k < 3; k++) *(Wide *)&from->g[e][k][more] = all_D8(1);
    for (uint32_t i = 0; i < chunks; i++) measure_parts(from, 8 * i, &store->parts.data[first + i]);
    *n = from->measured = 8 * (first + chunks);
    return true;
}
