/* The bounds column of ops.def as code: the vocabulary, and the rules of arithmetic, choices and booleans.
 *
 * What is unknown must not get lost. An addition or a product of an end that is NaN is NaN, and so is inf - inf and
 * 0 * inf; but a minimum drops a NaN in its second argument, and a function with a bounded image makes a finite number
 * of an infinite end. The comments say where each rule keeps it. */
#include "compiler/ir/bounds_rules.h"

#ifdef SALTUS_BOUNDS_MUTATION
int bound_mutation;
#endif

/* ---- shared */

Bound bound_trend(Rule *r, uint32_t falls) {
    Inst *lo[3], *hi[3];
    if (SPOILED(SPOIL_TREND)) falls &= (1u << r->n >> 1) - 1;
    for (uint32_t k = 0; k < r->n; k++) {
        bool down = falls >> k & 1;
        lo[k] = down ? r->arg[k].hi : r->arg[k].lo;
        hi[k] = down ? r->arg[k].lo : r->arg[k].hi;
    }
    if (SPOILED(SPOIL_ENDS)) return (Bound){ir_emit(&r->b, r->op, r->n, hi), ir_emit(&r->b, r->op, r->n, lo)};
    return (Bound){ir_emit(&r->b, r->op, r->n, lo), ir_emit(&r->b, r->op, r->n, hi)};
}

Bound bound_where(Rule *r, Inst *ok, Bound x) {
    if (SPOILED(SPOIL_WHERE)) return x;
    return (Bound){sel(r, ok, x.lo, num(r, NAN)), x.hi};
}

/* -inf + inf is NaN as well. */
Inst *bound_is_number(Rule *r, Bound x) {
    if (SPOILED(SPOIL_LINE)) return has_ends(r, x);
    return is_point(x) ? is_number(r, x.lo) : is_number(r, e2(r, OP_fadd, x.lo, x.hi));
}

Bound bound_even(Rule *r, Bound x) {
    return (Bound){max(r, x.lo, e1(r, OP_fneg, x.hi)), max(r, x.hi, e1(r, OP_fneg, x.lo))};
}

/* ---- arithmetic */

/* Magnitudes m, M: m below 0 means that 0 is inside. m*0 is NaN, which goes, only where m is -inf: there the whole line
 * stays. */
static Bound magnitude(Rule *r, Bound x) {
    Bound m = bound_even(r, x);
    return (Bound){max(r, m.lo, e2(r, OP_fmul, m.lo, num(r, 0))), m.hi};
}

/* x*y, or x*y + z with one rounding */
static Inst *term(Rule *r, Inst *x, Inst *y, Inst *z) { return z ? e3(r, OP_ffma, x, y, z) : e2(r, OP_fmul, x, y); }

/* max(m, 0)*m is 0 where 0 is inside, and 0*-inf, NaN, of the whole line. */
static Bound square(Rule *r, Bound x, Bound plus) {
    Bound m = bound_even(r, x);
    if (SPOILED(SPOIL_SQUARE)) return (Bound){term(r, x.lo, x.lo, plus.lo), term(r, m.hi, m.hi, plus.hi)};
    return (Bound){term(r, max(r, m.lo, num(r, 0)), m.lo, plus.lo), term(r, m.hi, m.hi, plus.hi)};
}

/* Of one factor whose value is p. */
static Bound scaled(Rule *r, Bound x, Inst *p, Bound plus) {
    Inst *near = x.lo, *far = x.hi;
    if (p->op == OP_constf) {
        if (p->imm.f < 0 && !SPOILED(SPOIL_SIGN)) near = x.hi, far = x.lo;
    } else {
        Inst *negative = SPOILED(SPOIL_SIGN) ? ir_constb(&r->b, false) : lt(r, p, num(r, 0));
        near = sel(r, negative, x.hi, x.lo);
        far = sel(r, negative, x.lo, x.hi);
    }
    return (Bound){term(r, near, p, plus.lo), term(r, far, p, plus.hi)};
}

/* The four corners. Of them the minimum keeps a NaN of the first, the maximum one of the last; one of the other two (0
 * at one factor's end, inf at the other's) is found by their sum, which is NaN for inf - inf too: there the bound is
 * the whole line anyway. */
static Bound product(Rule *r, Bound x, Bound y, Bound plus) {
    if (r->same) return square(r, x, plus);
    if (is_point(y)) return scaled(r, x, y.lo, plus);
    if (is_point(x)) return scaled(r, y, x.lo, plus);
    Inst *a = term(r, x.lo, y.lo, plus.lo), *b = term(r, x.lo, y.hi, plus.lo), *c = term(r, x.hi, y.lo, plus.lo),
         *d = term(r, x.hi, y.hi, plus.lo);
    Inst *lo = min(r, min(r, a, b), min(r, c, d)), *known = is_number(r, e2(r, OP_fadd, b, c));
    if (plus.lo != plus.hi) {
        a = term(r, x.lo, y.lo, plus.hi), b = term(r, x.lo, y.hi, plus.hi);
        c = term(r, x.hi, y.lo, plus.hi), d = term(r, x.hi, y.hi, plus.hi);
    }
    if (SPOILED(SPOIL_CORNER)) a = b;
    return bound_where(r, known, (Bound){lo, max(r, max(r, d, c), max(r, a, b))});
}

/* Unknown where the divisor may be 0. By a negative one the dividend's ends change places; then each end of the
 * quotient takes the divisor's end that its dividend's sign asks for. inf/inf is the one NaN that is left. */
static Bound quotient(Rule *r, Bound x, Bound y) {
    if (is_point(y)) {
        Inst *a = e2(r, OP_fdiv, x.lo, y.lo), *b = e2(r, OP_fdiv, x.hi, y.lo);
        if (is_constant(y) && y.lo->imm.f > 0) return (Bound){a, b};
        if (is_constant(y) && y.lo->imm.f < 0) return (Bound){b, a};
        return (Bound){min(r, a, b), max(r, b, a)};
    }
    Inst *zero = num(r, 0), *above = lt(r, zero, y.lo), *below = lt(r, y.hi, zero);
    Inst *known = both(r, either(r, above, below), has_ends(r, y));
    if (is_constant(x) && isfinite(x.lo->imm.f)) {
        Inst *a = e2(r, OP_fdiv, x.lo, y.hi), *b = e2(r, OP_fdiv, x.lo, y.lo);
        return bound_where(r, known, x.lo->imm.f < 0 ? (Bound){b, a} : (Bound){a, b});
    }
    Inst *top = num(r, INFINITY);
    Inst *finite = either(r, lt(r, e2(r, OP_fsub, x.hi, x.lo), top), lt(r, e2(r, OP_fsub, y.hi, y.lo), top));
    if (SPOILED(SPOIL_SIGN)) below = ir_constb(&r->b, false);
    Inst *lo = sel(r, below, x.hi, x.lo), *hi = sel(r, below, x.lo, x.hi);
    return bound_where(r, both(r, known, finite),
                       (Bound){e2(r, OP_fdiv, lo, sel(r, lt(r, lo, zero), y.lo, y.hi)),
                               e2(r, OP_fdiv, hi, sel(r, lt(r, hi, zero), y.hi, y.lo))});
}

/* The value is NaN where the first argument is, and the first argument where the second is NaN. The whole line, which
 * may be NaN, and a NaN in the second would be dropped. */
static Bound extreme(Rule *r, Bound x, Bound y) {
    return bound_where(r, bound_extreme_known(r, x, y), bound_trend(r, UP));
}

static Bound with_sign(Rule *r, Bound x, Bound y) {
    Inst *zero = num(r, 0), *ends = has_ends(r, y);
    Inst *positive = both(r, ends, lt(r, zero, y.lo)), *negative = both(r, ends, lt(r, y.hi, zero));
    Bound m = magnitude(r, x);
    Inst *low = e1(r, OP_fneg, m.hi);
    Bound z = {sel(r, positive, m.lo, low), sel(r, negative, e1(r, OP_fneg, m.lo), m.hi)};
    return bound_where(r, has_ends(r, x), z);
}

/* Falls where the argument is positive, unknown elsewhere: 1/sqrt(-0) is -inf. */
static Bound where_positive(Rule *r, Bound x, Bound result) { return bound_where(r, lt(r, num(r, 0), x.lo), result); }

static Bound within(Rule *r, double lo, double hi, Bound x) {
    return (Bound){max(r, x.lo, num(r, lo)), min(r, x.hi, num(r, hi))};
}

/* ---- comparisons: certain only between ends that are no NaN. The whole line, which may be NaN, has an infinite end at
 * which < is false as it is on NaN; <= and == need a finite difference. */

static Bound less(Rule *r, Bound x, Bound y) {
    Inst *ends = has_ends(r, (Bound){x.lo, y.hi}), *back = has_ends(r, (Bound){y.lo, x.hi});
    if (SPOILED(SPOIL_EQUAL))
        return (Bound){both(r, lt(r, x.lo, y.lo), ends), not(r, both(r, le(r, y.hi, x.lo), back))};
    return (Bound){both(r, lt(r, x.hi, y.lo), ends), not(r, both(r, le(r, y.hi, x.lo), back))};
}

static Bound less_equal(Rule *r, Bound x, Bound y) {
    Inst *ends = has_ends(r, (Bound){x.lo, y.hi}), *back = has_ends(r, (Bound){y.lo, x.hi});
    Inst *certain = le(r, e2(r, OP_fsub, x.hi, y.lo), num(r, 0));
    if (SPOILED(SPOIL_EQUAL)) certain = le(r, x.hi, y.lo);
    return (Bound){both(r, certain, ends), not(r, both(r, lt(r, y.hi, x.lo), back))};
}

static Bound equal(Rule *r, Bound x, Bound y) {
    Inst *certain = both(r, e2(r, OP_feq, x.lo, y.hi), e2(r, OP_feq, x.hi, y.lo));
    if (SPOILED(SPOIL_EQUAL)) certain = e2(r, OP_feq, x.lo, y.lo);
    return (Bound){certain, not(r, either(r, less(r, x, y).lo, less(r, y, x).lo))};
}

static Bound opposite(Rule *r, Bound x) { return (Bound){not(r, x.hi), not(r, x.lo)}; }

/* ---- booleans, choices */

static Bound differ(Rule *r, Bound x, Bound y) {
    Inst *certain = either(r, both(r, x.lo, not(r, y.hi)), both(r, not(r, x.hi), y.lo));
    Inst *equal = either(r, both(r, x.lo, y.lo), both(r, not(r, x.hi), not(r, y.hi)));
    return (Bound){certain, not(r, equal)};
}

static Bound may_be_nan(Rule *r, Bound x) { return (Bound){ir_constb(&r->b, false), not(r, bound_is_number(r, x))}; }

static Bound may_be_inf(Rule *r, Bound x) {
    Inst *finite = both(r, lt(r, num(r, -INFINITY), x.lo), lt(r, x.hi, num(r, INFINITY)));
    return (Bound){ir_constb(&r->b, false), not(r, finite)};
}

Rule bound_rule(Builder *b, Op op, const Bound *a, uint32_t n, uint32_t known) {
    Rule r = {.b = *b, .op = op, .arg = a, .n = n, .f64 = b->fn->precision == PREC_F64};
    r.same = known & BOUND_SAME, r.no_minus_0 = known & BOUND_NO_MINUS_0;
    r.b.fold = true;
    return r;
}

/* The minimum keeps a NaN at x.lo, the maximum one at y.hi; the sum finds the other two. */
Bound ir_bound_hull(Builder *b, Bound x, Bound y) {
    if (x.lo == y.lo && x.hi == y.hi) return x;
    Rule r = bound_rule(b, OP_fmin, NULL, 0, 0);
    switch (x.lo->type) {
    case TY_BOOL: return (Bound){both(&r, x.lo, y.lo), either(&r, x.hi, y.hi)};
    case TY_INT: return (Bound){e2(&r, OP_imin, x.lo, y.lo), e2(&r, OP_imax, x.hi, y.hi)};
    default: break;
    }
    Inst *known = is_number(&r, e2(&r, OP_fadd, y.lo, x.hi));
    return bound_where(&r, known, (Bound){min(&r, x.lo, y.lo), max(&r, y.hi, x.hi)});
}

Bound ir_bound_select(Builder *b, Bound cond, Bound x, Bound y) {
    Rule r = bound_rule(b, OP_fsel, NULL, 0, 0);
    Bound p = {sel(&r, cond.hi, x.lo, y.lo), sel(&r, cond.hi, x.hi, y.hi)};
    if (is_point(cond)) return p;
    return ir_bound_hull(&r.b, p, (Bound){sel(&r, cond.lo, x.lo, y.lo), sel(&r, cond.lo, x.hi, y.hi)});
}

Bound ir_bound_whole(Builder *b, IrType t) {
    switch (t) {
    case TY_BOOL: return (Bound){ir_constb(b, false), ir_constb(b, true)};
    case TY_INT: return (Bound){ir_consti(b, INT32_MIN), ir_consti(b, INT32_MAX)};
    default: return (Bound){ir_constf(b, -INFINITY), ir_constf(b, INFINITY)};
    }
}

Inst *ir_bound_is_point(Builder *b, Bound x) {
    if (is_point(x)) return ir_constb(b, true);
    switch (x.lo->type) {
    case TY_BOOL: return ir_emit1(b, OP_bnot, ir_emit2(b, OP_bxor, x.lo, x.hi));
    case TY_INT: return bound_int_is_point(b, x);
    default: return ir_emit2(b, OP_feq, x.lo, x.hi);
    }
}

Inst *ir_bound_is_number(Builder *b, Bound x) {
    Rule r = bound_rule(b, OP_fmin, NULL, 0, 0);
    return bound_is_number(&r, x);
}

Bound ir_bound_ends(Builder *b, Bound x) {
    if (is_constant(x) && !isnan(x.lo->imm.f)) return x;
    Rule r = bound_rule(b, OP_fmin, NULL, 0, 0);
    Inst *known = has_ends(&r, x);
    return (Bound){sel(&r, known, x.lo, num(&r, -INFINITY)), sel(&r, known, x.hi, num(&r, INFINITY))};
}

/* ---- the bounds column */

#define RISES bound_trend(r, 0)
#define FALLS bound_trend(r, 1)
#define TREND(x, y) bound_trend(r, (x) | (y) << 1)
#define PRODUCT(x, y) product(r, x, y, (Bound){0})
#define PRODUCT_PLUS(x, y, z) product(r, x, y, z)
#define QUOTIENT(x, y) quotient(r, x, y)
#define MAGNITUDE(x) magnitude(r, x)
#define LEAST(x, y) extreme(r, x, y)
#define GREATEST(x, y) extreme(r, x, y)
#define SIGNED(x, y) with_sign(r, x, y)
#define POSITIVE(x, bound) where_positive(r, x, bound)
#define KNOWN(x, bound) bound_where(r, bound_is_number(r, x), bound)
#define NEAR(ulps, bound) bound_near(r, ulps, bound)
#define ABOVE(least, bound) within(r, least, INFINITY, bound)
#define WITHIN(lo, hi, bound) within(r, lo, hi, bound)
#define EVEN(x) even_trend(r, x)
#define LOGARITHM(x, ulps) bound_log(r, ulps)
#define WAVE(x, ulps, phase) bound_wave(r, ulps, phase)
#define TANGENT(x, ulps) bound_tan(r, ulps)
#define ANGLE(x, y, ulps) bound_atan2(r, ulps, NULL)
#define POWER(x, y, ulps) bound_pow(r, ulps)
#define MANTISSA(x) bound_mantissa(r)
#define ANY_FLOAT(x) whole_float(r)
#define LESS(x, y) less(r, x, y)
#define LESS_EQUAL(x, y) less_equal(r, x, y)
#define EQUAL(x, y) equal(r, x, y)
#define OPPOSITE(bound) opposite(r, bound)
#define CHOICE(cond, x, y) choice(r, cond, x, y)
#define DIFFER(x, y) differ(r, x, y)
#define WHOLE whole_int(r)
#define POINTS(other) (bound_points_begin(r), bound_points(r, other))
#define SUM(x, y) sum(r)
#define INT_PRODUCT(x, y) bound_product(r)
#define INT_QUOTIENT(x, y) bound_quotient(r)
#define REMAINDER(x, y) bound_remainder(r, false)
#define UNSIGNED_REMAINDER(x, y) bound_remainder(r, true)
#define AND(x, y) bound_and(r)
#define SHIFT_LEFT(x, y) bound_shift(r)
#define SHIFT_RIGHT(x, y) bound_shift(r)
#define SHIFT_DOWN(x, y) bound_shift(r)
#define IF_POSITIVE(bound) bound_if_positive(r, bound)
#define UNWRAPPED(bound) bound_unwrapped(r, bound)
#define ORDERED bound_int_compare(r)
#define UNSIGNED_ORDERED bound_int_compare(r)
#define INT_EQUAL bound_int_equal(r)
#define ORDERED_ENDS(bound) where_ends(r, bound)
#define UNSIGNED_FLOAT(x) bound_unsigned_float(r)
#define BITS(x) bound_bits(r)
#define FROM_BITS(x) bound_from_bits(r)
#define EXPONENT(x) bound_exponent(r)
#define POWER_OF_TWO(x) bound_power_of_two(r)
#define MAY_BE_NAN(x) may_be_nan(r, x)
#define MAY_BE_INF(x) may_be_inf(r, x)

static Bound choice(Rule *r, Bound cond, Bound x, Bound y) { return ir_bound_select(&r->b, cond, x, y); }
static Bound whole_int(Rule *r) { return ir_bound_whole(&r->b, TY_INT); }
static Bound whole_float(Rule *r) { return ir_bound_whole(&r->b, TY_FLT); }
static Bound where_ends(Rule *r, Bound x) { return bound_where_int(r, has_ends(r, r->arg[0]), x); }

/* Sums of what mixes bits go on as points. */
static Bound sum(Rule *r) {
    bool ends = true;
    for (uint32_t k = 0; k < r->n; k++) ends &= !bound_is_point_where(r->arg[k]);
    return ends ? bound_sum(r) : POINTS(bound_sum(r));
}

static Bound even_trend(Rule *r, Bound x) {
    Bound m = bound_even(r, x), a = {max(r, m.lo, num(r, 0)), m.hi};
    Rule on = *r;
    on.arg = &a;
    return bound_trend(&on, 0);
}

/* a, b, c stand for the bounds of the arguments only while ops.def is read. */
Bound bound_row(Rule *r) {
#define a (r->arg[0])
#define b (r->arg[1])
#define c (r->arg[2])
#define ROW(name, bound)                                                                                               \
    case OP_##name:                                                                                                    \
        return bound;
#define FOP1(name, value, partials, bounds, ...) ROW(name, bounds)
#define FOP2(name, value, partials, bounds, ...) ROW(name, bounds)
#define FOP3(name, value, partials, bounds, ...) ROW(name, bounds)
#define FCMP2(name, value, bounds, ...) ROW(name, bounds)
#define FSEL(name, value, bounds, ...) ROW(name, bounds)
#define IOP1(name, value, bounds, ...) ROW(name, bounds)
#define IOP2(name, value, bounds, ...) ROW(name, bounds)
#define ICMP2(name, value, bounds, ...) ROW(name, bounds)
#define BOP1(name, value, bounds, ...) ROW(name, bounds)
#define BOP2(name, value, bounds, ...) ROW(name, bounds)
#define CONV(name, result, argument, value, bounds, ...) ROW(name, bounds)
#define SPECIAL(name, ...) case OP_##name:
    switch (r->op) {
#include "compiler/ir/ops.def"
#include "compiler/ir/ops_undef.h"
    case OP_COUNT: break;
    }
#undef a
#undef b
#undef c
#undef ROW
    ice(r->b.fn->session, "ir_bound_row: %s is no value row", ir_ops[r->op].name);
}

bool bound_all_points(const Bound *a, uint32_t n) {
    for (uint32_t k = 0; k < n; k++)
        if (!is_point(a[k])) return false;
    return true;
}

Bound ir_bound_row(Builder *b, Op op, const Bound *a, uint32_t n, uint32_t known) {
    if (bound_all_points(a, n)) {
        Inst *args[3];
        for (uint32_t k = 0; k < n; k++) args[k] = a[k].lo;
        Builder exact = *b;
        exact.fold = false;
        return ir_bound_point(ir_emit(&exact, op, n, args));
    }
    Rule r = bound_rule(b, op, a, n, known);
    return bound_row(&r);
}
