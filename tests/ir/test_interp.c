/* The interpreter: edge values of the rows, control flow under masks, memory, the tape, counters; and lower_rand
 * against it. */
#include "tests/ir/ir_test.h"

enum { N = 100 }; /* not a multiple of the lanes */

static const uint32_t widths[] = {1, 4, 16, 64};

typedef struct Call {
    float x[N], y[N], out[N];
    int32_t sample[N], stream[N], iout[N];
    SltKernelArgs args;
} Call;

static void fill(Call *c) {
    memset(c, 0, sizeof *c);
    for (int k = 0; k < N; k++) {
        c->x[k] = (float)k - 50;
        c->y[k] = 0.25f * (float)k;
        c->sample[k] = k;
        c->stream[k] = 77 * k + 5;
    }
    c->args.in[IN_X0] = c->x;
    c->args.in[IN_X1] = c->args.in[IN_RAND0] = c->y;
    c->args.in[IN_SAMPLE] = c->sample;
    c->args.in[IN_STREAM] = c->stream;
}

/* ---- rows */

static void check_row_f(Op op, double a, double b, double c, double want) {
    for (int p = PREC_F32; p <= PREC_F64; p++) {
        TestFn t = open_fn((Precision)p);
        uint32_t n = ir_ops[op].nargs;
        Inst *args[3] = {ir_constf(&t.b, a), ir_constf(&t.b, b), ir_constf(&t.b, c)};
        Inst *r = ir_emit(&t.b, op, n, args);
        Imm folded;
        if (!ir_ops[op].math) assert_true(ir_fold(r, (Precision)p, &folded));
        ir_yield(&t.b, 1, &r);
        check_sound(t.fn);
        SltKernelArgs call = {0};
        double out64 = 0;
        float out32 = 0;
        int32_t outi = 0;
        bool is_int = ir_ops[op].result != TY_FLT;
        call.out[0] = is_int ? (void *)&outi : p == PREC_F32 ? (void *)&out32 : &out64;
        assert_int_equal(run(t.fn, &call, 1, 4), SLT_OK);
        double got = is_int ? (double)outi : p == PREC_F32 ? (double)out32 : out64;
        double expect = p == PREC_F32 && !is_int ? (double)(float)want : want;
        if (memcmp(&got, &expect, sizeof got) != 0 && !(isnan(got) && isnan(want)))
            fail_msg("%s(%g, %g, %g) = %g, not %g", ir_ops[op].name, a, b, c, got, want);
        if (!ir_ops[op].math) {
            double v = is_int ? (double)folded.i : folded.f;
            if (memcmp(&v, &got, sizeof v) != 0 && !isnan(v))
                fail_msg("%s folds to %g, runs to %g", ir_ops[op].name, v, got);
        }
        close_fn(&t);
    }
}

static void check_row_i(Op op, int32_t a, int32_t b, int32_t want) {
    TestFn t = open_fn(PREC_F32);
    Inst *args[2] = {ir_consti(&t.b, a), ir_consti(&t.b, b)};
    Inst *r = ir_emit(&t.b, op, ir_ops[op].nargs, args);
    Imm folded;
    assert_true(ir_fold(r, PREC_F32, &folded));
    ir_yield(&t.b, 1, &r);
    SltKernelArgs call = {0};
    int32_t out = 0;
    call.out[0] = &out;
    assert_int_equal(run(t.fn, &call, 1, 1), SLT_OK);
    if (out != want || folded.i != want)
        fail_msg("%s(%d, %d) = %d, folded %d, not %d", ir_ops[op].name, a, b, out, (int)folded.i, want);
    close_fn(&t);
}

static void test_float_rows(void **state) {
    (void)state;
    check_row_f(OP_fadd, 0.1, 0.2, 0, 0.1 + 0.2);
    check_row_f(OP_fsub, 1, 0.75, 0, 0.25);
    check_row_f(OP_fdiv, 1, 0, 0, INFINITY);
    check_row_f(OP_fneg, 0, 0, 0, -0.0);
    check_row_f(OP_ffma, 0x1.000002p0, 0x1.fffffep-1, -1, fma(0x1.000002p0, 0x1.fffffep-1, -1));
    check_row_f(OP_fmul, INFINITY, 0, 0, NAN);
    check_row_f(OP_zmul, 0, INFINITY, 0, 0);
    check_row_f(OP_zmul, -0.0, NAN, 0, 0);
    check_row_f(OP_zmul, 3, INFINITY, 0, INFINITY);
    check_row_f(OP_zdiv, 0, 0, 0, 0);
    check_row_f(OP_zdiv, 1, -0.0, 0, -INFINITY);
    check_row_f(OP_fabs, -0.0, 0, 0, 0);
    check_row_f(OP_fmin, 2, 1, 0, 1);
    check_row_f(OP_fmin, 1, NAN, 0, 1);
    check_row_f(OP_fmin, NAN, 1, 0, NAN);
    check_row_f(OP_fmin, 0.0, -0.0, 0, 0.0); /* equal: the first */
    check_row_f(OP_fmax, -0.0, 0.0, 0, -0.0);
    check_row_f(OP_fmax, 1, NAN, 0, 1);
    check_row_f(OP_fcopysign, 3, -0.0, 0, -3);
    check_row_f(OP_fsqrt, -1, 0, 0, NAN);
    check_row_f(OP_fsqrt, 2.25, 0, 0, 1.5);
    check_row_f(OP_ffloor, -0.5, 0, 0, -1);
    check_row_f(OP_fceil, -0.5, 0, 0, -0.0);
    check_row_f(OP_fround, 2.5, 0, 0, 2);
    check_row_f(OP_fround, 3.5, 0, 0, 4);
    check_row_f(OP_ftrunc, -2.75, 0, 0, -2);
    check_row_f(OP_fmant, -12, 0, 0, -1.5);
    check_row_f(OP_fmant, 0x1p-126, 0, 0, 1);
    check_row_f(OP_flt, NAN, 1, 0, 0);
    check_row_f(OP_fle, 1, 1, 0, 1);
    check_row_f(OP_feq, 0.0, -0.0, 0, 1);
    check_row_f(OP_fne, NAN, NAN, 0, 1);
    check_row_f(OP_f2i, -2.75, 0, 0, -2);
    check_row_f(OP_f2i, NAN, 0, 0, 0);
    check_row_f(OP_f2i, 1e20, 0, 0, INT32_MAX);
    check_row_f(OP_f2i, -1e20, 0, 0, INT32_MIN);
    check_row_f(OP_f2u, 3e9, 0, 0, (int32_t)3000000000u);
    check_row_f(OP_f2u, -4, 0, 0, 0);
    check_row_f(OP_f2u, 1e20, 0, 0, -1);
    check_row_f(OP_fasuint, 1, 0, 0, 0x3f800000);
    check_row_f(OP_fexpo, 12, 0, 0, 3);
    check_row_f(OP_fexpo, 0.3, 0, 0, -2);
    check_row_f(OP_fisnan, NAN, 0, 0, 1);
    check_row_f(OP_fisinf, -INFINITY, 0, 0, 1);
    check_row_f(OP_fisinf, NAN, 0, 0, 0);
    check_row_f(OP_fpow, -2, 3, 0, -8); /* MATH rows fall back to the C library */
}

static void test_int_rows(void **state) {
    (void)state;
    check_row_i(OP_iadd, INT32_MAX, 1, INT32_MIN);
    check_row_i(OP_imul, 65536, 65537, 65536);
    check_row_i(OP_idiv, 7, 0, 0);
    check_row_i(OP_idiv, -7, 2, -3);
    check_row_i(OP_idiv, INT32_MIN, -1, INT32_MIN);
    check_row_i(OP_irem, -7, 2, -1);
    check_row_i(OP_irem, INT32_MIN, -1, 0);
    check_row_i(OP_irem, 5, 0, 0);
    check_row_i(OP_udiv, -1, 2, INT32_MAX);
    check_row_i(OP_urem, -1, 10, 5);
    check_row_i(OP_umulh, -1, -1, -2);
    check_row_i(OP_ishl, 1, 37, 32);
    check_row_i(OP_ishr, -8, 1, -4);
    check_row_i(OP_ushr, -8, 28, 15);
    check_row_i(OP_imin, -1, 1, -1);
    check_row_i(OP_umin, -1, 1, 1);
    check_row_i(OP_imax, -1, 1, 1);
    check_row_i(OP_umax, -1, 1, -1);
    check_row_i(OP_ineg, INT32_MIN, 0, INT32_MIN);
    check_row_i(OP_inot, 5, 0, -6);
    check_row_i(OP_iand, 12, 10, 8);
    check_row_i(OP_ior, 12, 10, 14);
    check_row_i(OP_ixor, 12, 10, 6);
    check_row_i(OP_ilt, -1, 0, 1);
    check_row_i(OP_ult, -1, 0, 0);
    check_row_i(OP_ule, 3, 3, 1);
    check_row_i(OP_ieq, 3, 4, 0);
}

/* ---- control flow: per-lane results as scalar code would give them, at every width */

/* Collatz steps of |x| with the carried values exchanged on the way, an if_ inside, and a break by value. */
static Fn *collatz(TestFn *t) {
    *t = open_fn(PREC_F32);
    Builder *b = &t->b;
    Inst *start = ir_emit2(b, OP_iadd, ir_input(b, IN_SAMPLE), ir_consti(b, 1)), *zero = ir_consti(b, 0);
    Inst *loop = ir_loop(b, 3, (Inst *[]){start, zero, start}, (LoopInfo){.max_iters = 500});
    Block *body = loop->region[0];
    Inst *n = body->params[1], *steps = body->params[2], *previous = body->params[3];
    (void)previous;
    Builder in = ir_at_end(t->fn, body);
    Inst *odd = ir_emit2(&in, OP_iand, n, ir_consti(&in, 1));
    Inst *cond = ir_if(&in, ir_emit2(&in, OP_ine, odd, ir_consti(&in, 0)));
    Builder arm = ir_at_end(t->fn, cond->region[0]);
    Inst *up = ir_emit2(&arm, OP_iadd, ir_emit2(&arm, OP_imul, n, ir_consti(&arm, 3)), ir_consti(&arm, 1));
    ir_yield(&arm, 1, &up);
    arm = ir_at_end(t->fn, cond->region[1]);
    Inst *down = ir_emit2(&arm, OP_ishr, n, ir_consti(&arm, 1));
    ir_yield(&arm, 1, &down);
    Inst *next = ir_proj(&in, cond, 0), *more = ir_emit2(&in, OP_iadd, steps, ir_consti(&in, 1));
    Inst *go_on = ir_emit2(&in, OP_ine, next, ir_consti(&in, 1));
    ir_yield(&in, 4,
             (Inst *[]){go_on, next, more, n}); /* n moves into another carried value: read before it is overwritten */
    Inst *r = ir_emit2(b, OP_iadd, ir_emit2(b, OP_imul, ir_proj(b, loop, 1), ir_consti(b, 1000)), ir_proj(b, loop, 2));
    ir_yield(b, 1, &r);
    check_sound(t->fn);
    return t->fn;
}

static int32_t collatz_scalar(int32_t n) {
    int32_t steps = 0, previous = n;
    do {
        previous = n;
        n = n & 1 ? 3 * n + 1 : n >> 1;
        steps++;
    } while (n != 1);
    return steps * 1000 + previous;
}

static void test_loops(void **state) {
    (void)state;
    TestFn t;
    Fn *fn = collatz(&t);
    Call *c = malloc(sizeof *c);
    for (size_t w = 0; w < sizeof widths / sizeof *widths; w++) {
        fill(c);
        c->args.out[0] = c->iout;
        assert_int_equal(run(fn, &c->args, N, widths[w]), SLT_OK);
        for (int k = 0; k < N; k++) assert_int_equal(c->iout[k], collatz_scalar(k + 1));
    }
    free(c);
    close_fn(&t);
}

/* A loop that never ends by itself is stopped; bad calls are refused. */
static void test_bad_calls(void **state) {
    (void)state;
    TestFn t = open_fn(PREC_F32);
    Inst *x = ir_input(&t.b, IN_X0);
    Inst *loop = ir_loop(&t.b, 1, &x, (LoopInfo){.max_iters = 3});
    Builder in = ir_at_end(t.fn, loop->region[0]);
    ir_yield(&in, 2, (Inst *[]){ir_constb(&in, true), loop->region[0]->params[1]});
    ir_yield(&t.b, 1, (Inst *[]){ir_proj(&t.b, loop, 0)});
    check_sound(t.fn);
    Call *c = malloc(sizeof *c);
    fill(c);
    assert_int_equal(run(t.fn, &c->args, N, 16), SLT_INTERNAL);
    assert_int_equal(run(t.fn, &c->args, N, 3), SLT_USAGE);
    c->args.in[IN_X0] = NULL;
    assert_int_equal(run(t.fn, &c->args, N, 16), SLT_USAGE);
    free(c);
    close_fn(&t);
}

/* [Cull]: the list's iterations only; an empty list leaves the initial values. */
static void test_cull(void **state) {
    (void)state;
    TestFn t = open_fn(PREC_F32);
    Inst *zero = ir_consti(&t.b, 0);
    Inst *loop = ir_loop(&t.b, 1, &zero, (LoopInfo){.max_iters = 10, .exact = true, .cull = true, .cull_id = 1});
    Block *body = loop->region[0];
    Builder in = ir_at_end(t.fn, body);
    Inst *sum = ir_emit2(&in, OP_iadd, body->params[1], body->params[0]);
    ir_yield(&in, 2, (Inst *[]){ir_emit2(&in, OP_ilt, body->params[0], ir_consti(&in, 9)), sum});
    ir_yield(&t.b, 1, (Inst *[]){ir_proj(&t.b, loop, 0)});
    check_sound(t.fn);
    const int32_t items[] = {2, 5, 9};
    SltCullList lists[2] = {{NULL, -1}, {items, 3}};
    int32_t out[4];
    SltKernelArgs args = {.cull = lists, .out = {out}};
    assert_int_equal(run(t.fn, &args, 4, 4), SLT_OK);
    assert_int_equal(out[3], 16);
    lists[1].count = 0;
    assert_int_equal(run(t.fn, &args, 4, 4), SLT_OK);
    assert_int_equal(out[3], 0);
    args.cull = NULL;
    assert_int_equal(run(t.fn, &args, 4, 4), SLT_OK);
    assert_int_equal(out[3], 45);
    close_fn(&t);
}

/* ---- memory: arrays are per lane, zeroed at each execution, indices clamped */
static void test_arrays(void **state) {
    (void)state;
    TestFn t = open_fn(PREC_F32);
    Builder *b = &t.b;
    Inst *n = ir_input(b, IN_SAMPLE), *x = ir_input(b, IN_X0);
    Inst *loop = ir_loop(b, 1, (Inst *[]){ir_constf(b, 0)}, (LoopInfo){.max_iters = 3, .exact = true});
    Block *body = loop->region[0];
    Builder in = ir_at_end(t.fn, body);
    Inst *a = ir_special(&in, OP_alloc, TY_ARRAY, 0, NULL, (Imm){.arr = {5, TY_FLT}});
    Inst *copy = ir_special(&in, OP_alloc, TY_ARRAY, 0, NULL, (Imm){.arr = {5, TY_FLT}});
    Inst *was = ir_special(&in, OP_load, TY_FLT, 2, (Inst *[]){a, n}, (Imm){0}); /* 0: fresh in each iteration */
    Inst *cond = ir_if(&in, ir_emit2(&in, OP_flt, x, ir_constf(&in, 0)));
    Builder arm = ir_at_end(t.fn, cond->region[0]);
    ir_special(&arm, OP_store, TY_VOID, 3, (Inst *[]){a, n, x}, (Imm){0}); /* n beyond 4 goes to element 4 */
    ir_yield(&arm, 0, NULL);
    arm = ir_at_end(t.fn, cond->region[1]);
    ir_yield(&arm, 0, NULL);
    ir_special(&in, OP_acopy, TY_VOID, 2, (Inst *[]){copy, a}, (Imm){0});
    Inst *got = ir_special(&in, OP_load, TY_FLT, 2, (Inst *[]){copy, ir_consti(&in, 4)}, (Imm){0});
    Inst *sum = ir_emit2(&in, OP_fadd, body->params[1], ir_emit2(&in, OP_fadd, got, was));
    ir_yield(&in, 2, (Inst *[]){ir_emit2(&in, OP_ilt, body->params[0], ir_consti(&in, 2)), sum});
    ir_yield(b, 1, (Inst *[]){ir_proj(b, loop, 0)});
    check_sound(t.fn);
    Call *c = malloc(sizeof *c);
    for (size_t w = 0; w < sizeof widths / sizeof *widths; w++) {
        fill(c);
        c->args.out[0] = c->out;
        assert_int_equal(run(t.fn, &c->args, N, widths[w]), SLT_OK);
        for (int k = 0; k < N; k++) assert_true(c->out[k] == (k >= 4 && c->x[k] < 0 ? 3 * c->x[k] : 0));
        Interp *again = ir_interp(&t.s->scratch, t.fn, widths[w]); /* laid out once: nothing of a call is left over */
        for (int call = 0; call < 3; call++) {
            uint64_t fuel = 10000;
            for (int k = 0; k < N; k++) c->x[k] = call == 1 ? -7 : (float)k - 50;
            memset(c->out, 0xff, sizeof c->out);
            assert_int_equal(ir_interp_run(again, &c->args, N, &fuel, 0, NULL, NULL), SLT_OK);
            assert_true(fuel < 10000);
            for (int k = 0; k < N; k++) assert_true(c->out[k] == (k >= 4 && c->x[k] < 0 ? 3 * c->x[k] : 0));
            fuel = 3;
            assert_int_equal(ir_interp_run(again, &c->args, N, &fuel, 0, NULL, NULL), SLT_LIMIT);
        }
    }
    free(c);
    close_fn(&t);
}

/* ---- pairs, counters, print, the parameter vectors */

typedef struct Printed {
    unsigned calls;
    double sum;
} Printed;

static void on_print(void *user, const char *text, uint32_t len, const double *values, uint32_t n, uint32_t lane) {
    Printed *p = user;
    assert_int_equal(len, 2);
    assert_memory_equal(text, "{}", 2);
    assert_int_equal(n, 1);
    assert_true(lane < N - 10);
    p->calls++;
    p->sum += values[0];
}

static void test_effects(void **state) {
    (void)state;
    TestFn t = open_fn(PREC_F32);
    Builder *b = &t.b;
    t.fn->nfloats = 6;
    t.fn->nints = 1;
    Inst *n = ir_input(b, IN_SAMPLE), *x = ir_input(b, IN_X0);
    Inst *cond = ir_if(b, ir_emit2(b, OP_ilt, n, ir_consti(b, 31))); /* 30 is active, its partner 31 is not */
    Builder in = ir_at_end(t.fn, cond->region[0]);
    Inst *both = ir_special(&in, OP_both, TY_BOOL, 0, NULL, (Imm){0});
    Inst *other = ir_special(&in, OP_partner, TY_INT, 1, &n, (Imm){0});
    Inst *on = ir_constb(&in, true);
    ir_special(&in, OP_count, TY_VOID, 1, &on, (Imm){.i = COUNTER_ASSERT});
    ir_yield(&in, 1, (Inst *[]){ir_select(&in, both, other, ir_consti(&in, -7))});
    in = ir_at_end(t.fn, cond->region[1]);
    ir_special(&in, OP_print, TY_VOID, 1, &n, (Imm){.text = {"{}", 2}});
    Inst *p = ir_special(&in, OP_param, TY_FLT, 1, &n, (Imm){.slot = {1, 4}}); /* clamped to 4 */
    ir_special(&in, OP_adj, TY_VOID, 2, (Inst *[]){ir_special(&in, OP_iparam, TY_INT, 1, &n, (Imm){.slot = {0, 1}}), x},
               (Imm){.slot = {2, 3}});
    ir_yield(&in, 1, (Inst *[]){ir_emit1(&in, OP_f2i, p)});
    ir_yield(b, 1, (Inst *[]){ir_proj(b, cond, 0)});
    check_sound(t.fn);
    Call *c = malloc(sizeof *c);
    fill(c);
    float params[6] = {10, 11, 12, 13, 14, 15}, adj[6] = {0};
    int32_t iparams[1] = {1};
    Printed printed = {0};
    c->args.params = params, c->args.iparams = iparams, c->args.adj = adj;
    c->args.out[0] = c->iout;
    c->args.print = on_print, c->args.user = &printed;
    c->args.n_valid = N - 10;
    assert_int_equal(run(t.fn, &c->args, N, 16), SLT_OK);
    float sum = 0;
    for (int k = 0; k < N; k++) {
        assert_int_equal(c->iout[k], k < 30 ? (k ^ 1) : k == 30 ? -7 : 14);
        if (k >= 31) sum += c->x[k];
    }
    assert_true(adj[3] == sum && adj[2] == 0 && adj[4] == 0);
    assert_int_equal(c->args.counters[COUNTER_ASSERT], 31);
    assert_int_equal(printed.calls, N - 10 - 31);
    free(c);
    close_fn(&t);
}

/* ---- the tape: a loop pushes what it read, the reverse loop meets the frames of its own lane backwards */
static void test_tape(void **state) {
    (void)state;
    TestFn t = open_fn(PREC_F32);
    Builder *b = &t.b;
    Inst *n = ir_input(b, IN_SAMPLE), *one = ir_consti(b, 1);
    Inst *mark = ir_special(b, OP_tapemark, TY_TAPE, 0, NULL, (Imm){0});
    Inst *loop = ir_loop(b, 1, (Inst *[]){ir_constf(b, 1)}, (LoopInfo){.max_iters = N});
    Block *body = loop->region[0];
    Builder in = ir_at_end(t.fn, body);
    Inst *keep = ir_emit2(&in, OP_ilt, body->params[0], n);
    ir_special(&in, OP_tapepush, TY_VOID, 3, (Inst *[]){body->params[0], body->params[1], keep}, (Imm){0});
    ir_yield(&in, 2, (Inst *[]){keep, ir_emit2(&in, OP_fadd, body->params[1], ir_constf(&in, 1))});
    Inst *rev = ir_special(b, OP_revloop, TY_VOID, 3, (Inst *[]){mark, ir_consti(b, 0), one}, (Imm){0});
    Block *back = ir_block(t.fn, rev);
    Inst *k = ir_block_param(t.fn, back, TY_INT), *v = ir_block_param(t.fn, back, TY_FLT);
    ir_block_param(t.fn, back, TY_BOOL);
    Inst *hash = ir_block_param(t.fn, back, TY_INT), *count = ir_block_param(t.fn, back, TY_INT);
    in = ir_at_end(t.fn, back);
    Inst *h = ir_emit2(&in, OP_iadd, ir_emit2(&in, OP_imul, hash, ir_consti(&in, 3)),
                       ir_emit2(&in, OP_iadd, k, ir_emit1(&in, OP_f2i, v)));
    ir_yield(&in, 2, (Inst *[]){h, ir_emit2(&in, OP_iadd, count, one)});
    ir_yield(b, 2, (Inst *[]){ir_proj(b, rev, 0), ir_proj(b, rev, 1)});
    check_sound(t.fn);
    Call *c = malloc(sizeof *c);
    int32_t counts[N];
    for (size_t w = 0; w < sizeof widths / sizeof *widths; w++) {
        fill(c);
        c->args.out[0] = c->iout, c->args.out[1] = counts;
        assert_int_equal(run(t.fn, &c->args, N, widths[w]), SLT_OK);
        for (int s = 0; s < N; s++) {
            int32_t want = 0;
            for (int it = s; it >= 0; it--) want = (int32_t)((uint32_t)want * 3u + (uint32_t)(it + it + 1));
            assert_int_equal(c->iout[s], want);
            assert_int_equal(counts[s], 1 + s + 1);
        }
    }
    c->args.tape_bytes = 2000;
    assert_int_equal(run(t.fn, &c->args, N, 16), SLT_LIMIT);
    assert_true(c->args.counters[COUNTER_TAPE_OVERFLOW] > 0);
    free(c);
    close_fn(&t);
}

/* ---- hashes: as IR and as C; rand before and after lower_rand */
static void test_rand_and_mix(void **state) {
    (void)state;
    for (int p = PREC_F32; p <= PREC_F64; p++) {
        TestFn t = open_fn((Precision)p);
        Builder *b = &t.b;
        Inst *n = ir_input(b, IN_SAMPLE), *r[3];
        for (int k = 0; k < 2; k++) {
            Inst *number = ir_consti(b, k * 4);
            r[k] = ir_special(b, OP_rand, TY_FLT, 1, &number, (Imm){0});
        }
        r[2] = ir_special(b, OP_rand, TY_FLT, 1, &n, (Imm){0});
        Inst *mix = ir_mix_inst(b, ir_input(b, IN_STREAM), n);
        ir_yield(b, 4, (Inst *[]){r[0], r[1], r[2], mix});
        check_sound(t.fn);
        Fn *low = ir_clone(t.fn, &t.s->module, "low");
        PassCtx ctx = {.session = t.s};
        assert_true(lower_rand(&ctx, low));
        check_sound(low);
        Call *c = malloc(sizeof *c);
        fill(c);
        double first[N], a[3][N], d[3][N];
        for (int k = 0; k < N; k++) first[k] = 0.5;
        float firstf[N];
        for (int k = 0; k < N; k++) firstf[k] = 0.5f;
        c->args.in[IN_RAND0] = p == PREC_F32 ? (void *)firstf : first;
        memset(a, 0, sizeof a), memset(d, 0, sizeof d);
        int32_t mixed[N];
        for (int k = 0; k < 3; k++) c->args.out[k] = a[k];
        c->args.out[3] = mixed;
        assert_int_equal(run(t.fn, &c->args, N, 16), SLT_OK);
        for (int k = 0; k < 3; k++) c->args.out[k] = d[k];
        assert_int_equal(run(low, &c->args, N, 4), SLT_OK);
        assert_memory_equal(a, d, sizeof a);
        double mean = 0;
        for (int k = 0; k < N; k++) {
            assert_int_equal((uint32_t)mixed[k], ir_mix((uint32_t)c->stream[k], (uint32_t)k));
            double u = p == PREC_F32 ? (double)((float *)a[1])[k] : a[1][k];
            assert_true(u == (double)(ir_rand_u32((uint32_t)c->stream[k], 4) >> 8) * 0x1p-24 && u >= 0 && u < 1);
            mean += u / N;
            double zero = p == PREC_F32 ? (double)((float *)a[0])[k] : a[0][k];
            assert_true(zero == 0.5);
        }
        assert_true(fabs(mean - 0.5) < 0.1);
        free(c);
        close_fn(&t);
    }
}

/* The hash as a generator: means, correlations of neighbours in stream and in number. */
static void test_rand_quality(void **state) {
    (void)state;
    enum { M = 200000 };
    double mean = 0, across = 0, along = 0;
    uint32_t bits[32] = {0};
    for (uint32_t k = 0; k < M; k++) {
        uint32_t v = ir_rand_u32(k, 3);
        double u = v * 0x1p-32 - 0.5;
        mean += u / M;
        across += u * (ir_rand_u32(k + 1, 3) * 0x1p-32 - 0.5) / M;
        along += u * (ir_rand_u32(k, 4) * 0x1p-32 - 0.5) / M;
        for (int j = 0; j < 32; j++) bits[j] += v >> j & 1;
    }
    assert_true(fabs(mean) < 4 * 0.2887 / sqrt(M));
    assert_true(fabs(across) < 4 * 0.0833 / sqrt(M) && fabs(along) < 4 * 0.0833 / sqrt(M));
    for (int j = 0; j < 32; j++) assert_true(fabs(bits[j] / (double)M - 0.5) < 5 * 0.5 / sqrt(M));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_float_rows),   cmocka_unit_test(test_int_rows), cmocka_unit_test(test_loops),
        cmocka_unit_test(test_bad_calls),    cmocka_unit_test(test_cull),     cmocka_unit_test(test_arrays),
        cmocka_unit_test(test_effects),      cmocka_unit_test(test_tape),     cmocka_unit_test(test_rand_and_mix),
        cmocka_unit_test(test_rand_quality),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
