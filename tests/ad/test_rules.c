/* The rules: every float row of ops.def, every argument, against central differences of the interpreter in f64, in both
 * modes; and the edge points, where the policy column says what must come out. A test that only compares the modes
 * would pass with a wrong rule, for both come from one row.
 *
 * Built with SALTUS_AD_MUTATION it instead spoils each partial in turn and demands that the same comparison fails. */
#include "tests/ad/ad_test.h"

typedef enum Domain { ANY, POS, NONNEG, UNIT, NZ2, SMALL, POWER } Domain;
typedef struct Row {
    Op op;
    uint32_t nargs;
    Domain domain;
} Row;

static const Row rows[] = {
#define FOP1(name, value, partials, bounds, events, range, cost, domain, ...) {OP_##name, 1, domain},
#define FOP2(name, value, partials, bounds, events, range, cost, domain, ...) {OP_##name, 2, domain},
#define FOP3(name, value, partials, bounds, events, range, cost, domain, ...) {OP_##name, 3, domain},
#define FCMP2(name, ...)
#define FSEL(name, ...)
#define IOP1(name, ...)
#define IOP2(name, ...)
#define ICMP2(name, ...)
#define BOP1(name, ...)
#define BOP2(name, ...)
#define CONV(name, ...)
#define SPECIAL(name, ...)
#include "compiler/ir/ops.def"
#include "compiler/ir/ops_undef.h"
};
enum { NROWS = sizeof rows / sizeof *rows, SAMPLES = 60 };

static double sample(Domain d, uint32_t arg, uint64_t *state) {
    double u = uniform(state);
    switch (d) {
    case POS: return 0.05 + 6 * u;
    case NONNEG: return 0.01 + 6 * u;
    case UNIT: return 1.9 * u - 0.95;
    case NZ2: return arg == 1 ? (u < 0.5 ? 0.3 + 3 * u : -0.3 - 3 * (u - 0.5)) : 6 * u - 3;
    case POWER: return arg == 0 ? 0.2 + 3 * u : 5 * u - 2.5;
    case ANY:
    case SMALL: break;
    }
    return 8 * u - 4;
}

typedef struct Kernels {
    Fn *f, *jvp, *vjp;
} Kernels;

static Kernels kernels_of(Session *s, const Row *row) {
    Prog p = prog_begin(s, PREC_F64, 3);
    Inst *a[3];
    for (uint32_t k = 0; k < row->nargs; k++) a[k] = par(&p, k);
    Inst *f = ir_emit(&p.b, row->op, row->nargs, a);
    prog_end(&p, 1, &f);
    PassCtx ctx = {.session = s, .has_fma = true};
    return (Kernels){p.fn, ad_jvp(&ctx, p.fn, NULL), ad_vjp(&ctx, p.fn, NULL, NULL)};
}

/* The value at parameters v. */
static double value(const Fn *fn, Run *r, const double v[3]) {
    memcpy(r->params, v, 3 * sizeof *v);
    assert_int_equal(run_fn(fn, r, 0, 1, 1), SLT_OK);
    return r->out[0][0];
}

/* True if the partials of the row agree with differences, forwards and backwards, everywhere it was tried. */
static bool row_agrees(Session *s, const Row *row, bool tell) {
    Kernels k = kernels_of(s, row);
    Run *r = calloc(1, sizeof *r);
    uint64_t state = row->op + 17;
    bool good = true;
    uint32_t compared = 0;
    for (int n = 0; n < SAMPLES && good; n++) {
        double v[3], t[3];
        for (uint32_t a = 0; a < row->nargs; a++) v[a] = sample(row->domain, a, &state);
        for (uint32_t a = 0; a < row->nargs && good; a++) {
            double d[2];
            for (int h = 0; h < 2; h++) {
                double e = h ? 1e-6 : 4e-6;
                memcpy(t, v, sizeof t);
                t[a] = v[a] + e;
                double up = value(k.f, r, t);
                t[a] = v[a] - e;
                d[h] = (up - value(k.f, r, t)) / (2 * e);
            }
            if (!near(d[0], d[1], 1e-5)) continue; /* a kink or a jump between */
            compared++;
            memset(r->dparams, 0, sizeof r->dparams);
            memset(r->adj, 0, sizeof r->adj);
            r->dparams[a] = 1.5;
            r->seed[0][0] = -0.75;
            value(k.jvp, r, v);
            double forward = r->out[1][0] / 1.5;
            value(k.vjp, r, v);
            double reverse = r->adj[a] / -0.75;
            good = near(forward, d[1], 1e-6) && near(reverse, d[1], 1e-6);
            if (!good && tell)
                print_error("%s, argument %u at (%g, %g): differences %.12g, forward %.12g, reverse %.12g\n",
                            ir_ops[row->op].name, a, v[0], v[1], d[1], forward, reverse);
        }
    }
    if (tell) assert_true(compared > SAMPLES * row->nargs / 2);
    free(r);
    return good;
}

#ifndef SALTUS_AD_MUTATION

TEST(partials_match_differences) {
    for (int k = 0; k < NROWS; k++)
        if (rows[k].op != OP_fmant &&
            !ir_is_log_part(
                rows[k].op)) /* pieces that lowering makes after differentiation: no derivative, on purpose */
            assert_true(row_agrees(s, &rows[k], true));
}

/* Both precisions share the rules; f32 is compared with f64. */
TEST(selection) {
    Prog p = prog_begin(s, PREC_F64, 3);
    Inst *f = sel(&p, lt(&p, par(&p, 0), cf(&p, 0)), par(&p, 1), mul(&p, par(&p, 2), par(&p, 1)));
    prog_end(&p, 1, &f);
    Check c = {0};
    check_ad(&p, &c);
}

typedef struct Edge {
    Op op;
    double v[2];
    double seed;
    double slope[2]; /* adjoints wanted */
} Edge;

/* Kinks and poles, as the policy column has them. */
TEST(edges) {
    static const Edge edges[] = {
        {OP_fabs, {0, 0}, 1, {0, 0}},         {OP_fabs, {-0.0, 0}, 1, {0, 0}},
        {OP_fmin, {2, 2}, 3, {3, 0}},         {OP_fmax, {2, 2}, 3, {3, 0}},
        {OP_fsqrt, {0, 0}, 1, {INFINITY, 0}}, {OP_fsqrt, {0, 0}, 0, {0, 0}},
        {OP_fcbrt, {0, 0}, 0, {0, 0}},        {OP_fcbrt, {0, 0}, 1, {INFINITY, 0}},
        {OP_flog, {0, 0}, 0, {0, 0}},         {OP_flog, {0, 0}, 1, {INFINITY, 0}},
        {OP_flog2, {0, 0}, 0, {0, 0}},        {OP_frsqrt, {0, 0}, 0, {0, 0}},
        {OP_fdiv, {1, 0}, 0, {0, 0}},         {OP_fdiv, {0, INFINITY}, 2, {0, 0}},
        {OP_fasin, {1, 0}, 0, {0, 0}},        {OP_fasin, {1, 0}, 1, {INFINITY, 0}},
        {OP_facos, {-1, 0}, 0, {0, 0}},       {OP_facos, {1, 0}, 1, {-INFINITY, 0}},
        {OP_fatan2, {0, 0}, 0, {0, 0}},       {OP_fpow, {0, 0}, 1, {0, 0}},
        {OP_fpow, {0, 2}, 1, {0, 0}},         {OP_fpow, {0, 1}, 1, {1, 0}},
        {OP_fpow, {-2, 3}, 1, {12, NAN}},     {OP_fexp, {1e4, 0}, 0, {0, 0}},
        {OP_fcosh, {1e4, 0}, 0, {0, 0}},      {OP_fsinh, {1e4, 0}, 0, {0, 0}},
        {OP_zmul, {0, 7}, 1, {7, 0}},         {OP_ffloor, {1, 0}, 1, {0, 0}},
        {OP_fround, {0.5, 0}, 1, {0, 0}},     {OP_fcopysign, {3, -1}, 2, {-2, 0}},
    };
    Run *r = calloc(1, sizeof *r);
    for (uint32_t e = 0; e < sizeof edges / sizeof *edges; e++) {
        const Edge *edge = &edges[e];
        Row row = {edge->op, ir_ops[edge->op].nargs, ANY};
        Kernels k = kernels_of(s, &row);
        memset(r, 0, sizeof *r);
        r->seed[0][0] = edge->seed;
        double v[3] = {edge->v[0], edge->v[1], 0};
        value(k.vjp, r, v);
        for (uint32_t a = 0; a < row.nargs; a++) {
            if (!near(r->adj[a], edge->slope[a], 1e-14))
                print_error("%s(%g, %g), seed %g: slope %u is %g, not %g\n", ir_ops[edge->op].name, v[0], v[1],
                            edge->seed, a, r->adj[a], edge->slope[a]);
            assert_true(near(r->adj[a], edge->slope[a], 1e-14));
            r->dparams[a] = edge->seed;
            value(k.jvp, r, v);
            assert_true(near(r->out[1][0], edge->slope[a], 1e-14));
            r->dparams[a] = 0;
        }
    }
    free(r);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(partials_match_differences), cmocka_unit_test(selection),
                                       cmocka_unit_test(edges)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

#else

/* Each partial that exists, spoilt in three ways: row_agrees must notice. Partials that are zero by nature have nothing
 * to spoil. */
TEST(every_mutation_is_caught) {
    uint32_t tried = 0, missed = 0;
    for (int k = 0; k < NROWS; k++) {
        const Row *row = &rows[k];
        Prog p = prog_begin(s, PREC_F64, 3);
        Inst *a[3];
        for (uint32_t n = 0; n < row->nargs; n++) a[n] = par(&p, n);
        Inst *f = ir_emit(&p.b, row->op, row->nargs, a);
        for (uint32_t n = 0; n < row->nargs; n++) {
            if (ad_mentions(f, n, NULL, NULL) == UINT32_MAX) continue;
            for (int kind = 0; kind < 3; kind++) {
                ad_mutation_op = row->op, ad_mutation_arg = (int)n, ad_mutation_kind = kind;
                tried++;
                if (row_agrees(s, row, false)) {
                    missed++;
                    print_error("not caught: %s, argument %u, kind %d\n", ir_ops[row->op].name, n, kind);
                }
            }
        }
    }
    print_message("%u mutations, %u missed\n", tried, missed);
    assert_true(tried > 100);
    assert_int_equal(missed, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_mutation_is_caught)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

#endif
