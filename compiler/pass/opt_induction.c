/* Counters: a carried integer i with i' = i + step, step invariant, becomes init + k*step. The loop's own k is the same
 * in all lanes, so counters stay uniform even where lanes leave the loop at different times.
 *
 * Only iterations after which the loop goes on have a successor, so i' need be i + step only where the condition to go
 * on holds: what the ways out of a break hand on does not matter. For the same reason a flag that the condition asks
 * for is a constant in the body. The counter of random numbers in a path is such a counter. */
#include "compiler/pass/walk.h"

static bool defined_outside(const Inst *v, const Block *body) { return !walk_inside(v->block, body); }

/* One conjunct of the condition to go on: flag == value. */
typedef struct Fact {
    Inst *flag;
    bool value;
} Fact;
enum { MAX_FACTS = 8 };

static uint32_t conjuncts(Inst *cond, Fact *facts, uint32_t n) {
    if (cond->op == OP_band) return conjuncts(cond->args[1], facts, conjuncts(cond->args[0], facts, n));
    if (n < MAX_FACTS) facts[n++] = cond->op == OP_bnot ? (Fact){cond->args[0], false} : (Fact){cond, true};
    return n;
}

/* The value of x where the fact holds; NULL: the fact holds nowhere. */
static Inst *where(Fact f, Inst *x) {
    if (f.flag->op == OP_constb) return (f.flag->imm.i != 0) == f.value ? x : NULL;
    if (x->op != OP_proj || f.flag->op != OP_proj || x->args[0] != f.flag->args[0] || x->args[0]->op != OP_if_)
        return x;
    Inst *y[2];
    for (uint32_t r = 0; r < 2; r++) {
        Inst **yields = x->args[0]->region[r]->last->args;
        y[r] = where((Fact){yields[f.flag->imm.i], f.value}, yields[x->imm.i]);
    }
    return !y[0] ? y[1] : !y[1] || y[0] == y[1] ? y[0] : x;
}

/* p + *step, *step a constant? */
static bool steps_from(const Inst *next, const Inst *p, int64_t *step) {
    for (*step = 0; next != p; next = next->args[0]) {
        if ((next->op != OP_iadd && next->op != OP_isub) || !ir_is_const(next->args[1])) return false;
        *step += next->op == OP_iadd ? next->args[1]->imm.i : -next->args[1]->imm.i;
    }
    return true;
}

static bool constant_flags(Fn *fn, Inst *loop, const Fact *facts, uint32_t n) {
    Block *body = loop->region[0];
    bool changed = false;
    for (uint32_t c = 0; c < loop->nargs; c++)
        for (uint32_t k = 0; k < n; k++) {
            const Inst *init = loop->args[c];
            if (facts[k].flag != body->last->args[c + 1] || init->op != OP_constb ||
                (init->imm.i != 0) != facts[k].value)
                continue;
            Builder b = ir_before(fn, body->first);
            Inst *p = body->params[c + 1], *value = ir_constb(&b, facts[k].value);
            if (p == facts[k].flag) continue;
            walk_replace(body, p, value);
            changed = true;
        }
    return changed;
}

static bool induction_loop(Fn *fn, Inst *loop) {
    Block *body = loop->region[0];
    bool changed = false;
    Fact facts[MAX_FACTS];
    uint32_t nfacts = loop->imm.loop.cull ? 0 : conjuncts(body->last->args[0], facts, 0);
    changed |= constant_flags(fn, loop, facts, nfacts);
    for (uint32_t c = 0; c < loop->nargs; c++) {
        Inst *p = body->params[c + 1], *next = body->last->args[c + 1];
        if (p->type != TY_INT) continue;
        for (uint32_t k = 0; k < nfacts && next->op == OP_proj; k++) {
            Inst *x = where(facts[k], next);
            if (x) next = x;
        }
        if ((next->op != OP_iadd && next->op != OP_isub)) continue;
        int64_t sum = 0;
        bool chain = next->args[0] != p;
        if (chain && !steps_from(next, p, &sum)) continue;
        Inst *step = next->args[1];
        if (!chain && (step == p || !(ir_is_const(step) || defined_outside(step, body)))) continue;
        Builder b = body->first ? ir_before(fn, body->first) : ir_at_end(fn, body);
        b.fold = true;
        if (chain) step = ir_consti(&b, (int32_t)(uint32_t)(uint64_t)sum);
        else if (ir_is_const(step) && !defined_outside(step, body)) step = ir_consti(&b, (int32_t)step->imm.i);
        Op op = chain ? OP_iadd : (Op)next->op;
        Inst *scaled = ir_is_const(step) && (int32_t)step->imm.i == 1 ? body->params[0]
                                                                      : ir_emit2(&b, OP_imul, body->params[0], step);
        bool from_zero = loop->args[c]->op == OP_consti && (int32_t)loop->args[c]->imm.i == 0;
        Inst *value = op == OP_iadd && from_zero ? scaled : ir_emit2(&b, op, loop->args[c], scaled);
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
