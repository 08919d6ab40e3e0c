/* Straight-line programs in chunks, so that kernels can leave out what a settled choice makes idle.
 *
 * A long expression of min, max and select needs, in one small place, few of its operations: where a < b on a whole
 * tile, nothing of b matters to min(a, b), and it is a. (Keeter 2020 prunes such an expression and interprets the rest;
 * here the code stays as it was compiled.) Operands share values, so skipping what is private to an operand gains
 * little and costs a test an operation. Instead the top block is cut into chunks of consecutive operations,
 *
 *     %n = live #chunk;  if_ %n { %a = take [import]; 16 operations; give [export], %z; yield } { yield }
 *
 * and each choice says what it may be, and looks only at the operand that it is known to be:
 *
 *     choice #c (first may be it, second may be it)
 *     %t = fsel settled #2c, first, fmin first, second
 *     %r = fsel settled #2c+1, second, %t
 *
 * Whoever takes %r from another chunk may be told to take what %r is known to be: of a thousand nested choices of which
 * one is open, one chunk runs. All that is the same in all samples of a call. `prune`, cut from the same chunks, notes
 * the choices of boxes (variant_bounds.c); runtime/sample/prune.h makes an SltPruned of them. With every chunk live and
 * no choice settled the values are those of the program; one that is never looked at may be anything. */
#include <string.h>

#include "compiler/pass/variant.h"

enum {
    CHUNK = 16,     /* operations: a chunk costs a jump, and runs whole for one live operation */
    MIN_OPS = 1000, /* below, a kernel is fast enough */
    MIN_CHOICES = 64,
    MIN_RUN = 4 * CHUNK /* consecutive operations that are worth cutting */
};
/* Inst.tag, of instructions of the top block: stays ahead of the chunks, and is it uniform too; goes into a chunk, also
 * what was added to a choice, or only for its sake. */
enum { UNIFORM = 1, AHEAD, OPERATION, ADDED, NOTED };

enum { NONE = 1 << 30 }; /* stands for the number of operations while that is not known */

typedef struct Chunks {
    Fn *fn;
    uint32_t nchunks, nchoices;
    uint32_t *chunk;        /* by id: 1 + the chunk of an instruction of the top block; 0: none */
    Inst **stands;          /* by id: what was made of a choice */
    bool *used;             /* by id: outside its chunk */
    uint32_t *op, *number;  /* by id: 1 + the number of an operation; of an exported value; 0: it is none */
    uint32_t *seen, *taken; /* by id: 1 + the chunk that imported it last (outside: nchunks + 1), and the number */
    Inst **take;            /* by id: that import */
    uint32_t nexports;
    Vec(SltChunkOp) ops;
    Vec(int32_t) exported;
    Vec(int8_t) below;
    Vec(uint32_t) import;
    Vec(uint32_t) first_op;
    Vec(uint32_t) first_choice;
    Vec(uint32_t) first_import;
} Chunks;

static bool is_choice(const Inst *i) { return i->op == OP_fmin || i->op == OP_fmax || ir_ops[i->op].selects; }
static bool is_read(const Inst *i) { return i->op == OP_param || i->op == OP_iparam || i->op == OP_dparam; }
static bool in_chunk(const Inst *i) { return i->tag >= OPERATION; }

static bool is_uniform(const Inst *i) {
    if (ir_is_const(i) || (i->op == OP_input && i->imm.i >= SLT_IN_VARYING)) return true;
    if (ir_ops[i->op].special && !is_read(i)) return false;
    for (uint32_t a = 0; a < i->nargs; a++)
        if (i->args[a]->tag != UNIFORM) return false;
    return true;
}

/* What a site decides by stays beside it, where bounds see what it compares; unless operations use it too. */
static void untag_decisions(Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) untag_decisions(i->region[r]);
        Inst *by = i->op == OP_site ? i->args[0] : NULL;
        bool used = !by || by->tag != OPERATION || !ir_ops[by->op].compares;
        for (const Inst *j = used ? NULL : by->next; j; j = j->next)
            for (uint32_t a = 0; a < j->nargs; a++) used |= j->args[a] == by && j->tag == OPERATION;
        if (!used) by->tag = 0;
    }
}

/* Inputs, parameters at known places, and arithmetic of those that are the same for all samples go ahead of all chunks,
 * where kernels compute what is uniform once a call. Tags what stays behind that is long enough to be cut; is it worth
 * it? */
static bool tag_operations(Fn *fn) {
    Inst *stays = NULL; /* the first that does */
    for (Inst *i = fn->body->first, *next; i; i = next) {
        next = i->next;
        i->tag = is_uniform(i) ? UNIFORM : i->op == OP_input ? AHEAD : 0;
        if (i->tag && stays) ir_move_before(i, stays);
        if (!i->tag && !stays) stays = i;
    }
    uint32_t ops = 0, choices = 0;
    for (Inst *i = stays, *end; i; i = end) {
        uint32_t length = 0;
        for (end = i; end && !ir_ops[end->op].special; end = end->next) length++;
        for (Inst *j = i; j != end && length >= MIN_RUN; j = j->next)
            j->tag = OPERATION, ops++, choices += is_choice(j);
        if (end == i) end = i->next;
    }
    if (ops < MIN_OPS || choices < MIN_CHOICES) return false;
    untag_decisions(fn->body);
    return true;
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
    Imm number = {.i = c->nchoices}, settled = {.i = 2 * (int64_t)c->nchoices};
    c->nchoices++;
    Inst *known = ir_special(&b, OP_settled, TY_BOOL, 0, NULL, settled);
    Inst *r = ir_select(&b, known, first, i);
    settled.i++;
    known = ir_special(&b, OP_settled, TY_BOOL, 0, NULL, settled);
    r = ir_select(&b, known, second, r);
    c->stands[i->id] = r;
    for (Inst *d = i->next; d != last; d = d->next) d->tag = ADDED;
    Inst *is = decision(&b, i), *not = ir_emit1(&b, OP_bnot, is);
    ir_special(&b, OP_choice, TY_VOID, 2, select ? (Inst *[]){is, not} : (Inst *[]){not, is}, number);
    for (Inst *d = r->next; d != last; d = d->next) d->tag = NOTED;
}

static void use_decorated(const Chunks *c, Inst *i) {
    for (uint32_t a = 0; a < i->nargs; a++)
        if (i->args[a]->id != UINT32_MAX && c->stands[i->args[a]->id]) i->args[a] = c->stands[i->args[a]->id];
    for (uint32_t r = 0; r < i->nregions; r++)
        for (Inst *j = i->region[r]->first; j; j = j->next) use_decorated(c, j);
}

static void number_chunks(Chunks *c) {
    uint32_t n = 0;
    bool before = false;
    for (Inst *i = c->fn->body->first; i; i = i->next) {
        if (in_chunk(i)) {
            if (!before) n = 0;
            if (i->tag == OPERATION && n++ % CHUNK == 0) c->nchunks++;
            c->chunk[i->id] = c->nchunks;
        }
        before = in_chunk(i);
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

/* x, of another chunk, for the chunk `to` (outside: nchunks + 1). */
static Inst *import(Chunks *c, Builder *b, Inst *x, uint32_t to) {
    if (c->seen[x->id] == to) return c->take[x->id];
    Imm imm = {0};
    imm.frame.which = c->import.len, imm.frame.places = 1;
    c->seen[x->id] = to, c->taken[x->id] = c->import.len;
    vec_push(c->fn->arena, &c->import, c->op[x->id] - 1);
    return c->take[x->id] = ir_special(b, OP_take, (IrType)x->type, 0, NULL, imm);
}

/* The min, max or select inside what was made of it, and the last instruction of that. */
static bool is_raw(const Inst *i) { return i->tag == OPERATION && i->next->tag == ADDED; }
static bool is_whole(const Inst *i) { return i->tag == ADDED && i->next->tag == NOTED; }

static bool is_other(const Chunks *c, const Inst *x, uint32_t chunk) {
    return x->id != UINT32_MAX && c->chunk[x->id] && c->chunk[x->id] != chunk;
}

static uint32_t value_number(const Chunks *c, const Inst *x, uint32_t chunk, uint32_t none) {
    if (is_other(c, x, chunk)) return none + 1 + c->taken[x->id];
    return c->op[x->id] ? c->op[x->id] - 1 : none;
}

static SltChunkOp operation(const Chunks *c, const Inst *i, uint32_t chunk, bool raw) {
    SltChunkOp op = {{NONE, NONE, NONE}, -1};
    for (uint32_t a = 0; a < i->nargs; a++) op.arg[a] = value_number(c, i->args[a], chunk, NONE);
    if (!raw) return op;
    op.choice = (int32_t)c->nchoices;
    if (ir_ops[i->op].selects) op = (SltChunkOp){{op.arg[1], op.arg[2], op.arg[0]}, op.choice};
    return op;
}

static void add_operation(Chunks *c, const Inst *i, SltChunkOp op) {
    vec_push(c->fn->arena, &c->ops, op);
    vec_push(c->fn->arena, &c->exported, c->used[i->id] ? (int32_t)c->nexports : -1);
    c->op[i->id] = c->ops.len;
}

const Inst *variant_choice_comparison(const Inst *choice, uint32_t *operand) {
    for (*operand = 0; *operand < 2; ++*operand) {
        const Inst *is = choice->args[*operand];
        if (is->op == OP_flt || is->op == OP_fle) return is;
    }
    return NULL;
}

static int8_t operand_below(const Inst *choice) {
    uint32_t operand;
    return variant_choice_comparison(choice, &operand) ? (int8_t)operand : -1;
}

/* The instructions from `first` on that belong to its chunk go into an if_; returns what follows. */
static Inst *make_chunk(Chunks *c, Inst *first) {
    Fn *fn = c->fn;
    uint32_t chunk = c->chunk[first->id];
    vec_push(fn->arena, &c->first_op, c->ops.len);
    vec_push(fn->arena, &c->first_import, c->import.len);
    vec_push(fn->arena, &c->first_choice, c->nchoices);
    Builder b = ir_before(fn, first);
    Inst *guard = ir_if(&b, ir_special(&b, OP_live, TY_BOOL, 0, NULL, (Imm){.i = chunk - 1}));
    Builder then = ir_at_end(fn, guard->region[0]), other = ir_at_end(fn, guard->region[1]);
    Inst *run = ir_yield(&then, 0, NULL), *next = first;
    ir_yield(&other, 0, NULL);
    SltChunkOp choice = {0};
    for (Inst *i = first; i && i->id != UINT32_MAX && c->chunk[i->id] == chunk; i = next) {
        next = i->next;
        bool raw = is_raw(i), whole = is_whole(i);
        ir_move_before(i, run);
        Builder at = ir_before(fn, i);
        Inst *source[3] = {0}; /* numbers belong to what is taken, not to the taking */
        for (uint32_t a = 0; a < i->nargs && a < 3; a++) {
            source[a] = i->args[a];
            if (is_other(c, i->args[a], chunk)) import(c, &at, i->args[a], chunk);
        }
        if (raw) choice = operation(c, i, chunk, true);
        else if (whole) add_operation(c, i, choice);
        else if (i->tag == OPERATION) add_operation(c, i, operation(c, i, chunk, false));
        else if (i->op == OP_choice) vec_push(fn->arena, &c->below, operand_below(i));
        c->nchoices += whole;
        for (uint32_t a = 0; a < i->nargs && a < 3; a++)
            if (is_other(c, source[a], chunk)) i->args[a] = c->take[source[a]->id];
        if (!c->used[i->id]) continue;
        Imm imm = {0};
        imm.frame.which = c->nexports++, imm.frame.places = 1;
        Builder behind = ir_before(fn, run);
        ir_special(&behind, OP_give, TY_VOID, 1, &i, imm);
    }
    return next;
}

/* Uses outside all chunks, in i or below it; imports go ahead of i, which stands in the top block. */
static void use_imports(Chunks *c, Inst *i, Inst *below) {
    for (uint32_t a = 0; a < below->nargs; a++) {
        Builder b = ir_before(c->fn, i);
        if (is_other(c, below->args[a], 0)) below->args[a] = import(c, &b, below->args[a], c->nchunks + 1);
    }
    for (uint32_t r = 0; r < below->nregions; r++)
        for (Inst *j = below->region[r]->first; j; j = j->next) use_imports(c, i, j);
}

static void number(Chunks *c) {
    Arena *scratch = &c->fn->session->scratch;
    uint32_t n = ir_number(c->fn) + 1;
    c->chunk = ARENA_ARRAY(scratch, uint32_t, n), c->used = ARENA_ARRAY(scratch, bool, n);
    c->op = ARENA_ARRAY(scratch, uint32_t, n), c->seen = ARENA_ARRAY(scratch, uint32_t, n);
    c->taken = ARENA_ARRAY(scratch, uint32_t, n);
    c->stands = ARENA_ARRAY(scratch, Inst *, n), c->take = ARENA_ARRAY(scratch, Inst *, n);
}

static bool has_effects(const Block *b) {
    bool any = false;
    for (const Inst *i = b->first; i; i = i->next) {
        any |= i->op == OP_print || i->op == OP_count;
        for (uint32_t r = 0; r < i->nregions; r++) any |= has_effects(i->region[r]);
    }
    return any;
}

static const SltChunks *table(Chunks *c) {
    for (uint32_t o = 0; o < c->ops.len; o++)
        for (uint32_t a = 0; a < 3; a++)
            if (c->ops.data[o].arg[a] >= NONE) c->ops.data[o].arg[a] -= NONE - c->ops.len;
    SltChunks *t = ARENA_NEW(c->fn->arena, SltChunks);
    *t = (SltChunks){.nops = c->ops.len,
                     .nchunks = c->nchunks,
                     .nchoices = c->nchoices,
                     .nimports = c->import.len,
                     .nexports = c->nexports,
                     .op = c->ops.data,
                     .first_op = c->first_op.data,
                     .first_choice = c->first_choice.data,
                     .first_import = c->first_import.data,
                     .import = c->import.data,
                     .exported = c->exported.data,
                     .below = c->below.data,
                     .effects = has_effects(c->fn->body)};
    return t;
}

Fn *variant_chunks(PassCtx *ctx, const Fn *primal, const SltChunks **out) {
    Fn *fn = variant_clone(ctx, primal, "chunks", false);
    *out = NULL;
    if (!tag_operations(fn)) return NULL;
    ArenaMark m = arena_mark(&ctx->session->scratch);
    Chunks c = {.fn = fn};
    number(&c);
    for (Inst *i = fn->body->first, *next; i; i = next) {
        next = i->next;
        use_decorated(&c, i);
        if (i->tag == OPERATION && is_choice(i)) decorate(&c, i);
    }
    c.nchoices = 0; /* counted again, chunk by chunk, in the same order */
    number(&c);
    number_chunks(&c);
    mark_uses(&c, fn->body, 0);
    for (Inst *i = fn->body->first, *next; i; i = next)
        next = i->id != UINT32_MAX && c.chunk[i->id] ? make_chunk(&c, i) : i->next;
    vec_push(fn->arena, &c.first_op, c.ops.len);
    vec_push(fn->arena, &c.first_choice, c.nchoices);
    vec_push(fn->arena, &c.first_import, c.import.len);
    for (Inst *i = fn->body->first; i; i = i->next)
        if (i->op != OP_if_ || i->args[0]->op != OP_live) use_imports(&c, i, i);
    *out = table(&c);
    arena_reset(&ctx->session->scratch, m);
    return fn;
}

static void drop_choices(Block *b) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) drop_choices(i->region[r]);
        if (i->op == OP_choice) ir_unlink(i);
    }
}

void variant_drop_choices(Fn *fn) { drop_choices(fn->body); }
