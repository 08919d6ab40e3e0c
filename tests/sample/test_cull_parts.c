/* Kernels that search lines run a few samples at a time, each with the iterations that may reach them: every sample
 * sees all that it would have seen in one go, whatever their number, the lanes, the precision and the kernel; lists are
 * much shorter; and all is as it was afterwards. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "runtime/sample/cull.h"
#include "tests/sample/layouts.h"

enum { ITERATIONS = 150, SAMPLES = 203 };
#define SIZE 0.08

static bool doubles;
static uint32_t calls, valid, samples;
static uint64_t looked; /* iterations of all calls, times their samples */

static double lo_of(int32_t i, uint32_t d) { return 0.01 * (d ? i * 61 % 97 : i * 37 % 91); }

static double get(const void *v, uint32_t i) {
    return doubles ? ((const double *)v)[i] : (double)((const float *)v)[i];
}
static void put(void *v, uint32_t i, double x) {
    if (doubles) ((double *)v)[i] = x;
    else ((float *)v)[i] = (float)x;
}

static void boxes(SltKernelArgs *a, uint32_t n) {
    const int32_t *iteration = a->in[SLT_IN_ITERATION];
    for (uint32_t k = 0; k < n; k++)
        for (uint32_t d = 0; d < 2; d++) {
            put(a->out[d], k, lo_of(iteration[k], d));
            put(a->out[2 + d], k, lo_of(iteration[k], d) + SIZE);
        }
}

/* A hash of the iterations whose boxes the sample is in, or its box touches; and its place. */
static void kernel(SltKernelArgs *a, uint32_t n, bool of_boxes, int hash_out, int place_out) {
    const SltCullList *l = &a->cull[0];
    calls++, valid += a->n_valid, samples += n, looked += (uint64_t)l->count * n;
    assert_true(a->n_valid && a->n_valid <= n);
    for (uint32_t k = 0; k < n; k++) {
        uint32_t hash = 1;
        for (int32_t j = 0; j < l->count; j++) {
            bool in = true;
            for (uint32_t d = 0; d < 2; d++) {
                const double at = get(a->in[SLT_IN_X0 + d], k), to = of_boxes ? get(a->in[SLT_IN_H0 + d], k) : at,
                             lo = lo_of(l->items[j], d);
                in &= to >= (doubles ? lo : (double)(float)lo) &&
                      at <= (doubles ? lo + SIZE : (double)(float)(lo + SIZE));
            }
            if (in) hash = hash * 31 + (uint32_t)l->items[j];
        }
        ((int32_t *)a->out[hash_out])[k] = (int32_t)hash;
        put(a->out[place_out], k, get(a->in[SLT_IN_X0], k) + 2 * get(a->in[SLT_IN_X1], k));
    }
}
static void region(SltKernelArgs *a, uint32_t n) { kernel(a, n, false, 1, 0); }
static void bounds(SltKernelArgs *a, uint32_t n) { kernel(a, n, true, 1, 0); }

typedef struct Answer {
    int32_t hash[SAMPLES];
    double place[SAMPLES];
} Answer;

static void fill(Batch *b) {
    for (uint32_t i = 0; i < SAMPLES; i++) { /* along lines, one after the other */
        const uint32_t line = i / 29;
        const double x[2] = {0.0344 * (i % 29), 0.05 + 0.13 * line};
        for (uint32_t d = 0; d < 2; d++) {
            batch_set(b, SLT_IN_X0 + d, i, x[d]);
            batch_set(b, SLT_IN_H0 + d, i, x[d] + (d ? 0 : 0.0344));
        }
    }
}

static void ask(Batch *b, SltKernelKind kind, uint32_t n, Answer *to) {
    const SltRole hash = kind == SLT_K_BOUNDS ? SLT_OUT_BOX_STATE : SLT_OUT_HASH,
                  place = kind == SLT_K_REGION   ? SLT_OUT_DEPTH
                          : kind == SLT_K_BOUNDS ? SLT_OUT_G
                                                 : SLT_OUT_F;
    const SltKernelArgs before = b->args;
    calls = valid = samples = 0, looked = 0;
    batch_call(b, kind, n);
    assert_memory_equal(b->args.in, before.in, sizeof before.in);
    assert_memory_equal(b->args.out, before.out, sizeof before.out);
    assert_ptr_equal(b->args.cull, before.cull);
    assert_int_equal(valid, n);
    for (uint32_t i = 0; i < n; i++)
        to->hash[i] = batch_get_int(b, hash, 0, i), to->place[i] = batch_get(b, place, 0, i);
}

static void check(bool f64, uint32_t lanes) {
    static const uint32_t counts[] = {ITERATIONS};
    static const SltKernelKind kinds[] = {SLT_K_REGION, SLT_K_BOUNDS};
    static Answer whole, parts;
    SltKernel *const cull[] = {boxes};
    SltScene s = {.dim = 2,
                  .channels = 1,
                  .hi = {1, 1, 1},
                  .f64 = f64,
                  .adj_lanes = 16,
                  .widest = lanes,
                  .nlists = 1,
                  .ncull = 1,
                  .cull_bounds = cull,
                  .cull_count = counts,
                  .list_count = counts};
    scene_add_output(&s, SLT_K_REGION, SLT_OUT_DEPTH, 1), scene_add_output(&s, SLT_K_REGION, SLT_OUT_HASH, 1);
    scene_add_output(&s, SLT_K_BOUNDS, SLT_OUT_G, 1), scene_add_output(&s, SLT_K_BOUNDS, SLT_OUT_BOX_STATE, 1);
    scene_add_output(&s, SLT_K_CULL, SLT_OUT_BOX, 4);
    s.layout[SLT_K_REGION].reads = (uint64_t)3 << SLT_IN_X0;
    s.layout[SLT_K_BOUNDS].reads = (uint64_t)3 << SLT_IN_X0 | (uint64_t)3 << SLT_IN_H0;
    s.layout[SLT_K_CULL].reads = (uint64_t)1 << SLT_IN_ITERATION;
    s.kernel[SLT_K_REGION] = region, s.kernel[SLT_K_BOUNDS] = bounds, doubles = f64;
    CullBoxes c;
    CullLists l;
    Batch b;
    assert_int_equal(cull_boxes(&c, &s, NULL), SLT_OK);
    assert_true(batch_init(&b, &s, NULL));
    const double lo[3] = {0, 0}, hi[3] = {1, 1};
    for (uint32_t k = 0; k < 2; k++)
        for (uint32_t n = k ? 1 : SAMPLES; n <= SAMPLES; n += 101) {
            CullBoxes without = c;
            without.strips = NULL; /* nobody has asked for parts */
            assert_true(cull_lists_init(&l, &without));
            cull_select(&without, &l, &b, lo, hi);
            fill(&b), ask(&b, kinds[k], n, &whole);
            assert_int_equal(calls, 1);
            const uint64_t all = looked;
            cull_lists_free(&l, &without);
            assert_true(cull_by_parts(&c) && cull_by_parts(&c) && cull_lists_init(&l, &c));
            cull_select(&c, &l, &b, lo, hi);
            fill(&b), ask(&b, kinds[k], n, &parts);
            assert_memory_equal(whole.hash, parts.hash, n * sizeof *whole.hash);
            assert_memory_equal(whole.place, parts.place, n * sizeof *whole.place);
            const uint32_t part = lanes > 16 ? lanes : 16;
            assert_int_equal(calls, (n + part - 1) / part);
            assert_true(looked < all / 2);
            /* Lists of someone else, or none: the call is one. */
            const SltCullList other = l.list[0];
            b.args.cull = &other, ask(&b, kinds[k], n, &parts);
            assert_int_equal(calls, 1);
            cull_lists_free(&l, &c), b.lists = NULL;
        }
    batch_free(&b), cull_free(&c);
}

static void test_parts(void **unused) {
    (void)unused;
    for (uint32_t lanes = 8; lanes <= 64; lanes *= 2) check(false, lanes), check(true, lanes);
}

/* Of an axis that the kernel does not read nothing is known: all that lies anywhere along it may matter. */
static void test_unread_axis(void **unused) {
    (void)unused;
    static const uint32_t counts[] = {ITERATIONS};
    SltKernel *const cull[] = {boxes};
    SltScene s = {.dim = 2, .channels = 1, .hi = {1, 1, 1}, .adj_lanes = 16, .widest = 16, .nlists = 1, .ncull = 1};
    s.cull_bounds = cull, s.cull_count = s.list_count = counts, doubles = false;
    scene_add_output(&s, SLT_K_CULL, SLT_OUT_BOX, 4);
    s.layout[SLT_K_CULL].reads = (uint64_t)1 << SLT_IN_ITERATION;
    s.layout[SLT_K_REGION].reads = (uint64_t)1 << SLT_IN_X0;
    CullBoxes c;
    CullLists l;
    Batch b;
    assert_int_equal(cull_boxes(&c, &s, NULL), SLT_OK);
    assert_true(cull_by_parts(&c) && cull_lists_init(&l, &c) && batch_init(&b, &s, NULL));
    cull_select(&c, &l, &b, (double[]){0, 0, 0}, (double[]){1, 1, 0});
    b.layout = &s.layout[SLT_K_REGION];
    for (uint32_t i = 0; i < 16; i++) batch_set(&b, SLT_IN_X0, i, 0.5);
    assert_true(cull_may_part(&b));
    cull_part(&b, 16, false);
    for (int32_t i = 0, k = 0; i < ITERATIONS; i++) {
        const bool is = k < b.args.cull->count && b.args.cull->items[k] == i;
        k += is;
        if (lo_of(i, 0) <= 0.5 && lo_of(i, 0) + SIZE >= 0.5) assert_true(is);
    }
    assert_in_range(b.args.cull->count, 1, ITERATIONS / 3);
    cull_lists_free(&l, &c), batch_free(&b), cull_free(&c);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_parts), cmocka_unit_test(test_unread_axis)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
