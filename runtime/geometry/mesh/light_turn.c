/* From the J of segments to derivatives.
 *
 * A side on the plane with normal G = A x B moves by dE = J . dG / |G|. With T, A and B are mapped vertices, from p:
 * the derivative in a mapped vertex, turned back by T, is that in the vertex, less that in p; with the vertex itself it
 * makes that in T. */
#include "light_inner.h"

#include <math.h>

#include "saltus/mesh.h"

/* What is held of a point: its place from p, the derivative in it. */
typedef struct Point {
    double at[3], mapped[3], d[3];
} Point;

static void point_set(const Light *l, Point *p, const double at[3]) {
    memcpy(p->at, at, sizeof p->at);
    vec_map(l->map, at, p->mapped);
    memset(p->d, 0, sizeof p->d);
}

static void point_of_vertex(const Light *l, Point *p, int32_t vertex) {
    double at[3];
    light_vertex(l, vertex, at);
    point_set(l, p, at);
}

/* by: the derivative in the mapped point. */
static void turn_back(const Light *l, LightSlopes *s, Point *p, const double by[3]) {
    double d[3];
    vec_back(l->map, by, d);
    vec_add(p->d, 1, d);
    for (int i = 0; i < 3; i++) vec_add(s->map[i], by[i], p->at);
}

/* The plane through p and two points. */
static void turn_edge(const Light *l, LightSlopes *s, const double j[3], Point *a, Point *b) {
    double g[3], by[3], scaled[3] = {0};
    vec_cross(a->mapped, b->mapped, g);
    const double size = sqrt(vec_dot(g, g));
    if (!(size > 0)) return;
    vec_add(scaled, 1 / size, j);
    vec_cross(b->mapped, scaled, by);
    turn_back(l, s, a, by);
    vec_cross(scaled, a->mapped, by);
    turn_back(l, s, b, by);
}

/* The plane of g = N / D - M / m: N = (B - A) x (C - A) and D = A . N of a triangle, M = u x v and m = c . M of the
 * light, all mapped. J . N / D = J . M / m. */
static void turn_plane(const Light *l, LightSlopes *s, const double j[3], Point corner[3], Point light[3]) {
    double e[2][3], n[3], m[3], g[3], by[3], product[3], scaled[3] = {0};
    for (int k = 0; k < 2; k++) vec_minus(corner[k + 1].mapped, corner[0].mapped, e[k]);
    vec_cross(e[0], e[1], n);
    vec_cross(light[1].mapped, light[2].mapped, m);
    const double det = vec_dot(corner[0].mapped, n), whole = vec_dot(light[0].mapped, m);
    for (int i = 0; i < 3; i++) g[i] = n[i] / det - m[i] / whole;
    const double size = sqrt(vec_dot(g, g));
    if (!(size > 0) || !isfinite(size)) return;
    vec_add(scaled, 1 / size, j);
    const double held = vec_dot(scaled, n) / det;
    for (int k = 0; k < 3; k++) {
        const double *b = corner[(k + 1) % 3].mapped, *c = corner[(k + 2) % 3].mapped;
        double opposite[3];
        vec_minus(b, c, opposite);
        vec_cross(opposite, scaled, by);
        vec_cross(b, c, product);
        vec_add(by, -held, product);
        for (int i = 0; i < 3; i++) by[i] /= det;
        turn_back(l, s, &corner[k], by);
    }
    for (int k = 0; k < 3; k++) {
        const double *b = light[(k + 1) % 3].mapped, *c = light[(k + 2) % 3].mapped;
        memset(by, 0, sizeof by);
        vec_cross(b, c, product);
        vec_add(by, held / whole, product);
        if (k) {
            if (k == 1) vec_cross(light[2].mapped, scaled, product);
            else vec_cross(scaled, light[1].mapped, product);
            vec_add(by, -1 / whole, product);
        }
        turn_back(l, s, &light[k], by);
    }
}

/* The receiver's horizon, mapped: its normal is T^-T n. */
static void turn_horizon(const Light *l, LightSlopes *s, const double j[3]) {
    double cofactor[3][3], g[3], back[3];
    for (int i = 0; i < 3; i++) vec_cross(l->map[(i + 1) % 3], l->map[(i + 2) % 3], cofactor[i]);
    const double det = vec_dot(l->map[0], cofactor[0]);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) cofactor[i][k] /= det; /* T^-T */
    vec_map(cofactor, l->n, g);
    const double size = sqrt(vec_dot(g, g));
    if (!(size > 0)) return;
    vec_back(cofactor, j, back);
    for (int i = 0; i < 3; i++) back[i] /= size;
    vec_add(s->n, 1, back);
    for (int k = 0; k < 3; k++) vec_add(s->map[k], -g[k], back);
}

static void turn_border(const Light *l, LightSlopes *s, const double j[3], int k) {
    static const double at[5][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0, 0}};
    Point p[2];
    for (int i = 0; i < 2; i++) {
        double place[3];
        memcpy(place, l->c, sizeof place);
        vec_add(place, at[k + i][0], l->u);
        vec_add(place, at[k + i][1], l->v);
        point_set(l, &p[i], place);
    }
    turn_edge(l, s, j, &p[0], &p[1]);
    for (int i = 0; i < 2; i++) {
        vec_add(s->corner, 1, p[i].d);
        vec_add(s->u, at[k + i][0], p[i].d);
        vec_add(s->v, at[k + i][1], p[i].d);
    }
}

/* b: NULL where there is one point. */
static void add_vertices(Light *l, const Point *a, const Point *b, int32_t na, int32_t nb, LightSlopes *s) {
    LightEdge e = {.vertex = {na, nb}};
    memcpy(e.d[0], a->d, sizeof e.d[0]);
    if (b) memcpy(e.d[1], b->d, sizeof e.d[1]);
    if (!ROW_ADD(l->store->edge, e)) l->lost = true;
    for (int k = 0; k < 2; k++) vec_add(s->moved, 1, e.d[k]);
}

static void turn_triangle(Light *l, LightSlopes *s, const Segment *segment) {
    const int32_t *face = l->s->tree.bvh->face + 3 * (size_t)segment->a;
    Point corner[3], light[3];
    for (int k = 0; k < 3; k++) point_of_vertex(l, &corner[k], face[k]);
    point_set(l, &light[0], l->c);
    point_set(l, &light[1], l->u);
    point_set(l, &light[2], l->v);
    turn_plane(l, s, segment->j, corner, light);
    vec_add(s->corner, 1, light[0].d);
    vec_add(s->u, 1, light[1].d);
    vec_add(s->v, 1, light[2].d);
    add_vertices(l, &corner[0], &corner[1], face[0], face[1], s);
    add_vertices(l, &corner[2], NULL, face[2], face[2], s);
}

static void turn_segment(Light *l, LightSlopes *s, const Segment *segment, int number) {
    Point p[2];
    switch (segment->kind) {
    case SEGMENT_FIXED:
    case SEGMENT_PIECE: return;
    case SEGMENT_BORDER: turn_border(l, s, segment->j, number); return;
    case SEGMENT_HORIZON: turn_horizon(l, s, segment->j); return;
    case SEGMENT_PLANE: turn_triangle(l, s, segment); return;
    case SEGMENT_EDGE:
        point_of_vertex(l, &p[0], segment->a);
        point_of_vertex(l, &p[1], segment->b);
        turn_edge(l, s, segment->j, &p[0], &p[1]);
        add_vertices(l, &p[0], &p[1], segment->a, segment->b, s);
        return;
    }
}

void light_turn(Light *l, LightSlopes *s) {
    for (uint32_t i = 0; i < l->store->segment.n; i++) {
        const Segment *segment = &l->store->segment.data[i];
        if (vec_dot(segment->j, segment->j) != 0) turn_segment(l, s, segment, (int)i);
    }
}
