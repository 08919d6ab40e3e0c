/* Lists by strips of a tile hold what `bounds` says may matter there and no later iteration overwrites; those of the
 * tile come back. Programs whose bounds note nothing, and short lists, are left alone. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "runtime/sample/narrow.h"
#include "tests/sample/layouts.h"

enum { ITERATIONS = 200, ROWS = 4 };

/* Iteration i changes something in the band [i / 200, i / 200 + .1] of y, and overwrites all in it where i is a
 * multiple of seven: a box that lies in that band is painted over. */
static float band(int32_t i) { return (float)i / ITERATIONS; }

static void bounds(SltKernelArgs *a, uint32_t n) {
    const float *lo = a->in[SLT_IN_X1], *hi = a->in[SLT_IN_H1];
    const SltCullList *list = a->cull ? &a->cull[0] : NULL;
    const int32_t count = list && list->count >= 0 ? list->count : ITERATIONS;
    assert_non_null(a->note);
    assert_true(n <= 64);
    for (int32_t j = 0; j < count; j++)
        for (uint32_t b = 0; b < n; b++) {
            const int32_t i = list && list->items ? list->items[j] : j;
            const float from = band(i), to = band(i) + .1f;
            if (from <= hi[b] && to >= lo[b]) a->note[0][j].may |= 1ull << b;
            if (i % 7 == 0 && from <= lo[b] && to >= hi[b]) a->note[0][j].must |= 1ull << b;
        }
}

static bool matters(int32_t i, const double y[2]) {
    bool hidden = false;
    for (int32_t k = i + 1; k < ITERATIONS; k++)
        hidden |= k % 7 == 0 && band(k) <= (float)y[0] && band(k) + .1f >= (float)y[1];
    return !hidden && band(i) <= (float)y[1] && band(i) + .1f >= (float)y[0];
}

static bool holds(const SltCullList *l, int32_t i) {
    for (int32_t j = 0; j < l->count; j++)
        if (l->items[j] == i) return true;
    return false;
}

/* every: how far apart the iterations lie that [Cull] has left; 0: it has left all. */
static void check(uint32_t every) {
    static const uint32_t counts[] = {ITERATIONS};
    static const uint8_t noted[] = {1};
    SltScene s = {.dim = 2, .channels = 1, .hi = {1, 1, 1}, .adj_lanes = 16, .nlists = 1, .list_count = counts};
    Batch b;
    Narrowed k;
    int32_t items[ITERATIONS], n = 0;
    for (int32_t i = 0; every && i < ITERATIONS; i += (int32_t)every) items[n++] = i;
    const SltCullList list = {items, n};
    scene_outputs_init(&s);
    s.kernel[SLT_K_BOUNDS] = bounds, s.list_noted = noted;
    assert_true(narrow_serves(&s));
    assert_true(batch_init(&b, &s, NULL) && narrow_init(&k, &s));
    NarrowParts p = {.rows = ROWS, .x = {0, 1}};
    for (uint32_t r = 0; r < ROWS; r++) p.y[r][0] = .5013 + .0207 * r, p.y[r][1] = p.y[r][0] + .0207;
    b.args.cull = every ? &list : NULL;
    assert_true(narrow_tile(&k, &b, &p));
    assert_int_equal(k.rows, every > 20 ? 0 : ROWS);
    assert_null(b.args.note);
    for (uint32_t from = 0; from < ROWS && k.rows; from++)
        for (uint32_t to = from; to < ROWS; to++) {
            narrow_rows(&k, &b, from, to);
            uint32_t left = 0;
            for (int32_t i = 0; i < ITERATIONS; i++) {
                bool wanted = false;
                for (uint32_t r = from; r <= to; r++) wanted |= matters(i, p.y[r]);
                wanted &= !every || i % (int32_t)every == 0;
                left += wanted;
                if (every < 2) assert_int_equal(holds(b.args.cull, i), wanted);
                else if (!wanted) assert_true(!holds(b.args.cull, i) || i % (int32_t)every == 0);
            }
            for (int32_t j = 1; j < b.args.cull->count; j++)
                assert_true(b.args.cull->items[j - 1] < b.args.cull->items[j]);
            if (every < 2) assert_int_equal(b.args.cull->count, left);
            assert_true(b.args.cull->count < ITERATIONS / 2);
        }
    narrow_end(&k, &b);
    assert_ptr_equal(b.args.cull, every ? &list : NULL);
    assert_int_equal(b.evaluations, 0);
    narrow_free(&k), batch_free(&b);
}

static void test_strips(void **unused) {
    (void)unused;
    check(0), check(1), check(3), check(50);
}

static void test_others(void **unused) {
    (void)unused;
    static const uint32_t counts[] = {ITERATIONS};
    static const uint8_t noted[] = {0};
    SltScene s = {.dim = 2, .nlists = 1, .list_count = counts, .list_noted = noted};
    assert_false(narrow_serves(&s));
    s.kernel[SLT_K_BOUNDS] = bounds;
    assert_false(narrow_serves(&s));
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_strips), cmocka_unit_test(test_others)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
