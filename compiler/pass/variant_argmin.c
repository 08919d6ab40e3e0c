/* Sites by which a loop keeps one of its iterations, that with the least key (or the greatest): the nearest of many,
 * argmin.
 *
 *     for (i ...) { float d = ...; [Disc] if (d < best) { best = d; c = ...; } }
 *
 * Behind such a loop nothing hangs on an iteration but on the one that took over last. So `bounds` need not list those
 * that nowhere in a box are the last (variant_lists.c), and cells follow no curve of theirs (cells_given.c). It is one
 * where the key hangs on nothing that the loop carries; where every iteration runs and asks; where in one that takes
 * over the compared value becomes the key, and all else that is carried something that hangs on nothing carried; and
 * where else all pass. Loops around it may hand on what it carries, and carry nothing else. */
#include "compiler/pass/variant.h"

typedef struct Search {
    const Inst *site;
    Argmin *found;
    uint8_t *old; /* by id: hangs on what a loop around carries */
} Search;

/* What a decision is where g < 0, or is not: 0 or 1; -1: the site does not tell. */
static int decided(const Search *s, const Inst *decision, bool below) {
    bool truth;
    if (decision->op == OP_bnot) {
        int other = decided(s, decision->args[0], below);
        return other < 0 ? other : !other;
    }
    if (decision->op != OP_site || decision->imm.i != s->site->imm.i) return -1;
    return variant_truth_below(decision->args[0], decision->args[1], &truth) ? truth == below : -1;
}

/* What v is where g < 0, or is not, as far as the site tells. */
static const Inst *resolve(const Search *s, const Inst *v, bool below) {
    int yes = -1;
    if (ir_ops[v->op].selects && (yes = decided(s, v->args[0], below)) >= 0)
        return resolve(s, v->args[yes ? 1 : 2], below);
    if (v->op == OP_proj && v->args[0]->op == OP_if_ && (yes = decided(s, v->args[0]->args[0], below)) >= 0)
        return resolve(s, v->args[0]->region[yes ? 0 : 1]->last->args[v->imm.i], below);
    if (v->op != OP_siten || v->imm.i != s->site->imm.i) return v;
    const Inst *of = v->args[0], *g = v->args[1];
    if ((of->op != OP_fmin && of->op != OP_fmax) || g->op != OP_fsub) return v;
    bool same = g->args[0] == of->args[0] && g->args[1] == of->args[1];
    if (!same && !(g->args[0] == of->args[1] && g->args[1] == of->args[0])) return v;
    return of->args[((of->op == OP_fmin) == below) == same ? 0 : 1];
}

/* Does the loop around the site keep what that takes over where g < 0, or is not? p: what it compares the key with. */
static bool keeps(const Search *s, const Inst *loop, const Inst *p, const Inst *key, bool below) {
    const Block *body = loop->region[0];
    for (uint32_t c = 0; c < loop->nargs; c++) {
        const Inst *param = body->params[c + 1], *next = body->last->args[c + 1];
        const Inst *taken = resolve(s, next, below);
        if (resolve(s, next, !below) != param) return false;
        if (param == p ? taken != key : s->old[taken->id] != 0) return false;
    }
    return true;
}

/* Does the loop around `inner` carry what that hands on, and nothing else? */
static bool hands_on(const Inst *loop, const Inst *inner) {
    const Block *body = loop->region[0];
    bool all = inner->block == body && loop->imm.loop.exact;
    for (uint32_t c = 0; c < loop->nargs && all; c++) {
        const Inst *v = body->last->args[c + 1];
        all = v->op == OP_proj && v->args[0] == inner && inner->args[v->imm.i] == body->params[c + 1];
    }
    return all;
}

bool variant_argmin(PassCtx *ctx, Fn *fn, const Inst *site, Argmin *found) {
    const Inst *of = site->args[0], *loop = site->block->owner, *outermost = loop;
    bool chooses = of->op == OP_fmin || of->op == OP_fmax, compares = of->op == OP_flt || of->op == OP_fle;
    if (!loop || loop->op != OP_loop || !(chooses || compares) || !loop->imm.loop.exact) return false;
    uint32_t own = of->args[0]->op == OP_arg && of->args[0]->block == site->block ? 0 : 1;
    const Inst *p = of->args[own], *key = of->args[1 - own];
    if (p->op != OP_arg || p->block != site->block || p == site->block->params[0]) return false;
    for (const Inst *inner = loop; inner->block->owner; inner = outermost) {
        outermost = inner->block->owner;
        if (outermost->op != OP_loop || !hands_on(outermost, inner)) return false;
    }
    if (!walk_can_leave_out(fn, outermost)) return false;
    Arena *scratch = &ctx->session->scratch;
    ArenaMark m = arena_mark(scratch);
    Search s = {.site = site, .old = ARENA_ARRAY(scratch, uint8_t, ir_number(fn) + 1)};
    for (const Block *b = site->block; b->owner; b = b->owner->block)
        for (uint32_t c = 0; c < b->owner->nargs; c++) s.old[b->params[c + 1]->id] = 1;
    variant_find_carried(outermost->region[0], s.old);
    bool is = false;
    for (int below = 0; below < 2 && !is && !s.old[key->id]; below++) {
        is = keeps(&s, loop, p, key, below);
        *found = (Argmin){.loop = loop, .key = key, .sign = below ? -1 : 1};
        /* The key is the lesser one where it takes over: which of g's signs that is says of which it is made. */
        found->least = site->args[1]->op == OP_fsub && (site->args[1]->args[0] == key) == (below != 0);
        is &= site->args[1]->op == OP_fsub;
    }
    arena_reset(scratch, m);
    return is;
}

static void find_block(PassCtx *ctx, Fn *fn, const Block *b) {
    Argmin found;
    for (const Inst *i = b->first; i; i = i->next) {
        if (variant_is_site(i) && fn->sites[i->imm.i].kind == SITE_COMPARE && variant_argmin(ctx, fn, i, &found))
            fn->sites[i->imm.i].argmin = found.sign;
        for (uint32_t r = 0; r < i->nregions; r++) find_block(ctx, fn, i->region[r]);
    }
}

void variant_find_argmins(PassCtx *ctx, Fn *fn) { find_block(ctx, fn, fn->body); }
