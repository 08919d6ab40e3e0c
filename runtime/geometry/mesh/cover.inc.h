/* Convex polygons: split by half-planes, covered by what is nearer. Include behind facets.inc.h. */

INLINE void add_corner(Polygon *p, double s, double t, uint32_t side) {
    if (p->n == CORNERS) return; /* never: KEPT and four splits are fewer */
    p->s[p->n] = s, p->t[p->n] = t, p->side[p->n++] = side;
}

/* As much of it as there is. */
INLINE void copy(Polygon *to, const Polygon *from) {
    const size_t n = from->n <= 8 ? 8 : CORNERS;
    to->facet = from->facet, to->n = from->n, to->least = from->least;
    memcpy(to->s, from->s, n * sizeof *to->s);
    memcpy(to->t, from->t, n * sizeof *to->t);
    memcpy(to->side, from->side, n * sizeof *to->side);
}

/* g at the corners, 0 where they are on the line; which of them are positive, which negative. One by one: they have
 * just been written so, and processors do not read several writes as one. */
INLINE void signs(const Polygon *p, const double g[3], double d[CORNERS], uint32_t *plus, uint32_t *minus) {
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

static void split(const Polygon *p, const double g[3], uint32_t side, Polygon *in, Polygon *out) {
    double d[CORNERS];
    uint32_t plus, minus;
    signs(p, g, d, &plus, &minus);
    in->n = out->n = 0;
    if (plus && minus) part(p, d, side, in, out);
    else copy(plus ? in : out, p);
}

static void keep(Store *store, const Polygon *p);

/* A polygon of many corners is halved along a chord, which does not move. */
static void halve(Store *store, const Polygon *p) {
    Polygon half[2];
    const uint32_t middle = p->n / 2;
    for (int i = 0; i < 2; i++) half[i].facet = p->facet, half[i].n = 0, half[i].least = p->least;
    for (uint32_t k = 0; k <= middle; k++) add_corner(&half[0], p->s[k], p->t[k], k < middle ? p->side[k] : SIDE_FIXED);
    for (uint32_t k = middle; k < p->n; k++) add_corner(&half[1], p->s[k], p->t[k], p->side[k]);
    add_corner(&half[1], p->s[0], p->t[0], SIDE_FIXED);
    keep(store, &half[0]);
    keep(store, &half[1]);
}

static void keep(Store *store, const Polygon *p) {
    if (p->n < 3) return;
    if (p->n > KEPT) halve(store, p);
    else if (window_room(store, &store->piece.data, store->piece.n, &store->piece.room, 1, sizeof *p))
        copy(&store->piece.data[store->piece.n++], p);
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
INLINE void compare(const Polygon *p, const Facet *f, const Facet *other, bool *front, bool *behind) {
    *front = *behind = false;
    for (uint32_t k = 0; k < p->n; k++) {
        const double mine = window_at(f->depth, p->s[k], p->t[k]), its = window_at(other->depth, p->s[k], p->t[k]),
                     near = SAME_DEPTH * (fabs(mine) + fabs(its));
        *front |= mine - its > near, *behind |= mine - its < -near;
    }
    if (!*front && !*behind) *front = f->triangle < other->triangle;
}

/* Puts facet `number` into piece `which`, of whose rests some become further pieces. */
static void cover(Store *store, uint32_t which, uint32_t number) {
    const Facet *f = &store->facet.data[number];
    const Polygon *old = &store->piece.data[which], *in = old;
    if (old->facet >= 0 && f->most <= old->least) return;
    double d[3][CORNERS];
    uint32_t plus[3], minus[3], nrest = 0;
    for (int k = 0; k < 3; k++) {
        signs(old, f->g[k], d[k], &plus[k], &minus[k]);
        if (!plus[k]) return;
    }
    Polygon row[2], rest[4];
    for (uint32_t k = 0; k < 3; k++) {
        if (!minus[k]) continue;
        if (in != old) signs(in, f->g[k], d[k], &plus[k], &minus[k]);
        if (!plus[k]) return;
        if (!minus[k]) continue;
        Polygon *to = &row[in == &row[0]];
        part(in, d[k], SIDE_OF(number, k), to, &rest[nrest++]);
        if (to->n < 3) return;
        in = to;
    }
    bool front = true, behind = false;
    const Facet *other = old->facet < 0 ? NULL : &store->facet.data[old->facet];
    if (other) compare(in, f, other, &front, &behind);
    if (!front) return;
    Polygon mine;
    if (behind) {
        Crossing crossing = {.a = f->triangle, .b = other->triangle};
        const uint32_t side = SIDE_CROSSING | store->crossing.n;
        for (int i = 0; i < 3; i++) crossing.g[i] = f->depth[i] - other->depth[i];
        const bool moves = PUSH(store, store->crossing, crossing);
        split(in, crossing.g, moves ? side : SIDE_FIXED, &mine, &rest[nrest]);
        if (rest[nrest].n) nrest++;
    } else {
        copy(&mine, in);
    }
    take(&mine, f, number);
    /* Its place in the row goes to what is the facet's, so that nothing needs to be taken out. */
    store->piece.data[which].n = 0;
    if (mine.n >= 3 && mine.n <= KEPT) copy(&store->piece.data[which], &mine);
    else keep(store, &mine);
    for (uint32_t k = 0; k < nrest; k++) keep(store, &rest[k]);
}

static void cover_all(Store *store, const Rectangle *r, uint32_t from, uint32_t n) {
    Polygon whole = {.facet = -1, .n = 4};
    for (int k = 0; k < 4; k++) {
        whole.s[k] = k == 1 || k == 2 ? r->hi[0] : r->lo[0], whole.t[k] = k >= 2 ? r->hi[1] : r->lo[1];
        whole.side[k] = SIDE_FIXED;
    }
    store->piece.n = store->crossing.n = 0;
    keep(store, &whole);
    for (uint32_t k = 0; k < n; k++)
        for (uint32_t i = 0, pieces = store->piece.n; i < pieces; i++)
            if (store->piece.data[i].n >= 3) cover(store, i, store->chosen.data[from + k]);
}
