/* MATH rows -> basic operations: one arithmetic for all widths, kernels and the interpreter.
 *
 * Every function is a range reduction, a minimax polynomial (lower_math_poly.h, fitted by tests/ir/fit_polynomials.py)
 * and a reconstruction; edges (zero, infinities, NaN, poles) come out as C's libm gives them. Results that would be
 * subnormal may become 0. Accuracy is measured in tests/ir/test_math.c. Whether ffma is used depends on the target
 * alone, so that all kernels of a program agree. */
#include "compiler/pass/lower_math.h"
#include "compiler/pass/lower_math_poly.h"

Inst *math_poly(Gen *g, const double *c, uint32_t n, Inst *x, double factor) {
    Inst *p = num(g, c[n - 1] * factor);
    for (uint32_t k = n - 1; k-- > 0;) p = mad(g, p, x, num(g, c[k] * factor));
    return p;
}

Inst *math_reduce(Gen *g, Inst *x, Inst *k, const double *parts, uint32_t n, double factor) {
    for (uint32_t p = 0; p < n; p++) x = mad(g, k, num(g, -parts[p] * factor), x);
    return x;
}

/* Dekker's splitting: the high half of a has so few bits that products of halves are exact. */
static Inst *high_half(Gen *g, Inst *a) {
    Inst *c = scale(g, a, g->f64 ? 134217729.0 : 4097.0);
    return sub(g, c, sub(g, c, a));
}

Inst *math_two_product(Gen *g, Inst *a, Inst *b, Inst **low) {
    Inst *p = mul(g, a, b);
    if (g->fma) {
        *low = ir_emit3(&g->b, OP_ffma, a, b, op1(g, OP_fneg, p));
        return p;
    }
    Inst *ah = high_half(g, a), *bh = high_half(g, b);
    Inst *al = sub(g, a, ah), *bl = sub(g, b, bh);
    Inst *e = add(g, sub(g, mul(g, ah, bh), p), mul(g, ah, bl));
    *low = add(g, add(g, e, mul(g, al, bh)), mul(g, al, bl));
    return p;
}

static Inst *expand(Gen *g, const Inst *i) {
    Inst *x = i->args[0];
    switch ((Op)i->op) {
    case OP_frsqrt: return op2(g, OP_fdiv, num(g, 1), op1(g, OP_fsqrt, x));
    case OP_fcbrt: return math_cbrt(g, x);
    case OP_fexp: return math_exp(g, x, EXP_CLAMP, 0);
    case OP_fexp2: return math_exp2(g, x, NULL, EXP_CLAMP);
    case OP_flog: return math_log(g, x);
    case OP_flog2: return math_log2(g, x);
    case OP_fsin: return math_sin(g, x);
    case OP_fcos: return math_cos(g, x);
    case OP_ftan: return math_tan(g, x);
    case OP_fasin: return math_asin(g, x);
    case OP_facos: return math_acos(g, x);
    case OP_fatan: return math_atan(g, x);
    case OP_fatan2: return math_atan2(g, x, i->args[1]);
    case OP_fsinh: return math_sinh(g, x);
    case OP_fcosh: return math_cosh(g, x);
    case OP_ftanh: return math_tanh(g, x);
    case OP_ferf: return math_erf(g, x);
    case OP_fpow: return math_pow(g, x, i->args[1]);
    default: ice(g->b.fn->session, "lower_math: no expansion of %s", ir_ops[i->op].name);
    }
}

static bool lower_block(PassCtx *ctx, Fn *fn, Block *b, Inst **map) {
    bool changed = false;
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) changed |= lower_block(ctx, fn, i->region[r], map);
        if (!ir_ops[i->op].math) continue;
        Gen g = {.b = ir_before(fn, i), .f64 = fn->precision == PREC_F64, .fma = ctx->has_fma};
        map[i->id] = expand(&g, i);
        ir_unlink(i);
        changed = true;
    }
    return changed;
}

bool lower_math(PassCtx *ctx, Fn *fn) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark m = arena_mark(scratch);
    uint32_t n = ir_number(fn);
    Inst **map = ARENA_ARRAY(scratch, Inst *, n + 1);
    bool changed = lower_block(ctx, fn, fn->body, map);
    if (changed) ir_replace_all(fn, map);
    arena_reset(scratch, m);
    return changed;
}
