/* How far a value as computed is from what exact arithmetic gives for the same position and parameters, at most,
 * anywhere on the box: the running error analysis of Wilkinson ("Rounding Errors in Algebraic Processes", 1963), with
 * magnitudes and slopes from the bounds. Each operation adds its own rounding to what its arguments bring along. First
 * order: slopes are bounded on the box, not on the box widened by the error itself, for which the sum is doubled at the
 * end. Decisions are taken to be those of the computed values. */
#include <float.h>
#include <math.h>

#include "compiler/pass/variant_bounds.h"

static Inst *number(Builder *b, double v) { return ir_constf(b, v); }

/* Sums and products of errors, of which NULL is 0. */
static Inst *plus(Builder *b, Inst *p, Inst *q) { return !p ? q : !q ? p : ir_emit2(b, OP_fadd, p, q); }
static Inst *times(Builder *b, Inst *e, Inst *factor) { return e ? ir_emit2(b, OP_fmul, e, factor) : NULL; }

Inst *error_larger(Builder *b, Inst *p, Inst *q) { return !p || p == q ? q : !q ? p : ir_emit2(b, OP_fmax, p, q); }

Inst *error_where(Builder *b, Inst *which, Inst *p, Inst *q) {
    return p == q ? p : bounds_choose(b, which, p ? p : number(b, 0), q ? q : number(b, 0));
}

static Inst *negative(Builder *b, Inst *v) { return ir_emit1(b, OP_fneg, v); }

/* The largest, and the least, magnitude on the box; of a box that holds 0 the least is not positive. */
static Inst *largest(Builder *b, Bound v) {
    return v.lo == v.hi ? ir_emit1(b, OP_fabs, v.lo) : ir_emit2(b, OP_fmax, v.hi, negative(b, v.lo));
}
static Inst *least(Builder *b, Bound v) {
    return v.lo == v.hi ? ir_emit1(b, OP_fabs, v.lo) : ir_emit2(b, OP_fmax, v.lo, negative(b, v.hi));
}

/* e / v where v is positive, else infinite. */
static Inst *over(Builder *b, Inst *e, Inst *v) {
    if (!e) return NULL;
    Inst *ok = ir_emit2(b, OP_flt, number(b, 0), v);
    return ir_select(b, ok, ir_emit2(b, OP_fdiv, e, v), number(b, INFINITY));
}

/* ulps: errors of rows that are rounded once are half a unit in the last place. */
static Inst *with_rounding(Boxes *x, Builder *b, Bound r, double ulps, Inst *e) {
    bool f64 = x->to->precision == PREC_F64;
    double unit = ulps * (f64 ? DBL_EPSILON : FLT_EPSILON);
    double tiny = f64 ? fmax(DBL_MIN * unit, 0x1p-1074) : fmax(FLT_MIN * unit, 0x1p-149); /* of what underflows */
    Inst *own = ir_emit2(b, OP_fmul, largest(b, r), number(b, unit));
    return plus(b, plus(b, own, number(b, tiny)), e);
}

enum { MATH_ULPS = 8 }; /* of the worst of the elementary functions, pow */

/* What comes from the arguments of an elementary function: slope times error. */
static Inst *through(Builder *b, Op op, const Boxed *a, Bound r) {
    Inst *e = a[0].error, *one = number(b, 1);
    switch (op) {
    case OP_fsin:
    case OP_fcos:
    case OP_ftanh:
    case OP_fatan: return e;
    case OP_ferf: return times(b, e, number(b, 1.13));
    case OP_fexp:
    case OP_fexp2: return times(b, e, largest(b, r));
    case OP_flog: return over(b, e, least(b, a[0].is));
    case OP_flog2: return over(b, times(b, e, number(b, 1.45)), least(b, a[0].is));
    case OP_fsinh:
    case OP_fcosh: return times(b, e, ir_emit2(b, OP_fadd, largest(b, r), one));
    case OP_ftan: return times(b, e, ir_emit2(b, OP_fadd, ir_emit2(b, OP_fmul, largest(b, r), largest(b, r)), one));
    case OP_fcbrt: return over(b, e, ir_emit2(b, OP_fmul, least(b, r), least(b, r)));
    case OP_frsqrt: return over(b, times(b, e, largest(b, r)), least(b, a[0].is));
    case OP_fasin:
    case OP_facos: { /* 1 / sqrt((1 - a) (1 + a)), of which one factor is at least 1 */
        Inst *rest = ir_emit2(b, OP_fsub, one, largest(b, a[0].is));
        return over(b, e, ir_emit1(b, OP_fsqrt, ir_emit2(b, OP_fmax, rest, number(b, 0))));
    }
    case OP_fatan2: { /* 1 / r, and r is at least either magnitude */
        Inst *nearest = ir_emit2(b, OP_fmax, least(b, a[0].is), least(b, a[1].is));
        return over(b, plus(b, a[0].error, a[1].error), nearest);
    }
    case OP_fpow: { /* r (b da / a + log a db) */
        Inst *base = over(b, times(b, a[0].error, largest(b, a[1].is)), least(b, a[0].is));
        Inst *magnitude = error_larger(b, ir_emit1(b, OP_fabs, ir_emit1(b, OP_flog, a[0].is.lo)),
                                       ir_emit1(b, OP_fabs, ir_emit1(b, OP_flog, a[0].is.hi)));
        return times(b, plus(b, base, times(b, a[1].error, magnitude)), largest(b, r));
    }
    default: return e || (a[1].error) ? number(b, INFINITY) : NULL;
    }
}

Inst *bounds_error(Boxes *x, Builder *b, const Inst *i, const Boxed *a, Bound r) {
    Op op = (Op)i->op;
    switch (op) {
    case OP_fneg:
    case OP_fabs: return a[0].error;
    case OP_fmin:
    case OP_fmax: return error_larger(b, a[0].error, a[1].error);
    case OP_fcopysign: return a[0].error;
    case OP_fsel: return error_where(b, a[0].is.lo, a[1].error, a[2].error); /* by a condition of one value */
    case OP_fadd:
    case OP_fsub: return with_rounding(x, b, r, 0.5, plus(b, a[0].error, a[1].error));
    case OP_fmul:
    case OP_ffma: {
        Inst *e = plus(b, times(b, a[0].error, largest(b, a[1].is)), times(b, a[1].error, largest(b, a[0].is)));
        if (op == OP_ffma) e = plus(b, e, a[2].error);
        return with_rounding(x, b, r, 0.5, e);
    }
    case OP_fdiv: {
        Inst *e = plus(b, a[0].error, times(b, a[1].error, largest(b, r))), *by = least(b, a[1].is);
        if (a[1].error) by = ir_emit2(b, OP_fsub, by, a[1].error);
        return with_rounding(x, b, r, 0.5, over(b, e, by));
    }
    case OP_fsqrt: { /* the root of a + e is at most e / root away, and at most the root of e */
        Inst *e = a[0].error;
        if (e) e = ir_emit2(b, OP_fmin, ir_emit1(b, OP_fsqrt, e), over(b, e, least(b, r)));
        return with_rounding(x, b, r, 0.5, e);
    }
    case OP_ffloor:
    case OP_fceil:
    case OP_fround:
    case OP_ftrunc:
    case OP_fmant: return NULL; /* of the same integer, as decided */
    case OP_i2f:
    case OP_u2f: return with_rounding(x, b, r, 0.5, NULL);
    case OP_iasfloat:
    case OP_ftwoi: return NULL;
    default: return with_rounding(x, b, r, MATH_ULPS, through(b, op, a, r));
    }
}
