/* Bounds of integers and conversions.
 *
 * Integers wrap: ends that would leave the range show by their order, and the bound is then the whole range. What mixes
 * bits (hashes) is exact where its arguments are points at run time. Along a chain of such rows the bound is sel(ok, v,
 * least) and sel(ok, v, greatest) with two constants: each row reads v and ok from there, and the selects between have
 * no use. */
#include "compiler/ir/bounds_rules.h"

static Inst *ile(Rule *r, Inst *x, Inst *y) { return e2(r, OP_ile, x, y); }
static Inst *not_negative(Rule *r, Bound x) { return ile(r, int_num(r, 0), x.lo); }

Bound bound_where_int(Rule *r, Inst *ok, Bound x) {
    if (SPOILED(SPOIL_WHERE)) return x;
    return (Bound){sel(r, ok, x.lo, int_num(r, INT32_MIN)), sel(r, ok, x.hi, int_num(r, INT32_MAX))};
}

/* Is x written as v where ok, else as two constants? */
bool bound_is_point_where(Bound x) {
    return !is_point(x) && x.lo->op == OP_isel && x.hi->op == OP_isel && x.lo->args[0] == x.hi->args[0] &&
           x.lo->args[1] == x.hi->args[1] && x.lo->args[2]->op == OP_consti && x.hi->args[2]->op == OP_consti;
}

Inst *bound_int_is_point(Builder *b, Bound x) {
    return bound_is_point_where(x) ? x.lo->args[0] : ir_emit2(b, OP_ieq, x.lo, x.hi);
}

/* The row of the values that the arguments have where they are points; *ok: where they are. */
static Inst *point_value(Rule *r, const Bound *arg, Inst **ok) {
    Inst *v[3];
    *ok = ir_constb(&r->b, true);
    for (uint32_t k = 0; k < r->n; k++) {
        v[k] = bound_is_point_where(arg[k]) ? arg[k].lo->args[1] : arg[k].lo;
        if (!is_point(arg[k])) *ok = both(r, *ok, bound_int_is_point(&r->b, arg[k]));
    }
    if (SPOILED(SPOIL_POINTS)) *ok = ir_constb(&r->b, true);
    return ir_emit(&r->b, r->op, r->n, v);
}

/* Where such arguments are no points, the rule of the row is asked for what they are then: constants, which fold. They
 * must cease to be points at once, with all others points; else for what they are at worst. */
void bound_points_begin(Rule *r) {
    const Inst *ok = NULL;
    bool any = false, together = true;
    for (uint32_t k = 0; k < r->n; k++) {
        r->source[k] = r->arg[k];
        if (is_point(r->arg[k])) continue;
        bool where = bound_is_point_where(r->arg[k]);
        any |= where;
        together &= where && (!ok || r->arg[k].lo->args[0] == ok);
        if (where) ok = r->arg[k].lo->args[0];
    }
    for (uint32_t k = 0; k < r->n && any; k++) {
        Bound *x = &r->instead[k];
        *x = r->arg[k];
        if (is_point(*x)) continue;
        if (together) *x = (Bound){x->lo->args[2], x->hi->args[2]};
        else *x = ir_bound_whole(&r->b, TY_INT);
    }
    if (any) r->arg = r->instead;
}

/* other: the rule, after bound_points_begin. */
Bound bound_points(Rule *r, Bound other) {
    Inst *ok, *v = point_value(r, r->source, &ok);
    return (Bound){sel(r, ok, v, other.lo), sel(r, ok, v, other.hi)};
}

/* Ends that wrapped are out of order, unless both did: then they are right again. */
Bound bound_unwrapped(Rule *r, Bound x) { return bound_where_int(r, ile(r, x.lo, x.hi), x); }

/* Sum or difference. Where both arguments have a width, the result's may exceed the range of integers by itself. */
Bound bound_sum(Rule *r) {
    Bound x = r->arg[0], y = r->arg[1], s = bound_trend(r, r->op == OP_isub ? 2 : 0);
    Inst *ok = ile(r, s.lo, s.hi);
    if (!is_point(x) && !is_point(y)) {
        Inst *width = e2(r, OP_isub, x.hi, x.lo);
        Inst *sum = e2(r, OP_iadd, width, e2(r, OP_isub, y.hi, y.lo));
        ok = both(r, ok, e2(r, OP_ule, width, sum));
    }
    return bound_where_int(r, ok, s);
}

static Bound four(Rule *r, Op op, Bound x, Bound y) {
    Inst *a = e2(r, op, x.lo, y.lo), *b = e2(r, op, x.lo, y.hi), *c = e2(r, op, x.hi, y.lo), *d = e2(r, op, x.hi, y.hi);
    return (Bound){e2(r, OP_imin, e2(r, OP_imin, a, b), e2(r, OP_imin, c, d)),
                   e2(r, OP_imax, e2(r, OP_imax, a, b), e2(r, OP_imax, c, d))};
}

/* The greatest magnitude, as an unsigned number. */
static Inst *size(Rule *r, Bound x) {
    Inst *lo = sel(r, e2(r, OP_ilt, x.lo, int_num(r, 0)), e1(r, OP_ineg, x.lo), x.lo);
    Inst *hi = sel(r, e2(r, OP_ilt, x.hi, int_num(r, 0)), e1(r, OP_ineg, x.hi), x.hi);
    return e2(r, OP_umax, lo, hi);
}

Bound bound_product(Rule *r) {
    Bound x = r->arg[0], y = r->arg[1];
    Inst *m = size(r, x), *n = size(r, y), *zero = int_num(r, 0);
    Inst *fits = both(r, e2(r, OP_ieq, e2(r, OP_umulh, m, n), zero), ile(r, zero, e2(r, OP_imul, m, n)));
    return bound_where_int(r, fits, four(r, OP_imul, x, y));
}

/* Of a positive divisor, towards 0; unknown of others. Also unsigned, where neither has its highest bit. */
Bound bound_quotient(Rule *r) {
    Bound x = r->arg[0], y = r->arg[1];
    Inst *zero = int_num(r, 0), *positive = e2(r, OP_ilt, zero, y.lo);
    Inst *lo = e2(r, OP_idiv, x.lo, sel(r, e2(r, OP_ilt, x.lo, zero), y.lo, y.hi));
    Inst *hi = e2(r, OP_idiv, x.hi, sel(r, e2(r, OP_ilt, x.hi, zero), y.hi, y.lo));
    return bound_where_int(r, positive, (Bound){lo, hi});
}

/* The remainder has the dividend's sign and at most its size, and is below a positive divisor. Where all dividends have
 * one quotient by one divisor, it rises with them. */
Bound bound_remainder(Rule *r, bool is_unsigned) {
    Bound x = r->arg[0], y = r->arg[1];
    Inst *zero = int_num(r, 0), *positive = e2(r, OP_ilt, zero, y.lo), *most = e2(r, OP_isub, y.hi, int_num(r, 1));
    Inst *low = e2(r, OP_imin, x.lo, zero), *high = e2(r, OP_imax, x.hi, zero);
    low = sel(r, positive, e2(r, OP_imax, low, e1(r, OP_ineg, most)), low);
    high = sel(r, positive, e2(r, OP_imin, high, most), high);
    if (is_point(y)) {
        Inst *one = e2(r, OP_ieq, e2(r, OP_idiv, x.lo, y.lo), e2(r, OP_idiv, x.hi, y.lo));
        one = both(r, one, positive);
        low = sel(r, one, e2(r, OP_irem, x.lo, y.lo), low);
        high = sel(r, one, e2(r, OP_irem, x.hi, y.lo), high);
    }
    if (!is_unsigned) return (Bound){low, high};
    Inst *small = not_negative(r, x), *known = both(r, positive, small);
    Bound far = bound_where_int(r, positive, (Bound){zero, most}); /* a negative number is a large one */
    return (Bound){sel(r, known, low, far.lo), sel(r, known, high, far.hi)};
}

/* At most an operand that is not negative. Under a mask of low bits it rises where the higher ones stay. */
Bound bound_and(Rule *r) {
    Bound x = r->arg[0], y = r->arg[1];
    Inst *top = int_num(r, INT32_MAX), *zero = int_num(r, 0);
    Inst *p = not_negative(r, x), *q = not_negative(r, y);
    Inst *hi = e2(r, OP_imin, sel(r, p, x.hi, top), sel(r, q, y.hi, top));
    Bound any = bound_where_int(r, either(r, p, q), (Bound){zero, hi});
    if (is_point(x)) { /* the mask second */
        Bound swap = x;
        x = y, y = swap;
    }
    if (!is_point(y)) return any;
    Inst *mask = y.lo, *higher = e1(r, OP_inot, mask);
    Inst *low_bits =
        both(r, not_negative(r, y), e2(r, OP_ieq, e2(r, OP_iand, mask, e2(r, OP_iadd, mask, int_num(r, 1))), zero));
    Inst *stays = e2(r, OP_ieq, e2(r, OP_iand, e2(r, OP_ixor, x.lo, x.hi), higher), zero);
    Inst *ok = both(r, low_bits, stays);
    return (Bound){sel(r, ok, e2(r, OP_iand, x.lo, mask), any.lo), sel(r, ok, e2(r, OP_iand, x.hi, mask), any.hi)};
}

/* By one count. To the left ends come back where nothing was lost; ushr of numbers of one sign. */
Bound bound_shift(Rule *r) {
    Bound x = r->arg[0], y = r->arg[1];
    if (!is_point(y)) return ir_bound_whole(&r->b, TY_INT);
    Bound s = bound_trend(r, 0);
    if (r->op == OP_ishr) return s;
    if (r->op == OP_ishl) {
        Inst *lo = e2(r, OP_ieq, e2(r, OP_ishr, s.lo, y.lo), x.lo),
             *hi = e2(r, OP_ieq, e2(r, OP_ishr, s.hi, y.lo), x.hi);
        return bound_where_int(r, both(r, lo, hi), s);
    }
    Inst *zero = int_num(r, 0), *one_sign = ile(r, zero, e2(r, OP_ixor, x.lo, x.hi));
    Inst *greatest = e2(r, OP_ushr, int_num(r, -1), y.lo); /* -1, and all is possible, if the count is 0 */
    Inst *shifts = ile(r, zero, greatest);
    return (Bound){sel(r, one_sign, s.lo, sel(r, shifts, zero, int_num(r, INT32_MIN))),
                   sel(r, one_sign, s.hi, sel(r, shifts, greatest, int_num(r, INT32_MAX)))};
}

/* An unsigned row whose arguments mean the same as signed ones; unknown elsewhere. */
Bound bound_if_positive(Rule *r, Bound x) {
    Inst *ok = not_negative(r, r->arg[0]);
    for (uint32_t k = 1; k < r->n; k++) ok = both(r, ok, not_negative(r, r->arg[k]));
    return bound_where_int(r, ok, x);
}

/* ---- comparisons */

Bound bound_int_compare(Rule *r) {
    Bound x = r->arg[0], y = r->arg[1], c = {e2(r, r->op, x.hi, y.lo), e2(r, r->op, x.lo, y.hi)};
    if (SPOILED(SPOIL_EQUAL)) c.lo = e2(r, r->op, x.lo, y.lo);
    if (r->op == OP_ilt || r->op == OP_ile) return c;
    /* numbers of one sign are in the same order as unsigned */
    Inst *zero = int_num(r, 0);
    Inst *ok = both(r, ile(r, zero, e2(r, OP_ixor, x.lo, x.hi)), ile(r, zero, e2(r, OP_ixor, y.lo, y.hi)));
    return (Bound){both(r, ok, c.lo), either(r, not(r, ok), c.hi)};
}

Bound bound_int_equal(Rule *r) {
    Bound x = r->arg[0], y = r->arg[1];
    if (SPOILED(SPOIL_EQUAL)) return (Bound){e2(r, OP_ieq, x.lo, y.lo), ir_constb(&r->b, true)};
    return (Bound){both(r, e2(r, OP_ieq, x.lo, y.hi), e2(r, OP_ieq, x.hi, y.lo)),
                   both(r, ile(r, x.lo, y.hi), ile(r, y.lo, x.hi))};
}

/* ---- conversions */

Bound bound_unsigned_float(Rule *r) {
    Bound x = r->arg[0], u = bound_trend(r, 0);
    Inst *ok = ile(r, int_num(r, 0), e2(r, OP_ixor, x.lo, x.hi));
    return (Bound){sel(r, ok, u.lo, num(r, 0)), sel(r, ok, u.hi, num(r, 4294967296.0))};
}

/* Of floats of one sign: their bits rise with the magnitude. */
typedef struct Signs {
    Inst *positive, *negative; /* the whole bound, without zeros */
} Signs;

static Signs signs(Rule *r, Bound x) {
    Inst *zero = num(r, 0), *ends = has_ends(r, x);
    return (Signs){both(r, ends, lt(r, zero, x.lo)), both(r, ends, lt(r, x.hi, zero))};
}

Bound bound_bits(Rule *r) {
    Signs s = signs(r, r->arg[0]);
    Bound u = bound_trend(r, 0);
    return bound_where_int(r, either(r, s.positive, s.negative),
                           (Bound){sel(r, s.negative, u.hi, u.lo), sel(r, s.negative, u.lo, u.hi)});
}

Bound bound_from_bits(Rule *r) {
    Bound x = r->arg[0], f = bound_trend(r, 0);
    Inst *zero = int_num(r, 0), *negative = e2(r, OP_ilt, x.hi, zero);
    Inst *ok = either(r, negative, ile(r, zero, x.lo));
    if (SPOILED(SPOIL_SIGN)) negative = ir_constb(&r->b, false);
    f = (Bound){sel(r, negative, f.hi, f.lo), sel(r, negative, f.lo, f.hi)};
    return bound_where(r, ok, f);
}

/* The exponent of a normal number; of others what kernels and the interpreter may say. */
Bound bound_exponent(Rule *r) {
    Bound x = r->arg[0], u = bound_trend(r, 0);
    Signs s = signs(r, x);
    Inst *normal = num(r, r->f64 ? DBL_MIN : (double)FLT_MIN), *top = num(r, INFINITY);
    Inst *above = both(r, le(r, normal, x.lo), lt(r, x.hi, top));
    Inst *below = both(r, le(r, x.hi, e1(r, OP_fneg, normal)), lt(r, e1(r, OP_fneg, top), x.lo));
    Inst *ok = either(r, both(r, above, s.positive), both(r, below, s.negative));
    return (Bound){sel(r, ok, sel(r, s.negative, u.hi, u.lo), int_num(r, -1100)),
                   sel(r, ok, sel(r, s.negative, u.lo, u.hi), int_num(r, 1100))};
}

Bound bound_power_of_two(Rule *r) {
    Bound x = r->arg[0];
    Inst *ok = both(r, ile(r, int_num(r, r->f64 ? -1022 : -126), x.lo), ile(r, x.hi, int_num(r, r->f64 ? 1023 : 127)));
    return bound_where(r, ok, bound_trend(r, 0));
}

Bound bound_mantissa(Rule *r) {
    Bound x = r->arg[0];
    Signs s = signs(r, x);
    Inst *finite = both(r, lt(r, num(r, -INFINITY), x.lo), lt(r, x.hi, num(r, INFINITY)));
    Bound m = {sel(r, s.negative, num(r, -2), num(r, 1)), sel(r, s.negative, num(r, -1), num(r, 2))};
    return bound_where(r, both(r, finite, either(r, s.positive, s.negative)), m);
}
