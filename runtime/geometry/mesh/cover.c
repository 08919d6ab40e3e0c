/* Convex polygons: split by half-planes, covered by what is nearer. Polygons stay where they were written; those of the
 * row are the places in `live`. */
#include <math.h>
#include <string.h>

#include "window.h"

static inline void add_corner(Polygon *p, double s, double t, uint32_t side) {
    if (p->n == CORNERS) return; /* never: KEPT and four splits are fewer */
    p->s[p->n] = s, p->t[p->n] = t, p->side[p->n++] = side;
}

/* g at the corners, 0 where they are on the line; which of them are positive, which negative. One by one: they have
 * just been written so, and processors do not read several writes as one. */
static inline void signs(const Polygon *p, const double g[3], double d[CORNERS], uint32_t *plus, uint32_t *minus) {
    const double near = ON_LINE * (fabs(g[0]) + fabs(g[1]));
    uint32_t above = 0, below = 0;
    for (uint32_t k = 0; k < p->n; k++) {
        const double at = window_at(g, p->s[k], p->t[k]);
        above |= (uint32_t)(at > near) << k, below |= (uint32_t)(at < -near) << k;
        d[k] = fabs(at) <= near ? 0 : at;
    }
    *plus = above, *minus = below;
}

/* A corner on the line is of both; a new one is the same in both. */
static void part(const Polygon *p, const double d[CORNERS], uint32_t side, Polygon *in, Polygon *out) {
    in->n = out->n = 0;
    in->facet = out->facet = p->facet, in->least = out->least = p->least;
    for (uint32_t k = 0; k < p->n; k++) {
        const uint32_t next = k + 1 < p->n ? k + 1 : 0;
        if (d[k] >= 0) add_corner(in, p->s[k], p->t[k], d[k] == 0 && d[next] < 0 ? side : p->side[k]);
        if (d[k] <= 0) add_corner(out, p->s[k], p->t[k], d[k] == 0 && d[next] > 0 ? side : p->side[k]);
        if (!(d[k] * d[next] < 0)) continue;
        const double at = d[k] / (d[k] - d[next]), s = p->s[k] + at * (p->s[next] - p->s[k]),
                     t = p->t[k] + at * (p->t[next] - p->t[k]);
        add_corner(in, s, t, d[k] > 0 ? side : p->side[k]);
        add_corner(out, s, t, d[k] < 0 ? side : p->side[k]);
    }
}

void cover_split(const Polygon *p, const double g[3], uint32_t side, Polygon *in, Polygon *out) {
    double d[CORNERS];
    uint32_t plus, minus;
    signs(p, g, d, &plus, &minus);
    in->n = out->n = 0;
    if (plus && minus) part(p, d, side, in, out);
    else *(plus ? in : out) = *p;
}

/* Places for so many more polygons. */
static bool places(Store *store, uint32_t more) {
    return window_room(store, &store->piece.data, store->piece.n, &store->piece.room, more,
                       sizeof *store->piece.data) &&
           window_room(store, &store->live.data, store->live.n, &store->live.room, more, sizeof *store->live.data);
}

/* A polygon of many corners is halved along a chord, which does not move. */
static void keep(Store *store, uint32_t place) {
    if (store->piece.data[place].n < 3) return;
    if (store->piece.data[place].n <= KEPT) {
        store->live.data[store->live.n++] = place;
        return;
    }
    if (!places(store, 2)) return;
    const Polygon *p = &store->piece.data[place];
    Polygon *half = &store->piece.data[store->piece.n];
    const uint32_t middle = p->n / 2;
    for (int i = 0; i < 2; i++) half[i].facet = p->facet, half[i].n = 0, half[i].least = p->least;
    for (uint32_t k = 0; k <= middle; k++) add_corner(&half[0], p->s[k], p->t[k], k < middle ? p->side[k] : SIDE_FIXED);
    for (uint32_t k = middle; k < p->n; k++) add_corner(&half[1], p->s[k], p->t[k], p->side[k]);
    add_corner(&half[1], p->s[0], p->t[0], SIDE_FIXED);
    for (int i = 0; i < 2; i++) store->live.data[store->live.n++] = store->piece.n++;
}

/* It is the facet's now. */
static void take(Polygon *p, const Facet *f, uint32_t number) {
    double least = HUGE_VAL;
    p->facet = (int32_t)number;
    for (uint32_t k = 0; k < p->n; k++) {
        const double d = window_at(f->depth, p->s[k], p->t[k]);
        if (d < least) least = d;
    }
    p->least = least;
}

/* Where at the corners is the depth of f more than the other's, where less? */
static void compare(const Polygon *p, const Facet *f, const Facet *other, bool *front, bool *behind) {
    *front = *behind = false;
    for (uint32_t k = 0; k < p->n; k++) {
        const double mine = window_at(f->depth, p->s[k], p->t[k]), its = window_at(other->depth, p->s[k], p->t[k]),
                     near = SAME_DEPTH * (fabs(mine) + fabs(its));
        *front |= mine - its > near, *behind |= mine - its < -near;
    }
    if (!*front && !*behind) *front = f->triangle < other->triangle;
}

/* Puts facet `number` into the polygon live[which], of whose rests some become further ones. */
static void cover(Store *store, uint32_t which, uint32_t number) {
    const Facet *f = &store->facet.data[number];
    const uint32_t start = store->live.data[which];
    Polygon *piece = store->piece.data;
    const int32_t before = piece[start].facet;
    if (before >= 0 && f->most <= piece[start].least) return;
    double d[3][CORNERS];
    uint32_t plus[3], minus[3], at = start, used = store->piece.n, rest[4], nrest = 0;
    for (int k = 0; k < 3; k++) {
        signs(&piece[start], f->g[k], d[k], &plus[k], &minus[k]);
        if (!plus[k]) return;
    }
    for (uint32_t k = 0; k < 3; k++) {
        if (!minus[k]) continue;
        if (at != start) signs(&piece[at], f->g[k], d[k], &plus[k], &minus[k]);
        if (!plus[k]) return;
        if (!minus[k]) continue;
        part(&piece[at], d[k], SIDE_OF(number, k), &piece[used], &piece[used + 1]);
        if (piece[used].n < 3) return;
        at = used, rest[nrest++] = used + 1, used += 2;
    }
    bool front = true, behind = false;
    const Facet *other = before < 0 ? NULL : &store->facet.data[before];
    if (other) compare(&piece[at], f, other, &front, &behind);
    if (!front) return;
    if (behind) {
        Crossing crossing = {.a = f->triangle, .b = other->triangle};
        const uint32_t side = SIDE_CROSSING | store->crossing.n;
        for (int i = 0; i < 3; i++) crossing.g[i] = f->depth[i] - other->depth[i];
        const bool moves = PUSH(store, store->crossing, crossing);
        cover_split(&piece[at], crossing.g, moves ? side : SIDE_FIXED, &piece[used], &piece[used + 1]);
        at = used, rest[nrest++] = used + 1, used += 2;
    }
    take(&piece[at], f, number);
    store->piece.n = used;
    /* Its place in the row is the facet's, so that nothing needs to be taken out. */
    store->live.data[which] = at;
    if (piece[at].n > KEPT || piece[at].n < 3) {
        store->live.data[which] = 0; /* which is nothing */
        keep(store, at);
    }
    for (uint32_t k = 0; k < nrest; k++) keep(store, rest[k]);
}

void cover_all(Store *store, const Rectangle *r, uint32_t from, uint32_t n) {
    store->piece.n = store->live.n = store->crossing.n = 0;
    if (!places(store, 2)) return;
    Polygon *piece = store->piece.data;
    piece[0].n = 0;
    piece[1].facet = -1, piece[1].n = 0, piece[1].least = 0;
    for (int k = 0; k < 4; k++)
        add_corner(&piece[1], k == 1 || k == 2 ? r->hi[0] : r->lo[0], k >= 2 ? r->hi[1] : r->lo[1], SIDE_FIXED);
    store->piece.n = 2;
    store->live.data[store->live.n++] = 1;
    for (uint32_t k = 0; k < n; k++)
        for (uint32_t i = 0, pieces = store->live.n; i < pieces; i++)
            if (store->live.data[i] && places(store, 16)) cover(store, i, store->chosen.data[from + k]);
}
