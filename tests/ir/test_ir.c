/* Builder, verifier, and the text form with its parser. */
#include "tests/ir/ir_test.h"

/* A program with every structured operation, sites, arrays and the tape: what the text form must carry. */
static Fn *everything(TestFn *t, Precision p) {
    *t = open_fn(p);
    Fn *fn = t->fn;
    Builder *b = &t->b;
    fn->dim = 3;
    fn->channels = 2;
    fn->nfloats = 7;
    fn->nints = 2;
    fn->sites = ARENA_ARRAY(fn->arena, SiteInfo, 2);
    fn->nsites = 2;
    fn->sites[0] =
        (SiteInfo){.kind = SITE_COMPARE, .depth = 1, .max_events = 12, .path = "main > \"f\"", .text = "d < 0"};
    fn->sites[1] = (SiteInfo){
        .kind = SITE_FLOOR, .depth = 0, .max_events = 1, .skip_loop = true, .path = "main", .text = "a\\b\n"};
    fn->outputs = ARENA_ARRAY(fn->arena, Output, 3);
    fn->outputs[0] = (Output){SLT_OUT_F, 0}, fn->outputs[1] = (Output){SLT_OUT_HASH, 0},
    fn->outputs[2] = (Output){SLT_OUT_K, 7};
    Inst *x = ir_input(b, IN_X0), *zero = ir_consti(b, 0), *one = ir_consti(b, 1);
    Inst *theta = ir_special(b, OP_param, TY_FLT, 1, &zero, (Imm){.slot = {2, 5}});
    Inst *array = ir_special(b, OP_alloc, TY_ARRAY, 0, NULL, (Imm){.arr = {4, TY_FLT}});
    Inst *copy = ir_special(b, OP_alloc, TY_ARRAY, 0, NULL, (Imm){.arr = {4, TY_FLT}});
    ir_special(b, OP_store, TY_VOID, 3, (Inst *[]){array, one, theta}, (Imm){0});
    ir_special(b, OP_acopy, TY_VOID, 2, (Inst *[]){copy, array}, (Imm){0});
    Inst *mark = ir_special(b, OP_tapemark, TY_TAPE, 0, NULL, (Imm){0});
    Inst *loop =
        ir_loop(b, 2, (Inst *[]){x, zero},
                (LoopInfo){.max_iters = 12, .exact = true, .told = true, .cull = true, .cull_id = 3, .loop_id = 9});
    Block *body = loop->region[0];
    Builder in = ir_at_end(fn, body);
    ir_special(&in, OP_tapepush, TY_VOID, 2, (Inst *[]){body->params[1], body->params[0]}, (Imm){0});
    Inst *cmp = ir_emit2(&in, OP_flt, body->params[1], theta);
    Inst *site = ir_special(&in, OP_site, TY_BOOL, 3, (Inst *[]){cmp, body->params[1], body->params[0]}, (Imm){.i = 0});
    Inst *cond = ir_if(&in, site);
    Builder arm = ir_at_end(fn, cond->region[0]);
    Inst *up = ir_emit2(&arm, OP_fadd, body->params[1], ir_constf(&arm, 0.1));
    ir_yield(&arm, 2, (Inst *[]){up, one});
    arm = ir_at_end(fn, cond->region[1]);
    ir_yield(&arm, 2, (Inst *[]){body->params[1], zero});
    ir_special(&in, OP_note, TY_VOID, 2, (Inst *[]){site, cmp}, (Imm){.i = 3});
    Inst *next = ir_proj(&in, cond, 0), *flag = ir_proj(&in, cond, 1);
    Inst *count = ir_emit2(&in, OP_iadd, body->params[2], flag);
    Inst *more = ir_emit2(&in, OP_ilt, count, ir_consti(&in, 9));
    ir_yield(&in, 3, (Inst *[]){more, next, count});
    Inst *total = ir_proj(b, loop, 1), *last = ir_proj(b, loop, 0);
    Inst *rev = ir_special(b, OP_revloop, TY_VOID, 2, (Inst *[]){mark, last}, (Imm){0});
    Block *back = ir_block(fn, rev);
    Inst *saved = ir_block_param(fn, back, TY_FLT), *k = ir_block_param(fn, back, TY_INT),
         *carried = ir_block_param(fn, back, TY_FLT);
    in = ir_at_end(fn, back);
    ir_special(&in, OP_adj, TY_VOID, 2, (Inst *[]){k, saved}, (Imm){.slot = {0, 7}});
    Inst *sum = ir_emit2(&in, OP_fadd, carried, saved);
    ir_yield(&in, 1, &sum);
    Inst *custom = ir_special(b, OP_custom, TY_VOID, 1, (Inst *[]){ir_proj(b, rev, 0)}, (Imm){0});
    Block *primal = ir_block(fn, custom), *tangent = ir_block(fn, custom);
    Inst *a = ir_block_param(fn, primal, TY_FLT);
    in = ir_at_end(fn, primal);
    Inst *sine = ir_emit1(&in, OP_fsin, a);
    ir_yield(&in, 1, &sine);
    ir_block_param(fn, tangent, TY_FLT);
    Inst *da = ir_block_param(fn, tangent, TY_FLT);
    in = ir_at_end(fn, tangent);
    ir_yield(&in, 1, &da);
    Inst *floor = ir_emit1(b, OP_ffloor, ir_proj(b, custom, 0));
    Inst *n = ir_special(b, OP_siten, TY_FLT, 2, (Inst *[]){floor, last}, (Imm){.i = 1});
    Inst *inf = ir_constf(b, INFINITY), *bad = ir_constf(b, NAN);
    Inst *r = ir_emit3(b, OP_ffma, n, inf, bad);
    Inst *on = ir_constb(b, true);
    ir_special(b, OP_count, TY_VOID, 1, &on, (Imm){.i = COUNTER_ASSERT});
    ir_special(b, OP_print, TY_VOID, 2, (Inst *[]){r, total}, (Imm){.text = {"r = {}\n\"{}\"", 12}});
    Inst *other = ir_special(b, OP_partner, TY_INT, 1, &total, (Imm){0});
    Inst *both = ir_special(b, OP_both, TY_BOOL, 0, NULL, (Imm){0});
    ir_yield(b, 3, (Inst *[]){r, other, both});
    check_sound(fn);
    return fn;
}

static void test_round_trip(void **state) {
    (void)state;
    for (int p = PREC_F32; p <= PREC_F64; p++) {
        TestFn t;
        Fn *fn = everything(&t, (Precision)p);
        char *text = ir_print_string(fn, &t.s->module);
        Fn *again = ir_parse(t.s, &t.s->module, session_add_text(t.s, "<ir>", ".", text, strlen(text)));
        if (!again) diag_print_text(t.s, stderr, false);
        assert_non_null(again);
        assert_string_equal(text, ir_print_string(again, &t.s->module));
        assert_int_equal(again->nsites, 2);
        assert_string_equal(again->sites[1].text, "a\\b\n");
        assert_true(again->sites[1].skip_loop);
        Fn *clone = ir_clone(fn, &t.s->module, "test");
        check_sound(clone);
        assert_string_equal(text, ir_print_string(clone, &t.s->module));
        close_fn(&t);
    }
}

/* Damaged text is an error with a place, or a sound function: never a crash. */
/* Of an initialised union a compiler may leave what lies behind the member as it was; imms compare with memcmp. */
static void test_whole_imms(void **state) {
    (void)state;
    TestFn t = open_fn(PREC_F32);
    Inst *zero = ir_consti(&t.b, 0), *made[2];
    for (int k = 0; k < 2; k++) {
        Imm imm;
        memset(&imm, k ? 0xaa : 0, sizeof imm);
        imm.slot.base = 0, imm.slot.count = 1;
        made[k] = ir_special(&t.b, OP_param, TY_FLT, 1, &zero, imm);
    }
    assert_memory_equal(&made[0]->imm, &made[1]->imm, sizeof(Imm));
    close_fn(&t);
}

static void test_parse_garbage(void **state) {
    (void)state;
    TestFn t;
    Fn *fn = everything(&t, PREC_F32);
    char *text = ir_print_string(fn, &t.s->module);
    size_t len = strlen(text);
    uint64_t seed = 99;
    unsigned accepted = 0, refused = 0;
    char *damaged = malloc(len + 1);
    for (int round = 0; round < 1500; round++) {
        memcpy(damaged, text, len + 1);
        size_t n = len;
        for (int k = 0; k < 1 + round % 3; k++) {
            seed = seed * 6364136223846793005u + 1442695040888963407u;
            size_t at = (size_t)(seed >> 33) % n;
            switch ((seed >> 20) % 3) {
            case 0: damaged[at] = "%{}()0123,:#abfitx\"\\ ;="[(seed >> 40) % 23]; break;
            case 1: memmove(damaged + at, damaged + at + 1, n-- - at); break;
            default: n = (seed >> 25) % 40 ? n : at + 1; damaged[n] = 0;
            }
        }
        Session *s = session_create(0);
        Fn *got = ir_parse(s, &s->module, session_add_text(s, "<ir>", ".", damaged, n));
        if (got) {
            accepted++;
            check_sound(got);
        } else {
            refused++;
            assert_true(s->nerrors > 0);
        }
        session_destroy(s);
    }
    free(damaged);
    close_fn(&t);
    assert_true(accepted > 20 && refused > 500);
}

static void test_parse_errors(void **state) {
    (void)state;
    const struct {
        const char *text, *says;
        uint32_t pos;
    } cases[] = {
        {"", "expected fn", 0},
        {"fn \"a\" f16", "f32 or f64", 7},
        {"fn \"a\" f32 dim 1 channels 1 floats 0 ints 0 { %0 = nosuch }", "an operation", 51},
        {"fn \"a\" f32 dim 1 channels 1 floats 0 ints 0 { %0 = fneg %1 }", "defined above", 56},
        {"fn \"a\" f32 dim 1 channels 1 floats 0 ints 0 { %0 = consti 3000000000 }", "in range", 58},
        {"fn \"a\" f32 dim 1 channels 1 floats 0 ints 0 { %0 = consti 3 %1 = fneg %0 yield %1 }", "operand 0 is int",
         0},
        {"fn \"a\" f32 dim 1 channels 1 floats 0 ints 0 { %0 = constb true }", "without a yield", 0},
    };
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        Session *s = session_create(0);
        assert_null(ir_parse(s, &s->module, session_add_text(s, "<ir>", ".", cases[k].text, strlen(cases[k].text))));
        assert_int_equal(s->nerrors, 1);
        if (!strstr(s->diags->text, cases[k].says)) fail_msg("'%s' does not say '%s'", s->diags->text, cases[k].says);
        assert_int_equal(s->diags->span.pos, cases[k].pos);
        session_destroy(s);
    }
}

static void expect_problem(Fn *fn, const char *says) {
    const char *text = "";
    assert_false(ir_verify(fn, &fn->session->module, &text));
    if (!strstr(text, says)) fail_msg("the verifier says '%s', not '%s'", text, says);
}

static Inst *find(Block *b, Op op) {
    for (Inst *i = b->first; i; i = i->next) {
        if (i->op == op) return i;
        for (uint32_t r = 0; r < i->nregions; r++) {
            Inst *inner = find(i->region[r], op);
            if (inner) return inner;
        }
    }
    return NULL;
}

/* Each kind of damage to a sound function is found. */
static void test_verifier(void **state) {
    (void)state;
#define DAMAGE(says, ...)                                                                                              \
    do {                                                                                                               \
        TestFn t;                                                                                                      \
        Fn *fn = everything(&t, PREC_F32);                                                                             \
        __VA_ARGS__;                                                                                                   \
        expect_problem(fn, says);                                                                                      \
        close_fn(&t);                                                                                                  \
    } while (0)
    DAMAGE("operand 0 is bool, not float", find(fn->body, OP_ffloor)->args[0] = find(fn->body, OP_constb));
    DAMAGE("is not defined before this", find(fn->body, OP_ffloor)->args[0] = find(fn->body, OP_siten));
    DAMAGE("is not defined before this",
           find(fn->body, OP_siten)->args[1] = find(fn->body, OP_loop)->region[0]->params[1]);
    TestFn stranger;
    everything(&stranger, PREC_F32);
    DAMAGE("is not in the function", find(fn->body, OP_ffloor)->args[0] = find(stranger.fn->body, OP_input));
    close_fn(&stranger);
    DAMAGE("region 1 yields 1 values, not 2", find(fn->body, OP_if_)->region[1]->last->nargs = 1);
    DAMAGE("yields int as value 0, not float",
           find(fn->body, OP_if_)->region[1]->last->args[0] = find(fn->body, OP_consti));
    DAMAGE("site outside the 2 sites", find(fn->body, OP_site)->imm.i = 2);
    DAMAGE("1 loop indices at a site of depth 2", fn->sites[0].depth = 2);
    DAMAGE("slot outside the 7 parameters", find(fn->body, OP_param)->imm.slot.count = 6);
    DAMAGE("without a yield", ir_unlink(fn->body->last));
    DAMAGE("no bound on the iterations", find(fn->body, OP_loop)->imm.loop.max_iters = 0);
    DAMAGE("region 0 has 3 parameters, not 2", find(fn->body, OP_loop)->nargs = 1);
    DAMAGE("a projection must stand behind", {
        Inst *custom = find(fn->body, OP_custom);
        Builder end = ir_at_end(fn, fn->body);
        ir_special(&end, OP_proj, TY_FLT, 1, &custom, (Imm){0});
    });
    DAMAGE("no tapepush makes frames", ir_unlink(find(fn->body, OP_tapepush)));
    DAMAGE("the list is broken", find(fn->body, OP_param)->prev = NULL);
    DAMAGE("stands not in the body of the loop with its list", find(fn->body, OP_note)->imm.i = 2);
    DAMAGE("list outside the 64", find(fn->body, OP_loop)->imm.loop.cull_id = 64);
    DAMAGE("no such counter", find(fn->body, OP_count)->imm.i = 77);
    DAMAGE("arrays of different shapes", find(fn->body, OP_alloc)->imm.arr.count = 5);
    DAMAGE("the result is int, not float", find(fn->body, OP_ffma)->type = TY_INT);
    DAMAGE("operand 2 is missing", find(fn->body, OP_ffma)->args[2] = NULL);
}

/* However many problems there are, each is listed, and whole. */
static void test_report(void **state) {
    (void)state;
    TestFn t = open_fn(PREC_F32);
    Inst *x = ir_input(&t.b, IN_X0), *no = ir_constb(&t.b, false);
    for (int k = 0; k < 200; k++) ir_emit1(&t.b, OP_fneg, x)->args[0] = no;
    char text[600];
    memset(text, 'a', sizeof text);
    ir_special(&t.b, OP_print, TY_INT, 0, NULL, (Imm){.text = {text, sizeof text}});
    ir_yield(&t.b, 1, &x);
    const char *report = "";
    assert_false(ir_verify(t.fn, &t.s->module, &report));
    size_t lines = 0;
    for (const char *c = report; *c; c++) lines += *c == '\n';
    assert_int_equal(lines, 201);
    text[sizeof text - 1] = 0;
    assert_non_null(strstr(report, text));
    close_fn(&t);
}

static void test_proj_order(void **state) {
    (void)state;
    TestFn t = open_fn(PREC_F32);
    Inst *on = ir_constb(&t.b, true), *x = ir_input(&t.b, IN_X0), *n = ir_input(&t.b, IN_SAMPLE);
    Inst *cond = ir_if(&t.b, on);
    for (int r = 0; r < 2; r++) {
        Builder in = ir_at_end(t.fn, cond->region[r]);
        ir_yield(&in, 3, (Inst *[]){x, n, on});
    }
    Inst *p2 = ir_proj(&t.b, cond, 2), *p0 = ir_proj(&t.b, cond, 0);
    ir_emit1(&t.b, OP_fneg, p0);
    Inst *p1 = ir_proj(&t.b, cond, 1);
    assert_ptr_equal(ir_proj(&t.b, cond, 2), p2);
    assert_ptr_equal(cond->next, p0);
    assert_ptr_equal(p0->next, p1);
    assert_ptr_equal(p1->next, p2);
    assert_int_equal(p1->type, TY_INT);
    Builder after = ir_after(t.fn, cond);
    assert_ptr_equal(after.before, p2->next);
    ir_yield(&t.b, 1, &p0);
    check_sound(t.fn);
    close_fn(&t);
}

/* Folding in the builder: value, and that exactly the documented liberties are taken. */
static void test_builder_fold(void **state) {
    (void)state;
    TestFn t = open_fn(PREC_F32);
    Builder *b = &t.b;
    b->fold = true;
    Inst *x = ir_input(b, IN_X0), *y = ir_input(b, IN_X1), *n = ir_input(b, IN_SAMPLE);
    Inst *zero = ir_constf(b, 0), *minus = ir_constf(b, -0.0), *one = ir_constf(b, 1), *two = ir_constf(b, 2);
    Inst *on = ir_constb(b, true), *off = ir_constb(b, false);
    Inst *less = ir_emit2(b, OP_flt, x, y);
    assert_ptr_equal(ir_emit2(b, OP_fadd, x, zero), x);
    assert_ptr_equal(ir_emit2(b, OP_fadd, minus, x), x);
    assert_ptr_equal(ir_emit2(b, OP_fmul, one, x), x);
    assert_int_equal(ir_emit2(b, OP_fmul, x, zero)->op, OP_fmul); /* may be NaN */
    assert_int_equal(ir_emit2(b, OP_zmul, two, x)->op, OP_fmul);
    assert_int_equal(ir_emit2(b, OP_zmul, x, y)->op, OP_zmul);
    assert_true(ir_emit2(b, OP_zmul, zero, x)->imm.f == 0);
    assert_int_equal(ir_emit2(b, OP_zdiv, x, two)->op, OP_fdiv);
    assert_true(ir_emit2(b, OP_fdiv, one, ir_constf(b, 3))->imm.f == (double)(1.0f / 3.0f));
    assert_int_equal(ir_emit1(b, OP_fexp, one)->op, OP_fexp); /* MATH rows only after lower_math */
    assert_ptr_equal(ir_select(b, on, x, y), x);
    assert_ptr_equal(ir_select(b, less, x, x), x);
    assert_ptr_equal(ir_select(b, less, on, off), less);
    Inst *first = ir_select(b, less, x, y), *again = ir_select(b, less, first, two);
    assert_true(again->args[1] == x && again->args[2] == two); /* the same question twice */
    assert_ptr_equal(ir_select(b, less, x, first), first);
    assert_ptr_equal(ir_select(b, less, two, first)->args[2], y);
    assert_ptr_equal(ir_emit2(b, OP_band, less, on), less);
    assert_ptr_equal(ir_emit2(b, OP_bor, less, on), on);
    assert_int_equal(ir_emit2(b, OP_bxor, on, less)->op, OP_bnot);
    assert_ptr_equal(ir_emit1(b, OP_bnot, ir_emit1(b, OP_bnot, less)), less);
    assert_ptr_equal(ir_emit2(b, OP_imul, n, ir_consti(b, 1)), n);
    assert_int_equal(ir_emit2(b, OP_ixor, n, n)->imm.i, 0);
    assert_int_equal(ir_emit2(b, OP_idiv, ir_consti(b, INT32_MIN), ir_consti(b, -1))->imm.i, INT32_MIN);
    assert_int_equal(ir_emit2(b, OP_ishl, ir_consti(b, 1), ir_consti(b, 33))->imm.i, 2);
    b->fold = false;
    assert_int_equal(ir_emit2(b, OP_fadd, x, zero)->op, OP_fadd);
    ir_yield(b, 1, &x);
    check_sound(t.fn);
    close_fn(&t);
}

static void test_lower_custom(void **state) {
    (void)state;
    TestFn t;
    Fn *fn = everything(&t, PREC_F64);
    PassCtx ctx = {.session = t.s, .has_fma = true};
    assert_true(lower_custom(&ctx, fn));
    assert_null(find(fn->body, OP_custom));
    check_sound(fn);
    assert_int_equal(find(fn->body, OP_ffloor)->args[0]->op, OP_fsin);
    assert_false(lower_custom(&ctx, fn));
    close_fn(&t);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_round_trip),   cmocka_unit_test(test_whole_imms),   cmocka_unit_test(test_parse_garbage),
        cmocka_unit_test(test_parse_errors), cmocka_unit_test(test_verifier),     cmocka_unit_test(test_report),
        cmocka_unit_test(test_proj_order),   cmocka_unit_test(test_builder_fold), cmocka_unit_test(test_lower_custom),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
