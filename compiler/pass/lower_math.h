/* Inside lower_math: the expression builder that the generators share.
 *
 * A generator emits the operations of one elementary function at g->b and returns the result. All of them are
 * branch-free and give the same bits at every width; f32 and f64 differ in coefficients and in how exponents are taken
 * apart (bits in f32; fexpo, fmant and ftwoi in f64). */
#ifndef SALTUS_PASS_LOWER_MATH_H
#define SALTUS_PASS_LOWER_MATH_H

#include "compiler/pass/pass.h"

typedef struct Gen {
    Builder b;
    bool f64;
    bool fma; /* ffma is one instruction of the target */
} Gen;

static inline Inst *num(Gen *g, double v) { return ir_constf(&g->b, v); }
static inline Inst *int_num(Gen *g, int32_t v) { return ir_consti(&g->b, v); }
static inline Inst *op1(Gen *g, Op op, Inst *a) { return ir_emit1(&g->b, op, a); }
static inline Inst *op2(Gen *g, Op op, Inst *a, Inst *c) { return ir_emit2(&g->b, op, a, c); }
static inline Inst *add(Gen *g, Inst *a, Inst *c) { return op2(g, OP_fadd, a, c); }
static inline Inst *sub(Gen *g, Inst *a, Inst *c) { return op2(g, OP_fsub, a, c); }
static inline Inst *mul(Gen *g, Inst *a, Inst *c) { return op2(g, OP_fmul, a, c); }
static inline Inst *scale(Gen *g, Inst *a, double v) { return op2(g, OP_fmul, a, num(g, v)); }
static inline Inst *sel(Gen *g, Inst *cond, Inst *x, Inst *y) { return ir_emit3(&g->b, OP_fsel, cond, x, y); }
static inline Inst *less(Gen *g, Inst *a, Inst *c) { return op2(g, OP_flt, a, c); }
/* a*b + c, with one rounding where the target has that. */
static inline Inst *mad(Gen *g, Inst *a, Inst *b, Inst *c) {
    return g->fma ? ir_emit3(&g->b, OP_ffma, a, b, c) : add(g, mul(g, a, b), c);
}
/* c - a*b */
static inline Inst *nmad(Gen *g, Inst *a, Inst *b, Inst *c) {
    return g->fma ? ir_emit3(&g->b, OP_ffma, op1(g, OP_fneg, a), b, c) : sub(g, c, mul(g, a, b));
}

/* c[0] + c[1] x + ... by Horner's rule, every coefficient times `factor`. */
Inst *math_poly(Gen *g, const double *c, uint32_t n, Inst *x, double factor);
#define POLY(g, name, x) MATH_POLY(g, name, x, 1)
#define MATH_POLY(g, name, x, factor)                                                                                  \
    ((g)->f64 ? math_poly(g, name##_64, sizeof name##_64 / sizeof *name##_64, x, factor)                               \
              : math_poly(g, name##_32, sizeof name##_32 / sizeof *name##_32, x, factor))
#define POLY32(g, name, x) math_poly(g, name##_32, sizeof name##_32 / sizeof *name##_32, x, 1)
/* x - k * (sum of parts) * factor, most significant part first. */
Inst *math_reduce(Gen *g, Inst *x, Inst *k, const double *parts, uint32_t n, double factor);
/* a*b exactly, as result + *low. */
Inst *math_two_product(Gen *g, Inst *a, Inst *b, Inst **low);

/* lower_math_exp.c */
enum { EXP_CLAMP_HIGH = 1, EXP_CLAMP_LOW = 2, EXP_CLAMP = 3 }; /* which end of its range the argument may exceed */
Inst *math_exp(Gen *g, Inst *x, int clamp, int shift);         /* e^x 2^shift, shift 0 or -1 */
Inst *math_exp2(Gen *g, Inst *x, Inst *low, int clamp);        /* 2^(x + low); low may be NULL */
/* f32: the same, where low may be as large as 8, and whatever it is if x is infinite: it is added before it is rounded.
 */
Inst *math_exp2_two(Gen *g, Inst *x, Inst *low);
/* f32 with fma: ln x = high + lead + (lead_low + tail); |high| >= |lead|, or 0. high and tail are infinite at 0 and
 * infinity, where lead is 0. */
typedef struct LogParts {
    Inst *high, *lead, *lead_low, *tail;
} LogParts;
LogParts math_log_parts(Gen *g, Inst *x);
Inst *math_log(Gen *g, Inst *x);
Inst *math_log2(Gen *g, Inst *x);
Inst *math_sinh(Gen *g, Inst *x);
Inst *math_cosh(Gen *g, Inst *x);
Inst *math_tanh(Gen *g, Inst *x);
Inst *math_erf(Gen *g, Inst *x);
/* m in [sqrt(1/2), sqrt(2)) and the exponent e as a float with x = m 2^e, x positive and finite (f32: and normal). */
void math_split(Gen *g, Inst *x, Inst **m, Inst **e);

/* lower_math_trig.c */
Inst *math_sin(Gen *g, Inst *x);
Inst *math_cos(Gen *g, Inst *x);
Inst *math_tan(Gen *g, Inst *x);
Inst *math_asin(Gen *g, Inst *x);
Inst *math_acos(Gen *g, Inst *x);
Inst *math_atan(Gen *g, Inst *x);
Inst *math_atan2(Gen *g, Inst *y, Inst *x);

/* lower_math_pow.c */
Inst *math_pow(Gen *g, Inst *x, Inst *y);
Inst *math_cbrt(Gen *g, Inst *x);

/* lower_math_powers.c: for pipeline_primal, before contraction */
bool opt_powers(PassCtx *ctx, Fn *fn);

#endif
