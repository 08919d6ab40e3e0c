/* Bounds of random programs such as people write them. Everything there is untagged, so all of it goes through seams.
 *
 *   test-kernels-bounds_random [seeds]    programs of each shape, 40 by default */
#include "tests/kernels/random_boxes.h"
#include "tests/ad/random_program.c"

static Fn *make(Session *s, uint64_t seed, Precision precision, const void *shape) {
    return random_program(s, &s->module, precision, seed, *(const RandomShape *)shape);
}

static void run(uint64_t first, RandomShape shape) { run_job((Job){make, &shape, first}); }

static void straight(void **state) {
    (void)state;
    run(1, (RandomShape){.no_arrays = true, .no_loops = true, .no_ifs = true, .statements = 12});
}
static void ifs(void **state) { (void)state, run(100000, (RandomShape){.no_arrays = true, .no_loops = true}); }
static void loops(void **state) { (void)state, run(200000, (RandomShape){.no_arrays = true}); }
static void all(void **state) { (void)state, run(300000, (RandomShape){0}); }
static void small(void **state) { (void)state, run(400000, (RandomShape){.statements = 3, .depth = 2}); }

int main(int argc, char **argv) {
    if (argc > 1) seeds = strtoull(argv[1], NULL, 10);
    const struct CMUnitTest tests[] = {cmocka_unit_test(straight), cmocka_unit_test(ifs), cmocka_unit_test(loops),
                                       cmocka_unit_test(all), cmocka_unit_test(small)};
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    report();
    return failed;
}
