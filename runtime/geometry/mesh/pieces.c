/* Windows, half-planes, splits; the store. */
#include "pieces.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "saltus/mesh.h"
#include "saltus/query.h"

enum {
    CORNERS = 20, /* of a polygon, at most; one that is kept has at most KEPT */
    KEPT = 12,
    FEW = 48,      /* triangles in a window that is not halved */
    HALVINGS = 40, /* at most */
    MOST_UNITS = 1 << 24
};
#define ON_LINE 2e-13  /* of a window's side: nearer to a line is on it */
#define SAME_DEPTH 1e-11

/* g = g[0] s + g[1] t + g[2]. An edge between vertices a < b; where triangles a and ~b cross, g is the difference of
 * their depths; a = -1: it does not move. */
typedef struct Line {
    double g[3];
    int32_t a, b;
} Line;

/* Side k goes from corner k to the next, on line side[k]. */
typedef struct Polygon {
    int32_t triangle; /* -1: nothing is seen here */
    uint32_t n;
    double depth[3], least; /* 1 / t as a line's g; the least of it at the corners */
    double s[CORNERS], t[CORNERS];
    uint32_t side[CORNERS];
} Polygon;

/* A triangle in the window. */
typedef struct Facet {
    int32_t triangle;
    double depth[3], most, low[2], high[2];
    double sign[3];
    uint32_t line; /* of its first edge; the others behind it */
} Facet;

#define ROW(type) \
    struct { \
        type *data; \
        uint32_t n, room; \
    }

typedef struct Store {
    unsigned char *unit;
    uint32_t n, room; /* in units of 8 doubles */
    ROW(int32_t) list;
    ROW(Line) line;
    ROW(Polygon) piece;
    ROW(Facet) facet;
} Store;

static _Thread_local Store *own;
static pthread_key_t key;
static pthread_once_t once = PTHREAD_ONCE_INIT;
static atomic_bool lost;

static void release(void *p) {
    Store *s = p;
    free(s->unit), free(s->list.data), free(s->line.data), free(s->piece.data), free(s->facet.data), free(s);
}

static void make_key(void) { (void)pthread_key_create(&key, release); }

static Store *store(void) {
    if (own) return own;
    pthread_once(&once, make_key);
    own = calloc(1, sizeof *own);
    if (own) (void)pthread_setspecific(key, own);
    return own;
}

bool pieces_lost(void) { return atomic_exchange(&lost, false); }

/* Room for one more; false: there is none. */
static bool room(void *data, uint32_t n, uint32_t *capacity, size_t size) {
    void *old;
    if (n < *capacity) return true;
    uint32_t want = *capacity ? 2 * *capacity : 64;
    memcpy(&old, data, sizeof old);
    void *fresh = want <= MOST_UNITS ? realloc(old, want * size) : NULL;
    if (!fresh) return atomic_store(&lost, true), false;
    memcpy(data, &fresh, sizeof fresh);
    *capacity = want;
    return true;
}
#define PUSH(row, value) \
    (room(&(row).data, (row).n, &(row).room, sizeof *(row).data) ? ((row).data[(row).n++] = (value), true) : false)

/* ---- vectors */

static void cross(const double a[3], const double b[3], double out[3]) {
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        out[i] = a[j] * b[k] - a[k] * b[j];
    }
}

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* ---- the window */

typedef struct Window {
    const BvhScene *scene;
    const void *values;
    Store *store;
    bool f64;
    double eye[3], u[3], v[3], c[3];
    double plane[3][3];   /* rows of the inverse of (u v c) but for its determinant: s, t, 1 up to a factor */
    uint32_t first, last; /* units of pieces */
} Window;

static double number(const Window *w, size_t at) {
    return w->f64 ? ((const double *)w->values)[at] : (double)((const float *)w->values)[at];
}

static bool window_set(Window *w, const void *rays, uint32_t width) {
    double row[SLT_BEAM_ROWS];
    for (uint32_t k = 0; k < SLT_BEAM_ROWS; k++) {
        row[k] = w->f64 ? ((const double *)rays)[(size_t)k * width] : (double)((const float *)rays)[(size_t)k * width];
        if (!(fabs(row[k]) <= 1e30)) return false;
    }
    for (int a = 0; a < 3; a++) {
        w->eye[a] = row[SLT_BEAM_EYE + a], w->c[a] = row[SLT_BEAM_CORNER + a] - w->eye[a];
        w->u[a] = row[SLT_BEAM_U + a], w->v[a] = row[SLT_BEAM_V + a];
    }
    cross(w->v, w->c, w->plane[0]);
    cross(w->c, w->u, w->plane[1]);
    cross(w->u, w->v, w->plane[2]);
    double whole = dot(w->u, w->plane[0]);
    if (whole == 0 || !isfinite(whole)) return false;
    for (int k = 0; k < 3 && whole < 0; k++)
        for (int a = 0; a < 3; a++) w->plane[k][a] = -w->plane[k][a];
    return true;
}

/* g of the plane through the eye with that normal. */
static void line_of(const Window *w, const double normal[3], double g[3]) {
    g[0] = dot(w->u, normal), g[1] = dot(w->v, normal), g[2] = dot(w->c, normal);
}

static double at(const double g[3], double s, double t) { return g[0] * s + g[1] * t + g[2]; }

/* ---- triangles near the window */

/* Is a box, wider by slack, wholly outside one of the planes? */
static bool outside(const double plane[5][3], const double lo[3], const double hi[3]) {
    for (int p = 0; p < 5; p++) {
        double most = 0, size = 0;
        for (int a = 0; a < 3; a++) {
            double x = plane[p][a] * (plane[p][a] > 0 ? hi[a] : lo[a]);
            most += x, size += fabs(x);
        }
        if (most < -1e-12 * size) return true;
    }
    return false;
}

static void gather(Window *w) {
    const Bvh *b = w->scene->bvh;
    double plane[5][3];
    for (int a = 0; a < 3; a++) {
        plane[0][a] = w->plane[0][a], plane[1][a] = w->plane[1][a];
        plane[2][a] = w->plane[2][a] - w->plane[0][a], plane[3][a] = w->plane[2][a] - w->plane[1][a];
        plane[4][a] = w->plane[2][a];
    }
    int32_t stack[BVH_STACK];
    uint32_t depth = 0;
    stack[depth++] = 0;
    while (depth) {
        const BvhNode *n = &b->node[stack[--depth]];
        for (int k = 0; k < BVH_WIDTH; k++) {
            double lo[3], hi[3];
            if (!n->child[k] || !(n->lo[0][k] <= n->hi[0][k])) continue;
            for (int a = 0; a < 3; a++) {
                lo[a] = (double)n->lo[a][k] - w->eye[a] - w->scene->slack;
                hi[a] = (double)n->hi[a][k] - w->eye[a] + w->scene->slack;
            }
            if (outside(plane, lo, hi)) continue;
            if (n->child[k] >= 0) {
                stack[depth++] = n->child[k];
                continue;
            }
            const int32_t *triangle = b->f64 ? ((const BvhLeaf64 *)b->leaf)[~n->child[k]].triangle
                                             : ((const BvhLeaf32 *)b->leaf)[~n->child[k]].triangle;
            for (int i = 0; i < BVH_LEAF; i++)
                if (triangle[i] >= 0) PUSH(w->store->list, triangle[i]);
        }
    }
}

/* ---- polygons */

typedef struct Rectangle {
    double lo[2], hi[2];
} Rectangle;

static Polygon rectangle(const Rectangle *r) {
    Polygon p = {.triangle = -1, .n = 4};
    for (int k = 0; k < 4; k++) {
        p.s[k] = k == 1 || k == 2 ? r->hi[0] : r->lo[0];
        p.t[k] = k >= 2 ? r->hi[1] : r->lo[1];
    }
    return p; /* line 0 is that of borders */
}

static void add_corner(Polygon *p, double s, double t, uint32_t side) {
    if (p->n == CORNERS) return; /* never: KEPT and four splits are fewer */
    p->s[p->n] = s, p->t[p->n] = t, p->side[p->n++] = side;
}

/* Parts p by sign * g: *in is where it is positive. NULL: not wanted. Returns whether there is any. A corner on the
 * line is of both; a new one is the same in both. */
static bool split(const Polygon *p, const double g[3], double sign, uint32_t line, Polygon *in, Polygon *out) {
    double d[CORNERS], near = ON_LINE * (fabs(g[0]) + fabs(g[1]));
    uint32_t plus = 0, minus = 0;
    for (uint32_t k = 0; k < p->n; k++) {
        d[k] = sign * at(g, p->s[k], p->t[k]);
        if (fabs(d[k]) <= near) d[k] = 0;
        plus += d[k] > 0, minus += d[k] < 0;
    }
    if (in) in->n = 0;
    if (out) out->n = 0;
    if (!plus) {
        if (out) *out = *p;
        return false;
    }
    if (!minus) {
        if (in) *in = *p;
        return true;
    }
    if (in) in->triangle = p->triangle;
    if (out) out->triangle = p->triangle, out->least = p->least, memcpy(out->depth, p->depth, sizeof out->depth);
    for (uint32_t k = 0; k < p->n; k++) {
        const uint32_t next = k + 1 < p->n ? k + 1 : 0;
        if (in && d[k] >= 0) add_corner(in, p->s[k], p->t[k], d[k] == 0 && d[next] < 0 ? line : p->side[k]);
        if (out && d[k] <= 0) add_corner(out, p->s[k], p->t[k], d[k] == 0 && d[next] > 0 ? line : p->side[k]);
        if (!(d[k] * d[next] < 0)) continue;
        double part = d[k] / (d[k] - d[next]);
        double s = p->s[k] + part * (p->s[next] - p->s[k]), t = p->t[k] + part * (p->t[next] - p->t[k]);
        if (in) add_corner(in, s, t, d[k] > 0 ? line : p->side[k]);
        if (out) add_corner(out, s, t, d[k] < 0 ? line : p->side[k]);
    }
    return true;
}

static void keep(Store *store, const Polygon *p);

/* A polygon of many corners is halved along a chord, which does not move. */
static void halve(Store *store, const Polygon *p) {
    Polygon a = *p, b = *p;
    const uint32_t middle = p->n / 2;
    a.n = 0, b.n = 0;
    for (uint32_t k = 0; k <= middle; k++) add_corner(&a, p->s[k], p->t[k], k < middle ? p->side[k] : 0);
    for (uint32_t k = middle; k < p->n; k++) add_corner(&b, p->s[k], p->t[k], p->side[k]);
    add_corner(&b, p->s[0], p->t[0], 0);
    keep(store, &a);
    keep(store, &b);
}

static void keep(Store *store, const Polygon *p) {
    if (p->n < 3) return;
    if (p->n > KEPT) halve(store, p);
    else PUSH(store->piece, *p);
}

/* ---- what is nearer */

static void take(Polygon *p, const Facet *f) {
    p->triangle = f->triangle;
    memcpy(p->depth, f->depth, sizeof p->depth);
    p->least = HUGE_VAL;
    for (uint32_t k = 0; k < p->n; k++) p->least = fmin(p->least, at(p->depth, p->s[k], p->t[k]));
}

/* Puts the facet into piece number `which`, of whose rests some become further pieces. */
static void cover(Store *store, uint32_t which, const Facet *f) {
    const Polygon *old = &store->piece.data[which];
    if (old->triangle >= 0 && f->most <= old->least) return;
    Polygon p = *old, in, rest;
    double low[2] = {p.s[0], p.t[0]}, high[2] = {p.s[0], p.t[0]};
    for (uint32_t k = 1; k < p.n; k++) {
        low[0] = fmin(low[0], p.s[k]), high[0] = fmax(high[0], p.s[k]);
        low[1] = fmin(low[1], p.t[k]), high[1] = fmax(high[1], p.t[k]);
    }
    if (f->low[0] >= high[0] || f->high[0] <= low[0] || f->low[1] >= high[1] || f->high[1] <= low[1]) return;
    in = p;
    for (uint32_t k = 0; k < 3; k++) {
        Polygon from = in;
        if (!split(&from, store->line.data[f->line + k].g, f->sign[k], f->line + k, &in, NULL) || in.n < 3) return;
    }
    bool front = p.triangle < 0, behind = false;
    double over[3];
    for (int k = 0; k < 3; k++) over[k] = f->depth[k] - p.depth[k];
    for (uint32_t k = 0; k < in.n && p.triangle >= 0; k++) {
        double mine = at(f->depth, in.s[k], in.t[k]), other = at(p.depth, in.s[k], in.t[k]),
               near = SAME_DEPTH * (fabs(mine) + fabs(other));
        front |= mine - other > near, behind |= mine - other < -near;
    }
    if (!front && !behind) front = f->triangle < p.triangle;
    if (!front) return;
    Polygon from = p;
    bool placed = false;
    /* Its place in the row goes to what is left of it, so that nothing needs to be taken out. */
    for (uint32_t k = 0; k < 3; k++) {
        split(&from, store->line.data[f->line + k].g, f->sign[k], f->line + k, &in, &rest);
        if (rest.n >= 3) keep(store, &rest);
        from = in;
    }
    in.triangle = p.triangle, in.least = p.least;
    memcpy(in.depth, p.depth, sizeof in.depth);
    if (behind) {
        const Line crossing = {.g = {over[0], over[1], over[2]}, .a = f->triangle, .b = ~p.triangle};
        uint32_t line = store->line.n;
        if (!PUSH(store->line, crossing)) line = 0;
        from = in;
        if (!split(&from, over, 1, line, &in, &rest)) in.n = 0;
        if (rest.n >= 3) keep(store, &rest);
    }
    if (in.n >= 3) take(&in, f), placed = true;
    if (placed && in.n <= KEPT) {
        store->piece.data[which] = in;
        return;
    }
    store->piece.data[which].n = 0;
    if (placed) keep(store, &in);
}

/* ---- triangles as facets */

static bool facet_of(Window *w, int32_t triangle, const Polygon *whole, Facet *f) {
    Store *store = w->store;
    const int32_t *corner = w->scene->bvh->face + 3 * (size_t)triangle;
    double p[3][3], n[3][3], sum[3];
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) p[k][a] = number(w, 3 * (size_t)corner[k] + (size_t)a) - w->eye[a];
    for (int k = 0; k < 3; k++) cross(p[k], p[(k + 1) % 3], n[k]);
    for (int a = 0; a < 3; a++) sum[a] = n[0][a] + n[1][a] + n[2][a];
    const double det = dot(p[0], n[1]);
    if (det == 0 || !isfinite(det)) return false;
    *f = (Facet){.triangle = triangle, .line = store->line.n};
    line_of(w, sum, f->depth);
    for (int k = 0; k < 3; k++) {
        f->depth[k] /= det;
        if (!isfinite(f->depth[k])) return false;
    }
    Polygon in = *whole;
    for (int k = 0; k < 3; k++) {
        const int32_t a = corner[k], b = corner[(k + 1) % 3];
        Line line = {.a = a < b ? a : b, .b = a < b ? b : a};
        line_of(w, n[k], line.g);
        for (int i = 0; i < 3 && b < a; i++) line.g[i] = -line.g[i];
        f->sign[k] = (det > 0) == (a < b) ? 1 : -1;
        Polygon from = in;
        bool any = split(&from, line.g, f->sign[k], 0, &in, NULL) && in.n >= 3;
        if (!any || !PUSH(store->line, line)) return store->line.n = f->line, false;
    }
    f->low[0] = f->low[1] = HUGE_VAL, f->high[0] = f->high[1] = f->most = -HUGE_VAL;
    for (uint32_t k = 0; k < in.n; k++) {
        f->low[0] = fmin(f->low[0], in.s[k]), f->high[0] = fmax(f->high[0], in.s[k]);
        f->low[1] = fmin(f->low[1], in.t[k]), f->high[1] = fmax(f->high[1], in.t[k]);
        f->most = fmax(f->most, at(f->depth, in.s[k], in.t[k]));
    }
    return true;
}

static int nearest_first(const void *x, const void *y) {
    const Facet *a = x, *b = y;
    if (a->most != b->most) return a->most < b->most ? 1 : -1;
    return (a->triangle > b->triangle) - (a->triangle < b->triangle);
}

/* Does the triangle fill the rectangle? Then *least is the least of its depth there. */
static bool fills(const Window *w, const Facet *f, const Rectangle *r, double *least) {
    *least = HUGE_VAL;
    for (int k = 0; k < 4; k++) {
        double s = k & 1 ? r->hi[0] : r->lo[0], t = k & 2 ? r->hi[1] : r->lo[1];
        for (uint32_t e = 0; e < 3; e++)
            if (!(f->sign[e] * at(w->store->line.data[f->line + e].g, s, t) > 0)) return false;
        *least = fmin(*least, at(f->depth, s, t));
    }
    return true;
}

/* ---- what kernels read */

static void put(const Window *w, uint32_t unit, uint32_t which, double v) {
    size_t i = 8 * (size_t)unit + which;
    if (w->f64) ((double *)w->store->unit)[i] = v;
    else ((float *)w->store->unit)[i] = (float)v;
}

static bool new_unit(Window *w, uint32_t *unit) {
    Store *s = w->store;
    if (!room(&s->unit, s->n, &s->room, 8 * sizeof(double))) return false;
    *unit = s->n++;
    for (uint32_t k = 0; k < 8; k++) put(w, *unit, k, 0);
    return true;
}

static void tell_side(Window *w, const Polygon *p, uint32_t k, const double centre[2]) {
    const Line *l = &w->store->line.data[p->side[k]];
    const uint32_t next = k + 1 < p->n ? k + 1 : 0;
    uint32_t unit;
    double length = hypot(p->s[next] - p->s[k], p->t[next] - p->t[k]), slope = hypot(l->g[0], l->g[1]);
    if (!new_unit(w, &unit)) return;
    double weight = slope > 0 ? length / slope : 0;
    put(w, unit, SLT_SIDE_A, l->a);
    put(w, unit, SLT_SIDE_B, l->b);
    put(w, unit, SLT_SIDE_WEIGHT, at(l->g, centre[0], centre[1]) < 0 ? -weight : weight);
    put(w, unit, SLT_SIDE_S0, p->s[k]), put(w, unit, SLT_SIDE_T0, p->t[k]);
    put(w, unit, SLT_SIDE_S1, p->s[next]), put(w, unit, SLT_SIDE_T1, p->t[next]);
}

static void tell(Window *w, const Polygon *p) {
    double area = 0, centre[2] = {0, 0};
    for (uint32_t k = 1; k + 1 < p->n; k++) {
        double as = p->s[k] - p->s[0], at_ = p->t[k] - p->t[0], bs = p->s[k + 1] - p->s[0], bt = p->t[k + 1] - p->t[0],
               part = 0.5 * (as * bt - at_ * bs);
        area += part, centre[0] += part * (as + bs) / 3, centre[1] += part * (at_ + bt) / 3;
    }
    if (!(area > 0)) return;
    centre[0] = p->s[0] + centre[0] / area, centre[1] = p->t[0] + centre[1] / area;
    uint32_t unit, sides = 0;
    if (!new_unit(w, &unit)) return;
    for (uint32_t k = 0; k < p->n; k++) {
        if (w->store->line.data[p->side[k]].a < 0) continue;
        tell_side(w, p, k, centre);
        sides++;
    }
    put(w, unit, SLT_PIECE_AREA, area);
    put(w, unit, SLT_PIECE_S, centre[0]), put(w, unit, SLT_PIECE_T, centre[1]);
    put(w, unit, SLT_PIECE_NEXT, SLT_WITNESS_NONE);
    put(w, unit, SLT_PIECE_TRIANGLE, p->triangle);
    put(w, unit, SLT_PIECE_SIDES, sides);
    if (w->first == UINT32_MAX) w->first = unit;
    else put(w, w->last, SLT_PIECE_NEXT, unit);
    w->last = unit;
}

/* ---- depth first */

/* Lists the triangles of one half; returns where the list ends. */
static uint32_t list_half(Store *store, uint32_t facets, uint32_t n, int axis, double middle, bool upper) {
    for (uint32_t k = facets; k < facets + n; k++) {
        const Facet *f = &store->facet.data[k];
        if (upper ? f->high[axis] > middle : f->low[axis] < middle) PUSH(store->list, f->triangle);
    }
    return store->list.n;
}

static void look(Window *w, uint32_t from, uint32_t to, const Rectangle *r, int halvings) {
    Store *store = w->store;
    const uint32_t lines = store->line.n, facets = store->facet.n;
    const Polygon whole = rectangle(r);
    double hidden = -HUGE_VAL, least;
    for (uint32_t k = from; k < to; k++) {
        Facet f;
        if (!facet_of(w, store->list.data[k], &whole, &f)) continue;
        if (f.most < hidden) {
            store->line.n = f.line;
            continue;
        }
        if (!PUSH(store->facet, f)) break;
        if (fills(w, &f, r, &least)) hidden = fmax(hidden, least);
    }
    const uint32_t end = store->list.n;
    uint32_t n = 0;
    for (uint32_t k = facets; k < store->facet.n; k++)
        if (!(store->facet.data[k].most < hidden)) store->facet.data[facets + n++] = store->facet.data[k];
    store->facet.n = facets + n;
    if (n > FEW && halvings < HALVINGS) {
        const int axis = r->hi[0] - r->lo[0] >= r->hi[1] - r->lo[1] ? 0 : 1;
        const double middle = 0.5 * (r->lo[axis] + r->hi[axis]);
        const uint32_t half = list_half(store, facets, n, axis, middle, false),
                       last = list_half(store, facets, n, axis, middle, true);
        store->line.n = lines, store->facet.n = facets;
        Rectangle part = *r;
        part.hi[axis] = middle;
        look(w, end, half, &part, halvings + 1);
        part = *r;
        part.lo[axis] = middle;
        look(w, half, last, &part, halvings + 1);
        store->list.n = end;
        return;
    }
    if (n) {
        qsort(store->facet.data + facets, n, sizeof *store->facet.data, nearest_first);
        store->piece.n = 0;
        PUSH(store->piece, whole);
        for (uint32_t k = 0; k < n; k++)
            for (uint32_t i = 0, pieces = store->piece.n; i < pieces; i++)
                if (store->piece.data[i].n >= 3) cover(store, i, &store->facet.data[facets + k]);
        for (uint32_t i = 0; i < store->piece.n; i++)
            if (store->piece.data[i].n >= 3 && store->piece.data[i].triangle >= 0) tell(w, &store->piece.data[i]);
    }
    store->line.n = lines, store->facet.n = facets;
}

void pieces_find(const BvhScene *s, const void *values, const void *rays, uint64_t mask, uint32_t width,
                 int32_t *witness) {
    const size_t size = s->bvh->f64 ? sizeof(double) : sizeof(float);
    Window w = {.scene = s, .values = values, .store = store(), .f64 = s->bvh->f64};
    for (uint32_t k = 0; k < width; k++) {
        witness[k] = SLT_WITNESS_NONE;
        if (!(mask >> k & 1) || !w.store || !window_set(&w, (const char *)rays + k * size, width)) continue;
        Store *store = w.store;
        w.first = UINT32_MAX;
        store->list.n = store->line.n = store->facet.n = 0;
        if (!PUSH(store->line, ((Line){.a = -1}))) continue;
        gather(&w);
        look(&w, 0, store->list.n, &(Rectangle){{0, 0}, {1, 1}}, 0);
        if (w.first != UINT32_MAX) witness[k] = (int32_t)w.first;
    }
}

void pieces_begin(void) {
    if (own) own->n = 0;
}

double pieces_told(bool f64, int32_t unit, uint32_t which) {
    if (!own || unit < 0 || (uint32_t)unit >= own->n) return 0;
    const size_t i = 8 * (size_t)unit + which;
    return f64 ? ((const double *)own->unit)[i] : (double)((const float *)own->unit)[i];
}
