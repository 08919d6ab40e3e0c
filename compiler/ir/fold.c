/* Constant folding of value rows, by the same expressions that the interpreter runs. */
#include <string.h>

#include "compiler/ir/ir.h"
#include "compiler/ir/rows.h"

typedef union Cell {
    float f32;
    double f64;
    int32_t i;
} Cell;

bool ir_fold(const Inst *i, Precision p, Imm *out) {
    const OpInfo *info = &ir_ops[i->op];
    if (info->special || info->math || i->nargs > 3) return false;
    Cell in[3], r;
    for (uint32_t a = 0; a < i->nargs; a++) {
        const Inst *v = i->args[a];
        if (!ir_is_const(v)) return false;
        if (v->op != OP_constf) in[a].i = (int32_t)v->imm.i;
        else if (p == PREC_F32) in[a].f32 = (float)v->imm.f;
        else in[a].f64 = v->imm.f;
    }
    (p == PREC_F32 ? rows_eval_f32 : rows_eval_f64)(i->op, 1, &r, &in[0], &in[1], &in[2]);
    memset(out, 0, sizeof *out);
    if (info->result != TY_FLT) out->i = r.i;
    else out->f = p == PREC_F32 ? (double)r.f32 : r.f64;
    return true;
}
