/* Long straight-line programs of min, max and select, whose sweep passes over chunks without adjoints (ad_sparse.c):
 * the oracles of check_ad, and the sweep that runs all, bit for bit. */
#include "tests/ad/ad_test.h"

enum { POOL = 24, PARAMS = 64 };

typedef Inst *Pole(Prog *p, Inst *d);
static Inst *one_by_zero(Prog *p, Inst *d) { return dvd(p, cf(p, 1), mx(p, d, cf(p, 0))); }
static Inst *root_of_negative(Prog *p, Inst *d) { return root(p, d); }
static Inst *zero_by_zero(Prog *p, Inst *d) {
    Inst *u = mx(p, d, cf(p, 0));
    return dvd(p, mul(p, u, u), u);
}
static Pole *const poles[] = {one_by_zero, root_of_negative, zero_by_zero};

static Inst *pick(Inst *const *pool, uint64_t *state) { return pool[(uint32_t)(uniform(state) * POOL)]; }

/* What is infinite or NaN where d < 0.3 is thrown away there. */
static Inst *with_pole(Prog *p, Inst *d, Inst *else_, uint64_t *state) {
    Inst *u = poles[(uint32_t)(uniform(state) * 3)](p, sub(p, d, cf(p, 0.3)));
    return sel(p, lt(p, d, cf(p, 0.31)), else_, mn(p, u, cf(p, 1)));
}

/* A value of moderate size made of the pool; same: ties, by what is equal although no pass can know. */
static Inst *statement(Prog *p, Inst *const *pool, bool same, uint64_t *state) {
    Inst *a = pick(pool, state), *b = pick(pool, state), *c = par(p, (uint32_t)(uniform(state) * PARAMS));
    switch ((int)(uniform(state) * 12)) {
    case 0: return mul(p, tanh_(p, a), c);
    case 1: return sub(p, mul(p, a, cf(p, 0.5)), c);
    case 2: return root(p, add(p, mul(p, a, a), mul(p, c, c)));
    case 3: return with_pole(p, a, b, state);
    case 4: return sel(p, lt(p, a, c), b, a);
    case 5: return sel(p, lt(p, input_x(p, 1), b), neg(p, a), c);
    case 6: return same ? mn(p, mul(p, a, cf(p, 0.75)), mul(p, a, sub(p, cf(p, 1), cf(p, 0.25)))) : mn(p, a, c);
    case 7: return same ? mx(p, mn(p, a, b), mn(p, b, a)) : mx(p, b, c);
    case 8: return mx(p, add(p, a, c), neg(p, b));
    default: return uniform(state) < 0.5 ? mn(p, a, b) : mx(p, a, b);
    }
}

static Prog long_program(Session *s, uint32_t statements, uint32_t outputs, bool same, uint64_t seed) {
    Prog p = prog_begin(s, PREC_F64, PARAMS);
    uint64_t state = seed;
    Inst *pool[POOL], *out[4];
    for (uint32_t k = 0; k < POOL; k++) pool[k] = mul(&p, input_x(&p, k & 1), add(&p, par(&p, k), cf(&p, 1.5)));
    for (uint32_t k = 0; k < statements; k++) pool[k % POOL] = statement(&p, pool, same, &state);
    for (uint32_t o = 0; o < outputs; o++) {
        out[o] = pool[o];
        for (uint32_t k = o + 1; k < POOL; k++) out[o] = k & 1 ? mn(&p, out[o], pool[k]) : mx(&p, out[o], pool[k]);
    }
    prog_end(&p, outputs, out);
    return p;
}

static uint32_t branches(const Fn *fn) { return count_ops(fn->body, OP_if_); }

TEST(oracles) {
    for (uint64_t seed = 1; seed <= 4; seed++) {
        Prog p = long_program(s, 900, 2, false, seed);
        Check c = {.p_lo = 0.1, .p_hi = 1, .fd_tolerance = 1e-4};
        check_ad(&p, &c);
        assert_true(c.compared > 2 * c.kinks);
        assert_true(branches(c.vjp) > 30);
    }
}

/* Equal operands: the sweep and the tangents take the same one. */
TEST(ties) {
    Prog p = long_program(s, 900, 2, true, 5);
    Check c = {.p_lo = 0.1, .p_hi = 1, .no_fd = true};
    check_ad(&p, &c);
    assert_true(branches(c.vjp) > 30);
}

static void assert_same(const Fn *sparse, const Fn *dense, const Run *r) {
    Run *a = malloc(sizeof *a), *b = malloc(sizeof *b);
    for (uint32_t lanes = 1; lanes <= LANES; lanes *= LANES) {
        *a = *b = *r;
        assert_int_equal(run_fn(sparse, a, 0, LANES, lanes), SLT_OK);
        assert_int_equal(run_fn(dense, b, 0, LANES, lanes), SLT_OK);
        for (uint32_t o = 0; o < nout(dense); o++)
            for (uint32_t l = 0; l < LANES; l++) assert_true(near(a->out[o][l], b->out[o][l], 0));
        for (uint32_t k = 0; k < PARAMS; k++) assert_true(near(a->adj[k], b->adj[k], 0));
    }
    free(a), free(b);
}

/* The same numbers as of the sweep that runs all, but for the signs of zeros; in lanes with seeds of 0, infinite and
 * NaN too. Of one output several rows: seeds are weights of its adjoints then, and finite. */
TEST(as_dense) {
    for (uint64_t seed = 10; seed < 18; seed++) {
        bool rows = seed % 4 == 3;
        Prog p = long_program(s, 900, rows ? 1 : 2, seed % 3 == 0, seed);
        PassCtx ctx = {.session = s, .has_fma = true};
        AdOptions o = {.wrt_x = !rows, .rows = rows ? 3 : 1};
        Fn *sparse = ad_vjp(&ctx, p.fn, &o, NULL);
        o.dense = true;
        Fn *dense = ad_vjp(&ctx, p.fn, &o, NULL);
        assert_true(branches(sparse) > branches(dense) + 30);
        clean(&ctx, sparse), clean(&ctx, dense);
        uint64_t state = seed;
        for (int round = 0; round < 4; round++) {
            Run *r = random_run(p.fn, &(Check){.x_lo = -1, .x_hi = 1, .p_lo = 0.1, .p_hi = 1}, &state);
            r->seed[1][2] = r->seed[0][3] = 0;
            if (!rows) r->seed[0][4] = INFINITY, r->seed[1][5] = NAN;
            assert_same(sparse, dense, r);
            free(r);
        }
    }
}

/* Below the threshold nothing is cut: of operations, of choices. */
TEST(short_ones) {
    PassCtx ctx = {.session = s, .has_fma = true};
    Prog p = long_program(s, 300, 1, false, 1);
    assert_int_equal(branches(ad_vjp(&ctx, p.fn, NULL, NULL)), 0);
    p = prog_begin(s, PREC_F64, PARAMS);
    Inst *v = input_x(&p, 0);
    for (uint32_t k = 0; k < 1500; k++) v = k % 30 ? add(&p, sine(&p, v), par(&p, k % PARAMS)) : mx(&p, v, par(&p, 1));
    prog_end(&p, 1, &v);
    assert_int_equal(branches(ad_vjp(&ctx, p.fn, NULL, NULL)), 0);
}

/* ---- loops whose results have no adjoints (pass_over in ad_region.c), and gates in loops */

/* From t0 on until t > 1: frames, as steps are not linear. */
static Inst *march(Prog *p, Inst *t0, Inst *slope) {
    Inst **b = loop_begin(p, 12, false, 1, &t0),
         *t = add(p, add(p, b[1], cf(p, 0.05)), mul(p, cf(p, 0.2), mul(p, slope, tanh_(p, b[1]))));
    loop_end(p, lt(p, t, cf(p, 1)), 1, &t, &t);
    return t;
}

/* What comes of t where it got beyond 1; else nothing does. */
static Inst *where_hit(Prog *p, Inst *t, Inst *factor) {
    Inst *v;
    if_begin(p, lt(p, cf(p, 1), t));
    if_else(p, 1, (Inst *[]){mul(p, factor, expo(p, t))});
    if_end(p, 1, (Inst *[]){cf(p, 0.5)}, &v);
    return v;
}

/* Frames of each lie on those of the one before. */
static Prog marches(Session *s) {
    Prog p = prog_begin(s, PREC_F64, PARAMS);
    Inst *sum = cf(&p, 0);
    for (uint32_t k = 0; k < 3; k++)
        sum = add(&p, sum, where_hit(&p, march(&p, input_x(&p, k & 1), par(&p, k)), par(&p, 3 + k)));
    prog_end(&p, 1, &sum);
    return p;
}

/* In a loop, whose own frames hold the marks, and which nobody asks for where x.x < 0. */
static Prog marches_in_loop(Session *s) {
    Prog p = prog_begin(s, PREC_F64, PARAMS);
    Inst *zero = cf(&p, 0), *sum, *f, **b = loop_begin(&p, 4, false, 1, &zero),
         *from = mul(&p, input_x(&p, 1), sine(&p, add(&p, b[1], i2f_(&p, b[0]))));
    sum = add(&p, b[1], where_hit(&p, march(&p, from, par(&p, 1)), par(&p, 2)));
    loop_end(&p, lt(&p, sum, cf(&p, 4)), 1, &sum, &sum);
    if_begin(&p, lt(&p, cf(&p, 0), input_x(&p, 0)));
    if_else(&p, 1, (Inst *[]){mul(&p, sum, sine(&p, sum))});
    if_end(&p, 1, &zero, &f);
    prog_end(&p, 1, &f);
    return p;
}

/* Soft discs, whose edges have adjoints where the clamp is not flat; the second clamp of one reads what the first made.
 */
static Prog soft_discs(Session *s) {
    Prog p = prog_begin(s, PREC_F64, PARAMS);
    Inst *init[2] = {cf(&p, 1), cf(&p, 0)}, *sum, **b = loop_begin(&p, 8, false, 2, init), *k = b[0], *d[2];
    for (uint32_t j = 0; j < 2; j++) d[j] = sub(&p, input_x(&p, (int)j), par_at(&p, 16 * j, 8, k));
    Inst *dist = root(&p, add(&p, add(&p, mul(&p, d[0], d[0]), mul(&p, d[1], d[1])), cf(&p, 0.01)));
    Inst *t = mx(&p, mn(&p, mul(&p, sub(&p, par_at(&p, 32, 8, k), dist), cf(&p, 4)), cf(&p, 1)), cf(&p, 0));
    Inst *u = sel(&p, lt(&p, t, cf(&p, 0.5)), cf(&p, 0.25),
                  mul(&p, sine(&p, mul(&p, t, par_at(&p, 40, 8, k))), root(&p, add(&p, t, cf(&p, 0.1)))));
    Inst *a = mul(&p, t, u), *next[2] = {mul(&p, b[1], sub(&p, cf(&p, 1), a)),
                                         add(&p, b[2], mul(&p, mul(&p, b[1], a), par_at(&p, 48, 8, k)))};
    loop_end(&p, lt(&p, cf(&p, 0.01), next[0]), 2, next, init);
    sum = add(&p, init[0], init[1]);
    prog_end(&p, 1, &sum);
    return p;
}

static void check_passed_over(Prog p, uint32_t loops, uint32_t gates) {
    PassCtx ctx = {.session = p.s, .has_fma = true};
    AdOptions o = {.wrt_x = true};
    Fn *sparse = ad_vjp(&ctx, p.fn, &o, NULL);
    o.dense = true;
    Fn *dense = ad_vjp(&ctx, p.fn, &o, NULL);
    assert_int_equal(count_ops(sparse->body, OP_tapedrop), loops);
    assert_int_equal(count_ops(sparse->body, OP_any), loops + gates);
    assert_int_equal(count_ops(dense->body, OP_any), 0);
    clean(&ctx, sparse), clean(&ctx, dense);
    uint64_t state = 3;
    for (int round = 0; round < 8; round++) {
        Run *r = random_run(p.fn, &(Check){.x_lo = -1, .x_hi = 1, .p_lo = 0.1, .p_hi = 1}, &state);
        for (uint32_t l = 0; l < LANES; l++)
            if (round & 1) r->seed[0][l] = l < 4 ? 0 : NAN; /* one is passed over, the other is not */
        assert_same(sparse, dense, r);
        free(r);
    }
    Check c = {.x_lo = -1, .x_hi = 1, .p_lo = 0.1, .p_hi = 1};
    check_ad(&p, &c);
    assert_true(c.compared > 2 * c.kinks);
}

TEST(without_adjoints) {
    check_passed_over(marches(s), 3, 0);
    check_passed_over(marches_in_loop(s), 2, 0);
    check_passed_over(soft_discs(s), 1, 2);
}

/* Iterations that a flat clamp leaves without effect (opt_idle.c): the same derivatives, and frames of the others only.
 */
TEST(idle_iterations) {
    PassCtx ctx = {.session = s, .has_fma = true};
    AdOptions o = {.wrt_x = true};
    Prog p = soft_discs(s);
    Fn *idle = ir_clone(p.fn, &s->module, "idle");
    assert_true(opt_idle(&ctx, idle));
    assert_sound(idle);
    Fn *sparse = ad_vjp(&ctx, idle, &o, NULL);
    o.dense = true;
    Fn *dense = ad_vjp(&ctx, p.fn, &o, NULL);
    clean(&ctx, sparse), clean(&ctx, dense);
    uint64_t state = 4;
    for (int round = 0; round < 8; round++) {
        Run *r = random_run(p.fn, &(Check){.x_lo = -1, .x_hi = 1, .p_lo = 0.1, .p_hi = 1}, &state);
        assert_same(sparse, dense, r);
        for (uint32_t k = 0; k < 8; k++) r->params[32 + k] = -9; /* all clamps are flat: no frames */
        r->tape_bytes = 64;
        assert_int_equal(run_fn(dense, r, 0, LANES, LANES), SLT_LIMIT);
        assert_int_equal(run_fn(sparse, r, 0, LANES, LANES), SLT_OK);
        free(r);
    }
}

/* Of a choice one result is asked for by what the clamp makes, the other by the loop's end: both stay behind it. */
TEST(choices_stay_whole) {
    PassCtx ctx = {.session = s, .has_fma = true};
    Prog p = prog_begin(s, PREC_F64, PARAMS);
    Inst *sum = cf(&p, 0), *x = input_x(&p, 0), *two[2] = {cf(&p, 0.5), cf(&p, 0.25)}, *swapped[2] = {two[1], two[0]},
         **b = loop_begin(&p, 8, false, 1, &sum), *k = b[0], *r[2], *t, *next;
    if_begin(&p, lt(&p, input_x(&p, 1), mul(&p, i2f_(&p, k), cf(&p, 0.1))));
    if_else(&p, 2, two);
    if_end(&p, 2, swapped, r);
    t = mx(&p, sub(&p, x, par_at(&p, 0, 8, k)), cf(&p, 0));
    next = add(&p, b[1], mul(&p, mul(&p, sine(&p, mul(&p, t, t)), root(&p, add(&p, t, r[0]))), mul(&p, t, t)));
    loop_end(&p, lt(&p, next, mul(&p, r[1], cf(&p, 9))), 1, &next, &sum);
    prog_end(&p, 1, &sum);
    opt_idle(&ctx, p.fn);
    assert_sound(p.fn);
    Check c = {.x_lo = -1, .x_hi = 1, .p_lo = -1, .p_hi = 1};
    check_ad(&p, &c);
}

/* Which adjoints are 0 hangs on the seeds of all rows, and mixes none of them. */
TEST(rows_stay) {
    Prog p = prog_begin(s, PREC_F64, PARAMS);
    Inst *c[3] = {cf(&p, 0), cf(&p, 0), cf(&p, 0)}, **b = loop_begin(&p, 5, false, 3, c), *next[3], *colour[3],
         *kept[3];
    for (uint32_t k = 0; k < 3; k++) kept[k] = b[k + 1];
    Inst *k = b[0];
    if_begin(&p, lt(&p, input_x(&p, 0), mul(&p, i2f_(&p, k), cf(&p, 0.2))));
    for (uint32_t j = 0; j < 3; j++)
        colour[j] = par_at(&p, 0, 15, iadd_(&p, imul_(&p, k, ci(&p, 3)), ci(&p, (int32_t)j)));
    if_else(&p, 3, colour);
    if_end(&p, 3, kept, next);
    loop_end(&p, NULL, 3, next, c);
    prog_end(&p, 3, c);
    PassCtx ctx = {.session = s, .has_fma = true};
    Fn *vjp = ad_vjp(&ctx, p.fn, NULL, NULL);
    assert_int_equal(count_ops(vjp->body, OP_any), 1);
    assert_true(ad_part_rows(vjp));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(oracles),
        cmocka_unit_test(ties),
        cmocka_unit_test(as_dense),
        cmocka_unit_test(short_ones),
        cmocka_unit_test(rows_stay),
        cmocka_unit_test(idle_iterations),
        cmocka_unit_test(choices_stay_whole),
        cmocka_unit_test(without_adjoints),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
