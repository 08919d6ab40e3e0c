/* Trigonometric functions and their inverses. */
#include <math.h>

#include "compiler/ir/range.h"
#include "compiler/pass/lower_math.h"
#include "compiler/pass/lower_math_poly.h"

static const double one_over_pi = 0.318309886183790671538, pi_value = 3.14159265358979323846;
static const double magic_32 = 12582912.0; /* 1.5 * 2^23 */

static Inst *reduce_by_pi(Gen *g, Inst *x, Inst *k, double factor) {
    if (g->f64) return math_reduce(g, x, k, g->fma ? pi_fma_64 : pi_split_64, g->fma ? 3 : 4, factor);
    return math_reduce(g, x, k, g->fma ? pi_fma_32 : pi_split_32, g->fma ? 3 : 5, factor);
}

/* r + r^3 P(r^2) */
static Inst *odd_sum(Gen *g, Inst *r, Inst *r2, Inst *p) { return mad(g, mul(g, r, r2), p, r); }

/* k mod 2 of an integer-valued float, 0 or 1. */
static Inst *parity_64(Gen *g, Inst *k) { return mad(g, op1(g, OP_ffloor, scale(g, k, 0.5)), num(g, -2), k); }

/* sin of r in [-pi/2, pi/2]. Arguments far beyond the reduction's reach leave garbage in r: the result is kept in [-1,
 * 1] even then. */
static Inst *sin_core(Gen *g, Inst *r) {
    Inst *r2 = mul(g, r, r);
    Inst *y = odd_sum(g, r, r2, POLY(g, sin_half, r2));
    return op2(g, OP_fmax, op2(g, OP_fmin, y, num(g, 1)), num(g, -1));
}

/* Of arguments in [-1.5, 1.5] nothing is reduced. The bits are the same (for all floats, tried), so that it does not
 * matter which kernel knows. */
static bool is_small(const Gen *g, const Inst *x) {
    const IrRange r = ir_range_rounded(x);
    return !g->f64 && g->fma && r.lo >= -1.5 && r.hi <= 1.5 && !(r.beyond & ~IR_NAN);
}

Inst *math_sin(Gen *g, Inst *x) {
    if (is_small(g, x)) {
        Inst *r2 = mul(g, x, x);
        return odd_sum(g, x, r2, POLY32(g, sin_half, r2));
    }
    if (g->f64) {
        Inst *k = op1(g, OP_fround, scale(g, x, one_over_pi));
        Inst *sign = mad(g, parity_64(g, k), num(g, -2), num(g, 1));
        return sin_core(g, mul(g, reduce_by_pi(g, x, k, 1), sign));
    }
    /* The sum's lowest bit is the parity of k. */
    Inst *t = mad(g, x, num(g, one_over_pi), num(g, magic_32));
    Inst *r = reduce_by_pi(g, x, sub(g, t, num(g, magic_32)), 1);
    Inst *sign = op2(g, OP_ishl, op1(g, OP_fasuint, t), int_num(g, 31));
    return sin_core(g, op1(g, OP_iasfloat, op2(g, OP_ixor, op1(g, OP_fasuint, r), sign)));
}

/* cos(x) = (-1)^(j + 1) sin(x - (j + 1/2) pi): the zeros of cos are the zeros of the polynomial, so they keep their
 * relative accuracy. */
Inst *math_cos(Gen *g, Inst *x) {
    if (is_small(g, x)) { /* sin(pi/2 - |x|), in which the third part of pi is lost; near 0 the polynomial exceeds 1 */
        Inst *a = ir_is_never_negative(x) ? x : op1(g, OP_fabs, x);
        Inst *r = add(g, sub(g, num(g, pi_fma_32[0] / 2), a), num(g, pi_fma_32[1] / 2)), *r2 = mul(g, r, r);
        return op2(g, OP_fmin, odd_sum(g, r, r2, POLY32(g, sin_half, r2)), num(g, 1));
    }
    Inst *q = mad(g, x, num(g, one_over_pi), num(g, -0.5));
    if (g->f64) {
        Inst *j = op1(g, OP_fround, q);
        Inst *sign = mad(g, parity_64(g, j), num(g, 2), num(g, -1));
        return sin_core(g, mul(g, reduce_by_pi(g, x, add(g, j, num(g, 0.5)), 1), sign));
    }
    Inst *t = add(g, q, num(g, magic_32 + 1)); /* the lowest bit is that of j + 1 */
    Inst *k = add(g, sub(g, t, num(g, magic_32 + 1)), num(g, 0.5));
    Inst *r = reduce_by_pi(g, x, k, 1);
    Inst *sign = op2(g, OP_ishl, op1(g, OP_fasuint, t), int_num(g, 31));
    return sin_core(g, op1(g, OP_iasfloat, op2(g, OP_ixor, op1(g, OP_fasuint, r), sign)));
}

Inst *math_tan(Gen *g, Inst *x) {
    Inst *k, *odd;
    if (g->f64) {
        k = op1(g, OP_fround, scale(g, x, 2 * one_over_pi));
        odd = op2(g, OP_fne, parity_64(g, k), num(g, 0));
    } else {
        Inst *t = mad(g, x, num(g, 2 * one_over_pi), num(g, magic_32));
        k = sub(g, t, num(g, magic_32));
        odd = op2(g, OP_ine, op2(g, OP_iand, op1(g, OP_fasuint, t), int_num(g, 1)), int_num(g, 0));
    }
    Inst *r = reduce_by_pi(g, x, k, 0.5);
    r = op2(g, OP_fmax, op2(g, OP_fmin, r, num(g, 0.8)), num(g, -0.8)); /* beyond the reduction's reach: no inf/inf */
    Inst *r2 = mul(g, r, r);
    Inst *s = odd_sum(g, r, r2, POLY(g, sin_quarter, r2));
    Inst *c = mad(g, mul(g, r2, r2), POLY(g, cos_quarter, r2), mad(g, r2, num(g, -0.5), num(g, 1)));
    return op2(g, OP_fdiv, sel(g, odd, c, s), sel(g, odd, op1(g, OP_fneg, s), c));
}

/* ---- inverse functions */

/* asin of s in [0, 1/2], s2 = s^2 */
static Inst *asin_core(Gen *g, Inst *s, Inst *s2) { return odd_sum(g, s, s2, POLY(g, asin, s2)); }

/* For |x| > 1/2: asin(|x|) = pi/2 - 2 asin(sqrt((1 - |x|)/2)). Gives the core's value p of either case; NaN beyond 1.
 */
static Inst *asin_half(Gen *g, Inst *x, Inst **big) {
    Inst *a = op1(g, OP_fabs, x);
    *big = less(g, num(g, 0.5), a);
    Inst *s2 = sel(g, *big, mad(g, a, num(g, -0.5), num(g, 0.5)), mul(g, a, a));
    Inst *s = sel(g, *big, op1(g, OP_fsqrt, s2), a);
    return asin_core(g, s, s2);
}

Inst *math_asin(Gen *g, Inst *x) {
    Inst *big, *p = asin_half(g, x, &big);
    Inst *far = mad(g, p, num(g, -2), num(g, pi_value / 2));
    return op2(g, OP_fcopysign, sel(g, big, far, p), x);
}

Inst *math_acos(Gen *g, Inst *x) {
    Inst *big, *p = asin_half(g, x, &big);
    Inst *negative = less(g, x, num(g, 0));
    Inst *twice = add(g, p, p);
    Inst *far = sel(g, negative, sub(g, num(g, pi_value), twice), twice);
    return sel(g, big, far, sub(g, num(g, pi_value / 2), op2(g, OP_fcopysign, p, x)));
}

/* atan(n/d) for 0 <= n <= d. f64 turns ratios above tan(pi/8) by pi/4 within the one division: the polynomial on [0, 1]
 * would need twice the coefficients. */
static Inst *atan_ratio(Gen *g, Inst *n, Inst *d) {
    Inst *turn = NULL;
    if (g->f64) {
        turn = less(g, scale(g, d, 0.41421356237309503), n);
        Inst *n2 = sel(g, turn, sub(g, n, d), n);
        d = sel(g, turn, add(g, n, d), d);
        n = n2;
    }
    Inst *t = op2(g, OP_fdiv, n, d);
    Inst *t2 = mul(g, t, t);
    Inst *p = odd_sum(g, t, t2, POLY(g, atan, t2));
    return turn ? add(g, p, sel(g, turn, num(g, pi_value / 4), num(g, 0))) : p;
}

Inst *math_atan(Gen *g, Inst *x) {
    Inst *a = op1(g, OP_fabs, x), *one = num(g, 1);
    Inst *swap = less(g, one, a);
    Inst *n = op2(g, OP_fmin, a, one), *d = op2(g, OP_fmax, one, a); /* NaN: n is NaN, d is 1 */
    if (g->f64) d = op2(g, OP_fmin, d, num(g, 1e300));               /* n + d and n - d stay finite */
    Inst *p = atan_ratio(g, n, d);
    return op2(g, OP_fcopysign, sel(g, swap, sub(g, num(g, pi_value / 2), p), p), x);
}

Inst *math_atan2(Gen *g, Inst *y, Inst *x) {
    Inst *ax = op1(g, OP_fabs, x), *ay = op1(g, OP_fabs, y);
    Inst *swap = less(g, ax, ay);
    Inst *n = sel(g, swap, ax, ay), *d = sel(g, swap, ay, ax); /* a NaN on either side reaches the ratio */
    Inst *inf = num(g, INFINITY);
    Inst *both_inf = op2(g, OP_feq, n, inf);
    n = sel(g, both_inf, num(g, 1), n); /* inf/inf counts as 1, 0/0 as 0; a NaN in d stays */
    d = sel(g, both_inf, op2(g, OP_fmin, d, num(g, 1)), d);
    d = sel(g, op2(g, OP_feq, d, num(g, 0)), num(g, 1), d);
    if (g->f64) {
        Inst *huge = less(g, num(g, 0x1p1000), d);
        Inst *by = sel(g, huge, num(g, 0x1p-100), num(g, 1));
        n = mul(g, n, by);
        d = mul(g, d, by);
    }
    Inst *p = atan_ratio(g, n, d);
    p = sel(g, swap, sub(g, num(g, pi_value / 2), p), p);
    Inst *left = less(g, op2(g, OP_fcopysign, num(g, 1), x), num(g, 0)); /* -0 too */
    p = sel(g, left, sub(g, num(g, pi_value), p), p);
    return op2(g, OP_fcopysign, p, y);
}
