/* What the IR's tests share: a session with a Fn under construction, and calls of the interpreter. */
#ifndef SALTUS_TESTS_IR_TEST_H
#define SALTUS_TESTS_IR_TEST_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "compiler/ir/ir.h"
#include "compiler/pass/pass.h"
#include "saltus/kernel.h"
#include "saltus/status.h"

typedef struct TestFn {
    Session *s;
    Fn *fn;
    Builder b;
} TestFn;

static inline TestFn open_fn(Precision p) {
    TestFn t = {.s = session_create(0)};
    assert_non_null(t.s);
    t.fn = ir_fn(t.s, &t.s->module, "test", p);
    t.b = ir_at_end(t.fn, t.fn->body);
    return t;
}

static inline void close_fn(TestFn *t) { session_destroy(t->s); }

/* Fails with the verifier's text and the function if the Fn is not sound. */
static inline void check_sound(Fn *fn) {
    const char *text;
    if (ir_verify(fn, &fn->session->module, &text)) return;
    fprintf(stderr, "%s\n", text);
    ir_print(fn, stderr);
    fail_msg("the verifier found problems");
}

static inline int run(Fn *fn, SltKernelArgs *args, uint32_t n, uint32_t lanes) {
    if (!args->n_valid) args->n_valid = n;
    return ir_interpret(fn, args, n, lanes);
}

#endif
