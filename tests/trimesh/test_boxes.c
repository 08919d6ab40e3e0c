/* Boxes of rays: what is said of all rays of a box holds for each that is tried, and is said often enough; and so do
 * the lines that part them. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

#include "runtime/geometry/mesh/trimesh.h"
#include "saltus/mesh.h"

enum { MAX_VERTICES = 4000, MAX_FACES = 6000, BOXES = 20000, TRIED = 24 };

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
    const double p[3] = {x, y, z};
    for (int a = 0; a < 3; a++) s->at[s->nvertices][a] = s->f32[s->nvertices][a] = (float)p[a];
    return s->nvertices++;
}

static void add_face(Surface *s, int32_t a, int32_t b, int32_t c) {
    memcpy(s->face[s->nfaces++], (int32_t[]){a, b, c}, sizeof s->face[0]);
}

/* n x n squares, bent, every third wound the other way, one in `holes` missing. */
static Surface *sheet(int n, double bend, int holes) {
    Surface *s = calloc(1, sizeof *s);
    for (int i = 0; i <= n; i++)
        for (int j = 0; j <= n; j++) {
            double x = 2.0 * i / n - 1, y = 2.0 * j / n - 1;
            add_vertex(s, x, y, bend * sin(4 * x) * cos(5 * y));
        }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            int32_t a = i * (n + 1) + j, b = a + n + 1;
            if (holes && (i * n + j) % holes == 0) continue;
            add_face(s, a, b, b + 1);
            if ((i + j) % 3) add_face(s, a, b + 1, a + 1);
            else add_face(s, b + 1, a, a + 1);
        }
    return s;
}

static Surface *soup(int n, double size) {
    Surface *s = calloc(1, sizeof *s);
    uint64_t state = 5;
    for (int i = 0; i < n; i++) {
        double c[3];
        int32_t v[3];
        for (int a = 0; a < 3; a++) c[a] = 2 * uniform(&state) - 1;
        for (int k = 0; k < 3; k++) {
            double p[3];
            for (int a = 2; a >= 0; a--) p[a] = c[a] + size * (uniform(&state) - 0.5);
            v[k] = add_vertex(s, p[0], p[1], p[2]);
        }
        add_face(s, v[0], v[1], v[2]);
    }
    return s;
}

static void set(bool f64, void *rays, uint32_t row, double v) {
    if (f64) ((double *)rays)[row] = v;
    else ((float *)rays)[row] = (float)v;
}

static double get(bool f64, const void *rays, uint32_t row) {
    return f64 ? ((const double *)rays)[row] : (double)((const float *)rays)[row];
}

/* From around a point above to one of the mesh's vertices or anywhere, in boxes of all sizes, some without width. */
static void random_box(const Surface *s, bool f64, uint64_t *state, void *box) {
    double size = pow(2, -16 * uniform(state)), mid[SLT_RAY_POINT_ROWS];
    const double *aim = s->at[(int)(uniform(state) * s->nvertices)];
    for (uint32_t a = 0; a < 3; a++) {
        mid[a] = (a == 2 ? 3 : 0) + uniform(state) - 0.5;
        double to = uniform(state) < 0.3 ? aim[a] : (a < 2 ? 2.4 : 0.4) * (uniform(state) - 0.5);
        mid[3 + a] = to - mid[a];
    }
    mid[SLT_RAY_T0] = uniform(state) < 0.2 ? 0.9 : 0, mid[SLT_RAY_T1] = uniform(state) < 0.2 ? 1 : 100;
    for (uint32_t i = 0; i < SLT_RAY_POINT_ROWS; i++) {
        double half = uniform(state) < 0.3 ? 0 : 0.5 * size * uniform(state);
        if (i >= SLT_RAY_T0) half *= uniform(state) < 0.5 ? 0 : 0.1;
        set(f64, box, i, i == SLT_RAY_T0 ? fmax(0, mid[i] - half) : mid[i] - half);
        set(f64, box, i + SLT_RAY_ROWS, mid[i] + half);
    }
}

static int32_t trace_in(const SltGeometry *g, const void *values, bool f64, const void *box, uint64_t *state) {
    double ray[SLT_RAY_POINT_ROWS];
    int32_t found;
    for (uint32_t i = 0; i < SLT_RAY_POINT_ROWS; i++) {
        double lo = get(f64, box, i), hi = get(f64, box, i + SLT_RAY_ROWS), w = uniform(state);
        w = w < 0.25 ? 0 : w > 0.75 ? 1 : 2 * w - 0.5;
        set(f64, ray, i, fmin(fmax(lo + w * (hi - lo), lo), hi));
    }
    g->query[SLT_QUERY_TRACE](g, values, ray, 1, 1, &found);
    return found;
}

/* ---- lines */
static void corner(const Surface *s, bool f64, int32_t v, const double o[3], double out[3]) {
    for (int a = 0; a < 3; a++) out[a] = (f64 ? s->at[v][a] : (double)s->f32[v][a]) - o[a];
}

static void cross(const double a[3], const double b[3], double out[3]) {
    for (int i = 0; i < 3; i++) out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* g of a line as saltus/mesh.h has it; *size: of its terms. */
static double g_of(const Surface *s, bool f64, const int32_t line[2], const double ray[SLT_RAY_POINT_ROWS],
                   double *size) {
    double p[3][3], n[3], along[2][3];
    const double *o = ray, *d = ray + 3;
    bool edge = line[0] < line[1], end = !edge;
    for (int k = 0; k < 3; k++) corner(s, f64, end ? s->face[line[0]][k] : line[k < 1 ? 0 : 1], o, p[k]);
    for (int k = 0; k < 2; k++)
        for (int a = 0; a < 3; a++) along[k][a] = p[k + 1][a] - p[0][a];
    *size = 20 * sqrt(dot(d, d) * dot(p[0], p[0]) * dot(along[0], along[0]));
    cross(end ? along[0] : p[0], end ? along[1] : along[0], n);
    if (edge) return dot(d, n);
    double t = ray[line[1] == line[0] ? SLT_RAY_T0 : SLT_RAY_T1];
    *size += 20 * t * sqrt(dot(d, d) * dot(along[0], along[0]) * dot(along[1], along[1]));
    return t * dot(d, n) - dot(p[0], n);
}

/* Rays from one point: their lines are straight, and two that lie on one side of each of them meet something or do not
 * alike. Returns whether lines are named. */
static bool check_lines(const Surface *s, const SltGeometry *g, const void *values, bool f64, uint64_t *state) {
    double box[SLT_LINE_ROWS], g_last[TRIED][SLT_LINES];
    bool hit[TRIED];
    int32_t said, line[SLT_LINES][2];
    random_box(s, f64, state, box);
    for (uint32_t i = 0; i < SLT_RAY_POINT_ROWS; i++)
        if (i < 3 || i >= SLT_RAY_T0) set(f64, box, i + SLT_RAY_ROWS, get(f64, box, i));
    g->query[SLT_QUERY_BLOCKED](g, values, box, 1, 1, &said);
    if (said <= SLT_RAYS_EITHER || said > SLT_RAYS_EITHER + SLT_LINES) return false;
    uint32_t n = (uint32_t)(said - SLT_RAYS_EITHER);
    assert_true(n <= SLT_LINES);
    for (uint32_t k = 0; k < n; k++)
        for (uint32_t which = 0; which < 2; which++) {
            set(f64, box, SLT_LINE_WHICH, 2 * k + which);
            g->query[SLT_QUERY_LINE](g, values, box, 1, 1, &line[k][which]);
        }
    for (int i = 0; i < TRIED; i++) {
        double row[SLT_RAY_POINT_ROWS], ray[SLT_RAY_POINT_ROWS], size;
        int32_t found;
        for (uint32_t r = 0; r < SLT_RAY_POINT_ROWS; r++) {
            double lo = get(f64, box, r), hi = get(f64, box, r + SLT_RAY_ROWS);
            set(f64, row, r, fmin(fmax(lo + uniform(state) * (hi - lo), lo), hi));
            ray[r] = get(f64, row, r);
        }
        g->query[SLT_QUERY_TRACE](g, values, row, 1, 1, &found);
        hit[i] = found >= 0;
        for (uint32_t k = 0; k < n; k++) {
            double v = g_of(s, f64, line[k], ray, &size);
            g_last[i][k] = fabs(v) > size * (f64 ? 0x1p-46 : 0x1p-18) ? v : 0;
        }
    }
    for (int i = 0; i < TRIED; i++)
        for (int j = 0; j < i; j++) {
            bool alike = true;
            for (uint32_t k = 0; k < n; k++) alike &= g_last[i][k] * g_last[j][k] > 0;
            if (alike) assert_int_equal(hit[i], hit[j]);
        }
    return true;
}

static void check(Surface *s, double blocked, double free_) {
    for (int f64 = 0; f64 < 2; f64++) {
        const void *values = f64 ? (const void *)s->at : s->f32;
        SltGeometry *g;
        const GeometrySource from = {.kind = SLT_GEOMETRY_MESH,
                                     .f64 = f64,
                                     .nvertices = (uint32_t)s->nvertices,
                                     .nfaces = (uint32_t)s->nfaces,
                                     .faces = &s->face[0][0],
                                     .queries = 1u << SLT_QUERY_TRACE | 1u << SLT_QUERY_BLOCKED | 1u << SLT_QUERY_LINE};
        assert_int_equal(trimesh_make(&g, &from, values, TRIMESH_ISA_BEST, NULL), SLT_OK);
        uint64_t state = 17;
        uint32_t all = 0, none = 0;
        for (int i = 0; i < BOXES; i++) {
            double box[SLT_BOX_ROWS];
            int32_t said;
            random_box(s, f64, &state, box);
            g->query[SLT_QUERY_BLOCKED](g, values, box, 1, 1, &said);
            all += said == SLT_RAYS_BLOCKED, none += said == SLT_RAYS_FREE;
            if (said >= SLT_RAYS_EITHER) continue;
            for (int k = 0; k < TRIED; k++)
                assert_int_equal(trace_in(g, values, f64, box, &state) >= 0, said == SLT_RAYS_BLOCKED);
        }
        uint32_t lines = 0;
        for (int i = 0; i < BOXES; i++) lines += check_lines(s, g, values, f64, &state);
        print_message("%s: of all boxes %.3f are met, %.3f free; %.3f of those from a point have lines\n",
                      f64 ? "f64" : "f32", (double)all / BOXES, (double)none / BOXES, (double)lines / BOXES);
        assert_true((double)lines / BOXES >= 0.03);
        assert_true((double)all / BOXES >= blocked && (double)none / BOXES >= free_);
        geometry_free(g);
    }
    free(s);
}

static void test_flat(void **state) {
    (void)state;
    check(sheet(6, 0, 0), 0.3, 0.05);
}

static void test_bent(void **state) {
    (void)state;
    check(sheet(24, 0.3, 0), 0.2, 0.05);
}

static void test_holes(void **state) {
    (void)state;
    check(sheet(16, 0.1, 5), 0.1, 0.05);
}

static void test_soup(void **state) {
    (void)state;
    check(soup(200, 0.5), 0.05, 0.1);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_flat), cmocka_unit_test(test_bent),
                                       cmocka_unit_test(test_holes), cmocka_unit_test(test_soup)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
