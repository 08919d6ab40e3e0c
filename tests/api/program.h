/* What the tests of the library share: a program from a string, through public headers alone. */
#ifndef SALTUS_TESTS_API_PROGRAM_H
#define SALTUS_TESTS_API_PROGRAM_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/saltus.h"

static inline SltProgram *compile_with(const char *source, SltOptions opt) {
    SltProgram *p;
    opt.stdlib_dir = SALTUS_STDLIB_BUILD, opt.no_cache = true;
    if (slt_compile_string(source, "t.salt", &opt, &p) != SLT_OK)
        fail_msg("%s%s", slt_diagnostics_text(p), slt_last_error(p));
    return p;
}

static inline SltProgram *compile(const char *source) { return compile_with(source, SLT_OPTIONS_INIT); }

static inline SltParam param(const SltProgram *p, const char *name) {
    SltParam q = SLT_PARAM_INIT;
    SltError err;
    if (slt_param_find(p, name, &q, &err) != SLT_OK) fail_msg("%s", err.text);
    return q;
}

#define assert_ok(call)                                                                                                \
    do {                                                                                                               \
        err = (SltError){0};                                                                                           \
        if ((call) != SLT_OK) fail_msg("%s: %s", #call, err.text);                                                     \
    } while (0)

#endif
