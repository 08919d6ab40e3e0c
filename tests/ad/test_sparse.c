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

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(oracles), cmocka_unit_test(ties), cmocka_unit_test(as_dense),
                                       cmocka_unit_test(short_ones)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
