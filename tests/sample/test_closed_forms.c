/* The lattice against closed forms, f32 and f64, with fixed seeds. The tolerance is a relative one on the largest
 * component (stated per case), or four reported standard errors if that is more. */
#include "tests/sample/closed_forms.h"

static void run(const Case *c, bool f64) {
    SltJob job = SLT_JOB_INIT;
    job.integral = true, job.samples = 1u << 18, job.seed = 5, job.threads = 2, job.estimator = SLT_EST_LATTICE;
    run_case(c, &job, f64, c->tolerance > 0 ? c->tolerance : 0.005, 4);
}
static void run_f32(void **state) { run(*state, false); }
static void run_f64(void **state) { run(*state, true); }

int main(void) {
    make_cases();
    static struct CMUnitTest tests[128];
    int n = 0;
    static char names[128][96];
    for (int i = 0; i < ncases; i++)
        for (int f64 = 0; f64 < 2; f64++) {
            if (cases[i].f64_only && !f64) continue;
            snprintf(names[n], sizeof names[n], "%s, %s", cases[i].name, f64 ? "f64" : "f32");
            tests[n] = (struct CMUnitTest){names[n], f64 ? run_f64 : run_f32, NULL, NULL, &cases[i]};
            n++;
        }
    return _cmocka_run_group_tests("closed forms", tests, (size_t)n, NULL, NULL);
}
