/* Triangles that windows may see, eight at a time. Include behind lanes.h.
 *
 * What is listed for several windows of one eye does not decide what one of them sees: `survey` asks each triangle
 * again, by arithmetic of the window alone. */
typedef D8 Wide __attribute__((aligned(8)));
typedef float Narrow __attribute__((vector_size(32), aligned(4)));

/* NaN is left out. */
INLINE void keep_min(D8 *a, const D8 *b) { *a = lower_D8(*b, *a); }
INLINE void keep_max(D8 *a, const D8 *b) { *a = higher_D8(*b, *a); }

#define BESIDE 1e-9 /* by which what lies where is widened */

INLINE void dot8(const D8 a[3], const double b[3], D8 *out) { *out = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Of g at the corners of the window, g[0] s + g[1] t + g[2]. */
INLINE void range_of(const D8 g[3], D8 *least, D8 *most) {
    D8 at[4] = {g[2], g[0] + g[2], g[1] + g[2], g[0] + g[1] + g[2]};
    *least = *most = at[0];
    for (int k = 1; k < 4; k++) keep_min(least, &at[k]), keep_max(most, &at[k]);
}

INLINE void size_of(const D8 *x, D8 *size) {
    D8 negative = -*x;
    *size = *x;
    keep_max(size, &negative);
}

/* Which of a node's boxes are not wholly outside of one of the planes through the eye? */
INLINE uint32_t boxes_in(const BvhNode *n, const double plane[5][3], const double eye[3], double slack) {
    L8 out = {0};
    D8 lo[3], hi[3];
    for (int a = 0; a < 3; a++) {
        lo[a] = __builtin_convertvector(*(const Narrow *)n->lo[a], D8) - (eye[a] + slack);
        hi[a] = __builtin_convertvector(*(const Narrow *)n->hi[a], D8) - (eye[a] - slack);
    }
    for (int p = 0; p < 5; p++) {
        D8 most = {0}, size = {0};
        for (int a = 0; a < 3; a++) {
            D8 x = plane[p][a] * (plane[p][a] > 0 ? hi[a] : lo[a]), absolute;
            size_of(&x, &absolute);
            most += x, size += absolute;
        }
        out |= most < -1e-12 * size;
    }
    L8 in = ~out & (lo[0] <= hi[0]);
    return bits_D8(in);
}

static void list_triangles(Search *s, const double plane[5][3], const double eye[3]) {
    const BvhScene *scene = &s->scene->tree;
    const Bvh *b = scene->bvh;
    int32_t stack[BVH_STACK];
    uint32_t depth = 0;
    Store *store = s->store;
    store->list.n = 0;
    stack[depth++] = 0;
    while (depth) {
        const BvhNode *n = &b->node[stack[--depth]];
        for (uint32_t in = boxes_in(n, plane, eye, scene->slack); in; in &= in - 1) {
            const int32_t child = n->child[__builtin_ctz(in)];
            if (child >= 0) {
                if (child) stack[depth++] = child;
                continue;
            }
            const int32_t *triangle =
                b->f64 ? ((const BvhLeaf64 *)b->leaf)[~child].triangle : ((const BvhLeaf32 *)b->leaf)[~child].triangle;
            if (!window_room(store, &store->list.data, store->list.n, &store->list.room, BVH_LEAF,
                             sizeof *store->list.data))
                return;
            for (int i = 0; i < BVH_LEAF; i++)
                if (triangle[i] >= 0) store->list.data[store->list.n++] = triangle[i];
        }
    }
}

INLINE void corners_of(const Search *s, const double eye[3], const int32_t *triangle, uint32_t n, D8 p[3][3]) {
    typedef struct {
        double at[3][3][8];
    } Corners;
    Corners c = {0};
    for (uint32_t i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) {
            const size_t at = 3 * (size_t)s->scene->tree.bvh->face[3 * (size_t)triangle[i] + (size_t)k];
            for (int a = 0; a < 3; a++)
                c.at[k][a][i] = (s->f64 ? ((const double *)s->scene->values)[at + (size_t)a]
                                        : (double)((const float *)s->scene->values)[at + (size_t)a]) -
                                eye[a];
        }
    memcpy(p, &c, sizeof c);
}

/* What eight triangles are, before those that are not in the rectangle are left out. */
typedef struct Columns {
    double normal[3][3][8], depth[3][8], lo[2][8], hi[2][8];
} Columns;

static void make_columns(const Search *s, const Window *w, const Rectangle *r, const int32_t *triangle, uint32_t n,
                         Columns *out, uint32_t *in, uint32_t *turned) {
    D8 p[3][3], sum[3], det, size;
    corners_of(s, w->eye, triangle, n, p);
    D8 lo[2] = {(D8){0} + HUGE_VAL, (D8){0} + HUGE_VAL}, hi[2] = {-lo[0], -lo[1]};
    L8 ahead = ~(L8){0}, outside = {0};
    for (int k = 0; k < 3; k++) {
        D8 along, at;
        dot8(p[k], w->plane[2], &along);
        ahead &= along > 0;
        for (int i = 0; i < 2; i++) {
            dot8(p[k], w->plane[i], &at);
            at /= along;
            keep_min(&lo[i], &at), keep_max(&hi[i], &at);
        }
    }
    for (int i = 0; i < 2; i++) {
        D8 above, below;
        size_of(&hi[i], &above), size_of(&lo[i], &below);
        lo[i] -= BESIDE * (1 + above + below), hi[i] += BESIDE * (1 + above + below);
        outside |= (lo[i] > r->hi[i]) | (hi[i] < r->lo[i]);
        lo[i] = (D8)((ahead & (L8)lo[i]) | (~ahead & (L8)((D8){0} - HUGE_VAL)));
        hi[i] = (D8)((ahead & (L8)hi[i]) | (~ahead & (L8)((D8){0} + HUGE_VAL)));
    }
    outside &= ahead;
    *in = ~bits_D8(outside) & ((1u << n) - 1);
    if (!*in) return;
    D8 normal[3][3];
    for (int k = 0; k < 3; k++) {
        const int q = (k + 1) % 3;
        for (int a = 0; a < 3; a++) {
            const int j = (a + 1) % 3, l = (a + 2) % 3;
            normal[k][a] = p[k][j] * p[q][l] - p[k][l] * p[q][j];
        }
    }
    for (int a = 0; a < 3; a++) sum[a] = normal[0][a] + normal[1][a] + normal[2][a];
    det = p[0][0] * normal[1][0] + p[0][1] * normal[1][1] + p[0][2] * normal[1][2];
    size_of(&det, &size);
    const L8 back = det < 0, good = (size > 0) & (size <= DBL_MAX);
    *in &= bits_D8(good), *turned = bits_D8(back);
    for (int a = 0; a < 3; a++) {
        *(Wide *)out->depth[a] = sum[a] / det;
        for (int k = 0; k < 3; k++) *(Wide *)out->normal[k][a] = (D8)((L8)normal[k][a] ^ (back & INT64_MIN));
    }
    for (int i = 0; i < 2; i++) *(Wide *)out->lo[i] = lo[i], *(Wide *)out->hi[i] = hi[i];
}

/* Appends those of eight triangles that lie in the rectangle. */
static void add_eight(Search *s, const Window *w, const Rectangle *r, const int32_t *triangle, uint32_t n) {
    Columns c;
    uint32_t in, turned;
    Store *store = s->store;
    make_columns(s, w, r, triangle, n, &c, &in, &turned);
    for (; in; in &= in - 1) {
        const uint32_t i = (uint32_t)__builtin_ctz(in), to = store->neights % 8;
        if (!to) {
            if (!window_room(store, &store->eight.data, store->eight.n, &store->eight.room, 1,
                             sizeof *store->eight.data))
                return;
            Eight *fresh = &store->eight.data[store->eight.n++];
            memset(fresh, 0, sizeof *fresh);
            for (int a = 0; a < 2; a++) *(Wide *)fresh->lo[a] = (D8){0} + HUGE_VAL;
        }
        Eight *e = &store->eight.data[store->eight.n - 1];
        for (int a = 0; a < 3; a++) {
            e->depth[a][to] = c.depth[a][i];
            for (int k = 0; k < 3; k++) e->normal[k][a][to] = c.normal[k][a][i];
        }
        for (int a = 0; a < 2; a++) e->lo[a][to] = c.lo[a][i], e->hi[a][to] = c.hi[a][i];
        e->triangle[to] = triangle[i], e->turned[to] = turned >> i & 1;
        store->neights++;
    }
}

static void list(Search *s, const Window *w, const Rectangle *r) {
    double plane[5][3];
    for (int a = 0; a < 3; a++) {
        const double *const *row = (const double *const[]){w->plane[0], w->plane[1], w->plane[2]};
        for (int i = 0; i < 2; i++) {
            plane[2 * i][a] = row[i][a] - r->lo[i] * row[2][a];
            plane[2 * i + 1][a] = r->hi[i] * row[2][a] - row[i][a];
        }
        plane[4][a] = row[2][a];
    }
    Store *store = s->store;
    store->eight.n = store->neights = 0;
    list_triangles(s, (const double(*)[3])plane, w->eye);
    for (uint32_t i = 0; i < store->list.n; i += 8)
        add_eight(s, w, r, store->list.data + i, store->list.n - i < 8 ? store->list.n - i : 8);
}

/* Those of the eight that the window may see. */
INLINE void survey_eight(Search *s, uint32_t number, const Rectangle *within, double *hidden) {
    typedef struct {
        double at[8];
    } Row;
    Store *store = s->store;
    const Eight *e = &store->eight.data[number];
    const Window *w = &s->window;
    L8 in = (*(const Wide *)e->lo[0] <= within->hi[0]) & (*(const Wide *)e->hi[0] >= within->lo[0]) &
            (*(const Wide *)e->lo[1] <= within->hi[1]) & (*(const Wide *)e->hi[1] >= within->lo[1]);
    if (!bits_D8(in)) return;
    D8 g[3], least, most;
    L8 fills = ~(L8){0};
    for (int k = 0; k < 3; k++) {
        const D8 n[3] = {*(const Wide *)e->normal[k][0], *(const Wide *)e->normal[k][1],
                         *(const Wide *)e->normal[k][2]};
        dot8(n, w->u, &g[0]), dot8(n, w->v, &g[1]), dot8(n, w->c, &g[2]);
        range_of(g, &least, &most);
        in &= most > 0, fills &= least > 0;
    }
    uint32_t some = bits_D8(in);
    if (!some) return;
    const D8 n[3] = {*(const Wide *)e->depth[0], *(const Wide *)e->depth[1], *(const Wide *)e->depth[2]};
    dot8(n, w->u, &g[0]), dot8(n, w->v, &g[1]), dot8(n, w->c, &g[2]);
    range_of(g, &least, &most);
    const uint32_t filling = bits_D8(fills);
    Row low, high;
    memcpy(&low, &least, sizeof low), memcpy(&high, &most, sizeof high);
    if (!window_room(store, &store->candidate.data, store->candidate.n, &store->candidate.room, 8,
                     sizeof *store->candidate.data))
        return;
    for (; some; some &= some - 1) {
        const int i = __builtin_ctz(some);
        if (high.at[i] < *hidden || !(low.at[i] >= -DBL_MAX && high.at[i] <= DBL_MAX)) continue;
        Candidate *c = &store->candidate.data[store->candidate.n++];
        *c = (Candidate){low.at[i], high.at[i], e->triangle[i], 8 * number + (uint32_t)i, filling >> i & 1};
        if (c->fills && c->least > *hidden) *hidden = c->least;
    }
}

static void survey(Search *s, const Rectangle *within) {
    Store *store = s->store;
    double hidden = -HUGE_VAL;
    uint32_t n = 0;
    store->candidate.n = 0;
    for (uint32_t i = 0; i < store->eight.n; i++) survey_eight(s, i, within, &hidden);
    for (uint32_t i = 0; i < store->candidate.n; i++)
        if (!(store->candidate.data[i].most < hidden)) store->candidate.data[n++] = store->candidate.data[i];
    store->candidate.n = n;
}

static void place(const Window *w, const double row[SLT_BEAM_ROWS][LANES], uint32_t width, Places *out) {
    out->ahead = 0;
    for (uint32_t k = 0; k < width; k += 8) {
        D8 u[3], v[3], c[3], at[3][4];
        L8 ahead = ~(L8){0};
        for (int a = 0; a < 3; a++) {
            const D8 eye = *(const Wide *)&row[SLT_BEAM_EYE + a][k];
            ahead &= eye == w->eye[a];
            c[a] = *(const Wide *)&row[SLT_BEAM_CORNER + a][k] - eye;
            u[a] = *(const Wide *)&row[SLT_BEAM_U + a][k], v[a] = *(const Wide *)&row[SLT_BEAM_V + a][k];
        }
        for (int i = 2; i >= 0; i--) {
            D8 first, s, t;
            dot8(c, w->plane[i], &first), dot8(u, w->plane[i], &s), dot8(v, w->plane[i], &t);
            at[i][0] = first, at[i][1] = first + s, at[i][2] = first + t, at[i][3] = first + s + t;
            if (i < 2) {
                D8 lo = at[i][0] / at[2][0], hi = lo;
                for (int q = 1; q < 4; q++) {
                    D8 x = at[i][q] / at[2][q];
                    keep_min(&lo, &x), keep_max(&hi, &x);
                }
                *(Wide *)&out->lo[i][k] = lo, *(Wide *)&out->hi[i][k] = hi;
            } else
                for (int q = 0; q < 4; q++) ahead &= at[2][q] > 0;
        }
        out->ahead |= (uint64_t)bits_D8(ahead) << k;
    }
}
