/* Loops of few iterations around loops with lists, written out: the bounces of a ray, each of which looks for what it
 * meets. One list for all of them is of what any may meet, and what bounds know of the first, whose rays leave one eye,
 * is lost in what they do not know of the last. Of images alone, once these have lists. */
#include "compiler/pass/variant.h"

enum { MOST_ITERATIONS = 4, MOST_SIZE = 1024 /* instructions in all */ };

static uint32_t count_found(const Block *b) {
    uint32_t n = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        n += i->op == OP_loop && i->imm.loop.cull && i->imm.loop.found;
        for (uint32_t r = 0; r < i->nregions; r++) n += count_found(i->region[r]);
    }
    return n;
}

/* Room: for how many lists. */
static bool is_written(const Inst *i, uint32_t room) {
    if (i->op != OP_loop || i->imm.loop.cull || i->imm.loop.max_iters > MOST_ITERATIONS) return false;
    const uint32_t more = i->imm.loop.max_iters - 1, lists = count_found(i->region[0]);
    return more && lists && more * lists <= room && (more + 1) * walk_size(i->region[0]) <= MOST_SIZE;
}

static void count_lists(const Block *b, uint32_t counts[SLT_MAX_CULL], uint32_t *n) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_loop && i->imm.loop.cull && i->imm.loop.found) counts[(*n)++] = i->imm.loop.max_iters;
        for (uint32_t r = 0; r < i->nregions; r++) count_lists(i->region[r], counts, n);
    }
}

static void count_written(const Block *b, uint32_t counts[SLT_MAX_CULL], uint32_t *n) {
    for (const Inst *i = b->first; i; i = i->next) {
        const bool written = is_written(i, SLT_MAX_CULL - *n);
        for (uint32_t k = 1; written && k < i->imm.loop.max_iters; k++) count_lists(i->region[0], counts, n);
        for (uint32_t r = 0; r < i->nregions && !written; r++) count_written(i->region[r], counts, n);
    }
}

void variant_written_lists(const Fn *primal, uint32_t counts[SLT_MAX_CULL], uint32_t *n) {
    count_written(primal->body, counts, n);
}

static uint32_t size_written(const Block *b) {
    uint32_t n = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        const uint32_t times = is_written(i, SLT_MAX_CULL) ? i->imm.loop.max_iters : 1;
        n += !ir_is_const(i) && i->op != OP_proj && i->op != OP_yield;
        for (uint32_t r = 0; r < i->nregions; r++) n += times * size_written(i->region[r]);
    }
    return n;
}

uint32_t variant_written_size(const Fn *primal) { return size_written(primal->body); }

/* In the order of count_lists. */
static void number_lists(Block *b, uint32_t *next) {
    for (Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_loop && i->imm.loop.cull && i->imm.loop.found) i->imm.loop.cull_id = (*next)++;
        for (uint32_t r = 0; r < i->nregions; r++) number_lists(i->region[r], next);
    }
}

typedef struct Writer {
    Fn *fn;
    Inst *loop;
    uint32_t nmap, next; /* next: the first list that is free */
} Writer;

/* Iteration k and those behind it: `in` and `out` are what is carried. */
static void write_from(Writer *w, Builder *b, uint32_t k, Inst *const *in, Inst **out) {
    const Inst *loop = w->loop;
    Block *body = loop->region[0];
    Arena *scratch = &w->fn->session->scratch;
    Inst **map = ARENA_ARRAY(scratch, Inst *, w->nmap), **then = ARENA_ARRAY(scratch, Inst *, loop->nargs + 1);
    if (k) number_lists(body, &w->next);
    map[body->params[0]->id] = ir_consti(b, (int32_t)k);
    for (uint32_t c = 0; c < loop->nargs; c++) map[body->params[c + 1]->id] = in[c];
    ir_clone_insts(b, body, body->first, body->last, map);
    Inst *const *yields = body->last->args, *goes_on = map[yields[0]->id] ? map[yields[0]->id] : yields[0];
    for (uint32_t c = 0; c < loop->nargs; c++)
        then[c] = map[yields[c + 1]->id] ? map[yields[c + 1]->id] : yields[c + 1];
    if (k + 1 == loop->imm.loop.max_iters) {
        for (uint32_t c = 0; c < loop->nargs; c++) out[c] = then[c];
        return;
    }
    Inst *more = ir_if(b, goes_on);
    Builder on = ir_at_end(w->fn, more->region[0]), off = ir_at_end(w->fn, more->region[1]);
    write_from(w, &on, k + 1, then, out);
    ir_yield(&on, loop->nargs, out);
    ir_yield(&off, loop->nargs, then);
    for (uint32_t c = 0; c < loop->nargs; c++) out[c] = ir_proj(b, more, c);
}

static void write_out(Fn *fn, Inst *loop, uint32_t *next) {
    Arena *scratch = &fn->session->scratch;
    ArenaMark m = arena_mark(scratch);
    Writer w = {.fn = fn, .loop = loop, .next = *next};
    Builder b = ir_before(fn, loop);
    Inst **out = ARENA_ARRAY(scratch, Inst *, loop->nargs + 1);
    w.nmap = ir_number(fn) + 1;
    write_from(&w, &b, 0, loop->args, out);
    *next = w.next;
    for (Inst *p = loop->next, *after; p && p->op == OP_proj && p->args[0] == loop; p = after) {
        after = p->next;
        walk_forward(fn, p, out[p->imm.i]);
    }
    ir_unlink(loop);
    arena_reset(scratch, m);
    walk_resolve_forwards(fn->body);
}

static bool write_block(Fn *fn, Block *b, uint32_t *next) {
    bool any = false;
    for (Inst *i = b->first, *after; i; i = after) {
        const bool written = is_written(i, SLT_MAX_CULL - *next);
        for (uint32_t r = 0; r < i->nregions && !written; r++) any |= write_block(fn, i->region[r], next);
        after = i->next;
        if (!written) continue;
        while (after && after->op == OP_proj && after->args[0] == i) after = after->next;
        write_out(fn, i, next);
        any = true;
    }
    return any;
}

static void count_ids(const Block *b, uint32_t *n) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_loop && i->imm.loop.cull && i->imm.loop.cull_id >= *n) *n = i->imm.loop.cull_id + 1;
        for (uint32_t r = 0; r < i->nregions; r++) count_ids(i->region[r], n);
    }
}

const Fn *variant_written(PassCtx *ctx, const Fn *primal) {
    uint32_t next = ctx->program ? ctx->program->ncull : 0;
    count_ids(primal->body, &next);
    Fn *fn = ir_clone(primal, primal->arena, primal->name);
    if (!write_block(fn, fn->body, &next)) return primal;
    variant_drop_sites(fn);
    fn->nsites = 0;
    opt_fold(ctx, fn), opt_cse(ctx, fn), opt_dce(ctx, fn);
    return fn;
}
