/* Counters: a carried integer i with i' = i + step, step invariant, becomes init + k*step. The loop's own k is the same
 * in all lanes, so counters stay uniform even where lanes leave the loop at different times. */
#include "compiler/pass/walk.h"

static bool defined_outside(const Inst *v, const Block *body) { return !walk_inside(v->block, body); }

static bool induction_loop(Fn *fn, Inst *loop) {
    Block *body = loop->region[0];
    bool changed = false;
    for (uint32_t c = 0; c < loop->nargs; c++) {
        Inst *p = body->params[c + 1], *next = body->last->args[c + 1];
        if (p->type != TY_INT || (next->op != OP_iadd && next->op != OP_isub) || next->args[0] != p) continue;
        Inst *step = next->args[1];
        if (step == p || !(ir_is_const(step) || defined_outside(step, body))) continue;
        Builder b = body->first ? ir_before(fn, body->first) : ir_at_end(fn, body);
        b.fold = true;
        if (ir_is_const(step) && !defined_outside(step, body)) step = ir_consti(&b, (int32_t)step->imm.i);
        Inst *scaled = ir_is_const(step) && (int32_t)step->imm.i == 1 ? body->params[0]
                                                                      : ir_emit2(&b, OP_imul, body->params[0], step);
        bool from_zero = loop->args[c]->op == OP_consti && (int32_t)loop->args[c]->imm.i == 0;
        Inst *value = next->op == OP_iadd && from_zero ? scaled : ir_emit2(&b, (Op)next->op, loop->args[c], scaled);
        walk_replace(body, p, value);
        changed = true;
    }
    return changed;
}

static bool induction_block(Fn *fn, Block *b) {
    bool changed = false;
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) changed |= induction_block(fn, i->region[r]);
        if (i->op == OP_loop) changed |= induction_loop(fn, i);
    }
    return changed;
}

bool opt_induction(PassCtx *ctx, Fn *fn) {
    (void)ctx;
    return induction_block(fn, fn->body);
}
