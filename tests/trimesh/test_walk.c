/* Walks between rays: nearly every jump of depth between two neighbouring rays is found by asking what parts them, and
 * where a walk says that nothing does, nothing jumps. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

#include "runtime/geometry/mesh/trimesh.h"
#include "saltus/mesh.h"

enum { MAX_VERTICES = 4000, MAX_FACES = 6000, SIDE = 160, HALVINGS = 40 };
#define JUMP 0.002 /* of t: what counts as a jump */
#define MISS 100.0

typedef struct Surface {
    int32_t nvertices, nfaces;
    double at[MAX_VERTICES][3];
    float f32[MAX_VERTICES][3];
    int32_t face[MAX_FACES][3];
} Surface;

static double uniform(uint64_t *state) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 11) * 0x1p-53;
}

static int32_t add_vertex(Surface *s, double x, double y, double z) {
    double *p = s->at[s->nvertices];
    p[0] = (float)x, p[1] = (float)y, p[2] = (float)z;
    return s->nvertices++;
}

static void add_face(Surface *s, int32_t a, int32_t b, int32_t c) {
    memcpy(s->face[s->nfaces++], (int32_t[]){a, b, c}, sizeof s->face[0]);
}

/* A closed surface around a point. */
static void add_blob(Surface *s, int rings, int columns, double rough, const double centre[3]) {
    const int32_t first = s->nvertices;
    uint64_t state = 7;
    for (int i = 0; i <= rings + 1; i++)
        for (int j = 0; j < (i == 0 || i == rings + 1 ? 1 : columns); j++) {
            double u = M_PI * i / (rings + 1), v = 2 * M_PI * (j + 0.37) / columns, r = 1 + rough * uniform(&state);
            add_vertex(s, centre[0] + r * sin(u) * cos(v), centre[1] + r * sin(u) * sin(v), centre[2] + r * cos(u));
        }
    for (int i = 0; i <= rings; i++)
        for (int j = 0; j < columns; j++) {
            int32_t k = (j + 1) % columns, above = first + 1 + (i - 1) * columns, below = first + 1 + i * columns;
            int32_t a = i ? above + j : first, b = i < rings ? below + j : s->nvertices - 1,
                    c = i < rings ? below + k : s->nvertices - 1, d = i ? above + k : first;
            if (b != c) add_face(s, a, b, c);
            if (a != d) add_face(s, a, c, d);
        }
}

static void add_soup(Surface *s, int n, double size) {
    uint64_t state = 11;
    for (int i = 0; i < n; i++) {
        double c[3];
        int32_t v[3];
        for (int a = 0; a < 3; a++) c[a] = 2 * uniform(&state) - 1;
        for (int k = 0; k < 3; k++) {
            double p[3];
            for (int a = 2; a >= 0; a--) p[a] = c[a] + size * (2 * uniform(&state) - 1);
            v[k] = add_vertex(s, p[0], p[1], p[2]);
        }
        add_face(s, v[0], v[1], v[2]);
    }
}

/* A sheet of n x n squares, wound this way and that. */
static void add_sheet(Surface *s, int n, double waves) {
    const int32_t first = s->nvertices;
    for (int i = 0; i <= n; i++)
        for (int j = 0; j <= n; j++) {
            double x = 2.0 * i / n - 1, y = 2.0 * j / n - 1;
            add_vertex(s, x, y, 0.4 * sin(waves * x) * cos(waves * y));
        }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            int32_t a = first + i * (n + 1) + j, b = a + n + 1;
            add_face(s, a, b, b + 1);
            if ((i + j) % 2) add_face(s, a, b + 1, a + 1);
            else add_face(s, b + 1, a, a + 1);
        }
}

typedef struct View {
    SltGeometry *g;
    const void *values;
    bool f64;
    double eye[3];
} View;

static View view_of(Surface *s, bool f64) {
    View v = {.f64 = f64, .eye = {0.31, 0.47, 4.1}, .values = f64 ? (const void *)s->at : s->f32};
    for (int i = 0; i < s->nvertices; i++)
        for (int a = 0; a < 3; a++) s->f32[i][a] = (float)s->at[i][a];
    const GeometrySource from = {.kind = SLT_GEOMETRY_MESH,
                                 .f64 = f64,
                                 .nvertices = (uint32_t)s->nvertices,
                                 .nfaces = (uint32_t)s->nfaces,
                                 .faces = &s->face[0][0],
                                 .queries = 1u << SLT_QUERY_TRACE | 1u << SLT_QUERY_BETWEEN};
    assert_int_equal(trimesh_make(&v.g, &from, v.values, TRIMESH_ISA_BEST, NULL), SLT_OK);
    return v;
}

static void direction(const double x[2], double d[3]) { d[0] = x[0], d[1] = x[1], d[2] = -4; }

static void set_row(const View *v, void *rays, uint32_t row, double to) {
    if (v->f64) ((double *)rays)[row] = to;
    else ((float *)rays)[row] = (float)to;
}

static void set_ray(const View *v, const double x[2], void *rays, uint32_t first) {
    double d[3];
    direction(x, d);
    for (uint32_t a = 0; a < 3; a++) set_row(v, rays, first + a, v->eye[a]), set_row(v, rays, first + 3 + a, d[a]);
    set_row(v, rays, first + SLT_RAY_T0, 0), set_row(v, rays, first + SLT_RAY_T1, MISS);
}

static int32_t trace(const View *v, const double x[2]) {
    double rays[SLT_RAY_POINT_ROWS];
    int32_t found;
    set_ray(v, x, rays, 0);
    v->g->query[SLT_QUERY_TRACE](v->g, v->values, rays, 1, 1, &found);
    return found;
}

static int32_t between(const View *v, const double x[2], const double y[2], int32_t a, int32_t b, bool edges,
                       uint32_t which) {
    double rays[SLT_PAIR_ROWS];
    int32_t found;
    set_ray(v, x, rays, 0), set_ray(v, y, rays, SLT_PAIR_OTHER);
    set_row(v, rays, SLT_PAIR_FACE, a), set_row(v, rays, SLT_PAIR_OTHER_FACE, b);
    set_row(v, rays, SLT_PAIR_EDGES, edges), set_row(v, rays, SLT_PAIR_WHICH, which);
    v->g->query[SLT_QUERY_BETWEEN](v->g, v->values, rays, 1, 1, &found);
    return found;
}

/* ---- planes and lines in double */
static void corner(const View *v, const Surface *s, int32_t i, double out[3]) {
    for (int a = 0; a < 3; a++) out[a] = s->at[i][a] - v->eye[a];
}

static void cross(const double a[3], const double b[3], double out[3]) {
    for (int i = 0; i < 3; i++) out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void plane(const View *v, const Surface *s, int32_t face, double n[3], double *det) {
    double p[3][3], u[3], w[3];
    for (int k = 0; k < 3; k++) corner(v, s, s->face[face][k], p[k]);
    for (int a = 0; a < 3; a++) u[a] = p[1][a] - p[0][a], w[a] = p[2][a] - p[0][a];
    cross(u, w, n);
    *det = dot(p[0], n);
}

static double depth(const View *v, const Surface *s, const double x[2], int32_t face) {
    double d[3], n[3], det;
    if (face < 0) return MISS;
    direction(x, d);
    plane(v, s, face, n, &det);
    return det / dot(d, n);
}

static double g_of(const View *v, const Surface *s, const double x[2], int32_t a, int32_t b) {
    double d[3], p[3], q[3], n[3], m[3], det[2];
    direction(x, d);
    if (b < 0) {
        plane(v, s, a, n, &det[0]), plane(v, s, ~b, m, &det[1]);
        return dot(d, n) * det[1] - dot(d, m) * det[0];
    }
    corner(v, s, a, p), corner(v, s, b, q);
    cross(p, q, n);
    return dot(d, n);
}

static void mix(const double x[2], const double y[2], double t, double out[2]) {
    for (int i = 0; i < 2; i++) out[i] = (1 - t) * x[i] + t * y[i];
}

/* Bisects towards the larger change: does the depth jump between x and y? */
static bool jumps(const View *v, const Surface *s, const double x0[2], const double y0[2]) {
    double x[2] = {x0[0], x0[1]}, y[2] = {y0[0], y0[1]}, m[2], tx = depth(v, s, x, trace(v, x)),
           ty = depth(v, s, y, trace(v, y));
    for (int i = 0; i < (v->f64 ? 40 : 18); i++) {
        mix(x, y, 0.5, m);
        double tm = depth(v, s, m, trace(v, m));
        if (fabs(tm - tx) > fabs(ty - tm)) memcpy(y, m, sizeof m), ty = tm;
        else memcpy(x, m, sizeof m), tx = tm;
    }
    return fabs(tx - ty) > JUMP * fmin(tx, ty);
}

typedef struct Count {
    uint64_t differ, smooth, lost, jumps, named, first, asked;
} Count;

/* As the finder does: the root of the line between x and y, and what is left on both sides. */
static bool find(const View *v, const Surface *s, const double x[2], const double y[2], int level, Count *c) {
    int32_t a = trace(v, x), b = trace(v, y);
    if (a == b || level > HALVINGS) return false;
    int32_t first = between(v, x, y, a, b, SLT_EDGES_NONE, 0);
    c->asked++;
    if (first == SLT_WITNESS_NONE) return false;
    double at = 0.5, lo[2], hi[2], pad = v->f64 ? 1e-9 : 1e-3;
    if (first >= 0) {
        int32_t second = between(v, x, y, a, b, SLT_EDGES_NONE, 1);
        double gx = g_of(v, s, x, first, second), gy = g_of(v, s, y, first, second);
        if ((gx < 0) != (gy < 0)) at = gx / (gx - gy);
        else first = SLT_BETWEEN_LOST;
    }
    if (first < 0) {
        mix(x, y, 0.5, lo);
        return find(v, s, x, lo, level + 1, c) || find(v, s, lo, y, level + 1, c);
    }
    mix(x, y, fmax(0, at - pad), lo), mix(x, y, fmin(1, at + pad), hi);
    double tl = depth(v, s, lo, trace(v, lo)), th = depth(v, s, hi, trace(v, hi));
    if (fabs(tl - th) > 0.5 * JUMP * fmin(tl, th)) {
        c->first += level == 0;
        return true;
    }
    return find(v, s, x, lo, level + 1, c) || find(v, s, hi, y, level + 1, c);
}

static Count survey(Surface *s, bool f64) {
    const View v = view_of(s, f64);
    Count c = {0};
    for (int i = 0; i < SIDE; i++)
        for (int j = 0; j < SIDE; j++)
            for (int axis = 0; axis < 2; axis++) {
                double x[2] = {2.8 * (i + 0.321) / SIDE - 1.4, 2.8 * (j + 0.123) / SIDE - 1.4}, y[2] = {x[0], x[1]};
                y[axis] += 2.8 / SIDE;
                int32_t a = trace(&v, x), b = trace(&v, y);
                if (a == b) continue;
                c.differ++;
                int32_t line = between(&v, x, y, a, b, SLT_EDGES_NONE, 0);
                assert_int_equal(line, between(&v, y, x, b, a, SLT_EDGES_NONE, 0));
                c.smooth += line == SLT_WITNESS_NONE, c.lost += line == SLT_BETWEEN_LOST;
                if (!jumps(&v, s, x, y)) continue;
                c.jumps++;
                c.named += find(&v, s, x, y, 0, &c);
            }
    geometry_free(v.g);
    return c;
}

static void check(Surface *s, const char *name) {
    for (int f64 = 0; f64 < 2; f64++) {
        Count c = survey(s, f64);
        print_message("%s %s: %llu differ, %llu smooth, %llu not known; %llu jumps, %llu named, %llu at once\n", name,
                      f64 ? "f64" : "f32", (unsigned long long)c.differ, (unsigned long long)c.smooth,
                      (unsigned long long)c.lost, (unsigned long long)c.jumps, (unsigned long long)c.named,
                      (unsigned long long)c.first);
        assert_true(c.jumps > 100);
        assert_true((double)c.named >= 0.999 * (double)c.jumps);
        assert_true((double)c.lost <= 0.001 * (double)c.differ + 1);
    }
    free(s);
}

static const double middle[3] = {0, 0, 0}, aside[3] = {0.7, 0.2, 0.4};

static void test_blob(void **state) {
    (void)state;
    Surface *s = calloc(1, sizeof *s);
    add_blob(s, 20, 40, 0, middle);
    check(s, "ball");
}

static void test_rough(void **state) {
    (void)state;
    Surface *s = calloc(1, sizeof *s);
    add_blob(s, 30, 60, 0.3, middle);
    check(s, "rough ball");
}

static void test_crossing_balls(void **state) {
    (void)state;
    Surface *s = calloc(1, sizeof *s);
    add_blob(s, 20, 30, 0.1, middle);
    add_blob(s, 15, 20, 0, aside);
    check(s, "crossing balls");
}

static void test_soup(void **state) {
    (void)state;
    Surface *s = calloc(1, sizeof *s);
    add_soup(s, 300, 0.5);
    check(s, "crossing triangles");
}

static void test_sheet(void **state) {
    (void)state;
    Surface *s = calloc(1, sizeof *s);
    add_sheet(s, 24, 9);
    check(s, "waves");
}

/* Faces twice, three at an edge, without area, an edge with another's vertex in its middle. */
static void test_broken(void **state) {
    (void)state;
    Surface *s = calloc(1, sizeof *s);
    add_sheet(s, 8, 3);
    for (int i = 0; i < 20; i++) add_face(s, s->face[3 * i][0], s->face[3 * i][1], s->face[3 * i][2]);
    int32_t fin = add_vertex(s, 0.1, 0.2, 1.5);
    for (int i = 0; i < 10; i++) add_face(s, s->face[5 * i][0], s->face[5 * i][1], fin);
    int32_t p = add_vertex(s, -1.2, 1.1, 0.5), q = add_vertex(s, 1.2, 1.1, 0.5), m = add_vertex(s, 0, 1.1, 0.5),
            r = add_vertex(s, 0, 1.3, 0.7), t = add_vertex(s, 0, 0.7, 0.5);
    add_face(s, p, q, r), add_face(s, p, m, t), add_face(s, m, q, t), add_face(s, p, m, q);
    add_face(s, p, p, q), add_face(s, r, r, r);
    check(s, "broken");
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_blob),           cmocka_unit_test(test_rough),
                                       cmocka_unit_test(test_crossing_balls), cmocka_unit_test(test_soup),
                                       cmocka_unit_test(test_sheet),          cmocka_unit_test(test_broken)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
