/* Common subexpressions by value numbering over the scopes: an instruction that a visible one already computes is
 * replaced by it. Pure operations only; parameters are constant memory, so their loads count as pure. Sites are told
 * apart by their number and never merged with others. */
#include <string.h>

#include "compiler/pass/walk.h"

typedef struct Entry {
    Inst *inst;
    struct Entry *next;
    uint32_t hash;
} Entry;

typedef struct Cse {
    Fn *fn;
    Arena *arena;
    Entry **table;
    uint32_t mask;
    Inst **map;
    Vec(uint32_t) undo; /* buckets touched, to leave a scope */
    bool changed;
} Cse;

static uint32_t hash_of(const Inst *i) {
    uint32_t h = ir_mix(i->op * 31u + i->type, i->nargs);
    for (uint32_t a = 0; a < i->nargs; a++) h = ir_mix(h, i->args[a]->id);
    if (!ir_ops[i->op].special) return h;
    uint64_t bits[sizeof i->imm / 8 + 1] = {0};
    memcpy(bits, &i->imm, sizeof i->imm);
    for (uint32_t w = 0; w < sizeof bits / 8; w++) h = ir_mix(ir_mix(h, (uint32_t)bits[w]), (uint32_t)(bits[w] >> 32));
    return h;
}

static bool equal(const Inst *x, const Inst *y) {
    if (x->op != y->op || x->type != y->type || x->nargs != y->nargs) return false;
    if (ir_ops[x->op].special && memcmp(&x->imm, &y->imm, sizeof x->imm) != 0) return false;
    for (uint32_t a = 0; a < x->nargs; a++)
        if (x->args[a] != y->args[a]) return false;
    return true;
}

static void cse_block(Cse *c, Block *b) {
    uint32_t level = c->undo.len;
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        walk_remap(i, c->map);
        for (uint32_t r = 0; r < i->nregions; r++) cse_block(c, i->region[r]);
        if (i->nregions || !walk_is_pure(i)) continue;
        uint32_t h = hash_of(i);
        Entry *e = c->table[h & c->mask];
        while (e && !(e->hash == h && equal(e->inst, i))) e = e->next;
        if (e) {
            c->map[i->id] = e->inst;
            ir_unlink(i);
            c->changed = true;
            continue;
        }
        e = ARENA_NEW(c->arena, Entry);
        *e = (Entry){i, c->table[h & c->mask], h};
        c->table[h & c->mask] = e;
        vec_push(c->arena, &c->undo, h & c->mask);
    }
    while (c->undo.len > level) {
        uint32_t bucket = c->undo.data[--c->undo.len];
        c->table[bucket] = c->table[bucket]->next;
    }
}

bool opt_cse(PassCtx *ctx, Fn *fn) {
    ArenaMark m = arena_mark(&ctx->session->scratch);
    Cse c = {.fn = fn, .arena = &ctx->session->scratch};
    uint32_t n = ir_number(fn) + 1, size = 64;
    while (size < n) size *= 2;
    c.mask = size - 1;
    c.table = ARENA_ARRAY(c.arena, Entry *, size);
    c.map = ARENA_ARRAY(c.arena, Inst *, n);
    cse_block(&c, fn->body);
    arena_reset(&ctx->session->scratch, m);
    return c.changed;
}
