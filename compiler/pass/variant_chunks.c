/* Straight-line programs in chunks, so that kernels can leave out what a settled choice makes idle.
 *
 * A long expression of min, max and select needs, in one small place, few of its operations: where a < b on a whole
 * tile, nothing of b matters to min(a, b). (Keeter 2020 prunes such an expression and interprets the rest; here the
 * code stays as it was compiled.) Operands share values, so skipping what is private to an operand gains little and
 * costs a test an operation. Instead the top block is cut into chunks of consecutive operations,
 *
 *     %n = live #chunk;  %c = if_ %n { 16 operations; yield what is used outside } { yield 0.. };  %p = proj %c #0 ..
 *
 * and each choice says what it may be, and looks only at the operand that it is known to be:
 *
 *     choice #c (first may be it, second may be it)
 *     %t = fsel settled #2c, first, fmin first, second
 *     %r = fsel settled #2c+1, second, %t
 *
 * All bits are the same in all samples of a call. `bounds`, cut from the same chunks, notes the choices of boxes
 * (variant_bounds); runtime/sample/prune.h turns them into the chunks that run. With every chunk live and no choice
 * settled the values are those of the program, and a value that is never looked at may be anything. */
#include <string.h>

#include "compiler/pass/variant.h"

enum {
    CHUNK = 16,     /* operations: a chunk costs a jump, and runs whole for one live operation */
    MIN_OPS = 1000, /* below, a kernel is fast enough, and its values stay in registers */
    MIN_CHOICES = 64,
    MIN_RUN = 4 * CHUNK, /* consecutive operations that are worth cutting */
    DECORATION = 1       /* Inst.flags: belongs to the choice before it */
};
enum { UNIFORM = 1, AHEAD = 2 }; /* Inst.tag: stays ahead of the chunks; is it uniform too? */

typedef struct Chunks {
    Fn *fn;
    uint32_t nchunks, nchoices;
    uint32_t *chunk; /* by id: 1 + the chunk of an instruction of the top block; 0: none */
    bool *used;      /* by id: outside its chunk */
    Inst **proj;     /* by id: what stands for it there */
} Chunks;

static bool is_choice(const Inst *i) { return i->op == OP_fmin || i->op == OP_fmax || ir_ops[i->op].selects; }
static bool is_read(const Inst *i) { return i->op == OP_param || i->op == OP_iparam || i->op == OP_dparam; }
static bool in_chunk(const Inst *i) { return !ir_ops[i->op].special || i->op == OP_settled || i->op == OP_choice; }

static void move_before(Inst *i, Inst *at) {
    ir_unlink(i);
    i->block = at->block, i->prev = at->prev, i->next = at;
    if (at->prev) at->prev->next = i;
    else at->block->first = i;
    at->prev = i;
}

static bool is_uniform(const Inst *i) {
    if (ir_is_const(i) || (i->op == OP_input && i->imm.i >= SLT_IN_VARYING)) return true;
    if (ir_ops[i->op].special && !is_read(i)) return false;
    for (uint32_t a = 0; a < i->nargs; a++)
        if (i->args[a]->tag != UNIFORM) return false;
    return true;
}

/* Inputs, parameters at known places, and arithmetic of those that are the same for all samples go ahead of all chunks,
 * where kernels compute what is uniform once a call. Tags every instruction of the top block; returns how many
 * operations are left, `choices` of which are choices. */
static uint32_t lift_uniform(Fn *fn, uint32_t *choices) {
    Inst *stays = NULL; /* the first that does */
    uint32_t ops = 0;
    *choices = 0;
    for (Inst *i = fn->body->first, *next; i; i = next) {
        next = i->next;
        i->flags = 0;
        i->tag = is_uniform(i) ? UNIFORM : i->op == OP_input ? AHEAD : 0;
        if (i->tag && stays) move_before(i, stays);
        if (i->tag) continue;
        if (!stays) stays = i;
        ops += in_chunk(i), *choices += is_choice(i);
    }
    return ops;
}

/* What decides a choice: is it its second operand (min, max), its first (select)? */
static Inst *decision(Builder *b, const Inst *i) {
    if (i->op == OP_fmin) return ir_emit2(b, OP_flt, i->args[1], i->args[0]);
    if (i->op == OP_fmax) return ir_emit2(b, OP_flt, i->args[0], i->args[1]);
    return i->args[0];
}

static void decorate(Chunks *c, Inst *i) {
    bool select = ir_ops[i->op].selects;
    Inst *first = i->args[select], *second = i->args[select + 1], *last = i->next;
    Builder b = ir_before(c->fn, last);
    Inst *is = decision(&b, i), *not = ir_emit1(&b, OP_bnot, is);
    Imm number = {.i = c->nchoices}, settled = {.i = 2 * (int64_t)c->nchoices};
    c->nchoices++;
    ir_special(&b, OP_choice, TY_VOID, 2, select ? (Inst *[]){is, not} : (Inst *[]){not, is}, number);
    Inst *known = ir_special(&b, OP_settled, TY_BOOL, 0, NULL, settled);
    Inst *r = ir_select(&b, known, first, i);
    settled.i++;
    known = ir_special(&b, OP_settled, TY_BOOL, 0, NULL, settled);
    r = ir_select(&b, known, second, r);
    c->proj[i->id] = r;
    for (Inst *d = i->next; d != last; d = d->next) d->flags = DECORATION;
}

static void use_decorated(const Chunks *c, Inst *i) {
    for (uint32_t a = 0; a < i->nargs; a++)
        if (i->args[a]->id != UINT32_MAX && c->proj[i->args[a]->id]) i->args[a] = c->proj[i->args[a]->id];
    for (uint32_t r = 0; r < i->nregions; r++)
        for (Inst *j = i->region[r]->first; j; j = j->next) use_decorated(c, j);
}

/* Numbers the chunks of each run of operations that is long enough. */
static void cut(Chunks *c) {
    for (Inst *i = c->fn->body->first, *end; i; i = end) {
        uint32_t length = 0, n = 0;
        for (end = i; end && in_chunk(end) && !end->tag; end = end->next) length += !(end->flags & DECORATION);
        if (end == i) end = i->next;
        if (length < MIN_RUN) continue;
        for (Inst *j = i; j != end; j = j->next) {
            if (!(j->flags & DECORATION) && n++ % CHUNK == 0) c->nchunks++;
            c->chunk[j->id] = c->nchunks;
        }
    }
}

static void mark_uses(Chunks *c, const Block *b, uint32_t chunk) {
    for (const Inst *i = b->first; i; i = i->next) {
        uint32_t own = b == c->fn->body ? c->chunk[i->id] : chunk;
        for (uint32_t a = 0; a < i->nargs; a++) {
            uint32_t from = c->chunk[i->args[a]->id];
            c->used[i->args[a]->id] |= from && from != own;
        }
        for (uint32_t r = 0; r < i->nregions; r++) mark_uses(c, i->region[r], own);
    }
}

/* The instructions from `first` on that belong to its chunk go into an if_; returns what follows. */
static Inst *make_chunk(Chunks *c, Inst *first) {
    Fn *fn = c->fn;
    uint32_t chunk = c->chunk[first->id];
    Builder b = ir_before(fn, first);
    Inst *live = ir_special(&b, OP_live, TY_BOOL, 0, NULL, (Imm){.i = chunk - 1}), *guard = ir_if(&b, live);
    Builder then = ir_at_end(fn, guard->region[0]), other = ir_at_end(fn, guard->region[1]);
    Inst *run = ir_yield(&then, 0, NULL), *next = first;
    Vec(Inst *) values = {0};
    Vec(Inst *) zeros = {0};
    for (Inst *i = first; i && i->id != UINT32_MAX && c->chunk[i->id] == chunk; i = next) {
        next = i->next;
        move_before(i, run);
        if (!c->used[i->id]) continue;
        ir_append_arg(fn, run, i);
        vec_push(fn->arena, &values, i);
        vec_push(fn->arena, &zeros, ir_zero(&other, (IrType)i->type));
    }
    ir_yield(&other, zeros.len, zeros.data);
    b = ir_after(fn, guard);
    for (uint32_t r = 0; r < values.len; r++) c->proj[values.data[r]->id] = ir_proj(&b, guard, r);
    return next;
}

static void use_projs(Chunks *c, Block *b, uint32_t chunk) {
    for (Inst *i = b->first; i; i = i->next) {
        bool guard = i->op == OP_if_ && i->args[0]->op == OP_live;
        for (uint32_t a = 0; a < i->nargs; a++) {
            Inst *x = i->args[a];
            if (x->id != UINT32_MAX && c->proj[x->id] && c->chunk[x->id] != chunk) i->args[a] = c->proj[x->id];
        }
        for (uint32_t r = 0; r < i->nregions; r++)
            use_projs(c, i->region[r], guard && r == 0 ? (uint32_t)i->args[0]->imm.i + 1 : chunk);
    }
}

static void number(Chunks *c) {
    Arena *scratch = &c->fn->session->scratch;
    uint32_t n = ir_number(c->fn) + 1;
    c->chunk = ARENA_ARRAY(scratch, uint32_t, n);
    c->used = ARENA_ARRAY(scratch, bool, n);
    c->proj = ARENA_ARRAY(scratch, Inst *, n);
}

Fn *variant_chunks(PassCtx *ctx, const Fn *primal) {
    Fn *fn = variant_clone(ctx, primal, "chunks", false);
    ArenaMark m = arena_mark(&ctx->session->scratch);
    Chunks c = {.fn = fn};
    uint32_t choices, ops = lift_uniform(fn, &choices);
    if (ops >= MIN_OPS && choices >= MIN_CHOICES) {
        number(&c);
        for (Inst *i = fn->body->first, *next; i; i = next) {
            next = i->next;
            use_decorated(&c, i);
            if (is_choice(i) && !i->tag) decorate(&c, i);
        }
        number(&c);
        cut(&c);
        mark_uses(&c, fn->body, 0);
        for (Inst *i = fn->body->first, *next; i; i = next)
            next = i->id != UINT32_MAX && c.chunk[i->id] ? make_chunk(&c, i) : i->next;
        use_projs(&c, fn->body, 0);
    }
    arena_reset(&ctx->session->scratch, m);
    return c.nchunks ? fn : NULL;
}

static void drop_choices(Block *b) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) drop_choices(i->region[r]);
        if (i->op == OP_choice) ir_unlink(i);
    }
}

void variant_drop_choices(Fn *fn) { drop_choices(fn->body); }

/* ---- what the runtime must know */
typedef struct Table {
    const Fn *fn;
    uint32_t *op; /* by id: 1 + the number of an operation; 0: it is none */
    Vec(SltChunkOp) ops;
    Vec(uint32_t) first_op;
    Vec(uint32_t) first_choice;
    Vec(uint32_t) roots;
    uint32_t nchoices;
    bool effects;
} Table;

/* The value behind a proj of a chunk. */
static const Inst *source(const Inst *x) {
    bool of_chunk = x->op == OP_proj && x->args[0]->op == OP_if_ && x->args[0]->args[0]->op == OP_live;
    return of_chunk ? ir_yield_of(x->args[0]->region[0])->args[x->imm.i] : x;
}

static void add_chunk(Table *t, const Block *chunk) {
    Arena *arena = t->fn->arena;
    vec_push(arena, &t->first_op, t->ops.len);
    vec_push(arena, &t->first_choice, t->nchoices);
    for (const Inst *i = chunk->first; i; i = i->next) {
        t->nchoices += i->op == OP_choice;
        if (ir_ops[i->op].special) continue;
        SltChunkOp op = {{0, 0, 0}, -1};
        bool by_settled = ir_ops[i->op].selects && i->args[0]->op == OP_settled;
        if (by_settled) op.settled = (int32_t)i->args[0]->imm.i;
        for (uint32_t a = by_settled; a < i->nargs; a++) op.arg[a - by_settled] = t->op[source(i->args[a])->id];
        vec_push(arena, &t->ops, op);
        t->op[i->id] = t->ops.len;
    }
}

static void add_roots(Table *t, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        t->effects |= i->op == OP_print || i->op == OP_count;
        bool chunk = b == t->fn->body && i->op == OP_if_ && i->args[0]->op == OP_live;
        for (uint32_t a = 0; a < i->nargs; a++) {
            uint32_t op = t->op[source(i->args[a])->id];
            if (op && i->op != OP_proj) vec_push(t->fn->arena, &t->roots, op - 1);
        }
        for (uint32_t r = 0; r < i->nregions && !chunk; r++) add_roots(t, i->region[r]);
    }
}

const SltChunks *variant_chunk_table(Fn *fn) {
    Table t = {.fn = fn};
    ArenaMark m = arena_mark(&fn->session->scratch);
    t.op = ARENA_ARRAY(&fn->session->scratch, uint32_t, ir_number(fn) + 1);
    for (const Inst *i = fn->body->first; i; i = i->next)
        if (i->op == OP_if_ && i->args[0]->op == OP_live) add_chunk(&t, i->region[0]);
    add_roots(&t, fn->body);
    arena_reset(&fn->session->scratch, m);
    SltChunks *c = ARENA_NEW(fn->arena, SltChunks);
    *c = (SltChunks){.nops = t.ops.len,
                     .nchunks = t.first_op.len,
                     .nchoices = t.nchoices,
                     .nroots = t.roots.len,
                     .op = t.ops.data,
                     .effects = t.effects};
    vec_push(fn->arena, &t.first_op, t.ops.len);
    vec_push(fn->arena, &t.first_choice, t.nchoices);
    c->first_op = t.first_op.data, c->first_choice = t.first_choice.data, c->root = t.roots.data;
    for (uint32_t o = 0; o < c->nops; o++) /* numbers from 1 so far, 0: none */
        for (uint32_t a = 0; a < 3; a++)
            t.ops.data[o].arg[a] = t.ops.data[o].arg[a] ? t.ops.data[o].arg[a] - 1 : c->nops;
    return c;
}
