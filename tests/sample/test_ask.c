/* Which edges of a tile are looked at: against the rules edge by edge, along every axis of one, two and three. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/ask.h"
#include "runtime/sample/depth.h"

static uint32_t state = 1;
static uint32_t word(void) { return state = state * 1664525u + 1013904223u, (state ^ state >> 15) & 0xffffff; }

enum { MOST = 37 * 21 * 9 };
static const double threshold = 0.5;

static bool want_edge(const Worker *w, uint32_t axis, uint64_t a, uint64_t b) {
    return w->hash[a] != w->hash[b] || (w->face && w->face[a] != w->face[b]) ||
           (w->depth && depth_differs(w->depth[a], w->depth[b], threshold)) ||
           (w->finder.proves && !(w->settled[a] >> axis & 1));
}

/* Of edge e of a line of n vertices: near.c passes over the others. */
static bool want_near(const Worker *w, const AskTile *t, uint32_t axis, uint32_t e, uint64_t v) {
    const uint32_t n = t->n[axis];
    const uint64_t s = t->stride[axis];
    if (!w->near_g) return false;
    if ((t->at_start[axis] && e < 2) || (t->at_end[axis] && e + 3 >= n)) return true;
    if (e < 1 || e + 2 >= n) return false;
    return w->near_key[v] == w->near_key[v + s] && w->near_g[v] < w->near_g[v - s] &&
           w->near_g[v + 2 * s] > w->near_g[v + s];
}

static void check_axis(Worker *w, const AskTile *t, uint32_t axis) {
    ask_edges(w, t, axis, threshold);
    const uint32_t a = axis == 0 ? 1 : 0, b = axis == 2 ? 1 : 2;
    for (uint32_t q = 0; q < t->n[b]; q++)
        for (uint32_t p = 0; p < t->n[a]; p++) {
            const uint64_t first = p * t->stride[a] + q * t->stride[b];
            uint8_t any = 0;
            for (uint32_t e = t->from[axis]; e < t->to[axis]; e++) {
                const uint64_t v = first + e * t->stride[axis];
                const uint8_t want = (want_edge(w, axis, v, v + t->stride[axis]) ? ASK_EDGE : 0) |
                                     (want_near(w, t, axis, e, v) ? ASK_NEAR : 0);
                assert_int_equal(w->ask[v] & (ASK_EDGE | ASK_NEAR), want);
                any |= want;
            }
            assert_int_equal(w->ask[first] >> 2, any);
            /* Those that have a bit are found one after the other. */
            for (uint8_t bit = ASK_EDGE; bit <= ASK_NEAR; bit *= 2) {
                uint32_t e = t->from[axis];
                for (uint32_t at = e; at < t->to[axis]; at++) {
                    if (!(w->ask[first + at * t->stride[axis]] & bit)) continue;
                    e = ask_next(w->ask + first, t->stride[axis], e, t->to[axis], bit);
                    assert_int_equal(e++, at);
                }
                assert_int_equal(ask_next(w->ask + first, t->stride[axis], e, t->to[axis], bit), t->to[axis]);
            }
        }
}

static void test_edges(void **unused) {
    (void)unused;
    static uint32_t hash[MOST], face[MOST], key[MOST];
    static float g[MOST];
    static double depth[MOST];
    static uint8_t settled[MOST], ask[MOST];
    for (uint32_t i = 0; i < 3 * 64; i++) {
        const uint32_t dim = 1 + i % 3, odds = i & 64 ? 500 : 3;
        Worker w = {.hash = hash, .settled = settled, .ask = ask};
        AskTile t;
        uint64_t stride = 1;
        for (uint32_t d = 0; d < 3; d++) {
            static const uint32_t most[3] = {37, 21, 9};
            t.n[d] = d < dim ? 2 + word() % (most[d] - 1) : 1, t.stride[d] = stride, stride *= t.n[d];
            t.at_start[d] = word() & 1, t.at_end[d] = word() & 1;
            t.from[d] = t.n[d] > 4 && word() & 1, t.to[d] = t.n[d] > 4 ? t.n[d] - 1 - word() % 2 : t.n[d] - 1;
        }
        for (uint64_t v = 0; v < stride; v++) {
            hash[v] = word() % odds == 0, face[v] = word() % odds == 0, key[v] = word() % odds == 0;
            g[v] = word() % 64 ? (float)(word() % 256) : (float)(word() % 2 ? NAN : INFINITY);
            depth[v] = word() % 64 ? word() % odds == 0 : word() % 2 ? (double)NAN : HUGE_VAL;
            settled[v] = (uint8_t)(word() % odds ? 7 : word() % 8);
        }
        if (i & 4) w.face = face;
        if (i & 8) w.depth = depth;
        if (i & 16) w.near_g = g, w.near_key = key;
        w.finder.proves = i & 32;
        for (uint32_t axis = 0; axis < dim; axis++) check_axis(&w, &t, axis);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_edges)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
