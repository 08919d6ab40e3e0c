/* Value rows of ops.def: one part at a time, scalars and vectors alike. The lowering column drives the switch; rows
 * that say EMIT have a function here. Every operation is total: nothing a dead lane can hold traps or is undefined. */
#include "compiler/back/cpu/emit.h"

#include "compiler/ir/logs.h"
#include "compiler/ir/range.h"

#include <float.h>
#include <math.h>
#include <string.h>

typedef struct Shape {
    LLVMTypeRef f, i; /* float and int of the same shape as the operands */
} Shape;

static bool is_vector_type(Emit *e, LLVMTypeRef t) { return LL(GetTypeKind)(t) == LLVMVectorTypeKind; }

static LLVMTypeRef like(Emit *e, Part a, LLVMTypeRef scalar) {
    return is_vector_type(e, LL(TypeOf)(a)) ? LL(VectorType)(scalar, e->L) : scalar;
}

static Part kf(Emit *e, Part shape, double v) { return emit_const_like(e, LL(TypeOf)(shape), e->t_flt, v, 0, true); }
static Part ki(Emit *e, Part shape, uint32_t v) { return emit_const_like(e, LL(TypeOf)(shape), e->t_i32, 0, v, false); }
static Part sel(Emit *e, Part c, Part x, Part y) { return LL(BuildSelect)(e->b, c, x, y, ""); }
static Part fcmp(Emit *e, LLVMRealPredicate p, Part a, Part b) { return LL(BuildFCmp)(e->b, p, a, b, ""); }
static Part icmp(Emit *e, LLVMIntPredicate p, Part a, Part b) { return LL(BuildICmp)(e->b, p, a, b, ""); }

static Part intrin1(Emit *e, const char *name, Part a) { return emit_intrinsic(e, name, LL(TypeOf)(a), &a, 1); }

/* ---- rounding without roundps: adding and subtracting 2^(mantissa bits) rounds to even where |a| is below it; larger
 * values are integers. */
static Part rounded(Emit *e, Op op, Part a) {
    double big = e->fn->precision == PREC_F64 ? 4503599627370496.0 : 8388608.0;
    Part magnitude = intrin1(e, "llvm.fabs", a), one = kf(e, a, 1), r;
    Part even = LL(BuildFSub)(e->b, LL(BuildFAdd)(e->b, magnitude, kf(e, a, big), ""), kf(e, a, big), "");
    if (op == OP_ftrunc) {
        r = sel(e, fcmp(e, LLVMRealOGT, even, magnitude), LL(BuildFSub)(e->b, even, one, ""), even);
    } else {
        Part pair[2] = {even, a};
        r = emit_intrinsic(e, "llvm.copysign", LL(TypeOf)(a), pair, 2);
        if (op == OP_ffloor) r = sel(e, fcmp(e, LLVMRealOGT, r, a), LL(BuildFSub)(e->b, r, one, ""), r);
        else if (op == OP_fceil) r = sel(e, fcmp(e, LLVMRealOLT, r, a), LL(BuildFAdd)(e->b, r, one, ""), r);
    }
    Part pair[2] = {r, a};
    r = emit_intrinsic(e, "llvm.copysign", LL(TypeOf)(a), pair, 2);
    return sel(e, fcmp(e, LLVMRealOLT, magnitude, kf(e, a, big)), r, a);
}

/* fma on a target without it: libm's, lane by lane; slow and exact. */
static Part emulated_fma(Emit *e, Part *args) {
    const char *name = e->fn->precision == PREC_F64 ? "fma" : "fmaf";
    LLVMTypeRef params[3] = {e->t_flt, e->t_flt, e->t_flt}, type = LL(FunctionType)(e->t_flt, params, 3, false);
    Part f = LL(GetNamedFunction)(e->mod, name);
    if (!f) f = LL(AddFunction)(e->mod, name, type);
    LLVMTypeRef shape = LL(TypeOf)(args[0]);
    if (!is_vector_type(e, shape)) return LL(BuildCall2)(e->b, type, f, args, 3, "");
    Part v = LL(ConstNull)(shape);
    for (uint32_t l = 0; l < e->L; l++) {
        Part lane = emit_int(e, e->t_i32, l), x[3];
        for (uint32_t j = 0; j < 3; j++) x[j] = LL(BuildExtractElement)(e->b, args[j], lane, "");
        v = LL(BuildInsertElement)(e->b, v, LL(BuildCall2)(e->b, type, f, x, 3, ""), lane, "");
    }
    return v;
}

static Part intrinsic(Emit *e, Op op, const char *name, Part *args, unsigned n) {
    if (op == OP_ffma && !e->opt->target.has_fma) return emulated_fma(e, args);
    if (e->sse2_only && (op == OP_ffloor || op == OP_fceil || op == OP_ftrunc || op == OP_fround))
        return rounded(e, op, args[0]);
    return emit_intrinsic(e, name, LL(TypeOf)(args[0]), args, n);
}

/* ---- integers */
/* Quotient of 32-bit integers through double, exact: the quotient's distance from the next integer is at least 1/|b|,
 * far above half an ulp. The vector units divide doubles and not integers. The divisor is not 0; INT_MIN / -1 is the
 * caller's. */
static Part quotient(Emit *e, Part a, Part b, bool is_signed) {
    LLVMTypeRef d = like(e, a, e->t_f64), i = LL(TypeOf)(a);
    if (!is_vector_type(e, i)) return is_signed ? LL(BuildSDiv)(e->b, a, b, "") : LL(BuildUDiv)(e->b, a, b, "");
    if (is_signed) {
        Part q = LL(BuildFDiv)(e->b, LL(BuildSIToFP)(e->b, a, d, ""), LL(BuildSIToFP)(e->b, b, d, ""), "");
        return LL(BuildFPToSI)(e->b, q, i, "");
    }
    Part q = LL(BuildFDiv)(e->b, LL(BuildUIToFP)(e->b, a, d, ""), LL(BuildUIToFP)(e->b, b, d, ""), "");
    return LL(BuildFPToUI)(e->b, q, i, "");
}

static Part divided(Emit *e, Op op, Part a, Part b, const Inst *divisor) {
    bool rem = op == OP_irem || op == OP_urem, is_signed = op == OP_idiv || op == OP_irem;
    if (divisor->op == OP_consti && divisor->imm.i != 0 && divisor->imm.i != -1) { /* LLVM multiplies */
        if (rem) return is_signed ? LL(BuildSRem)(e->b, a, b, "") : LL(BuildURem)(e->b, a, b, "");
        return is_signed ? LL(BuildSDiv)(e->b, a, b, "") : LL(BuildUDiv)(e->b, a, b, "");
    }
    Part zero = ki(e, a, 0), one = ki(e, a, 1), none = icmp(e, LLVMIntEQ, b, zero);
    if (!is_signed) {
        Part safe = sel(e, none, one, b), q = quotient(e, a, safe, false);
        Part r = rem ? LL(BuildSub)(e->b, a, LL(BuildMul)(e->b, q, safe, ""), "") : q;
        return sel(e, none, zero, r);
    }
    Part minus = icmp(e, LLVMIntEQ, b, ki(e, a, UINT32_MAX));
    Part safe = sel(e, LL(BuildOr)(e->b, none, minus, ""), one, b), q = quotient(e, a, safe, true);
    if (rem) /* a - a * 1 = 0 where b is 0 or -1 */
        return LL(BuildSub)(e->b, a, LL(BuildMul)(e->b, q, safe, ""), "");
    q = sel(e, minus, LL(BuildNeg)(e->b, a, ""), q);
    return sel(e, none, zero, q);
}

static Part high_product(Emit *e, Part a, Part b) {
    LLVMTypeRef wide = like(e, a, e->t_i64);
    Part p = LL(BuildMul)(e->b, LL(BuildZExt)(e->b, a, wide, ""), LL(BuildZExt)(e->b, b, wide, ""), "");
    p = LL(BuildLShr)(e->b, p, emit_const_like(e, wide, e->t_i64, 0, 32, false), "");
    return LL(BuildTrunc)(e->b, p, LL(TypeOf)(a), "");
}

/* ---- conversions */
bool emit_converts(const Emit *e) {
    const bool wide = e->fn->precision == PREC_F64;
    const unsigned bytes = e->opt->target.vector_bytes;
    return e->W > 1 && e->L * (wide ? 8 : 4) == bytes && !(wide && bytes == 16);
}

Part emit_converted(Emit *e, Part a, Part keep, bool is_signed) {
    const bool wide = e->fn->precision == PREC_F64;
    const unsigned bytes = e->opt->target.vector_bytes;
    LLVMTypeRef i = like(e, a, e->t_i32);
    if (!is_vector_type(e, i) || !emit_converts(e) || (!is_signed && bytes < 64)) return NULL;
    if (bytes == 64) {
        const char *name =
            wide        ? is_signed ? "llvm.x86.avx512.mask.cvttpd2dq.512" : "llvm.x86.avx512.mask.cvttpd2udq.512"
            : is_signed ? "llvm.x86.avx512.mask.cvttps2dq.512"
                        : "llvm.x86.avx512.mask.cvttps2udq.512";
        LLVMTypeRef mask = LL(IntTypeInContext)(e->ctx, e->L);
        Part bits = keep ? LL(BuildBitCast)(e->b, keep, mask, "") : LL(ConstAllOnes)(mask);
        Part x[4] = {a, LL(ConstNull)(i), bits, emit_int(e, e->t_i32, 4 /* rounding as set */)};
        return emit_intrinsic(e, name, NULL, x, 4);
    }
    const char *name = bytes == 16 ? "llvm.x86.sse2.cvttps2dq"
                       : wide      ? "llvm.x86.avx.cvtt.pd2dq.256"
                                   : "llvm.x86.avx.cvtt.ps2dq.256";
    Part r = emit_intrinsic(e, name, NULL, &a, 1);
    return keep ? sel(e, keep, r, LL(ConstNull)(i)) : r;
}

static Part float_to_int(Emit *e, Part a, bool is_signed, bool nan_too /* gives any integer */) {
    LLVMTypeRef i = like(e, a, e->t_i32);
    Part keep = !is_signed ? fcmp(e, LLVMRealOGE, a, kf(e, a, 0)) : nan_too ? NULL : fcmp(e, LLVMRealORD, a, a);
    Part fast = emit_converted(e, a, keep, is_signed);
    if (fast && !is_signed) return fast;
    if (fast) { /* 2^31 - 1 where 2^31 does not fit: one less */
        const Part above = fcmp(e, LLVMRealOGE, a, kf(e, a, 2147483648.0)), less = ki(e, fast, UINT32_MAX);
        if (e->opt->target.vector_bytes < 64) return LL(BuildAdd)(e->b, fast, LL(BuildSExt)(e->b, above, i, ""), "");
        return sel(e, above, LL(BuildAdd)(e->b, fast, less, ""), fast); /* an addition under a mask */
    }
    Part top = kf(e, a, is_signed ? 2147483648.0 : 4294967296.0), bottom = kf(e, a, is_signed ? -2147483648.0 : 0);
    Part low = fcmp(e, LLVMRealOGE, a, bottom), high = fcmp(e, LLVMRealOLT, a, top);
    Part safe = sel(e, LL(BuildAnd)(e->b, low, high, ""), a, kf(e, a, 0));
    Part r = is_signed ? LL(BuildFPToSI)(e->b, safe, i, "") : LL(BuildFPToUI)(e->b, safe, i, "");
    Part above = emit_const_like(e, i, e->t_i32, 0, is_signed ? INT32_MAX : UINT32_MAX, false);
    r = sel(e, fcmp(e, LLVMRealOGE, a, top), above, r);
    if (is_signed)
        r = sel(e, fcmp(e, LLVMRealOLT, a, bottom), emit_const_like(e, i, e->t_i32, 0, (uint32_t)INT32_MIN, false), r);
    return r;
}

/* The bits of a float as an integer of its own width, and back. */
static LLVMTypeRef bits_scalar(Emit *e) { return e->fn->precision == PREC_F64 ? e->t_i64 : e->t_i32; }
static Part to_bits(Emit *e, Part a) { return LL(BuildBitCast)(e->b, a, like(e, a, bits_scalar(e)), ""); }
static Part from_bits(Emit *e, Part a) { return LL(BuildBitCast)(e->b, a, like(e, a, e->t_flt), ""); }
static Part kb(Emit *e, Part shape, uint64_t v) {
    return emit_const_like(e, LL(TypeOf)(shape), bits_scalar(e), 0, v, false);
}

static Part mantissa(Emit *e, Part a) {
    bool wide = e->fn->precision == PREC_F64;
    Part bits = LL(BuildAnd)(e->b, to_bits(e, a), kb(e, to_bits(e, a), wide ? 0x800fffffffffffffull : 0x807fffffu), "");
    return from_bits(e, LL(BuildOr)(e->b, bits, kb(e, bits, wide ? 0x3ff0000000000000ull : 0x3f800000u), ""));
}

static Part exponent(Emit *e, Part a) {
    bool wide = e->fn->precision == PREC_F64;
    Part bits = to_bits(e, a);
    bits = LL(BuildLShr)(e->b, bits, kb(e, bits, wide ? 52 : 23), "");
    bits = LL(BuildAnd)(e->b, bits, kb(e, bits, wide ? 2047 : 255), "");
    if (wide) bits = LL(BuildTrunc)(e->b, bits, like(e, a, e->t_i32), "");
    return LL(BuildSub)(e->b, bits, ki(e, bits, wide ? 1023 : 127), "");
}

static Part two_to(Emit *e, Part a) {
    bool wide = e->fn->precision == PREC_F64;
    Part biased = LL(BuildAdd)(e->b, a, ki(e, a, wide ? 1023 : 127), "");
    if (wide) biased = LL(BuildZExt)(e->b, biased, like(e, a, e->t_i64), "");
    return from_bits(e, LL(BuildShl)(e->b, biased, kb(e, biased, wide ? 52 : 23), ""));
}

/* ---- parts of logarithms (ir/logs.h) */
static Part fused(Emit *e, Part a, Part b, Part c) {
    Part x[3] = {a, b, c};
    return intrinsic(e, OP_ffma, "llvm.fma", x, 3);
}

/* Element `at` of a table of n, 8 or 16, by its low bits alone. */
static Part from_table(Emit *e, Part at, const double *table, uint32_t n) {
    if (e->fn->precision == PREC_F32 && is_vector_type(e, LL(TypeOf)(at)) && e->L == n &&
        e->opt->target.vector_bytes >= 32) {
        Part lanes[16];
        for (uint32_t l = 0; l < n; l++) lanes[l] = LL(ConstReal)(e->t_flt, table[l]);
        Part x[2] = {LL(ConstVector)(lanes, n), at};
        return emit_intrinsic(e, n == 16 ? "llvm.x86.avx512.permvar.sf.512" : "llvm.x86.avx2.permps", NULL, x, 2);
    }
    at = LL(BuildAnd)(e->b, at, kb(e, at, n - 1), "");
    Part r = kf(e, at, table[0]);
    for (uint32_t k = 1; k < n; k++) r = sel(e, icmp(e, LLVMIntEQ, at, kb(e, at, k)), kf(e, at, table[k]), r);
    return r;
}

/* By the processor's own exponents and mantissas, which are right where x is 0, infinite or subnormal, and a NaN below
 * 0 if asked to be. */
static Part log_part_512(Emit *e, Op op, Part a, bool negative) {
    LLVMTypeRef t = LL(TypeOf)(a), i = like(e, a, e->t_i32);
    Part all = LL(ConstAllOnes)(LL(IntTypeInContext)(e->ctx, e->L)), as_set = emit_int(e, e->t_i32, 4);
    Part in_binade = emit_int(e, e->t_i32, negative && op == OP_flogm ? 12 : 4 /* of |x| */);
    Part to_mantissa[5] = {a, in_binade, LL(ConstNull)(t), all, as_set};
    Part m = emit_intrinsic(e, "llvm.x86.avx512.mask.getmant.ps.512", NULL, to_mantissa, 5);
    Part at = LL(BuildAdd)(e->b, LL(BuildBitCast)(e->b, m, i, ""), ki(e, m, LOG_OFFSET), "");
    at = LL(BuildLShr)(e->b, at, ki(e, at, 20), ""); /* its low four bits are 8 + k, 0 where k is 8 */
    const double *table = op == OP_flogm ? log_inverse : op == OP_flogh ? log_table_high : log_table_low;
    double turned[16] = {table[8]};
    for (uint32_t k = 0; k < 8; k++) turned[8 + k] = table[k];
    Part v = from_table(e, at, turned, 16);
    if (op == OP_flogm) return fused(e, m, v, kf(e, m, -1));
    Part to_exponent[4] = {a, LL(ConstNull)(t), all, as_set};
    Part n = emit_intrinsic(e, "llvm.x86.avx512.mask.getexp.ps.512", NULL, to_exponent, 4);
    return fused(e, n, kf(e, n, op == OP_flogh ? log_ln2_high : log_ln2_low), v);
}

/* Elsewhere bits are taken apart: what carries into the exponent when LOG_OFFSET is added is k = 8, which is k = 0 of
 * the next exponent: the same sums. Exponents stay where they are in the bits, and constants are so much smaller. */
static Part log_part(Emit *e, const Inst *i, Part a) {
    const bool wide = e->fn->precision == PREC_F64, negative = !ir_is_never_negative(i->args[0]);
    if (e->opt->target.vector_bytes >= 64 && !wide && is_vector_type(e, LL(TypeOf)(a)) && e->L == 16)
        return log_part_512(e, i->op, a, negative);
    const int fraction = wide ? 52 : 23, up = wide ? 54 : 24;
    const uint64_t one = wide ? 0x3ff0000000000000ull : 0x3f800000u;
    const uint64_t exponents = wide ? 0x7ff0000000000000ull : 0x7f800000u;
    Part size = intrin1(e, "llvm.fabs", a);
    Part tiny = fcmp(e, LLVMRealOLT, size, kf(e, a, wide ? DBL_MIN : (double)FLT_MIN));
    Part normal = sel(e, tiny, LL(BuildFMul)(e->b, size, kf(e, a, ldexp(1, up)), ""), size), bits = to_bits(e, normal);
    Part moved = LL(BuildAdd)(e->b, bits, kb(e, bits, (uint64_t)LOG_OFFSET << (fraction - 23)), "");
    Part at = LL(BuildLShr)(e->b, moved, kb(e, bits, (uint64_t)fraction - 3), "");
    Part n = LL(BuildAnd)(e->b, moved, kb(e, bits, exponents), "");
    n = LL(BuildSub)(e->b, n, kb(e, bits, one), "");
    if (i->op == OP_flogm) {
        Part m = from_bits(e, LL(BuildSub)(e->b, bits, n, ""));
        m = fused(e, m, from_table(e, at, log_inverse, 8), kf(e, a, -1));
        if (!negative) return m; /* of NaN the other parts are NaN */
        return sel(e, fcmp(e, LLVMRealOGE, a, kf(e, a, 0)), m, kf(e, a, (double)NAN));
    }
    n = LL(BuildSub)(e->b, n, sel(e, tiny, kb(e, bits, (uint64_t)up << fraction), kb(e, bits, 0)), "");
    if (wide) { /* the upper halves */
        n = LL(BuildLShr)(e->b, n, kb(e, bits, 32), "");
        n = LL(BuildTrunc)(e->b, n, like(e, a, e->t_i32), "");
    }
    n = LL(BuildSIToFP)(e->b, n, like(e, a, e->t_flt), "");
    n = sel(e, fcmp(e, LLVMRealOLT, size, kf(e, a, (double)INFINITY)), n, size);
    n = sel(e, fcmp(e, LLVMRealOEQ, size, kf(e, a, 0)), kf(e, a, (double)-INFINITY), n);
    const double unit = i->op == OP_flogh ? log_ln2_high : log_ln2_low;
    return fused(e, n, kf(e, a, unit * (wide ? 0x1p-20 : 0x1p-23)),
                 from_table(e, at, i->op == OP_flogh ? log_table_high : log_table_low, 8));
}

/* v, or 0 where a is. With masks the condition says where it is not: then what makes v clears the other lanes itself,
 * and LLVM turns no condition round that is asked for more than once. */
static bool has_masks(const Emit *e) { return e->opt->target.vector_bytes >= 64; }
static Part is_nonzero(Emit *e, Part a) { return fcmp(e, LLVMRealUNE, a, kf(e, a, 0)); }
static Part unless_zero(Emit *e, Part a, Part v) {
    if (has_masks(e)) return sel(e, is_nonzero(e, a), v, kf(e, a, 0));
    return sel(e, fcmp(e, LLVMRealOEQ, a, kf(e, a, 0)), kf(e, a, 0), v);
}

static Part product_guarded_twice(Emit *e, Part x, Part g) {
    Part both = LL(BuildAnd)(e->b, is_nonzero(e, x), is_nonzero(e, g), "");
    return sel(e, both, LL(BuildFMul)(e->b, x, g, ""), kf(e, x, 0));
}

static Part emit_row(Emit *e, const Inst *i, Part *x) {
    Part a = x[0], b = x[1];
    switch ((Op)i->op) {
    case OP_zmul: return unless_zero(e, a, LL(BuildFMul)(e->b, a, b, ""));
    case OP_zdiv: return unless_zero(e, a, LL(BuildFDiv)(e->b, a, b, ""));
    case OP_fmin: return sel(e, fcmp(e, LLVMRealOLT, b, a), b, a);
    case OP_fmax: return sel(e, fcmp(e, LLVMRealOLT, a, b), b, a);
    case OP_idiv:
    case OP_irem:
    case OP_udiv:
    case OP_urem: return divided(e, i->op, a, b, i->args[1]);
    case OP_umulh: return high_product(e, a, b);
    case OP_ishl: return LL(BuildShl)(e->b, a, LL(BuildAnd)(e->b, b, ki(e, b, 31), ""), "");
    case OP_ishr: return LL(BuildAShr)(e->b, a, LL(BuildAnd)(e->b, b, ki(e, b, 31), ""), "");
    case OP_ushr: return LL(BuildLShr)(e->b, a, LL(BuildAnd)(e->b, b, ki(e, b, 31), ""), "");
    case OP_i2f: return LL(BuildSIToFP)(e->b, a, like(e, a, e->t_flt), "");
    case OP_u2f: return LL(BuildUIToFP)(e->b, a, like(e, a, e->t_flt), "");
    case OP_f2i:
    case OP_f2u: return float_to_int(e, a, i->op == OP_f2i, e->hidden && e->hidden[i->id]);
    case OP_fasuint:
        if (e->fn->precision == PREC_F64) a = LL(BuildFPTrunc)(e->b, a, like(e, a, e->t_f32), "");
        return LL(BuildBitCast)(e->b, a, like(e, a, e->t_i32), "");
    case OP_iasfloat:
        a = LL(BuildBitCast)(e->b, a, like(e, a, e->t_f32), "");
        return e->fn->precision == PREC_F64 ? LL(BuildFPExt)(e->b, a, like(e, a, e->t_f64), "") : a;
    case OP_fmant: return mantissa(e, a);
    case OP_flogm:
    case OP_flogh:
    case OP_flogl: return log_part(e, i, a);
    case OP_fexpo: return exponent(e, a);
    case OP_ftwoi: return two_to(e, a);
    case OP_fisnan: return fcmp(e, LLVMRealUNO, a, a);
    case OP_fisinf: return fcmp(e, LLVMRealOEQ, intrin1(e, "llvm.fabs", a), kf(e, a, (double)INFINITY));
    default: emit_fail(e, "%s was not lowered", ir_ops[i->op].name); return LL(ConstNull)(emit_scalar_type(e, i->type));
    }
}

/* One part of a value row, by the table's lowering column. */
static Part value_part(Emit *e, const Inst *i, Part *x) {
    if (e->by_steps && e->by_steps[i->id]) return emit_root_by_steps(e, x[0]);
    float inverse[2];
    if (emit_divides_by_products(e, i, inverse)) return emit_quotient_by_products(e, x[0], inverse);
    switch ((Op)i->op) {
#define U_BIN(name) LL(Build##name)(e->b, x[0], "")
#define B_BIN(name) LL(Build##name)(e->b, x[0], x[1], "")
#define U_INTRIN(name) intrinsic(e, i->op, name, x, 1)
#define B_INTRIN(name) intrinsic(e, i->op, name, x, 2)
#define T_INTRIN(name) intrinsic(e, i->op, name, x, 3)
#define U_EMIT emit_row(e, i, x)
#define B_EMIT emit_row(e, i, x)
#define U_MATH emit_row(e, i, x)
#define B_MATH emit_row(e, i, x)
#define B_FCMP(p) fcmp(e, LLVMReal##p, x[0], x[1])
#define B_ICMP(p) icmp(e, LLVMInt##p, x[0], x[1])
#define FOP1(name, value, partials, bounds, events, range, cost, domain, lowering, ...)                                     \
    case OP_##name:                                                                                                    \
        return U_##lowering;
#define FOP2(name, value, partials, bounds, events, range, cost, domain, lowering, ...)                                     \
    case OP_##name:                                                                                                    \
        return B_##lowering;
#define FOP3(name, value, partials, bounds, events, range, cost, domain, lowering, ...)                                     \
    case OP_##name:                                                                                                    \
        return T_##lowering;
#define FCMP2(name, value, bounds, lowering)                                                                                   \
    case OP_##name:                                                                                                    \
        return B_##lowering;
#define FSEL(name, ...)                                                                                              \
    case OP_##name:                                                                                                    \
        return sel(e, x[0], x[1], x[2]);
#define IOP1(name, value, bounds, range, cost, lowering)                                                                                    \
    case OP_##name:                                                                                                    \
        return U_##lowering;
#define IOP2(name, value, bounds, range, cost, lowering)                                                                                    \
    case OP_##name:                                                                                                    \
        return B_##lowering;
#define ICMP2(name, value, bounds, lowering)                                                                                   \
    case OP_##name:                                                                                                    \
        return B_##lowering;
#define BOP1(name, value, bounds, lowering)                                                                                    \
    case OP_##name:                                                                                                    \
        return U_##lowering;
#define BOP2(name, value, bounds, lowering)                                                                                    \
    case OP_##name:                                                                                                    \
        return B_##lowering;
#define CONV(name, result, argument, value, bounds, events, range, cost, lowering)                                                                  \
    case OP_##name:                                                                                                    \
        return U_##lowering;
#define SPECIAL(name, ...) case OP_##name:
#include "compiler/ir/ops.def"
#include "compiler/ir/ops_undef.h"
    case OP_COUNT: break;
    }
    emit_fail(e, "%s is not a value", ir_ops[i->op].name);
    return LL(ConstNull)(e->t_i32);
}

void emit_value_op(Emit *e, Inst *i) {
    if (emit_is_vector(e, i)) {
        emit_value_run(e, &i, 1);
        return;
    }
    Part x[3] = {NULL, NULL, NULL};
    for (uint32_t j = 0; j < i->nargs; j++) x[j] = emit_scalar(e, i->args[j]);
    emit_slot(e, i)[0] = value_part(e, i, x);
}

static Part part_of(Emit *e, const Inst *i, uint32_t p) {
    return emit_is_vector(e, i) ? emit_slot(e, i)[p] : emit_splat(e, emit_scalar(e, i));
}

void emit_run_part(Emit *e, const EmitRun *run, uint32_t k, uint32_t p) {
    const Inst *i = run->at[k], *first = run->first[k];
    Part x[3] = {NULL, NULL, NULL};
    if (has_masks(e) && ir_is_guarded_twice(i)) {
        const Inst *product = i->args[2];
        emit_slot(e, i)[p] = product_guarded_twice(e, part_of(e, product->args[0], p), part_of(e, product->args[1], p));
        return;
    }
    for (uint32_t j = 0; j < i->nargs; j++)
        x[j] = run->same[k][j] ? run->same[k][j] : emit_slot(e, j == 0 && first ? first : i->args[j])[p];
    emit_slot(e, i)[p] = value_part(e, i, x);
}

/* One part after the other: what is between lives in few registers, whatever the width. */
void emit_value_run(Emit *e, Inst *const *at, uint32_t n) {
    EmitRun run = {.at = at, .n = n};
    run.same = arena_alloc(e->arena, (n + 1) * sizeof *run.same);
    run.first = arena_alloc(e->arena, (n + 1) * sizeof *run.first);
    for (uint32_t k = 0; k < n; k++) {
        Part bound;
        run.first[k] = emit_compared_root(e, at[k], &bound);
        if (run.first[k]) {
            run.same[k][0] = NULL, run.same[k][1] = emit_splat(e, bound); /* nothing reads the root: LLVM drops it */
            continue;
        }
        for (uint32_t j = 0; j < at[k]->nargs; j++) {
            const Inst *x = at[k]->args[j];
            bool picks = ir_ops[at[k]->op].selects && j == 0; /* a uniform condition selects whole vectors */
            if (emit_is_vector(e, x)) run.same[k][j] = NULL;
            else run.same[k][j] = picks ? emit_scalar(e, x) : emit_splat(e, emit_scalar(e, x));
        }
    }
    if (emit_lookup(e, &run)) return;
    for (uint32_t p = 0; p < e->P; p++)
        for (uint32_t k = 0; k < n; k++) emit_run_part(e, &run, k, p);
}
