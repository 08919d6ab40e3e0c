/* The rows behind operators and builtins. */
#include "compiler/front/rows.h"

Op row_of_operator(Operator op, TypeKind k, bool *swap) {
    bool f = k == T_FLOAT, u = k == T_UINT, q = k == T_BOOL;
    *swap = op == OPR_GT || op == OPR_GE;
    switch (op) {
    case OPR_ADD: return f ? OP_fadd : OP_iadd;
    case OPR_SUB: return f ? OP_fsub : OP_isub;
    case OPR_MUL: return f ? OP_fmul : OP_imul;
    case OPR_DIV: return f ? OP_fdiv : u ? OP_udiv : OP_idiv;
    case OPR_MOD: return f ? OP_COUNT : u ? OP_urem : OP_irem;
    case OPR_AND: return q ? OP_band : OP_iand;
    case OPR_OR: return q ? OP_bor : OP_ior;
    case OPR_XOR: return q ? OP_bxor : OP_ixor;
    case OPR_SHL: return OP_ishl;
    case OPR_SHR: return u ? OP_ushr : OP_ishr;
    case OPR_EQ: return f ? OP_feq : q ? OP_COUNT : OP_ieq;
    case OPR_NE: return f ? OP_fne : q ? OP_bxor : OP_ine;
    case OPR_LT:
    case OPR_GT: return f ? OP_flt : u ? OP_ult : OP_ilt;
    case OPR_LE:
    case OPR_GE: return f ? OP_fle : u ? OP_ule : OP_ile;
    case OPR_NOT: return OP_bnot;
    case OPR_COMPL: return OP_inot;
    case OPR_NEG: return f ? OP_fneg : OP_ineg;
    case OPR_NONE:
    case OPR_LAND:
    case OPR_LOR:
    case OPR_PLUS:
    case OPR_INC:
    case OPR_DEC: break;
    }
    return OP_COUNT;
}

static const uint8_t builtin_rows[] = {
#define OP_NONE OP_COUNT
    [B_NONE] = OP_NONE,
#define BUILTIN(id, name, sig, row) [B_##id] = OP_##row,
#include "compiler/front/check/builtins.def"
#undef BUILTIN
#undef OP_NONE
};

Op row_of_builtin(Builtin f, TypeKind k) {
    if (k == T_INT || k == T_UINT) {
        if (f == B_min) return k == T_UINT ? OP_umin : OP_imin;
        if (f == B_max) return k == T_UINT ? OP_umax : OP_imax;
    }
    Op row = (Op)builtin_rows[f];
    IrType t = k == T_FLOAT ? TY_FLT : k == T_BOOL ? TY_BOOL : TY_INT;
    return row == OP_COUNT || ir_ops[row].arg != t ? OP_COUNT : row;
}
