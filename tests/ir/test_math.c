/* Accuracy of lower_math: every elementary function, both precisions, with and without fma, against the C library's
 * long double. */
#include "compiler/ir/bounds.h"
#include "compiler/ir/rows.h"
#include "compiler/pass/lower_math.h"
#include "tests/ir/ir_test.h"

enum { POINTS = 24000, MAX_POINTS = POINTS + 2000 };

typedef long double Real;
typedef Real Reference(Real x, Real y);

#define REF1(name, call)                                                                                               \
    static Real ref_##name(Real x, Real y) {                                                                           \
        (void)y;                                                                                                       \
        return call;                                                                                                   \
    }
REF1(rsqrt, 1 / sqrtl(x))
REF1(cbrt, cbrtl(x))
REF1(exp, expl(x))
REF1(exp2, exp2l(x))
REF1(log, logl(x))
REF1(log2, log2l(x))
REF1(sin, sinl(x))
REF1(cos, cosl(x))
REF1(tan, tanl(x))
REF1(asin, asinl(x))
REF1(acos, acosl(x))
REF1(atan, atanl(x))
REF1(sinh, sinhl(x))
REF1(cosh, coshl(x))
REF1(tanh, tanhl(x))
REF1(erf, erfl(x))
static Real ref_atan2(Real y, Real x) { return atan2l(y, x); }
static Real ref_pow(Real x, Real y) { return powl(x, y); }

typedef struct Case {
    Op op;
    Reference *reference;
    double lo, hi; /* sampled uniformly; logarithmically over all magnitudes too where `wide` */
    bool wide, positive;
    double ulp32, ulp64; /* allowed */
} Case;

/* Trigonometric arguments up to 1e5 are promised; beyond, only that results stay in range (test_far). */
static const Case cases[] = {
    {OP_frsqrt, ref_rsqrt, 0, 10, true, true, 2, 2},       {OP_fcbrt, ref_cbrt, -10, 10, true, false, 2, 2},
    {OP_fexp, ref_exp, -87, 88.7, false, false, 3, 3},     {OP_fexp, ref_exp, -1, 1, false, false, 3, 3},
    {OP_fexp2, ref_exp2, -125, 127.9, false, false, 3, 3}, {OP_flog, ref_log, 0, 10, true, true, 3, 3},
    {OP_flog, ref_log, 0.5, 2, false, true, 3, 3},         {OP_flog2, ref_log2, 0, 10, true, true, 3, 4},
    {OP_flog2, ref_log2, 0.5, 2, false, true, 3, 4},       {OP_fsin, ref_sin, -10, 10, false, false, 3, 3},
    {OP_fcos, ref_cos, -10, 10, false, false, 3, 3},       {OP_ftan, ref_tan, -10, 10, false, false, 4, 4},
    {OP_fsin, ref_sin, -1e5, 1e5, false, false, 3, 3},     {OP_fcos, ref_cos, -1e5, 1e5, false, false, 3, 3},
    {OP_ftan, ref_tan, -1e5, 1e5, false, false, 4, 4},     {OP_fasin, ref_asin, -1, 1, false, false, 3, 3},
    {OP_facos, ref_acos, -1, 1, false, false, 3, 3},       {OP_fatan, ref_atan, -5, 5, true, false, 3, 3},
    {OP_fatan2, ref_atan2, -3, 3, true, false, 4, 4},      {OP_fsinh, ref_sinh, -5, 5, false, false, 4, 4},
    {OP_fsinh, ref_sinh, -88, 88, false, false, 4, 4},     {OP_fcosh, ref_cosh, -89, 89, false, false, 4, 4},
    {OP_ftanh, ref_tanh, -3, 3, true, false, 3, 3},        {OP_ferf, ref_erf, -4, 4, true, false, 3, 4},
    {OP_fpow, ref_pow, 0, 10, true, true, 8, 4},           {OP_fpow, ref_pow, 0.9, 1.1, false, true, 8, 4},
};

static uint64_t next_random(uint64_t *state) {
    uint64_t z = *state += 0x9e3779b97f4a7c15u;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

static double uniform(uint64_t *state) { return (double)(next_random(state) >> 11) * 0x1p-53; }

static double sample(const Case *c, bool f32, uint64_t *state) {
    if (!c->wide || next_random(state) & 1) return c->lo + (c->hi - c->lo) * uniform(state);
    double range = f32 ? 120 : 1000;
    double v = exp2((uniform(state) * 2 - 1) * range);
    return c->positive || next_random(state) & 1 ? v : -v;
}

typedef struct Data {
    double x[MAX_POINTS], y[MAX_POINTS], out[MAX_POINTS];
    uint32_t n;
} Data;

static bool has_math(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (ir_ops[i->op].math) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (has_math(i->region[r])) return true;
    }
    return false;
}

/* Rounds the points to the precision, lowers and runs; returns the number of operations. */
static uint32_t evaluate(Op op, Precision p, bool fma, Data *d) {
    TestFn t = open_fn(p);
    Inst *args[2] = {ir_input(&t.b, IN_X0), NULL};
    if (ir_ops[op].nargs == 2) args[1] = ir_input(&t.b, IN_X1);
    Inst *v = ir_emit(&t.b, op, ir_ops[op].nargs, args);
    ir_yield(&t.b, 1, &v);
    PassCtx ctx = {.session = t.s, .has_fma = fma};
    assert_true(lower_math(&ctx, t.fn));
    assert_false(has_math(t.fn->body));
    check_sound(t.fn);
    uint32_t count = 0;
    for (const Inst *i = t.fn->body->first; i; i = i->next)
        count +=
            !ir_is_const(i) && i->op != OP_input && i->op != OP_yield && i->op != OP_fasuint && i->op != OP_iasfloat;
    SltKernelArgs args_in = {0};
    float *fx = malloc(3 * sizeof *fx * d->n), *fy = fx + d->n, *fo = fy + d->n;
    for (uint32_t k = 0; k < d->n; k++) {
        if (p == PREC_F64) continue;
        fx[k] = (float)d->x[k], fy[k] = (float)d->y[k];
        d->x[k] = (double)fx[k], d->y[k] = (double)fy[k];
    }
    bool f32 = p == PREC_F32;
    args_in.in[IN_X0] = f32 ? (void *)fx : d->x;
    args_in.in[IN_X1] = f32 ? (void *)fy : d->y;
    args_in.out[0] = f32 ? (void *)fo : d->out;
    assert_int_equal(run(t.fn, &args_in, d->n, 16), SLT_OK);
    for (uint32_t k = 0; f32 && k < d->n; k++) d->out[k] = (double)fo[k];
    free(fx);
    close_fn(&t);
    return count;
}

/* Distance in units of the last place of the exact result; the unit of the smallest normal number below that. */
static Real ulps(double got, Real want, bool f32) {
    Real top = f32 ? (Real)3.40282357e38L : (Real)1.7976931348623157e308L;
    if (isnan(want) || isnan(got)) return isnan(want) && isnan(got) ? 0 : INFINITY;
    if (isinf(got) || fabsl(want) > top) {
        if (isinf(got) && got * want > 0 && fabsl(want) > top * 0.9999995L) return 0;
        return isinf(got) && isinf((double)want) && got * want > 0 ? 0 : INFINITY;
    }
    if (want == 0) return got == 0 ? 0 : INFINITY;
    int e = ilogbl(want), low = f32 ? -126 : -1022;
    return fabsl((Real)got - want) / ldexpl(1, (e < low ? low : e) - (f32 ? 23 : 52));
}

static void accuracy(Precision p, bool fma) {
    bool f32 = p == PREC_F32;
    Data *d = malloc(sizeof *d);
    bool bad = false;
    printf("%s %s: largest error in ulp (operations)\n", f32 ? "f32" : "f64", fma ? "fma" : "no fma");
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        const Case *c = &cases[k];
        uint64_t state = 1234 + k;
        d->n = POINTS;
        for (uint32_t j = 0; j < POINTS; j++) {
            d->x[j] = sample(c, f32, &state);
            d->y[j] = c->op == OP_fpow ? (uniform(&state) * 2 - 1) * (f32 ? 127 : 1000) / (fabs(log2(d->x[j])) + 0.01)
                                       : sample(c, f32, &state);
        }
        uint32_t ops = evaluate(c->op, p, fma, d);
        Real worst = 0;
        uint32_t at = 0;
        for (uint32_t j = 0; j < POINTS; j++) {
            Real want = c->reference(d->x[j], d->y[j]);
            if (fabsl(want) < (f32 ? 2e-38L : 4e-308L)) continue; /* may be 0 */
            Real u = ulps(d->out[j], want, f32);
            if (u > worst) worst = u, at = j;
        }
        Real allowed = f32 ? c->ulp32 : c->ulp64;
        printf("  %-6s [%g, %g]%s %.2Lf (%u)%s\n", ir_ops[c->op].name, c->lo, c->hi, c->wide ? " and wide" : "", worst,
               ops, worst > allowed ? "  <-- too much" : "");
        if (worst > allowed) {
            bad = true;
            printf("      at %.17g, %.17g: %.17g, not %.17Lg\n", d->x[at], d->y[at], d->out[at],
                   c->reference(d->x[at], d->y[at]));
        }
    }
    free(d);
    assert_false(bad);
}

static void test_f32_fma(void **state) { (void)state, accuracy(PREC_F32, true); }
static void test_f32_plain(void **state) { (void)state, accuracy(PREC_F32, false); }
static void test_f64_fma(void **state) { (void)state, accuracy(PREC_F64, true); }
static void test_f64_plain(void **state) { (void)state, accuracy(PREC_F64, false); }

/* The tables of compiler/ir/logs.h: the rest is exact in f32, the high part a multiple of 2^-17, and all parts together
 * are the logarithm. */
static void test_log_parts(void **state) {
    (void)state;
    uint64_t seed = 5;
    for (int n = 0; n < 200000; n++) {
        uint32_t bits = n < 4096 ? (uint32_t)n << 19 : (uint32_t)next_random(&seed) & 0x7fffffff;
        float x, part[3], zero = 0;
        memcpy(&x, &bits, sizeof x);
        if (!isfinite(x) || x == 0) continue;
        const Op ops[] = {OP_flogm, OP_flogh, OP_flogl};
        for (int k = 0; k < 3; k++) rows_eval_f32((uint8_t)ops[k], 1, &part[k], &x, &zero, &zero);
        double f, exact = x;
        rows_eval_f64(OP_flogm, 1, &f, &exact, &exact, &exact);
        assert_true((double)part[0] == f && fabs(f) <= 0x1.00001p-4);
        assert_true(rint(ldexp((double)part[1], 17)) == ldexp((double)part[1], 17));
        Real want = logl((Real)x), got = (Real)part[1] + (Real)part[2] + log1pl((Real)part[0]);
        assert_true(fabsl(got - want) <= fabsl(want) * 0x1p-35L);
    }
}

/* Every pair of edge values, for every function: as C's libm, also in the sign of zero. */
static void edges(Precision p, bool fma) {
    bool f32 = p == PREC_F32;
    const double list[] = {0.0,  -0.0,     1,         -1,   0.5,     -0.5,    2,       -2,       3,        -3,  2.5,
                           -2.5, INFINITY, -INFINITY, NAN,  1e-3,    1e30,    -1e30,   1e-30,    -1e-30,   100, -100,
                           1e4,  -1e4,     7,         1001, 0.99999, 1.00001, 1e9 + 1, 0x1p-140, -0x1p-140};
    enum { EDGES = sizeof list / sizeof *list };
    Data *d = malloc(sizeof *d);
    bool bad = false;
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        const Case *c = &cases[k];
        if (k && c->op == cases[k - 1].op) continue;
        bool two = ir_ops[c->op].nargs == 2;
        d->n = 0;
        for (uint32_t a = 0; a < EDGES; a++)
            for (uint32_t b = 0; b < (two ? EDGES : 1u); b++) d->x[d->n] = list[a], d->y[d->n++] = list[b];
        evaluate(c->op, p, fma, d);
        for (uint32_t j = 0; j < d->n; j++) {
            double x = d->x[j], y = d->y[j], got = d->out[j];
            Real want = c->reference(x, y);
            bool far = (c->op == OP_fsin || c->op == OP_fcos || c->op == OP_ftan) && fabs(x) > 1e5 && isfinite(x);
            if (far) {
                if (c->op != OP_ftan && !(fabs(got) <= 1))
                    bad = true, printf("%s(%g) = %g\n", ir_ops[c->op].name, x, got);
                continue;
            }
            if (fabsl(want) < (f32 ? 2e-38L : 4e-308L)) { /* zero, or a subnormal that may be zero: the sign holds */
                if (fabs(got) < (f32 ? 2e-38 : 4e-308) &&
                    (want != 0 || !signbit(got) == !signbit(want) || c->op == OP_fsin || c->op == OP_ftan))
                    continue;
                bad = true;
                printf("%s %s(%g, %g) = %g, not %Lg\n", f32 ? "f32" : "f64", ir_ops[c->op].name, x, y, got, want);
                continue;
            }
            Real u = ulps(got, want, f32);
            if (!(u <= (f32 ? c->ulp32 : c->ulp64))) {
                bad = true;
                printf("%s %s(%g, %g) = %g, not %Lg\n", f32 ? "f32" : "f64", ir_ops[c->op].name, x, y, got, want);
            }
        }
    }
    free(d);
    assert_false(bad);
}

static void test_edges(void **state) {
    (void)state;
    edges(PREC_F32, true);
    edges(PREC_F32, false);
    edges(PREC_F64, true);
    edges(PREC_F64, false);
}

/* exp meets its limits where the format does. */
static void test_overflow(void **state) {
    (void)state;
    Data *d = malloc(sizeof *d);
    const double f32_points[] = {88.72, 88.73, 89.5, 1e30, -86.9, -90, -1e30};
    d->n = 7;
    memcpy(d->x, f32_points, sizeof f32_points);
    memset(d->y, 0, sizeof d->y);
    evaluate(OP_fexp, PREC_F32, true, d);
    assert_true(isfinite(d->out[0]) && d->out[0] > 3.3e38);
    assert_true(isinf(d->out[1]) && isinf(d->out[2]) && isinf(d->out[3]));
    assert_true(d->out[4] > 1.8e-38 && d->out[5] == 0 && d->out[6] == 0);
    const double f64_points[] = {709.78, 709.79, 750, 1e300, -708.0, -746, -1e300};
    memcpy(d->x, f64_points, sizeof f64_points);
    evaluate(OP_fexp, PREC_F64, true, d);
    assert_true(isfinite(d->out[0]) && d->out[0] > 1.79e308);
    assert_true(isinf(d->out[1]) && isinf(d->out[2]) && isinf(d->out[3]));
    assert_true(d->out[4] > 3.3e-308 && d->out[5] == 0 && d->out[6] == 0);
    free(d);
}

/* The bounds column widens by at least twice the error that is allowed above. */
static void test_widening(void **state) {
    (void)state;
    enum { ROW_POINTS = 500 };
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++)
        for (int p = PREC_F32; p <= PREC_F64; p++) {
            const Case *c = &cases[k];
            if (c->op == OP_frsqrt) continue; /* correctly rounded operations, which rise */
            TestFn t = open_fn((Precision)p);
            Bound a[2] = {{ir_input(&t.b, IN_X0), ir_input(&t.b, IN_H0)},
                          {ir_input(&t.b, IN_X1), ir_input(&t.b, IN_H1)}};
            Bound r = ir_bound_row(&t.b, c->op, a, ir_ops[c->op].nargs, 0);
            ir_yield(&t.b, 2, (Inst *[]){r.lo, r.hi});
            PassCtx ctx = {.session = t.s, .has_fma = true};
            lower_math(&ctx, t.fn);
            uint64_t state_ = 99 + k;
            double in[2][ROW_POINTS], out[2][ROW_POINTS];
            float in32[2][ROW_POINTS], out32[2][ROW_POINTS];
            for (uint32_t j = 0; j < ROW_POINTS; j++)
                for (int s = 0; s < 2; s++) {
                    in[s][j] = s && c->op == OP_fpow ? uniform(&state_) * 4 - 2 : sample(c, p == PREC_F32, &state_);
                    in32[s][j] = (float)in[s][j];
                }
            SltKernelArgs args = {0};
            for (int s = 0; s < 2; s++) {
                args.in[IN_X0 + s] = args.in[IN_H0 + s] = p == PREC_F32 ? (void *)in32[s] : in[s];
                args.out[s] = p == PREC_F32 ? (void *)out32[s] : out[s];
            }
            assert_int_equal(run(t.fn, &args, ROW_POINTS, 4), SLT_OK);
            uint32_t seen = 0;
            for (uint32_t j = 0; j < ROW_POINTS; j++) {
                double lo = p == PREC_F32 ? (double)out32[0][j] : out[0][j],
                       hi = p == PREC_F32 ? (double)out32[1][j] : out[1][j];
                /* not where the image ends, results are tiny, or nothing is known */
                if (!(hi - lo < INFINITY) || fabs(hi) < (p == PREC_F32 ? 1e-30 : 1e-290)) continue;
                if (fabs(lo) >= 1 && (c->op == OP_fsin || c->op == OP_fcos)) continue;
                if (fabs(hi) >= 1 && (c->op == OP_fsin || c->op == OP_fcos || c->op == OP_ftanh || c->op == OP_ferf))
                    continue;
                if (fabs(lo) >= 1 && (c->op == OP_ftanh || c->op == OP_ferf)) continue;
                double ulp = ldexp(1, ilogb(hi) - (p == PREC_F32 ? 23 : 52)),
                       allowed = p == PREC_F32 ? c->ulp32 : c->ulp64;
                seen++;
                if (hi - lo < 4 * allowed * ulp)
                    fail_msg("%s: [%.17g, %.17g] is narrower than twice %g ulp to each side", ir_ops[c->op].name, lo,
                             hi, allowed);
            }
            if (c->lo > -1e4) assert_true(seen > ROW_POINTS / 20);
            close_fn(&t);
        }
}

/* What is known of an argument leaves operations out and changes no bit. */
static void test_known_arguments(void **state) {
    (void)state;
    enum { CASES = 4, SIZE = 8192 };
    static const Op ops[CASES] = {OP_fsin, OP_fcos, OP_fexp, OP_fexp2};
    TestFn t = open_fn(PREC_F32);
    Inst *x = ir_input(&t.b, IN_X0), *out[2 * CASES];
    Inst *small = ir_emit2(&t.b, OP_fmax, ir_emit2(&t.b, OP_fmin, x, ir_constf(&t.b, 1.4)), ir_constf(&t.b, -1.4));
    Inst *negative = ir_emit1(&t.b, OP_fneg, ir_emit1(&t.b, OP_fabs, x));
    for (uint32_t k = 0; k < CASES; k++) {
        out[2 * k] = ir_emit1(&t.b, ops[k], x);
        out[2 * k + 1] = ir_emit1(&t.b, ops[k], k < 2 ? small : negative);
    }
    ir_yield(&t.b, 2 * CASES, out);
    const uint32_t before = 2 * (15 + 17 + 13 + 12);
    PassCtx ctx = {.session = t.s, .has_fma = true};
    assert_true(lower_math(&ctx, t.fn));
    uint32_t count = 0;
    for (const Inst *i = t.fn->body->first; i; i = i->next)
        count += !ir_is_const(i) && i->op != OP_input && i->op != OP_yield && i->op != OP_fasuint &&
                 i->op != OP_iasfloat && i->op != OP_fneg;
    assert_true(count < before - 10);
    static float in[SIZE], got[2 * CASES][SIZE];
    uint64_t seed = 3;
    SltKernelArgs args = {.in = {in}};
    for (uint32_t k = 0; k < 2 * CASES; k++) args.out[k] = got[k];
    for (uint32_t n = 0; n < SIZE; n++)
        in[n] = (float)(n & 1 ? -1.4 * uniform(&seed) : -exp2(uniform(&seed) * 60 - 59.5)) * (n & 2 ? -1 : 1);
    in[0] = 0, in[1] = -0.0f, in[2] = 1.4f, in[3] = -1.4f, in[4] = NAN;
    assert_int_equal(run(t.fn, &args, SIZE, 16), SLT_OK);
    for (uint32_t k = 0; k < CASES; k++)
        for (uint32_t n = 0; n < SIZE; n++) {
            if (fabsf(in[n]) > 1.4f || (k > 1 && !signbit(in[n])) || isnan(in[n])) continue;
            assert_memory_equal(&got[2 * k][n], &got[2 * k + 1][n], sizeof(float));
        }
    for (uint32_t k = 0; k < CASES; k++) assert_true(isnan(got[2 * k + 1][4]));
    close_fn(&t);
}

/* pow(x, n) as products: values and the exponents it leaves alone. */
static void test_powers(void **state) {
    (void)state;
    for (int n = -9; n <= 9; n++) {
        TestFn t = open_fn(PREC_F64);
        Inst *x = ir_input(&t.b, IN_X0);
        Inst *v = ir_emit2(&t.b, OP_fpow, x, ir_constf(&t.b, n));
        Inst *w = ir_emit2(&t.b, OP_fpow, x, ir_constf(&t.b, 2.5));
        ir_yield(&t.b, 2, (Inst *[]){v, w});
        PassCtx ctx = {.session = t.s};
        assert_int_equal(opt_powers(&ctx, t.fn), n != 0 && abs(n) < 9);
        check_sound(t.fn);
        assert_true(has_math(t.fn->body)); /* 2.5 stays */
        const double xs[] = {-3, -1, 0.7, 1, 2, 1e-60, INFINITY, 0, NAN};
        double out[9], other[9];
        SltKernelArgs args = {.in = {xs}, .out = {out, other}};
        assert_int_equal(run(t.fn, &args, 9, 4), SLT_OK);
        for (int k = 0; k < 9; k++) {
            double want = pow(xs[k], n);
            if (isnan(want)) assert_true(isnan(out[k]));
            else if (isinf(want) || fabs(want) < 1e-300) assert_true(out[k] == want || fabs(out[k] - want) < 1e-300);
            else assert_true(fabs(out[k] - want) <= 4.5 * 0x1p-52 * fabs(want));
        }
        close_fn(&t);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_f32_fma),   cmocka_unit_test(test_f32_plain),       cmocka_unit_test(test_f64_fma),
        cmocka_unit_test(test_f64_plain), cmocka_unit_test(test_edges),           cmocka_unit_test(test_overflow),
        cmocka_unit_test(test_log_parts), cmocka_unit_test(test_known_arguments), cmocka_unit_test(test_powers),
        cmocka_unit_test(test_widening),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
