/* What the same operations make before a loop and at the end of each iteration is made at the start of an iteration:
 *
 *     p = f(u); while (on) { ... u = next(u); p = f(u); }     becomes     while (on) { p = f(u); ... u = next(u); }
 *
 * where nobody reads the last p. `for (Piece q = m.first(beam); q.found; q = m.next(q))` is such a loop, and f all that
 * is known of a piece. Then there is one copy of f, in the value and in each sweep of its derivative. */
#include <string.h>

#include "compiler/pass/walk.h"

enum {
    LEAST = 16,   /* operations of f that are worth it */
    DEEPEST = 500 /* operations one of the other: we recur */
};

typedef struct Rotate {
    Fn *fn;
    Arena *arena;
    Inst *loop;
    Block *body;
    Inst **twin;    /* by id of what an iteration makes: the same before the loop */
    uint32_t *leaf; /* by id: 1 + the number of a carried value of which f is a function */
    uint32_t *uses; /* by id */
    bool *made;     /* by id: of f */
    bool *kept;     /* by id: of f, and wanted at the end of an iteration too */
    bool *out;      /* by number of a carried value: f makes it */
    uint32_t root;  /* the carried value that is looked at */
    uint32_t depth;
} Rotate;

static bool same_value(Rotate *r, Inst *in, Inst *before);

static bool same_imm(const Inst *x, const Inst *y) {
    if (x->op == OP_loop) {
        const LoopInfo *a = &x->imm.loop, *b = &y->imm.loop;
        return !a->cull && !b->cull && a->max_iters == b->max_iters && a->exact == b->exact && a->told == b->told;
    }
    return memcmp(&x->imm, &y->imm, sizeof x->imm) == 0;
}

static bool same_block(Rotate *r, const Block *in, const Block *before);

static bool same_inst(Rotate *r, Inst *in, Inst *before) {
    bool moves = walk_is_pure(in) || in->op == OP_if_ || in->op == OP_loop || in->op == OP_proj || in->op == OP_yield;
    if (!moves || in->op == OP_site || in->op == OP_siten || in->op != before->op || in->type != before->type ||
        in->nargs != before->nargs || !same_imm(in, before))
        return false;
    for (uint32_t a = 0; a < in->nargs; a++)
        if (!same_value(r, in->args[a], before->args[a])) return false;
    for (uint32_t g = 0; g < in->nregions; g++)
        if (!same_block(r, in->region[g], before->region[g])) return false;
    r->twin[in->id] = before;
    return true;
}

static Inst *computed(Inst *i) {
    while (i && ir_is_const(i)) i = i->next;
    return i;
}

/* Regions are compared line by line, constants where they are used: one generator wrote both. */
static bool same_block(Rotate *r, const Block *in, const Block *before) {
    if (in->nparams != before->nparams) return false;
    for (uint32_t p = 0; p < in->nparams; p++) r->twin[in->params[p]->id] = before->params[p];
    Inst *x = computed(in->first), *y = computed(before->first);
    for (; x && y; x = computed(x->next), y = computed(y->next))
        if (!same_inst(r, x, y)) return false;
    return !x && !y;
}

static bool same_value(Rotate *r, Inst *in, Inst *before) {
    if (in == before || r->twin[in->id] == before) return true;
    for (uint32_t c = 0; c < r->loop->nargs; c++) {
        if (c == r->root || r->body->last->args[c + 1] != in || r->loop->args[c] != before) continue;
        if (!r->leaf[in->id]) r->leaf[in->id] = c + 1;
        return r->leaf[in->id] == c + 1;
    }
    if (in->op == OP_arg || !walk_inside(in->block, r->body) || r->depth == DEEPEST) return false;
    r->depth++;
    bool same = same_inst(r, in, before);
    r->depth--;
    return same;
}

/* Calls `on` for each operand of i and of what its regions hold. */
static void each_operand(Rotate *r, const Inst *i, void (*on)(Rotate *, Inst *)) {
    for (uint32_t a = 0; a < i->nargs; a++) on(r, i->args[a]);
    for (uint32_t g = 0; g < i->nregions; g++)
        for (const Inst *x = i->region[g]->first; x; x = x->next) each_operand(r, x, on);
}

static bool is_leaf(const Rotate *r, const Inst *v) { return r->leaf[v->id] && !r->out[r->leaf[v->id] - 1]; }

static void make(Rotate *r, Inst *v) {
    if (v->block != r->body || v->op == OP_arg || is_leaf(r, v) || r->made[v->id]) return;
    r->made[v->id] = true;
    each_operand(r, v, make);
}

static void keep(Rotate *r, Inst *v) {
    if (!r->made[v->id] || r->kept[v->id]) return;
    r->kept[v->id] = true;
    each_operand(r, v, keep);
}

static uint32_t size_of(const Inst *i) {
    uint32_t n = !ir_is_const(i) && i->op != OP_proj;
    for (uint32_t g = 0; g < i->nregions; g++) n += walk_size(i->region[g]);
    return n;
}

/* Of what f makes, little may be wanted where it was made. */
static bool is_worth_it(Rotate *r) {
    const Inst *yield = r->body->last;
    uint32_t all = 0, twice = 0;
    for (uint32_t c = 0; c < r->loop->nargs; c++)
        if (r->out[c]) make(r, yield->args[c + 1]);
    for (const Inst *i = r->body->first; i != yield; i = i->next)
        if (!r->made[i->id]) each_operand(r, i, keep);
    keep(r, yield->args[0]);
    for (uint32_t c = 0; c < r->loop->nargs; c++)
        if (!r->out[c]) keep(r, yield->args[c + 1]);
    for (const Inst *i = r->body->first; i != yield; i = i->next) {
        if (r->made[i->id]) all += size_of(i);
        if (r->kept[i->id]) twice += size_of(i);
    }
    return all >= LEAST && twice <= all / 8;
}

/* Does it hold in every iteration, as what the loop goes on by, and is not reached without? */
static bool is_given(const Rotate *r, const Inst *i) {
    return i->type == TY_BOOL && walk_tells(r->body->last->args[0], i, true) &&
           walk_begins(r->loop, r->twin[i->id], true);
}

static void move(Rotate *r) {
    const Inst *yield = r->body->last;
    Inst **map = ARENA_ARRAY(r->arena, Inst *, r->fn->ninsts + 1);
    Builder b = ir_before(r->fn, r->body->first);
    for (const Inst *i = r->body->first; i; i = i->next)
        if (is_leaf(r, i)) map[i->id] = r->body->params[r->leaf[i->id]];
    for (Inst *i = b.before; i != yield; i = i->next)
        if (r->made[i->id] && is_given(r, i)) map[i->id] = ir_constb(&b, true);
        else if (r->made[i->id]) ir_clone_insts(&b, r->body, i, i->next, map);
    for (uint32_t c = 0; c < r->loop->nargs; c++) {
        if (!r->out[c]) continue;
        Inst *param = r->body->params[c + 1];
        walk_replace(r->body, param, map[yield->args[c + 1]->id]);
        ir_replace_arg(r->body->last, c + 1, param); /* nobody reads it: opt_dce */
    }
}

static bool is_read(const Rotate *r, uint32_t c) {
    for (const Inst *p = r->loop->next; p && p->op == OP_proj; p = p->next)
        if (p->args[0] == r->loop && p->imm.i == c && r->uses[p->id]) return true;
    return false;
}

static bool rotate(Rotate *r, Inst *loop) {
    bool some = false;
    r->loop = loop, r->body = loop->region[0];
    r->out = ARENA_ARRAY(r->arena, bool, loop->nargs + 1);
    if (loop->imm.loop.cull) return false;
    for (uint32_t c = 0; c < loop->nargs; c++) {
        Inst *last = r->body->last->args[c + 1];
        r->root = c;
        /* A flag is most often the loop's condition, wanted where it was made. */
        r->out[c] = last->type != TY_BOOL && last->op != OP_arg && last->block == r->body && !is_read(r, c) &&
                    same_inst(r, last, loop->args[c]);
        some |= r->out[c];
    }
    if (!some || !is_worth_it(r)) return false;
    move(r);
    return true;
}

static bool rotate_in(Rotate *r, Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t g = 0; g < i->nregions; g++)
            if (rotate_in(r, i->region[g])) return true;
        if (i->op == OP_loop && rotate(r, i)) return true;
    }
    return false;
}

bool opt_rotate(PassCtx *ctx, Fn *fn) {
    Arena *scratch = &ctx->session->scratch;
    bool changed = false;
    for (bool again = ir_has(fn->body, OP_loop); again;) {
        ArenaMark m = arena_mark(scratch);
        const uint32_t n = ir_number(fn) + 1;
        Rotate r = {.fn = fn, .arena = scratch};
        r.twin = ARENA_ARRAY(scratch, Inst *, n), r.leaf = ARENA_ARRAY(scratch, uint32_t, n);
        r.uses = ARENA_ARRAY(scratch, uint32_t, n);
        r.made = ARENA_ARRAY(scratch, bool, n), r.kept = ARENA_ARRAY(scratch, bool, n);
        ir_count_uses(fn->body, r.uses);
        again = rotate_in(&r, fn->body);
        changed |= again;
        arena_reset(scratch, m);
    }
    return changed;
}
