/* What the tests of the standard library share: a program made of one module and an expression,
 * evaluated and differentiated at points that are parameters, so that a value is exactly f(p) and
 * not a mean over a pixel. */
#ifndef TESTS_STDLIB_FIXTURE_H
#define TESTS_STDLIB_FIXTURE_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/saltus.h"

/* Compiles in binary64 against the source tree's library; fails the test with the diagnostics. The
 * caller frees. */
static inline SltProgram *compile(const char *source, const char *entry) {
    SltOptions opt = SLT_OPTIONS_INIT;
    opt.stdlib_dir = SALTUS_STDLIB_BUILD;
    opt.entry = entry;
    opt.f64 = true;
    SltProgram *p = NULL;
    SltStatus s = slt_compile_string(source, "test.salt", &opt, &p);
    if (s != SLT_OK) fail_msg("%s\n%s%s", source, slt_diagnostics_text(p), slt_last_error(p));
    /* The library must not warn; that a site depends on parameters only is these programs' own
     * doing. */
    for (uint32_t i = 0; i < slt_diagnostic_count(p); i++) {
        SltDiagnostic d = SLT_DIAGNOSTIC_INIT;
        if (slt_diagnostic(p, i, &d) && strcmp(d.code, "W0402") != 0)
            fail_msg("%s\n%s", source, slt_diagnostics_text(p));
    }
    return p;
}

/* Value [channels] and gradient [channels][floats] of a program that does not look at x. */
static inline void evaluate(SltProgram *p, double *value, double *gradient) {
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    job.integral = true, job.samples = 64, job.threads = 1, job.no_boundary = true;
    SltIntegral out = {.struct_size = sizeof out, .value = value, .gradient = gradient};
    if (slt_grad_integral(p, &job, &out, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
}

/* A fixed stream in [0, 1). */
static inline double uniform(uint32_t *state) {
    *state = *state * 1664525u + 1013904223u;
    return (double)(*state >> 8) / 16777216.0;
}

static inline void set(SltProgram *p, const char *name, const double *v) {
    SltParam q = SLT_PARAM_INIT;
    SltError err = {0};
    if (slt_param_find(p, name, &q, &err) != SLT_OK || slt_set_floats(p, q.fbase, q.fcount, v, &err) != SLT_OK)
        fail_msg("%s", err.text);
}

static inline uint32_t base_of(SltProgram *p, const char *name) {
    SltParam q = SLT_PARAM_INIT;
    SltError err = {0};
    if (slt_param_find(p, name, &q, &err) != SLT_OK) fail_msg("%s", err.text);
    return q.fbase;
}

#endif
