#include "compiler/pass/slice.h"

void slice_add(Slice *s, Inst *i) {
    if (!i || s->in[i->id]) return;
    s->in[i->id] = true;
    vec_push(s->arena, &s->work, i);
}

static void add_control(Slice *s, const Block *b) {
    for (; b && b->owner; b = b->owner->block) {
        if (b->owner->op == OP_if_) slice_add(s, b->owner->args[0]);
        if (b->owner->op == OP_loop) slice_add(s, b->last->args[0]);
    }
}

static void add_stores(Slice *s, const Inst *array) {
    for (Inst *at = s->stores[array->id]; at; at = s->next_store[at->id]) {
        s->in[at->id] = true;
        for (uint32_t a = 1; a < at->nargs; a++) slice_add(s, at->args[a]);
        add_control(s, at->block);
    }
}

static void add_parameter(Slice *s, const Inst *i) {
    const Block *b = i->block;
    uint32_t at = (uint32_t)i->imm.i;
    if (!b->owner) return;
    if (b->owner->op == OP_loop && at > 0) {
        slice_add(s, b->owner->args[at - 1]);
        slice_add(s, b->last->args[at]);
        slice_add(s, b->last->args[0]);
    } else if (b->owner->op == OP_custom && at < b->owner->nargs) {
        slice_add(s, b->owner->args[at]);
    }
}

static void add_result(Slice *s, const Inst *i) {
    Inst *op = i->args[0];
    uint32_t at = (uint32_t)i->imm.i + (op->op == OP_loop ? 1 : 0);
    slice_add(s, op->region[0]->last->args[at]);
    if (op->op == OP_if_) slice_add(s, op->region[1]->last->args[at]), slice_add(s, op->args[0]);
    if (op->op == OP_loop) slice_add(s, op->region[0]->last->args[0]);
}

static void add_operands(Slice *s, const Inst *i) {
    bool site = i->op == OP_site || i->op == OP_siten;
    if (i->op == OP_arg) add_parameter(s, i);
    else if (i->op == OP_proj) add_result(s, i);
    else if (i->op == OP_alloc) add_stores(s, i);
    else
        for (uint32_t a = site && !s->decisions ? 1 : 0; a < i->nargs; a++) slice_add(s, i->args[a]);
}

static void find_stores(Slice *s, const Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_store || i->op == OP_acopy)
            s->next_store[i->id] = s->stores[i->args[0]->id], s->stores[i->args[0]->id] = i;
        for (uint32_t r = 0; r < i->nregions; r++) find_stores(s, i->region[r]);
    }
}

Slice slice_begin(Fn *fn, Arena *arena, bool decisions) {
    uint32_t n = fn->ninsts + 1;
    Slice s = {.arena = arena, .decisions = decisions, .in = ARENA_ARRAY(arena, bool, n)};
    s.stores = ARENA_ARRAY(arena, Inst *, n), s.next_store = ARENA_ARRAY(arena, Inst *, n);
    find_stores(&s, fn->body);
    return s;
}

void slice_close(Slice *s) {
    while (s->work.len) add_operands(s, s->work.data[--s->work.len]);
}
