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
        const L8 above = under(all_D8(near), at), below = under(at, all_D8(-near));
        *plus |= bits_D8(above) << k, *minus |= bits_D8(below) << k;
        *(Wide *)&d[k] = (D8)((above | below) & (L8)at);
    }
    const uint32_t all = (1u << p->n) - 1;
    *plus &= all, *minus &= all;
}

/* Where a line passes from corner k to the next. */
typedef struct Passing {
    double s, t;
} Passing;

INLINE Passing passing(const Polygon *p, const double d[CORNERS], uint32_t k, uint32_t next) {
    const double at = d[k] / (d[k] - d[next]);
    return (Passing){p->s[k] + at * (p->s[next] - p->s[k]), p->t[k] + at * (p->t[next] - p->t[k])};
}

/* Corners from `first` to `last`, which are some but not all, and what lies before and behind them on the line unless
 * they do. They are in a row, p being convex; where rounding has bent it by more than ON_LINE, less than that is lost.
 */
INLINE void add_run(const Polygon *p, const double d[CORNERS], uint32_t first, uint32_t last, const Passing *before,
                    const Passing *behind, uint32_t side, Polygon *to) {
    const uint32_t n = p->n;
    to->n = 0, to->facet = p->facet, to->least = p->least;
    if (d[first] != 0) add_corner(to, before->s, before->t, p->side[first ? first - 1 : n - 1]);
    for (uint32_t k = first; k != last; k = k + 1 < n ? k + 1 : 0) add_corner(to, p->s[k], p->t[k], p->side[k]);
    if (d[last] == 0) {
        add_corner(to, p->s[last], p->t[last], side);
    } else {
        add_corner(to, p->s[last], p->t[last], p->side[last]);
        add_corner(to, behind->s, behind->t, side);
    }
}

/* Where the corners `kept` begin and end. */
INLINE void run_of(uint32_t kept, uint32_t n, uint32_t *first, uint32_t *last) {
    const uint32_t off = ((1u << n) - 1) & ~kept;
    *first = (uint32_t)__builtin_ctz(kept & (off << 1 | off >> (n - 1)));
    const uint32_t ends = off & (kept << 1 | kept >> (n - 1)), next = (uint32_t)__builtin_ctz(ends);
    *last = next ? next - 1 : n - 1;
}

#if defined(__AVX512F__)
/* rest_of of few corners, without decisions. They are written as vectors: what follows reads them so, at once. */
INLINE void rest_of_few(const Polygon *p, const double d[CORNERS], uint32_t off, uint32_t side, Polygon *to) {
    const uint32_t n = p->n;
    uint32_t first, last;
    run_of(((1u << n) - 1) & ~off, n, &first, &last);
    const Passing before = passing(p, d, first ? first - 1 : n - 1, first),
                  behind = passing(p, d, last, last + 1 < n ? last + 1 : 0);
    const uint32_t begins = d[first] != 0, ends = d[last] != 0,
                   count = (last < first ? last + n : last) - first + 1 + begins + ends;
    /* Corner by corner from the one before the first, if what lies there is kept. */
    __m512i from =
        _mm512_add_epi64(_mm512_set_epi64(7, 6, 5, 4, 3, 2, 1, 0), _mm512_set1_epi64((int64_t)first - (int64_t)begins));
    const __m512i all = _mm512_set1_epi64(n);
    from = _mm512_mask_add_epi64(from, _mm512_movepi64_mask(from), from, all);
    from = _mm512_mask_sub_epi64(from, _mm512_cmpge_epi64_mask(from, all), from, all);
    const __mmask8 at_last = (__mmask8)(1u << (count - 1)), new_last = ends ? at_last : 0, new_first = (__mmask8)begins;
    __m512d s = _mm512_permutexvar_pd(from, _mm512_loadu_pd(p->s)),
            t = _mm512_permutexvar_pd(from, _mm512_loadu_pd(p->t));
    s = _mm512_mask_mov_pd(s, new_first, _mm512_set1_pd(before.s));
    t = _mm512_mask_mov_pd(t, new_first, _mm512_set1_pd(before.t));
    s = _mm512_mask_mov_pd(s, new_last, _mm512_set1_pd(behind.s));
    t = _mm512_mask_mov_pd(t, new_last, _mm512_set1_pd(behind.t));
    const __m256i sides =
        _mm256_permutexvar_epi32(_mm512_cvtepi64_epi32(from), _mm256_loadu_si256((const __m256i *)p->side));
    to->n = count, to->facet = p->facet, to->least = p->least;
    _mm512_storeu_pd(to->s, s), _mm512_storeu_pd(to->t, t);
    _mm256_storeu_si256((__m256i *)to->side, _mm256_mask_mov_epi32(sides, at_last, _mm256_set1_epi32((int32_t)side)));
}
#endif

/* What a line leaves of p, less the corners `off`, of which there are some but not all. */
INLINE void rest_of(const Polygon *p, const double d[CORNERS], uint32_t off, uint32_t side, Polygon *to) {
    uint32_t first, last;
#if defined(__AVX512F__)
    if (p->n < 8) {
        rest_of_few(p, d, off, side, to);
        return;
    }
#endif
    Passing before = {0}, behind = {0};
    run_of(((1u << p->n) - 1) & ~off, p->n, &first, &last);
    if (d[first] != 0) before = passing(p, d, first ? first - 1 : p->n - 1, first);
    if (d[last] != 0) behind = passing(p, d, last, last + 1 < p->n ? last + 1 : 0);
    add_run(p, d, first, last, &before, &behind, side, to);
}
static void split(const Polygon *p, const double g[3], uint32_t side, Polygon *in, Polygon *out) {
    double d[CORNERS];
    uint32_t plus, minus;
    signs(p, g, d, &plus, &minus);
    in->n = out->n = 0;
    if (plus && minus) rest_of(p, d, minus, side, in), rest_of(p, d, plus, side, out);
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
INLINE void compare_corners(const Polygon *p, const Facet *f, const Facet *other, bool *front, bool *behind) {
    uint32_t more = 0, less_ = 0;
    for (uint32_t k = 0; k < p->n; k += 8) {
        const D8 s = corners_at(p, p->s, k), t = corners_at(p, p->t, k),
                 mine = f->depth[0] * s + f->depth[1] * t + f->depth[2],
                 its = other->depth[0] * s + other->depth[1] * t + other->depth[2], apart = mine - its;
        const uint32_t there = p->n - k < 8 ? (1u << (p->n - k)) - 1 : 255;
        D8 mine_size, its_size;
        size_of(&mine, &mine_size), size_of(&its, &its_size);
        const D8 near = SAME_DEPTH * (mine_size + its_size);
        more |= less(near, apart) & there, less_ |= less(apart, -near) & there;
    }
    *front = more != 0, *behind = less_ != 0;
}

static void compare(const Polygon *p, const Facet *f, const Facet *other, bool *front, bool *behind) {
    compare_corners(p, f, other, front, behind);
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
        rest_of(&piece[at], d[k], minus[k], SIDE_OF(number, k), &piece[used]);
        rest_of(&piece[at], d[k], plus[k], SIDE_OF(number, k), &piece[used + 1]);
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

/* ---- what does not cross */

static double area_of(const Polygon *p) {
    double twice = 0;
    for (uint32_t k = 1; k + 1 < p->n; k++)
        twice += (p->s[k] - p->s[0]) * (p->t[k + 1] - p->t[0]) - (p->t[k] - p->t[0]) * (p->s[k + 1] - p->s[0]);
    return 0.5 * twice;
}

/* The part of p in the facet: p itself, one of two places, or NULL, none. */
static const Polygon *clip(const Polygon *p, const Facet *f, uint32_t number, Polygon room[2]) {
    double d[CORNERS];
    uint32_t plus, minus, into = 0;
    for (uint32_t k = 0; k < 3; k++) {
        signs(p, f->g[k], d, &plus, &minus);
        if (!plus) return NULL;
        if (!minus) continue;
        rest_of(p, d, minus, SIDE_OF(number, k), &room[into]);
        p = &room[into], into = !into;
        if (p->n < 3) return NULL;
    }
    return p;
}

/* Does a side of the facet part it from the polygon? */
INLINE bool parted(const Polygon *p, const Facet *f) {
    uint32_t reached = 0; /* bit k: a corner is on the facet's side of its side k */
    for (uint32_t at = 0; at < p->n; at += 8) {
        const D8 s = corners_at(p, p->s, at), t = corners_at(p, p->t, at);
        const uint32_t there = (1u << (p->n - at)) - 1;
        for (uint32_t k = 0; k < 3; k++) {
            const double *g = f->g[k], near = ON_LINE * (fabs(g[0]) + fabs(g[1]));
            if (less(all_D8(near), g[0] * s + g[1] * t + g[2]) & there) reached |= 1u << k;
            else if (p->n <= 8) return true;
        }
    }
    return reached != 7;
}

/* Of the polygons that have come into the row; false: out of memory. */
static bool measure_extents(Store *store) {
    if (!window_room(store, &store->extents.data, (store->extents.n + 7) / 8, &store->extents.room,
                     (store->live.n + 7) / 8 - (store->extents.n + 7) / 8, sizeof *store->extents.data))
        return false;
    for (; store->extents.n < store->live.n; store->extents.n++) {
        Extents *to = &store->extents.data[store->extents.n / 8];
        const uint32_t i = store->extents.n % 8;
        const Polygon *p = &store->piece.data[store->live.data[store->extents.n]];
        double lo[2] = {HUGE_VAL, HUGE_VAL}, hi[2] = {-HUGE_VAL, -HUGE_VAL};
        for (uint32_t k = 0; k < p->n; k++) {
            lo[0] = p->s[k] < lo[0] ? p->s[k] : lo[0], hi[0] = p->s[k] > hi[0] ? p->s[k] : hi[0];
            lo[1] = p->t[k] < lo[1] ? p->t[k] : lo[1], hi[1] = p->t[k] > hi[1] ? p->t[k] : hi[1];
        }
        for (int a = 0; a < 2; a++) to->lo[a][i] = lo[a], to->hi[a][i] = hi[a];
        to->area[i] = p->n ? area_of(p) : 0;
    }
    return true;
}

static void remove_live(Store *store, uint32_t which) {
    store->live.data[which] = 0; /* which is nothing */
    if (which >= store->extents.n) return;
    Extents *e = &store->extents.data[which / 8];
    e->lo[0][which % 8] = HUGE_VAL, e->area[which % 8] = 0;
}

/* Puts what is left of live[which] without a facet in its place and behind the row. False: out of memory. */
static bool take_out(Store *store, uint32_t which, uint32_t number) {
    if (!places(store, MOST_PLACES)) return false;
    const Facet *f = &store->facet.data[number];
    const uint32_t start = store->live.data[which];
    double d[3][CORNERS];
    uint32_t plus[3], minus[3], at = start;
    for (int k = 0; k < 3; k++) {
        signs(&store->piece.data[start], f->g[k], d[k], &plus[k], &minus[k]);
        if (!plus[k]) return true;
    }
    remove_live(store, which);
    for (uint32_t k = 0; k < 3; k++) {
        const Polygon *p = &store->piece.data[at];
        if (!minus[k]) continue;
        if (at != start) signs(p, f->g[k], d[k], &plus[k], &minus[k]);
        if (!minus[k]) continue;
        if (!plus[k]) {
            keep(store, at);
            return true;
        }
        Polygon *in = &store->piece.data[store->piece.n];
        rest_of(p, d[k], minus[k], SIDE_OF(number, k), in), rest_of(p, d[k], plus[k], SIDE_OF(number, k), in + 1);
        at = store->piece.n, store->piece.n += 2;
        keep(store, at + 1);
    }
    return true;
}

/* What is seen of a facet and of one in the row, whose polygon is live[which]: what is hidden of either is taken out.
 * `row`: from where on the facet's own are; less_left: of these something is. False: they cross, or out of memory. */
static bool part_two(Store *store, uint32_t row, uint32_t which, uint32_t number, bool *less_left) {
    const Facet *f = &store->facet.data[number];
    const Polygon *other = &store->piece.data[store->live.data[which]];
    const uint32_t its = (uint32_t)other->facet;
    const Facet *its_facet = &store->facet.data[its];
    bool front, behind;
    if (parted(other, f) || parted(&store->piece.data[f->own], its_facet)) return true;
    /* Mostly one is in front wherever it, or the other, is. */
    compare_corners(&store->piece.data[f->own], f, its_facet, &front, &behind);
    if (front == behind) compare_corners(&store->piece.data[its_facet->own], f, its_facet, &front, &behind);
    if (front == behind) {
        Polygon room[2];
        const Polygon *both = clip(&store->piece.data[f->own], its_facet, its, room);
        if (!both) return true;
        compare(both, f, its_facet, &front, &behind);
        if (front && behind) return false;
    }
    if (front) return take_out(store, which, number);
    *less_left = true;
    for (uint32_t j = row, end = store->live.n; j < end; j++) {
        const Polygon *rest = &store->piece.data[store->live.data[j]];
        if (rest->n && rest->facet == (int32_t)number && !take_out(store, j, its)) return false;
    }
    return true;
}

/* Is anything left of the facet? */
static bool is_seen(const Store *store, uint32_t row, uint32_t number) {
    for (uint32_t j = row; j < store->live.n; j++) {
        const Polygon *p = &store->piece.data[store->live.data[j]];
        if (p->n && p->facet == (int32_t)number) return true;
    }
    return false;
}

/* Parts a facet's polygon, the last in the row, from those before it. What hides all of it hides what it would. */
static bool part_from_row(Store *store, uint32_t number) {
    const uint32_t row = store->live.n - 1;
    const Extents *own = &store->extents.data[row / 8];
    const uint32_t i = row % 8;
    const D8 lo[2] = {all_D8(own->lo[0][i]), all_D8(own->lo[1][i])},
             hi[2] = {all_D8(own->hi[0][i]), all_D8(own->hi[1][i])};
    for (uint32_t k = 0; k < row; k += 8) {
        const Extents *e = &store->extents.data[k / 8];
        uint32_t near = upto(*(const Wide *)e->lo[0], hi[0]) & upto(lo[0], *(const Wide *)e->hi[0]) &
                        upto(*(const Wide *)e->lo[1], hi[1]) & upto(lo[1], *(const Wide *)e->hi[1]);
        if (row - k < 8) near &= (1u << (row - k)) - 1;
        for (; near; near &= near - 1) {
            bool less_left = false;
            if (!part_two(store, row, k + (uint32_t)__builtin_ctz(near), number, &less_left)) return false;
            if (less_left && !is_seen(store, row, number)) return true;
        }
    }
    return true;
}

static double area_of_row(const Store *store) {
    double area = 0;
    for (uint32_t i = 0; i < store->extents.n; i++) area += store->extents.data[i / 8].area[i % 8];
    return area;
}

/* Facets nearest first, each cut from the rectangle at once, less what is in front of it. False: some cross, or out of
 * memory; facets that are not in the rectangle have been left out. */
static bool cover_plainly(const Search *s, const Rectangle *r, uint32_t from, uint32_t *n) {
    Store *store = s->store;
    uint32_t *chosen = store->chosen.data + from, kept = 0;
    const double whole = (r->hi[0] - r->lo[0]) * (r->hi[1] - r->lo[1]) * (1 - COVERED);
    double least = HUGE_VAL;
    Polygon rectangle;
    set_rectangle(&rectangle, r);
    store->extents.n = 0;
    for (uint32_t k = 0; k < *n; k++) {
        const uint32_t number = chosen[k];
        if (!measure_extents(store)) return false;
        if (s->candidate[number].most <= least && area_of_row(store) >= whole) break;
        if (!places(store, 4)) return false;
        window_facets(s, number + 1);
        Facet *f = &store->facet.data[number];
        Polygon *own = &store->piece.data[store->piece.n];
        const Polygon *p = clip(&rectangle, f, number, own);
        if (!p) continue;
        if (p == &rectangle) *own = rectangle, p = own;
        chosen[kept++] = number;
        f->own = (uint32_t)(p - store->piece.data);
        store->piece.n += 2;
        take(&store->piece.data[f->own], f, number);
        least = p->least < least ? p->least : least;
        store->live.data[store->live.n++] = f->own;
        if (!measure_extents(store)) return false;
        if (!part_from_row(store, number)) {
            for (k++; k < *n; k++) chosen[kept++] = chosen[k];
            *n = kept;
            return false;
        }
    }
    return true;
}

static void cover_all(Search *s, const Rectangle *r, uint32_t from, uint32_t n) {
    Store *store = s->store;
    store->piece.n = store->live.n = store->crossing.n = 0;
    if (!places(store, n + 2)) return;
    store->piece.data[0].n = 0, store->piece.n = 1;
    if (n <= FEW_FACETS && cover_plainly(s, r, from, &n)) return;
    set_rectangle(&store->piece.data[1], r);
    store->piece.n = 2, store->live.n = 0;
    store->live.data[store->live.n++] = 1;
    for (uint32_t k = 0; k < n; k++) {
        const uint32_t pieces = store->live.n;
        if (!places(store, MOST_PLACES * pieces)) return;
        window_facets(s, store->chosen.data[from + k] + 1);
        for (uint32_t i = 0; i < pieces; i++)
            if (store->live.data[i]) cover(store, i, store->chosen.data[from + k]);
    }
}
