/* An if_ whose results only a later if_ of the same condition uses becomes the beginning of that one. Reverse mode
 * makes such pairs, what a branch computes and the sweep of it: joined they hand nothing on through results, each of
 * which is a vector to be kept, and zeros where the other branch was taken, and what both compute is computed once.
 */
#include "compiler/pass/walk.h"

typedef struct Fuse {
    Inst **user; /* by id of an if_: the one if_ inside which all uses of its results are; itself: there are others */
    Inst **into; /* by id of an if_ that is gone: where its regions are now */
    bool changed;
} Fuse;

/* The instruction of the block that i is, or is inside of; NULL: i is not inside. */
static Inst *around(Inst *i, const Block *block) {
    while (i && i->block != block) i = i->block->owner;
    return i;
}

static void note_uses(Fuse *f, Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = 0; a < i->nargs && i->op != OP_proj; a++) {
            Inst *from = i->args[a]->op == OP_proj ? i->args[a]->args[0] : NULL;
            if (!from || from->op != OP_if_) continue;
            Inst *at = around(i, from->block), **user = &f->user[from->id];
            const bool fits = at && at != i && at->op == OP_if_ && at->args[0] == from->args[0];
            *user = fits && (!*user || *user == at) ? at : from;
        }
        for (uint32_t r = 0; r < i->nregions; r++) note_uses(f, i->region[r]);
    }
}

/* Does it mean the same wherever it stands? */
static bool is_free(const Inst *i) {
    const bool splits = i->op == OP_if_ || i->op == OP_loop;
    if (!splits && ir_ops[i->op].kind != KIND_PURE && ir_ops[i->op].kind != KIND_LINK) return false;
    if (i->op == OP_site || i->op == OP_siten || i->op == OP_query) return false;
    for (uint32_t r = 0; r < i->nregions; r++)
        for (const Inst *j = i->region[r]->first; j; j = j->next)
            if (!is_free(j)) return false;
    return true;
}

static bool may_move(const Inst *i, const Inst *to) {
    if (is_free(i)) return true;
    for (const Inst *j = i->next; j != to; j = j->next)
        if (!is_free(j)) return false;
    return true;
}

static void join(Fn *fn, Inst *i, Inst *to) {
    for (uint32_t r = 0; r < 2; r++) {
        if (!to->region[r]->first) { /* it yields nothing */
            Builder b = ir_at_end(fn, to->region[r]);
            ir_yield(&b, 0, NULL);
        }
        for (Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
            walk_replace(to->region[r], p, i->region[r]->last->args[p->imm.i]);
        walk_splice(i->region[r], to->region[r]->first);
    }
    while (i->next && i->next->op == OP_proj && i->next->args[0] == i) ir_unlink(i->next);
    ir_unlink(i);
}

/* Backwards, so that of three the first two go into the third. */
static void fuse_block(Fuse *f, Fn *fn, Block *b) {
    for (Inst *i = b->last, *prev; i; i = prev) {
        prev = i->prev;
        for (uint32_t r = 0; r < i->nregions; r++) fuse_block(f, fn, i->region[r]);
        Inst *to = i->op == OP_if_ ? f->user[i->id] : NULL;
        if (!to || to == i) continue;
        while (f->into[to->id]) to = f->into[to->id];
        if (!may_move(i, to)) continue;
        f->into[i->id] = to;
        join(fn, i, to);
        f->changed = true;
    }
}

bool opt_fuse(PassCtx *ctx, Fn *fn) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark m = arena_mark(scratch);
    const uint32_t n = ir_number(fn) + 1;
    Fuse f = {.user = ARENA_ARRAY(scratch, Inst *, n), .into = ARENA_ARRAY(scratch, Inst *, n)};
    note_uses(&f, fn->body);
    fuse_block(&f, fn, fn->body);
    arena_reset(scratch, m);
    return f.changed;
}
