/* Counts of what is wrong with a mesh, against every vertex held against every edge, and against every pair of faces.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

#include "runtime/mesh/mesh.h"

enum { MOST = 400 };

typedef struct Soup {
    uint32_t nvertices, nfaces;
    double at[MOST][3];
    int32_t face[MOST][3], part[MOST];
} Soup;

static uint32_t below(uint64_t *state, uint32_t n) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)((*state >> 33) % n);
}

/* Corners on a coarse grid, so that much coincides; stretched, so that edges differ in length. */
static void fill(Soup *s, uint32_t nvertices, uint32_t nfaces, uint32_t side, uint64_t *state) {
    s->nvertices = nvertices, s->nfaces = nfaces;
    for (uint32_t v = 0; v < nvertices;) {
        bool fresh = true;
        for (int a = 0; a < 3; a++) s->at[v][a] = 0.1 * below(state, side) * (a == 0 ? 40 : a == 1 ? 1 : 0.03);
        for (uint32_t u = 0; u < v; u++) fresh &= memcmp(s->at[u], s->at[v], sizeof s->at[v]) != 0;
        v += fresh; /* as welding leaves them */
    }
    for (uint32_t f = 0; f < nfaces; f++)
        for (int k = 0; k < 3; k++) s->face[f][k] = (int32_t)below(state, nvertices);
}

static bool has(const int32_t f[3], int32_t v) { return f[0] == v || f[1] == v || f[2] == v; }

static bool same_corners(const int32_t a[3], const int32_t b[3]) {
    return has(a, b[0]) && has(a, b[1]) && has(a, b[2]) && has(b, a[0]) && has(b, a[1]) && has(b, a[2]);
}

/* As the header defines them, pair by pair. */
static MeshCounts count_all(const Soup *s) {
    MeshCounts c = {.vertices = s->nvertices, .triangles = s->nfaces, .parts = 1};
    double lo[3] = {1e9, 1e9, 1e9}, hi[3] = {-1e9, -1e9, -1e9}, near = 0;
    bool used[MOST] = {false}, on[MOST] = {false};
    for (uint32_t f = 0; f < s->nfaces; f++)
        for (int k = 0; k < 3; k++) {
            used[s->face[f][k]] = true;
            for (int a = 0; a < 3; a++)
                lo[a] = fmin(lo[a], s->at[s->face[f][k]][a]), hi[a] = fmax(hi[a], s->at[s->face[f][k]][a]);
        }
    for (int a = 0; a < 3; a++) near += (hi[a] - lo[a]) * (hi[a] - lo[a]);
    near = 1e-6 * sqrt(near);
    for (uint32_t f = 0; f < s->nfaces; f++) {
        const int32_t *of = s->face[f];
        bool earlier = false, three = of[0] != of[1] && of[1] != of[2] && of[2] != of[0];
        for (uint32_t g = 0; g < f; g++) earlier |= three && same_corners(of, s->face[g]);
        c.duplicates += earlier;
        for (int k = 0; k < 3; k++) {
            int32_t a = s->face[f][k], b = s->face[f][(k + 1) % 3];
            const double *p = s->at[a], *q = s->at[b];
            double length = 0;
            for (int i = 0; i < 3; i++) length += (q[i] - p[i]) * (q[i] - p[i]);
            for (uint32_t v = 0; v < s->nvertices && three; v++) {
                bool own = !used[v] || (int32_t)v == a || (int32_t)v == b;
                for (uint32_t g = 0; g < s->nfaces && !own; g++) /* a corner of a face at this edge */
                    for (int e = 0; e < 3; e++) {
                        int32_t x = s->face[g][e], y = s->face[g][(e + 1) % 3];
                        own |= ((x == a && y == b) || (x == b && y == a)) && s->face[g][(e + 2) % 3] == (int32_t)v;
                    }
                double along = 0, off = 0;
                for (int i = 0; i < 3; i++) along += (s->at[v][i] - p[i]) * (q[i] - p[i]) / length;
                for (int i = 0; i < 3; i++) off += pow(s->at[v][i] - p[i] - along * (q[i] - p[i]), 2);
                double margin = near / sqrt(length);
                on[v] |= !own && along > margin && along < 1 - margin && off <= near * near;
            }
        }
    }
    for (uint32_t v = 0; v < s->nvertices; v++) c.on_edges += on[v], c.lone += !used[v];
    return c;
}

static void soups(void **state) {
    (void)state;
    uint64_t seed = 5;
    uint32_t found = 0, doubled = 0;
    for (int round = 0; round < 200; round++) {
        static Soup s;
        MeshCounts got;
        memset(&s, 0, sizeof s);
        uint32_t side = 2 + below(&seed, 5), room = side * side * side;
        fill(&s, room < 60 ? room / 2 + 2 : 60, 1 + below(&seed, 60), side, &seed);
        assert_true(mesh_inspect(&s.at[0][0], s.nvertices, &s.face[0][0], s.part, s.nfaces, &got));
        MeshCounts want = count_all(&s);
        assert_int_equal(got.on_edges, want.on_edges);
        assert_int_equal(got.duplicates, want.duplicates);
        assert_int_equal(got.lone, want.lone);
        found += got.on_edges, doubled += got.duplicates;
    }
    assert_true(found > 100 && doubled > 10);
}

static void closed_and_open(void **state) {
    (void)state;
    static const double at[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    static const int32_t face[5][3] = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}, {1, 1, 2}},
                         part[5] = {0, 0, 0, 1, 1};
    MeshCounts c;
    assert_true(mesh_inspect(&at[0][0], 4, &face[0][0], part, 4, &c));
    assert_int_equal(c.edges, 6);
    assert_int_equal(c.parts, 2);
    assert_int_equal(c.open_edges + c.nonmanifold_edges + c.duplicates + c.degenerate + c.on_edges + c.lone, 0);
    assert_true(mesh_inspect(&at[0][0], 4, &face[0][0], part, 3, &c));
    assert_int_equal(c.open_edges, 3);
    assert_true(mesh_inspect(&at[0][0], 4, &face[0][0], part, 5, &c));
    assert_int_equal(c.degenerate, 1);
    assert_int_equal(c.nonmanifold_edges, 0);
}

/* What has no size, or far too much, is counted all the same. */
static void extremes(void **state) {
    (void)state;
    static const double at[3][4][3] = {{{0}},
                                       {{1e300, 0, 0}, {-1e300, 0, 0}, {0, 1e300, 0}, {0, 0, 1e300}},
                                       {{0, 0, 0}, {1e-300, 0, 0}, {0, 1e-300, 0}, {1, 1, 1}}};
    static const int32_t face[2][3] = {{0, 1, 2}, {0, 2, 3}}, part[2] = {0};
    for (int k = 0; k < 3; k++) {
        MeshCounts c;
        assert_true(mesh_inspect(&at[k][0][0], 4, &face[0][0], part, 2, &c));
        assert_int_equal(c.edges, 5);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(soups), cmocka_unit_test(closed_and_open),
                                       cmocka_unit_test(extremes)};
    return cmocka_run_group_tests_name("mesh.inspect", tests, NULL, NULL);
}
