/* Dead code: instructions, results of ifs and loops, carried values and arrays that reach no output and no effect.
 *
 * Mark from the roots (outputs, effects, sites of skipped loops) through operands; a region operation is alive when one
 * of its results or something inside it is, a carried value when its parameter or its result is, a store when its array
 * is read. Then sweep and renumber. Linear. */
#include <string.h>

#include "compiler/pass/walk.h"

enum { LIVE = 1 };

typedef struct Dce {
    Fn *fn;
    Arena *arena;
    Vec(Inst *) work;
    Inst **stores; /* by id of the alloc: last store or acopy into it, chained through next_store */
    Inst **next_store;
    bool changed;
} Dce;

static void mark(Dce *d, Inst *i) {
    if (!i || (i->flags & LIVE)) return;
    i->flags |= LIVE;
    vec_push(d->arena, &d->work, i);
}

static bool is_root(const Fn *fn, const Inst *i) {
    if (ir_ops[i->op].kind == KIND_EFFECT) return true;
    return i->op == OP_site && fn->sites && i->imm.i < (int64_t)fn->nsites && fn->sites[i->imm.i].skip_loop;
}

static void collect(Dce *d, Block *b) {
    for (uint32_t p = 0; p < b->nparams; p++) b->params[p]->flags = 0;
    for (Inst *i = b->first; i; i = i->next) {
        i->flags = 0;
        if (i->op == OP_store || i->op == OP_acopy) {
            d->next_store[i->id] = d->stores[i->args[0]->id];
            d->stores[i->args[0]->id] = i;
        }
        for (uint32_t r = 0; r < i->nregions; r++)
            if (i->region[r]) collect(d, i->region[r]);
    }
}

static void mark_roots(Dce *d, Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        if (is_root(d->fn, i)) mark(d, i);
        for (uint32_t r = 0; r < i->nregions; r++)
            if (i->region[r]) mark_roots(d, i->region[r]);
    }
}

/* What a live block parameter keeps alive. */
static void propagate_arg(Dce *d, Inst *i) {
    Inst *owner = i->block->owner;
    if (!owner) return;
    mark(d, owner);
    uint32_t index = (uint32_t)i->imm.i;
    if (owner->op == OP_loop && index > 0) {
        mark(d, owner->args[index - 1]);
        mark(d, i->block->last->args[index]);
    } else if (owner->op == OP_revloop) {
        uint32_t carried = owner->nargs - 1, frame = i->block->nparams - carried;
        if (index >= frame) {
            mark(d, owner->args[1 + index - frame]);
            mark(d, i->block->last->args[index - frame]);
        }
    } else if (owner->op == OP_custom) {
        if (index < owner->nargs) mark(d, owner->args[index]);
    }
}

static void propagate_proj(Dce *d, Inst *i) {
    Inst *owner = i->args[0];
    uint32_t index = (uint32_t)i->imm.i;
    mark(d, owner);
    for (uint32_t r = 0; r < owner->nregions; r++) mark(d, walk_results(owner, owner->region[r])[index]);
    if (owner->op == OP_loop) mark(d, owner->args[index]);
    if (owner->op == OP_revloop) mark(d, owner->args[1 + index]);
}

static void propagate(Dce *d, Inst *i) {
    if (i->op != OP_arg && i->block->owner) mark(d, i->block->owner);
    switch (i->op) {
    case OP_arg: propagate_arg(d, i); return;
    case OP_proj: propagate_proj(d, i); return;
    case OP_if_: mark(d, i->args[0]); return;
    case OP_loop: mark(d, i->region[0]->last->args[0]); return;
    case OP_revloop: mark(d, i->args[0]); return;
    case OP_custom:
        for (uint32_t a = 0; a < i->nargs; a++) mark(d, i->args[a]);
        for (uint32_t r = 0; r < i->nregions; r++)
            for (uint32_t a = 0; a < i->region[r]->last->nargs; a++) mark(d, i->region[r]->last->args[a]);
        return;
    case OP_alloc:
        for (Inst *s = d->stores[i->id]; s; s = d->next_store[s->id]) mark(d, s);
        return;
    default:
        for (uint32_t a = 0; a < i->nargs; a++) mark(d, i->args[a]);
    }
}

/* Drops the results, carried values and parameters of a live region operation that nobody needs. */
static void trim(Dce *d, Inst *i) {
    if (i->op == OP_custom) return;
    uint32_t n = ir_nresults(i);
    if (!n) return;
    uint32_t *index = ARENA_ARRAY(d->arena, uint32_t, n), kept = 0;
    bool *keep = ARENA_ARRAY(d->arena, bool, n);
    uint32_t first_param = i->op == OP_loop ? 1 : i->op == OP_revloop ? i->region[0]->nparams - n : 0;
    bool carried = i->op != OP_if_;
    for (Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
        if (p->flags & LIVE) keep[p->imm.i] = true;
    for (uint32_t r = 0; r < n; r++) {
        if (carried && (i->region[0]->params[first_param + r]->flags & LIVE)) keep[r] = true;
        index[r] = keep[r] ? kept++ : UINT32_MAX;
    }
    if (kept == n) return;
    d->changed = true;
    for (uint32_t g = 0; g < i->nregions; g++) {
        Inst *y = i->region[g]->last;
        uint32_t lead = i->op == OP_loop ? 1 : 0;
        for (uint32_t r = 0; r < n; r++)
            if (keep[r]) y->args[lead + index[r]] = y->args[lead + r];
        y->nargs = lead + kept;
    }
    if (carried) {
        Block *body = i->region[0];
        uint32_t lead = i->op == OP_loop ? 0 : 1;
        for (uint32_t r = 0; r < n; r++)
            if (keep[r]) {
                i->args[lead + index[r]] = i->args[lead + r];
                body->params[first_param + index[r]] = body->params[first_param + r];
                body->params[first_param + index[r]]->imm.i = first_param + index[r];
            }
        i->nargs = lead + kept;
        body->nparams = first_param + kept;
    }
    for (Inst *p = i->next, *next; p && p->op == OP_proj && p->args[0] == i; p = next) {
        next = p->next;
        if (keep[p->imm.i]) p->imm.i = index[p->imm.i];
        else ir_unlink(p);
    }
}

static void sweep(Dce *d, Block *b) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        if (i->op == OP_yield) continue;
        if (!(i->flags & LIVE)) {
            if (i->op == OP_proj && (i->args[0]->flags & LIVE))
                continue; /* trim decides: an unused carried result stays */
            ir_unlink(i);
            d->changed = true;
            continue;
        }
        for (uint32_t r = 0; r < i->nregions; r++) sweep(d, i->region[r]);
        if (i->nregions) {
            trim(d, i);
            next = i->next;
        }
    }
}

bool opt_dce(PassCtx *ctx, Fn *fn) {
    ArenaMark m = arena_mark(&ctx->session->scratch);
    Dce d = {.fn = fn, .arena = &ctx->session->scratch};
    ir_number(fn);
    d.stores = ARENA_ARRAY(d.arena, Inst *, fn->ninsts + 1);
    d.next_store = ARENA_ARRAY(d.arena, Inst *, fn->ninsts + 1);
    collect(&d, fn->body);
    for (uint32_t a = 0; a < fn->body->last->nargs; a++) mark(&d, fn->body->last->args[a]);
    mark_roots(&d, fn->body);
    while (d.work.len) propagate(&d, d.work.data[--d.work.len]);
    sweep(&d, fn->body);
    arena_reset(&ctx->session->scratch, m);
    return d.changed;
}
