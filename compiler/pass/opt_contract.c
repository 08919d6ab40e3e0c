/* a*b + c becomes ffma where the product has no other use. Like opt_powers the pass changes floats, so it
 * runs once, on the primal, before any variant is cut: every kernel and the interpreter round alike. */
#include "compiler/pass/walk.h"

static void count_uses(Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = 0; a < i->nargs; a++) i->args[a]->tag++;
        for (uint32_t r = 0; r < i->nregions; r++) count_uses(i->region[r]);
    }
}
static void clear_uses(Block *b) {
    for (uint32_t p = 0; p < b->nparams; p++) b->params[p]->tag = 0;
    for (Inst *i = b->first; i; i = i->next) {
        i->tag = 0;
        for (uint32_t r = 0; r < i->nregions; r++) clear_uses(i->region[r]);
    }
}

static bool product(const Inst *i, const Block *b) { return i->op == OP_fmul && i->tag == 1 && i->block == b; }

static bool contract_block(Fn *fn, Block *b) {
    bool changed = false;
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) changed |= contract_block(fn, i->region[r]);
        if (i->op != OP_fadd && i->op != OP_fsub) continue;
        Inst *x = i->args[0], *y = i->args[1], *args[3];
        Builder at = ir_before(fn, i);
        at.span = i->span;
        if (product(x, b)) {
            args[0] = x->args[0], args[1] = x->args[1];
            args[2] = i->op == OP_fadd ? y : ir_emit1(&at, OP_fneg, y);
        } else if (product(y, b)) {
            args[0] = i->op == OP_fadd ? y->args[0] : ir_emit1(&at, OP_fneg, y->args[0]);
            args[1] = y->args[1];
            args[2] = x;
        } else {
            continue;
        }
        i->op = OP_ffma;
        i->nargs = 3;
        i->args = arena_copy(fn->arena, args, sizeof args);
        changed = true;
    }
    return changed;
}

bool opt_contract(PassCtx *ctx, Fn *fn) {
    if (!ctx->has_fma) return false;
    clear_uses(fn->body);
    count_uses(fn->body);
    return contract_block(fn, fn->body);
}
