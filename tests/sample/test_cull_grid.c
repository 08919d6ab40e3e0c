/* Boxes of [Cull] iterations by cells find the same as looking at every box does: small and wide ones, boxes beside the
 * domain, on borders of cells, of no size, turned round, without an end, of NaN. Those by strips find all of these, and
 * none that is farther away than a strip is wide. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "runtime/sample/cull_strips.h"

enum { BOXES = 3000, RECTANGLES = 400 };

static double random_unit(void) {
    static uint64_t state = 1;
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (double)(state >> 11) * 0x1p-53;
}

static CullBox random_box(uint32_t i) {
    static const double sizes[] = {0, 0x1p-6, 0.003, 0.05, 0.25, 1, 3, -0.01};
    double size = sizes[random_unit() < 0.8 ? 2 : i % 8];
    CullBox b;
    for (int d = 0; d < 2; d++) {
        b.lo[d] = -1.2 + 2.4 * random_unit();
        if (i % 5 == 0) b.lo[d] = round(b.lo[d] * 64) / 64;
        b.hi[d] = b.lo[d] + size * (i % 2 ? 1 : random_unit());
    }
    if (i % 501 == 0) b.lo[i % 2] = NAN;
    if (i % 502 == 0) b.hi[i % 2] = INFINITY;
    if (i % 503 == 0) b.lo[i % 2] = -INFINITY;
    return b;
}

/* As cull_grid.h states it. */
static bool touches(const CullBox *b, const double lo[2], const double hi[2]) {
    return !(b->lo[0] > hi[0] || b->hi[0] < lo[0] || b->lo[1] > hi[1] || b->hi[1] < lo[1]);
}

static void check_strips(const CullStrips *t, const SltScene *s, const CullBox *box, uint32_t n, const double lo[2],
                         const double hi[2]) {
    static int32_t items[BOXES + 1];
    double wide_lo[2], wide_hi[2];
    int32_t found = cull_strips_find(t, lo, hi, items), k = 0;
    assert_in_range(found, 0, n);
    for (int d = 0; d < 2; d++) {
        const double side = s->hi[d] > s->lo[d] ? s->hi[d] - s->lo[d] : 1, end = s->lo[d] + side,
                     strip = 1.001 * side / CULL_STRIPS;
        /* What lies beside the domain is in the strip of its border. */
        wide_lo[d] = lo[d] - strip <= s->lo[d] ? -HUGE_VAL : fmin(lo[d], end) - strip;
        wide_hi[d] = hi[d] + strip >= end ? HUGE_VAL : fmax(hi[d], s->lo[d]) + strip;
    }
    for (uint32_t i = 0; i < n; i++) {
        const bool is = k < found && items[k] == (int32_t)i;
        k += is;
        if (touches(&box[i], lo, hi)) assert_true(is);
        if (is) assert_true(touches(&box[i], wide_lo, wide_hi));
    }
    assert_int_equal(k, found); /* in order, each once */
}

static void check(const SltScene *s, uint32_t n) {
    CullBox *box = malloc((n + 1) * sizeof *box);
    CullGrid g;
    CullStrips t;
    uint64_t found[BOXES / 64 + 1], some[BOXES / 4096 + 1];
    for (uint32_t i = 0; i < n; i++) box[i] = random_box(i);
    assert_true(cull_grid_make(&g, s, box, n) && cull_strips_make(&t, &g));
    assert_int_equal(t.words, (n + 63) / 64);
    for (uint32_t r = 0; r < RECTANGLES; r++) {
        double lo[2], hi[2], size = r % 3 == 0 ? 0.03 : r % 3 == 1 ? 0.4 : 0;
        for (int d = 0; d < 2; d++) {
            lo[d] = -1.1 + 2.1 * random_unit();
            if (r % 4 == 0) lo[d] = floor(lo[d] * 16) / 16;
            hi[d] = r == 1 ? 1 : lo[d] + size;
        }
        memset(found, 0, sizeof found), memset(some, 0, sizeof some);
        cull_grid_find(&g, lo, hi, found, some);
        for (uint32_t i = 0; i < n; i++) assert_int_equal(found[i / 64] >> i % 64 & 1, touches(&box[i], lo, hi));
        if (n) check_strips(&t, s, box, n, lo, hi);
        for (uint32_t w = 0; w <= n / 64; w++) assert_int_equal(some[w / 64] >> w % 64 & 1, found[w] != 0);
    }
    cull_strips_free(&t), cull_grid_free(&g);
    free(box);
}

static void too_many_for_strips(void **state) {
    (void)state;
    enum { N = CULL_STRIPS_MOST + 1 };
    const SltScene unit = {.dim = 2, .lo = {-1, -1}, .hi = {1, 1}};
    CullBox *box = calloc(N, sizeof *box);
    CullGrid g;
    CullStrips t;
    assert_true(cull_grid_make(&g, &unit, box, N) && cull_strips_make(&t, &g));
    assert_int_equal(t.words, 0);
    cull_strips_free(&t), cull_grid_free(&g);
    free(box);
}

static void finds_what_touches(void **state) {
    (void)state;
    SltScene unit = {.dim = 2, .lo = {-1, -1}, .hi = {1, 1}}, flat = {.dim = 2, .lo = {-1, 0}, .hi = {1, 0}};
    check(&unit, BOXES);
    check(&unit, 5);
    check(&unit, 1);
    check(&unit, 0);
    check(&flat, 100);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(finds_what_touches), cmocka_unit_test(too_many_for_strips)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
