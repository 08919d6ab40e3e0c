/* Loop invariants move in front of their loop: every pure instruction whose operands are defined outside it. From under
 * an if_ only cheap ones move (a region that is rarely taken must not make everybody pay for its elementary functions).
 * Loops run at least once, and no operation traps. */
#include "compiler/pass/walk.h"

/* Divisions of integers count as cheap: mostly by constants, which are products. So do guarded quotients, which are
 * derivatives of what was worth its branch already. */
static bool cheap(const Inst *i) {
    const OpInfo *o = &ir_ops[i->op];
    return o->cost < IR_COST_DIVISION || o->arg == TY_INT || i->op == OP_zdiv;
}

static bool invariant(const Inst *i, const Block *body) {
    for (uint32_t a = 0; a < i->nargs; a++)
        if (walk_inside(i->args[a]->block, body)) return false;
    return true;
}

static bool hoist(Block *b, Inst *loop, bool conditional) {
    bool changed = false;
    const Block *body = loop->region[0];
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        if (i->op == OP_loop || i->op == OP_revloop) continue; /* the inner loop's invariants came out already */
        for (uint32_t r = 0; r < i->nregions; r++) changed |= hoist(i->region[r], loop, conditional || i->op == OP_if_);
        if (i->nregions || !walk_is_pure(i) || i->op == OP_site || i->op == OP_siten) continue;
        if ((conditional && !cheap(i)) || !invariant(i, body)) continue;
        ir_unlink(i);
        i->block = loop->block;
        i->next = loop;
        i->prev = loop->prev;
        if (loop->prev) loop->prev->next = i;
        else loop->block->first = i;
        loop->prev = i;
        changed = true;
    }
    return changed;
}

static bool licm_block(Block *b) {
    bool changed = false;
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) changed |= licm_block(i->region[r]);
        if (i->op == OP_loop) changed |= hoist(i->region[0], i, false);
    }
    return changed;
}

bool opt_licm(PassCtx *ctx, Fn *fn) {
    (void)ctx;
    return licm_block(fn->body);
}
