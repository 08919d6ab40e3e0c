/* Light of parallelograms past meshes: closed forms, a reference in long double, both ways of searching; what is
 * degenerate; derivatives against differences of the reference. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "light_answer.h"

/* Builds, asks once, frees. */
static double once(LitScene *s, bool f64, bool lobe, LightWay way) {
    Trimesh *m = make(s, f64);
    const double value = ask(m, s, lobe, way, NULL);
    geometry_free(&m->base.shared);
    return value;
}

static long double reference(const LitScene *s, bool lobe) {
    static long double at[LIT_VERTICES][3];
    long double row[SLT_LOBE_ROWS];
    for (int k = 0; k < SLT_LOBE_ROWS; k++) row[k] = s->row[k];
    for (uint32_t i = 0; i < s->nvertices; i++)
        for (int a = 0; a < 3; a++) at[i][a] = s->at[i][a];
    return lit_value(s, row, (const long double(*)[3])at, lobe);
}

/* One triangle, far below. */
static void nothing_near(LitScene *s) {
    memset(s, 0, sizeof *s);
    lit_face(s, lit_vertex(s, 0, 0, -50), lit_vertex(s, 1, 0, -50), lit_vertex(s, 0, 1, -50));
}

/* ---- values */

/* The midpoint rule over the light, extrapolated. */
static double by_numbers(const LitScene *s, int n) {
    const double *row = s->row;
    double sum = 0, normal[3];
    for (int a = 0; a < 3; a++) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;
        normal[a] = row[SLT_LIGHT_U + b] * row[SLT_LIGHT_V + c] - row[SLT_LIGHT_U + c] * row[SLT_LIGHT_V + b];
    }
    for (int i = 0; i < n * n; i++) {
        double here = 0, there = 0, square = 0;
        for (int a = 0; a < 3; a++) {
            const double d = row[SLT_LIGHT_CORNER + a] - row[SLT_LIGHT_P + a] +
                             (i % n + 0.5) / n * row[SLT_LIGHT_U + a] + (i / n + 0.5) / n * row[SLT_LIGHT_V + a];
            here += d * row[SLT_LIGHT_N + a], there -= d * normal[a], square += d * d;
        }
        if (here > 0 && there > 0) sum += here * there / (square * square);
    }
    return sum / (n * n);
}

static void test_unoccluded(void **state) {
    (void)state;
    LitScene *s = calloc(1, sizeof *s);
    nothing_near(s);
    place(s, 0.3, -0.2);
    const double a = by_numbers(s, 200), b = by_numbers(s, 400);
    assert_float_equal(once(s, true, false, LIGHT_BY_COUNTS), b + (b - a) / 3, 1e-9);
    /* A square above its axis: the configuration factor of textbooks, four times that of a corner. */
    put(s, SLT_LIGHT_P, 0, 0, 0), put(s, SLT_LIGHT_N, 0, 0, 1), put(s, SLT_LIGHT_CORNER, -0.5, -0.4, 1);
    put(s, SLT_LIGHT_U, 0, 0.8, 0), put(s, SLT_LIGHT_V, 1, 0, 0);
    const double x = 0.5, y = 0.4;
    assert_float_equal(
        once(s, true, false, LIGHT_BY_COUNTS),
        2 * (x / sqrt(1 + x * x) * atan(y / sqrt(1 + x * x)) + y / sqrt(1 + y * y) * atan(x / sqrt(1 + y * y))), 1e-14);
    free(s);
}

static void test_horizon(void **state) {
    (void)state;
    LitScene *s = calloc(1, sizeof *s);
    nothing_near(s);
    /* A wall, half of it under the floor. */
    put(s, SLT_LIGHT_N, 0, 0, 1), put(s, SLT_LIGHT_CORNER, 1, -1, -1);
    put(s, SLT_LIGHT_U, 0, 0, 2), put(s, SLT_LIGHT_V, 0, 2, 0);
    const double whole = once(s, true, false, LIGHT_BY_COUNTS);
    put(s, SLT_LIGHT_CORNER, 1, -1, 0), put(s, SLT_LIGHT_U, 0, 0, 1);
    assert_true(whole > 0.1);
    assert_float_equal(whole, once(s, true, false, LIGHT_BY_COUNTS), 1e-15);
    put(s, SLT_LIGHT_N, -1, 0, 0);
    assert_true(once(s, true, false, LIGHT_BY_COUNTS) == 0);
    free(s);
}

static void test_half_hidden(void **state) {
    (void)state;
    LitScene *s = calloc(1, sizeof *s);
    put(s, SLT_LIGHT_N, 0, 0, 1), put(s, SLT_LIGHT_CORNER, -0.5, -0.4, 1);
    put(s, SLT_LIGHT_U, 0, 0.8, 0), put(s, SLT_LIGHT_V, 1, 0, 0);
    lit_square(s, (double[3]){-0.1, -2, 0.5}, (double[3]){4, 0, 0}, (double[3]){0, 4, 0}, 1);
    const double half = once(s, true, false, LIGHT_SILHOUETTES), other = once(s, true, false, LIGHT_TRIANGLES);
    s->nfaces = s->nvertices = 0;
    lit_square(s, (double[3]){0, 0, -50}, (double[3]){1, 0, 0}, (double[3]){0, 1, 0}, 1);
    put(s, SLT_LIGHT_V, 0.3, 0, 0); /* the shadow's edge is at x = -0.2 of the light */
    const double want = once(s, true, false, LIGHT_BY_COUNTS);
    assert_float_equal(half, want, 1e-14);
    assert_float_equal(other, want, 1e-14);
    free(s);
}

/* Nothing behind the light hides it, nor in its plane; of what goes through it, the part before it does. */
static void test_at_the_light(void **state) {
    (void)state;
    static const double z[] = {1.5, 1 + 1e-14, 1, 1 - 1e-14};
    for (int f64 = 0; f64 < 2; f64++) {
        LitScene *s = calloc(1, sizeof *s);
        nothing_near(s);
        put(s, SLT_LIGHT_P, 0.1, 0.2, 0), put(s, SLT_LIGHT_N, 0, 0, 1), put(s, SLT_LIGHT_CORNER, -0.5, -0.4, 1);
        put(s, SLT_LIGHT_U, 0, 0.8, 0), put(s, SLT_LIGHT_V, 1, 0, 0);
        const double free_value = once(s, f64, false, LIGHT_BY_COUNTS);
        for (int i = 0; i < 4; i++)
            for (LightWay way = LIGHT_SILHOUETTES; way <= LIGHT_TRIANGLES; way++) {
                s->nfaces = s->nvertices = 0;
                lit_square(s, (double[3]){-0.3, -0.3, z[i]}, (double[3]){0.6, 0, 0}, (double[3]){0, 0.6, 0}, 2);
                assert_float_equal(once(s, f64, false, way), free_value, 1e-15);
            }
        double value[2][2];
        for (int whole = 0; whole < 2; whole++)
            for (int way = 0; way < 2; way++) { /* a wall and a lid with a slope, cut at the light's plane or not */
                const double t = whole ? 1 : 0.5;
                s->nfaces = s->nvertices = 0;
                lit_square(s, (double[3]){-0.1, -0.3, 0.75}, (double[3]){0.1, 0.5, 0}, (double[3]){0, 0, 0.5 * t}, 1);
                lit_square(s, (double[3]){0.1, -0.3, 0.9}, (double[3]){0.25 * t, 0, 0.2 * t}, (double[3]){0, 0.4, 0},
                           1);
                value[whole][way] = once(s, f64, false, way ? LIGHT_TRIANGLES : LIGHT_SILHOUETTES);
            }
        for (int way = 0; way < 2; way++) {
            assert_float_equal(value[1][way], value[0][0], f64 ? 1e-12 : 1e-6);
            assert_float_equal(value[0][way], value[0][0], f64 ? 1e-12 : 1e-6);
            assert_true(value[0][0] < free_value - 0.01);
        }
        free(s);
    }
}

static void test_degenerate(void **state) {
    (void)state;
    LitScene *s = calloc(1, sizeof *s);
    static const int rows[] = {SLT_LIGHT_P, SLT_LIGHT_N, SLT_LIGHT_CORNER, SLT_LIGHT_U, SLT_LIGHT_V};
    lit_blob(s, (double[3]){0, 0, 0.5}, 0.2, 5, 9, 0);
    Trimesh *m = make(s, true);
    place(s, 0.2, 0.1);
    memcpy(s->row + SLT_LIGHT_V, s->row + SLT_LIGHT_U, 3 * sizeof(double)); /* a line */
    assert_true(ask(m, s, false, LIGHT_BY_COUNTS, NULL) == 0);
    for (int a = 0; a < 3; a++) s->row[SLT_LIGHT_V + a] = 0;
    assert_true(ask(m, s, false, LIGHT_BY_COUNTS, NULL) == 0);
    place(s, 0.2, 0.1); /* in its plane */
    for (int a = 0; a < 3; a++)
        s->row[SLT_LIGHT_P + a] = s->row[SLT_LIGHT_CORNER + a] + 2 * s->row[SLT_LIGHT_U + a] + s->row[SLT_LIGHT_V + a];
    assert_float_equal(ask(m, s, false, LIGHT_BY_COUNTS, NULL), 0, 1e-12);
    place(s, 0.2, 0.1); /* behind it */
    s->row[SLT_LIGHT_P + 2] = 2;
    s->row[SLT_LIGHT_N + 2] = -1;
    assert_true(ask(m, s, false, LIGHT_BY_COUNTS, NULL) == 0);
    place(s, 0.2, 0.1); /* seen from below */
    s->row[SLT_LIGHT_VIEW + 2] = -1;
    assert_true(ask(m, s, true, LIGHT_BY_COUNTS, NULL) == 0);
    for (int k = 0; k < 5; k++) {
        place(s, 0.2, 0.1);
        s->row[rows[k] + 1] = k & 1 ? NAN : HUGE_VAL;
        assert_true(isnan(ask(m, s, false, LIGHT_BY_COUNTS, NULL)));
    }
    /* Broken vertices and collapsed triangles hide nothing. */
    place(s, 0.2, 0.1);
    s->at[3][1] = NAN, memcpy(s->at[20], s->at[21], sizeof s->at[0]);
    geometry_changed(&m->base.shared, 0, 1), geometry_follow(&m->base.shared, s->at);
    const double value = ask(m, s, false, LIGHT_SILHOUETTES, NULL);
    assert_true(isfinite(value) && value > 0);
    assert_float_equal(value, ask(m, s, false, LIGHT_TRIANGLES, NULL), 1e-12);
    geometry_free(&m->base.shared);
    free(s);
}

/* A receiver on the mesh, as rounding leaves it: its own triangle does not hide the light. */
static void test_on_the_mesh(void **state) {
    (void)state;
    for (int f64 = 0; f64 < 2; f64++) {
        LitScene *s = calloc(1, sizeof *s);
        lit_blob(s, (double[3]){0.1, 0.2, 0.3}, 0.4, 9, 16, 0);
        lit_blob(s, (double[3]){0.4, 0.3, 0.85}, 0.1, 5, 9, 0);
        Trimesh *m = make(s, f64);
        uint64_t seed = 11;
        uint32_t lit = 0;
        for (uint32_t i = 0; i < 2000; i++) {
            const int32_t *face = s->face[i % 288];
            double w[3] = {lit_uniform(&seed), lit_uniform(&seed), 0}, e[2][3], p[3], normal[3];
            if (w[0] + w[1] > 1) w[0] = 1 - w[0], w[1] = 1 - w[1];
            if (i % 7 == 0) w[0] = 0;
            w[2] = 1 - w[0] - w[1];
            place(s, 0, 0);
            for (int a = 0; a < 3; a++) {
                p[a] = 0;
                for (int k = 0; k < 3; k++) p[a] += w[k] * (f64 ? s->at[face[k]][a] : (double)s->f32[face[k]][a]);
                for (int k = 0; k < 2; k++) e[k][a] = s->at[face[k + 1]][a] - s->at[face[0]][a];
            }
            for (int a = 0; a < 3; a++) {
                const int b = (a + 1) % 3, c = (a + 2) % 3;
                normal[a] = e[0][b] * e[1][c] - e[0][c] * e[1][b];
            }
            unit_length(normal);
            put(s, SLT_LIGHT_P, p[0], p[1], p[2]), put(s, SLT_LIGHT_N, normal[0], normal[1], normal[2]);
            const double on = ask(m, s, false, LIGHT_SILHOUETTES, NULL), same = ask(m, s, false, LIGHT_TRIANGLES, NULL);
            for (int a = 0; a < 3; a++) s->row[SLT_LIGHT_P + a] += 1e-4 * normal[a];
            const double above = ask(m, s, false, LIGHT_SILHOUETTES, NULL);
            assert_float_equal(on, same, f64 ? 1e-11 : 1e-6);
            assert_float_equal(on, above, 2e-3);
            lit += on > 0;
        }
        assert_in_range(lit, 600, 1600);
        geometry_free(&m->base.shared);
        free(s);
    }
}

enum { SCENES = 8 };
static void set_scene(LitScene *s, int which) {
    memset(s, 0, sizeof *s);
    place(s, 0.23, 0.11);
    switch (which) {
    case 0: lit_blob(s, (double[3]){0, 0, 0.5}, 0.2, 5, 9, 0); break;
    case 1: lit_blob(s, (double[3]){0.05, 0, 0.45}, 0.12, 5, 9, 1); break;
    case 2: lit_soup(s, 12, 0.4, 3); break;
    case 3: lit_square(s, (double[3]){-0.2, -0.2, 0.4}, (double[3]){0.4, 0.01, 0}, (double[3]){0, 0.4, 0.1}, 3); break;
    case 4: /* through the light */ lit_blob(s, (double[3]){0, 0.1, 0.95}, 0.2, 4, 7, 0.1); break;
    case 5: /* around the receiver, and behind it */
        lit_square(s, (double[3]){-1, -0.9, -0.4}, (double[3]){1.31, 0.1, 1.2}, (double[3]){0.1, 1.45, 0.9}, 1);
        break;
    case 6: /* low light: the horizon cuts it */
        lit_blob(s, (double[3]){0.5, 0, 0.1}, 0.1, 4, 7, 0);
        put(s, SLT_LIGHT_CORNER, 1.1, -0.6, -0.4), put(s, SLT_LIGHT_U, 0.05, 0.1, 1.1),
            put(s, SLT_LIGHT_V, 0.1, 1.2, 0);
        put(s, SLT_LIGHT_VIEW, -0.7, 0.1, 0.5), unit_length(s->row + SLT_LIGHT_VIEW);
        break;
    case 7: /* no face is anybody's neighbour, edges lie on edges */
        lit_square(s, (double[3]){-0.2, -0.2, 0.4}, (double[3]){0.4, 0, 0}, (double[3]){0, 0.4, 0.1}, 3);
        for (uint32_t f = 0; f < 18; f++)
            for (int k = 0; k < 3; k++) {
                const double *p = s->at[s->face[f][k]];
                s->face[f][k] = lit_vertex(s, p[0], p[1], p[2]);
            }
        break;
    }
}

static void test_values(void **state) {
    (void)state;
    LitScene *s = calloc(1, sizeof *s);
    for (int which = 0; which < SCENES; which++)
        for (int lobe = 0; lobe < 2; lobe++) {
            set_scene(s, which);
            Trimesh *wide = make(s, true), *narrow = make(s, false);
            for (int i = 0; i < 10; i++) {
                s->row[SLT_LIGHT_P] = 0.1 * i - 0.5, s->row[SLT_LIGHT_P + 1] = 0.074 * i - 0.3;
                const double want = (double)reference(s, lobe);
                assert_float_equal(ask(wide, s, lobe, LIGHT_SILHOUETTES, NULL), want, 1e-12);
                assert_float_equal(ask(wide, s, lobe, LIGHT_TRIANGLES, NULL), want, 1e-12);
                assert_float_equal(ask(narrow, s, lobe, LIGHT_SILHOUETTES, NULL), want, 2e-6);
            }
            geometry_free(&wide->base.shared), geometry_free(&narrow->base.shared);
        }
    free(s);
}

/* Of a grid's places: edges on edges, faces on faces, collapsed and turned ones, on the receiver's horizon, the light's
 * plane and its borders. */
static void test_grids(void **state) {
    (void)state;
    LitScene *s = calloc(1, sizeof *s);
    uint64_t seed = 1;
    uint32_t lit = 0;
    place(s, 0, 0);
    put(s, SLT_LIGHT_N, 0, 0, 1), put(s, SLT_LIGHT_CORNER, -0.5, -0.5, 1);
    put(s, SLT_LIGHT_U, 0, 1, 0), put(s, SLT_LIGHT_V, 1, 0, 0);
    for (int scene = 0; scene < 5000; scene++) {
        const int vertices = 4 + (int)(6 * lit_uniform(&seed)), faces = 1 + (int)(8 * lit_uniform(&seed));
        const bool lobe = scene % 5 == 0;
        s->nvertices = s->nfaces = 0;
        for (int i = 0; i < vertices; i++) {
            double p[3];
            for (int a = 0; a < 3; a++) p[a] = floor(5 * lit_uniform(&seed)) / 2 - 1;
            lit_vertex(s, p[0], p[1], scene & 1 ? 0.5 : scene & 2 ? 0.75 * p[2] + 0.75 : 0.4 * p[2] + 0.5);
        }
        for (int i = 0; i < faces; i++) {
            int32_t corner[3];
            for (int k = 0; k < 3; k++) corner[k] = (int32_t)(vertices * lit_uniform(&seed));
            lit_face(s, corner[0], corner[1], corner[2]);
        }
        for (int a = 0; a < 2; a++) s->row[SLT_LIGHT_P + a] = floor(5 * lit_uniform(&seed)) / 2 - 1;
        s->row[SLT_LIGHT_P + 2] = 0;
        const double want = (double)reference(s, lobe);
        Trimesh *wide = make(s, true), *narrow = make(s, false);
        assert_float_equal(ask(wide, s, lobe, LIGHT_SILHOUETTES, NULL), want, 1e-13);
        assert_float_equal(ask(wide, s, lobe, LIGHT_TRIANGLES, NULL), want, 1e-13);
        assert_float_equal(ask(narrow, s, lobe, LIGHT_SILHOUETTES, NULL), want, 1e-6);
        geometry_free(&wide->base.shared), geometry_free(&narrow->base.shared);
        lit += want > 0;
    }
    assert_in_range(lit, 4000, 4999);
    free(s);
}

/* ---- derivatives */

typedef struct Moved {
    const LitScene *s;
    long double row[SLT_LOBE_ROWS], at[LIT_VERTICES][3];
    bool lobe;
} Moved;

/* Central differences of the reference, extrapolated. */
static double difference(Moved *m, long double *number) {
    const long double keep = *number, h = 1e-6L;
    long double d[2];
    for (int i = 0; i < 2; i++) {
        long double v[2], step = h * (i + 1);
        for (int side = 0; side < 2; side++) {
            *number = side ? keep - step : keep + step;
            v[side] = lit_value(m->s, m->row, (const long double(*)[3])m->at, m->lobe);
        }
        d[i] = (v[0] - v[1]) / (2 * step);
    }
    *number = keep;
    return (double)(d[0] + (d[0] - d[1]) / 3);
}

/* Takes away the derivative in the length of the unit vector in rows at, at + 1, at + 2. */
static void turning(Answer *a, const double row[SLT_LOBE_ROWS], int at) {
    double along = 0;
    for (int k = 0; k < 3; k++) along += a->row[at + k] * row[at + k];
    for (int k = 0; k < 3; k++) a->row[at + k] -= along * row[at + k];
}

static void test_derivatives(void **state) {
    (void)state;
    LitScene *s = calloc(1, sizeof *s);
    Answer *a = calloc(1, sizeof *a), *other = calloc(1, sizeof *other), *f32 = calloc(1, sizeof *f32);
    Moved *moved = calloc(1, sizeof *moved);
    for (int which = 0; which < SCENES - 1; which++)
        for (int lobe = 0; lobe < 2; lobe++) {
            set_scene(s, which);
            Trimesh *m = make(s, true), *narrow = make(s, false);
            ask(m, s, lobe, LIGHT_SILHOUETTES, a), ask(m, s, lobe, LIGHT_TRIANGLES, other);
            ask(narrow, s, lobe, LIGHT_SILHOUETTES, f32);
            /* Of the lobe what turns n and view; the reference knows no other lengths. */
            for (int k = 0; k < 6 && lobe; k++)
                turning(k < 2 ? a : k < 4 ? other : f32, s->row, k & 1 ? SLT_LIGHT_VIEW : SLT_LIGHT_N);
            moved->s = s, moved->lobe = lobe;
            for (int k = 0; k < SLT_LOBE_ROWS; k++) moved->row[k] = s->row[k];
            for (uint32_t i = 0; i < 3 * s->nvertices; i++) moved->at[i / 3][i % 3] = s->at[i / 3][i % 3];
            double most = 0, off[3] = {0};
            for (uint32_t k = 0; k < SLT_LOBE_ROWS + 3 * s->nvertices; k++) {
                if (k >= SLT_LIGHT_ROWS && k < SLT_LOBE_ROWS && !lobe) continue;
                const Answer *of[3] = {a, other, f32};
                const uint32_t i = k - SLT_LOBE_ROWS;
                const bool row = k < SLT_LOBE_ROWS;
                const double want = difference(moved, row ? &moved->row[k] : &moved->at[i / 3][i % 3]);
                most = fmax(most, fabs(want));
                for (int n = 0; n < 3; n++)
                    off[n] = fmax(off[n], fabs((row ? of[n]->row[k] : of[n]->vertex[i / 3][i % 3]) - want));
            }
            print_message("scene %d, %s: %.1e %.1e, f32 %.1e, of %g\n", which, lobe ? "ltc" : "irradiance",
                          off[0] / most, off[1] / most, off[2] / most, most);
            assert_true(most > 0.01);
            assert_true(off[0] <= 1e-8 * most);
            assert_true(off[1] <= 1e-8 * most);
            assert_true(off[2] <= 1e-4 * most);
            geometry_free(&m->base.shared), geometry_free(&narrow->base.shared);
        }
    free(s), free(a), free(other), free(f32), free(moved);
}

/* Moved together nothing changes. */
static void test_together(void **state) {
    (void)state;
    LitScene *s = calloc(1, sizeof *s);
    Answer *a = calloc(1, sizeof *a);
    for (int which = 0; which < SCENES; which++)
        for (int lobe = 0; lobe < 2; lobe++) {
            set_scene(s, which);
            Trimesh *m = make(s, true);
            ask(m, s, lobe, LIGHT_SILHOUETTES, a);
            for (int k = 0; k < 3; k++) {
                double sum = a->row[SLT_LIGHT_P + k] + a->row[SLT_LIGHT_CORNER + k];
                for (uint32_t i = 0; i < s->nvertices; i++) sum += a->vertex[i][k];
                assert_float_equal(sum, 0, 1e-11);
            }
            geometry_free(&m->base.shared);
        }
    free(s), free(a);
}

/* A call padded with copies of a sample asks once: lanes with the question of the lane before have its answer. */
static void test_copies(void **state) {
    (void)state;
    enum { WIDTH = 8 };
    LitScene *s = calloc(1, sizeof *s);
    Answer *a = calloc(1, sizeof *a);
    double rays[SLT_LOBE_ROWS][WIDTH];
    int32_t unit[WIDTH];
    for (int lobe = 0; lobe < 2; lobe++) {
        set_scene(s, 1);
        Trimesh *m = make(s, true);
        const SltGeometry *g = &m->base.shared;
        ask(m, s, lobe, LIGHT_BY_COUNTS, a);
        for (uint32_t r = 0; r < SLT_LOBE_ROWS; r++)
            for (uint32_t k = 0; k < WIDTH; k++) rays[r][k] = s->row[r] + (r == 0 && k >= 4 ? 0.01 : 0);
        pieces_begin();
        g->query[lobe ? SLT_QUERY_LTC : SLT_QUERY_IRRADIANCE](g, s->at, rays, 0xee, WIDTH, unit);
        assert_int_equal(unit[0], 0);
        assert_int_equal(unit[4], 0);
        for (uint32_t k = 1; k < WIDTH; k++)
            if (k != 4) assert_int_equal(unit[k], unit[k < 4 ? 1 : 5]);
        assert_int_not_equal(unit[1], unit[5]);
        assert_true(told(true, unit[1], SLT_LIGHT_VALUE) == a->value);
        assert_true(told(true, unit[5], SLT_LIGHT_VALUE) != a->value);
        geometry_free(&m->base.shared);
    }
    free(s), free(a);
}

/* What one query found serves the other of the same receiver, to the bit, and no longer than until the next vector of
 * samples begins. */
static void test_both(void **state) {
    (void)state;
    LitScene *s = calloc(1, sizeof *s);
    Answer *alone = calloc(2, sizeof *alone);
    int32_t unit[2][2];
    for (int which = 0; which < SCENES; which++)
        for (int way = LIGHT_SILHOUETTES; way <= LIGHT_TRIANGLES; way++) {
            set_scene(s, which);
            Trimesh *m = make(s, true);
            LightScene scene = {.tree = {.bvh = &m->bvh},
                                .adjacency = &m->adjacency,
                                .search = m->rays->by[true],
                                .beam = m->beam,
                                .cross = m->cross,
                                .cones = &m->cones,
                                .values = s->at,
                                .way = (LightWay)way,
                                .both = true};
            for (int lobe = 0; lobe < 2; lobe++) ask(m, s, lobe, (LightWay)way, &alone[lobe]);
            for (int first = 0; first < 2; first++) {
                pieces_begin();
                for (int k = 0; k < 2; k++) {
                    const int lobe = first ^ k;
                    assert_true(light_find(&scene, lobe ? SLT_QUERY_LTC : SLT_QUERY_IRRADIANCE, s->row, 1, 1,
                                           &unit[first][lobe]));
                    assert_true(told(true, unit[first][lobe], SLT_LIGHT_VALUE) == alone[lobe].value);
                    for (uint32_t r = 0; r < SLT_LIGHT_ROWS; r++)
                        assert_true(told(true, unit[first][lobe], SLT_LIGHT_SLOPES + r) == alone[lobe].row[r]);
                }
            }
            const double was = alone[0].value;
            for (uint32_t i = 0; i < s->nvertices; i++)
                s->at[i][0] += 0.02; /* boxes stay: they are wide enough for that */
            scene.tree.slack = 0.05, scene.tree.moved = s->at;
            pieces_begin();
            assert_true(light_find(&scene, SLT_QUERY_IRRADIANCE, s->row, 1, 1, &unit[0][0]));
            assert_true(told(true, unit[0][0], SLT_LIGHT_VALUE) != was);
            geometry_free(&m->base.shared);
        }
    free(s), free(alone);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_unoccluded),   cmocka_unit_test(test_horizon),    cmocka_unit_test(test_half_hidden),
        cmocka_unit_test(test_at_the_light), cmocka_unit_test(test_degenerate), cmocka_unit_test(test_on_the_mesh),
        cmocka_unit_test(test_values),       cmocka_unit_test(test_grids),      cmocka_unit_test(test_derivatives),
        cmocka_unit_test(test_together),     cmocka_unit_test(test_copies),     cmocka_unit_test(test_both),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
