/* What a Builder with fold set does instead of emitting a row. */
#include <math.h>

#include "compiler/ir/ir.h"

static bool is_f(const Inst *i, double v) { return i->op == OP_constf && i->imm.f == v; } /* 0 matches -0 */
static bool is_negzero(const Inst *i) { return is_f(i, 0) && signbit(i->imm.f); }
static bool is_i(const Inst *i, int32_t v) { return i->op == OP_consti && (int32_t)i->imm.i == v; }
static bool is_b(const Inst *i, bool v) { return i->op == OP_constb && (i->imm.i != 0) == v; }
static bool is_finite(const Inst *i) { return i->op == OP_constf && isfinite(i->imm.f); }

static Inst *constants(Builder *b, Op op, Inst *const *args) {
    uint32_t n = ir_ops[op].nargs;
    for (uint32_t a = 0; a < n; a++)
        if (!ir_is_const(args[a])) return NULL;
    Inst *copy[3] = {0};
    for (uint32_t a = 0; a < n; a++) copy[a] = args[a];
    Inst row = {.op = (uint8_t)op, .type = ir_ops[op].result, .nargs = n, .args = copy};
    Imm v;
    if (!ir_fold(&row, b->fn->precision, &v)) return NULL;
    switch (ir_ops[op].result) {
    case TY_FLT: return ir_constf(b, v.f);
    case TY_INT: return ir_consti(b, (int32_t)v.i);
    default: return ir_constb(b, v.i != 0);
    }
}

static Inst *floats(Builder *b, Op op, Inst *x, Inst *y, Inst *z) {
    switch (op) {
    case OP_fadd: return is_f(y, 0) ? x : is_f(x, 0) ? y : NULL;
    case OP_fsub: return is_f(y, 0) ? x : is_f(x, 0) ? ir_emit1(b, OP_fneg, y) : NULL;
    case OP_fmul:
        if (is_f(x, 1)) return y;
        if (is_f(y, 1)) return x;
        return is_f(x, -1) ? ir_emit1(b, OP_fneg, y) : is_f(y, -1) ? ir_emit1(b, OP_fneg, x) : NULL;
    case OP_fdiv: return is_f(y, 1) ? x : is_f(y, -1) ? ir_emit1(b, OP_fneg, x) : NULL;
    case OP_fneg: return x->op == OP_fneg ? x->args[0] : NULL;
    case OP_fabs: return x->op == OP_fabs ? x : x->op == OP_fneg ? ir_emit1(b, OP_fabs, x->args[0]) : NULL;
    case OP_ffma:
        if (is_f(x, 1)) return ir_emit2(b, OP_fadd, y, z);
        if (is_f(y, 1)) return ir_emit2(b, OP_fadd, x, z);
        return is_negzero(z) || is_f(z, 0) ? ir_emit2(b, OP_fmul, x, y) : NULL;
    case OP_zmul: /* 0 where x is 0: a finite constant on either side needs no test */
        if (is_f(x, 0) || is_f(y, 0)) return ir_constf(b, 0);
        return x->op == OP_constf || is_finite(y) ? ir_emit2(b, OP_fmul, x, y) : NULL;
    case OP_zdiv:
        if (is_f(x, 0)) return ir_constf(b, 0);
        if (x->op == OP_constf) return ir_emit2(b, OP_fdiv, x, y);
        return y->op == OP_constf && y->imm.f != 0 && !isnan(y->imm.f) ? ir_emit2(b, OP_fdiv, x, y) : NULL;
    case OP_fmin:
    case OP_fmax: return x == y ? x : NULL;
    default: return NULL;
    }
}

static Inst *selects(Builder *b, Op op, Inst *cond, Inst *x, Inst *y) {
    if (cond->op == OP_constb) return cond->imm.i ? x : y;
    if (x == y) return x;
    if (cond->op == OP_bnot) return ir_emit3(b, op, cond->args[0], y, x);
    /* the same question once more */
    if (y->op == op && y->args[0] == cond) {
        Inst *yes = y->args[1];
        bool same = yes == x || (yes->op == x->op && yes->op == OP_consti && yes->imm.i == x->imm.i);
        return same ? y : ir_emit3(b, op, cond, x, y->args[2]);
    }
    if (x->op == op && x->args[0] == cond) return ir_emit3(b, op, cond, x->args[1], y);
    if (op == OP_bsel) {
        if (is_b(x, true)) return ir_emit2(b, OP_bor, cond, y);
        if (is_b(y, false)) return ir_emit2(b, OP_band, cond, x);
        if (is_b(x, false) && is_b(y, true)) return ir_emit1(b, OP_bnot, cond);
        return NULL;
    }
    if (!ir_is_const(x) || !ir_is_const(y)) return NULL;
    if (op == OP_isel) return x->imm.i == y->imm.i ? x : NULL;
    return x->imm.f == y->imm.f && signbit(x->imm.f) == signbit(y->imm.f) ? x : NULL;
}

static Inst *integers(Builder *b, Op op, Inst *x, Inst *y) {
    switch (op) {
    case OP_iadd:
    case OP_ior:
    case OP_ixor:
        if (is_i(y, 0)) return x;
        if (is_i(x, 0)) return y;
        return x != y || op == OP_iadd ? NULL : op == OP_ior ? x : ir_consti(b, 0);
    case OP_isub: return is_i(y, 0) ? x : x == y ? ir_consti(b, 0) : NULL;
    case OP_ishl:
    case OP_ishr:
    case OP_ushr: return is_i(y, 0) || is_i(x, 0) ? x : NULL;
    case OP_imul:
        if (is_i(x, 1) || is_i(y, 0)) return y;
        return is_i(y, 1) || is_i(x, 0) ? x : NULL;
    case OP_idiv:
    case OP_udiv: return is_i(y, 1) ? x : NULL;
    case OP_iand:
        if (is_i(x, -1) || is_i(y, 0) || x == y) return y;
        return is_i(y, -1) || is_i(x, 0) ? x : NULL;
    case OP_imin:
    case OP_imax:
    case OP_umin:
    case OP_umax: return x == y ? x : NULL;
    case OP_ineg:
    case OP_inot: return x->op == op ? x->args[0] : NULL;
    case OP_ieq:
    case OP_ile:
    case OP_ule: return x == y ? ir_constb(b, true) : NULL;
    case OP_ine:
    case OP_ilt:
    case OP_ult: return x == y ? ir_constb(b, false) : NULL;
    default: return NULL;
    }
}

static Inst *bools(Builder *b, Op op, Inst *x, Inst *y) {
    switch (op) {
    case OP_band:
        if (is_b(x, true) || is_b(y, false) || x == y) return y;
        return is_b(y, true) || is_b(x, false) ? x : NULL;
    case OP_bor:
        if (is_b(x, false) || is_b(y, true) || x == y) return y;
        return is_b(y, false) || is_b(x, true) ? x : NULL;
    case OP_bxor:
        if (is_b(y, false)) return x;
        if (is_b(x, false)) return y;
        if (is_b(y, true)) return ir_emit1(b, OP_bnot, x);
        if (is_b(x, true)) return ir_emit1(b, OP_bnot, y);
        return x == y ? ir_constb(b, false) : NULL;
    case OP_bnot: return x->op == OP_bnot ? x->args[0] : NULL;
    default: return NULL;
    }
}

Inst *ir_simplify(Builder *b, Op op, Inst *const *args) {
    Inst *same = constants(b, op, args);
    if (same) return same;
    uint32_t n = ir_ops[op].nargs;
    Inst *x = args[0], *y = n > 1 ? args[1] : NULL, *z = n > 2 ? args[2] : NULL;
    if (ir_ops[op].selects) return selects(b, op, x, y, z);
    switch (ir_ops[op].arg) {
    case TY_FLT: return floats(b, op, x, y, z);
    case TY_INT: return integers(b, op, x, y);
    case TY_BOOL: return bools(b, op, x, y);
    default: return NULL;
    }
}
