/* Dense layers: several neurons at a time. In
 *
 *     for k { s = bias[k]; for j { s += w[k][j] * h[j]; } out += act(s); }
 *
 * the loop over j runs once for four neighbouring k, side by side: h[j] is read once for them, and four sums grow that
 * do not wait for each other. Each sum is added up in its own order, and what follows the inner loop runs neuron after
 * neuron: no float changes.
 *
 * Not where there are sites: an event is a site and its loop indices. */
#include "compiler/pass/walk.h"

enum { MAX_INSTS = 256 /* of the body, written out */, MAX_SUMS = 12 };

/* Tags. Of the outer body: BEHIND needs what an iteration hands to the next, or the results of the inner loop. Of the
 * inner: OWN differs from neuron to neuron. */
enum { BEFORE, BEHIND, OWN };

static bool is_tame(const Inst *i) {
    return walk_is_pure(i) || i->op == OP_param || i->op == OP_iparam || i->op == OP_load;
}

static bool uses(const Block *b, Op op, const Inst *array) {
    for (const Inst *i = b->first; i; i = i->next)
        if (i->op == op && i->args[0] == array) return true;
    return false;
}

static bool has(const Inst *i, uint32_t tag, const Block *within) {
    for (uint32_t j = 0; j < i->nargs; j++)
        if (i->args[j]->tag == tag && walk_inside(i->args[j]->block, within)) return true;
    return false;
}

/* Does the inner loop read an array at places that are the same for every neuron? Only then there is something to
 * share. */
static bool shares(const Block *body, const Block *in) {
    bool any = false;
    for (Inst *i = in->first; i; i = i->next) {
        for (uint32_t j = 0; j < i->nargs; j++) {
            const Block *b = i->args[j]->block;
            if (i->args[j]->tag == OWN || (walk_inside(b, body) && !walk_inside(b, in) && !ir_is_const(i->args[j])))
                i->tag = OWN;
        }
        any |= i->op == OP_load && i->tag != OWN;
    }
    return any;
}

/* The one loop in the body of `outer`, if the two can be jammed; tags say which instructions are BEHIND. */
static Inst *inner_of(Inst *outer) {
    Block *body = outer->region[0];
    Inst *inner = NULL;
    if (outer->op != OP_loop || !outer->imm.loop.exact || outer->imm.loop.cull) return NULL;
    for (Inst *i = body->first; i; i = i->next)
        if (i->op == OP_loop && !inner) inner = i;
        else if (!is_tame(i) && i->op != OP_store && i->op != OP_proj && i->op != OP_yield && !ir_is_const(i))
            return NULL;
    if (!inner || !inner->imm.loop.exact || inner->imm.loop.cull || inner->imm.loop.max_iters < 4) return NULL;
    for (const Inst *i = inner->region[0]->first; i; i = i->next)
        if (!is_tame(i) && i->op != OP_yield && !ir_is_const(i)) return NULL;
    walk_clear_tags(body);
    for (uint32_t c = 1; c < body->nparams; c++) body->params[c]->tag = BEHIND;
    bool past = false;
    for (Inst *i = body->first; i; i = i->next) {
        past |= i == inner;
        if (i->op == OP_store || i->op == OP_yield || (past && i->op == OP_proj) || (past && i->op == OP_load))
            i->tag = BEHIND;
        if (has(i, BEHIND, body)) i->tag = BEHIND;
        if (i->op == OP_store && (!past || uses(inner->region[0], OP_load, i->args[0]))) return NULL;
        if (i->op == OP_load && i->tag == BEFORE && uses(body, OP_store, i->args[0])) return NULL;
    }
    for (const Inst *i = inner->region[0]->first; i; i = i->next)
        if (has(i, BEHIND, body)) return NULL;
    return inner->tag == BEHIND || !shares(body, inner->region[0]) ? NULL : inner;
}

static uint32_t factor(const Inst *outer, const Inst *inner) {
    static const uint32_t by[] = {4, 3, 2};
    uint32_t size = walk_size(outer->region[0]);
    for (uint32_t k = 0; k < sizeof by / sizeof *by; k++)
        if (outer->imm.loop.max_iters % by[k] == 0 && by[k] * size <= MAX_INSTS && by[k] * inner->nargs <= MAX_SUMS)
            return by[k];
    return 1;
}

static void clone_tagged(Builder *b, const Block *body, Inst *inner, uint32_t tag, Inst **map) {
    for (Inst *i = body->first; i; i = i->next)
        if (i != inner && i->tag == tag && i->op != OP_proj && i->op != OP_yield)
            ir_clone_insts(b, body, i, i->next, map);
}

static Inst *mapped(Inst *const *map, Inst *v) { return map[v->id] ? map[v->id] : v; }

static void jam(Fn *fn, Inst *outer, Inst *inner, uint32_t f) {
    Block *body = outer->region[0], *in = inner->region[0];
    Arena *scratch = &fn->session->scratch;
    ArenaMark m = arena_mark(scratch);
    ir_number(fn);
    Inst ***map = ARENA_ARRAY(scratch, Inst **, f);
    for (uint32_t q = 0; q < f; q++) map[q] = ARENA_ARRAY(scratch, Inst *, fn->ninsts + 1);

    Builder at = ir_before(fn, outer);
    LoopInfo info = outer->imm.loop;
    info.max_iters /= f;
    Inst *made = ir_loop(&at, outer->nargs, outer->args, info);
    Builder b = ir_at_end(fn, made->region[0]);
    Inst *first = ir_emit2(&b, OP_imul, made->region[0]->params[0], ir_consti(&b, (int32_t)f));
    uint32_t n = inner->nargs;
    Inst **init = ARENA_ARRAY(scratch, Inst *, f * n + 1), **next = ARENA_ARRAY(scratch, Inst *, f * n + 1);
    for (uint32_t q = 0; q < f; q++) {
        map[q][body->params[0]->id] = ir_emit2(&b, OP_iadd, first, ir_consti(&b, (int32_t)q));
        clone_tagged(&b, body, inner, BEFORE, map[q]);
        for (uint32_t c = 0; c < n; c++) init[q * n + c] = mapped(map[q], inner->args[c]);
    }

    Inst *jammed = ir_loop(&b, f * n, init, inner->imm.loop), *flag = NULL;
    Builder t = ir_at_end(fn, jammed->region[0]);
    for (uint32_t q = 0; q < f; q++) {
        map[q][in->params[0]->id] = jammed->region[0]->params[0];
        for (uint32_t c = 0; c < n; c++) map[q][in->params[c + 1]->id] = jammed->region[0]->params[1 + q * n + c];
        ir_clone_insts(&t, in, in->first, in->last, map[q]);
        for (uint32_t c = 0; c < n; c++) next[1 + q * n + c] = mapped(map[q], in->last->args[c + 1]);
        if (!q) flag = mapped(map[q], in->last->args[0]);
    }
    next[0] = flag;
    ir_yield(&t, f * n + 1, next);

    Inst **carried = ARENA_ARRAY(scratch, Inst *, outer->nargs + 2);
    for (uint32_t c = 0; c < outer->nargs; c++) carried[c + 1] = made->region[0]->params[c + 1];
    for (uint32_t q = 0; q < f; q++) {
        for (uint32_t c = 0; c < outer->nargs; c++) map[q][body->params[c + 1]->id] = carried[c + 1];
        for (Inst *p = inner->next; p && p->op == OP_proj && p->args[0] == inner; p = p->next)
            map[q][p->id] = ir_proj(&b, jammed, (uint32_t)p->imm.i + q * n);
        clone_tagged(&b, body, inner, BEHIND, map[q]);
        for (uint32_t c = 0; c < outer->nargs; c++) carried[c + 1] = mapped(map[q], body->last->args[c + 1]);
    }
    carried[0] = ir_emit2(&b, OP_ilt, made->region[0]->params[0], ir_consti(&b, (int32_t)info.max_iters - 1));
    ir_yield(&b, outer->nargs + 1, carried);
    for (Inst *p = outer->next, *after; p && p->op == OP_proj && p->args[0] == outer; p = after) {
        after = p->next;
        walk_forward(fn, p, ir_proj(&at, made, (uint32_t)p->imm.i));
    }
    ir_unlink(outer);
    arena_reset(scratch, m);
}

static bool jam_block(Fn *fn, Block *b) {
    bool changed = false;
    for (Inst *i = b->first, *next; i; i = next) {
        for (uint32_t r = 0; r < i->nregions; r++) changed |= jam_block(fn, i->region[r]);
        next = i->next;
        if (i->op != OP_loop) continue;
        Inst *inner = inner_of(i);
        uint32_t f = inner ? factor(i, inner) : 1;
        if (f == 1) continue;
        while (next && next->op == OP_proj && next->args[0] == i) next = next->next;
        walk_resolve_forwards(fn->body); /* ids of forwarded values are stale */
        jam(fn, i, inner, f);
        changed = true;
    }
    return changed;
}

bool opt_jam(PassCtx *ctx, Fn *fn) {
    (void)ctx;
    bool changed = jam_block(fn, fn->body);
    if (changed) walk_resolve_forwards(fn->body);
    return changed;
}
