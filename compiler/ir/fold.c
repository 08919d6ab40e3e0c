/* Value rows of constants, by the same expressions that the interpreter runs. */
#include <string.h>

#include "compiler/ir/ir.h"
#include "compiler/ir/rows.h"

typedef union Cell {
    float f32;
    double f64;
    int32_t i;
} Cell;

Imm ir_row(Op op, Precision p, const Imm args[3]) {
    const OpInfo *info = &ir_ops[op];
    Cell in[3], r;
    for (uint32_t a = 0; a < info->nargs; a++)
        if (info->arg != TY_FLT || (info->selects && a == 0)) in[a].i = (int32_t)args[a].i;
        else if (p == PREC_F32) in[a].f32 = (float)args[a].f;
        else in[a].f64 = args[a].f;
    (p == PREC_F32 ? rows_eval_f32 : rows_eval_f64)((uint8_t)op, 1, &r, &in[0], &in[1], &in[2]);
    Imm out;
    memset(&out, 0, sizeof out);
    if (info->result != TY_FLT) out.i = r.i;
    else out.f = p == PREC_F32 ? (double)r.f32 : r.f64;
    return out;
}

bool ir_fold(const Inst *i, Precision p, Imm *out) {
    const OpInfo *info = &ir_ops[i->op];
    if (info->special || info->math) return false;
    Imm args[3];
    for (uint32_t a = 0; a < i->nargs; a++) {
        if (!ir_is_const(i->args[a])) return false;
        args[a] = i->args[a]->imm;
    }
    *out = ir_row((Op)i->op, p, args);
    return true;
}
