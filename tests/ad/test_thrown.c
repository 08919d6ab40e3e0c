/* What a program throws away leaves no trace in its derivatives: something infinite or NaN where d < 0.3, something
 * behind it, and a way to keep only what is computed where d > 0.3. Both modes and the adjoint identity against
 * differences (check_ad), for every combination. */
#include "tests/ad/ad_test.h"

/* Ordinary, and not the same, where d > 0.3. */
typedef Inst *Function(Prog *p, Inst *d);
static Inst *positive(Prog *p, Inst *d) { return mx(p, d, cf(p, 0)); } /* u: 0 on half of the line */
static Inst *over(Prog *p, Inst *u) { return dvd(p, cf(p, 1), u); }
static Inst *op1(Prog *p, Op op, Inst *x) { return ir_emit1(&p->b, op, x); }
static Inst *op2(Prog *p, Op op, Inst *x, Inst *y) { return ir_emit2(&p->b, op, x, y); }
static Inst *square(Prog *p, Inst *x) { return mul(p, x, x); }

static Inst *root_of_negative(Prog *p, Inst *d) { return root(p, d); }
static Inst *log_of_negative(Prog *p, Inst *d) { return op1(p, OP_flog, d); }
static Inst *log_of_log(Prog *p, Inst *d) { return op1(p, OP_flog2, op1(p, OP_flog2, add(p, d, cf(p, 1.1)))); }
static Inst *acos_outside(Prog *p, Inst *d) { return op1(p, OP_facos, sub(p, cf(p, 1.2), mul(p, d, cf(p, 0.8)))); }
static Inst *asin_outside(Prog *p, Inst *d) { return op1(p, OP_fasin, sub(p, cf(p, 1.2), mul(p, d, cf(p, 0.8)))); }
static Inst *power_of_negative(Prog *p, Inst *d) { return op2(p, OP_fpow, d, cf(p, 0.45)); }
static Inst *power_of_a_parameter(Prog *p, Inst *d) { return op2(p, OP_fpow, d, par(p, 1)); }
static Inst *rsqrt_of_negative(Prog *p, Inst *d) { return op1(p, OP_frsqrt, d); }
static Inst *zero_by_zero(Prog *p, Inst *d) { return dvd(p, square(p, positive(p, d)), positive(p, d)); }
static Inst *one_by_zero(Prog *p, Inst *d) { return over(p, positive(p, d)); }
static Inst *zero_times_infinity(Prog *p, Inst *d) { return mul(p, square(p, positive(p, d)), one_by_zero(p, d)); }
static Inst *infinity_less_infinity(Prog *p, Inst *d) {
    return sub(p, one_by_zero(p, d), over(p, mul(p, positive(p, d), cf(p, 2))));
}
static Inst *root_of_zero(Prog *p, Inst *d) { return root(p, positive(p, d)); }
static Inst *cube_root_of_zero(Prog *p, Inst *d) { return op1(p, OP_fcbrt, positive(p, d)); }
static Inst *length_of_zero(Prog *p, Inst *d) {
    Inst *u = positive(p, d);
    return root(p, add(p, square(p, u), square(p, mul(p, u, par(p, 1)))));
}
static Inst *unit_of_zero(Prog *p, Inst *d) {
    return mul(p, positive(p, d), op1(p, OP_frsqrt, square(p, length_of_zero(p, d))));
}
static Inst *angle_of_zero(Prog *p, Inst *d) {
    Inst *u = positive(p, d);
    return op2(p, OP_fatan2, u, mul(p, u, add(p, par(p, 1), cf(p, 2))));
}
static Inst *zero_to_the_zero(Prog *p, Inst *d) { return op2(p, OP_fpow, positive(p, d), positive(p, d)); }
static Inst *wave_of_infinity(Prog *p, Inst *d) { return sine(p, one_by_zero(p, d)); }
static Inst *tangent_of_infinity(Prog *p, Inst *d) { return op1(p, OP_ftan, one_by_zero(p, d)); }
static Inst *overflowing(Prog *p, Inst *d) { return expo(p, mul(p, cf(p, 1e4), sub(p, cf(p, 0.1), d))); }
static Inst *overflows_that_meet(Prog *p, Inst *d) {
    Inst *e = expo(p, mul(p, cf(p, 4), sub(p, op2(p, OP_fpow, cf(p, 1e4), neg(p, d)), cf(p, 0.1))));
    return dvd(p, e, add(p, cf(p, 1), e));
}
static Inst *hyperbolic(Prog *p, Inst *d) {
    Inst *v = one_by_zero(p, d);
    return sub(p, op1(p, OP_fcosh, v), op1(p, OP_fsinh, v));
}
static Inst *ratio_of_parameters(Prog *p, Inst *d) { /* 0/0 of what does not depend on x */
    return dvd(p, positive(p, d), add(p, positive(p, par(p, 1)), positive(p, d)));
}
static Inst *squared_again_and_again(Prog *p, Inst *d) { /* z = z^2 + c, of which one part is a difference */
    Inst *re = sub(p, cf(p, 1), d), *im = mul(p, d, cf(p, 0.5));
    Inst **v = loop_begin(p, 24, true, 2, (Inst *[]){re, im}), *x = v[1], *y = v[2], *to[2];
    to[0] = add(p, sub(p, square(p, x), square(p, y)), mul(p, par(p, 1), cf(p, 0.1)));
    to[1] = mul(p, mul(p, cf(p, 2), x), y);
    loop_end(p, NULL, 2, to, to);
    return add(p, to[0], to[1]);
}
static Inst *root_in_a_loop(Prog *p, Inst *d) { /* the NaN arrives two iterations later at what goes out */
    Inst **v = loop_begin(p, 4, true, 3, (Inst *[]){d, d, d}), *to[3] = {root(p, v[2]), v[3], v[1]};
    loop_end(p, NULL, 3, to, to);
    return to[1];
}
static Inst *root_in_an_array(Prog *p, Inst *d) {
    Inst *a = array(p, 2);
    put(p, a, ci(p, 1), root(p, d));
    return at(p, a, ci(p, 1));
}
static Inst *constant_nan(Prog *p, Inst *d) { return mul(p, sel(p, lt(p, d, cf(p, 0)), cf(p, NAN), d), d); }

static Inst *itself(Prog *p, Inst *v) { return mul(p, v, par(p, 2)); }
static Inst *wave(Prog *p, Inst *v) { return op1(p, OP_fcos, add(p, mul(p, v, cf(p, 9)), par(p, 2))); }
static Inst *clamped(Prog *p, Inst *v) { return mul(p, mn(p, mx(p, v, cf(p, 0)), cf(p, 1)), par(p, 2)); }
static Inst *arc(Prog *p, Inst *v) { return op1(p, OP_fatan, mul(p, v, par(p, 2))); }
static Inst *soft(Prog *p, Inst *v) { return mul(p, tanh_(p, v), op1(p, OP_ferf, mul(p, v, par(p, 2)))); }
static Inst *bell(Prog *p, Inst *v) { return mul(p, expo(p, neg(p, square(p, v))), par(p, 2)); }
static Inst *witch(Prog *p, Inst *v) { return dvd(p, par(p, 2), add(p, cf(p, 1), square(p, v))); }
static Inst *blend(Prog *p, Inst *v) {
    Inst *h = clamped(p, v);
    return ir_emit3(&p->b, OP_ffma, h, sub(p, par(p, 2), v), v);
}
static Inst *signs(Prog *p, Inst *v) { return op2(p, OP_fcopysign, op1(p, OP_fabs, v), par(p, 2)); }

typedef Inst *Throwing(Prog *p, Inst *d, Inst *bad, Inst *good);
static Inst *below(Prog *p, Inst *d) { return lt(p, d, cf(p, 0.3)); }
static Inst *by_select(Prog *p, Inst *d, Inst *bad, Inst *good) { return sel(p, below(p, d), good, bad); }
static Inst *by_if(Prog *p, Inst *d, Inst *bad, Inst *good) {
    Inst *r;
    if_begin(p, below(p, d));
    Inst *yes = mul(p, good, good);
    if_else(p, 1, &yes);
    if_end(p, 1, &bad, &r);
    return r;
}
static Inst *by_later_if(Prog *p, Inst *d, Inst *bad, Inst *good) { /* what stands behind the pole is in the region */
    Inst *r;
    if_begin(p, lt(p, d, cf(p, 5)));
    Inst *behind = sine(p, mul(p, bad, par(p, 3)));
    if_else(p, 1, &behind);
    if_end(p, 1, &good, &r);
    return sel(p, below(p, d), good, r);
}
static Inst *by_array(Prog *p, Inst *d, Inst *bad, Inst *good) {
    Inst *a = array(p, 3), *i = sel(p, below(p, d), ci(p, 1), ci(p, 2));
    put(p, a, ci(p, 1), bad);
    put(p, a, i, good);
    return at(p, a, ci(p, 1));
}
static Inst *by_iteration(Prog *p, Inst *d, Inst *bad, Inst *good) { /* the third overwrites what the first two carry */
    Inst **v = loop_begin(p, 4, true, 1, &bad), *k = v[0];
    Inst *last = ir_emit2(&p->b, OP_ieq, k, ci(p, 2)), *next = add(p, sine(p, v[1]), mul(p, v[1], par(p, 3)));
    next = sel(p, band_(p, last, below(p, d)), good, next);
    loop_end(p, NULL, 1, &next, &next);
    return next;
}
static Inst *by_break(Prog *p, Inst *d, Inst *bad, Inst *good) { /* a flag remembers */
    Inst **v = loop_begin(p, 6, false, 2, (Inst *[]){good, bad}), *to[2];
    to[0] = sel(p, below(p, d), v[1], add(p, v[2], v[1]));
    to[1] = mul(p, v[2], cf(p, 0.5));
    loop_end(p, lt(p, i2f_(p, v[0]), mul(p, par(p, 3), cf(p, 4))), 2, to, to);
    return to[0];
}

#define EACH(name) {#name, name}
static const struct {
    const char *name;
    Function *of;
} poles[] =
    {
        EACH(root_of_negative),
        EACH(log_of_negative),
        EACH(log_of_log),
        EACH(acos_outside),
        EACH(asin_outside),
        EACH(power_of_negative),
        EACH(power_of_a_parameter),
        EACH(rsqrt_of_negative),
        EACH(zero_by_zero),
        EACH(one_by_zero),
        EACH(zero_times_infinity),
        EACH(infinity_less_infinity),
        EACH(root_of_zero),
        EACH(cube_root_of_zero),
        EACH(length_of_zero),
        EACH(unit_of_zero),
        EACH(angle_of_zero),
        EACH(zero_to_the_zero),
        EACH(wave_of_infinity),
        EACH(tangent_of_infinity),
        EACH(overflowing),
        EACH(overflows_that_meet),
        EACH(hyperbolic),
        EACH(ratio_of_parameters),
        EACH(squared_again_and_again),
        EACH(root_in_a_loop),
        EACH(root_in_an_array),
        EACH(constant_nan),
},
  behind[] = {
      EACH(itself), EACH(wave), EACH(clamped), EACH(arc), EACH(soft), EACH(bell), EACH(witch), EACH(blend), EACH(signs),
};
static const struct {
    const char *name;
    Throwing *of;
} ways[] = {
    EACH(by_select), EACH(by_if), EACH(by_later_if), EACH(by_array), EACH(by_iteration), EACH(by_break),
};
#define COUNT(a) (sizeof a / sizeof *a)

static Inst *distance(Prog *p) { return add(p, input_x(p, 0), mul(p, par(p, 0), cf(p, 0.5))); }

TEST(combinations) {
    uint32_t compared = 0, kinks = 0;
    for (uint32_t k = 0; k < COUNT(poles); k++)
        for (uint32_t b = 0; b < COUNT(behind); b++)
            for (uint32_t w = 0; w < COUNT(ways); w++) {
                ArenaMark m = arena_mark(&s->module);
                Prog p = prog_begin(s, PREC_F64, 4);
                Inst *d = distance(&p), *good = add(&p, mul(&p, d, par(&p, 1)), par(&p, 3));
                Inst *bad = behind[b].of(&p, poles[k].of(&p, d)), *f = ways[w].of(&p, d, bad, good);
                prog_end(&p, 1, &f);
                Check c = {0};
                if (getenv("VERBOSE")) print_message("%s %s %s\n", poles[k].name, behind[b].name, ways[w].name);
                check_ad(&p, &c);
                compared += c.compared, kinks += c.kinks;
                arena_reset(&s->module, m);
            }
    print_message("%u compared, %u kinks\n", compared, kinks);
    assert_true(compared > 9 * kinks);
}

/* An output that nobody asks for, in no lane, and one that is asked for beside it. */
TEST(unseen) {
    for (uint32_t k = 0; k < COUNT(poles); k++)
        for (uint32_t b = 0; b < COUNT(behind); b++) {
            ArenaMark m = arena_mark(&s->module);
            Prog p = prog_begin(s, PREC_F64, 4);
            Inst *d = distance(&p), *bad = behind[b].of(&p, poles[k].of(&p, d));
            prog_end(&p, 2, (Inst *[]){bad, mul(&p, sine(&p, d), par(&p, 3))});
            PassCtx ctx = {.session = s, .has_fma = true};
            Fn *v = ad_vjp(&ctx, p.fn, &(AdOptions){.wrt_x = true}, NULL);
            clean(&ctx, v);
            uint64_t state = 1;
            Run *r = random_run(p.fn, &(Check){.x_lo = -1, .x_hi = 1, .p_lo = 0.5, .p_hi = 1}, &state);
            for (uint32_t l = 0; l < LANES; l++) r->seed[0][l] = 0;
            assert_int_equal(run_fn(v, r, 0, LANES, LANES), SLT_OK);
            double last = 0;
            for (uint32_t l = 0; l < LANES; l++) {
                double at = r->x[0][l] + r->params[0] * 0.5, dx = r->seed[1][l] * cos(at) * r->params[3];
                if (!near(r->out[2][l], dx, 1e-12)) print_error("%s %s: %g\n", poles[k].name, behind[b].name, at);
                assert_true(near(r->out[2][l], dx, 1e-12));
                last += r->seed[1][l] * sin(at);
            }
            assert_true(near(r->adj[3], last, 1e-12) && r->adj[1] == 0 && r->adj[2] == 0);
            free(r);
            arena_reset(&s->module, m);
        }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(combinations), cmocka_unit_test(unseen)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
