/* Integers of floats whose NaN nobody can tell.
 *
 * int(x) is 0 where x is NaN, which takes two instructions. In noise the fraction of such an x is NaN, too, and so is
 * everything that the integer could have changed. That is looked up: all that hangs on the integer, within its block,
 * must end in sums and products that are NaN where x is. */
#include "compiler/back/cpu/emit.h"

enum { PATIENCE = 1 << 16 }; /* instructions that are looked at in a kernel */

typedef struct Search {
    uint8_t *mark;  /* by id */
    uint32_t *seen; /* ids that are marked */
    uint32_t n, looked_at;
} Search;

enum { NAN_TOO = 1, HANGS = 2 };

static void put(Search *s, const Inst *i, uint8_t mark) {
    if (!s->mark[i->id]) s->seen[s->n++] = i->id;
    s->mark[i->id] |= mark;
}

static bool region_reads(Search *s, const Block *b, uint8_t mark) {
    for (const Inst *i = b->first; i; i = i->next) {
        s->looked_at++;
        for (uint32_t k = 0; k < i->nargs; k++)
            if (s->mark[i->args[k]->id] & mark) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (region_reads(s, i->region[r], mark)) return true;
    }
    return false;
}

static bool reads(const Search *s, const Inst *i, uint8_t mark) {
    for (uint32_t k = 0; k < i->nargs; k++)
        if (s->mark[i->args[k]->id] & mark) return true;
    return false;
}

static bool keeps_nan(Op op) {
    return op == OP_fadd || op == OP_fsub || op == OP_fmul || op == OP_fdiv || op == OP_ffma || op == OP_fneg ||
           op == OP_fabs || op == OP_fsqrt || op == OP_ffloor;
}

/* Does nothing hang on integer c where its argument is NaN? */
static bool nan_hides(Search *s, const Inst *c) {
    const Inst *x = c->args[0], *from = c;
    put(s, x, NAN_TOO);
    if (x->op == OP_ffloor) put(s, x->args[0], NAN_TOO), x = x->args[0];
    for (const Inst *i = c; i && i != x; i = i->prev) from = i; /* what is NaN with it may lie before c */
    put(s, c, HANGS);
    for (const Inst *i = from; i; i = i->next, s->looked_at++) {
        if (keeps_nan((Op)i->op) && reads(s, i, NAN_TOO)) put(s, i, NAN_TOO);
        for (uint32_t r = 0; r < i->nregions; r++)
            if (region_reads(s, i->region[r], HANGS)) return false;
        if (!reads(s, i, HANGS) || s->mark[i->id] & NAN_TOO) continue;
        if (ir_ops[i->op].special) return false;
        put(s, i, HANGS);
    }
    return true;
}

static void look_at(Emit *e, const Block *b, Search *s) {
    for (const Inst *i = b->first; i && s->looked_at < PATIENCE; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) look_at(e, i->region[r], s);
        if (!emit_is_vector(e, i)) continue;
        if (i->op == OP_f2i) e->hidden[i->id] = nan_hides(s, i);
        while (s->n) s->mark[s->seen[--s->n]] = 0;
    }
}

void emit_find_hidden(Emit *e) {
    if (!ir_has(e->fn->body, OP_f2i)) return;
    const uint32_t n = e->fn->ninsts + 1;
    e->hidden = ARENA_ARRAY(e->arena, bool, n);
    Search s = {.mark = ARENA_ARRAY(e->arena, uint8_t, n), .seen = ARENA_ARRAY(e->arena, uint32_t, n)};
    look_at(e, e->fn->body, &s);
}
