/* The transform: control flow, storage, accumulation, on programs written by hand. */
#include "tests/ad/ad_test.h"

TEST(straight) {
    Prog p = prog_begin(s, PREC_F64, 3);
    Inst *x = input_x(&p, 0), *y = input_x(&p, 1);
    Inst *d = root(&p, add(&p, add(&p, mul(&p, x, x), mul(&p, y, y)), cf(&p, 0.01)));
    Inst *e = expo(&p, mul(&p, par(&p, 0), neg(&p, d)));
    Inst *f = add(&p, mul(&p, e, par(&p, 1)), dvd(&p, sine(&p, mul(&p, x, par(&p, 2))), add(&p, d, cf(&p, 1))));
    prog_end(&p, 2, (Inst *[]){f, sub(&p, e, d)});
    Check c = {0};
    check_ad(&p, &c);
    assert_true(c.compared > 0 && c.kinks == 0);
}

TEST(branches) {
    Prog p = prog_begin(s, PREC_F64, 4);
    Inst *x = input_x(&p, 0), *y = input_x(&p, 1), *r[2], *q[2];
    Inst *a = mul(&p, x, par(&p, 0));
    if_begin(&p, lt(&p, y, cf(&p, 0)));
    Inst *t = sine(&p, mul(&p, a, par(&p, 1)));
    if_begin(&p, lt(&p, x, cf(&p, 0.2)));
    Inst *u = expo(&p, t);
    if_else(&p, 2, (Inst *[]){mul(&p, u, t), a});
    Inst *w = root(&p, add(&p, mul(&p, t, t), cf(&p, 0.5)));
    if_end(&p, 2, (Inst *[]){w, mul(&p, w, y)}, q);
    if_else(&p, 2, (Inst *[]){q[0], q[1]});
    if_end(&p, 2, (Inst *[]){a, mul(&p, par(&p, 2), y)}, r);
    prog_end(&p, 1, (Inst *[]){mul(&p, add(&p, r[0], r[1]), add(&p, par(&p, 3), r[0]))});
    Check c = {0};
    check_ad(&p, &c);
    assert_true(c.compared > 2 * c.kinks);
}

/* s += w*c needs no s: a 200-iteration loop with linear accumulation stores nothing. */
TEST(linear_accumulation) {
    Prog p = prog_begin(s, PREC_F64, 400);
    Inst *x = input_x(&p, 0), *r[1];
    Inst **c = loop_begin(&p, 200, true, 1, (Inst *[]){cf(&p, 0)});
    Inst *w = sine(&p, add(&p, mul(&p, x, par_at(&p, 0, 200, c[0])), i2f_(&p, c[0])));
    loop_end(&p, NULL, 1, (Inst *[]){add(&p, c[1], mul(&p, w, par_at(&p, 200, 200, c[0])))}, r);
    prog_end(&p, 1, r);
    Check k = {0};
    check_ad(&p, &k);
    /* w is an elementary function: stored, one value a frame; without it the loop has no tape at all */
    assert_int_equal(k.tape.frame_values, 2); /* k and w */

    p = prog_begin(s, PREC_F64, 400);
    x = input_x(&p, 0);
    c = loop_begin(&p, 200, true, 1, (Inst *[]){cf(&p, 0)});
    w = add(&p, mul(&p, x, par_at(&p, 0, 200, c[0])), i2f_(&p, c[0]));
    loop_end(&p, NULL, 1, (Inst *[]){add(&p, c[1], mul(&p, w, par_at(&p, 200, 200, c[0])))}, r);
    prog_end(&p, 1, r);
    k = (Check){0};
    check_ad(&p, &k);
    assert_int_equal(k.tape.bytes_per_lane, 0);
    assert_int_equal(count_ops(k.vjp->body, OP_tapepush), 0);
    assert_int_equal(count_ops(k.vjp->body, OP_revloop), 0);
}

/* A nonlinear recurrence with a break that depends on the data: every lane leaves at its own time. */
TEST(data_dependent_break) {
    Prog p = prog_begin(s, PREC_F64, 3);
    Inst *x = input_x(&p, 0), *y = input_x(&p, 1), *r[2];
    Inst **c = loop_begin(&p, 40, false, 2, (Inst *[]){x, y});
    Inst *a = add(&p, mul(&p, c[1], par(&p, 0)), sine(&p, mul(&p, c[2], par(&p, 1))));
    Inst *b = add(&p, mul(&p, c[2], c[1]), par(&p, 2));
    Inst *n = tanh_(&p, b);
    Inst *go = lt(&p, add(&p, mul(&p, a, a), mul(&p, n, n)), cf(&p, 0.9));
    loop_end(&p, go, 2, (Inst *[]){a, n}, r);
    prog_end(&p, 1, (Inst *[]){mul(&p, r[0], add(&p, r[1], cf(&p, 1)))});
    Check k = {0};
    check_ad(&p, &k);
    assert_true(k.compared > k.kinks);
}

static void nested(Session *s, uint32_t budget, uint32_t outer, uint32_t inner, uint32_t *bytes) {
    Prog p = prog_begin(s, PREC_F64, 4);
    Inst *x = input_x(&p, 0), *y = input_x(&p, 1), *r[2], *q[1], *t[1];
    Inst **c = loop_begin(&p, outer, false, 2, (Inst *[]){x, y});
    Inst *step = mul(&p, par(&p, 0), add(&p, c[1], cf(&p, 1)));
    Inst **d = loop_begin(&p, inner, false, 1, (Inst *[]){c[2]});
    Inst *e = sine(&p, add(&p, mul(&p, d[1], step), par(&p, 1)));
    if_begin(&p, lt(&p, e, cf(&p, 0.3)));
    Inst *f = mul(&p, e, mul(&p, e, par(&p, 2)));
    if_else(&p, 1, &f);
    if_end(&p, 1, &d[1], t);
    Inst *m = add(&p, mul(&p, t[0], cf(&p, 0.9)), mul(&p, c[1], cf(&p, 0.1)));
    loop_end(&p, lt(&p, m, cf(&p, 0.8)), 1, &m, q);
    Inst *n = add(&p, mul(&p, c[1], cf(&p, 0.5)), mul(&p, q[0], par(&p, 3)));
    loop_end(&p, lt(&p, n, mul(&p, x, cf(&p, 1.5))), 2, (Inst *[]){n, q[0]}, r);
    prog_end(&p, 2, (Inst *[]){r[0], mul(&p, r[1], r[0])});
    Check k = {.tape_budget = budget};
    check_ad(&p, &k);
    assert_true(k.compared > k.kinks);
    *bytes = (uint32_t)k.tape.bytes_per_lane;
}

TEST(nested_loops) {
    uint32_t bytes;
    nested(s, 0, 7, 5, &bytes);
}

TEST(checkpoints) {
    uint32_t all, few;
    nested(s, 1u << 30, 30, 20, &all);
    nested(s, 64, 30, 20, &few);
    assert_true(few < all / 3);
    nested(s, 64, 17, 13, &few); /* lengths that no segment divides */
}

/* Loops in both regions of an if, in a loop, after a loop: the order of frames. */
TEST(loops_in_ifs_in_loops) {
    Prog p = prog_begin(s, PREC_F64, 5);
    Inst *x = input_x(&p, 0), *y = input_x(&p, 1), *r[2], *q[1], *t[2], *u[1];
    Inst **c = loop_begin(&p, 6, false, 2, (Inst *[]){x, y});
    Inst **d = loop_begin(&p, 3, false, 1, (Inst *[]){c[1]});
    Inst *e = tanh_(&p, add(&p, mul(&p, d[1], par(&p, 0)), c[2]));
    loop_end(&p, lt(&p, e, cf(&p, 0.5)), 1, &e, q);
    if_begin(&p, lt(&p, q[0], c[2]));
    Inst *scale = sine(&p, mul(&p, q[0], par(&p, 1)));
    d = loop_begin(&p, 4, false, 1, (Inst *[]){q[0]});
    e = add(&p, mul(&p, d[1], scale), par(&p, 2));
    Inst *e2 = sine(&p, mul(&p, e, e));
    loop_end(&p, lt(&p, e2, cf(&p, 0.4)), 1, &e2, u);
    Inst *twice = mul(&p, u[0], scale);
    d = loop_begin(&p, 2, true, 1, (Inst *[]){twice});
    e = mul(&p, d[1], add(&p, d[1], par(&p, 3)));
    loop_end(&p, NULL, 1, &e, u);
    if_else(&p, 2, (Inst *[]){u[0], q[0]});
    d = loop_begin(&p, 5, false, 1, (Inst *[]){c[2]});
    e = tanh_(&p, mul(&p, add(&p, d[1], q[0]), par(&p, 4)));
    loop_end(&p, lt(&p, c[1], e), 1, &e, u);
    if_end(&p, 2, (Inst *[]){q[0], u[0]}, t);
    Inst *n = tanh_(&p, add(&p, t[0], mul(&p, c[1], par(&p, 0))));
    loop_end(&p, lt(&p, n, cf(&p, 0.7)), 2, (Inst *[]){n, mul(&p, t[1], cf(&p, 0.8))}, r);
    prog_end(&p, 1, (Inst *[]){add(&p, r[0], mul(&p, r[1], r[1]))});
    Check k = {0};
    check_ad(&p, &k);
    assert_true(k.compared > k.kinks);
    check_ad(&p, &(Check){.tape_budget = 32});
}

/* A painter: for (i) { d = |x - c_i| - r_i; if (d < 0) col = lerp(col, ink_i, a(d)) }. */
static Prog painter(Session *s, uint32_t n, bool opaque) {
    Prog p = prog_begin(s, PREC_F64, 5 * n);
    Inst *x = input_x(&p, 0), *y = input_x(&p, 1), *r[2], *t[2];
    Inst **c = loop_begin(&p, n, true, 2, (Inst *[]){cf(&p, 0.1), cf(&p, 0.2)});
    Inst *base = imul_(&p, c[0], ci(&p, 5)), *q[5];
    for (int k = 0; k < 5; k++) q[k] = par_at(&p, 0, 5 * n, iadd_(&p, base, ci(&p, k)));
    Inst *dx = sub(&p, x, q[0]), *dy = sub(&p, y, q[1]);
    Inst *d = sub(&p, root(&p, add(&p, add(&p, mul(&p, dx, dx), mul(&p, dy, dy)), cf(&p, 1e-6))), mul(&p, q[2], q[2]));
    if_begin(&p, lt(&p, d, cf(&p, 0)));
    Inst *v[2];
    for (int k = 0; k < 2; k++) {
        Inst *ink = q[3 + k];
        v[k] = opaque ? ink : add(&p, c[1 + k], mul(&p, sub(&p, ink, c[1 + k]), mul(&p, d, cf(&p, -0.7))));
    }
    if_else(&p, 2, v);
    if_end(&p, 2, (Inst *[]){c[1], c[2]}, t);
    loop_end(&p, NULL, 2, t, r);
    prog_end(&p, 2, r);
    return p;
}

static uint64_t pushes(const Fn *fn, const Check *c) {
    (void)c;
    uint64_t n = 0; /* the smallest tape on which the kernel runs, in frames of one lane */
    uint64_t state = 5;
    Run *r = random_run(fn, &(Check){.x_lo = -1, .x_hi = 1, .p_lo = -1, .p_hi = 1}, &state);
    for (n = 64; n < (1u << 22); n += 64) {
        r->tape_bytes = n;
        if (run_fn(fn, r, 0, 1, 1) == SLT_OK) break;
    }
    free(r);
    return n;
}

TEST(sparse) {
    for (int opaque = 0; opaque < 2; opaque++) {
        Prog p = painter(s, 100, opaque);
        Check k = {.fd_tolerance = 1e-4};
        check_ad(&p, &k);
        assert_true(k.compared > k.kinks);
        assert_non_null(strstr(k.tape.text, "only iterations that are taken"));
        assert_true(pushes(k.vjp, &k) < 100 * 40 / 2); /* about a third of the discs is hit */
        p = painter(s, 100, opaque);
        check_ad(&p, &(Check){.tape_budget = 256, .no_fd = true});
    }
}

/* Several guards, one of them an else. */
TEST(sparse_several) {
    Prog p = prog_begin(s, PREC_F64, 40);
    Inst *x = input_x(&p, 0), *r[2], *t[1], *u[2];
    Inst **c = loop_begin(&p, 20, true, 2, (Inst *[]){x, input_x(&p, 1)});
    Inst *a = par_at(&p, 0, 20, c[0]), *b = par_at(&p, 20, 20, c[0]);
    if_begin(&p, lt(&p, a, mul(&p, x, cf(&p, 0.4))));
    Inst *v = mul(&p, c[1], sine(&p, mul(&p, a, x)));
    if_else(&p, 1, &v);
    if_end(&p, 1, &c[1], t);
    if_begin(&p, lt(&p, cf(&p, -0.5), b));
    if_else(&p, 2, (Inst *[]){t[0], c[2]});
    if_end(&p, 2, (Inst *[]){add(&p, t[0], mul(&p, b, c[2])), mul(&p, c[2], tanh_(&p, add(&p, c[2], b)))}, u);
    loop_end(&p, NULL, 2, u, r);
    prog_end(&p, 1, (Inst *[]){add(&p, r[0], r[1])});
    Check k = {0};
    check_ad(&p, &k);
    assert_non_null(strstr(k.tape.text, "only iterations that are taken"));
}

/* A loop inside the guarded region. */
TEST(sparse_with_loop) {
    Prog p = prog_begin(s, PREC_F64, 20);
    Inst *x = input_x(&p, 0), *y = input_x(&p, 1), *r[1], *t[1], *u[1];
    Inst **c = loop_begin(&p, 10, true, 1, (Inst *[]){x});
    Inst *a = par_at(&p, 0, 10, c[0]), *b = par_at(&p, 10, 10, c[0]);
    if_begin(&p, lt(&p, a, y));
    Inst **d = loop_begin(&p, 4, false, 1, (Inst *[]){c[1]});
    Inst *e = sine(&p, add(&p, mul(&p, d[1], b), y));
    loop_end(&p, lt(&p, e, a), 1, &e, u);
    if_else(&p, 1, u);
    if_end(&p, 1, &c[1], t);
    loop_end(&p, NULL, 1, t, r);
    prog_end(&p, 1, r);
    Check k = {0};
    check_ad(&p, &k);
    assert_non_null(strstr(k.tape.text, "only iterations that are taken"));
    check_ad(&p, &(Check){.tape_budget = 32});
}

/* Arrays written in loops, read later: a small network. */
TEST(network) {
    enum { H = 6 };
    Prog p = prog_begin(s, PREC_F64, 3 * H + H * H + 2 * H);
    Inst *x = input_x(&p, 0), *y = input_x(&p, 1), *r[1], *q[1];
    Inst *h1 = array(&p, H), *h2 = array(&p, H);
    Inst **c = loop_begin(&p, H, true, 0, NULL);
    Inst *z = add(&p, mul(&p, x, par_at(&p, 0, H, c[0])),
                  add(&p, mul(&p, y, par_at(&p, H, H, c[0])), par_at(&p, 2 * H, H, c[0])));
    put(&p, h1, c[0], sine(&p, z));
    loop_end(&p, NULL, 0, NULL, r);
    c = loop_begin(&p, H, true, 0, NULL);
    Inst *i = c[0];
    Inst **d = loop_begin(&p, H, true, 1, (Inst *[]){par_at(&p, 3 * H + H * H, H, i)});
    Inst *w = par_at(&p, 3 * H, H * H, iadd_(&p, imul_(&p, i, ci(&p, H)), d[0]));
    Inst *sum = add(&p, d[1], mul(&p, w, at(&p, h1, d[0])));
    loop_end(&p, NULL, 1, &sum, q);
    put(&p, h2, i, tanh_(&p, q[0]));
    loop_end(&p, NULL, 0, NULL, r);
    c = loop_begin(&p, H, true, 1, (Inst *[]){cf(&p, 0)});
    sum = add(&p, c[1], mul(&p, at(&p, h2, c[0]), par_at(&p, 4 * H + H * H, H, c[0])));
    loop_end(&p, NULL, 1, &sum, r);
    prog_end(&p, 1, r);
    Check k = {0};
    check_ad(&p, &k);
    assert_int_equal(k.kinks, 0);
    assert_true(count_ops(k.vjp->body, OP_revloop) <= 1); /* only tanh's result is stored: the inner loop has no tape */
}

/* Arrays overwritten while they are read, an array made in a loop, copies, indices from data. */
TEST(arrays) {
    Prog p = prog_begin(s, PREC_F64, 6);
    Inst *x = input_x(&p, 0), *y = input_x(&p, 1), *r[1];
    Inst *a = array(&p, 6), *b = array(&p, 6);
    for (int k = 0; k < 6; k++) put(&p, a, ci(&p, k), mul(&p, par(&p, (uint32_t)k), k & 1 ? x : y));
    Inst **c = loop_begin(&p, 9, false, 1, (Inst *[]){x});
    Inst *tmp = array(&p, 3);
    Inst *index = ir_emit1(&p.b, OP_f2i, mul(&p, add(&p, c[1], cf(&p, 1)), cf(&p, 2.7)));
    Inst *v = at(&p, a, index);
    put(&p, tmp, ci(&p, 1), mul(&p, v, v));
    put(&p, tmp, index, sine(&p, v));
    Inst *w = add(&p, at(&p, tmp, ci(&p, 1)), mul(&p, at(&p, tmp, ci(&p, 0)), c[1]));
    put(&p, a, c[0], add(&p, w, mul(&p, cf(&p, 0.5), at(&p, a, iadd_(&p, index, ci(&p, 1))))));
    if_begin(&p, lt(&p, w, cf(&p, 0)));
    copy(&p, b, a);
    put(&p, a, index, c[1]);
    if_else(&p, 0, NULL);
    if_end(&p, 0, NULL, r);
    Inst *n = tanh_(&p, add(&p, w, at(&p, b, ci(&p, 2))));
    loop_end(&p, lt(&p, n, cf(&p, 0.9)), 1, &n, r);
    Inst *sum = r[0];
    for (int k = 0; k < 6; k++) sum = add(&p, sum, mul(&p, at(&p, a, ci(&p, k)), at(&p, b, ci(&p, 5 - k))));
    prog_end(&p, 1, &sum);
    Check k = {0};
    check_ad(&p, &k);
    assert_true(k.compared > k.kinks);
    check_ad(&p, &(Check){.tape_budget = 16});
}

/* A tangent by hand, deliberately not the derivative, so that a test sees whose rule was used; and one with a loop in
 * it. */
TEST(custom) {
    Prog p = prog_begin(s, PREC_F64, 3);
    Inst *x = input_x(&p, 0), *y = input_x(&p, 1);
    Inst *args[2] = {mul(&p, x, par(&p, 0)), mul(&p, y, par(&p, 1))};
    Inst *i = ir_special(&p.b, OP_custom, TY_VOID, 2, args, (Imm){0});
    Builder outer = p.b;
    Block *f = ir_block(p.fn, i);
    Inst *a = ir_block_param(p.fn, f, TY_FLT), *b = ir_block_param(p.fn, f, TY_FLT), *r[1];
    p.b = ir_at_end(p.fn, f);
    ir_yield(&p.b, 1, (Inst *[]){mul(&p, sine(&p, a), mul(&p, b, par(&p, 2)))});
    Block *df = ir_block(p.fn, i);
    Inst *q[4];
    for (int k = 0; k < 4; k++) q[k] = ir_block_param(p.fn, df, TY_FLT);
    p.b = ir_at_end(p.fn, df);
    Inst **c = loop_begin(&p, 3, true, 1, (Inst *[]){q[2]});
    Inst *t = add(&p, mul(&p, c[1], q[1]), mul(&p, q[3], q[0]));
    loop_end(&p, NULL, 1, &t, r);
    ir_yield(&p.b, 1, (Inst *[]){mul(&p, r[0], par(&p, 2))});
    p.b = outer;
    Inst *out = ir_proj(&p.b, i, 0);
    prog_end(&p, 1, (Inst *[]){add(&p, mul(&p, out, out), x)});
    Check k = {.no_fd = true};
    check_ad(&p, &k);
    /* the reverse is the transposed region: with seed 1, d/da = 2 f (b^3) p2 etc. */
    Run *run = calloc(1, sizeof *run);
    run->x[0][0] = 0.5, run->x[1][0] = 0.75, run->seed[0][0] = 1;
    run->params[0] = 1.5, run->params[1] = 0.8, run->params[2] = 1.25;
    assert_int_equal(run_fn(k.vjp, run, 0, 1, 1), SLT_OK);
    double va = 0.75, vb = 0.6, out0 = sin(va) * vb * 1.25;
    double da = vb * vb * vb * 1.25, db = va * (1 + vb + vb * vb) * 1.25;
    assert_true(near(run->adj[0], 2 * out0 * da * 0.5, 1e-12));
    assert_true(near(run->adj[1], 2 * out0 * db * 0.75, 1e-12));
    assert_true(run->adj[2] == 0); /* parameters read inside belong to the hand-written tangent */
    free(run);
}

TEST(wrt_subset) {
    Prog p = painter(s, 12, false);
    uint8_t wrt[60] = {0};
    PassCtx ctx = {.session = s, .has_fma = true};
    Fn *none = ad_vjp(&ctx, p.fn, &(AdOptions){.wrt = wrt}, NULL);
    clean(&ctx, none);
    assert_int_equal(count_ops(none->body, OP_adj), 0);
    assert_int_equal(count_ops(none->body, OP_tapepush), 0);
    assert_int_equal(count_ops(none->body, OP_revloop), 0);

    p = prog_begin(s, PREC_F64, 4);
    Inst *x = input_x(&p, 0);
    Inst *f = mul(&p, sine(&p, mul(&p, x, par(&p, 0))), add(&p, par(&p, 1), mul(&p, par(&p, 2), par(&p, 3))));
    prog_end(&p, 1, &f);
    uint8_t one[4] = {0, 1, 0, 0};
    TapeReport report;
    Fn *v = ad_vjp(&ctx, p.fn, &(AdOptions){.wrt = one}, &report);
    clean(&ctx, v);
    assert_int_equal(count_ops(v->body, OP_adj), 1);
    assert_int_equal(count_ops(v->body, OP_fcos), 0);
    Fn *j = ad_jvp(&ctx, p.fn, &(AdOptions){.wrt = one});
    clean(&ctx, j);
    assert_int_equal(count_ops(j->body, OP_dparam), 1);
    uint8_t bits[1];
    ad_activity(p.fn, bits);
    assert_int_equal(bits[0], 15);
}

TEST(grad_x) {
    Prog p = prog_begin(s, PREC_F64, 2);
    Inst *x = input_x(&p, 0), *y = input_x(&p, 1);
    Inst *g = sub(&p, root(&p, add(&p, mul(&p, x, x), mul(&p, mul(&p, y, y), par(&p, 1)))), par(&p, 0));
    prog_end(&p, 1, &g);
    PassCtx ctx = {.session = s, .has_fma = true};
    Fn *d = ad_grad_x(&ctx, p.fn);
    clean(&ctx, d);
    assert_int_equal(nout(d), 3);
    assert_int_equal(count_ops(d->body, OP_fsqrt), 1);
    Run *r = calloc(1, sizeof *r);
    r->x[0][0] = 3, r->x[1][0] = 2, r->params[0] = 1, r->params[1] = 4;
    assert_int_equal(run_fn(d, r, 0, 1, 1), SLT_OK);
    assert_true(near(r->out[0][0], 4, 1e-15) && near(r->out[1][0], 0.6, 1e-15) && near(r->out[2][0], 1.6, 1e-15));
    free(r);
}

/* detach, rounding and comparisons carry nothing; 0 * inf is 0. */
TEST(policies) {
    Prog p = prog_begin(s, PREC_F64, 1);
    Inst *x = input_x(&p, 0), *q = par(&p, 0);
    Inst *f = add(&p, mul(&p, ir_emit1(&p.b, OP_detach, x), q), ir_emit1(&p.b, OP_ffloor, mul(&p, x, cf(&p, 3))));
    prog_end(&p, 1, &f);
    PassCtx ctx = {.session = s, .has_fma = true};
    Fn *v = ad_vjp(&ctx, p.fn, &(AdOptions){.wrt_x = true}, NULL);
    Run *r = calloc(1, sizeof *r);
    r->x[0][0] = 0.7, r->params[0] = 2, r->seed[0][0] = 1;
    assert_int_equal(run_fn(v, r, 0, 1, 1), SLT_OK);
    assert_true(r->adj[0] == 0.7 && r->out[1][0] == 0);

    /* length at the origin; sqrt(0) * 0; a branch not taken whose log is infinite */
    p = prog_begin(s, PREC_F64, 1);
    x = input_x(&p, 0);
    Inst *len = root(&p, add(&p, mul(&p, x, x), mul(&p, input_x(&p, 1), input_x(&p, 1))));
    Inst *safe = sel(&p, lt(&p, cf(&p, 0), x), ir_emit1(&p.b, OP_flog, x), mul(&p, x, par(&p, 0)));
    Inst *h = mul(&p, expo(&p, mul(&p, cf(&p, 1000), len)), cf(&p, 0));
    prog_end(&p, 1, (Inst *[]){add(&p, add(&p, len, safe), h)});
    v = ad_vjp(&ctx, p.fn, &(AdOptions){.wrt_x = true}, NULL);
    Fn *j = ad_jvp(&ctx, p.fn, &(AdOptions){.wrt_x = true});
    memset(r, 0, sizeof *r);
    r->params[0] = 3, r->seed[0][0] = 1, r->dx[0][0] = 1;
    assert_int_equal(run_fn(v, r, 0, 1, 1), SLT_OK);
    assert_true(r->out[1][0] == 3 && r->out[2][0] == 0 && r->adj[0] == 0);
    assert_int_equal(run_fn(j, r, 0, 1, 1), SLT_OK);
    assert_true(r->out[1][0] == 3);
    r->x[0][0] = 2; /* the exponential overflows, its factor is 0 */
    assert_int_equal(run_fn(v, r, 0, 1, 1), SLT_OK);
    assert_false(isnan(r->out[1][0]));
    free(r);
}

/* Ordinary code pays nothing for the guards. */
TEST(no_guards_in_ordinary_code) {
    Prog p = painter(s, 8, false);
    PassCtx ctx = {.session = s, .has_fma = true};
    Fn *v = ad_vjp(&ctx, p.fn, &(AdOptions){0}, NULL);
    clean(&ctx, v);
    assert_int_equal(count_ops(v->body, OP_zdiv), 0);
    assert_true(count_ops(v->body, OP_zmul) <= 2); /* the carried colours, which nobody clamps */
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(straight),
        cmocka_unit_test(branches),
        cmocka_unit_test(linear_accumulation),
        cmocka_unit_test(data_dependent_break),
        cmocka_unit_test(nested_loops),
        cmocka_unit_test(checkpoints),
        cmocka_unit_test(loops_in_ifs_in_loops),
        cmocka_unit_test(sparse),
        cmocka_unit_test(sparse_several),
        cmocka_unit_test(sparse_with_loop),
        cmocka_unit_test(network),
        cmocka_unit_test(arrays),
        cmocka_unit_test(custom),
        cmocka_unit_test(wrt_subset),
        cmocka_unit_test(grad_x),
        cmocka_unit_test(policies),
        cmocka_unit_test(no_guards_in_ordinary_code),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
