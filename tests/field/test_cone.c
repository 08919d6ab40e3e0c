/* Safety shapes: every variant, instruction set and precision gives the witness that cell stepping gives; and the
 * shapes themselves hold what they promise. */
#include "field_test.h"

#include "runtime/geometry/heightfield/cone.h"

enum { VARIANTS = 6 };
static const struct {
    const char *name;
    FieldOptions options;
} variants[VARIANTS] = {
    {"rings", {.structure = SLT_STRUCTURE_CONE}},
    {"directional", {.structure = SLT_STRUCTURE_CONE, .cone_directional = true}},
    {"exact", {.structure = SLT_STRUCTURE_CONE, .cone_exact = true}},
    {"exact, directional", {.structure = SLT_STRUCTURE_CONE, .cone_exact = true, .cone_directional = true}},
    {"bounded", {.structure = SLT_STRUCTURE_CONE, .max_slope = -0.4f}},
    {"exact, directional, bounded",
     {.structure = SLT_STRUCTURE_CONE, .cone_exact = true, .cone_directional = true, .max_slope = 0.2f}},
};

static void compare(const char *name, const char *how, const SltGeometry *naive, const SltGeometry *cone, const void *z,
                    bool f64, SltQuery what, const Rows *rays, uint64_t mask, uint32_t width) {
    int32_t expected[WIDTH];
    naive->query[what](naive, z, rays, mask, width, expected);
    expect_witnesses(name, how, cone, z, f64, what, rays, mask, width, expected);
}

static void agree(const Terrain *t, uint64_t seed, uint64_t rays_wanted) {
    double *wide = doubles(t->z, (size_t)t->w * t->h);
    for (int v = 0; v < VARIANTS; v++)
        for (int f64 = 0; f64 < 2; f64++) {
            const void *z = f64 ? (const void *)wide : t->z;
            SltGeometry *naive =
                make_field(z, f64, t->w, t->h, (FieldOptions){.structure = SLT_STRUCTURE_NAIVE, .band = 0.5f});
            /* Shapes are the same whatever searches them, and take most of the time: made once, searched by the queries
             * of a small field for each instruction set. */
            FieldOptions o = variants[v].options;
            o.isa = FIELD_ISA_SCALAR, o.band = 0.5f;
            SltGeometry *shapes = make_field(z, f64, t->w, t->h, o);
            for (int isa = FIELD_ISA_SCALAR; isa < FIELD_ISAS; isa++) {
                o.isa = (FieldIsa)isa;
                SltGeometry *small = make_field(z, f64, 2, 2, o), cone = *shapes;
                if (!small) continue;
                memcpy(cone.query, small->query, sizeof cone.query);
                Rng rng = {seed * 31 + (uint64_t)isa};
                for (uint64_t done = 0; done < rays_wanted; done += WIDTH) {
                    Rows rays;
                    SltQuery what = done % 640 == 0 ? SLT_QUERY_CLEARANCE
                                    : done % 128    ? SLT_QUERY_OCCLUDED
                                                    : SLT_QUERY_TRACE; /* what shapes do not serve is there too */
                    uint32_t width = uniform(&rng) < 0.8 ? WIDTH : 1 + below(&rng, WIDTH);
                    uint64_t mask = uniform(&rng) < 0.8 ? ~0ull : (uint64_t)(uniform(&rng) * 0x1p64);
                    some_rays(t, &rng, what, f64, width, &rays);
                    compare(t->name, field_describe(small), naive, &cone, z, f64, what, &rays, mask, width);
                }
                field_free(small);
            }
            field_free(shapes);
            field_free(naive);
        }
    free(wide);
}

static void test_terrains(void **state) {
    (void)state;
    const char *wanted = getenv("SALTUS_FIELD_RAYS");
    for (int n = 0; n < TERRAINS; n++) {
        Terrain t;
        if (!strcmp(terrain_names[n], "data") && !wanted) continue; /* exact shapes of a large field take seconds */
        if (!terrain_make(&t, terrain_names[n], 57, 43)) continue;
        agree(&t, 1 + (uint64_t)n, wanted ? strtoull(wanted, NULL, 10) : 2000);
        free(t.z);
    }
}

static void test_shapes(void **state) {
    (void)state;
    static const uint32_t shapes[][2] = {{2, 2},   {2, 3},   {3, 2},   {3, 3},   {5, 4},
                                         {17, 17}, {18, 16}, {2, 300}, {300, 2}, {33, 7}};
    for (size_t n = 0; n < sizeof shapes / sizeof *shapes; n++) {
        Terrain t;
        assert_true(terrain_make(&t, n & 1 ? "noise" : "spikes", shapes[n][0], shapes[n][1]));
        agree(&t, 100 + n, 700);
        free(t.z);
    }
}

static void test_not_finite(void **state) {
    (void)state;
    static const float odd[] = {NAN, INFINITY, -INFINITY, 3e38f, -3e38f, 1e-40f};
    for (int n = 0; n < 6; n++) {
        Terrain t;
        Rng rng = {77};
        assert_true(terrain_make(&t, "noise", 37, 22));
        for (int k = 0; k < 20; k++) t.z[below(&rng, t.w * t.h)] = odd[n];
        agree(&t, 200 + (uint64_t)n, 700);
        for (uint32_t k = 0; k < t.w * t.h; k++) t.z[k] = odd[n];
        t.low = 0, t.high = 1;
        agree(&t, 300 + (uint64_t)n, 0);
        free(t.z);
    }
}

/* Far from the origin a float knows a position to a fraction of a cell only. */
static void test_far(void **state) {
    (void)state;
    Terrain t;
    Rng rng = {3};
    assert_true(terrain_make(&t, "noise", 97, 75));
    SltGeometry *naive = make_field(t.z, false, t.w, t.h, (FieldOptions){.structure = SLT_STRUCTURE_NAIVE});
    for (int v = 0; v < VARIANTS; v++) {
        SltGeometry *cone = make_field(t.z, false, t.w, t.h, variants[v].options);
        uint32_t found = 0;
        for (int n = 0; n < 300; n++) {
            Rows rays;
            for (uint32_t lane = 0; lane < WIDTH; lane++) {
                double away = pow(10, between(&rng, 3, 6)), a = between(&rng, 0, 6.283), x = between(&rng, 0, t.w - 1),
                       y = between(&rng, 0, t.h - 1), slope = between(&rng, -0.7, 0.1);
                double ray[8] = {x - away * cos(a),
                                 y - away * sin(a),
                                 between(&rng, t.low, t.high) - slope * away,
                                 cos(a),
                                 sin(a),
                                 slope,
                                 0,
                                 INFINITY};
                for (int c = 0; c < 8; c++) rays.f[c * WIDTH + (int)lane] = (float)ray[c];
            }
            compare("far", field_describe(cone), naive, cone, t.z, false, SLT_QUERY_TRACE, &rays, ~0ull, WIDTH);
            int32_t id[WIDTH];
            cone->query[SLT_QUERY_TRACE](cone, t.z, &rays, ~0ull, WIDTH, id);
            for (int k = 0; k < WIDTH; k++) found += id[k] >= 0;
        }
        assert_true(found > 1000);
        field_free(cone);
    }
    field_free(naive);
    free(t.z);
}

static void test_slack(void **state) {
    (void)state;
    const float slack = 0.25f;
    for (int v = 0; v < VARIANTS; v++) {
        Terrain t;
        Rng rng = {5};
        assert_true(terrain_make(&t, "noise", 100, 80));
        FieldOptions o = variants[v].options;
        o.slack = slack;
        SltGeometry *cone = make_field(t.z, false, t.w, t.h, o),
                    *naive = make_field(t.z, false, t.w, t.h, (FieldOptions){.structure = SLT_STRUCTURE_NAIVE});
        for (uint32_t n = 0; n < t.w * t.h; n++) t.z[n] += (float)between(&rng, -0.2, 1) * slack;
        for (int n = 0; n < 200; n++) {
            Rows rays;
            some_rays(&t, &rng, SLT_QUERY_TRACE, false, WIDTH, &rays);
            compare(variants[v].name, field_describe(cone), naive, cone, t.z, false, SLT_QUERY_TRACE, &rays, ~0ull,
                    WIDTH);
        }
        /* A copy with another slack is asked as well as the field itself. */
        SltGeometry copy = *cone;
        copy.slack = 2 * slack;
        for (uint32_t n = 0; n < t.w * t.h; n++) t.z[n] += (float)between(&rng, 0, 1) * slack;
        for (int n = 0; n < 100; n++) {
            Rows rays;
            some_rays(&t, &rng, SLT_QUERY_TRACE, false, WIDTH, &rays);
            compare(variants[v].name, field_describe(cone), naive, &copy, t.z, false, SLT_QUERY_TRACE, &rays, ~0ull,
                    WIDTH);
        }
        field_free(cone);
        field_free(naive);
        free(t.z);
    }
}

static void test_refresh(void **state) {
    (void)state;
    for (int v = 0; v < VARIANTS; v++) {
        Terrain t;
        Rng rng = {9};
        assert_true(terrain_make(&t, "noise", 60, 50));
        SltGeometry *cone = make_field(t.z, false, t.w, t.h, variants[v].options),
                    *naive = make_field(t.z, false, t.w, t.h, (FieldOptions){.structure = SLT_STRUCTURE_NAIVE});
        for (int n = 0; n < 10; n++) {
            uint32_t x = below(&rng, t.w), y = below(&rng, t.h);
            *terrain_at(&t, x, y) = 3 * t.high;
            field_refresh(cone, t.z, x, y, x + 1, y + 1);
            Rows rays;
            for (int k = 0; k < 20; k++) {
                some_rays(&t, &rng, SLT_QUERY_TRACE, false, WIDTH, &rays);
                compare(variants[v].name, field_describe(cone), naive, cone, t.z, false, SLT_QUERY_TRACE, &rays, ~0ull,
                        WIDTH);
            }
        }
        field_free(cone);
        field_free(naive);
        free(t.z);
    }
}

/* What rings promise: no vertex that a ray of the class can pass, u along its main axis, is above base + slope * u. And
 * that directions and exactness make shapes wider, not narrower. */
static void test_promise(void **state) {
    (void)state;
    Terrain t;
    assert_true(terrain_make(&t, "noise", 41, 35));
    const int w = (int)t.w, h = (int)t.h;
    double slopes[2] = {0};
    for (int directional = 0; directional < 2; directional++) {
        FieldCones c;
        FieldConeOptions o = {.directional = directional};
        assert_true(cone_build(&c, t.z, false, t.w, t.h, &o));
        assert_false(c.relaxed);
        for (int k = 0; k < (int)c.classes; k++)
            for (int j = 0; j + 1 < h; j++)
                for (int i = 0; i + 1 < w; i++) {
                    uint32_t p = c.packed[(k * h + j) * w + i], upper = p & 0xffff0000u;
                    float slope;
                    memcpy(&slope, &upper, sizeof slope);
                    double base = c.lowest + (double)c.step * (p & 0xffff);
                    slopes[directional] += slope / c.classes;
                    for (int y = 0; y < h; y++)
                        for (int x = 0; x < w; x++) {
                            int dx = x < i       ? i - x
                                     : x > i + 1 ? x - i - 1
                                                 : 0,
                                dy = y < j       ? j - y
                                     : y > j + 1 ? y - j - 1
                                                 : 0,
                                u = dx > dy ? dx : dy;
                            if (directional) { /* +x, -x, +y, -y: in the quarter that widens from the cell */
                                int ahead = k == 0   ? x - i
                                            : k == 1 ? i + 1 - x
                                            : k == 2 ? y - j
                                                     : j + 1 - y,
                                    aside = k < 2 ? dy : dx;
                                if (ahead < 0 || aside > ahead) continue;
                            }
                            double z = *terrain_at(&t, (uint32_t)x, (uint32_t)y);
                            if (z > base + slope * u + 1e-4)
                                fail_msg("class %d, cell %d %d: vertex %d %d at %g is above %g + %g * %d", k, i, j, x,
                                         y, z, base, (double)slope, u);
                        }
                }
        cone_free(&c);
    }
    assert_true(slopes[1] < 0.9 * slopes[0]);
    FieldCounts counts[2] = {0};
    for (int exact = 0; exact < 2; exact++) { /* a ray takes fewer steps by exact shapes */
        SltGeometry *f =
            make_field(t.z, false, t.w, t.h,
                       (FieldOptions){.structure = SLT_STRUCTURE_CONE, .cone_exact = exact, .cone_directional = true});
        Rng rng = {4};
        for (int n = 0; n < 100; n++) {
            Rows rays;
            int32_t id[WIDTH];
            some_rays(&t, &rng, SLT_QUERY_TRACE, false, WIDTH, &rays);
            field_count(f, SLT_QUERY_TRACE, t.z, &rays, ~0ull, WIDTH, id, &counts[exact]);
        }
        field_free(f);
    }
    assert_int_equal(counts[0].rays, 100 * WIDTH);
    assert_true(counts[1].nodes < counts[0].nodes && counts[1].cells < counts[0].cells);
    free(t.z);
}

/* A bowl has no triangle that a ray from above can hit from behind: exact shapes are as wide as they may be, and a ray
 * steps far. */
static void test_bowl(void **state) {
    (void)state;
    const uint32_t n = 65;
    float *z = malloc(n * n * sizeof *z);
    assert_non_null(z);
    for (uint32_t j = 0; j < n; j++)
        for (uint32_t i = 0; i < n; i++)
            z[j * n + i] = 0x1p-7f * ((float)((i - 32.0) * (i - 32.0)) + (float)((j - 32.0) * (j - 32.0)));
    FieldCones c;
    FieldConeOptions o = {.exact = true};
    assert_true(cone_build(&c, z, false, n, n, &o));
    assert_true(c.relaxed);
    uint32_t wide = 0;
    for (uint32_t j = 0; j + 1 < n; j++)
        for (uint32_t i = 0; i + 1 < n; i++) wide += c.radius[j * n + i] == FIELD_CONE_MAX_RADIUS;
    assert_true(wide > (n - 1) * (n - 1) * 9 / 10);
    cone_free(&c);
    SltGeometry *cone = make_field(z, false, n, n, (FieldOptions){.structure = SLT_STRUCTURE_CONE, .cone_exact = true}),
                *naive = make_field(z, false, n, n, (FieldOptions){.structure = SLT_STRUCTURE_NAIVE});
    Terrain t = {.name = "bowl", .w = n, .h = n, .z = z, .low = 0, .high = 16};
    Rng rng = {8};
    FieldCounts a = {0}, b = {0};
    for (int k = 0; k < 200; k++) {
        Rows rays;
        int32_t id[WIDTH];
        some_rays(&t, &rng, SLT_QUERY_TRACE, false, WIDTH, &rays);
        compare("bowl", field_describe(cone), naive, cone, z, false, SLT_QUERY_TRACE, &rays, ~0ull, WIDTH);
        field_count(cone, SLT_QUERY_TRACE, z, &rays, ~0ull, WIDTH, id, &a);
        field_count(naive, SLT_QUERY_TRACE, z, &rays, ~0ull, WIDTH, id, &b);
    }
    assert_true(4 * a.cells < b.cells);
    field_free(cone);
    field_free(naive);
    free(z);
}

/* With a bound, steep shadow rays go cell by cell and the others by wide shapes: the radius is above zero where a slope
 * allows it. */
static void test_bound(void **state) {
    (void)state;
    Terrain t;
    assert_true(terrain_make(&t, "bumps", 97, 75));
    FieldCones free_one, bound;
    FieldConeOptions o = {.exact = true}, p = {.exact = true, .bounded = true, .max_slope = -2.0f};
    assert_true(cone_build(&free_one, t.z, false, t.w, t.h, &o));
    assert_true(cone_build(&bound, t.z, false, t.w, t.h, &p));
    uint64_t sums[2] = {0};
    for (uint32_t n = 0; n < t.w * t.h; n++) {
        assert_true(bound.radius[n] >= free_one.radius[n]);
        sums[0] += free_one.radius[n], sums[1] += bound.radius[n];
    }
    assert_true(sums[1] > 2 * sums[0]);
    cone_free(&free_one);
    cone_free(&bound);
    free(t.z);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_terrains), cmocka_unit_test(test_shapes), cmocka_unit_test(test_not_finite),
        cmocka_unit_test(test_far),      cmocka_unit_test(test_slack),  cmocka_unit_test(test_refresh),
        cmocka_unit_test(test_promise),  cmocka_unit_test(test_bowl),   cmocka_unit_test(test_bound)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
