/* Bounds of random programs over all operations: bits of floats, integers that wrap, NaN and infinities.
 *
 *   test-kernels-bounds_wild [seeds]    programs of each size, 40 by default */
#include "tests/kernels/random_boxes.h"
#include "tests/back/generate.h"

static Fn *make(Session *s, uint64_t seed, Precision precision, const void *size) {
    Fn *fn = gen_fn(s, (Gen){.fma = true, .forward = true}, seed, precision, *(const uint32_t *)size);
    fn->body->last->nargs = fn->channels = 4; /* the floats among its outputs */
    fn->dim = 2;
    ir_name_outputs(fn, SLT_OUT_F);
    return fn;
}

static void run(uint64_t first, uint32_t size) { run_job((Job){make, &size, first}); }

static void small(void **state) { (void)state, run(1, 12); }
static void medium(void **state) { (void)state, run(100000, 40); }
static void large(void **state) { (void)state, run(200000, 160); }

int main(int argc, char **argv) {
    if (argc > 1) seeds = strtoull(argv[1], NULL, 10);
    const struct CMUnitTest tests[] = {cmocka_unit_test(small), cmocka_unit_test(medium), cmocka_unit_test(large)};
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    report();
    return failed;
}
