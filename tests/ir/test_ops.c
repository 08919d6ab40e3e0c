/* The columns of ops.def that are facts for passes: range and cost. The value column is tests/ir/test_interp.c, the
 * partials are tests/ad. */
#include "compiler/ir/range.h"
#include "compiler/ir/rows.h"
#include "tests/ir/ir_test.h"

static uint64_t state;
static double uniform(void) {
    state = state * 6364136223846793005ull + 1442695040888963407ull;
    return (double)(state >> 40) * 0x1p-24;
}

/* ---- ranges */

/* One argument: an interval, and a value inside. */
typedef struct Sample {
    IrRange range;
    double v;
} Sample;

static const double float_edges[] = {0,   -0.0, 0.5,    -0.5,    1,     -1,    1.5,      -2.5,      79,
                                     -79, 81,   1e-30,  -1e-30,  1e-45, 1e5,   -1e5,     7,         1e18,
                                     3,   -3,   0x1p31, -0x1p31, 88.8,  -1e18, INFINITY, -INFINITY, NAN};
static const int32_t int_edges[] = {0,
                                    1,
                                    -1,
                                    2,
                                    -2,
                                    3,
                                    7,
                                    31,
                                    32,
                                    33,
                                    -31,
                                    255,
                                    65535,
                                    65536,
                                    -65536,
                                    INT32_MAX,
                                    INT32_MIN,
                                    INT32_MAX - 1,
                                    INT32_MIN + 1};

static Sample float_sample(void) {
    enum { EDGES = sizeof float_edges / sizeof *float_edges };
    double v =
        uniform() < 0.4 ? float_edges[(int)(uniform() * EDGES)] : ldexp(uniform() - 0.5, (int)(uniform() * 40) - 20);
    v = (float)v; /* the same argument in both precisions */
    double below = uniform() < 0.5 ? 0 : ldexp(uniform(), (int)(uniform() * 20) - 10),
           above = uniform() < 0.5 ? 0 : ldexp(uniform(), (int)(uniform() * 20) - 10);
    if (isnan(v) || uniform() < 0.1) return (Sample){IR_RANGE_ANY, v};
    if (isinf(v)) return (Sample){{uniform() < 0.5 ? -INFINITY : v < 0 ? v : 1, INFINITY, IR_OVERFLOW | IR_POLE}, v};
    return (Sample){{v - below, v + above, 0}, v};
}

static Sample int_sample(void) {
    enum { EDGES = sizeof int_edges / sizeof *int_edges };
    int32_t v = uniform() < 0.5 ? int_edges[(int)(uniform() * EDGES)]
                                : (int32_t)(ldexp(uniform() - 0.5, (int)(uniform() * 32)));
    double lo = uniform() < 0.5 ? v : v - ldexp(uniform(), (int)(uniform() * 32)),
           hi = uniform() < 0.5 ? v : v + ldexp(uniform(), (int)(uniform() * 32));
    if (uniform() < 0.1) return (Sample){IR_RANGE_INT, v};
    return (Sample){{fmax(floor(lo), INT32_MIN), fmin(ceil(hi), INT32_MAX), 0}, v};
}

typedef union Cell {
    float f32;
    double f64;
    int32_t i;
} Cell;

static Cell cell(IrType t, Precision p, double v) {
    return t != TY_FLT ? (Cell){.i = (int32_t)v} : p == PREC_F32 ? (Cell){.f32 = (float)v} : (Cell){.f64 = v};
}

/* Is v, computed in p, inside? Floats up to a few units in the last place of the precision, and 1e-37: products of
 * ranges count smaller bounds as 0. */
static bool inside(IrRange r, double v, Precision p, IrType t, bool ordinary) {
    if (isnan(v)) return r.beyond & IR_NAN || !ordinary;
    if (isinf(v)) return r.beyond & (IR_OVERFLOW | IR_POLE) || !ordinary || (v > 0 ? r.hi == v : r.lo == v);
    double ulp = t != TY_FLT ? 0 : p == PREC_F32 ? 0x1p-20 : 0x1p-46, least = t != TY_FLT ? 0 : 1e-37;
    return v >= r.lo - fabs(r.lo) * ulp - least && v <= r.hi + fabs(r.hi) * ulp + least;
}

/* Sums, products, quotients and powers of huge numbers overflow without the range saying so. */
static void check_ranges(Op op, Precision p) {
    const OpInfo *o = &ir_ops[op];
    const double big = op == OP_fpow ? 16 : 1e15;
    for (int n = 0; n < 20000; n++) {
        Sample s[3];
        Cell in[3], out = {.f64 = 0};
        bool ordinary = true, same = o->nargs > 1 && !o->selects && uniform() < 0.1;
        for (uint32_t k = 0; k < o->nargs; k++) {
            IrType t = o->selects && k == 0 ? TY_BOOL : (IrType)o->arg;
            s[k] = t == TY_FLT ? float_sample() : t == TY_INT ? int_sample() : (Sample){{0, 1, 0}, uniform() < 0.5};
            if (op == OP_ftwoi) s[k] = (Sample){{-126, 127, 0}, floor(uniform() * 254) - 126};
            if (same && k == 1) s[1] = s[0];
            in[k] = cell(t, p, s[k].v);
            ordinary &=
                t != TY_FLT || s[k].v == 0 || !isfinite(s[k].v) || (fabs(s[k].v) < big && fabs(s[k].v) > 1 / big);
        }
        for (uint32_t k = o->nargs; k < 3; k++) s[k] = (Sample){IR_RANGE_FINITE, 0};
        IrRange r = ir_range_row(op, s[0].range, s[1].range, s[2].range, same);
        if (o->result == TY_INT && !(r.lo >= INT32_MIN && r.hi <= INT32_MAX)) r = IR_RANGE_INT;
        (p == PREC_F32 ? rows_eval_f32 : rows_eval_f64)((uint8_t)op, 1, &out, &in[0], &in[1], &in[2]);
        double v = o->result != TY_FLT ? out.i : p == PREC_F32 ? (double)out.f32 : out.f64;
        if (o->result == TY_BOOL && v != 0 && v != 1) fail_msg("%s gives %g", o->name, v);
        if (!inside(r, v, p, (IrType)o->result, ordinary))
            fail_msg(
                "%s(%.9g, %.9g, %.9g) = %.9g is outside [%.9g, %.9g] (%d) of [%.9g, %.9g], [%.9g, %.9g], [%.9g, %.9g]",
                o->name, s[0].v, s[1].v, s[2].v, v, r.lo, r.hi, r.beyond, s[0].range.lo, s[0].range.hi, s[1].range.lo,
                s[1].range.hi, s[2].range.lo, s[2].range.hi);
    }
}

static void test_ranges(void **unused) {
    (void)unused;
    for (int op = 0; op < OP_COUNT; op++)
        for (int p = PREC_F32; p <= PREC_F64 && !ir_ops[op].special; p++) check_ranges((Op)op, (Precision)p);
}

/* ---- costs */

/* Additions that the lowered body takes. */
static uint32_t lowered_cost(Op op) {
    TestFn t = open_fn(PREC_F32);
    Inst *args[3] = {ir_input(&t.b, IN_X0), ir_input(&t.b, IN_X1), ir_input(&t.b, IN_X2)};
    Inst *r = ir_emit(&t.b, op, ir_ops[op].nargs, args);
    ir_yield(&t.b, 1, &r);
    PassCtx ctx = {.session = t.s, .has_fma = true};
    pipeline_kernel(&ctx, t.fn);
    uint32_t cost = 0;
    for (const Inst *i = t.fn->body->first; i; i = i->next)
        if (i->op != OP_input) cost += ir_ops[i->op].cost;
    close_fn(&t);
    return cost;
}

static void test_costs(void **unused) {
    (void)unused;
    for (int op = 0; op < OP_COUNT; op++) {
        const OpInfo *o = &ir_ops[op];
        if (!o->special) assert_true(o->cost > 0);
        if (!o->math) continue;
        uint32_t cost = lowered_cost((Op)op);
        if (cost < o->cost * 3u / 4 || cost > o->cost * 5u / 4) fail_msg("%s costs %u, not %u", o->name, cost, o->cost);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_ranges),
        cmocka_unit_test(test_costs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
