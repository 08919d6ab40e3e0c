/* Reverse mode's guards, which make a product with 0 of what may be infinite 0, cost a quarter of many a sweep, and
 * hardly a sample needs one. Without them a sum is either what it was, to the last bit, or not finite: whoever runs
 * such a kernel looks, and runs the guarded one where it is not (runtime/sample/accum.c). So nothing here may change
 * how anything is rounded, and no pass that contracts comes behind this one. */
#include "compiler/pass/walk.h"

static bool strip(Fn *fn, Block *b) {
    bool changed = false;
    for (Inst *i = b->last, *before; i; i = before) { /* a product comes before the choice that is made of it */
        before = i->prev;
        for (uint32_t r = 0; r < i->nregions; r++) changed |= strip(fn, i->region[r]);
        if (ir_is_guarded_twice(i)) walk_forward(fn, i, i->args[2]);
        else if (i->op == OP_zmul) i->op = OP_fmul;
        else if (i->op == OP_zdiv) i->op = OP_fdiv;
        else continue;
        changed = true;
    }
    return changed;
}

bool opt_bare(PassCtx *ctx, Fn *fn) {
    (void)ctx;
    const bool changed = strip(fn, fn->body);
    if (changed) walk_resolve_forwards(fn->body);
    return changed;
}
