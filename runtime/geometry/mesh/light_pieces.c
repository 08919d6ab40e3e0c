/* Cuts the light into convex pieces, each wholly lit or dark, sub-window by sub-window. */
#include "light_inner.h"

#include <math.h>

/* ---- polygons */

static void add_corner(Polygon *p, double u, double v, uint32_t side) {
    if (p->n == LIGHT_CORNERS) return; /* never: LIGHT_KEPT and four splits are fewer */
    p->u[p->n] = u, p->v[p->n] = v, p->side[p->n++] = side;
}

static void rectangle(const Window *w, Polygon *p) {
    p->n = 0;
    for (uint32_t k = 0; k < 4; k++) {
        const double u = k == 1 || k == 2 ? w->hi[0] : w->lo[0], v = k >= 2 ? w->hi[1] : w->lo[1];
        const bool border = k == 0 ? w->lo[1] == 0 : k == 1 ? w->hi[0] == 1 : k == 2 ? w->hi[1] == 1 : w->lo[0] == 0;
        add_corner(p, u, v, border ? k : LINE_FIXED);
    }
}

/* g at the corners, 0 where they are on the line; which signs there are. */
static void sides_of(const Polygon *p, const double g[3], double sign, double d[LIGHT_CORNERS], bool *plus,
                     bool *minus) {
    *plus = *minus = false;
    for (uint32_t k = 0; k < p->n; k++) {
        d[k] = sign * light_at(g, p->u[k], p->v[k]);
        if (fabs(d[k]) <= LIGHT_ON_LINE) d[k] = 0;
        *plus |= d[k] > 0, *minus |= d[k] < 0;
    }
}

/* Parts p by d: *in is where it is positive. A corner on the line is of both; a new one is the same in both. */
static void part(const Polygon *p, const double d[LIGHT_CORNERS], uint32_t line, Polygon *in, Polygon *out) {
    in->n = out->n = 0;
    for (uint32_t k = 0; k < p->n; k++) {
        const uint32_t next = k + 1 < p->n ? k + 1 : 0;
        if (d[k] >= 0) add_corner(in, p->u[k], p->v[k], d[k] == 0 && d[next] < 0 ? line : p->side[k]);
        if (d[k] <= 0) add_corner(out, p->u[k], p->v[k], d[k] == 0 && d[next] > 0 ? line : p->side[k]);
        if (!(d[k] * d[next] < 0)) continue;
        const double at = d[k] / (d[k] - d[next]), u = p->u[k] + at * (p->u[next] - p->u[k]),
                     v = p->v[k] + at * (p->v[next] - p->v[k]);
        add_corner(in, u, v, d[k] > 0 ? line : p->side[k]);
        add_corner(out, u, v, d[k] < 0 ? line : p->side[k]);
    }
}

static void copy(Polygon *to, const Polygon *from) {
    to->n = from->n;
    memcpy(to->u, from->u, from->n * sizeof *to->u);
    memcpy(to->v, from->v, from->n * sizeof *to->v);
    memcpy(to->side, from->side, from->n * sizeof *to->side);
}

/* Of *p remains where sign * g is positive, *out is the rest; either may have no corners. */
static void split(Polygon *p, const double g[3], double sign, uint32_t line, Polygon *out) {
    double d[LIGHT_CORNERS];
    bool plus, minus;
    sides_of(p, g, sign, d, &plus, &minus);
    if (plus && minus) {
        Polygon whole;
        copy(&whole, p);
        part(&whole, d, line, p, out);
    } else if (plus) {
        out->n = 0;
    } else {
        copy(out, p);
        p->n = 0;
    }
}

static void keep(Light *l, const Polygon *p);

/* A polygon of many corners is halved along a chord, which does not move. */
static void halve(Light *l, const Polygon *p) {
    Polygon a = {0}, b = {0};
    const uint32_t middle = p->n / 2;
    for (uint32_t k = 0; k <= middle; k++) add_corner(&a, p->u[k], p->v[k], k < middle ? p->side[k] : LINE_FIXED);
    for (uint32_t k = middle; k < p->n; k++) add_corner(&b, p->u[k], p->v[k], p->side[k]);
    add_corner(&b, p->u[0], p->v[0], LINE_FIXED);
    keep(l, &a);
    keep(l, &b);
}

static void bound(Polygon *p) {
    for (int i = 0; i < 2; i++) {
        const double *x = i ? p->v : p->u;
        p->low[i] = p->high[i] = x[0];
        for (uint32_t k = 1; k < p->n; k++)
            p->low[i] = light_min(p->low[i], x[k]), p->high[i] = light_max(p->high[i], x[k]);
    }
}

/* Makes row `which` of pieces a copy of p. */
static void set(Light *l, uint32_t which, const Polygon *p) {
    copy(&l->store->piece.data[which], p);
    bound(&l->store->piece.data[which]);
}

static void keep(Light *l, const Polygon *p) {
    if (p->n < 3) return;
    if (p->n > LIGHT_KEPT) {
        halve(l, p);
        return;
    }
    LightStore *s = l->store;
    if (!row_room(&s->piece.data, s->piece.n, &s->piece.room, sizeof *s->piece.data)) l->lost = true;
    else set(l, s->piece.n++, p);
}

void light_above(const Light *l, const Window *w, Polygon *p) {
    Polygon below;
    if (l->lit) {
        const double line[4][3] = {{0, 1, -w->lo[1]}, {-1, 0, w->hi[0]}, {0, -1, w->hi[1]}, {1, 0, -w->lo[0]}};
        copy(p, &l->lit->polygon);
        for (int k = 0; k < 4; k++) split(p, line[k], 1, LINE_FIXED, &below);
        return;
    }
    rectangle(w, p);
    split(p, l->clip[0], 1, LINE_HORIZON, &below);
}

/* ---- silhouettes */

/* Is the box of the piece wholly, and by more than rounding, on one side of the line? */
static bool keeps_clear(const double g[3], const Polygon *p) {
    const double wide = 0.5 * (p->high[0] - p->low[0]), high = 0.5 * (p->high[1] - p->low[1]);
    return fabs(light_at(g, p->low[0] + wide, p->low[1] + high)) > fabs(g[0]) * wide + fabs(g[1]) * high + 1e-9;
}

/* Cuts piece number `which` if the segment runs through it. A side that it lies on becomes its. */
static void cut(Light *l, uint32_t which, uint32_t line) {
    const Segment *s = &l->store->segment.data[line];
    Polygon *p = &l->store->piece.data[which], in, out;
    double d[LIGHT_CORNERS], from = HUGE_VAL, to = -HUGE_VAL;
    bool plus, minus;
    for (int i = 0; i < 2; i++)
        if (s->high[i] < p->low[i] - LIGHT_ON_LINE || s->low[i] > p->high[i] + LIGHT_ON_LINE) return;
    if (keeps_clear(s->g, p)) return;
    sides_of(p, s->g, 1, d, &plus, &minus);
    for (uint32_t k = 0; k < p->n; k++) {
        const uint32_t next = k + 1 < p->n ? k + 1 : 0;
        if (!plus || !minus) {
            if (d[k] == 0 && d[next] == 0 && p->side[k] == LINE_FIXED) p->side[k] = line;
            continue;
        }
        if (d[k] != 0 && !(d[k] * d[next] < 0)) continue;
        const double at = d[k] == 0 ? 0 : d[k] / (d[k] - d[next]), u = p->u[k] + at * (p->u[next] - p->u[k]),
                     v = p->v[k] + at * (p->v[next] - p->v[k]), along = s->g[0] * v - s->g[1] * u;
        from = light_min(from, along), to = light_max(to, along);
    }
    if (!(light_min(to, s->to) - light_max(from, s->from) > LIGHT_ON_LINE)) return;
    part(p, d, line, &in, &out);
    p->n = 0;
    if (in.n >= 3 && in.n <= LIGHT_KEPT) set(l, which, &in);
    else keep(l, &in);
    keep(l, &out);
}

static void middle_of(const Polygon *p, double at[2]) {
    at[0] = at[1] = 0;
    for (uint32_t i = 0; i < p->n; i++) at[0] += p->u[i], at[1] += p->v[i];
    at[0] /= p->n, at[1] /= p->n;
}

/* Each piece is asked at its middle. */
static void find_lit(Light *l) {
    enum { FEW_TRIANGLES = 32 };
    LightStore *store = l->store;
    store->lit.n = 0;
    for (uint32_t i = 0; i < store->piece.n; i++)
        if (!ROW_ADD(store->lit, true)) {
            l->lost = true;
            return;
        }
    uint32_t n = 0;
    for (uint32_t i = 0; i < store->piece.n; i++)
        if (store->piece.data[i].n >= 3 && n++ < i) set(l, n - 1, &store->piece.data[i]);
    store->piece.n = n;
    const bool few = l->lit && store->triangle.n <= FEW_TRIANGLES;
    for (uint32_t from = 0; from < n; from += LIGHT_AT_ONCE) {
        double place[LIGHT_AT_ONCE][2];
        bool dark[LIGHT_AT_ONCE];
        const uint32_t some = n - from < LIGHT_AT_ONCE ? n - from : LIGHT_AT_ONCE;
        for (uint32_t k = 0; k < some; k++) {
            middle_of(&store->piece.data[from + k], place[k]);
            if (few) dark[k] = light_ask_all(l, place[k]);
        }
        if (!few) light_ask(l, (const double(*)[2])place, some, dark);
        for (uint32_t k = 0; k < some; k++) store->lit.data[from + k] = !dark[k];
    }
}

/* ---- triangle by triangle */

static bool covered_part(const Light *l, const Facet *f, const Polygon *p, Polygon *in) {
    Polygon out;
    copy(in, p);
    for (uint32_t k = 0; k < 3u + f->cut && in->n >= 3; k++)
        split(in, l->store->segment.data[f->line + k].g, k < 3 ? f->sign[k] : 1, f->line + k, &out);
    return in->n >= 3;
}

/* Takes from piece number `which` what the facet hides. */
static void subtract(Light *l, uint32_t which, const Facet *f) {
    Polygon p, in, out;
    copy(&p, &l->store->piece.data[which]);
    if (!covered_part(l, f, &p, &in)) return;
    l->store->piece.data[which].n = 0;
    for (uint32_t k = 0; k < 3u + f->cut; k++) {
        split(&p, l->store->segment.data[f->line + k].g, k < 3 ? f->sign[k] : 1, f->line + k, &out);
        keep(l, &out);
    }
}

static bool covers(const Light *l, const Facet *f, const Polygon *p) {
    for (uint32_t e = 0; e < 3u + f->cut; e++) {
        const double *g = l->store->segment.data[f->line + e].g, sign = e < 3 ? f->sign[e] : 1;
        for (uint32_t k = 0; k < p->n; k++)
            if (!(sign * light_at(g, p->u[k], p->v[k]) >= 0)) return false;
    }
    return true;
}

/* ---- sub-windows */

static bool segment_in(const Segment *s, const Window *w) {
    bool plus = false, minus = false;
    for (int i = 0; i < 2; i++)
        if ((s->end[0][i] < w->lo[i] && s->end[1][i] < w->lo[i]) ||
            (s->end[0][i] > w->hi[i] && s->end[1][i] > w->hi[i]))
            return false;
    for (int k = 0; k < 4; k++) {
        const double g = light_at(s->g, k & 1 ? w->hi[0] : w->lo[0], k & 2 ? w->hi[1] : w->lo[1]);
        plus |= g >= 0, minus |= g <= 0;
    }
    return plus && minus;
}

/* List entries from .. to - 1 are segments, or facets, in the window. */
static void finish(Light *l, uint32_t from, uint32_t to, const Polygon *whole, bool facets) {
    LightStore *store = l->store;
    store->piece.n = 0;
    keep(l, whole);
    for (uint32_t k = from; k < to; k++)
        for (uint32_t i = 0, n = store->piece.n; i < n; i++) {
            if (store->piece.data[i].n < 3) continue;
            if (facets) subtract(l, i, &store->facet.data[store->list.data[k]]);
            else cut(l, i, store->list.data[k]);
        }
    if (!facets) find_lit(l);
    for (uint32_t k = from; k < to && facets; k++) {
        const Facet *f = &store->facet.data[store->list.data[k]];
        for (uint32_t e = 0; e < 3u + f->cut; e++)
            if (!ROW_ADD(store->list, f->line + e)) l->lost = true;
    }
    if (facets) from = to, to = store->list.n;
    const uint32_t near = store->near.n;
    for (uint32_t k = from; k < to; k++)
        if (!ROW_ADD(store->near, store->list.data[k])) l->lost = true;
    for (uint32_t i = 0; i < store->piece.n && !l->lost; i++) {
        if (store->piece.data[i].n < 3 || !(facets || store->lit.data[i])) continue;
        if (!row_room(&store->shown.data, store->shown.n, &store->shown.room, sizeof *store->shown.data)) {
            l->lost = true;
            return;
        }
        Shown *s = &store->shown.data[store->shown.n++];
        copy(&s->p, &store->piece.data[i]);
        s->from = near, s->n = to - from;
    }
}

void light_shine(Light *l) {
    LightStore *store = l->store;
    light_add_arcs(l);
    for (uint32_t i = 0; i < store->shown.n; i++) {
        Shown *s = &store->shown.data[i];
        Polygon below;
        if (l->lobe) split(&s->p, l->clip[1], 1, LINE_FIXED, &below);
        if (s->p.n >= 3) light_add(l, &s->p, s->n ? store->near.data + s->from : NULL, s->n);
    }
}

static void look(Light *l, uint32_t from, uint32_t to, const Window *w, int halvings, bool facets) {
    LightStore *store = l->store;
    const uint32_t kept = store->list.n;
    Polygon whole, in;
    light_above(l, w, &whole);
    if (whole.n < 3) return;
    for (uint32_t k = from; k < to; k++) {
        const uint32_t i = store->list.data[k];
        if (facets ? !covered_part(l, &store->facet.data[i], &whole, &in) : !segment_in(&store->segment.data[i], w))
            continue;
        if (facets && covers(l, &store->facet.data[i], &whole)) {
            store->list.n = kept;
            return;
        }
        if (!ROW_ADD(store->list, i)) l->lost = true;
    }
    const uint32_t end = store->list.n;
    if (end - kept <= LIGHT_FEW || halvings == LIGHT_HALVINGS) {
        finish(l, kept, end, &whole, facets);
    } else {
        /* Not in the middle, where edges of symmetric scenes lie. */
        const int axis = w->hi[0] - w->lo[0] >= w->hi[1] - w->lo[1] ? 0 : 1;
        const double middle = w->lo[axis] + 0.4897 * (w->hi[axis] - w->lo[axis]);
        Window half = *w;
        half.hi[axis] = middle;
        look(l, kept, end, &half, halvings + 1, facets);
        half = *w;
        half.lo[axis] = middle;
        look(l, kept, end, &half, halvings + 1, facets);
    }
    store->list.n = kept;
}

void light_look(Light *l, bool facets) {
    LightStore *store = l->store;
    const uint32_t n = facets ? store->facet.n : store->segment.n;
    if (!facets) light_lines(l);
    store->list.n = store->shown.n = store->near.n = 0;
    for (uint32_t i = facets ? 0 : l->nborder; i < n; i++)
        if (!ROW_ADD(store->list, i)) l->lost = true;
    if (!l->lost) look(l, 0, store->list.n, &(Window){{0, 0}, {1, 1}}, 0, facets);
}
