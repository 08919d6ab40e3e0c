/* Every query of the mipmap, at every instruction set and in both precisions, gives the witness that cell stepping
 * gives.
 *
 * SALTUS_FIELD_RAYS: rays a terrain, query, precision and instruction set (default: a run of some seconds). The long
 * run: SALTUS_FIELD_RAYS=10000000 tests/test-field-agree. */
#include "field_test.h"

/* Boxes are for test_boxes.c, what meshes alone answer for tests/trimesh. */
static bool is_of_others(int what) {
    return query_rows[what].ray == RAY_BOX || !(query_rows[what].geometries & SLT_ON_HEIGHTFIELD);
}

static void agree(const Terrain *t, uint64_t seed, uint64_t rays_wanted, float band) {
    for (int f64 = 0; f64 < 2; f64++) {
        double *wide = f64 ? doubles(t->z, (size_t)t->w * t->h) : NULL;
        const void *z = f64 ? (const void *)wide : t->z;
        SltGeometry *naive =
                        make_field(z, f64, t->w, t->h, (FieldOptions){.structure = SLT_STRUCTURE_NAIVE, .band = band}),
                    *fields[FIELD_ISAS] = {0};
        for (int isa = FIELD_ISA_SCALAR; isa < FIELD_ISAS; isa++)
            fields[isa] = make_field(z, f64, t->w, t->h, (FieldOptions){.isa = (FieldIsa)isa, .band = band});
        for (int what = 0; what < SLT_QUERIES; what++) {
            if (is_of_others(what)) continue;
            Rng rng = {seed * 31 + (uint64_t)what};
            uint64_t found = 0;
            for (uint64_t done = 0; done < rays_wanted; done += WIDTH) {
                Rows rays;
                int32_t expected[WIDTH];
                uint32_t width = uniform(&rng) < 0.8 ? WIDTH : 1 + below(&rng, WIDTH);
                uint64_t mask = uniform(&rng) < 0.8 ? ~0ull : (uint64_t)(uniform(&rng) * 0x1p64);
                some_rays(t, &rng, (SltQuery)what, f64, width, &rays);
                naive->query[what](naive, z, &rays, mask, width, expected);
                for (int isa = FIELD_ISA_SCALAR; isa < FIELD_ISAS; isa++)
                    if (fields[isa])
                        expect_witnesses(t->name, isa_names[isa], fields[isa], z, f64, (SltQuery)what, &rays, mask,
                                         width, expected);
                for (uint32_t n = 0; n < width; n++) found += expected[n] != SLT_WITNESS_NONE;
            }
            assert_true(found > rays_wanted / 50); /* the rays are worth something */
        }
        field_free(naive);
        for (int isa = 0; isa < FIELD_ISAS; isa++) field_free(fields[isa]);
        free(wide);
    }
}

static void test_terrains(void **state) {
    (void)state;
    const char *wanted = getenv("SALTUS_FIELD_RAYS");
    const uint64_t rays = wanted ? strtoull(wanted, NULL, 10) : 20000;
    for (int n = 0; n < TERRAINS; n++) {
        Terrain t;
        if (!terrain_make(&t, terrain_names[n], 193, 150)) continue;
        agree(&t, 1 + (uint64_t)n, rays, 0.5f);
        free(t.z);
    }
}

static void test_shapes(void **state) {
    (void)state;
    static const uint32_t shapes[][2] = {{2, 2},   {2, 3},   {3, 2},    {3, 3},    {5, 4},
                                         {17, 17}, {18, 16}, {2, 4096}, {4096, 2}, {33, 7}};
    for (size_t n = 0; n < sizeof shapes / sizeof *shapes; n++) {
        Terrain t;
        assert_true(terrain_make(&t, n & 1 ? "noise" : "spikes", shapes[n][0], shapes[n][1]));
        agree(&t, 100 + n, 2000, n & 1 ? INFINITY : 0.0f);
        free(t.z);
    }
}

/* NaN and infinite heights: no crash, no endless loop, still the same answers. */
static void test_not_finite(void **state) {
    (void)state;
    static const float odd[] = {NAN, INFINITY, -INFINITY, 3e38f, -3e38f, 1e-40f};
    for (int n = 0; n < 6; n++) {
        Terrain t;
        Rng rng = {77};
        assert_true(terrain_make(&t, "noise", 65, 40));
        for (int k = 0; k < 60; k++) t.z[below(&rng, t.w * t.h)] = odd[n];
        agree(&t, 200 + (uint64_t)n, 2000, 0.5f);
        for (uint32_t k = 0; k < t.w * t.h; k++) t.z[k] = odd[n];
        t.low = 0, t.high = 1;
        for (int what = 0; what < SLT_QUERIES; what++) {
            if (is_of_others(what)) continue;
            SltGeometry *a = make_field(t.z, false, t.w, t.h, (FieldOptions){.structure = SLT_STRUCTURE_NAIVE}),
                        *b = make_field(t.z, false, t.w, t.h, (FieldOptions){0});
            Rows rays;
            int32_t expected[WIDTH];
            some_rays(&t, &rng, (SltQuery)what, false, WIDTH, &rays);
            a->query[what](a, t.z, &rays, ~0ull, WIDTH, expected);
            expect_witnesses("one odd height", "mipmap", b, t.z, false, (SltQuery)what, &rays, ~0ull, WIDTH, expected);
            field_free(a);
            field_free(b);
        }
        free(t.z);
    }
}

/* Heights up to `slack` above those of the structure. */
static void test_slack(void **state) {
    (void)state;
    const float slack = 0.25f;
    Terrain t;
    Rng rng = {5};
    assert_true(terrain_make(&t, "noise", 100, 80));
    SltGeometry *naive =
        make_field(t.z, false, t.w, t.h, (FieldOptions){.structure = SLT_STRUCTURE_NAIVE, .slack = slack, .band = 1});
    SltGeometry *mip = make_field(t.z, false, t.w, t.h, (FieldOptions){.slack = slack, .band = 1});
    for (uint32_t n = 0; n < t.w * t.h; n++) t.z[n] += (float)between(&rng, -0.2, 1) * slack;
    SltGeometry *tight = make_field(t.z, false, t.w, t.h, (FieldOptions){.structure = SLT_STRUCTURE_NAIVE, .band = 1});
    for (int what = 0; what < SLT_QUERIES; what++) {
        if (is_of_others(what)) continue;
        for (int n = 0; n < 200; n++) {
            Rows rays;
            int32_t expected[WIDTH];
            some_rays(&t, &rng, (SltQuery)what, false, WIDTH, &rays);
            tight->query[what](tight, t.z, &rays, ~0ull, WIDTH, expected);
            expect_witnesses("slack", "naive", naive, t.z, false, (SltQuery)what, &rays, ~0ull, WIDTH, expected);
            expect_witnesses("slack", "mipmap", mip, t.z, false, (SltQuery)what, &rays, ~0ull, WIDTH, expected);
        }
    }
    field_free(naive);
    field_free(mip);
    field_free(tight);
    free(t.z);
}

/* A refreshed field answers as a new one, for rectangles everywhere, of every size. */
static void test_refresh(void **state) {
    (void)state;
    static const uint32_t shapes[][2] = {{97, 64}, {2, 300}, {128, 129}, {2300, 3}};
    for (int s = 0; s < 4; s++) {
        Terrain t;
        Rng rng = {9};
        assert_true(terrain_make(&t, "noise", shapes[s][0], shapes[s][1]));
        for (int f64 = 0; f64 < 2; f64++) {
            double *wide = doubles(t.z, (size_t)t.w * t.h);
            const void *z = f64 ? (const void *)wide : t.z;
            SltGeometry *naive = make_field(z, f64, t.w, t.h, (FieldOptions){.structure = SLT_STRUCTURE_NAIVE}),
                        *mip = make_field(z, f64, t.w, t.h, (FieldOptions){0});
            for (int n = 0; n < 60; n++) {
                uint32_t x0 = below(&rng, t.w), y0 = below(&rng, t.h), x1 = x0 + 1 + below(&rng, n & 1 ? 3 : t.w),
                         y1 = y0 + 1 + below(&rng, n & 1 ? 3 : t.h);
                for (uint32_t j = y0; j < y1 && j < t.h; j++) {
                    for (uint32_t i = x0; i < x1 && i < t.w; i++) {
                        size_t at = (size_t)(t.h - 1 - j) * t.w + i;
                        wide[at] = between(&rng, t.low, t.high) * (n % 3 ? 1 : 2);
                        t.z[at] = (float)wide[at];
                    }
                }
                field_refresh(mip, z, x0, y0, x1, y1);
                Rows rays;
                int32_t expected[WIDTH];
                some_rays(&t, &rng, SLT_QUERY_TRACE, f64, WIDTH, &rays);
                naive->query[SLT_QUERY_TRACE](naive, z, &rays, ~0ull, WIDTH, expected);
                expect_witnesses("refreshed", "mipmap", mip, z, f64, SLT_QUERY_TRACE, &rays, ~0ull, WIDTH, expected);
            }
            /* The levels themselves: what a query visits is what it would visit in a new field. */
            SltGeometry *again = make_field(z, f64, t.w, t.h, (FieldOptions){0});
            FieldCounts a = {0}, b = {0};
            for (int n = 0; n < 50; n++) {
                Rows rays;
                int32_t id[WIDTH];
                some_rays(&t, &rng, SLT_QUERY_CLEARANCE, f64, WIDTH, &rays);
                field_count(mip, SLT_QUERY_CLEARANCE, z, &rays, ~0ull, WIDTH, id, &a);
                field_count(again, SLT_QUERY_CLEARANCE, z, &rays, ~0ull, WIDTH, id, &b);
            }
            assert_true(a.nodes > 0 && a.cells > 0);
            assert_int_equal(a.nodes, b.nodes);
            assert_int_equal(a.cells, b.cells);
            field_free(naive);
            field_free(mip);
            field_free(again);
            free(wide);
        }
        free(t.z);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_terrains), cmocka_unit_test(test_shapes),
                                       cmocka_unit_test(test_not_finite), cmocka_unit_test(test_slack),
                                       cmocka_unit_test(test_refresh)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
