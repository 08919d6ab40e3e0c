/* From the J of segments to derivatives of what is lit of a piece.
 *
 * A side lies in (s, t) on a line g = 0, g = g0 s + g1 t + g2, and moves the area by the integral of dg / |grad g|
 * along it, which is J . (dg0, dg1, dg2) / |grad g|: g is linear. With d = c + s u + t v from the eye E, and K =
 * J0 u + J1 v + J2 c, g is one of
 *
 *   d . (A x B)            an edge seen from the eye
 *   d . n / det, less that of another   where triangles cross: seen from the eye, and on the piece's plane
 *   X - L . (A x B)        an edge seen from the light L, A and B from there, X = E + d det / (d . n) on the piece's
 *                          plane; times d . n it is (E - L) . N d . n + det d . N, N = A x B */
#include "light_inner.h"

#include <math.h>

/* own: the derivatives in the corners of the piece's triangle, added up. */
typedef struct Turn {
    Light *l;
    LitSlopes *s;
    double own[3][3];
} Turn;

/* What is held of a side: J / |grad g|, K. */
typedef struct Held {
    double j[3], k[3];
} Held;

static bool hold(const Turn *t, const double j[3], double sign, const double g[2], Held *h) {
    const double slope = sqrt(g[0] * g[0] + g[1] * g[1]);
    const OutlineBeam *b = t->l->lit->piece.beam;
    if (!(slope > 0) || !isfinite(slope)) return false;
    for (int i = 0; i < 3; i++) h->j[i] = sign * j[i] / slope;
    for (int a = 0; a < 3; a++) h->k[a] = h->j[0] * b->u[a] + h->j[1] * b->v[a] + h->j[2] * b->c[a];
    return true;
}

/* by: the derivative in K. */
static void turn_beam(const Turn *t, const Held *h, const double by[3]) {
    vec_add(t->s->u, h->j[0], by), vec_add(t->s->v, h->j[1], by);
    vec_add(t->s->corner, h->j[2], by), vec_add(t->s->eye, -h->j[2], by);
}

static void add_vertices(const Turn *t, int32_t a, int32_t b, const double da[3], const double db[3]) {
    LightEdge e = {.vertex = {a, b}};
    memcpy(e.d[0], da, sizeof e.d[0]), memcpy(e.d[1], db, sizeof e.d[1]);
    if (!ROW_ADD(t->l->store->edge, e)) t->l->lost = true;
}

static void add_triangle(Turn *t, int32_t triangle, double d[3][3]) {
    static const double none[3];
    const int32_t *face = t->l->s->tree.bvh->face + 3 * (size_t)triangle;
    if (triangle == t->l->own) {
        for (int k = 0; k < 3; k++) vec_add(t->own[k], 1, d[k]);
        return;
    }
    add_vertices(t, face[0], face[1], d[0], d[1]);
    add_vertices(t, face[2], face[2], d[2], none);
}

/* Of the product of two vertices seen from a point; by: the derivative in it. point: gets what the point does. */
static void turn_product(const Turn *t, int32_t a, int32_t b, const double (*at)[3], const double by[3],
                         double point[3]) {
    double d[2][3];
    vec_cross(at[1], by, d[0]);
    vec_cross(by, at[0], d[1]);
    for (int k = 0; k < 2; k++) vec_add(point, -1, d[k]);
    add_vertices(t, a, b, d[0], d[1]);
}

/* Of a triangle's normal, (B - A) x (C - A). */
static void turn_normal(const double (*corner)[3], const double by[3], double d[3][3]) {
    double way[2][3], one[3];
    for (int k = 0; k < 2; k++) vec_minus(corner[k + 1], corner[0], way[k]);
    for (int k = 0; k < 2; k++) {
        if (k) vec_cross(by, way[0], one);
        else vec_cross(way[1], by, one);
        vec_add(d[k + 1], 1, one), vec_add(d[0], -1, one);
    }
}

static void from_eye(const Turn *t, int32_t vertex, double at[3]) {
    light_vertex(t->l, vertex, at);
    vec_add(at, -1, t->l->lit->eye);
}

/* ---- the three kinds of lines */

static void turn_seen_edge(Turn *t, const double j[3], double sign, int32_t a, int32_t b) {
    const OutlineBeam *beam = t->l->lit->piece.beam;
    double at[2][3], n[3];
    Held h;
    from_eye(t, a, at[0]), from_eye(t, b, at[1]);
    vec_cross(at[0], at[1], n);
    if (!hold(t, j, sign, (double[2]){vec_dot(beam->u, n), vec_dot(beam->v, n)}, &h)) return;
    turn_beam(t, &h, n);
    turn_product(t, a, b, (const double(*)[3])at, h.k, t->s->eye);
}

typedef struct Depth {
    double corner[3][3], normal[3], det;
} Depth;

static void depth_of(const Turn *t, int32_t triangle, Depth *d) {
    const int32_t *face = t->l->s->tree.bvh->face + 3 * (size_t)triangle;
    double way[2][3];
    for (int k = 0; k < 3; k++) from_eye(t, face[k], d->corner[k]);
    for (int k = 0; k < 2; k++) vec_minus(d->corner[k + 1], d->corner[0], way[k]);
    vec_cross(way[0], way[1], d->normal);
    d->det = vec_dot(d->corner[0], d->normal);
}

/* factor * K . normal / det */
static void turn_depth(Turn *t, const Held *h, double factor, const Depth *d, int32_t triangle) {
    double by[3] = {0}, corner[3][3] = {{0}};
    vec_add(by, factor / d->det, d->normal);
    turn_beam(t, h, by);
    const double in_det = -factor * vec_dot(h->k, d->normal) / (d->det * d->det);
    memset(by, 0, sizeof by);
    vec_add(by, factor / d->det, h->k), vec_add(by, in_det, d->corner[0]);
    turn_normal((const double(*)[3])d->corner, by, corner);
    vec_add(corner[0], in_det, d->normal), vec_add(t->s->eye, -in_det, d->normal);
    add_triangle(t, triangle, corner);
}

/* g: 1 / t of a less that of b. */
static void turn_crossing(Turn *t, const double j[3], double sign, int32_t a, int32_t b) {
    const OutlineBeam *beam = t->l->lit->piece.beam;
    Depth d[2];
    Held h;
    double n[3] = {0};
    depth_of(t, a, &d[0]), depth_of(t, b, &d[1]);
    for (int k = 0; k < 2; k++) vec_add(n, (k ? -1 : 1) / d[k].det, d[k].normal);
    if (!hold(t, j, sign, (double[2]){vec_dot(beam->u, n), vec_dot(beam->v, n)}, &h)) return;
    turn_depth(t, &h, 1, &d[0], a), turn_depth(t, &h, -1, &d[1], b);
}

/* Where a triangle passes through the piece's plane: before it for the light where J counts, for the eye perhaps
 * beyond it. */
static void turn_plane(Turn *t, const double j[3], int32_t triangle) {
    double at[3][3], way[2][3], n[3];
    light_corners(t->l, triangle, at);
    for (int k = 0; k < 2; k++) vec_minus(at[k + 1], at[0], way[k]);
    vec_cross(way[0], way[1], n);
    const double light = vec_dot(at[0], n), eye = light - vec_dot(t->l->lit->eye, n);
    turn_crossing(t, j, (light < 0) == (eye < 0) ? 1 : -1, triangle, t->l->own);
}

static void turn_shadow(Turn *t, const double j[3], int32_t a, int32_t b) {
    const Lit *q = t->l->lit;
    const OutlineBeam *beam = q->piece.beam;
    double at[2][3], n[3], g[2], by[3] = {0}, corner[3][3] = {{0}};
    Held h;
    light_vertex(t->l, a, at[0]), light_vertex(t->l, b, at[1]);
    vec_cross(at[0], at[1], n);
    const double above = vec_dot(q->eye, n);
    for (int i = 0; i < 2; i++) {
        const double *along = i ? beam->v : beam->u;
        g[i] = above * vec_dot(along, q->normal) + q->det * vec_dot(along, n);
    }
    /* g has the sign of (X - L) . N times that of d . n, which is that of det. */
    if (!hold(t, j, q->det < 0 ? -1 : 1, g, &h)) return;
    const double in_above = vec_dot(h.k, q->normal), in_det = vec_dot(h.k, n);
    vec_add(by, above, q->normal), vec_add(by, q->det, n);
    turn_beam(t, &h, by);
    vec_add(t->s->eye, in_above, n), vec_add(t->s->light, -in_above, n);
    memset(by, 0, sizeof by);
    vec_add(by, above, h.k), vec_add(by, in_det, q->corner[0]);
    turn_normal((const double(*)[3])q->corner, by, corner);
    vec_add(corner[0], in_det, q->normal), vec_add(t->s->eye, -in_det, q->normal);
    add_triangle(t, t->l->own, corner);
    memset(by, 0, sizeof by);
    vec_add(by, in_above, q->eye), vec_add(by, q->det, h.k);
    turn_product(t, a, b, (const double(*)[3])at, by, t->s->light);
}

static void turn_segment(Turn *t, const Segment *s) {
    const OutlinePart *part;
    switch (s->kind) {
    case SEGMENT_BORDER:
    case SEGMENT_HORIZON:
    case SEGMENT_FIXED: return;
    case SEGMENT_EDGE: turn_shadow(t, s->j, s->a, s->b); return;
    case SEGMENT_PLANE: turn_plane(t, s->j, s->a); return;
    case SEGMENT_PIECE:
        part = &t->l->lit->piece.part[s->a];
        if (part->b < 0) turn_crossing(t, s->j, part->outside ? -1 : 1, part->a, ~part->b);
        else turn_seen_edge(t, s->j, part->outside ? -1 : 1, part->a, part->b);
        return;
    }
}

void lit_turn(Light *l, LitSlopes *s) {
    static const double none[3];
    Turn t = {.l = l, .s = s};
    for (uint32_t i = 0; i < l->store->segment.n; i++)
        if (l->store->segment.data[i].j[2] != 0 || l->store->segment.data[i].j[0] != 0)
            turn_segment(&t, &l->store->segment.data[i]);
    const int32_t *face = l->s->tree.bvh->face + 3 * (size_t)l->own;
    add_vertices(&t, face[0], face[1], t.own[0], t.own[1]);
    add_vertices(&t, face[2], face[2], t.own[2], none);
}
