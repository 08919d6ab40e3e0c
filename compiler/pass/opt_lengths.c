/* `length` is v == 0 ? 0 : sqrt(v), whose derivative at 0 is 0; once derivatives are made, sqrt(v) alone has the same
 * bits, unless v is -0, whose root is -0. A sum of squares never is: what cancels, or underflows, gives +0. */
#include <math.h>

#include "compiler/pass/walk.h"

static bool is_zero(const Inst *i) { return i->op == OP_constf && i->imm.f == 0; }
static bool is_plus_zero(const Inst *i) { return is_zero(i) && !signbit(i->imm.f); }

static bool never_minus_zero(const Inst *v, uint32_t depth) {
    if (v->op == OP_constf) return !is_zero(v) || is_plus_zero(v);
    if (v->op == OP_fabs) return true;
    if (v->op == OP_fmul || v->op == OP_ffma) return v->args[0] == v->args[1]; /* a*a + c is 0 where c cancels: +0 */
    if (v->op != OP_fadd || !depth) return false; /* of two zeros a sum is -0 only if both are */
    return never_minus_zero(v->args[0], depth - 1) || never_minus_zero(v->args[1], depth - 1);
}

static bool is_length(const Inst *i) {
    enum { DEPTH = 4 };
    if (i->op != OP_fsel || i->args[0]->op != OP_feq || i->args[2]->op != OP_fsqrt) return false;
    const Inst *v = i->args[2]->args[0], *at = i->args[0];
    return at->args[0] == v && is_zero(at->args[1]) && is_plus_zero(i->args[1]) && never_minus_zero(v, DEPTH);
}

static bool simplify(Fn *fn, Block *b) {
    bool changed = false;
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) changed |= simplify(fn, i->region[r]);
        if (is_length(i)) walk_forward(fn, i, i->args[2]), changed = true;
    }
    return changed;
}

bool opt_lengths(PassCtx *ctx, Fn *fn) {
    (void)ctx;
    bool changed = simplify(fn, fn->body);
    if (changed) walk_resolve_forwards(fn->body);
    return changed;
}
