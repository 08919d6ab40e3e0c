/* Tiny loops with a constant trip count are written out: at most 8 iterations and 96 instructions in all. Not those
 * with sites: an event is a site and its loop indices, and a site stands in one place. */
#include "compiler/pass/walk.h"

enum { MAX_ITERS = 8, MAX_INSTS = 96 };

static void unroll(Fn *fn, Inst *loop) {
    Block *body = loop->region[0];
    uint32_t n = loop->imm.loop.max_iters, nc = loop->nargs;
    Arena *scratch = &fn->session->scratch;
    ArenaMark m = arena_mark(scratch);
    Inst **carried = ARENA_ARRAY(scratch, Inst *, nc + 1);
    for (uint32_t c = 0; c < nc; c++) carried[c] = loop->args[c];
    ir_number(fn);
    uint32_t nmap = fn->ninsts + 1;
    Inst **map = ARENA_ARRAY(scratch, Inst *, nmap);
    for (uint32_t k = 0; k < n; k++) {
        for (uint32_t j = 0; j < nmap; j++) map[j] = NULL;
        Builder b = ir_before(fn, loop);
        map[body->params[0]->id] = ir_consti(&b, (int32_t)k);
        for (uint32_t c = 0; c < nc; c++) map[body->params[c + 1]->id] = carried[c];
        ir_clone_insts(&b, body, body->first, body->last, map);
        for (uint32_t c = 0; c < nc; c++) {
            Inst *v = body->last->args[c + 1];
            carried[c] = map[v->id] ? map[v->id] : v;
        }
    }
    for (Inst *p = loop->next, *next; p && p->op == OP_proj && p->args[0] == loop; p = next) {
        next = p->next;
        walk_forward(fn, p, carried[p->imm.i]);
    }
    ir_unlink(loop);
    arena_reset(scratch, m);
}

static bool has_site(const Block *b) { return ir_has(b, OP_site) || ir_has(b, OP_siten); }

static bool unroll_block(Fn *fn, Block *b) {
    bool changed = false;
    for (Inst *i = b->first, *next; i; i = next) {
        for (uint32_t r = 0; r < i->nregions; r++) changed |= unroll_block(fn, i->region[r]);
        next = i->next;
        if (i->op != OP_loop || !i->imm.loop.exact || i->imm.loop.cull) continue;
        uint32_t n = i->imm.loop.max_iters;
        if (n > MAX_ITERS || n * walk_size(i->region[0]) > MAX_INSTS || has_site(i->region[0])) continue;
        while (next && next->op == OP_proj && next->args[0] == i) next = next->next;
        walk_resolve_forwards(fn->body); /* ids of forwarded values are stale */
        unroll(fn, i);
        changed = true;
    }
    return changed;
}

bool opt_unroll(PassCtx *ctx, Fn *fn) {
    (void)ctx;
    bool changed = unroll_block(fn, fn->body);
    if (changed) walk_resolve_forwards(fn->body);
    return changed;
}
