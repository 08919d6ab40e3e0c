/* Keys are sorted whatever their number, their bits and their order. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/finder.h"

static uint32_t state = 1;
static uint32_t word(void) { return state = state * 1664525u + 1013904223u, state ^ state >> 15; }

static int ascending(const void *a, const void *b) {
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

static void test_sorted(void **unused) {
    (void)unused;
    enum { MOST = 5000 };
    static uint64_t keys[MOST], want[MOST];
    for (uint32_t i = 0; i < 400; i++) {
        const uint32_t n = i < 100 ? i : word() % MOST, few = 1 + word() % 9;
        for (uint32_t k = 0; k < n; k++) switch (i % 4) {
            case 0: keys[k] = (uint64_t)word() << 32 | word(); break;             /* any */
            case 1: keys[k] = (uint64_t)(word() % few) << 32 | k; break;          /* numbered, of few sites */
            case 2: keys[k] = (uint64_t)(word() % few) << 40 | word() % 7; break; /* many are equal */
            case 3: keys[k] = (uint64_t)(n - k) << 56; break;
            }
        memcpy(want, keys, n * sizeof *keys);
        qsort(want, n, sizeof *want, ascending);
        sort_keys(keys, n);
        assert_memory_equal(keys, want, n * sizeof *keys);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_sorted)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
