/* An instruction that only one branch of an if_ uses moves into that branch: then the instruction costs nothing where
 * the branch is not taken. For kernels with rare branches (the event kernel looks at g only of the event that it
 * found). Nothing moves into loops.
 */
#include "compiler/pass/walk.h"

typedef struct Sink {
    Block **use; /* by id: the innermost block that holds all uses so far; NULL: none seen */
    bool changed;
} Sink;

static uint32_t depth(const Block *b) {
    uint32_t n = 0;
    for (; b->owner; b = b->owner->block) n++;
    return n;
}

static Block *common(Block *a, Block *b) {
    if (!a) return b;
    uint32_t da = depth(a), db = depth(b);
    for (; da > db; da--) a = a->owner->block;
    for (; db > da; db--) b = b->owner->block;
    while (a != b) a = a->owner->block, b = b->owner->block;
    return a;
}

static void note(Sink *s, const Inst *i) {
    for (uint32_t a = 0; a < i->nargs; a++) s->use[i->args[a]->id] = common(s->use[i->args[a]->id], i->block);
}

/* From the innermost block of all uses outwards to a region of an if_ that stands in `from` or below it with ifs alone
 * in between. */
static Block *target(Block *use, Block *from) {
    Block *best = use;
    for (Block *b = use; b && b != from; b = b->owner ? b->owner->block : NULL)
        if (!b->owner || b->owner->op != OP_if_) best = b->owner ? b->owner->block : NULL;
    return best == from ? NULL : best;
}

/* Both lanes of a pair take the branch of the event that parts them, so `partner` may follow. */
static bool may_move(const Inst *i) {
    return !i->nregions && (walk_is_pure(i) || i->op == OP_partner) && i->op != OP_site && i->op != OP_siten;
}

/* Backwards, so that what an instruction uses is looked at after it has moved. */
static void sink_block(Sink *s, Block *b) {
    for (Inst *i = b->last, *prev; i; i = prev) {
        prev = i->prev;
        for (uint32_t r = i->nregions; r-- > 0;) sink_block(s, i->region[r]);
        Block *to = may_move(i) && s->use[i->id] ? target(s->use[i->id], b) : NULL;
        if (to && to->first) {
            ir_unlink(i);
            i->block = to;
            i->prev = NULL;
            i->next = to->first;
            to->first->prev = i;
            to->first = i;
            s->changed = true;
        }
        note(s, i);
    }
}

bool opt_sink(PassCtx *ctx, Fn *fn) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark m = arena_mark(scratch);
    Sink s = {.use = ARENA_ARRAY(scratch, Block *, ir_number(fn) + 1)};
    sink_block(&s, fn->body);
    arena_reset(scratch, m);
    return s.changed;
}
