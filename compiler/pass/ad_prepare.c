/* Reverse mode, before the sweep: shapes that the sweep does not know become ones that it knows. Values stay. */
#include <string.h>

#include "compiler/pass/ad.h"

/* ---- customs: both regions are inlined. The tangent region runs at tangents that are 0 but "vary as" the arguments,
 * and each result takes its derivative from the tangent region's: links say so. Since the tangent region is linear in
 * its tangents, reversing it is transposing it. */

static Inst *detached(Builder *b, Inst *v) {
    return v->type == TY_FLT && !ir_is_const(v) ? ir_emit1(b, OP_detach, v) : v;
}

static uint32_t link_to(Arena *scratch, AdLinks *links, Inst *target) {
    vec_push(scratch, &links->v, target);
    return links->v.len;
}

/* Everything a cloned region reads from outside itself is a constant for it, parameters included. */
static void detach_params(Fn *fn, Block *b) {
    for (Inst *i = b->first; i; i = i->next)
        for (uint32_t r = 0; r < i->nregions; r++) detach_params(fn, i->region[r]);
    for (Inst *i = b->first; i; i = i->next)
        for (uint32_t a = 0; a < i->nargs; a++) {
            Inst *v = i->args[a];
            if (v->type != TY_FLT || i->op == OP_detach) continue;
            if (v->op != OP_param && v->op != OP_input) continue;
            Builder at = ir_before(fn, i);
            ir_replace_arg(i, a, ir_emit1(&at, OP_detach, v));
        }
}

static void detach_outside(Fn *fn, Block *b, const Block *region) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = 0; a < i->nargs; a++) {
            Inst *v = i->args[a];
            if (v->type != TY_FLT || i->op == OP_detach || walk_inside(v->block, region) || ir_is_const(v)) continue;
            Builder at = ir_before(fn, i);
            ir_replace_arg(i, a, ir_emit1(&at, OP_detach, v));
        }
        for (uint32_t r = 0; r < i->nregions; r++) detach_outside(fn, i->region[r], region);
    }
}

static void inline_region(Builder *b, Block *region, Inst **args, uint32_t nargs, Inst **results) {
    Block *to = region;
    for (uint32_t p = 0; p < nargs; p++) walk_replace(to, to->params[p], args[p]);
    Inst *yield = to->last;
    for (uint32_t r = 0; r < yield->nargs; r++) results[r] = yield->args[r];
    walk_splice(to, b->before);
}

static void expand_custom(Fn *fn, Arena *scratch, AdLinks *links, Inst *i) {
    Builder b = ir_before(fn, i);
    uint32_t n = i->nargs, nresults = i->region[0]->last->nargs, ntangents = i->region[1]->last->nargs;
    Inst **args = ARENA_ARRAY(scratch, Inst *, 2 * n + 1);
    Inst **values = ARENA_ARRAY(scratch, Inst *, nresults + 1),
         **tangents = ARENA_ARRAY(scratch, Inst *, ntangents + 1);
    for (uint32_t r = 0; r < 2; r++) {
        detach_params(fn, i->region[r]);
        detach_outside(fn, i->region[r], i->region[r]);
    }
    for (uint32_t a = 0; a < n; a++) args[a] = detached(&b, i->args[a]);
    uint32_t nt = n;
    for (uint32_t a = 0; a < n; a++) {
        if (i->args[a]->type != TY_FLT) continue;
        Inst *t = ir_emit1(&b, OP_detach, ir_constf(&b, 0));
        t->tag = link_to(scratch, links, i->args[a]);
        args[nt++] = t;
    }
    inline_region(&b, i->region[0], args, n, values);
    inline_region(&b, i->region[1], args, nt, tangents);
    uint32_t *at = ARENA_ARRAY(scratch, uint32_t, nresults + 1), nfloat = 0;
    for (uint32_t r = 0; r < nresults; r++) {
        at[r] = ntangents == nresults ? r : nfloat;
        nfloat += values[r]->type == TY_FLT;
    }
    for (Inst *p = i->next, *next; p && p->op == OP_proj && p->args[0] == i; p = next) {
        next = p->next;
        Inst *v = values[p->imm.i];
        if (p->type == TY_FLT) {
            v = ir_emit1(&b, OP_detach, v);
            v->tag = link_to(scratch, links, tangents[at[p->imm.i]]);
        }
        walk_replace(fn->body, p, v);
        for (uint32_t k = 0; k < links->v.len; k++)
            if (links->v.data[k] == p) links->v.data[k] = v;
        ir_unlink(p);
    }
    ir_unlink(i);
}

static void expand_in(Fn *fn, Arena *scratch, AdLinks *links, Block *b) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) expand_in(fn, scratch, links, i->region[r]);
        if (i->op != OP_custom) continue;
        while (next && next->op == OP_proj && next->args[0] == i) next = next->next;
        expand_custom(fn, scratch, links, i);
    }
}

void ad_expand_customs(Fn *fn, Arena *scratch, AdLinks *links) { expand_in(fn, scratch, links, fn->body); }

/* ---- inputs: one instruction for each component of x, in the top block, so that its adjoint has one place */

static void hoist_in(Fn *fn, Block *b, Inst **x, Inst **map) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) hoist_in(fn, i->region[r], x, map);
        if (i->op != OP_input || i->imm.i < IN_X0 || i->imm.i > IN_X2) continue;
        Inst **home = &x[i->imm.i - IN_X0];
        if (!*home) {
            Builder top = {.fn = fn, .block = fn->body, .before = fn->body->first, .span = i->span};
            *home = ir_input(&top, (InputSlot)i->imm.i);
        }
        map[i->id] = *home;
        ir_unlink(i);
    }
}

void ad_hoist_inputs(Fn *fn, Arena *scratch) {
    Inst *x[3] = {0}, **map = ARENA_ARRAY(scratch, Inst *, ir_number(fn) + 1);
    hoist_in(fn, fn->body, x, map);
    ir_replace_all(fn, map);
}

/* ---- ifs that hold loops. A mixed vector runs then, else; both would push frames of different shapes on one stack. So
 * if (c) {A} else {B} becomes if (c) {A}; if (!c) {B}: at most one region of an if pushes. */

static bool holds_taped(const Block *b, const uint8_t *taped) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_loop && i->id != UINT32_MAX && taped[i->id]) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (holds_taped(i->region[r], taped)) return true;
    }
    return false;
}

static void split_if(Fn *fn, Inst *i) {
    Builder b = ir_before(fn, i);
    Inst *first = ir_if(&b, i->args[0]);
    Block *then = i->region[0], *none = i->region[1];
    uint32_t n = then->last->nargs;
    /* the new if takes the then region, the old one keeps the else region, its results and its users */
    Block *spare = first->region[0];
    first->region[0] = then;
    then->owner = first;
    Builder e = ir_at_end(fn, first->region[1]);
    Inst **zeros = ARENA_ARRAY(fn->arena, Inst *, n + 1);
    for (uint32_t r = 0; r < n; r++) zeros[r] = ir_zero(&e, (IrType)then->last->args[r]->type);
    ir_yield(&e, n, zeros);
    Builder after = ir_before(fn, i);
    Inst **results = ARENA_ARRAY(fn->arena, Inst *, n + 1);
    for (uint32_t r = 0; r < n; r++) results[r] = ir_proj(&after, first, r);
    after = ir_before(fn, i);
    ir_replace_arg(i, 0, ir_emit1(&after, OP_bnot, i->args[0]));
    i->region[0] = none;
    i->region[1] = spare;
    spare->owner = i;
    Builder s = ir_at_end(fn, spare);
    ir_yield(&s, n, results);
}

static bool split_in(Fn *fn, Block *b, const uint8_t *taped) {
    bool changed = false;
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) changed |= split_in(fn, i->region[r], taped);
        if (i->op == OP_if_ && holds_taped(i->region[0], taped) && holds_taped(i->region[1], taped))
            split_if(fn, i), changed = true;
    }
    return changed;
}

bool ad_split_ifs(Fn *fn, const uint8_t *taped) { return split_in(fn, fn->body, taped); }

/* ---- strip-mining: for (k < n) body  ->  for (s < ceil(n/B)) for (j < B) body with k = s*B + j, left by the same
 * breaks in the same state. The inner loop is a segment: the sweep pushes only the state at its start, and runs it
 * again, pushing, when it gets there. */

static bool writes_outside(const Block *b, const Block *loop) {
    for (const Inst *i = b->first; i; i = i->next) {
        if ((i->op == OP_store || i->op == OP_acopy) && !walk_inside(i->args[0]->block, loop)) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (writes_outside(i->region[r], loop)) return true;
    }
    return false;
}

bool ad_strip_mine(Fn *fn, Inst *loop, uint32_t segment) {
    LoopInfo info = loop->imm.loop;
    Block *old = loop->region[0];
    uint32_t n = info.max_iters, nseg = (n + segment - 1) / segment, carried = loop->nargs;
    if ((info.cull && !info.found) || segment < 2 || nseg < 2 || writes_outside(old, old)) return false;

    bool listed = info.cull;
    info.cull = loop->imm.loop.cull = false; /* the two loops go over places of the list */
    Builder before = ir_before(fn, loop);
    loop->region[0] = NULL;
    loop->nregions = 0;
    Block *outer = ir_block(fn, loop);
    loop->imm.loop.max_iters = nseg;
    Inst *s = ir_block_param(fn, outer, TY_INT);
    Inst **state = ARENA_ARRAY(fn->arena, Inst *, carried + 1);
    for (uint32_t c = 0; c < carried; c++) state[c] = ir_block_param(fn, outer, (IrType)loop->args[c]->type);
    Builder b = {.fn = fn, .block = outer, .span = loop->span};
    Inst *base = ir_emit2(&b, OP_imul, s, ir_consti(&b, (int32_t)segment));
    Inst *last_segment = ir_emit2(&b, OP_ilt, s, ir_consti(&b, (int32_t)nseg - 1));
    state[carried] = ir_constb(&b, true);

    LoopInfo inner_info = info;
    inner_info.max_iters = segment;
    inner_info.exact = info.exact && n % segment == 0 && !listed;
    if (listed) loop->imm.loop.exact = false;
    Inst *inner = ir_loop(&b, carried + 1, state, inner_info);
    inner->tag = AD_TAG_SEGMENT | loop->tag;
    loop->tag = 0;
    inner->region[0] = old;
    old->owner = inner;
    ir_block_param(fn, old, TY_BOOL); /* whether the loop wanted to go on */
    Inst *j = old->params[0];
    Builder top = {.fn = fn, .block = old, .before = old->first, .span = loop->span};
    Inst *place = ir_emit2(&top, OP_iadd, base, j), *k = place;
    if (listed) k = ir_special(&top, OP_item, TY_INT, 1, &place, (Imm){.i = info.cull_id});
    walk_replace(old, j, k);
    place->args[0] = base;
    place->args[1] = j;
    if (listed) k->args[0] = place;
    Inst *yield = old->last;
    Builder end = ir_at_end(fn, old);
    Inst *go = yield->args[0];
    Inst *on = ir_emit2(&end, OP_band, go, ir_emit2(&end, OP_ilt, j, ir_consti(&end, (int32_t)segment - 1)));
    Inst *many = NULL;
    if (listed) {
        Inst *all = ir_consti(&before, (int32_t)n);
        many = ir_special(&before, OP_items, TY_INT, 1, &all, (Imm){.i = info.cull_id});
        Inst *next_place = ir_emit2(&end, OP_iadd, place, ir_consti(&end, 1));
        on = ir_emit2(&end, OP_band, on, ir_emit2(&end, OP_ilt, next_place, many));
    } else if (n % segment) {
        on = ir_emit2(&end, OP_band, on, ir_emit2(&end, OP_ilt, k, ir_consti(&end, (int32_t)n - 1)));
    }
    ir_replace_arg(yield, 0, on);
    ir_append_arg(fn, yield, go);

    Inst **next = ARENA_ARRAY(fn->arena, Inst *, carried + 2);
    Builder after = ir_at_end(fn, outer);
    for (uint32_t c = 0; c <= carried; c++) next[c + 1] = ir_proj(&after, inner, c);
    after = ir_at_end(fn, outer);
    next[0] = ir_emit2(&after, OP_band, next[carried + 1], last_segment);
    if (listed) {
        Inst *next_base = ir_emit2(&after, OP_iadd, base, ir_consti(&after, (int32_t)segment));
        next[0] = ir_emit2(&after, OP_band, next[0], ir_emit2(&after, OP_ilt, next_base, many));
    }
    ir_yield(&after, carried + 1, next);
    return true;
}
