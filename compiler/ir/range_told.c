/* Which values tell of their NaN: where one is NaN, every float that the Fn gives is. Backwards, from what the last
 * yield takes to the arguments of operations that keep a NaN, whatever the other arguments are.
 *
 * Only what surely runs counts: a use in the block of the definition or in a loop behind it, which runs once at least
 * (one with a list of iterations need not), not one in a branch. */
#include <string.h>

#include "compiler/ir/range.h"

static bool keeps_nan(Op op, uint32_t arg) {
    switch ((int)op) {
    case OP_fadd:
    case OP_fsub:
    case OP_fmul:
    case OP_fdiv:
    case OP_ffma:
    case OP_fneg:
    case OP_fabs:
    case OP_fsqrt:
    case OP_fexp:
    case OP_fexp2:
    case OP_fsin:
    case OP_fcos: return true;
    case OP_fmin:
    case OP_fmax: return arg == 0;
    default: return false;
    }
}

static void tell_block(uint8_t *told, const Block *b);

static void mark(uint8_t *told, const Inst *v, const Block *b) {
    if (v->type == TY_FLT && v->block == b) told[v->id] = 1;
}

static void clear(uint8_t *told, const Block *b) {
    for (uint32_t p = 0; p < b->nparams; p++) told[b->params[p]->id] = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        told[i->id] = 0;
        for (uint32_t r = 0; r < i->nregions; r++) clear(told, i->region[r]);
    }
}

static void tell_if(uint8_t *told, const Inst *i) {
    for (uint32_t r = 0; r < 2; r++) {
        const Block *body = i->region[r];
        for (const Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
            if (told[p->id]) mark(told, body->last->args[p->imm.i], body);
        tell_block(told, body);
    }
}

/* Values of block `of` that the body of a loop behind them uses. */
static void tell_from_within(uint8_t *told, const Block *body, const Block *of) {
    for (const Inst *i = body->first; i; i = i->next) {
        if (i->op == OP_loop && !i->imm.loop.cull) tell_from_within(told, i->region[0], of);
        for (uint32_t a = 0; a < i->nargs && told[i->id]; a++)
            if (keeps_nan((Op)i->op, a)) mark(told, i->args[a], of);
    }
}

/* What is carried tells where the result does and an iteration carries the NaN on, to itself or to another that tells:
 * the largest such set, as the loop may end behind any iteration. Results of loops tell until they are found not to. */
static void tell_loop(uint8_t *told, const Inst *i) {
    const Block *body = i->region[0];
    bool changed = true;
    while (changed) {
        clear(told, body);
        for (const Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
            if (told[p->id]) mark(told, body->last->args[p->imm.i + 1], body);
        tell_block(told, body);
        changed = false;
        for (Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
            if (told[p->id] && !told[body->params[p->imm.i + 1]->id]) told[p->id] = 0, changed = true;
    }
    for (const Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
        if (told[p->id]) mark(told, i->args[p->imm.i], i->block);
    if (!i->imm.loop.cull) tell_from_within(told, body, i->block);
}

static void tell_block(uint8_t *told, const Block *b) {
    for (const Inst *i = b->last; i; i = i->prev) {
        if (i->op == OP_if_) tell_if(told, i);
        else if (i->op == OP_loop) tell_loop(told, i);
        else if (told[i->id])
            for (uint32_t a = 0; a < i->nargs; a++)
                if (keeps_nan((Op)i->op, a)) mark(told, i->args[a], b);
    }
}

void ir_told(const Fn *fn, Arena *scratch, uint8_t *told) {
    const Inst *yield = fn->body->last;
    uint8_t *one = ARENA_ARRAY(scratch, uint8_t, fn->ninsts + 1);
    bool any = false;
    for (uint32_t o = 0; o < yield->nargs; o++) {
        if (yield->args[o]->type != TY_FLT) continue;
        memset(one, 0, fn->ninsts + 1);
        mark(one, yield->args[o], fn->body);
        tell_block(one, fn->body);
        for (uint32_t k = 0; k < fn->ninsts; k++) told[k] = one[k] & (any ? told[k] : 1);
        any = true;
    }
    if (!any) memset(told, 0, fn->ninsts);
}
