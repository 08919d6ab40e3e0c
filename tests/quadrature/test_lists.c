/* Lists from cell to cell of a tree, against lists made for each cell from scratch: painted discs, and a second loop
 * whose iterations nothing hides. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/lists.h"

enum { DISCS = 700, BARS = 90, LOOPS = 3, SIDE = 4, BOXES = SIDE * SIDE, DEPTH = 4 };

typedef struct Scene {
    SltScene slt;
    double disc[DISCS][3];
    uint32_t runs; /* iterations of calls of `bounds` */
} Scene;

typedef struct Square {
    double lo[2], hi[2];
} Square;

static uint64_t state = 7;
static double random_number(void) {
    state = state * 6364136223846793005ull + 1442695040888963407ull;
    return (double)(state >> 11) * 0x1p-53;
}

/* The disc is painted opaquely: it may do something where it reaches, and overwrites where it covers. */
static void disc_on(const Scene *s, uint32_t k, const Square *q, bool *may, bool *must) {
    double near = 0, far = 0;
    for (int d = 0; d < 2; d++) {
        double lo = q->lo[d] - s->disc[k][d], hi = q->hi[d] - s->disc[k][d];
        near += lo > 0 ? lo * lo : hi < 0 ? hi * hi : 0;
        far += fmax(lo * lo, hi * hi);
    }
    double r = s->disc[k][2] * s->disc[k][2];
    *may = near <= r, *must = far < r;
}

/* Bar k adds something between k / BARS and (k + 2) / BARS. */
static bool bar_on(uint32_t k, const Square *q) {
    return q->hi[0] >= (double)k / BARS && q->lo[0] <= (double)(k + 2) / BARS;
}

/* Lists 0 (of [Cull], which `bounds` does not make), 1 the bars, 2 the discs. */
static void call_bounds(void *user, int kind, SltKernelArgs *a, uint32_t n) {
    Scene *s = user;
    assert_int_equal(kind, SLT_K_BOUNDS);
    assert_true(n <= SLT_PAD && a->note && a->cull);
    for (uint32_t loop = 1; loop < LOOPS; loop++) {
        const SltCullList *list = &a->cull[loop];
        int32_t count = list->count < 0 ? (loop == 1 ? BARS : DISCS) : list->count;
        s->runs += (uint32_t)count;
        for (int32_t j = 0; j < count; j++) {
            uint32_t k = (uint32_t)(list->count < 0 ? j : list->items[j]);
            assert_true(!a->note[loop][j].may && !a->note[loop][j].must);
            for (uint32_t i = 0; i < SLT_PAD; i++) { /* what is padding is noted too, and must not count */
                Square q;
                bool may = true, must = false;
                for (uint32_t d = 0; d < 2 && i < n; d++)
                    q.lo[d] = ((const double *)a->in[SLT_IN_X0 + d])[i],
                    q.hi[d] = ((const double *)a->in[SLT_IN_H0 + d])[i];
                if (i < n && loop == 1) may = bar_on(k, &q);
                if (i < n && loop == 2) disc_on(s, k, &q, &may, &must);
                a->note[loop][j].may |= (uint64_t)may << i;
                a->note[loop][j].must |= (uint64_t)must << i;
            }
        }
    }
}
static void present(SltKernelArgs *a, uint32_t n) { (void)a, (void)n; }

static void check_node(const Scene *s, const Batch *b, const Square *q) {
    const SltCullList *list = b->args.cull;
    assert_int_equal(list[0].count, 2);
    assert_int_equal(list[0].items[1], 5);
    int32_t n = 0, first = 0;
    for (uint32_t k = 0; k < BARS; k++)
        if (bar_on(k, q)) assert_true(n < list[1].count && list[1].items[n++] == (int32_t)k);
    assert_int_equal(list[1].count, n);
    bool may, must;
    for (uint32_t k = 0; k < DISCS; k++) {
        disc_on(s, k, q, &may, &must);
        if (must) first = (int32_t)k;
    }
    n = 0;
    for (uint32_t k = (uint32_t)first; k < DISCS; k++) {
        disc_on(s, k, q, &may, &must);
        if (may) assert_true(n < list[2].count && list[2].items[n++] == (int32_t)k);
    }
    assert_int_equal(list[2].count, n);
}

/* Every disc and bar that may do something in one of the four quarters, and nothing else. */
static void check_quarters(const Scene *s, const Batch *b, const Square *q) {
    const SltCullList *list = b->args.cull;
    int32_t n = 0, first[4] = {0};
    bool may, must;
    for (uint32_t k = 0; k < BARS; k++)
        if (bar_on(k, &q[0]) || bar_on(k, &q[1])) assert_true(n < list[1].count && list[1].items[n++] == (int32_t)k);
    assert_int_equal(list[1].count, n);
    for (uint32_t i = 0; i < 4; i++)
        for (uint32_t k = 0; k < DISCS; k++) {
            disc_on(s, k, &q[i], &may, &must);
            if (must) first[i] = (int32_t)k;
        }
    n = 0;
    for (uint32_t k = 0; k < DISCS; k++) {
        bool any = false;
        for (uint32_t i = 0; i < 4; i++) disc_on(s, k, &q[i], &may, &must), any |= may && (int32_t)k >= first[i];
        if (any) assert_true(n < list[2].count && list[2].items[n++] == (int32_t)k);
    }
    assert_int_equal(list[2].count, n);
}

static void put_squares(Batch *b, const Square *node, uint32_t side, Square *q) {
    double width = (node->hi[0] - node->lo[0]) / side;
    for (uint32_t i = 0; i < side * side; i++)
        for (uint32_t d = 0; d < 2; d++) {
            q[i].lo[d] = node->lo[d] + (d ? i / side : i % side) * width, q[i].hi[d] = q[i].lo[d] + width;
            batch_set(b, SLT_IN_X0 + d, i, q[i].lo[d]), batch_set(b, SLT_IN_H0 + d, i, q[i].hi[d]);
        }
}

typedef struct Node {
    Square q;
    uint32_t depth;
    ListsAt lists;
} Node;

static void test_tree(void **unused) {
    (void)unused;
    static Scene s;
    static Node stack[DEPTH * BOXES + 1];
    for (int k = 0; k < DISCS; k++)
        for (int d = 0; d < 3; d++) s.disc[k][d] = d < 2 ? random_number() : 0.02 + 0.1 * random_number();
    const uint32_t counts[LOOPS] = {9, BARS, DISCS};
    const uint8_t noted[LOOPS] = {0, 1, 1};
    s.slt = (SltScene){.f64 = true,
                       .dim = 2,
                       .channels = 1,
                       .adj_lanes = 4,
                       .call = call_bounds,
                       .call_user = &s,
                       .nlists = LOOPS,
                       .ncull = 1,
                       .list_count = counts,
                       .list_noted = noted};
    s.slt.kernel[SLT_K_BOUNDS] = present;
    for (int slot = 0; slot < 2; slot++)
        s.slt.layout[SLT_K_BOUNDS].reads |= (uint64_t)1 << (SLT_IN_X0 + slot) | (uint64_t)1 << (SLT_IN_H0 + slot);
    Batch b;
    Lists l;
    assert_true(batch_init(&b, &s.slt, NULL));
    assert_true(lists_init(&l, &s.slt));
    const int32_t promised[2] = {3, 5};
    const SltCullList root[LOOPS] = {{promised, 2}, {NULL, -1}, {NULL, -1}};
    uint32_t n = 0, nodes = 0;
    for (int time = 0; time < 2; time++) { /* the same object for another tile */
        b.args.cull = root;
        stack[n++] = (Node){{{0, 0}, {1, 1}}, 0, lists_begin(&l, &b)};
        while (n) {
            Node node = stack[--n];
            lists_enter(&l, &b, node.lists);
            if (node.depth) check_node(&s, &b, &node.q);
            nodes++;
            Square q[BOXES], quarter[4];
            uint64_t wanted = 0;
            bool narrow = nodes % 2;
            if (narrow) {
                put_squares(&b, &node.q, 2, quarter);
                assert_true(lists_note(&l, &b));
                batch_call(&b, SLT_K_BOUNDS, 4);
                assert_true(lists_narrow(&l, &b, 4));
                check_quarters(&s, &b, quarter);
            }
            put_squares(&b, &node.q, SIDE, q);
            for (uint32_t i = 0; i < BOXES; i++) wanted |= (uint64_t)(random_number() < 0.5) << i;
            assert_true(lists_note(&l, &b));
            batch_call(&b, SLT_K_BOUNDS, BOXES);
            assert_true(lists_split(&l, &b, BOXES, wanted));
            assert_null(b.args.note);
            if (narrow) check_quarters(&s, &b, quarter); /* the node's own still stand */
            else if (node.depth) check_node(&s, &b, &node.q);
            else assert_int_equal(b.args.cull[2].count, -1);
            if (node.depth + 1 == DEPTH) continue;
            for (uint32_t i = 0; i < BOXES; i++) { /* in another order than that of the boxes */
                uint32_t box = i * 7 % BOXES;
                if (wanted >> box & 1) stack[n++] = (Node){q[box], node.depth + 1, lists_of(&l, box)};
            }
        }
    }
    assert_true(nodes > 300);
    assert_true(s.runs < nodes * (DISCS + BARS) / 10);
    /* Memory is that of one way down, not of all that was seen. */
    assert_true(l.cap < 4 * BOXES * (DISCS + BARS));
    lists_free(&l);
    batch_free(&b);
}

/* A program without such loops: nothing is touched. */
static void test_none(void **unused) {
    (void)unused;
    SltScene s = {.f64 = true, .dim = 1, .channels = 1, .adj_lanes = 4};
    Batch b;
    Lists l;
    assert_true(batch_init(&b, &s, NULL));
    assert_true(lists_init(&l, &s));
    ListsAt at = lists_begin(&l, &b);
    lists_enter(&l, &b, at);
    assert_true(lists_note(&l, &b) && lists_split(&l, &b, 16, 0xffff));
    lists_enter(&l, &b, lists_of(&l, 3));
    assert_true(!b.args.cull && !b.args.note);
    lists_free(&l);
    batch_free(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_tree), cmocka_unit_test(test_none)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
