/* pow and cbrt. */
#include <math.h>

#include "compiler/ir/range.h"
#include "compiler/pass/lower_math.h"
#include "compiler/pass/lower_math_poly.h"

/* ---- pow: 2^(y log2|x|), the logarithm as an unevaluated sum of two numbers, because y multiplies its error. In f32
 * with fma the logarithm has a table (ir/logs.h), elsewhere a quotient. */

/* a + b as result + *low; |a| >= |b| or a = 0. */
static Inst *fast_two_sum(Gen *g, Inst *a, Inst *b, Inst **low) {
    Inst *s = add(g, a, b);
    *low = add(g, sub(g, a, s), b);
    return s;
}

/* log2 of a positive number: m 2^e, s = (m - 1)/(m + 1), log2 m = 2/ln 2 (s + s^3/3 + ...). Products of the leading
 * term (f64: of the cubic term too) are exact; what is left is small enough for plain arithmetic. */
static Inst *log2_two(Gen *g, Inst *x, Inst **low) {
    Inst *m, *e;
    math_split(g, x, &m, &e);
    Inst *f = sub(g, m, num(g, 1));
    Inst *d = add(g, f, num(g, 2)), *d_low = sub(g, f, sub(g, d, num(g, 2)));
    Inst *inverse = op2(g, OP_fdiv, num(g, 1), d);
    Inst *s = mul(g, f, inverse), *sd_low;
    Inst *sd = math_two_product(g, s, d, &sd_low); /* f - s d, exactly, is what the quotient left over */
    Inst *rest = nmad(g, s, d_low, sub(g, sub(g, f, sd), sd_low));
    Inst *s_low = mul(g, rest, inverse);

    const double *c = g->f64 ? two_over_ln2_64 : two_over_ln2_32;
    Inst *lead_low, *lead = math_two_product(g, s, num(g, c[0]), &lead_low);
    Inst *s2_low, *s2 = g->f64 ? math_two_product(g, s, s, &s2_low) : mul(g, s, s);
    Inst *tail = mad(g, s, num(g, c[1]), lead_low);
    Inst *sum, *sum_low;
    if (g->f64) {
        const double *c3 = two_thirds_over_ln2_64;
        tail = mad(g, scale(g, s_low, c[0]), add(g, s2, num(g, 1)), tail);
        Inst *cube_low, *cube = math_two_product(g, s2, s, &cube_low);
        cube_low = mad(g, s2_low, s, cube_low);
        Inst *third_low, *third = math_two_product(g, cube, num(g, c3[0]), &third_low);
        third_low = mad(g, cube, num(g, c3[1]), mad(g, cube_low, num(g, c3[0]), third_low));
        Inst *fifth = mul(g, mul(g, cube, s2), math_poly(g, pow_64, sizeof pow_64 / sizeof *pow_64, s2, 1));
        Inst *more_low;
        sum = fast_two_sum(g, e, lead, &sum_low);
        sum = fast_two_sum(g, sum, third, &more_low);
        sum_low = add(g, sum_low, add(g, more_low, add(g, third_low, fifth)));
    } else {
        tail = mad(g, s_low, num(g, c[0]), tail);
        tail = mad(g, mul(g, s, s2), math_poly(g, pow_32, sizeof pow_32 / sizeof *pow_32, s2, 1), tail);
        sum = fast_two_sum(g, e, lead, &sum_low);
    }
    return fast_two_sum(g, sum, add(g, sum_low, tail), low); /* low becomes small: exp2 rounds by the sum alone */
}

/* pow(x, y) of r = |x|^y: its sign, and NaN. */
static Inst *signed_power(Gen *g, Inst *x, Inst *y, Inst *finite, Inst *r) {
    Inst *integer = op2(g, OP_feq, op1(g, OP_ffloor, y), y);
    Inst *half = scale(g, y, 0.5);
    Inst *odd = op2(g, OP_band, integer, op2(g, OP_fne, op1(g, OP_ffloor, half), half));
    r = sel(g, odd, op2(g, OP_fcopysign, r, x), r);
    Inst *bad = op2(g, OP_band, less(g, x, num(g, 0)), finite);
    return sel(g, op2(g, OP_band, bad, op1(g, OP_bnot, integer)), num(g, NAN), r);
}

static Inst *one_of(Gen *g, Inst *a, Inst *y, Inst *r) { /* also pow(NaN, 0), pow(1, NaN), pow(-1, inf) */
    Inst *one = op2(g, OP_bor, op2(g, OP_feq, y, num(g, 0)), op2(g, OP_feq, a, num(g, 1)));
    return sel(g, one, num(g, 1), r);
}

/* f32 with fma: 2^(y / ln 2 * ln a). y is kept so small that only an infinite logarithm makes the product infinite;
 * there its low part is a NaN, of which fmin makes a number. */
static Inst *power_32(Gen *g, Inst *x, Inst *y) {
    const double most = 0x1p40; /* any number but 1 to it is 0 or infinite */
    const bool fixed = y->op == OP_constf && y->imm.f != 0 && !isnan(y->imm.f);
    const bool fraction = fixed && y->imm.f != floor(y->imm.f);
    Inst *a;
    if (!fraction) a = op1(g, OP_fabs, x);
    else if (ir_is_never_negative(x)) a = x;
    else
        a = sel(g, op2(g, OP_feq, x, num(g, -INFINITY)), num(g, INFINITY),
                x); /* the logarithm makes NaN of the others */
    LogParts p = math_log_parts(g, a);
    Inst *log_low, *log = fast_two_sum(g, p.high, p.lead, &log_low);
    log_low = add(g, log_low, add(g, p.lead_low, p.tail));

    Inst *z = op2(g, OP_fmax, op2(g, OP_fmin, y, num(g, most)), num(g, -most));
    Inst *w_low, *w = math_two_product(g, z, num(g, one_over_ln2_32[0]), &w_low);
    w_low = mad(g, z, num(g, one_over_ln2_32[1]), w_low);
    Inst *t_low, *t = math_two_product(g, w, log, &t_low);
    t_low = mad(g, w_low, log, mad(g, w, log_low, t_low));
    Inst *r = math_exp2_two(g, t, op2(g, OP_fmin, num(g, 8), t_low));
    if (fraction) return r;
    if (!fixed) r = one_of(g, a, y, r);
    return signed_power(g, x, y, less(g, a, num(g, INFINITY)), r);
}

Inst *math_pow(Gen *g, Inst *x, Inst *y) {
    if (!g->f64 && g->fma) return power_32(g, x, y);
    Inst *a = op1(g, OP_fabs, x), *inf = num(g, INFINITY), *zero = num(g, 0);
    Inst *low, *log = log2_two(g, a, &low);
    Inst *finite = less(g, a, inf);
    log = sel(g, op2(g, OP_feq, a, zero), num(g, -INFINITY), log);
    log = sel(g, finite, log, a); /* inf, NaN */

    Inst *t_low, *t = math_two_product(g, y, log, &t_low);
    t_low = mad(g, y, low, t_low);
    /* Far outside the range of exp2 the low part is noise, or inf - inf. */
    Inst *near = less(g, op1(g, OP_fabs, t), num(g, 4096));
    Inst *r = math_exp2(g, t, sel(g, near, t_low, zero), EXP_CLAMP);
    return signed_power(g, x, y, finite, one_of(g, a, y, r));
}

/* ---- cbrt: y ~ x^(-1/3) without divisions (Householder's iteration on 1 - x y^3), then z = x y^2 corrected once */

static Inst *rcbrt_step(Gen *g, Inst *x, Inst *y) {
    Inst *c = nmad(g, mul(g, mul(g, x, y), y), y, num(g, 1)); /* x*y first: y^3 of x = 0 may overflow */
    Inst *p = mad(g, mad(g, c, num(g, 14.0 / 81), num(g, 2.0 / 9)), c, num(g, 1.0 / 3));
    return mad(g, mul(g, y, c), p, y);
}

Inst *math_cbrt(Gen *g, Inst *x) {
    Inst *a = op1(g, OP_fabs, x), *tiny = less(g, a, num(g, g->f64 ? 0x1p-1022 : 0x1p-126));
    Inst *v = sel(g, tiny, scale(g, a, g->f64 ? 0x1p54 : 0x1p24), a);
    Inst *y, *unscale = sel(g, tiny, num(g, g->f64 ? 0x1p-18 : 0x1p-8), num(g, 1));
    Inst *usable = less(g, a, num(g, INFINITY));
    if (g->f64) {
        /* v = w 2^(3q), w in [1, 8): (e + 3072) div 3 by a product, exact for these exponents. */
        Inst *e = op2(g, OP_iadd, op1(g, OP_fexpo, v), int_num(g, 3072));
        Inst *q = op2(g, OP_ushr, op2(g, OP_imul, e, int_num(g, 21846)), int_num(g, 16));
        Inst *rem = op2(g, OP_isub, e, op2(g, OP_imul, q, int_num(g, 3)));
        Inst *is1 = op2(g, OP_ieq, rem, int_num(g, 1)), *is2 = op2(g, OP_ieq, rem, int_num(g, 2));
        Inst *m = op1(g, OP_fmant, v);
        Inst *root = sel(g, is2, num(g, 0.62996052494743658), sel(g, is1, num(g, 0.79370052598409974), num(g, 1)));
        y = mul(g, math_poly(g, rcbrt_64, sizeof rcbrt_64 / sizeof *rcbrt_64, m, 1), root);
        v = mul(g, m, sel(g, is2, num(g, 4), sel(g, is1, num(g, 2), num(g, 1))));
        unscale = mul(g, unscale, op1(g, OP_ftwoi, op2(g, OP_isub, q, int_num(g, 1024))));
        usable = op2(g, OP_band, usable, less(g, num(g, 0), a)); /* fmant of 0 says nothing */
    } else {
        /* A third of the bits, subtracted from a constant: x^(-1/3) within a few percent. */
        Inst *third = op2(g, OP_umulh, op1(g, OP_fasuint, v), int_num(g, 0x55555556));
        y = op1(g, OP_iasfloat, op2(g, OP_isub, int_num(g, 0x54a2fa8c), third));
        y = rcbrt_step(g, v, y);
    }
    y = rcbrt_step(g, v, y);
    Inst *z = mul(g, mul(g, v, y), y);
    Inst *rest = nmad(g, mul(g, z, z), z, v);
    z = mad(g, rest, scale(g, mul(g, y, y), 1.0 / 3), z);
    return op2(g, OP_fcopysign, sel(g, usable, mul(g, z, unscale), a), x);
}
