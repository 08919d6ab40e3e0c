/* A program's integral and derivatives by quadrature to an error, through the library. */
#ifndef SALTUS_TESTS_QUADRATURE_INTEGRATE_H
#define SALTUS_TESTS_QUADRATURE_INTEGRATE_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "saltus/saltus.h"

enum { INTEGRATE_PARAMETERS = 8 };
typedef struct Result {
    double value, value_error, g[INTEGRATE_PARAMETERS], error[INTEGRATE_PARAMETERS];
    uint32_t n; /* parameters */
    SltStats stats;
} Result;

static inline Result integrate(const char *name, const char *source, bool f64, double error) {
    SltOptions o = SLT_OPTIONS_INIT;
    o.f64 = f64;
    SltProgram *p = NULL;
    if (slt_compile_string(source, name, &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
    Result r = {.n = slt_float_count(p), .stats = SLT_STATS_INIT};
    assert_true(r.n <= INTEGRATE_PARAMETERS);
    SltJob job = SLT_JOB_INIT;
    job.integral = true, job.estimator = SLT_EST_QUADRATURE, job.error = error;
    SltIntegral out = {.struct_size = sizeof out,
                       .value = &r.value,
                       .value_stderr = &r.value_error,
                       .gradient = r.g,
                       .gradient_stderr = r.error};
    SltError err = {0};
    if (slt_grad_integral(p, &job, &out, &r.stats, &err) != SLT_OK) fail_msg("%s", err.text);
    slt_program_free(p);
    return r;
}

#endif
