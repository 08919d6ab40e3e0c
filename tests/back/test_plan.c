/* What the back end decides of a kernel before a target is asked: parts, the forms of if_, frames of the tape. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "compiler/back/core/core.h"

static Target target(const char *name) {
    Target t;
    assert_true(target_named(&t, name));
    return t;
}

/* if (cond) { then: x * x ... } else { ... }, with so many multiplications on each side. */
static Inst *branch(Builder *b, Inst *cond, Inst *x, int then, int other, int64_t hint) {
    Inst *i = ir_if(b, cond);
    i->imm.i = hint;
    const int n[2] = {then, other};
    for (int side = 0; side < 2; side++) {
        Builder in = ir_at_end(b->fn, i->region[side]);
        Inst *v = x;
        for (int k = 0; k < n[side]; k++) v = ir_emit2(&in, OP_fmul, v, v);
        ir_yield(&in, 1, &v);
    }
    ir_proj(b, i, 0);
    return i;
}

static void test_forms(void **state) {
    (void)state;
    Session *s = session_create(0);
    Fn *fn = ir_fn(s, &s->module, "p", PREC_F32);
    Builder b = ir_at_end(fn, fn->body);
    Inst *x = ir_input(&b, IN_X0), *zero = ir_constf(&b, 0), *first = ir_consti(&b, 0);
    Inst *p = ir_special(&b, OP_param, TY_FLT, 1, &first, (Imm){.slot = {0, 1}});
    Inst *varying = ir_emit2(&b, OP_flt, x, zero), *uniform = ir_emit2(&b, OP_flt, p, zero);
    const struct {
        Inst *i;
        IfForm form;
    } cases[] = {
        {branch(&b, uniform, x, 2, 2, 0), IF_PICK},
        {branch(&b, uniform, x, 3, 2, 0), IF_JUMP},
        {branch(&b, varying, x, 2, 2, 0), IF_BLEND},
        {branch(&b, varying, x, 5, 0, 0), IF_THEN_ONLY},
        {branch(&b, varying, x, 0, 5, 0), IF_ELSE_ONLY},
        {branch(&b, varying, x, 4, 4, 0), IF_BLEND}, /* one of two sides runs anyway */
        {branch(&b, varying, x, 5, 4, 0), IF_BOTH},
        {branch(&b, varying, x, 1, 0, IR_IF_RARE), IF_THEN_ONLY},
    };
    ir_yield(&b, 1, &x);
    const Target t = target("sse2");
    Plan plan = back_plan(fn, &t, 8);
    assert_int_equal(plan.L, 4);
    assert_int_equal(plan.P, 2); /* so a blend of 4 operations costs 8 */
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++)
        assert_int_equal(back_if_form(&plan, cases[k].i), cases[k].form);
    assert_true(back_is_vector(&plan, x));
    assert_false(back_is_vector(&plan, p));

    plan = back_plan(fn, &t, 1); /* one lane: every condition is that lane's own */
    assert_int_equal(back_if_form(&plan, cases[3].i), IF_JUMP);
    assert_false(back_is_vector(&plan, x));
    session_destroy(s);
}

static void test_pairs_need_two_lanes(void **state) {
    (void)state;
    Session *s = session_create(0);
    Fn *fn = ir_fn(s, &s->module, "p", PREC_F64);
    Builder b = ir_at_end(fn, fn->body);
    Inst *x = ir_input(&b, IN_X0), *other = ir_special(&b, OP_partner, TY_FLT, 1, &x, (Imm){0});
    ir_yield(&b, 1, &other);
    const Target t = target("avx2");
    Plan plan = back_plan(fn, &t, 1);
    assert_int_equal(plan.W, 2);
    plan = back_plan(fn, &t, 16);
    assert_int_equal(plan.L, 4);
    assert_int_equal(plan.P, 4);
    session_destroy(s);
}

/* Whole vectors first, then words, then bits: no value straddles its alignment. */
static void test_frames(void **state) {
    (void)state;
    Session *s = session_create(0);
    Fn *fn = ir_fn(s, &s->module, "p", PREC_F32);
    Builder b = ir_at_end(fn, fn->body);
    Inst *x = ir_input(&b, IN_X0);
    Inst *values[4] = {ir_emit2(&b, OP_flt, x, ir_constf(&b, 0)), ir_consti(&b, 7), x, ir_constb(&b, true)};
    ir_special(&b, OP_tapepush, TY_VOID, 4, values, (Imm){0});
    ir_yield(&b, 1, &x);
    const Target t = target("avx2");
    Plan plan = back_plan(fn, &t, 16);
    const FrameClass *c = back_frame_class(&plan.frames, &s->scratch, 4, values);
    assert_int_equal(plan.frames.len, 1);
    assert_false(c->masked); /* every lane pushes */
    assert_int_equal(c->offset[2], 0);
    assert_int_equal(c->offset[1], 64);
    assert_int_equal(c->offset[0], 68); /* two parts of 8 lanes: a byte each */
    assert_int_equal(c->offset[3], 70);
    assert_int_equal(c->bytes, 128);
    session_destroy(s);
}

static void test_width(void **state) {
    (void)state;
    Session *s = session_create(0);
    const char *why = NULL;
    for (uint32_t w = 1; w <= BACK_MAX_WIDTH; w *= 2) assert_int_equal(back_check_width(s, w, &why), 0);
    assert_null(why);
    assert_int_equal(back_check_width(s, 0, &why), 0); /* to be chosen */
    assert_int_not_equal(back_check_width(s, 12, &why), 0);
    assert_int_not_equal(back_check_width(s, 2 * BACK_MAX_WIDTH, &why), 0);
    assert_non_null(why);
    session_destroy(s);
}

/* The nearest of many points, by a loop of which lanes take `work` multiplications where a branch says so; leaves: it
 * ends for a lane then. */
static Fn *nearest(Session *s, int work, bool leaves) {
    Fn *fn = ir_fn(s, &s->module, "p", PREC_F32);
    Builder b = ir_at_end(fn, fn->body);
    Inst *x = ir_input(&b, IN_X0), *y = ir_input(&b, IN_X1), *best = ir_constf(&b, 1e30);
    Inst *loop = ir_loop(&b, 1, &best, (LoopInfo){.max_iters = 64});
    Builder in = ir_at_end(fn, loop->region[0]);
    Inst *p = ir_special(&in, OP_param, TY_FLT, 1, &loop->region[0]->params[0], (Imm){.slot = {0, 64}});
    Inst *dx = ir_emit2(&in, OP_fsub, x, p), *dy = ir_emit2(&in, OP_fsub, y, p);
    Inst *d = ir_emit3(&in, OP_ffma, dx, dx, ir_emit2(&in, OP_fmul, dy, dy)), *was = loop->region[0]->params[1];
    Inst *less = ir_emit2(&in, OP_flt, d, was), *i = ir_if(&in, less), *v = d;
    Builder t = ir_at_end(fn, i->region[0]), e = ir_at_end(fn, i->region[1]);
    for (int k = 0; k < work; k++) v = ir_emit2(&t, OP_fmul, v, v);
    ir_yield(&t, 1, &v);
    ir_yield(&e, 1, &was);
    Inst *yield[2] = {leaves ? ir_emit1(&in, OP_bnot, less) : ir_constb(&in, true), ir_proj(&in, i, 0)};
    ir_yield(&in, 2, yield);
    Inst *out = ir_proj(&b, loop, 0);
    ir_yield(&b, 1, &out);
    return fn;
}

/* A row shares y: it is worth it where it saves more than branches go around, of which squares take fewer. */
static void test_rows(void **state) {
    (void)state;
    Session *s = session_create(0);
    const Target t = target("avx512");
    const struct {
        int work;
        bool leaves, row;
    } cases[] = {{0, false, true}, {2, false, true}, {3, false, false}, {40, false, false}, {0, true, false}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        Fn *fn = nearest(s, cases[k].work, cases[k].leaves);
        back_share_row(fn, &t, 64);
        assert_int_equal(fn->same != 0, cases[k].row);
        Plan plan = back_plan(fn, &t, 64);
        const Inst *x = fn->body->first, *y = x->next;
        assert_true(back_is_vector(&plan, x));
        assert_int_equal(back_is_vector(&plan, y), !cases[k].row);
    }
    session_destroy(s);
}

/* A loop of n iterations that stores element k of a, or reads it first. */
static void fill(Builder *b, Inst *a, uint32_t n, bool reads) {
    Inst *loop = ir_loop(b, 0, NULL, (LoopInfo){.max_iters = n, .exact = true});
    Builder in = ir_at_end(b->fn, loop->region[0]);
    Inst *k = loop->region[0]->params[0], *load[2] = {a, k};
    Inst *v = reads ? ir_special(&in, OP_load, TY_FLT, 2, load, (Imm){0}) : ir_constf(&in, 2), *store[3] = {a, k, v};
    ir_special(&in, OP_store, TY_VOID, 3, store, (Imm){0});
    Inst *more = ir_emit2(&in, OP_ilt, k, ir_consti(&in, (int32_t)n - 1));
    ir_yield(&in, 1, &more);
}

static void store_at(Builder *b, Inst *a, int32_t at) {
    Inst *store[3] = {a, ir_consti(b, at), ir_constf(b, 3)};
    ir_special(b, OP_store, TY_VOID, 3, store, (Imm){0});
}

static void test_zeros(void **state) {
    (void)state;
    Session *s = session_create(0);
    Fn *fn = ir_fn(s, &s->module, "f", PREC_F32);
    Builder b = ir_at_end(fn, fn->body);
    Inst *a[6];
    for (int k = 0; k < 6; k++) a[k] = ir_special(&b, OP_alloc, TY_ARRAY, 0, NULL, (Imm){.arr = {3, TY_FLT}});
    fill(&b, a[0], 3, false);
    fill(&b, a[1], 2, false); /* not the last */
    fill(&b, a[2], 3, true);
    for (int k = 2; k >= 0; k--) store_at(&b, a[3], k);
    for (int k = 0; k < 3; k++) store_at(&b, a[4], k % 2);
    Inst *load[2] = {a[5], ir_consti(&b, 0)}, *out = ir_special(&b, OP_load, TY_FLT, 2, load, (Imm){0});
    fill(&b, a[5], 3, false); /* too late */
    ir_yield(&b, 1, &out);
    static const bool needs[6] = {false, true, true, false, true, true};
    for (int k = 0; k < 6; k++) assert_int_equal(back_needs_zeros(a[k]), needs[k]);
    session_destroy(s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_forms),  cmocka_unit_test(test_pairs_need_two_lanes),
        cmocka_unit_test(test_frames), cmocka_unit_test(test_width),
        cmocka_unit_test(test_rows),   cmocka_unit_test(test_zeros),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
