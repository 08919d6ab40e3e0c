/* Quotients by constants, as two products.
 *
 * The divider takes 5 cycles for a vector of 32 bytes and up to 16 for one of 64, and what is divided by is a constant
 * more often than not: `smoothstep(0.0, 0.03, v)`, `v / 3.0`. With c + d = 1/b, c the first 24 bits and d the next 24,
 *
 *     a / b = fma(a, c, a d)
 *
 * to the last bit for 37 of 40 b (Brisebarre, Muller and Raina, Accelerating correctly rounded floating-point
 * division when the divisor is known in advance, 2004). What is rounded at the end is wrong by 2^-46 at most, so the
 * answer is only where a / b lies that near the middle between two floats. There are some dozen such a for a b, which
 * are found by an inverse modulo a power of 2, and tried: a constant that fails is divided by. c is cut off, not
 * rounded, so that d has its sign: then zeros, infinities and NaN come out as of the division, too, and so does what is
 * too large. Only a d must not be too small to hold its bits: so a must be known to be 0 or large enough, as the sum
 * with a constant, a count, a rounding or a root is. */
#include "compiler/back/cpu/emit.h"

#include <float.h>
#include <math.h>

enum { BITS = 24, LEAST = -149 }; /* of a float: its bits; all are multiples of 2^-149 */

/* ---- how small may a value be that is not 0? */
static int lowest_bit(double v) {
    if (!isfinite(v) || v == 0) return LEAST;
    int exponent;
    const double m = frexp(fabs(v), &exponent);
    return exponent - 53 + __builtin_ctzll((uint64_t)ldexp(m, 53));
}

static int least(int a, int b) { return a < b ? a : b; }
static int most(int a, int b) { return a > b ? a : b; }

/* Of a sum with c: what hardly matters beside c leaves its half at least, and what does matter has no bits more than
 * `bits` below c's first. */
static int beside(const Inst *c, int bits) {
    return c->op == OP_constf && c->imm.f != 0 && isfinite(c->imm.f) ? ilogb(c->imm.f) - bits : LEAST;
}

/* A g such that every finite value of v is a multiple of 2^g. */
static int grid(const Inst *v, uint32_t depth) {
    enum { DEPTH = 5 };
    if (v->op == OP_constf) return v->imm.f == 0 ? 0 : most(lowest_bit(v->imm.f), LEAST);
    if (depth == DEPTH) return LEAST;
    int a[3] = {LEAST, LEAST, LEAST};
    for (uint32_t j = 0; j < v->nargs && j < 3; j++)
        if (v->args[j]->type == TY_FLT) a[j] = grid(v->args[j], depth + 1);
    const int product = most(a[0] + a[1], LEAST);
    switch ((Op)v->op) {
    case OP_fadd:
    case OP_fsub: return most(least(a[0], a[1]), most(beside(v->args[0], BITS + 1), beside(v->args[1], BITS + 1)));
    case OP_ffma: return most(least(product, a[2]), most(beside(v->args[2], 2 * BITS + 2), LEAST));
    case OP_fmul: return product;
    case OP_fmin:
    case OP_fmax: return least(a[0], a[1]);
    case OP_fsel: return least(a[1], a[2]);
    case OP_fneg:
    case OP_fabs: return a[0];
    case OP_fsqrt: return (a[0] - 1) / 2 - BITS; /* at least the root of 2^a[0] */
    case OP_ffloor:
    case OP_fceil:
    case OP_fround:
    case OP_ftrunc:
    case OP_i2f:
    case OP_u2f: return 0;
    default: return LEAST;
    }
}

/* ---- is it the quotient? */
static bool is_same(float a, float b, float c, float d) { return fmaf(a, c, a * d) == a / b; }

/* All a of 24 bits for which |a 2^k - b m| is small, m odd and of 25 bits: a / b is near the middle of two floats. */
static bool holds_near_middles(uint32_t whole, uint32_t k, float b, float c, float d) {
    enum { NEAR = 32 }; /* the bound is 8 */
    const uint32_t twos = (uint32_t)__builtin_ctz(whole);
    const uint64_t odd = whole >> twos, modulus = 1ull << (k - twos);
    uint64_t inverse = odd; /* modulo 8; each step doubles the bits */
    for (int i = 0; i < 4; i++) inverse *= 2 - odd * inverse;
    for (int64_t r = -NEAR; r <= NEAR; r++) {
        if (!r || r & ((1 << twos) - 1)) continue;
        uint64_t m = (uint64_t)(-r / (1 << twos)) * inverse & (modulus - 1);
        m += ((1ull << BITS) - m + modulus - 1) / modulus * modulus * (m < 1ull << BITS);
        for (; m < 2ull << BITS; m += modulus) {
            const uint64_t a = (whole * m + (uint64_t)r) >> k;
            if (a >> (BITS - 1) == 1 && !is_same((float)a, b, c, d)) return false;
        }
    }
    return true;
}

static bool constant_inverse(float b, float inverse[2]) {
    if (!(fabsf(b) >= 0x1p-20f && fabsf(b) <= 0x1p20f)) return false;
    int exponent;
    const uint32_t whole = (uint32_t)ldexpf(frexpf(fabsf(b), &exponent), BITS);
    float c = (float)(1 / (double)b);
    if (fabs((double)c) > fabs(1 / (double)b)) c = nextafterf(c, 0);
    const float d = (float)(fma(-(double)c, (double)b, 1) / (double)b);
    inverse[0] = c, inverse[1] = d;
    return d != 0 && holds_near_middles(whole, BITS, b, c, d) && holds_near_middles(whole, BITS + 1, b, c, d);
}

bool emit_divides_by_products(const Emit *e, const Inst *i, float inverse[2]) {
    if (i->op != OP_fdiv || i->args[1]->op != OP_constf || e->fn->precision != PREC_F32) return false;
    if (!e->opt->target.has_fma || !emit_is_vector(e, i)) return false;
    const float b = (float)i->args[1]->imm.f;
    return constant_inverse(b, inverse) && grid(i->args[0], 0) + ilogbf(inverse[1]) >= FLT_MIN_EXP - 1;
}

Part emit_quotient_by_products(Emit *e, Part a, const float inverse[2]) {
    Part x[3] = {a, emit_splat(e, LL(ConstReal)(e->t_f32, (double)inverse[0])),
                 LL(BuildFMul)(e->b, a, emit_splat(e, LL(ConstReal)(e->t_f32, (double)inverse[1])), "")};
    return emit_intrinsic(e, "llvm.fma", LL(TypeOf)(a), x, 3);
}
