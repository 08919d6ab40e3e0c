/* fpow with a small constant integer exponent -> products, at most 4 of them. Not part of lower_math: the pass changes
 * floats, and whether an exponent is a constant may differ between kernels later, so it runs once, on the primal,
 * before variants are cut. */
#include <math.h>

#include "compiler/pass/lower_math.h"

enum { MAX_EXPONENT = 8 };

static Inst *power(Builder *b, Inst *x, uint32_t n) {
    if (n == 1) return x;
    Inst *half = power(b, x, n / 2), *square = ir_emit2(b, OP_fmul, half, half);
    return n & 1 ? ir_emit2(b, OP_fmul, square, x) : square;
}

static bool powers_in(Fn *fn, Block *b, Inst **map) {
    bool changed = false;
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) changed |= powers_in(fn, i->region[r], map);
        if (i->op != OP_fpow || i->args[1]->op != OP_constf) continue;
        double n = i->args[1]->imm.f, size = fabs(n);
        if (!(size >= 1 && size <= MAX_EXPONENT) || size != floor(size)) continue;
        Builder at = ir_before(fn, i);
        Inst *v = power(&at, i->args[0], (uint32_t)size);
        map[i->id] = n < 0 ? ir_emit2(&at, OP_fdiv, ir_constf(&at, 1), v) : v;
        ir_unlink(i);
        changed = true;
    }
    return changed;
}

bool opt_powers(PassCtx *ctx, Fn *fn) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark m = arena_mark(scratch);
    uint32_t n = ir_number(fn);
    Inst **map = ARENA_ARRAY(scratch, Inst *, n + 1);
    bool changed = powers_in(fn, fn->body, map);
    if (changed) ir_replace_all(fn, map);
    arena_reset(scratch, m);
    return changed;
}
