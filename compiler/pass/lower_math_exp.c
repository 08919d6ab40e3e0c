/* exp, log and what is made of them. */
#include <math.h>

#include "compiler/ir/range.h"
#include "compiler/pass/lower_math.h"
#include "compiler/pass/lower_math_poly.h"

static const double log2_of_e = 1.44269504088896340736;

/* ---- exponentials: 2^n p(r) with |r| <= half a unit
 *
 * The polynomial is doubled and the power of two halved, so that n reaches one beyond the largest exponent and overflow
 * comes from the last product. In f32 the sum x log2(e) + MAGIC rounds to an integer whose low bits are the exponent
 * field to be. */

static const double magic_32 = 12582912.0; /* 1.5 * 2^23: sums keep integers in their low bits */

typedef struct Power {
    Inst *n;     /* integer-valued float */
    Inst *scale; /* 2^(n - 1 + shift) */
} Power;

static Power split_power(Gen *g, Inst *x, double factor, int shift) {
    if (g->f64) {
        Inst *n = op1(g, OP_fround, factor == 1 ? x : scale(g, x, factor));
        Inst *e = op2(g, OP_iadd, op1(g, OP_f2i, n), int_num(g, shift - 1));
        return (Power){n, op1(g, OP_ftwoi, e)};
    }
    double magic = magic_32 + 126 + shift;
    Inst *t = factor == 1 ? add(g, x, num(g, magic)) : mad(g, x, num(g, factor), num(g, magic));
    Inst *bits = op2(g, OP_ishl, op1(g, OP_fasuint, t), int_num(g, 23));
    return (Power){sub(g, t, num(g, magic)), op1(g, OP_iasfloat, bits)};
}

static Inst *clamped(Gen *g, Inst *x, int clamp, double low, double high) {
    const IrRange r = ir_range_rounded(x);
    if (!(r.beyond & ~IR_NAN) && r.hi < high - 1) clamp &= ~EXP_CLAMP_HIGH;
    if (!(r.beyond & ~IR_NAN) && r.lo > low + 1) clamp &= ~EXP_CLAMP_LOW;
    if (clamp & EXP_CLAMP_HIGH) x = op2(g, OP_fmin, x, num(g, high)); /* a NaN in x stays */
    if (clamp & EXP_CLAMP_LOW) x = op2(g, OP_fmax, x, num(g, low));
    return x;
}

Inst *math_exp(Gen *g, Inst *x, int clamp, int shift) {
    /* f32: at the low end the exponent field is 0 and the scale is 0, which is the underflow. f64: the scale stays
     * normal and a select makes the 0. At the high end the product overflows. */
    double low = g->f64 ? -708.0 : -87.33, high = (g->f64 ? 709.9 : 88.9) - shift * 0.6931;
    Inst *c = clamped(g, x, clamp, low, high);
    Power p = split_power(g, c, log2_of_e, shift);
    const double *ln2 = g->f64 ? (g->fma ? ln2_fma_64 : ln2_split_64) : g->fma ? ln2_fma_32 : ln2_split_32;
    Inst *r = math_reduce(g, c, p.n, ln2, 2, 1);
    Inst *y = mul(g, mad(g, MATH_POLY(g, exp, r, 2), r, num(g, 2)), p.scale);
    return g->f64 && (clamp & EXP_CLAMP_LOW) ? sel(g, less(g, x, num(g, low)), num(g, 0), y) : y;
}

Inst *math_exp2_two(Gen *g, Inst *x, Inst *low) {
    Power p = split_power(g, clamped(g, add(g, x, low), EXP_CLAMP, -126, 128.4), 1, 0);
    /* Where the sum was clamped from below, the scale is 0 and the rest is anything; from above, it is at least 0. */
    Inst *r = op2(g, OP_fmax, add(g, sub(g, x, p.n), low), num(g, -1));
    return mul(g, mad(g, MATH_POLY(g, exp2, r, 2), r, num(g, 2)), p.scale);
}

Inst *math_exp2(Gen *g, Inst *x, Inst *low_part, int clamp) {
    double low = g->f64 ? -1021.4 : -126, high = g->f64 ? 1024.4 : 128.4;
    Inst *c = clamped(g, x, clamp, low, high);
    Power p = split_power(g, c, 1, 0);
    Inst *r = sub(g, c, p.n);
    if (low_part) r = add(g, r, low_part);
    Inst *y = mul(g, mad(g, MATH_POLY(g, exp2, r, 2), r, num(g, 2)), p.scale);
    return g->f64 && (clamp & EXP_CLAMP_LOW) ? sel(g, less(g, x, num(g, low)), num(g, 0), y) : y;
}

/* ---- logarithms */

void math_split(Gen *g, Inst *x, Inst **m, Inst **e) {
    if (!g->f64) {
        const int32_t half_sqrt = 0x3f3504f3; /* bits of sqrt(1/2): subtracting them moves the binade's border there */
        Inst *tiny = less(g, x, num(g, 0x1p-126)), *normal = sel(g, tiny, scale(g, x, 0x1p24), x);
        Inst *bits = op2(g, OP_isub, op1(g, OP_fasuint, normal), int_num(g, half_sqrt));
        *e = add(g, op1(g, OP_i2f, op2(g, OP_ishr, bits, int_num(g, 23))), sel(g, tiny, num(g, -24), num(g, 0)));
        *m = op1(g, OP_iasfloat, op2(g, OP_iadd, op2(g, OP_iand, bits, int_num(g, 0x7fffff)), int_num(g, half_sqrt)));
        return;
    }
    Inst *tiny = less(g, x, num(g, 0x1p-1022));
    Inst *normal = sel(g, tiny, scale(g, x, 0x1p54), x);
    Inst *n = add(g, op1(g, OP_i2f, op1(g, OP_fexpo, normal)), sel(g, tiny, num(g, -54), num(g, 0)));
    Inst *mant = op1(g, OP_fmant, normal);
    Inst *big = less(g, num(g, 1.4142135623730951), mant);
    *m = sel(g, big, scale(g, mant, 0.5), mant);
    *e = sel(g, big, add(g, n, num(g, 1)), n);
}

/* log is -inf at 0, NaN below, inf at inf; y elsewhere. */
static Inst *log_edges(Gen *g, Inst *x, Inst *y) {
    y = sel(g, less(g, x, num(g, INFINITY)), y, x);
    Inst *edge = sel(g, op2(g, OP_feq, x, num(g, 0)), num(g, -INFINITY), num(g, NAN));
    return sel(g, less(g, num(g, 0), x), y, edge);
}

/* log(1 + f) = f - (f^2/2 - s (f^2/2 + R(s^2))), s = f/(2 + f); the parts are returned for the caller to add the
 * exponent in. */
static Inst *log1p_tail_64(Gen *g, Inst *f, Inst **half_square) {
    Inst *s = op2(g, OP_fdiv, f, add(g, f, num(g, 2)));
    Inst *s2 = mul(g, s, s), *h = mul(g, scale(g, f, 0.5), f);
    Inst *r = mul(g, s2, math_poly(g, log_64, sizeof log_64 / sizeof *log_64, s2, 1));
    *half_square = h;
    return mul(g, s, add(g, h, r));
}

LogParts math_log_parts(Gen *g, Inst *x) {
    Inst *f = op1(g, OP_flogm, x), *half = scale(g, f, 0.5), *cube = mul(g, mul(g, f, f), f);
    LogParts p = {.high = op1(g, OP_flogh, x), .lead = nmad(g, half, f, f)};
    p.lead_low = nmad(g, half, f, sub(g, f, p.lead)); /* exact: the lead is more than half of f */
    p.tail = mad(g, cube, POLY32(g, log_tail, f), op1(g, OP_flogl, x));
    return p;
}

Inst *math_log(Gen *g, Inst *x) {
    if (!g->f64 && g->fma) {
        Inst *f = op1(g, OP_flogm, x);
        Inst *tail = mad(g, mul(g, f, f), POLY32(g, log_near, f), op1(g, OP_flogl, x));
        return add(g, op1(g, OP_flogh, x), add(g, f, tail));
    }
    Inst *m, *e;
    math_split(g, x, &m, &e);
    Inst *f = sub(g, m, num(g, 1));
    if (!g->f64) {
        Inst *p = mad(g, math_poly(g, log_32, sizeof log_32 / sizeof *log_32, f, 1), f, num(g, 1));
        return log_edges(g, x, mad(g, e, num(g, 0.693147180559945309417), mul(g, f, p)));
    }
    Inst *h, *tail = log1p_tail_64(g, f, &h);
    tail = mad(g, e, num(g, ln2_split_64[1]), tail);
    Inst *low = sub(g, sub(g, h, tail), f);
    return log_edges(g, x, sub(g, scale(g, e, ln2_split_64[0]), low));
}

Inst *math_log2(Gen *g, Inst *x) {
    Inst *m, *e;
    math_split(g, x, &m, &e);
    Inst *f = sub(g, m, num(g, 1));
    if (!g->f64) {
        Inst *p = math_poly(g, log2_32, sizeof log2_32 / sizeof *log2_32, f, 1);
        return log_edges(g, x, mad(g, f, p, e));
    }
    Inst *h, *tail = log1p_tail_64(g, f, &h);
    return log_edges(g, x, mad(g, sub(g, f, sub(g, h, tail)), num(g, log2_of_e), e));
}

/* ---- hyperbolic functions: an odd polynomial near 0, where e^x - e^-x cancels; h = e^|x|/2 elsewhere */

/* x + x^3 P(x^2) */
#define ODD(g, name, x) odd_sum(g, x, x2, POLY(g, name, x2))
static Inst *odd_sum(Gen *g, Inst *x, Inst *x2, Inst *p) { return mad(g, mul(g, x, x2), p, x); }

Inst *math_sinh(Gen *g, Inst *x) {
    Inst *a = op1(g, OP_fabs, x), *x2 = mul(g, x, x);
    Inst *h = math_exp(g, a, EXP_CLAMP_HIGH, -1);
    Inst *far = sub(g, h, op2(g, OP_fdiv, num(g, 0.25), h));
    return op2(g, OP_fcopysign, sel(g, less(g, a, num(g, 1)), ODD(g, sinh, a), far), x);
}

Inst *math_cosh(Gen *g, Inst *x) {
    Inst *h = math_exp(g, op1(g, OP_fabs, x), EXP_CLAMP_HIGH, -1);
    return add(g, h, op2(g, OP_fdiv, num(g, 0.25), h));
}

Inst *math_tanh(Gen *g, Inst *x) {
    Inst *a = op1(g, OP_fabs, x), *x2 = mul(g, x, x);
    Inst *e = math_exp(g, add(g, a, a), EXP_CLAMP_HIGH, 0);
    Inst *far = sub(g, num(g, 1), op2(g, OP_fdiv, num(g, 2), add(g, e, num(g, 1))));
    Inst *near = ODD(g, tanh, a);
    return op2(g, OP_fcopysign, sel(g, less(g, a, num(g, g->f64 ? 0.55 : 0.625)), near, far), x);
}

/* erf: odd polynomial near 0, elsewhere 1 - 2^q(|x|), q fitted to log2(erfc). */
Inst *math_erf(Gen *g, Inst *x) {
    Inst *a = op1(g, OP_fabs, x), *x2 = mul(g, x, x);
    Inst *q = POLY(g, erfc_log2, op2(g, OP_fmin, a, num(g, g->f64 ? 6 : 4)));
    Inst *far = sub(g, num(g, 1), math_exp2(g, q, NULL, 0));
    Inst *near = mul(g, x, POLY(g, erf, x2));
    return sel(g, less(g, a, num(g, g->f64 ? 1 : 0.875)), near, op2(g, OP_fcopysign, far, x));
}
