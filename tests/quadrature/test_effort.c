/* What ends sweeps of which nobody said how many evaluations they may have. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include "runtime/quadrature/effort.h"

/* Boxes foretold a quarter of the cells that there are. The first sweep has ended by itself and errs by twice what is
 * wanted: the next one is paid for, and nothing was limited. */
static void foretold_too_few(void **state) {
    (void)state;
    static const double cost = 1.2e7, scale = 0.05;
    SltScene s = {.dim = 2, .f64 = true};
    SltJob job = SLT_JOB_INIT;
    job.integral = true, job.error = 1e-3;
    for (int given = 0; given < 2; given++) {
        job.max_evaluations = given ? (uint64_t)(1.5 * cost) : 0;
        Run r = {.s = &s, .j = &job};
        Sweep p = {.run = &r};
        Effort e;
        SltStop stop;
        effort_begin(&e, &r, 1e6, (Outlook){.cells = 5e4, .side = 0x1p-6});
        effort_apply(&e, &p, 0);
        assert_true(effort_took(&e, 2e-3 * scale, 0));
        bool more = effort_more(&e, &p, 2e-3 * scale, 0, scale, (uint64_t)cost, (uint64_t)cost, &stop);
        assert_int_equal(more, !given);
        if (given) assert_int_equal(stop, SLT_STOP_EVALUATIONS);
        effort_apply(&e, &p, (uint64_t)cost);
        if (!given) assert_true((double)p.budget > 2.25 * cost);
    }
}

/* Discs that are smaller than a few of the usual cells, to a coarse error: cells stop far below their size. Searching
 * cells of which each holds several was five times as dear as cutting them (20 000 discs of .001 to .004 to 1e-3). */
static void cut_before_searched(void **state) {
    (void)state;
    static const double side = 0x1p-6;
    for (uint32_t dim = 2; dim <= 3; dim++) {
        SltScene s = {.dim = dim, .f64 = true};
        SltJob job = SLT_JOB_INIT;
        job.integral = true, job.error = 1e-3;
        Run r = {.s = &s, .j = &job};
        Effort e;
        effort_begin(&e, &r, 1e6, (Outlook){.cells = 5e4, .side = side});
        if (dim == 2) assert_true(e.least <= 0x1p-5 * side);
        else assert_true(e.least > 0x1p-5 * side); /* along surfaces they would be many */
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(foretold_too_few), cmocka_unit_test(cut_before_searched)};
    return cmocka_run_group_tests_name("effort", tests, NULL, NULL);
}
