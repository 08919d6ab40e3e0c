/* Convex polygons: split by half-planes, covered by what is nearer. Polygons stay where they were written; those of the
 * row are the places in `live`. Include behind beams.inc.h. */
typedef L8 WideMask __attribute__((aligned(8)));

static inline void add_corner(Polygon *p, double s, double t, uint32_t side) {
    if (p->n == CORNERS) return; /* never: KEPT and four splits are fewer */
    p->s[p->n] = s, p->t[p->n] = t, p->side[p->n++] = side;
}

/* The corners k to k + 7; 0 where there is none, since numbers without a meaning may be slow ones. */
INLINE D8 corners_at(const Polygon *p, const double *row, uint32_t k) {
    static const int64_t there[16] = {-1, -1, -1, -1, -1, -1, -1, -1};
    const uint32_t n = p->n - k < 8 ? p->n - k : 8;
    return (D8)(*(const WideMask *)&there[8 - n] & *(const WideMask *)&row[k]);
}

/* g at the corners, 0 where they are on the line; which of them are positive, which negative. */
INLINE void signs(const Polygon *p, const double g[3], double d[CORNERS], uint32_t *plus, uint32_t *minus) {
    const double near = ON_LINE * (fabs(g[0]) + fabs(g[1]));
    *plus = *minus = 0;
    for (uint32_t k = 0; k < p->n; k += 8) {
        const D8 at = g[0] * corners_at(p, p->s, k) + g[1] * corners_at(p, p->t, k) + g[2];
        const L8 above = at > near, below = at < -near;
        *plus |= bits_D8(above) << k, *minus |= bits_D8(below) << k;
        *(Wide *)&d[k] = (D8)((above | below) & (L8)at);
    }
    const uint32_t all = (1u << p->n) - 1;
    *plus &= all, *minus &= all;
}

/* A corner on the line is of both; a new one is the same in both. out: may be NULL. */
INLINE void part(const Polygon *p, const double d[CORNERS], uint32_t side, Polygon *in, Polygon *out) {
    in->n = 0, in->facet = p->facet, in->least = p->least;
    if (out) out->n = 0, out->facet = p->facet, out->least = p->least;
    for (uint32_t k = 0; k < p->n; k++) {
        const uint32_t next = k + 1 < p->n ? k + 1 : 0;
        if (d[k] >= 0) add_corner(in, p->s[k], p->t[k], d[k] == 0 && d[next] < 0 ? side : p->side[k]);
        if (out && d[k] <= 0) add_corner(out, p->s[k], p->t[k], d[k] == 0 && d[next] > 0 ? side : p->side[k]);
        if (!(d[k] * d[next] < 0)) continue;
        const double at = d[k] / (d[k] - d[next]), s = p->s[k] + at * (p->s[next] - p->s[k]),
                     t = p->t[k] + at * (p->t[next] - p->t[k]);
        add_corner(in, s, t, d[k] > 0 ? side : p->side[k]);
        if (out) add_corner(out, s, t, d[k] < 0 ? side : p->side[k]);
    }
}

static void split(const Polygon *p, const double g[3], uint32_t side, Polygon *in, Polygon *out) {
    double d[CORNERS];
    uint32_t plus, minus;
    signs(p, g, d, &plus, &minus);
    in->n = out->n = 0;
    if (plus && minus) part(p, d, side, in, out);
    else *(plus ? in : out) = *p;
}

/* What a facet may need for one polygon: two places a split, of which there are four, and four of these halved. */
enum { MOST_PLACES = 16 };

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

/* Puts facet `number` into the polygon live[which], of whose rests some become further ones. There are MOST_PLACES
 * places for it. */
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
        split(&piece[at], crossing.g, moves ? side : SIDE_FIXED, &piece[used], &piece[used + 1]);
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

static void set_rectangle(Polygon *p, const Rectangle *r) {
    p->facet = -1, p->n = 0, p->least = 0;
    for (int k = 0; k < 4; k++)
        add_corner(p, k == 1 || k == 2 ? r->hi[0] : r->lo[0], k >= 2 ? r->hi[1] : r->lo[1], SIDE_FIXED);
}

/* ---- facets beside each other */

#define COVERED 1e-12 /* of a rectangle may be left of it that counts as covered */

/* The part of p in the facet: p itself, one of two places, or NULL, none. */
static const Polygon *clip(const Polygon *p, const Facet *f, uint32_t number, Polygon room[2]) {
    double d[CORNERS];
    uint32_t plus, minus, into = 0;
    for (uint32_t k = 0; k < 3; k++) {
        signs(p, f->g[k], d, &plus, &minus);
        if (!plus) return NULL;
        if (!minus) continue;
        part(p, d, SIDE_OF(number, k), &room[into], NULL);
        p = &room[into], into = !into;
        if (p->n < 3) return NULL;
    }
    return p;
}

/* Does a side of the facet part it from the polygon? */
INLINE bool parted(const Polygon *p, const Facet *f) {
    double d[CORNERS];
    uint32_t plus, minus;
    for (int k = 0; k < 3; k++) {
        signs(p, f->g[k], d, &plus, &minus);
        if (!plus) return true;
    }
    return false;
}

static double area_of(const Polygon *p) {
    double twice = 0;
    for (uint32_t k = 1; k + 1 < p->n; k++)
        twice += (p->s[k] - p->s[0]) * (p->t[k + 1] - p->t[0]) - (p->t[k] - p->t[0]) * (p->s[k + 1] - p->s[0]);
    return 0.5 * twice;
}

/* What most windows see is one sheet: facets that a line parts from each other, pair by pair, and behind them, where
 * they leave nothing of the rectangle free, what is farther than all of them. Then each is cut from the rectangle at
 * once. False: it is not so; facets that are not in the rectangle have been left out. */
static bool cover_with_sheet(Store *store, const Rectangle *r, uint32_t from, uint32_t *n) {
    uint32_t *chosen = store->chosen.data + from, kept = 0, k = 0;
    const double whole = (r->hi[0] - r->lo[0]) * (r->hi[1] - r->lo[1]) * (1 - COVERED);
    double least = HUGE_VAL, behind = -HUGE_VAL, area = 0;
    bool sheet = true;
    Polygon rectangle, room[2];
    set_rectangle(&rectangle, r);
    for (; k < *n && sheet; k++) {
        const Facet *f = &store->facet.data[chosen[k]];
        if (area >= whole && f->most <= least) break;
        const Polygon *p = clip(&rectangle, f, chosen[k], room);
        if (!p) continue;
        chosen[kept++] = chosen[k];
        double near = -HUGE_VAL, far = HUGE_VAL;
        for (uint32_t c = 0; c < p->n; c++) {
            const double d = window_at(f->depth, p->s[c], p->t[c]);
            near = d > near ? d : near, far = d < far ? d : far;
        }
        bool apart = true;
        for (uint32_t i = 0; i < store->live.n && apart; i++) {
            const Polygon *other = &store->piece.data[store->live.data[i]];
            apart = parted(other, f) || parted(p, &store->facet.data[other->facet]);
        }
        if (apart) {
            Polygon *own = &store->piece.data[store->piece.n];
            *own = *p, own->facet = (int32_t)chosen[kept - 1];
            store->live.data[store->live.n++] = store->piece.n++;
            least = far < least ? far : least, area += area_of(p);
        } else {
            behind = near > behind ? near : behind;
            sheet = behind <= least;
        }
    }
    if (sheet && (behind == -HUGE_VAL || (behind <= least && area >= whole))) return true;
    for (; k < *n; k++) chosen[kept++] = chosen[k];
    *n = kept;
    return false;
}

static void cover_all(Store *store, const Rectangle *r, uint32_t from, uint32_t n) {
    store->piece.n = store->live.n = store->crossing.n = 0;
    if (!places(store, n + 2)) return;
    store->piece.data[0].n = 0, store->piece.n = 1;
    if (n <= FEW_FACETS && cover_with_sheet(store, r, from, &n)) return;
    set_rectangle(&store->piece.data[1], r);
    store->piece.n = 2, store->live.n = 0;
    store->live.data[store->live.n++] = 1;
    for (uint32_t k = 0; k < n; k++) {
        const uint32_t pieces = store->live.n;
        if (!places(store, MOST_PLACES * pieces)) return;
        for (uint32_t i = 0; i < pieces; i++)
            if (store->live.data[i]) cover(store, i, store->chosen.data[from + k]);
    }
}
