/* Triangles in the beam from p to the light, and the lines that may end a shadow. */
#include "light_inner.h"

#include <math.h>

static inline double number(const Light *l, size_t at) {
    return l->f64 ? ((const double *)l->s->values)[at] : (double)((const float *)l->s->values)[at];
}

void light_vertex(const Light *l, int32_t vertex, double at[3]) {
    for (int a = 0; a < 3; a++) at[a] = number(l, 3 * (size_t)vertex + (size_t)a) - l->p[a];
}

void light_corners(const Light *l, int32_t triangle, double at[3][3]) {
    const int32_t *face = l->s->tree.bvh->face + 3 * (size_t)triangle;
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) at[k][a] = number(l, 3 * (size_t)face[k] + (size_t)a) - l->p[a];
}

/* By det(A, B, C) = A . N, p's distance from the plane times |N|, and the square of N. */
static Facing facing_by(const Light *l, double det, double square) {
    if (!(det * det > l->near * l->near * square) || !isfinite(det)) return FACING_NOT;
    return det < 0 ? FACING_TO : FACING_AWAY;
}

/* What is not finite hides nothing. */
Facing light_facing(const Light *l, int32_t triangle, double at[3][3]) {
    if (triangle == l->own) return FACING_BEYOND;
    double p[3], q[3], normal[3], least = HUGE_VAL;
    vec_minus(at[1], at[0], p);
    vec_minus(at[2], at[0], q);
    vec_cross(p, q, normal);
    const Facing f = facing_by(l, vec_dot(at[0], normal), vec_dot(normal, normal));
    if (f == FACING_NOT || !l->through) return f;
    for (int k = 0; k < 3; k++) least = light_min(least, vec_dot(l->row[2], at[k]));
    return least < l->beyond ? f : FACING_BEYOND;
}

/* ---- triangles */

enum { PLANES = 6 };

static void set_planes(const Light *l, BeamPlane plane[PLANES]) {
    for (int i = 0; i < 2; i++) {
        plane[2 * i] = plane[2 * i + 1] = (BeamPlane){.off = 0};
        for (int a = 0; a < 3; a++) {
            plane[2 * i].normal[a] = l->row[i][a];
            plane[2 * i + 1].normal[a] = l->row[2][a] - l->row[i][a];
        }
    }
    plane[4].off = 2 - l->beyond, plane[5].off = 0;
    for (int a = 0; a < 3; a++) plane[4].normal[a] = -l->row[2][a], plane[5].normal[a] = l->n[a];
}

/* Is anything below the node on the light's plane, or behind it? */
static bool reaches(const Light *l, const BvhNode *n) {
    for (int k = 0; k < BVH_WIDTH; k++) {
        double most = 0;
        if (!n->child[k] || !(n->lo[0][k] <= n->hi[0][k])) continue;
        for (int a = 0; a < 3; a++) {
            const double by = l->row[2][a], x = (double)(by > 0 ? n->hi[a][k] : n->lo[a][k]) - l->p[a];
            most += by * x + fabs(by) * l->s->tree.slack;
        }
        if (!(most < l->beyond)) return true;
    }
    return false;
}

static Facing note(const Light *l, int32_t triangle, Facing f) {
    l->store->stamp[triangle] = l->store->stamps << 2 | (uint32_t)f;
    return f;
}

static Facing known(const Light *l, int32_t triangle) {
    const uint32_t s = l->store->stamp[triangle];
    if (s >> 2 == l->store->stamps) return (Facing)(s & 3);
    double at[3][3];
    light_corners(l, triangle, at);
    return note(l, triangle, light_facing(l, triangle, at));
}

static bool forget(Light *l) {
    LightStore *store = l->store;
    const uint32_t n = l->s->tree.bvh->nfaces;
    if (store->marked < n || store->stamps + 1 == 1u << 30) {
        free(store->stamp);
        store->stamp = calloc(n, sizeof *store->stamp);
        store->marked = store->stamp ? n : 0, store->stamps = 0;
    }
    store->stamps++;
    return store->stamp;
}

static void take_leaf(Light *l, const BeamPlane *plane, const BeamSight *sight, int32_t leaf) {
    const Bvh *b = l->s->tree.bvh;
    const int32_t *triangle =
        b->f64 ? ((const BvhLeaf64 *)b->leaf)[leaf].triangle : ((const BvhLeaf32 *)b->leaf)[leaf].triangle;
    const bool moved = l->s->tree.moved;
    const uint32_t in = l->lit && !moved ? l->s->beam->triangles(b, leaf, plane, l->nplanes, l->p) : ~0u;
    if (!row_room(&l->store->triangle.data, l->store->triangle.n + BVH_LEAF, &l->store->triangle.room,
                  sizeof *l->store->triangle.data)) {
        l->lost = true;
        return;
    }
    for (int i = 0; i < BVH_LEAF; i++)
        if (in >> i & 1 && triangle[i] >= 0) l->store->triangle.data[l->store->triangle.n++] = triangle[i];
    if (l->lit || moved) return;
    const BeamFacings f = l->s->beam->facings(b, leaf, sight);
    for (int i = 0; i < BVH_LEAF; i++)
        if (triangle[i] >= 0) note(l, triangle[i], (Facing)((f.low >> i & 1) | (f.high >> i & 1) << 1));
}

/* edges: only where some end a shadow. */
void light_gather(Light *l, bool edges) {
    const Bvh *b = l->s->tree.bvh;
    BeamPlane plane[PLANES];
    int32_t stack[BVH_STACK];
    uint32_t depth = 0;
    l->store->triangle.n = 0;
    if (!forget(l)) {
        l->lost = true;
        return;
    }
    set_planes(l, plane);
    l->nplanes = l->lit ? PLANES - 1 : PLANES;
    l->through = reaches(l, &b->node[0]);
    const ConeNode *cone = edges && !l->lit && !l->s->tree.moved && l->s->cones ? l->s->cones->node : NULL;
    BeamSight sight = {.near = l->near, .beyond = l->through ? l->beyond : HUGE_VAL};
    memcpy(sight.p, l->p, sizeof sight.p), memcpy(sight.along, l->row[2], sizeof sight.along);
    l->skipped = false;
    stack[depth++] = 0;
    while (depth) {
        const int32_t at = stack[--depth];
        const BvhNode *n = &b->node[at];
        uint32_t in = l->s->beam->boxes(n, plane, l->nplanes, l->p, l->s->tree.slack);
        if (in && cone) {
            const uint32_t alike = in & l->s->beam->alike(n, &cone[at], &sight);
            l->skipped |= alike != 0, in &= ~alike;
        }
        for (; in; in &= in - 1) {
            const int32_t child = n->child[__builtin_ctz(in)];
            if (child >= 0) {
                stack[depth++] = child;
                continue;
            }
            take_leaf(l, plane, &sight, ~child);
        }
    }
}

/* ---- segments */

/* The line of the plane through p with that normal; the ends are there. */
static void set_line(const Light *l, const double normal[3], Segment *s) {
    s->g[0] = vec_dot(normal, l->u), s->g[1] = vec_dot(normal, l->v), s->g[2] = vec_dot(normal, l->c);
    const double slope = sqrt(s->g[0] * s->g[0] + s->g[1] * s->g[1]);
    /* A plane that is parallel to the light has no line on it, and two sides all the same. */
    if (!(slope > 0) || !isfinite(slope)) s->g[0] = s->g[1] = 0, s->g[2] = s->g[2] < 0 ? -1 : 1;
    else
        for (int k = 0; k < 3; k++) s->g[k] /= slope;
    for (int i = 0; i < 2; i++)
        s->low[i] = light_min(s->end[0][i], s->end[1][i]), s->high[i] = light_max(s->end[0][i], s->end[1][i]);
    for (int k = 0; k < 2; k++) {
        const double along = s->g[0] * s->end[k][1] - s->g[1] * s->end[k][0];
        if (!k || along < s->from) s->from = along;
        if (!k || along > s->to) s->to = along;
    }
}

static void add_segment(Light *l, const double normal[3], Segment s) {
    set_line(l, normal, &s);
    if (!ROW_ADD(l->store->segment, s)) l->lost = true;
}

void light_lines(Light *l) {
    for (uint32_t i = l->nborder; i < l->store->segment.n; i++) {
        Segment *s = &l->store->segment.data[i];
        double a[3], b[3], normal[3];
        if (s->kind != SEGMENT_EDGE) continue;
        light_vertex(l, s->a, a), light_vertex(l, s->b, b);
        vec_cross(a, b, normal);
        set_line(l, normal, s);
    }
}

/* The part of the edge in the pyramid over the light, whose sides are the light's borders; false: none. */
static bool clip_edge(const Light *l, const double a[3], const double b[3], Segment *s) {
    static const int8_t border[5] = {3, 1, 0, 2, CUT_DEEP};
    double h[2][3], part[2] = {0, 1};
    s->cut[0] = s->cut[1] = CUT_NOT;
    for (int k = 0; k < 2; k++) vec_map(l->row, k ? b : a, h[k]);
    if (!(h[0][2] > 0) && !(h[1][2] > 0)) return false;
    for (int i = 0; i < 5; i++) {
        double f[2];
        for (int k = 0; k < 2; k++)
            f[k] = i == 4 ? 2 - l->beyond - h[k][2] : i & 1 ? h[k][2] - h[k][i / 2] : h[k][i / 2];
        if (f[0] < 0 && f[1] < 0) return false;
        if (!(f[0] < 0) && !(f[1] < 0)) continue;
        const double at = f[0] / (f[0] - f[1]);
        if (f[0] < 0 && at > part[0]) part[0] = at, s->cut[0] = border[i];
        if (f[1] < 0 && at < part[1]) part[1] = at, s->cut[1] = border[i];
    }
    if (!(part[0] < part[1])) return false;
    for (int k = 0; k < 2; k++) {
        double at[3];
        for (int i = 0; i < 3; i++)
            at[i] = part[k] == 0 ? h[0][i] : part[k] == 1 ? h[1][i] : h[0][i] + part[k] * (h[1][i] - h[0][i]);
        if (!(at[2] > 0)) return false;
        s->end[k][0] = at[0] / at[2], s->end[k][1] = at[1] / at[2];
    }
    return isfinite(s->end[0][0] + s->end[0][1] + s->end[1][0] + s->end[1][1]);
}

/* A side of the triangle that the window lies on? It cuts nothing of it; rounding must not say otherwise. */
static bool is_own(const Light *l, int32_t a, int32_t b) {
    if (l->own < 0) return false;
    const int32_t *face = l->s->tree.bvh->face + 3 * (size_t)l->own;
    return (a == face[0] || a == face[1] || a == face[2]) && (b == face[0] || b == face[1] || b == face[2]);
}

/* Which side of the way from a to b a face hides on whose half-edge runs that way, or the other: 1 left, -1 right. */
static int32_t hides_on(Facing f, bool same_way) {
    if (f < FACING_TO) return 0;
    return (f == FACING_AWAY) == same_way ? 1 : -1;
}

/* Edge k of the triangle, and of the one behind the half-edge `other`, if there is one. Its line is to come. */
static void add_edge(Light *l, int32_t triangle, int k, int32_t other) {
    const int32_t *face = l->s->tree.bvh->face + 3 * (size_t)triangle;
    const int32_t from = face[k], to = face[(k + 1) % 3];
    const bool up = from <= to;
    double a[3], b[3];
    Segment s = {.kind = SEGMENT_EDGE,
                 .a = up ? from : to,
                 .b = up ? to : from,
                 .more = hides_on(known(l, triangle), up),
                 .many = other == ADJACENCY_MANY};
    if (other >= 0) s.more += hides_on(known(l, other / 3), l->s->tree.bvh->face[other] == s.a);
    light_vertex(l, s.a, a), light_vertex(l, s.b, b);
    if (is_own(l, s.a, s.b) || !clip_edge(l, a, b, &s)) return;
    if (!ROW_ADD(l->store->segment, s)) l->lost = true;
}

/* Where the triangle passes through the light's plane; false: nowhere. normal: of the difference of 1 / h_z. What lies
 * on a piece's plane, within rounding, does not pass it: an edge there ends a shadow as others do. */
static bool cut_by_light(const Light *l, double at[3][3], double end[2][2], double normal[3]) {
    double h[3][3], p[3], q[3], m[3], light, det;
    int n = 0, on = 0;
    for (int k = 0; k < 3; k++) {
        vec_map(l->row, at[k], h[k]);
        if (l->lit && fabs(h[k][2] - 1) <= 1 - l->beyond) h[k][2] = 1, on++;
    }
    if (on > 1) return false;
    for (int k = 0; k < 3; k++) {
        const double *a = h[k], *b = h[(k + 1) % 3];
        if ((a[2] < 1) == (b[2] < 1) || n == 2) continue;
        const double part = (1 - a[2]) / (b[2] - a[2]);
        for (int i = 0; i < 2; i++) end[n][i] = a[i] + part * (b[i] - a[i]);
        n++;
    }
    if (n < 2) return false;
    vec_minus(at[1], at[0], p);
    vec_minus(at[2], at[0], q);
    vec_cross(p, q, normal);
    vec_cross(l->u, l->v, m);
    det = vec_dot(at[0], normal), light = vec_dot(l->c, m);
    for (int i = 0; i < 3; i++) normal[i] = normal[i] / det - m[i] / light;
    return isfinite(normal[0] + normal[1] + normal[2]);
}

/* Does the segment keep clear of the window? */
static bool is_clear(double end[2][2]) {
    for (int i = 0; i < 2; i++)
        if ((end[0][i] < 0 && end[1][i] < 0) || (end[0][i] > 1 && end[1][i] > 1)) return true;
    return false;
}

static void add_cut(Light *l, int32_t triangle) {
    Segment s = {.kind = SEGMENT_PLANE, .a = triangle, .b = triangle};
    double at[3][3], normal[3];
    light_corners(l, triangle, at);
    if (cut_by_light(l, at, s.end, normal) && !is_clear(s.end)) add_segment(l, normal, s);
}

/* ---- which edges end a shadow */

/* Do both faces of the edge hide, one on either side of it? Or neither? Their corners may run in different ways. */
static bool goes_on(const Light *l, int32_t triangle, int k, Facing own, int32_t half) {
    const int32_t *face = l->s->tree.bvh->face;
    const Facing other = known(l, half / 3);
    if (own < FACING_TO || other < FACING_TO) return own < FACING_TO && other < FACING_TO;
    return (own == other) == (face[3 * triangle + k] != face[half]);
}

/* Bits: of a gathered triangle's edges that may end a shadow, in a mesh all of whose faces run one way. Those do not
 * behind which a face is seen as this one, or was not gathered, which is out of the beam or alike. */
static uint32_t may_end(const LightStore *store, const int32_t across[3], uint32_t own) {
    uint32_t may = 0;
    for (int k = 0; k < 3; k++) {
        const uint32_t alone = across[k] < 0, other = store->stamp[alone ? 0 : (uint32_t)across[k] / 3],
                       differs = (other != own) & (other >> 2 == store->stamps);
        may |= (alone | differs) << k;
    }
    return may;
}

void light_edges(Light *l) {
    const LightStore *store = l->store;
    const Adjacency *adjacency = l->s->adjacency;
    const bool told = l->s->cones && l->s->cones->one_way && !l->lit && !l->s->tree.moved && !l->s->tree.bvh->unmet;
    for (uint32_t i = 0; i < store->triangle.n; i++) {
        const int32_t triangle = store->triangle.data[i], *across = adjacency->across + 3 * (size_t)triangle;
        const Facing own = known(l, triangle);
        for (uint32_t may = told ? may_end(store, across, store->stamp[triangle]) : 7; may; may &= may - 1) {
            const int k = __builtin_ctz(may), other = across[k];
            if (other < 0 ? own < FACING_TO : other / 3 > triangle || goes_on(l, triangle, k, own, other)) continue;
            add_edge(l, triangle, k, other);
        }
        l->touches |= own == FACING_NOT;
        if (own >= FACING_TO && l->through) add_cut(l, triangle);
    }
}

/* ---- triangle by triangle */

/* The last segment is a side of the own triangle, which is wholly on one side of it. */
static void keep_whole(Light *l, const double normal[3]) {
    double at[3][3], most = 0;
    Segment *s = &l->store->segment.data[l->store->segment.n - 1];
    if (l->lost) return;
    light_corners(l, l->own, at);
    for (int k = 0; k < 3; k++) {
        const double g = vec_dot(normal, at[k]);
        if (fabs(g) > fabs(most)) most = g;
    }
    s->g[0] = s->g[1] = 0, s->g[2] = most < 0 ? -1 : 1;
}

void light_facets(Light *l) {
    LightStore *store = l->store;
    for (uint32_t i = 0; i < store->triangle.n; i++) {
        const int32_t triangle = store->triangle.data[i], *face = l->s->tree.bvh->face + 3 * (size_t)triangle;
        double at[3][3], normal[3];
        light_corners(l, triangle, at);
        const Facing facing = light_facing(l, triangle, at);
        if (facing < FACING_TO) continue;
        Facet f = {.line = store->segment.n};
        for (int k = 0; k < 3; k++) {
            int a = k, b = (k + 1) % 3;
            if (face[a] > face[b]) a = b, b = k;
            f.sign[k] = (facing == FACING_AWAY) == (a == k) ? 1 : -1;
            Segment s = {.kind = SEGMENT_EDGE, .a = face[a], .b = face[b]};
            if (!clip_edge(l, at[a], at[b], &s)) s.end[0][0] = s.end[1][0] = s.end[0][1] = s.end[1][1] = -1;
            vec_cross(at[a], at[b], normal);
            add_segment(l, normal, s);
            if (is_own(l, face[a], face[b])) keep_whole(l, normal);
        }
        Segment cut = {.kind = SEGMENT_PLANE, .a = triangle, .b = triangle};
        f.cut = l->through && cut_by_light(l, at, cut.end, normal);
        if (f.cut) add_segment(l, normal, cut);
        if (!ROW_ADD(store->facet, f)) l->lost = true;
    }
}

bool light_hides_some(const Light *l, int32_t triangle) { return known(l, triangle) >= FACING_TO; }

bool light_hides(const Light *l, int32_t triangle, double u, double v) {
    double at[3][3], d[3], normal[3], sum = 0;
    const Facing facing = known(l, triangle);
    if (facing < FACING_TO) return false;
    light_corners(l, triangle, at);
    for (int i = 0; i < 3; i++) d[i] = l->c[i] + u * l->u[i] + v * l->v[i];
    for (int k = 0; k < 3; k++) {
        vec_cross(at[k], at[(k + 1) % 3], normal);
        const double g = vec_dot(d, normal);
        if (!(facing == FACING_AWAY ? g >= 0 : g <= 0)) return false;
        sum += g;
    }
    /* The weights of the corners are g / det, their sum 1 / h_z. */
    vec_cross(at[1], at[2], normal);
    return sum / vec_dot(at[0], normal) > 1;
}
