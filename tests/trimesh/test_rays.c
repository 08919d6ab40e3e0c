/* Rays against meshes: nothing leaks at edges and vertices, all instruction sets have the same bits, trees decide how
 * long a search takes and nothing else. */
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

enum { MAX_VERTICES = 12000, MAX_FACES = 22000 };

typedef struct Surface {
    uint32_t nvertices, nfaces;
    double at[MAX_VERTICES][3];
    int32_t face[MAX_FACES][3];
    float f32[MAX_VERTICES][3];
} Surface;

static double uniform(uint64_t *state) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 11) * 0x1p-53;
}

static void round_all(Surface *s) {
    for (uint32_t i = 0; i < s->nvertices; i++)
        for (int a = 0; a < 3; a++) s->f32[i][a] = (float)s->at[i][a];
}

/* A closed surface around the origin: rings x columns points between two poles, dented by `rough`. */
static Surface *blob(uint32_t rings, uint32_t columns, double rough) {
    Surface *s = calloc(1, sizeof *s);
    uint64_t state = 7;
    for (uint32_t i = 0; i <= rings + 1; i++)
        for (uint32_t j = 0; j < (i == 0 || i == rings + 1 ? 1 : columns); j++) {
            double u = M_PI * i / (rings + 1), v = 2 * M_PI * (j + 0.37) / columns, r = 1 + rough * uniform(&state);
            double *p = s->at[s->nvertices++];
            p[0] = r * sin(u) * cos(v), p[1] = r * sin(u) * sin(v), p[2] = r * cos(u);
        }
    for (uint32_t i = 0; i <= rings; i++)
        for (uint32_t j = 0; j < columns; j++) {
            uint32_t k = (j + 1) % columns, above = 1 + (i - 1) * columns, below = 1 + i * columns;
            int32_t a = (int32_t)(i ? above + j : 0), b = (int32_t)(i < rings ? below + j : s->nvertices - 1),
                    c = (int32_t)(i < rings ? below + k : s->nvertices - 1), d = (int32_t)(i ? above + k : 0);
            if (b != c) memcpy(s->face[s->nfaces++], (int32_t[]){a, b, c}, sizeof s->face[0]);
            if (a != d) memcpy(s->face[s->nfaces++], (int32_t[]){a, c, d}, sizeof s->face[0]);
        }
    round_all(s);
    return s;
}

/* Large triangles anywhere: rays pass most boxes, each its own. */
static Surface *heap(uint32_t nfaces) {
    Surface *s = calloc(1, sizeof *s);
    uint64_t state = 13;
    s->nfaces = nfaces, s->nvertices = 3 * nfaces;
    for (uint32_t i = 0; i < s->nvertices; i++) {
        for (int a = 0; a < 3; a++) s->at[i][a] = 2 * uniform(&state) - 1;
        s->face[i / 3][i % 3] = (int32_t)i;
    }
    round_all(s);
    return s;
}

static SltGeometry *made(const Surface *s, bool f64, TrimeshIsa isa) {
    SltGeometry *g;
    SltError err;
    const GeometrySource from = {.kind = SLT_GEOMETRY_MESH,
                                 .f64 = f64,
                                 .nvertices = s->nvertices,
                                 .nfaces = s->nfaces,
                                 .faces = &s->face[0][0],
                                 .queries = 1u << SLT_QUERY_TRACE | 1u << SLT_QUERY_OCCLUDED};
    SltStatus status = trimesh_make(&g, &from, f64 ? (const void *)s->at : s->f32, isa, &err);
    if (status == SLT_USAGE) return NULL; /* not on this machine */
    assert_int_equal(status, SLT_OK);
    return g;
}

static int32_t shoot(const SltGeometry *g, const Surface *s, bool f64, SltQuery what, const double ray[8]) {
    float narrow[8];
    int32_t id;
    for (int k = 0; k < 8; k++) narrow[k] = (float)ray[k];
    g->query[what](g, f64 ? (const void *)s->at : s->f32, f64 ? (const void *)ray : narrow, 1, 1, &id);
    return id;
}

/* From a point near the origin to a vertex or a point of an edge of a face, or what floats make of it. */
static void aim(const Surface *s, bool f64, uint32_t face, const double from[3], uint64_t *state, double ray[8]) {
    const int32_t *v = s->face[face % s->nfaces];
    int k = (int)(uniform(state) * 3), kind = (int)(uniform(state) * 20);
    double w = kind % 4 == 0 ? 0 : kind % 4 == 1 ? 0.5 : uniform(state);
    for (int a = 0; a < 3; a++) {
        double p = f64 ? s->at[v[k]][a] : (double)s->f32[v[k]][a],
               q = f64 ? s->at[v[(k + 1) % 3]][a] : (double)s->f32[v[(k + 1) % 3]][a];
        ray[a] = from[a];
        ray[3 + a] = p + w * (q - p) - ray[a];
        if (kind % 5 == 0) ray[3 + a] *= 1e-3;
    }
    ray[6] = 0, ray[7] = 1e9;
}

enum { BLOCK = 64 };
static uint32_t leak_blocks = 5000; /* a surface and precision; the first argument in rays */

/* In calls of 64 rays from one point to faces beside each other, from one point to any, from points of their own, and
 * alone. */
static uint32_t leaks_of(const Surface *s, bool f64, uint64_t seed) {
    SltGeometry *g = made(s, f64, TRIMESH_ISA_BEST);
    const void *values = f64 ? (const void *)s->at : s->f32;
    uint32_t leaks = 0;
    for (uint32_t i = 0; i < leak_blocks; i++) {
        double wide[8][BLOCK], from[3] = {0}, ray[8];
        float narrow[8][BLOCK];
        int32_t id[BLOCK];
        const uint32_t first = (uint32_t)(uniform(&seed) * s->nfaces);
        for (uint32_t k = 0; k < BLOCK; k++) {
            for (int a = 0; a < 3 && i % 3 && (i % 4 == 2 || !k); a++) from[a] = 0.2 * (uniform(&seed) - 0.5);
            aim(s, f64, i % 4 == 0 ? first + k / 4 : (uint32_t)(uniform(&seed) * s->nfaces), from, &seed, ray);
            for (int c = 0; c < 8; c++) wide[c][k] = ray[c], narrow[c][k] = (float)ray[c];
            if (i % 4 != 3) continue;
            leaks += shoot(g, s, f64, SLT_QUERY_TRACE, ray) < 0;
            leaks += shoot(g, s, f64, SLT_QUERY_OCCLUDED, ray) < 0;
        }
        for (int any = 0; any < 2 && i % 4 != 3; any++) {
            g->query[any ? SLT_QUERY_OCCLUDED : SLT_QUERY_TRACE](g, values, f64 ? (const void *)wide : narrow,
                                                                 ~(uint64_t)0, BLOCK, id);
            for (uint32_t k = 0; k < BLOCK; k++) leaks += id[k] < 0;
        }
    }
    geometry_free(g);
    return leaks;
}

static void test_watertight(void **state) {
    (void)state;
    Surface *shapes[] = {blob(30, 60, 0), blob(50, 100, 0.1), blob(1, 3, 0)};
    for (int f64 = 0; f64 < 2; f64++)
        for (size_t n = 0; n < 3; n++) assert_int_equal(leaks_of(shapes[n], f64, 99 + n), 0);
    for (size_t n = 0; n < 3; n++) free(shapes[n]);
}

/* A ray through the soup, some of them along axes and through vertices. */
static void any_ray(const Surface *s, uint32_t i, uint64_t *state, double ray[8]) {
    for (int a = 0; a < 3; a++) {
        ray[a] = 4 * uniform(state) - 2;
        ray[3 + a] = i % 7 == 0 ? (a == (int)(i / 7 % 3) ? -1 : 0) : uniform(state) - 0.5;
        if (i % 11 == 0) ray[3 + a] = s->at[i % s->nvertices][a] - ray[a];
    }
    ray[6] = i % 13 ? 0 : -3, ray[7] = i % 17 ? 1e30 : 1;
}

static void test_same_everywhere(void **state) {
    (void)state;
    Surface *s = blob(20, 40, 1.5), *turned = calloc(1, sizeof *turned);
    s->at[5][0] = NAN, s->at[9][1] = HUGE_VAL;     /* these triangles are never met */
    memcpy(s->at[20], s->at[21], sizeof s->at[0]); /* these are edges */
    round_all(s);
    *turned = *s;
    for (uint32_t i = 0; i < s->nfaces; i++) memcpy(turned->face[s->nfaces - 1 - i], s->face[i], sizeof s->face[0]);
    for (int f64 = 0; f64 < 2; f64++) {
        SltGeometry *best = made(s, f64, TRIMESH_ISA_BEST), *back = made(turned, f64, TRIMESH_ISA_PLAIN);
        uint32_t hits = 0;
        for (TrimeshIsa isa = TRIMESH_ISA_PLAIN; isa < TRIMESH_ISAS; isa++) {
            SltGeometry *g = made(s, f64, isa);
            uint64_t seed = 3;
            for (uint32_t i = 0; g && i < 20000; i++) {
                double ray[8];
                any_ray(s, i, &seed, ray);
                int32_t id = shoot(best, s, f64, SLT_QUERY_TRACE, ray);
                assert_int_equal(shoot(g, s, f64, SLT_QUERY_TRACE, ray), id);
                assert_true((shoot(g, s, f64, SLT_QUERY_OCCLUDED, ray) >= 0) == (id >= 0));
                hits += id >= 0;
                if (isa != TRIMESH_ISA_PLAIN) continue;
                int32_t other = shoot(back, turned, f64, SLT_QUERY_TRACE, ray);
                if (i % 11) assert_int_equal(other < 0 ? other : (int32_t)s->nfaces - 1 - other, id);
                else assert_true((other < 0) == (id < 0)); /* through a vertex: triangles that share it are as near */
            }
            geometry_free(g);
        }
        assert_true(hits > 10000);
        geometry_free(best), geometry_free(back);
    }
    free(s), free(turned);
}

/* A call's rays: from one camera, from points near each other, of one direction from far apart, or any; or some of
 * each.
 */
static void fill(const Surface *s, uint32_t i, uint32_t width, uint64_t *state, double (*ray)[8]) {
    const double narrow = pow(10, -3 * uniform(state));
    double from[3], to[3];
    for (int a = 0; a < 3; a++) from[a] = 6 * uniform(state) - 3, to[a] = 2 * uniform(state) - 1 - from[a];
    if (i % 9 == 0) memcpy(to, (const double[]){0, 0, i % 2 ? 5 : -5}, sizeof to);
    for (uint32_t k = 0; k < width; k++) {
        const uint32_t kind = i % 5 < 4 ? i % 5 : (uint32_t)(4 * uniform(state));
        for (int a = 0; a < 3; a++) {
            const double o = kind == 1 || kind == 2 ? narrow * (uniform(state) - 0.5) : 0,
                         d = kind == 0 || kind == 1 ? narrow * (uniform(state) - 0.5) : 0;
            ray[k][a] = from[a] + o, ray[k][3 + a] = to[a] + (i % 9 || k % 3 ? d : 0);
        }
        ray[k][6] = i % 7 ? 0 : 0.5 * uniform(state), ray[k][7] = i % 4 ? 1e9 : 2 * uniform(state);
        if (kind == 3) any_ray(s, i + k, state, ray[k]);
    }
}

/* A call's rays find what each finds alone. */
static void ask_together(const Surface *s, uint32_t calls) {
    enum { WIDEST = 64 };
    static const uint32_t widths[] = {1, 4, 7, 8, 16, 32, 33, WIDEST};
    for (int f64 = 0; f64 < 2; f64++) {
        SltGeometry *alone = made(s, f64, TRIMESH_ISA_PLAIN);
        for (TrimeshIsa isa = TRIMESH_ISA_PLAIN; isa < TRIMESH_ISAS; isa++) {
            SltGeometry *g = made(s, f64, isa);
            uint64_t seed = 11;
            uint32_t hits = 0, rays = 0;
            for (uint32_t i = 0; g && i < calls; i++) {
                const uint32_t width = widths[i % 8];
                double ray[WIDEST][8], wide[8 * WIDEST];
                float narrow[8 * WIDEST];
                int32_t id[WIDEST], any[WIDEST];
                fill(s, i, width, &seed, ray);
                uint64_t mask = i % 3 ? ~(uint64_t)0 : (uint64_t)(uniform(&seed) * 0x1p32) * 0x9e3779b97f4a7c15u;
                for (uint32_t k = 0; k < width; k++)
                    for (uint32_t c = 0; c < 8; c++)
                        wide[c * width + k] = ray[k][c], narrow[c * width + k] = (float)ray[k][c];
                const void *values = f64 ? (const void *)s->at : s->f32, *all = f64 ? (const void *)wide : narrow;
                g->query[SLT_QUERY_TRACE](g, values, all, mask, width, id);
                g->query[SLT_QUERY_OCCLUDED](g, values, all, mask, width, any);
                for (uint32_t k = 0; k < width; k++) {
                    const bool on = mask >> k & 1;
                    assert_int_equal(id[k], on ? shoot(alone, s, f64, SLT_QUERY_TRACE, ray[k]) : SLT_WITNESS_NONE);
                    assert_int_equal(any[k], id[k] < 0 ? SLT_WITNESS_NONE : 0);
                    hits += id[k] >= 0, rays += on;
                }
            }
            if (g) assert_true(hits > rays / 4 && hits < rays);
            geometry_free(g);
        }
        geometry_free(alone);
    }
}

static void test_together(void **state) {
    (void)state;
    Surface *s = blob(20, 40, 1.5), *h = heap(2000);
    s->at[5][0] = NAN;
    round_all(s);
    ask_together(s, 3000);
    ask_together(h, 300);
    free(s), free(h);
}

static void test_moves(void **state) {
    (void)state;
    Surface *s = blob(20, 40, 0.3), *now = malloc(sizeof *now);
    for (int f64 = 0; f64 < 2; f64++) {
        SltGeometry *g = made(s, f64, TRIMESH_ISA_BEST);
        uint64_t seed = 5;
        for (int step = 0; step < 6; step++) {
            *now = *s;
            for (uint32_t i = 0; i < s->nvertices; i++)
                for (int a = 0; a < 3; a++)
                    now->at[i][a] = s->at[i][a] * (1 + 0.4 * step) + 0.3 * step * (uniform(&seed) - 0.5);
            round_all(now);
            const void *before = f64 ? (const void *)s->at : s->f32, *after = f64 ? (const void *)now->at : now->f32;
            SltGeometry moved = geometry_moved(g, before, after), *fresh = made(now, f64, TRIMESH_ISA_BEST);
            for (uint32_t i = 0; i < 3000; i++) {
                double ray[8];
                any_ray(s, i, &seed, ray);
                assert_int_equal(shoot(&moved, now, f64, SLT_QUERY_TRACE, ray),
                                 shoot(fresh, now, f64, SLT_QUERY_TRACE, ray));
            }
            geometry_changed(g, 0, 3);
            assert_true(geometry_follow(g, after) > 0);
            assert_int_equal(geometry_follow(g, after), 0);
            for (uint32_t i = 0; i < 3000; i++) {
                double ray[8];
                any_ray(s, i, &seed, ray);
                assert_int_equal(shoot(g, now, f64, SLT_QUERY_TRACE, ray),
                                 shoot(fresh, now, f64, SLT_QUERY_TRACE, ray));
            }
            *s = *now;
            geometry_free(fresh);
        }
        geometry_free(g);
    }
    free(s), free(now);
}

static void test_refused_rays(void **state) {
    (void)state;
    Surface *s = blob(4, 8, 0);
    for (int f64 = 0; f64 < 2; f64++) {
        SltGeometry *g = made(s, f64, TRIMESH_ISA_BEST);
        static const double rays[][8] = {{NAN, 0, 0, 1, 0, 0, 0, 1},      {0, 0, 0, 0, NAN, 1, 0, 1},
                                         {0, 0, 0, 0, 0, 0, 0, 9},        {0, 0, 0, 1, 0, 0, 9, 1},
                                         {0, 0, 0, 1, 0, 0, NAN, 1},      {5, 0, 0, 1, 0, 0, 0, 9},
                                         {HUGE_VAL, 0, 0, 1, 0, 0, 0, 9}, {0, 0, 0, 1, 0, 0, 2, HUGE_VAL}};
        for (size_t i = 0; i < sizeof rays / sizeof *rays; i++)
            assert_int_equal(shoot(g, s, f64, SLT_QUERY_TRACE, rays[i]), SLT_WITNESS_NONE);
        assert_true(shoot(g, s, f64, SLT_QUERY_TRACE, (const double[]){5, 0, 0, 1, 0, 0, -HUGE_VAL, HUGE_VAL}) >= 0);
        assert_true(shoot(g, s, f64, SLT_QUERY_TRACE, (const double[]){0, 0, 0, 1e-20, 2e-20, 0, 0, HUGE_VAL}) >= 0);
        geometry_free(g);
    }
    free(s);
}

int main(int argc, char **argv) {
    if (argc > 1) leak_blocks = (uint32_t)(strtoul(argv[1], NULL, 10) / BLOCK) + 1;
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_watertight), cmocka_unit_test(test_same_everywhere),
                                       cmocka_unit_test(test_together), cmocka_unit_test(test_moves),
                                       cmocka_unit_test(test_refused_rays)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
