/* Neighbours across edges and edges at vertices, against a search through all faces. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "runtime/geometry/mesh/adjacency.h"

enum { VERTICES = 14, FACES = 40 };

static int32_t from(const int32_t *face, uint32_t h) { return face[h]; }
static int32_t to(const int32_t *face, uint32_t h) { return face[h - h % 3 + (h + 1) % 3]; }

static bool same_edge(const int32_t *face, uint32_t g, uint32_t h) {
    return (from(face, g) == from(face, h) && to(face, g) == to(face, h)) ||
           (from(face, g) == to(face, h) && to(face, g) == from(face, h));
}

/* Two of its corners are one vertex: no face to others. */
static bool is_none(const int32_t *face, uint32_t h) {
    const int32_t *corner = face + (h - h % 3);
    return corner[0] == corner[1] || corner[1] == corner[2] || corner[2] == corner[0];
}

static int32_t searched(const int32_t *face, uint32_t nfaces, uint32_t h) {
    int32_t found = ADJACENCY_BORDER;
    if (is_none(face, h)) return ADJACENCY_MANY;
    for (uint32_t g = 0; g < 3 * nfaces; g++)
        if (g != h && !is_none(face, g) && same_edge(face, g, h))
            found = found == ADJACENCY_BORDER ? (int32_t)g : ADJACENCY_MANY;
    return found;
}

static bool is_edge(const int32_t *face, uint32_t nfaces, int32_t a, int32_t b) {
    for (uint32_t h = 0; h < 3 * nfaces; h++)
        if (!is_none(face, h) && ((from(face, h) == a && to(face, h) == b) || (from(face, h) == b && to(face, h) == a)))
            return true;
    return false;
}

static void assert_adjacency(const int32_t *face, uint32_t nfaces, uint32_t nvertices) {
    Adjacency a;
    assert_true(adjacency_make(&a, face, nfaces, nvertices));
    for (uint32_t h = 0; h < 3 * nfaces; h++) assert_int_equal(a.across[h], searched(face, nfaces, h));
    for (int32_t v = 0; v < (int32_t)nvertices; v++) {
        uint32_t at = a.first[v];
        for (int32_t w = 0; w < (int32_t)nvertices; w++) {
            if (!is_edge(face, nfaces, v, w)) continue;
            assert_true(at < a.first[v + 1]);
            assert_int_equal(a.end[at++], w);
        }
        assert_int_equal(at, a.first[v + 1]);
    }
    assert_true(adjacency_bytes(&a) >= 3 * nfaces * sizeof *a.across);
    adjacency_free(&a);
    assert_int_equal(adjacency_bytes(&a), 0);
}

static void test_tetrahedron(void **state) {
    (void)state;
    static const int32_t face[] = {0, 1, 2, 0, 3, 1, 1, 3, 2, 2, 3, 0};
    Adjacency a;
    assert_true(adjacency_make(&a, face, 4, 4));
    for (uint32_t h = 0; h < 12; h++) assert_int_equal(a.across[a.across[h]], h);
    adjacency_free(&a);
    assert_adjacency(face, 4, 4);
}

/* Borders, edges of many faces, faces twice, faces with a corner twice. */
static void test_any_faces(void **state) {
    (void)state;
    uint32_t random = 1;
    for (int round = 0; round < 200; round++) {
        int32_t face[3 * FACES];
        for (int k = 0; k < 3 * FACES; k++) {
            random = random * 1664525 + 1013904223;
            face[k] = (int32_t)((random >> 16) % VERTICES);
        }
        assert_adjacency(face, (uint32_t)round % (FACES + 1), VERTICES);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_tetrahedron), cmocka_unit_test(test_any_faces)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
