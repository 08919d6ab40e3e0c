/* Walking, replacing, splicing, and threading values through control structure. */
#include <string.h>

#include "compiler/pass/walk.h"

bool walk_is_pure(const Inst *i) { return ir_ops[i->op].kind == KIND_PURE; }

uint32_t walk_size(const Block *b) {
    uint32_t n = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        if (!ir_is_const(i) && i->op != OP_proj && i->op != OP_yield) n++;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (i->region[r]) n += walk_size(i->region[r]);
    }
    return n;
}

bool walk_is_indexed(const Inst *v, uint32_t depth) {
    bool indexed = v->op == OP_arg;
    for (uint32_t a = 0; a < v->nargs && depth && !indexed; a++) indexed = walk_is_indexed(v->args[a], depth - 1);
    return indexed;
}

uint32_t walk_fn_size(const Fn *fn) {
    uint32_t n = 0;
    for (; fn; fn = fn->next_part) n += walk_size(fn->body);
    return n;
}

double walk_work(const Block *b) {
    double n = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        n += !ir_is_const(i);
        for (uint32_t r = 0; r < i->nregions; r++)
            n += (i->op == OP_loop ? (double)i->imm.loop.max_iters : 1) * walk_work(i->region[r]);
    }
    return n;
}

bool walk_any_marked(const uint8_t *marks, const Inst *param) {
    const uint8_t *first = marks + param->imm.slot.base;
    const uint32_t n = param->imm.slot.count;
    return n && (*first || memcmp(first, first + 1, n - 1) != 0); /* none is, if all are as the first */
}

bool walk_inside(const Block *inner, const Block *outer) {
    for (const Block *b = inner; b; b = b->owner ? b->owner->block : NULL)
        if (b == outer) return true;
    return false;
}

void walk_remap(Inst *i, Inst **map) {
    for (uint32_t a = 0; a < i->nargs; a++) {
        Inst *v = i->args[a];
        while (v && v->id != UINT32_MAX && map[v->id] && map[v->id] != v) v = map[v->id];
        i->args[a] = v;
    }
}

void walk_replace(Block *b, const Inst *from, Inst *to) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = 0; a < i->nargs; a++)
            if (i->args[a] == from) i->args[a] = to;
        for (uint32_t r = 0; r < i->nregions; r++) walk_replace(i->region[r], from, to);
    }
}

/* An unlinked instruction is free for this: its op says that it forwards, its first operand where to. */
void walk_forward(Fn *fn, Inst *i, Inst *to) {
    ir_unlink(i);
    i->op = OP_COUNT;
    if (!i->nargs) i->args = arena_alloc(fn->arena, sizeof *i->args);
    i->nargs = 1;
    i->args[0] = to;
}

void walk_clear_tags(Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        i->tag = 0;
        for (uint32_t r = 0; r < i->nregions; r++) walk_clear_tags(i->region[r]);
    }
    for (uint32_t p = 0; p < b->nparams; p++) b->params[p]->tag = 0;
}

void walk_resolve_forwards(Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = 0; a < i->nargs; a++)
            while (i->args[a]->op == OP_COUNT) i->args[a] = i->args[a]->args[0];
        for (uint32_t r = 0; r < i->nregions; r++) walk_resolve_forwards(i->region[r]);
    }
}

bool walk_make_site(Fn *fn, Inst *at, Inst *g0, Inst *g1, SiteInfo *info) {
    Inst *args[2 + SLT_MAX_K] = {at};
    uint32_t depth = 0;
    for (const Block *b = at->block; b->owner; b = b->owner->block) depth += b->owner->op == OP_loop;
    if (depth > SLT_MAX_K) return false;
    info->path = fn->name, info->max_events = 1, info->depth = depth;
    uint32_t outer = depth;
    for (const Block *b = at->block; b->owner; b = b->owner->block) {
        if (b->owner->op != OP_loop) continue;
        uint64_t iters = b->owner->imm.loop.max_iters;
        args[2 + --outer] = b->params[0];
        info->max_events = info->max_events > UINT64_MAX / iters ? UINT64_MAX : info->max_events * iters;
    }
    Builder b = ir_after(fn, at);
    b.span = info->span;
    args[1] = g1 ? ir_emit2(&b, OP_fsub, g0, g1) : g0;
    bool compares = at->type == TY_BOOL;
    Inst *site =
        ir_special(&b, compares ? OP_site : OP_siten, (IrType)at->type, 2 + depth, args, (Imm){.i = fn->nsites++});
    walk_replace(fn->body, at, site);
    ir_replace_arg(site, 0, at);
    return true;
}

bool walk_tells(const Inst *flag, const Inst *v, bool value) {
    if (flag->op == OP_band) return walk_tells(flag->args[0], v, value) || walk_tells(flag->args[1], v, value);
    return value ? flag == v : flag->op == OP_bnot && flag->args[0] == v;
}

bool walk_begins(const Inst *loop, const Inst *v, bool value) {
    if (v->op == OP_constb) return (v->imm.i != 0) == value;
    for (const Block *b = loop->block; b->owner; b = b->owner->block)
        if (b->owner->op == OP_if_ && b == b->owner->region[0] && walk_tells(b->owner->args[0], v, value)) return true;
    return false;
}

void walk_splice(Block *from, Inst *at) {
    Block *to = at->block;
    for (Inst *i = from->first, *next; i; i = next) {
        next = i->next;
        if (i->op == OP_yield) break;
        i->block = to;
        i->prev = at->prev;
        i->next = at;
        if (at->prev) at->prev->next = i;
        else to->first = i;
        at->prev = i;
    }
    from->first = from->last = NULL;
}

static bool touches_below(Thread *t, const Inst *i) {
    for (uint32_t r = 0; r < i->nregions; r++)
        for (const Inst *j = i->region[r] ? i->region[r]->first : NULL; j; j = j->next)
            if (t->touches(t, j) || touches_below(t, j)) return true;
    return false;
}

/* Threads the values through i: those that it changes become results, and carried values of a loop. */
static void thread_structured(Thread *t, Inst *i) {
    Inst *before[16];
    memcpy(before, t->value, sizeof before);
    uint32_t old = ir_nresults(i);
    if (i->op == OP_if_) {
        for (uint32_t r = 0; r < 2; r++) {
            memcpy(t->value, before, sizeof before);
            thread_block(t, i->region[r]);
            for (uint32_t v = 0; v < t->n; v++) ir_append_arg(t->fn, i->region[r]->last, t->value[v]);
        }
    } else if (i->op == OP_loop) {
        Block *body = i->region[0];
        for (uint32_t v = 0; v < t->n; v++) {
            ir_append_arg(t->fn, i, before[v]);
            t->value[v] = ir_block_param(t->fn, body, (IrType)before[v]->type);
        }
        if (t->depth < sizeof t->loop_k / sizeof *t->loop_k) t->loop_k[t->depth] = body->params[0];
        t->depth++;
        thread_block(t, body);
        t->depth--;
        for (uint32_t v = 0; v < t->n; v++) ir_append_arg(t->fn, body->last, t->value[v]);
        if (t->cont) {
            Builder b = ir_before(t->fn, body->last);
            Inst *flag = t->cont(t, &b, body->last->args[0]);
            if (flag) ir_replace_arg(body->last, 0, flag), i->imm.loop.exact = false;
        }
    } else {
        ice(t->fn->session, "thread: unexpected region operation");
    }
    Builder b = ir_after(t->fn, i);
    for (uint32_t v = 0; v < t->n; v++) t->value[v] = ir_proj(&b, i, old + v);
}

void thread_block(Thread *t, Block *b) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        if (i->nregions) {
            if (touches_below(t, i)) {
                thread_structured(t, i);
                next = i->next;
                while (next && next->op == OP_proj) next = next->next;
            }
        } else if (t->touches(t, i)) {
            t->at(t, i);
        }
    }
}
