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

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(foretold_too_few)};
    return cmocka_run_group_tests_name("effort", tests, NULL, NULL);
}
