/* Boxes of rays: what SLT_QUERY_BLOCKED says of a box, cell stepping finds for every ray in it.
 *
 * SALTUS_FIELD_RAYS: rays in boxes, by terrain and precision (default: a run of some seconds). The long run:
 * SALTUS_FIELD_RAYS=30000000 tests/test-field-boxes. */
#include <float.h>

#include "field_test.h"

enum { INSIDE = 32 }; /* rays tried of each box */

typedef union Boxes {
    float f[SLT_BOX_ROWS];
    double d[SLT_BOX_ROWS];
} Boxes;

typedef struct Tally {
    uint64_t boxes[3], rays; /* boxes by answer + 1 */
} Tally;

static double rounded(double v, bool f64) { return f64 ? v : (double)(float)v; }

/* The height of the terrain as shaders compute it, in their precision: compiler/front/gen/heightfield.c. */
#define LOOKUP(flt, name)                                                                                              \
    static flt name(const flt *z, uint32_t w, uint32_t h, flt x, flt y) {                                              \
        flt i = x < (flt)(w - 2) ? (flt)(int)x : (flt)(w - 2), j = y < (flt)(h - 2) ? (flt)(int)y : (flt)(h - 2);      \
        flt u = x - i, v = y - j, ru = 1 - u, rv = 1 - v;                                                              \
        const flt *at = z + (size_t)(h - 1 - (uint32_t)j) * w + (size_t)i;                                             \
        flt a00 = at[0], a10 = at[1], a01 = at[-(ptrdiff_t)w], a11 = at[1 - (ptrdiff_t)w];                             \
        flt p = u * (a10 - a00), q = v * (a01 - a00), r = ru * (a01 - a11), s = rv * (a10 - a11);                      \
        return u + v <= 1 ? (a00 + p) + q : (a11 + r) + s;                                                             \
    }
LOOKUP(float, lookup32)
LOOKUP(double, lookup64)

static double lookup(const Terrain *t, const void *z, bool f64, double x, double y) {
    return f64 ? lookup64(z, t->w, t->h, x, y) : (double)lookup32(z, t->w, t->h, (float)x, (float)y);
}

/* A number of [a, b], often an end, in the precision of the field. */
static double pick(Rng *r, double a, double b, bool f64) {
    double u = uniform(r);
    if (u < 0.15 || a == b) return a;
    if (u > 0.85) return b;
    return fmin(fmax(rounded(a + (b - a) * (u - 0.15) / 0.7, f64), a), b);
}

static void some_box(const Terrain *t, Rng *r, bool f64, double lo[SLT_RAY_ROWS], double hi[SLT_RAY_ROWS]) {
    double ray[8], size = pow(10, between(r, -6, 1)), unit = f64 ? DBL_EPSILON : (double)FLT_EPSILON;
    uint32_t shape = below(r, 4); /* origins; origins along one axis; everything; a few units in the last place */
    some_ray(t, r, ray);
    bool lifted = uniform(r) < 0.5 && ray[0] >= 0 && ray[1] >= 0 && ray[0] <= t->w - 1 && ray[1] <= t->h - 1;
    if (lifted && uniform(r) < 0.8) ray[6] = 0, ray[7] = INFINITY;
    uint32_t axis = below(r, 2);
    for (int n = 0; n < 8; n++) {
        double by = 0;
        if (shape == 3) by = (double)below(r, 4) * unit * (fabs(ray[n]) + 1);
        else if (n < 2) by = shape == 1 && (uint32_t)n != axis ? 0 : size * uniform(r);
        else if (shape != 1 || n == 2) by = n == 2 || shape == 2 ? 0.3 * size * uniform(r) * (shape == 2) : 0;
        if (isinf(ray[n])) by = 0;
        lo[n] = rounded(ray[n], f64), hi[n] = rounded(ray[n] + by, f64);
    }
    if (uniform(r) < 0.1) lo[0] = floor(lo[0]), hi[0] = lo[0] + below(r, 3);
    if (uniform(r) < 0.1) lo[1] = floor(lo[1]), hi[1] = lo[1] + below(r, 3);
    if (uniform(r) < 0.05) lo[3] = -fabs(hi[3]);
    lo[8] = lifted ? rounded(uniform(r) < 0.5 ? 1e-3 : between(r, -0.01, 0.05), f64) : NAN;
    hi[8] = lifted ? rounded(lo[8] + (uniform(r) < 0.3 ? 1e-3 : 0), f64) : NAN;
    lo[9] = hi[9] = 0;
    for (int n = 0; n < 9; n++)
        if (lo[n] > hi[n]) lo[n] = hi[n];
}

static void check_box(const Terrain *t, Rng *r, bool f64, const SltGeometry *bounding, const SltGeometry *naive,
                      const void *z, Tally *tally) {
    double lo[SLT_RAY_ROWS], hi[SLT_RAY_ROWS];
    some_box(t, r, f64, lo, hi);
    Boxes box;
    for (int n = 0; n < SLT_RAY_ROWS; n++)
        if (f64) box.d[n] = lo[n], box.d[n + SLT_RAY_ROWS] = hi[n];
        else box.f[n] = (float)lo[n], box.f[n + SLT_RAY_ROWS] = (float)hi[n];
    int32_t answer;
    bounding->query[SLT_QUERY_BLOCKED](bounding, z, &box, 1, 1, &answer);
    assert_in_range(answer + 1, 0, 2);
    tally->boxes[answer + 1]++;
    if (answer == SLT_RAYS_EITHER) return;
    /* With a lift, origins are where the box lies within the terrain. */
    bool lifted = lo[8] <= hi[8] && lo[0] >= 0 && lo[1] >= 0 && hi[0] <= t->w - 1 && hi[1] <= t->h - 1;
    Rows rays;
    int32_t found[INSIDE];
    for (uint32_t k = 0; k < INSIDE; k++) {
        double ray[8];
        for (int n = 0; n < 8; n++) ray[n] = pick(r, lo[n], hi[n], f64);
        if (lifted) {
            double over = lookup(t, z, f64, ray[0], ray[1]), lift = pick(r, lo[8], hi[8], f64);
            ray[2] = rounded(over + lift, f64);
        }
        for (uint32_t n = 0; n < 8; n++)
            if (f64) rays.d[n * INSIDE + k] = ray[n];
            else rays.f[n * INSIDE + k] = (float)ray[n];
    }
    naive->query[SLT_QUERY_TRACE](naive, z, &rays, ~0ull, INSIDE, found);
    tally->rays += INSIDE;
    for (uint32_t k = 0; k < INSIDE; k++) {
        if ((found[k] == SLT_WITNESS_NONE) == (answer == SLT_RAYS_FREE)) continue;
        char text[2048] = "";
        for (uint32_t n = 0; n < SLT_RAY_ROWS; n++) {
            size_t at = strlen(text);
            snprintf(text + at, sizeof text - at, "\n[%.17g, %.17g]", lo[n], hi[n]);
            at = strlen(text);
            if (n < 8)
                snprintf(text + at, sizeof text - at, " %.17g",
                         f64 ? rays.d[n * INSIDE + k] : (double)rays.f[n * INSIDE + k]);
        }
        fail_msg("%s, f%d: the box is %s, a ray meets %d%s", t->name, f64 ? 64 : 32,
                 answer == SLT_RAYS_FREE ? "free" : "blocked", found[k], text);
    }
}

/* Boxes of one field, and how many were told. */
static void contradict(const Terrain *t, uint64_t seed, uint64_t rays_wanted, float slack, Tally *all) {
    for (int f64 = 0; f64 < 2; f64++) {
        double *wide = f64 ? doubles(t->z, (size_t)t->w * t->h) : NULL;
        const void *z = f64 ? (const void *)wide : t->z;
        SltGeometry *naive =
                        make_field(z, f64, t->w, t->h,
                                   (FieldOptions){.structure = SLT_STRUCTURE_NAIVE, .queries = 1u << SLT_QUERY_TRACE}),
                    *bounding = make_field(z, f64, t->w, t->h,
                                           (FieldOptions){.queries = 1u << SLT_QUERY_BLOCKED, .slack = slack});
        Rng rng = {seed};
        Tally tally = {{0}, 0};
        while (tally.rays < rays_wanted) check_box(t, &rng, f64, bounding, naive, z, &tally);
        for (int k = 0; k < 3; k++) all->boxes[k] += tally.boxes[k];
        all->rays += tally.rays;
        field_free(naive), field_free(bounding), free(wide);
    }
}

static uint64_t wanted(uint64_t usual) {
    const char *text = getenv("SALTUS_FIELD_RAYS");
    return text ? strtoull(text, NULL, 10) : usual;
}

static void test_terrains(void **state) {
    (void)state;
    for (int n = 0; n < TERRAINS; n++) {
        Terrain t;
        Tally tally = {{0}, 0};
        if (!terrain_make(&t, terrain_names[n], 193, 150)) continue;
        contradict(&t, 1 + (uint64_t)n, wanted(200000), 0, &tally);
        uint64_t boxes = tally.boxes[0] + tally.boxes[1] + tally.boxes[2];
        print_message("%-14s %9llu boxes: %4.1f %% free, %4.1f %% blocked, %4.1f %% either\n", t.name,
                      (unsigned long long)boxes, 100.0 * (double)tally.boxes[0] / (double)boxes,
                      100.0 * (double)tally.boxes[1] / (double)boxes, 100.0 * (double)tally.boxes[2] / (double)boxes);
        /* They are worth something. */
        assert_true(tally.boxes[0] > boxes / 20 && tally.boxes[1] > boxes / 40 && tally.boxes[2] < 2 * boxes / 3);
        free(t.z);
    }
}

static void test_shapes(void **state) {
    (void)state;
    static const uint32_t shapes[][2] = {{2, 2},   {2, 3},   {3, 2},    {3, 3},    {5, 4},
                                         {17, 17}, {18, 16}, {2, 4096}, {4096, 2}, {33, 7}};
    for (size_t n = 0; n < sizeof shapes / sizeof *shapes; n++) {
        Terrain t;
        Tally tally = {{0}, 0};
        assert_true(terrain_make(&t, n & 1 ? "noise" : "spikes", shapes[n][0], shapes[n][1]));
        contradict(&t, 100 + n, 20000, 0, &tally);
        free(t.z);
    }
}

/* NaN, infinite and huge heights. */
static void test_not_finite(void **state) {
    (void)state;
    static const float odd[] = {NAN, INFINITY, -INFINITY, 3e38f, -3e38f, 1e30f, 1e-40f};
    for (size_t n = 0; n < sizeof odd / sizeof *odd; n++) {
        Terrain t;
        Rng rng = {77};
        Tally tally = {{0}, 0};
        assert_true(terrain_make(&t, "noise", 65, 40));
        for (int k = 0; k < 60; k++) t.z[below(&rng, t.w * t.h)] = odd[n];
        for (int f64 = 0; f64 < 2; f64++) {
            double *wide = doubles(t.z, (size_t)t.w * t.h);
            const void *z = f64 ? (const void *)wide : t.z;
            SltGeometry *naive = make_field(z, f64, t.w, t.h, (FieldOptions){.structure = SLT_STRUCTURE_NAIVE}),
                        *bounding = make_field(z, f64, t.w, t.h, (FieldOptions){0});
            for (int k = 0; k < 20000; k++) check_box(&t, &rng, f64, bounding, naive, z, &tally);
            field_free(naive), field_free(bounding), free(wide);
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
    Tally tally = {{0}, 0};
    assert_true(terrain_make(&t, "noise", 100, 80));
    SltGeometry *bounding = make_field(t.z, false, t.w, t.h, (FieldOptions){.slack = slack});
    for (uint32_t n = 0; n < t.w * t.h; n++) t.z[n] += (float)between(&rng, -0.2, 1) * slack;
    SltGeometry *naive = make_field(t.z, false, t.w, t.h, (FieldOptions){.structure = SLT_STRUCTURE_NAIVE});
    for (int k = 0; k < 20000; k++) check_box(&t, &rng, false, bounding, naive, t.z, &tally);
    assert_true(tally.rays > 100000);
    field_free(naive), field_free(bounding), free(t.z);
}

/* Origins on the terrain: almost all boxes of a hundredth of a cell are told, whatever the sun. */
static void test_sharp(void **state) {
    (void)state;
    Terrain t;
    Rng rng = {6};
    uint64_t told[3] = {0}, many = 20000;
    assert_true(terrain_make(&t, "noise", 193, 150));
    SltGeometry *bounding = make_field(t.z, false, t.w, t.h, (FieldOptions){0});
    for (uint64_t k = 0; k < many; k++) {
        double x = between(&rng, 0, t.w - 1.01), y = between(&rng, 0, t.h - 1.01), way = between(&rng, 0, 6.28);
        float a[SLT_RAY_ROWS] = {
            (float)x, (float)y, NAN,  (float)cos(way), (float)sin(way), (float)between(&rng, 0.02, 0.4),
            0,        INFINITY, 0.02f};
        Boxes box;
        for (int n = 0; n < SLT_RAY_ROWS; n++) box.f[n] = box.f[n + SLT_RAY_ROWS] = a[n];
        box.f[SLT_RAY_ROWS] += 0.01f, box.f[SLT_RAY_ROWS + 1] += 0.01f;
        int32_t answer;
        bounding->query[SLT_QUERY_BLOCKED](bounding, t.z, &box, 1, 1, &answer);
        told[answer + 1]++;
    }
    print_message("a hundredth of a cell: %.1f %% free, %.1f %% blocked\n", 100.0 * (double)told[0] / (double)many,
                  100.0 * (double)told[1] / (double)many);
    assert_true(told[0] + told[1] > many * 97 / 100 && told[0] > many / 10 && told[1] > many / 10);
    field_free(bounding), free(t.z);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_terrains), cmocka_unit_test(test_shapes),
                                       cmocka_unit_test(test_not_finite), cmocka_unit_test(test_slack),
                                       cmocka_unit_test(test_sharp)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
