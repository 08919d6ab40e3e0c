/* Cones of normals: below a child that is said to turn one side to a point all faces do, and none of their edges ends a
 * shadow. On every instruction set alike. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "light_answer.h"

typedef struct Seen {
    const LitScene *s;
    const Trimesh *m;
    double p[3], near, height; /* of the light's plane above z = 0 */
} Seen;

/* p's distance from the face's plane, above on the side from which it runs counter-clockwise. */
static double height_above(const Seen *of, int32_t face) {
    double at[3][3], way[2][3], n[3], sum = 0, square = 0;
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) at[k][a] = of->s->at[of->s->face[face][k]][a];
    for (int k = 0; k < 2; k++)
        for (int a = 0; a < 3; a++) way[k][a] = at[k + 1][a] - at[0][a];
    for (int a = 0; a < 3; a++) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;
        n[a] = way[0][b] * way[1][c] - way[0][c] * way[1][b];
        sum += n[a] * (of->p[a] - at[0][a]), square += n[a] * n[a];
    }
    return sum / sqrt(square);
}

static bool same_way(const LitScene *s, int32_t face, int k, int32_t half) {
    return s->face[face][k] == s->face[half / 3][half % 3];
}

/* side: 1 or -1, or 0 before the first face. How many faces. */
static uint32_t check_below(const Seen *of, int32_t child, int *side) {
    uint32_t n = 0;
    if (child >= 0) {
        for (int k = 0; k < BVH_WIDTH; k++)
            if (of->m->bvh.node[child].child[k]) n += check_below(of, of->m->bvh.node[child].child[k], side);
        return n;
    }
    for (int i = 0; i < BVH_LEAF; i++) {
        const int32_t face = ((const BvhLeaf64 *)of->m->bvh.leaf)[~child].triangle[i];
        if (face < 0) continue;
        n++;
        for (int k = -1; k < 3; k++) {
            const int32_t half = k < 0 ? 3 * face : of->m->adjacency.across[3 * face + k];
            assert_true(half >= 0);
            if (k >= 0) assert_false(same_way(of->s, face, k, half));
            const double h = height_above(of, half / 3);
            assert_true(fabs(h) > of->near);
            if (!*side) *side = h > 0 ? 1 : -1;
            assert_int_equal(h > 0 ? 1 : -1, *side);
        }
        for (int k = 0; k < 3; k++) assert_true(of->s->at[of->s->face[face][k]][2] < of->height);
    }
    return n;
}

enum { NODES = 512 };
static uint32_t check(LitScene *s, const double p[3], double near, double height) {
    uint32_t n = 0;
    uint32_t plain[NODES];
    for (TrimeshIsa isa = TRIMESH_ISA_PLAIN; isa < TRIMESH_ISAS; isa++) {
        Trimesh *m = make_for(s, true, isa);
        if (!m) continue;
        const Seen of = {.s = s, .m = m, .p = {p[0], p[1], p[2]}, .near = near, .height = height};
        const BeamSight sight = {.p = {p[0], p[1], p[2]},
                                 .near = near,
                                 .along = {0, 0, 1 / (height - p[2])},
                                 .beyond = height < 5 ? 1 : HUGE_VAL};
        assert_true(m->cones.n == m->bvh.nnodes && m->bvh.nnodes <= NODES);
        for (uint32_t i = 0; i < m->bvh.nnodes; i++) {
            const uint32_t alike = m->beam->alike(&m->bvh.node[i], &m->cones.node[i], &sight);
            if (isa == TRIMESH_ISA_PLAIN) plain[i] = alike;
            assert_int_equal(alike, plain[i]);
            for (uint32_t k = 0; k < BVH_WIDTH && isa == TRIMESH_ISA_PLAIN; k++) {
                int side = 0;
                if (!(alike >> k & 1)) continue;
                assert_true(m->bvh.node[i].child[k] != 0);
                n += check_below(&of, m->bvh.node[i].child[k], &side);
            }
        }
        geometry_free(&m->base.shared);
    }
    return n;
}

static void test_alike(void **state) {
    (void)state;
    LitScene *s = calloc(1, sizeof *s);
    uint64_t seed = 4;
    uint32_t found[4] = {0}, faces = 0;
    for (int n = 0; n < 240; n++) {
        double p[3];
        for (int a = 0; a < 3; a++) p[a] = 6 * lit_uniform(&seed) - 3;
        memset(s, 0, sizeof *s);
        lit_blob(s, (double[3]){0, 0, 0}, 1, 19, 30, n % 2 ? 0.02 : 0);
        faces = s->nfaces;
        switch (n % 4) {
        case 0: break;
        case 1: p[2] = -3, found[1] += check(s, p, 1e-3, 0.5); continue;
        case 2: /* one half runs the other way: its rim is where shadows end */
            for (uint32_t f = 0; f < s->nfaces / 2; f++) {
                const int32_t v = s->face[f][0];
                s->face[f][0] = s->face[f][1], s->face[f][1] = v;
            }
            break;
        case 3: /* without a part, with a broken vertex and a collapsed face */
            s->nfaces -= 40;
            s->at[s->face[100][0]][1] = NAN;
            memcpy(s->at[s->face[300][0]], s->at[s->face[300][1]], sizeof s->at[0]);
            break;
        }
        found[n % 4] += check(s, p, n % 8 < 4 ? 0 : 0.05, 10);
    }
    /* Most of a finely cut ball. */
    for (int k = 0; k < 4; k++) assert_true(found[k] > (k == 1 ? 10 : 20) * faces);
    free(s);
}

/* After vertices have moved. */
static void test_follow(void **state) {
    (void)state;
    LitScene *s = calloc(1, sizeof *s);
    lit_blob(s, (double[3]){0, 0, 0}, 1, 19, 30, 0);
    Trimesh *m = make(s, true);
    uint64_t seed = 6;
    for (uint32_t i = 0; i < s->nvertices; i++)
        for (int a = 0; a < 3; a++) s->at[i][a] = 2 * s->at[i][a] + 0.02 * lit_uniform(&seed);
    geometry_changed(&m->base.shared, 0, 1), geometry_follow(&m->base.shared, s->at);
    Trimesh *fresh = make(s, true);
    if (m->bvh.cost == fresh->bvh.cost)
        assert_memory_equal(m->cones.node, fresh->cones.node, m->cones.n * sizeof *m->cones.node);
    const BeamSight sight = {.p = {4, 1, 0}, .beyond = HUGE_VAL};
    const Seen of = {.s = s, .m = m, .p = {4, 1, 0}, .height = 10};
    uint32_t n = 0;
    for (uint32_t i = 0; i < m->bvh.nnodes; i++)
        for (uint32_t alike = m->beam->alike(&m->bvh.node[i], &m->cones.node[i], &sight); alike; alike &= alike - 1) {
            int side = 0;
            n += check_below(&of, m->bvh.node[i].child[__builtin_ctz(alike)], &side);
        }
    assert_true(n > s->nfaces / 4);
    geometry_free(&m->base.shared), geometry_free(&fresh->base.shared);
    free(s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_alike),
        cmocka_unit_test(test_follow),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
