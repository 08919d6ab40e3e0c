/* Building and editing: new instructions, blocks, clones, numbering, replacement. */
#include <math.h>
#include <string.h>

#include "compiler/ir/ir.h"

/* ---- functions and blocks */

Fn *ir_fn(Session *s, Arena *arena, const char *name, Precision p) {
    Fn *fn = ARENA_NEW(arena, Fn);
    fn->name = name;
    fn->session = s;
    fn->arena = arena;
    fn->precision = p;
    fn->dim = 2;
    fn->channels = 1;
    fn->body = ARENA_NEW(arena, Block);
    return fn;
}

static uint32_t region_limit(const Inst *owner) {
    switch (owner->op) {
    case OP_if_:
    case OP_custom: return 2;
    case OP_loop:
    case OP_revloop: return 1;
    default: return 0;
    }
}

Block *ir_block(Fn *fn, Inst *owner) {
    Block *b = ARENA_NEW(fn->arena, Block);
    b->owner = owner;
    if (!owner) return b;
    for (uint32_t r = 0; r < region_limit(owner); r++) {
        if (owner->region[r]) continue;
        owner->region[r] = b;
        if (owner->nregions <= r) owner->nregions = (uint8_t)(r + 1);
        break;
    }
    return b;
}

static Inst *new_inst(Fn *fn, Op op, IrType t, uint32_t nargs, Inst *const *args, Span span) {
    Inst *i = ARENA_NEW(fn->arena, Inst);
    i->op = (uint8_t)op;
    i->type = (uint8_t)t;
    i->nargs = nargs;
    i->span = span;
    i->id = UINT32_MAX;
    if (nargs) i->args = arena_copy(fn->arena, args, sizeof *args * nargs);
    return i;
}

Inst *ir_block_param(Fn *fn, Block *b, IrType t) {
    Inst *i = new_inst(fn, OP_arg, t, 0, NULL, b->owner ? b->owner->span : SPAN_NONE);
    i->block = b;
    i->imm.i = b->nparams;
    Inst **params = ARENA_ARRAY(fn->arena, Inst *, b->nparams + 1);
    if (b->nparams) memcpy(params, b->params, sizeof *params * b->nparams);
    params[b->nparams++] = i;
    b->params = params;
    return i;
}

/* ---- places */

Builder ir_at_end(Fn *fn, Block *b) {
    Inst *yield = b->last && b->last->op == OP_yield ? b->last : NULL;
    Span span = b->owner ? b->owner->span : b->last ? b->last->span : SPAN_NONE;
    return (Builder){.fn = fn, .block = b, .before = yield, .span = span};
}

Builder ir_before(Fn *fn, Inst *i) { return (Builder){.fn = fn, .block = i->block, .before = i, .span = i->span}; }

Builder ir_after(Fn *fn, Inst *i) {
    Inst *next = i->op == OP_arg ? i->block->first : i->next;
    Inst *owner = i->op == OP_proj ? i->args[0] : i;
    while (next && next->op == OP_proj && next->args[0] == owner) next = next->next; /* projections stay together */
    return (Builder){.fn = fn, .block = i->block, .before = next, .span = i->span};
}

static void link_before(Block *b, Inst *before, Inst *i) {
    i->block = b;
    i->next = before;
    i->prev = before ? before->prev : b->last;
    if (i->prev) i->prev->next = i;
    else b->first = i;
    if (before) before->prev = i;
    else b->last = i;
}

void ir_unlink(Inst *i) {
    if (i->prev) i->prev->next = i->next;
    else if (i->block && i->block->first == i) i->block->first = i->next;
    if (i->next) i->next->prev = i->prev;
    else if (i->block && i->block->last == i) i->block->last = i->prev;
    i->prev = i->next = NULL;
    i->block = NULL;
}

void ir_move_before(Inst *i, Inst *at) {
    ir_unlink(i);
    link_before(at->block, at, i);
}

/* ---- values */

static Inst *insert(Builder *b, Op op, IrType t, uint32_t nargs, Inst *const *args) {
    Inst *i = new_inst(b->fn, op, t, nargs, args, b->span);
    link_before(b->block, b->before, i);
    return i;
}

Inst *ir_emit(Builder *b, Op op, uint32_t nargs, Inst *const *args) {
    const OpInfo *info = &ir_ops[op];
    if (nargs != info->nargs || (info->special && op != OP_detach && op != OP_ghost && op != OP_rand))
        ice(b->fn->session, "ir_emit: %s with %u arguments", info->name, nargs);
    if (b->fold && !info->special) {
        Inst *same = ir_simplify(b, op, args);
        if (same) return same;
    }
    return insert(b, op, (IrType)info->result, nargs, args);
}

Inst *ir_emit1(Builder *b, Op op, Inst *a) { return ir_emit(b, op, 1, &a); }
Inst *ir_emit2(Builder *b, Op op, Inst *a, Inst *c) { return ir_emit(b, op, 2, (Inst *[]){a, c}); }
Inst *ir_emit3(Builder *b, Op op, Inst *a, Inst *c, Inst *d) { return ir_emit(b, op, 3, (Inst *[]){a, c, d}); }

static size_t imm_size(Op op) {
    if (op == OP_loop) return sizeof(LoopInfo);
    if (op == OP_print) return sizeof((Imm *)NULL)->text;
    if (op == OP_give || op == OP_take) return sizeof((Imm *)NULL)->frame;
    if (op == OP_query || op == OP_told) return sizeof((Imm *)NULL)->query;
    return sizeof((Imm *)NULL)->i;
}

Inst *ir_special(Builder *b, Op op, IrType t, uint32_t nargs, Inst *const *args, Imm imm) {
    Inst *i = insert(b, op, t, nargs, args);
    /* What lies behind the member that was set is anything (clang leaves it so), and imms compare with memcmp. */
    memcpy(&i->imm, &imm, imm_size(op));
    return i;
}

Inst *ir_constf(Builder *b, double v) {
    Inst *i = insert(b, OP_constf, TY_FLT, 0, NULL);
    i->imm.f = b->fn->precision == PREC_F32 ? (double)(float)v : v;
    return i;
}

Inst *ir_consti(Builder *b, int32_t v) {
    Inst *i = insert(b, OP_consti, TY_INT, 0, NULL);
    i->imm.i = v;
    return i;
}

Inst *ir_constb(Builder *b, bool v) {
    Inst *i = insert(b, OP_constb, TY_BOOL, 0, NULL);
    i->imm.i = v;
    return i;
}

Inst *ir_zero(Builder *b, IrType t) {
    switch (t) {
    case TY_BOOL: return ir_constb(b, false);
    case TY_INT: return ir_consti(b, 0);
    case TY_FLT: return ir_constf(b, 0);
    case TY_VOID:
    case TY_ARRAY:
    case TY_TAPE: break;
    }
    ice(b->fn->session, "ir_zero: type %d has no zero", (int)t);
}

Inst *ir_input(Builder *b, InputSlot slot) {
    Inst *i = insert(b, OP_input, ir_input_type(slot), 0, NULL);
    i->imm.i = slot;
    return i;
}

Inst *ir_select(Builder *b, Inst *cond, Inst *x, Inst *y) {
    Op op = x->type == TY_FLT ? OP_fsel : x->type == TY_INT ? OP_isel : OP_bsel;
    return ir_emit3(b, op, cond, x, y);
}

/* ---- structure */

Inst *ir_if(Builder *b, Inst *cond) {
    Inst *i = insert(b, OP_if_, TY_VOID, 1, &cond);
    ir_block(b->fn, i);
    ir_block(b->fn, i);
    return i;
}

Inst *ir_loop(Builder *b, uint32_t ncarried, Inst *const *init, LoopInfo info) {
    Inst *i = insert(b, OP_loop, TY_VOID, ncarried, init);
    i->imm.loop = info;
    Block *body = ir_block(b->fn, i);
    ir_block_param(b->fn, body, TY_INT);
    for (uint32_t c = 0; c < ncarried; c++) ir_block_param(b->fn, body, (IrType)init[c]->type);
    return i;
}

Inst *ir_yield(Builder *b, uint32_t n, Inst *const *values) {
    Inst *last = b->block->last;
    if (last && last->op == OP_yield) ice(b->fn->session, "ir_yield: the block has one already");
    b->before = NULL; /* a yield is the end of its block wherever the builder stood */
    return insert(b, OP_yield, TY_VOID, n, values);
}

uint32_t ir_nresults(const Inst *i) {
    if (!i->nregions || !i->region[0] || !i->region[0]->last) return 0;
    const Inst *yield = i->region[0]->last;
    if (yield->op != OP_yield) return 0;
    return i->op == OP_loop ? (yield->nargs ? yield->nargs - 1 : 0) : yield->nargs;
}

void ir_count_uses(const Block *b, uint32_t *uses) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = 0; a < i->nargs; a++) uses[i->args[a]->id]++;
        for (uint32_t r = 0; r < i->nregions; r++) ir_count_uses(i->region[r], uses);
    }
}

static bool is_plus_zero(const Inst *i) { return i->op == OP_constf && i->imm.f == 0 && !signbit(i->imm.f); }

bool ir_is_guarded_twice(const Inst *i) {
    if (i->op != OP_fsel || i->args[0]->op != OP_feq || i->args[2]->op != OP_zmul) return false;
    const Inst *g = i->args[2]->args[1];
    return i->args[0]->args[0] == g && is_plus_zero(i->args[0]->args[1]) && is_plus_zero(i->args[1]);
}

bool ir_has(const Block *b, Op op) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == op) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (ir_has(i->region[r], op)) return true;
    }
    return false;
}

Inst *ir_proj(Builder *b, Inst *structured, uint32_t index) {
    if (index >= ir_nresults(structured))
        ice(b->fn->session, "ir_proj: result %u of %s with %u results", index, ir_ops[structured->op].name,
            ir_nresults(structured));
    Inst *at = structured->next;
    for (; at && at->op == OP_proj && at->args[0] == structured; at = at->next) {
        if (at->imm.i == index) return at;
        if (at->imm.i > index) break;
    }
    const Inst *yield = structured->region[0]->last;
    Inst *value = yield->args[index + (structured->op == OP_loop ? 1 : 0)];
    Inst *i = new_inst(b->fn, OP_proj, (IrType)value->type, 1, &structured, structured->span);
    i->imm.i = index;
    link_before(structured->block, at, i);
    return i;
}

void ir_replace_arg(Inst *i, uint32_t index, Inst *value) { i->args[index] = value; }

void ir_append_arg(Fn *fn, Inst *i, Inst *value) {
    Inst **args = ARENA_ARRAY(fn->arena, Inst *, i->nargs + 1);
    if (i->nargs) memcpy(args, i->args, sizeof *args * i->nargs);
    args[i->nargs++] = value;
    i->args = args;
}

bool ir_is_const(const Inst *i) { return i->op == OP_constf || i->op == OP_consti || i->op == OP_constb; }

/* ---- whole functions */

static uint32_t number_block(Block *b, uint32_t n) {
    for (uint32_t p = 0; p < b->nparams; p++) b->params[p]->id = n++;
    for (Inst *i = b->first; i; i = i->next) {
        i->id = n++;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (i->region[r]) n = number_block(i->region[r], n);
    }
    return n;
}

uint32_t ir_number(Fn *fn) {
    fn->ninsts = number_block(fn->body, 0);
    return fn->ninsts;
}

static bool is_numbered(const Block *b, uint32_t *n) {
    for (uint32_t p = 0; p < b->nparams; p++)
        if (b->params[p]->id != (*n)++) return false;
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->id != (*n)++) return false;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (i->region[r] && !is_numbered(i->region[r], n)) return false;
    }
    return true;
}

bool ir_is_numbered(const Fn *fn) {
    uint32_t n = 0;
    return is_numbered(fn->body, &n) && n == fn->ninsts;
}

static Inst *mapped(Inst *v, Inst **map) { return v && v->id != UINT32_MAX && map[v->id] ? map[v->id] : v; }

static void clone_region(Builder *b, const Block *from, Inst *owner, uint32_t r, Inst **map) {
    Block *to = ARENA_NEW(b->fn->arena, Block);
    to->owner = owner;
    owner->region[r] = to;
    for (uint32_t p = 0; p < from->nparams; p++) {
        Inst *param = ir_block_param(b->fn, to, (IrType)from->params[p]->type);
        param->span = from->params[p]->span;
        map[from->params[p]->id] = param;
    }
    Builder inner = {.fn = b->fn, .block = to, .span = b->span};
    ir_clone_insts(&inner, from, from->first, NULL, map);
}

void ir_clone_insts(Builder *b, const Block *from, Inst *first, Inst *last_exclusive, Inst **map) {
    (void)from;
    for (Inst *i = first; i && i != last_exclusive; i = i->next) {
        Inst *c = insert(b, (Op)i->op, (IrType)i->type, i->nargs, i->args);
        for (uint32_t a = 0; a < c->nargs; a++) c->args[a] = mapped(c->args[a], map);
        c->imm = i->imm;
        c->span = i->span;
        c->flags = i->flags;
        c->tag = i->tag;
        c->nregions = i->nregions;
        if (i->id != UINT32_MAX) map[i->id] = c;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (i->region[r]) clone_region(b, i->region[r], c, r, map);
    }
}

Fn *ir_clone(const Fn *fn, Arena *arena, const char *name) {
    uint32_t n = ir_number((Fn *)fn); /* ids are scratch: numbering changes nothing that the Fn means */
    Fn *to = ARENA_NEW(arena, Fn);
    *to = *fn;
    to->name = name;
    to->arena = arena;
    to->body = ARENA_NEW(arena, Block);
    if (fn->nsites) to->sites = arena_copy(arena, fn->sites, sizeof *fn->sites * fn->nsites);
    if (fn->outputs && fn->body->last)
        to->outputs = arena_copy(arena, fn->outputs, sizeof *fn->outputs * fn->body->last->nargs);
    ArenaMark m = arena_mark(&fn->session->scratch);
    Inst **map = ARENA_ARRAY(&fn->session->scratch, Inst *, n + 1);
    Builder b = ir_at_end(to, to->body);
    ir_clone_insts(&b, fn->body, fn->body->first, NULL, map);
    if (arena != &fn->session->scratch) arena_reset(&fn->session->scratch, m);
    return to;
}

static void replace_in(Block *b, Inst **map) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = 0; a < i->nargs; a++) {
            Inst *v = i->args[a], *to;
            while ((to = mapped(v, map)) != v) v = to;
            i->args[a] = v;
        }
        for (uint32_t r = 0; r < i->nregions; r++)
            if (i->region[r]) replace_in(i->region[r], map);
    }
}

void ir_replace_all(Fn *fn, Inst **map) { replace_in(fn->body, map); }

void ir_name_outputs(Fn *fn, SltRole role) {
    uint32_t n = fn->body->last->nargs;
    fn->outputs = ARENA_ARRAY(fn->arena, Output, n + 1);
    for (uint32_t i = 0; i < n; i++) fn->outputs[i] = (Output){role, i};
}
