/* Queries with answers known in closed form, and silhouettes against brute force over all crossings. */
#include "field_test.h"

enum { N = 33 };

static int32_t ask(SltGeometry *f, const float *z, SltQuery what, const float ray[8]) {
    int32_t id;
    f->query[what](f, z, ray, 1, 1, &id);
    return id;
}

static int32_t edge(int i, int j, int kind) { return 4 * (j * N + i) + kind; }
static int32_t triangle(int i, int j, int upper) { return 2 * (j * N + i) + upper; }

/* A wall of height 4 at x = 20 on flat ground. */
static void test_wall(void **state) {
    (void)state;
    static float z[N * N];
    for (int n = 0; n < N * N; n++) z[n] = n % N == 20 ? 4 : 0;
    for (int structure = 0; structure < 3; structure += 2) {
        SltGeometry *f = make_field(z, false, N, N, (FieldOptions){.structure = (SltStructure)structure, .band = 0.5f});
        const float inf = INFINITY;
        /* Level at z = 2: blocked half way between x = 19 and x = 20. */
        assert_int_equal(ask(f, z, SLT_QUERY_TRACE, (float[]){2.5f, 7.25f, 2, 1, 0, 0, 0, inf}), triangle(19, 7, 0));
        assert_int_equal(ask(f, z, SLT_QUERY_TRACE, (float[]){30.5f, 7.25f, 2, -1, 0, 0, 0, inf}), triangle(20, 7, 0));
        assert_int_equal(ask(f, z, SLT_QUERY_TRACE, (float[]){2.5f, 7.25f, 2, 1, 0, 0, 0, 10}), SLT_WITNESS_NONE);
        assert_int_equal(ask(f, z, SLT_QUERY_TRACE, (float[]){2.5f, 7.25f, 2, 1, 0, 0, 20, 10}), SLT_WITNESS_NONE);
        assert_int_equal(ask(f, z, SLT_QUERY_TRACE, (float[]){2.5f, 7.25f, 4, 1, 0, 0, 0, inf}),
                         SLT_WITNESS_NONE); /* touching the top is not below it */
        assert_int_not_equal(ask(f, z, SLT_QUERY_OCCLUDED, (float[]){2.5f, 7.25f, 3.99f, 1, 0, 0, 0, inf}),
                             SLT_WITNESS_NONE);
        assert_int_equal(ask(f, z, SLT_QUERY_OCCLUDED, (float[]){2.5f, 7.25f, 4, 1, 0, 0, 0, inf}), SLT_WITNESS_NONE);
        assert_int_equal(ask(f, z, SLT_QUERY_TRACE, (float[]){20, 7.25f, 1, 1, 0, 0, 0, inf}), SLT_WITNESS_AT_T0);
        assert_int_equal(ask(f, z, SLT_QUERY_TRACE, (float[]){5.25f, 7.25f, 9, 0, 0, -1, 0, inf}),
                         triangle(5, 7, 0)); /* straight down */
        assert_int_equal(ask(f, z, SLT_QUERY_TRACE, (float[]){5.75f, 7.75f, 9, 0, 0, -1, 0, inf}), triangle(5, 7, 1));
        assert_int_equal(ask(f, z, SLT_QUERY_TRACE, (float[]){5.75f, 7.75f, 9, 0, 0, 1, 0, inf}), SLT_WITNESS_NONE);
        /* From outside: below the rim, above it, and past the box. */
        assert_int_equal(ask(f, z, SLT_QUERY_TRACE, (float[]){-3, 7.25f, -1, 1, 0, 0, 0, inf}), SLT_HEIGHTFIELD_WALL);
        assert_int_equal(ask(f, z, SLT_QUERY_TRACE, (float[]){40, 7.25f, -1, -1, 0, 0, 0, inf}),
                         SLT_HEIGHTFIELD_WALL - 1);
        assert_int_equal(ask(f, z, SLT_QUERY_TRACE, (float[]){3.5f, -2, -1, 0, 1, 0, 0, inf}),
                         SLT_HEIGHTFIELD_WALL - 2);
        assert_int_equal(ask(f, z, SLT_QUERY_TRACE, (float[]){3.5f, 60, -1, 0, -2, 0, 0, inf}),
                         SLT_HEIGHTFIELD_WALL - 3);
        assert_int_equal(ask(f, z, SLT_QUERY_TRACE, (float[]){-3, 7.25f, 2, 1, 0, 0, 0, inf}), triangle(19, 7, 0));
        assert_int_equal(ask(f, z, SLT_QUERY_TRACE, (float[]){-3, -7.25f, 0, 1, 0, 0, 0, inf}), SLT_WITNESS_NONE);
        assert_int_equal(ask(f, z, SLT_QUERY_TRACE, (float[]){3, 3, NAN, 1, 0, 0, 0, inf}), SLT_WITNESS_NONE);
        /* Clearance of a level ray is least at the top of the wall while z < 4 + ..., and of one that looks down at the
         * end of its interval. */
        assert_int_equal(ask(f, z, SLT_QUERY_CLEARANCE, (float[]){2.5f, 7.25f, 3, 1, 0, 0, 1, inf}), edge(20, 7, 1));
        assert_int_equal(ask(f, z, SLT_QUERY_SHADOW, (float[]){2.5f, 7.25f, 3.75f, 1, 0, 0, 1, inf}), edge(20, 7, 1));
        assert_int_equal(ask(f, z, SLT_QUERY_SHADOW, (float[]){2.5f, 7.25f, 4.25f, 1, 0, 0, 1, inf}), edge(20, 7, 1));
        assert_int_equal(ask(f, z, SLT_QUERY_SHADOW, (float[]){2.5f, 7.25f, 5, 1, 0, 0, 1, inf}), SLT_WITNESS_NONE);
        assert_int_equal(ask(f, z, SLT_QUERY_CLEARANCE, (float[]){2.5f, 7.25f, 5, 1, 0, -0.1f, 1, 4}),
                         SLT_WITNESS_AT_T1);
        assert_int_equal(ask(f, z, SLT_QUERY_CLEARANCE, (float[]){2.5f, 7.25f, -0.5f, 1, 0, 1, 1, 4}),
                         SLT_WITNESS_AT_T0);
        assert_int_equal(ask(f, z, SLT_QUERY_CLEARANCE, (float[]){-9, 7.25f, 5, 1, 0, 0, 1, 4}), SLT_WITNESS_NONE);
        /* From the top of the wall down its far side, and from the ground up to it. */
        assert_int_equal(ask(f, z, SLT_QUERY_RISE, (float[]){16.5f, 7.25f, 1, 1, 0, 0, 2.875f, inf}), edge(20, 7, 1));
        assert_int_equal(ask(f, z, SLT_QUERY_RISE, (float[]){16.5f, 7.25f, 1, 1, 0, 0, 3.75f, inf}), SLT_WITNESS_AT_T0);
        /* Seen from the ground the wall's top is the only silhouette, under 3.5 / 17.5. */
        assert_int_equal(ask(f, z, SLT_QUERY_SILHOUETTE, (float[]){2.5f, 7.25f, 0.5f, 1, 0, 0, -inf, inf}),
                         edge(20, 7, 1));
        assert_int_equal(ask(f, z, SLT_QUERY_SILHOUETTE, (float[]){2.5f, 7.25f, 0.5f, 1, 0, 0, 0.19f, 0.21f}),
                         edge(20, 7, 1));
        assert_int_equal(ask(f, z, SLT_QUERY_SILHOUETTE, (float[]){2.5f, 7.25f, 0.5f, 1, 0, 0, 0.21f, 9}),
                         SLT_WITNESS_NONE);
        assert_int_equal(ask(f, z, SLT_QUERY_SILHOUETTE, (float[]){2.5f, 7.25f, 0.5f, 1, 0, 0, -9, 0.19f}),
                         SLT_WITNESS_NONE);
        /* From above it, the wall; then the far border of the ground, where the terrain ends. */
        int32_t id[8];
        const float o[3] = {2.5f, 7.25f, 10}, d[2] = {1, 0};
        assert_int_equal(field_silhouettes(f, z, o, d, -INFINITY, INFINITY, id, 8, NULL), 2);
        assert_int_equal(id[0], edge(20, 7, 1));
        assert_int_equal(id[1], edge(32, 7, 1));
        field_free(f);
    }
}

/* The slope under which the origin sees a witness, by the arithmetic of leaf.h. */
static float slope_of(const Terrain *t, const float *o, const float *d, int32_t id) {
    int cell = id / 4, i = cell % (int)t->w, j = cell / (int)t->w, kind = id % 4;
    float s, u, a, b;
    if (kind == 1)
        s = ((float)i - o[0]) * (1 / d[0]), u = o[1] + s * d[1] - (float)j,
        a = *terrain_at(t, (uint32_t)i, (uint32_t)j), b = *terrain_at(t, (uint32_t)i, (uint32_t)j + 1);
    else if (kind == 0)
        s = ((float)j - o[1]) * (1 / d[1]), u = o[0] + s * d[0] - (float)i,
        a = *terrain_at(t, (uint32_t)i, (uint32_t)j), b = *terrain_at(t, (uint32_t)i + 1, (uint32_t)j);
    else
        s = ((float)(i + j + 1) - (o[0] + o[1])) * (1 / (d[0] + d[1])), u = o[0] + s * d[0] - (float)i,
        a = *terrain_at(t, (uint32_t)i, (uint32_t)j + 1), b = *terrain_at(t, (uint32_t)i + 1, (uint32_t)j);
    u = fminf(fmaxf(u, 0), 1);
    return ((a + u * (b - a)) - o[2]) / s;
}

/* One pass finds what the query finds when it is called again above each peak; and the levels save cells. */
static void test_slices(void **state) {
    (void)state;
    Terrain t;
    Rng rng = {3};
    assert_true(terrain_make(&t, "noise", 1025, 1025));
    SltGeometry *mip = make_field(t.z, false, t.w, t.h, (FieldOptions){0}),
                *naive = make_field(t.z, false, t.w, t.h, (FieldOptions){.structure = SLT_STRUCTURE_NAIVE});
    uint64_t peaks = 0;
    FieldCounts few = {0}, many = {0}, few_window = {0}, many_window = {0};
    for (int n = 0; n < 400; n++) {
        double x = between(&rng, 0, t.w - 1), y = between(&rng, 0, t.h - 1), a = between(&rng, 0, 6.28318530718),
               k = between(&rng, -0.1, 0.5);
        const float o[3] = {(float)x, (float)y, (float)(terrain_height(&t, x, y) + (n % 4 ? 0.01 : 60))},
                    d[2] = {(float)cos(a), (float)sin(a)};
        int32_t one[512], brute[512], next;
        FieldCounts *count[2] = {n % 4 ? &few : NULL, n % 4 ? &many : NULL};
        uint32_t found = field_silhouettes(mip, t.z, o, d, -INFINITY, INFINITY, one, 512, count[0]);
        assert_int_equal(field_silhouettes(naive, t.z, o, d, -INFINITY, INFINITY, brute, 512, count[1]), found);
        assert_true(found <= 512);
        assert_memory_equal(one, brute, found * sizeof *one);
        float ray[8] = {o[0], o[1], o[2], d[0], d[1], 0, -INFINITY, INFINITY};
        for (uint32_t p = 0; p < found; p++) {
            mip->query[SLT_QUERY_SILHOUETTE](mip, t.z, ray, 1, 1, &next);
            assert_int_equal(next, one[p]);
            float slope = slope_of(&t, o, d, next);
            assert_true(slope > ray[6]);
            ray[6] = slope;
        }
        mip->query[SLT_QUERY_SILHOUETTE](mip, t.z, ray, 1, 1, &next);
        assert_int_equal(next, SLT_WITNESS_NONE);
        peaks += found;
        found = field_silhouettes(mip, t.z, o, d, k, k + 0.00077, one, 512, &few_window);
        assert_int_equal(field_silhouettes(naive, t.z, o, d, k, k + 0.00077, brute, 512, &many_window), found);
        assert_memory_equal(one, brute, found * sizeof *one);
    }
    assert_true(peaks > 800);
    print_message("surface points: %.1f nodes and cells, brute force %.1f; windows: %.1f, %.1f\n",
                  (double)(few.nodes + few.cells) / (double)few.rays, (double)many.cells / (double)many.rays,
                  (double)(few_window.nodes + few_window.cells) / (double)few_window.rays,
                  (double)many_window.cells / (double)many_window.rays);
    assert_true(many.cells > 4 * (few.nodes + few.cells));
    assert_true(many_window.cells > 8 * (few_window.nodes + few_window.cells));
    field_free(mip);
    field_free(naive);
    free(t.z);
}

static void test_refusals(void **state) {
    (void)state;
    float z[4] = {0};
    SltGeometry *f = (SltGeometry *)1;
    SltError err;
    assert_int_equal(field_make(&f, z, false, 1, 4, NULL, &err), SLT_USAGE);
    assert_null(f);
    assert_int_equal(field_make(&f, z, false, 1u << 15, 1u << 15, NULL, &err), SLT_LIMIT);
    assert_int_equal(field_make(&f, z, false, 2, 2, &(FieldOptions){.band = NAN}, &err), SLT_USAGE);
    assert_int_equal(field_make(&f, z, false, 2, 2, &(FieldOptions){.queries = 1u << SLT_QUERY_RISE}, &err), SLT_OK);
    assert_int_equal(field_bytes(f), 0); /* no query of this field looks at levels */
    field_free(f);
    assert_int_equal(field_make(&f, z, false, 2, 2, NULL, &err), SLT_OK);
    assert_int_equal(field_bytes(f), sizeof(float));
    field_free(f);
    field_free(NULL);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_wall), cmocka_unit_test(test_slices),
                                       cmocka_unit_test(test_refusals)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
