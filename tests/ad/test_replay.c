/* Iterations that are run again, and checkpoints in many levels: what is kept, how much at most, and that the adjoints
 * stay the same. */
#include "tests/ad/ad_test.h"

static Fn *reverse(Prog *p, uint32_t budget, uint8_t replay, TapeReport *tape) {
    PassCtx ctx = {.session = p->s, .has_fma = true};
    Fn *v = ad_vjp(&ctx, p->fn, &(AdOptions){.wrt_x = true, .tape_budget = budget, .replay = replay}, tape);
    assert_sound(v);
    return v;
}

/* A walk: a state of two, a sum that no rule mentions, a way out that depends on the state. Many values would be
 * stored, two are enough. */
static Prog walk(Session *s, uint32_t n, double far) {
    Prog p = prog_begin(s, PREC_F64, 4);
    Inst *r[3];
    Inst **c = loop_begin(&p, n, false, 3, (Inst *[]){cf(&p, 0), input_x(&p, 0), input_x(&p, 1)});
    Inst *u = sine(&p, add(&p, mul(&p, c[2], par(&p, 0)), i2f_(&p, c[0]))), *w = tanh_(&p, mul(&p, c[3], par(&p, 1)));
    Inst *len = root(&p, add(&p, add(&p, mul(&p, u, u), mul(&p, w, w)), cf(&p, 0.1))), *t[1];
    if_begin(&p, lt(&p, u, w));
    Inst *q = dvd(&p, expo(&p, mul(&p, u, w)), len);
    if_else(&p, 1, &q);
    Inst *q2 = mul(&p, root(&p, add(&p, mul(&p, w, w), cf(&p, 0.3))), par(&p, 2));
    if_end(&p, 1, &q2, t);
    Inst *a = tanh_(&p, add(&p, t[0], mul(&p, c[2], cf(&p, 0.7)))),
         *b = sine(&p, sub(&p, mul(&p, t[0], par(&p, 3)), dvd(&p, c[3], len)));
    Inst *sum = add(&p, c[1], mul(&p, t[0], cf(&p, 0.01)));
    loop_end(&p, lt(&p, a, cf(&p, far)), 3, (Inst *[]){sum, a, b}, r);
    prog_end(&p, 2, (Inst *[]){add(&p, r[0], mul(&p, r[1], r[2])), r[2]});
    return p;
}

TEST(keeps_the_state) {
    Prog p = walk(s, 20, 0.95);
    TapeReport stored, replayed;
    reverse(&p, 1u << 30, AD_REPLAY_NEVER, &stored);
    reverse(&p, 1u << 30, AD_REPLAY_ALWAYS, &replayed);
    assert_true(stored.bytes_per_lane >= 20 * (4 + 6 * 8));
    assert_int_equal(replayed.bytes_per_lane, 20 * (4 + 2 * 8));
    assert_non_null(strstr(replayed.text, "each iteration replayed"));
    assert_null(strstr(stored.text, "each iteration replayed"));
    check_ad(&p, &(Check){.replay = AD_REPLAY_ALWAYS});
    /* the state at the start of a segment is the same two values: the sum is not carried through a second run */
    TapeReport levels;
    reverse(&p, 1, AD_REPLAY_ALWAYS, &levels);
    assert_non_null(strstr(levels.text, "one frame of 20 bytes"));
    assert_null(strstr(levels.text, "one frame of 28 bytes"));
}

/* Loops of arithmetic are better off with what they store: only loops that search are replayed unasked. */
TEST(not_unasked) {
    Prog p = walk(s, 20, 0.95);
    TapeReport tape;
    reverse(&p, 0, AD_REPLAY_AUTO, &tape);
    assert_null(strstr(tape.text, "replayed"));
}

/* As many levels as it takes: the bound does not depend on the number of iterations. */
TEST(bounded) {
    static const uint32_t trips[] = {10, 100, 1000, 10000, 1000000, 100000000, 4000000000};
    for (int replay = 0; replay < 2; replay++)
        for (uint32_t k = 0; k < sizeof trips / sizeof *trips; k++) {
            Prog p = walk(s, trips[k], 2);
            TapeReport tape;
            reverse(&p, 2048, replay ? AD_REPLAY_ALWAYS : AD_REPLAY_NEVER, &tape);
            if (tape.bytes_per_lane > 2048)
                print_error("%u iterations: %llu bytes\n%s\n", trips[k], (unsigned long long)tape.bytes_per_lane,
                            tape.text);
            assert_true(tape.bytes_per_lane <= 2048);
        }
    Prog p = walk(s, 4000000000, 2); /* unasked: 64 KiB */
    TapeReport tape;
    reverse(&p, 0, AD_REPLAY_AUTO, &tape);
    assert_true(tape.bytes_per_lane <= 64 * 1024 && tape.bytes_per_lane > 1024);
}

TEST(levels_agree) {
    static const uint32_t budgets[] = {20000, 2000, 500, 260, 1}, trips[] = {300, 257, 64, 7, 5, 3};
    for (uint32_t t = 0; t < sizeof trips / sizeof *trips; t++) {
        Prog p = walk(s, trips[t], t % 2 ? 0.97 : 2);
        TapeReport tape;
        Fn *stored = reverse(&p, 1u << 30, AD_REPLAY_NEVER, &tape);
        uint64_t least = tape.bytes_per_lane;
        for (uint32_t b = 0; b < sizeof budgets / sizeof *budgets; b++)
            for (int replay = 0; replay < 2; replay++) {
                Fn *other = reverse(&p, budgets[b], replay ? AD_REPLAY_ALWAYS : AD_REPLAY_NEVER, &tape);
                assert_true(tape.bytes_per_lane <= least);
                compare_kernels(p.fn, stored, other, 4);
            }
    }
}

/* A replayed loop in a replayed loop, with an array that the outer one fills and the inner one reads, and one of its
 * own. */
TEST(nested_with_arrays) {
    Prog p = prog_begin(s, PREC_F64, 4);
    Inst *x = input_x(&p, 0), *r[2], *q[2], *none[1];
    Inst **c = loop_begin(&p, 9, false, 2, (Inst *[]){x, input_x(&p, 1)});
    Inst *table = array(&p, 4);
    for (int k = 0; k < 4; k++)
        put(&p, table, ci(&p, k), sine(&p, add(&p, mul(&p, c[1], par(&p, (uint32_t)k)), cf(&p, k))));
    Inst **d = loop_begin(&p, 6, false, 2, (Inst *[]){c[2], c[1]});
    Inst *own = array(&p, 2);
    Inst *e = at(&p, table, ir_emit2(&p.b, OP_iand, d[0], ci(&p, 3)));
    put(&p, own, ci(&p, 0), root(&p, add(&p, mul(&p, e, d[1]), cf(&p, 2))));
    if_begin(&p, lt(&p, e, d[2]));
    put(&p, own, ci(&p, 0), mul(&p, e, expo(&p, d[1])));
    if_else(&p, 0, NULL);
    if_end(&p, 0, NULL, none);
    Inst *f = tanh_(&p, add(&p, at(&p, own, ci(&p, 0)), d[2])), *g = sine(&p, mul(&p, f, d[1]));
    loop_end(&p, lt(&p, g, cf(&p, 0.8)), 2, (Inst *[]){f, g}, q);
    put(&p, table, ci(&p, 1), mul(&p, q[0], q[1]));
    Inst *n = tanh_(&p, add(&p, at(&p, table, ci(&p, 1)), mul(&p, q[1], at(&p, table, ci(&p, 2)))));
    loop_end(&p, lt(&p, n, cf(&p, 0.9)), 2, (Inst *[]){n, q[0]}, r);
    prog_end(&p, 2, r);
    Check k = {.replay = AD_REPLAY_ALWAYS};
    check_ad(&p, &k);
    assert_true(k.compared > k.kinks);
    Fn *stored = reverse(&p, 1u << 30, AD_REPLAY_NEVER, NULL);
    for (uint32_t budget = 1; budget < 1u << 20; budget *= 16)
        for (uint8_t replay = AD_REPLAY_ALWAYS; replay <= AD_REPLAY_KEEP; replay++)
            compare_kernels(p.fn, stored, reverse(&p, budget, replay, NULL), 4);
}

/* ---- opt_induction: counters behind a break, which a path's random numbers are */

/* for (k < 12) { if (x < k * step) break (n + 5); n += 1; [if (odd) n += 3;] n += 2; } */
static Prog counter(Session *s, bool uneven) {
    Prog p = prog_begin(s, PREC_F64, 2);
    Inst *x = input_x(&p, 0), *yes = ir_constb(&p.b, true), *no = ir_constb(&p.b, false), *r[3], *t[3];
    Inst **c = loop_begin(&p, 12, false, 3, (Inst *[]){cf(&p, 0), ci(&p, 7), no});
    if_begin(&p, lt(&p, add(&p, x, cf(&p, 1)), mul(&p, i2f_(&p, c[0]), mul(&p, par(&p, 0), par(&p, 0)))));
    if_else(&p, 3, (Inst *[]){add(&p, c[1], cf(&p, 0.5)), iadd_(&p, c[2], ci(&p, 5)), yes});
    Inst *sum = add(&p, c[1], sine(&p, mul(&p, i2f_(&p, c[2]), par(&p, 1)))), *n = iadd_(&p, c[2], ci(&p, 1));
    if (uneven) {
        Inst *u[1];
        if_begin(&p, lt(&p, sum, cf(&p, 0.2)));
        Inst *more = iadd_(&p, n, ci(&p, 3));
        if_else(&p, 1, &more);
        if_end(&p, 1, &n, u);
        n = u[0];
    }
    if_end(&p, 3, (Inst *[]){sum, iadd_(&p, n, ci(&p, 2)), c[3]}, t);
    loop_end(&p, ir_emit1(&p.b, OP_bnot, t[2]), 3, t, r);
    prog_end(&p, 2, (Inst *[]){r[0], i2f_(&p, r[1])});
    return p;
}

static bool mentions(const Block *b, const Inst *x) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = 0; a < i->nargs; a++)
            if (i->args[a] == x) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (mentions(i->region[r], x)) return true;
    }
    return false;
}

static const Inst *the_loop(const Fn *fn) {
    const Inst *i = fn->body->first;
    while (i->op != OP_loop) i = i->next;
    return i;
}

TEST(counters) {
    for (int uneven = 0; uneven < 2; uneven++) {
        Prog p = counter(s, uneven);
        PassCtx ctx = {.session = s, .has_fma = true};
        Fn *before = ir_clone(p.fn, &s->module, "before");
        assert_true(opt_induction(&ctx, p.fn));
        assert_sound(p.fn);
        const Block *body = the_loop(p.fn)->region[0];
        assert_false(mentions(body, body->params[3])); /* the flag is false in every iteration */
        assert_int_equal(mentions(body, body->params[2]), uneven);
        uint64_t state = 3;
        for (int round = 0; round < 6; round++) {
            Run *a = random_run(before, &(Check){.x_lo = -1, .x_hi = 1, .p_lo = -1, .p_hi = 1}, &state),
                *b = malloc(sizeof *b);
            *b = *a;
            assert_int_equal(run_fn(before, a, 0, LANES, LANES), SLT_OK);
            assert_int_equal(run_fn(p.fn, b, 0, LANES, LANES), SLT_OK);
            for (int o = 0; o < 2; o++) assert_memory_equal(a->out[o], b->out[o], LANES * sizeof(double));
            free(a), free(b);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(keeps_the_state), cmocka_unit_test(not_unasked),        cmocka_unit_test(bounded),
        cmocka_unit_test(levels_agree),    cmocka_unit_test(nested_with_arrays), cmocka_unit_test(counters),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
