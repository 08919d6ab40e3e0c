/* Emitting, local variables as SSA, structure, and what is known about integers. */
#include <string.h>

#include "compiler/front/gen/internal.h"

/* ---- emitting: every instruction that is not a constant counts towards the limit */

static Inst *counted(Lower *l, Inst *i) {
    if (!ir_is_const(i) && ++l->nops > IR_MAX_OPS) gen_too_large(l, l->b.span);
    return i;
}
Inst *op1(Lower *l, Op op, Inst *a) { return counted(l, ir_emit1(&l->b, op, a)); }
Inst *op2(Lower *l, Op op, Inst *a, Inst *b) { return counted(l, ir_emit2(&l->b, op, a, b)); }
Inst *op3(Lower *l, Op op, Inst *a, Inst *b, Inst *c) { return counted(l, ir_emit3(&l->b, op, a, b, c)); }
Inst *special(Lower *l, Op op, IrType t, uint32_t n, Inst *const *args, Imm imm) {
    return counted(l, ir_special(&l->b, op, t, n, args, imm));
}
Inst *kf(Lower *l, double v) { return ir_constf(&l->b, v); }
Inst *ki(Lower *l, int64_t v) { return ir_consti(&l->b, (int32_t)v); }
Inst *kb(Lower *l, bool v) { return ir_constb(&l->b, v); }
Inst *sel(Lower *l, Inst *c, Inst *x, Inst *y) { return counted(l, ir_select(&l->b, c, x, y)); }

Inst *alloc_array(Lower *l, IrType elem, uint32_t count) {
    return special(l, OP_alloc, TY_ARRAY, 0, NULL, (Imm){.arr = {count, elem}});
}

/* ---- variables */

Var *var_new(Lower *l, IrType t, uint32_t n) {
    Var *v = ARENA_ARRAY(l->arena, Var, n ? n : 1);
    for (uint32_t i = 0; i < n; i++) v[i].type = t, v[i].born = l->clock;
    l->clock++;
    return v;
}

Var *vars_for(Lower *l, Type *t) {
    const Layout *layout = gen_layout(l, t);
    Var *v = var_new(l, TY_VOID, layout->n);
    for (uint32_t i = 0; i < layout->n; i++) {
        const LeafType *leaf = &layout->leaf[i];
        v[i].type = leaf->count ? TY_ARRAY : leaf->type;
        if (leaf->count) v[i].value = alloc_array(l, leaf->type, leaf->count);
    }
    return v;
}

/* A variable that a jump left unassigned is never read for its value: zero stands for it. */
Inst *var_get(Lower *l, Var *v) { return v->value ? v->value : ir_zero(&l->b, v->type); }

void var_set(Lower *l, Var *v, Inst *x) {
    if (v->value == x) return;
    vec_push(l->arena, &l->journal, ((Change){v, v->value}));
    v->value = x;
}

/* A variable that exists from the start of loop `root`, found to be needed only now: it becomes a carried value of
 * every loop from there to here. Nothing has changed the variable in this iteration yet, so its value here is
 * the innermost parameter. */
Var *var_hidden(Lower *l, LoopCtx *root, Inst *(*init)(Lower *, Builder *), IrType t) {
    Var *v = ARENA_NEW(l->arena, Var);
    v->type = t;
    v->born = root->born; /* ifs in the loop merge it, those around the loop do not know it */
    Builder before = ir_before(l->fn, root->op);
    v->value = init(l, &before);
    LoopCtx *chain[256];
    uint32_t n = 0;
    for (LoopCtx *c = l->loop;; c = c->outer) {
        if (n == 256) session_limit(l->s, "loops nested more than 256 deep");
        chain[n++] = c;
        if (c == root) break;
    }
    while (n-- > 0) {
        LoopCtx *c = chain[n];
        ir_append_arg(l->fn, c->op, v->value);
        v->value = ir_block_param(l->fn, c->op->region[0], t);
        vec_push(l->arena, &c->carried, v);
    }
    return v;
}

/* ---- ifs */

static bool same_value(const Inst *a, const Inst *b) {
    if (a == b) return true;
    if (!a || !b || a->op != b->op || !ir_is_const(a)) return false;
    return a->op == OP_constf ? memcmp(&a->imm.f, &b->imm.f, sizeof a->imm.f) == 0 : a->imm.i == b->imm.i;
}

static Inst *copy_const(Lower *l, const Inst *c) {
    return c->op == OP_constf ? kf(l, c->imm.f) : c->op == OP_consti ? ki(l, c->imm.i) : kb(l, c->imm.i != 0);
}

static void enter_region(Lower *l, Inst *op, uint32_t r) {
    Span span = l->b.span;
    l->b = ir_at_end(l->fn, op->region[r]);
    l->b.fold = true;
    l->b.span = span;
}

enum { MAX_DEPTH = 400 }; /* of regions: what the verifier and the passes recurse over */

static void deeper(Lower *l) {
    if (++l->depth <= MAX_DEPTH) return;
    diag_emit(l->s, DIAG_region_depth, l->b.span, (unsigned)MAX_DEPTH);
    gen_giveup(l);
}

void if_begin(Lower *l, IfCtx *c, Inst *cond) {
    deeper(l);
    memset(c, 0, sizeof *c);
    c->op = counted(l, ir_if(&l->b, cond));
    c->outer = l->b;
    c->mark = l->journal.len;
    c->born = l->clock++;
    enter_region(l, c->op, 0);
}

void if_else(Lower *l, IfCtx *c) {
    uint32_t stamp = ++l->stamps;
    for (uint32_t i = c->mark; i < l->journal.len; i++) {
        Var *v = l->journal.data[i].var;
        if (v->born >= c->born || v->stamp == stamp) continue;
        v->stamp = stamp;
        vec_push(l->arena, &c->changed, v);
        vec_push(l->arena, &c->first, v->value);
    }
    while (l->journal.len > c->mark) {
        Change ch = l->journal.data[--l->journal.len];
        ch.var->value = ch.old;
    }
    c->then_end = l->b;
    enter_region(l, c->op, 1);
}

void if_end(Lower *l, IfCtx *c) {
    l->depth--;
    /* Values before the if_ are the oldest journal entries of the second branch. */
    uint32_t n = c->changed.len;
    uint32_t stamp = ++l->stamps;
    Inst **firsts = ARENA_ARRAY(l->arena, Inst *, n + (l->journal.len - c->mark) + 1);
    for (uint32_t i = 0; i < n; i++) firsts[i] = c->first.data[i], c->changed.data[i]->stamp = stamp;
    for (uint32_t i = c->mark; i < l->journal.len; i++) {
        Var *v = l->journal.data[i].var;
        if (v->born >= c->born || v->stamp == stamp) continue;
        v->stamp = stamp;
        firsts[c->changed.len] = l->journal.data[i].old;
        vec_push(l->arena, &c->changed, v);
    }
    n = c->changed.len;
    Inst **seconds = ARENA_ARRAY(l->arena, Inst *, n + 1);
    for (uint32_t i = 0; i < n; i++) seconds[i] = c->changed.data[i]->value;
    while (l->journal.len > c->mark) {
        Change ch = l->journal.data[--l->journal.len];
        ch.var->value = ch.old;
    }
    Builder else_end = l->b;
    Inst *cond = c->op->args[0];
    Inst **ya = ARENA_ARRAY(l->arena, Inst *, n + 1), **yb = ARENA_ARRAY(l->arena, Inst *, n + 1);
    uint32_t *index = ARENA_ARRAY(l->arena, uint32_t, n + 1), ny = 0;
    for (uint32_t i = 0; i < n; i++) {
        Var *v = c->changed.data[i];
        Inst *x = firsts[i], *y = seconds[i];
        index[i] = UINT32_MAX;
        if (same_value(x, y)) continue;
        bool flag = x && y && x->op == OP_constb && y->op == OP_constb;
        if (flag) continue;
        if (v->type == TY_ARRAY) ice(l->s, "an array variable was reassigned");
        ya[ny] = x ? x : ir_zero(&c->then_end, v->type);
        yb[ny] = y ? y : ir_zero(&else_end, v->type);
        index[i] = ny++;
    }
    ir_yield(&c->then_end, ny, ya);
    ir_yield(&else_end, ny, yb);
    Span span = l->b.span;
    l->b = c->outer;
    l->b.span = span;
    for (uint32_t i = 0; i < n; i++) {
        Var *v = c->changed.data[i];
        Inst *x = firsts[i], *y = seconds[i], *out;
        if (index[i] != UINT32_MAX) out = ir_proj(&l->b, c->op, index[i]);
        else if (same_value(x, y)) out = x && ir_is_const(x) ? copy_const(l, x) : x;
        else out = x->imm.i ? cond : op1(l, OP_bnot, cond); /* true on one side, false on the other */
        var_set(l, v, out);
    }
}

/* ---- loops */

void loop_begin(Lower *l, LoopCtx *c, const VarList *carried, LoopInfo info) {
    deeper(l);
    Inst **init = ARENA_ARRAY(l->arena, Inst *, carried->len + 1);
    for (uint32_t i = 0; i < carried->len; i++) init[i] = var_get(l, carried->data[i]);
    info.loop_id = l->nloops++;
    c->op = counted(l, ir_loop(&l->b, carried->len, init, info));
    c->after = l->b;
    c->k = c->op->region[0]->params[0];
    c->ninitial = carried->len;
    c->mark = l->journal.len;
    c->born = l->clock++;
    c->outer = l->loop;
    c->frame = l->frame;
    l->loop = c;
    if (!l->frame->first_loop) l->frame->first_loop = c;
    enter_region(l, c->op, 0);
    for (uint32_t i = 0; i < carried->len; i++) {
        vec_push(l->arena, &c->carried, carried->data[i]);
        var_set(l, carried->data[i], c->op->region[0]->params[i + 1]);
    }
}

void loop_end(Lower *l, LoopCtx *c, Inst *go_on) {
    l->depth--;
    uint32_t n = c->carried.len;
    Inst **values = ARENA_ARRAY(l->arena, Inst *, n + 1);
    values[0] = go_on;
    for (uint32_t i = 0; i < n; i++) values[i + 1] = var_get(l, c->carried.data[i]);
    ir_yield(&l->b, n + 1, values);
    Span span = l->b.span;
    l->b = c->after;
    l->b.span = span;
    for (uint32_t i = 0; i < n; i++) {
        Var *v = c->carried.data[i];
        Inst *param = c->op->region[0]->params[i + 1];
        if (i >= c->ninitial) {
            /* For a variable that var_hidden added, the value before the loop is what the loop was given. */
            for (uint32_t j = c->mark; j < l->journal.len; j++)
                if (l->journal.data[j].var == v) l->journal.data[j].old = c->op->args[i];
            v->value = c->op->args[i];
        }
        /* A value that no iteration changes is the value from before: gen_prune_loops takes the parameter out. */
        var_set(l, v, values[i + 1] == param ? c->op->args[i] : ir_proj(&l->b, c->op, i));
    }
    l->loop = c->outer;
    if (l->frame->first_loop == c) l->frame->first_loop = NULL;
}

/* Parameters that every iteration passes on unchanged are their initial value. */
static void find_invariant(Block *b, Inst **map, bool *any) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) find_invariant(i->region[r], map, any);
        if (i->op != OP_loop) continue;
        Block *body = i->region[0];
        for (uint32_t p = 1; p < body->nparams; p++)
            if (body->last->args[p] == body->params[p]) map[body->params[p]->id] = i->args[p - 1], *any = true;
    }
}

static void drop_invariant(Block *b, Inst **map) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) drop_invariant(i->region[r], map);
        if (i->op != OP_loop) continue;
        Block *body = i->region[0];
        uint32_t kept = 1, total = body->nparams;
        for (uint32_t p = 1; p < total; p++) {
            bool drop = map[body->params[p]->id] != NULL;
            for (Inst *q = i->next, *next; q && q->op == OP_proj && q->args[0] == i; q = next) {
                next = q->next;
                if (drop || q->imm.i != (int64_t)p - 1) continue;
                q->imm.i = kept - 1;
            }
            if (drop) continue;
            body->params[kept] = body->params[p];
            body->params[kept]->imm.i = kept;
            body->last->args[kept] = body->last->args[p];
            i->args[kept - 1] = i->args[p - 1];
            kept++;
        }
        body->nparams = body->last->nargs = kept;
        i->nargs = kept - 1;
    }
}

void gen_prune_loops(Lower *l) {
    uint32_t n = ir_number(l->fn);
    Inst **map = ARENA_ARRAY(&l->s->scratch, Inst *, n + 1);
    bool any = false;
    find_invariant(l->fn->body, map, &any);
    if (!any) return;
    /* Chains: inner loops were given outer parameters. Outer parameters have smaller ids, so one pass in order resolves
     * them. */
    for (uint32_t i = 0; i < n; i++)
        if (map[i] && map[i]->id != UINT32_MAX && map[map[i]->id]) map[i] = map[map[i]->id];
    /* Invariant results were never projected (loop_end), so replacing the parameters is all. */
    Inst **copy = arena_copy(&l->s->scratch, map, sizeof *map * (n + 1));
    for (uint32_t u = 0; u < l->untracked.len; u++) {
        Untracked *t = &l->untracked.data[u];
        if (t->g0 && copy[t->g0->id]) t->g0 = copy[t->g0->id];
        if (t->g1 && copy[t->g1->id]) t->g1 = copy[t->g1->id];
    }
    ir_replace_all(l->fn, map);
    drop_invariant(l->fn->body, copy);
}

/* ---- ranges */

void range_set(Lower *l, Inst *i, int64_t lo, int64_t hi) {
    if (i->op == OP_consti) return;
    if (!l->ranges.len) vec_push(l->arena, &l->ranges, ((IrRange){0}));
    i->tag = l->ranges.len;
    vec_push(l->arena, &l->ranges, ((IrRange){(double)lo, (double)hi, 0}));
}

void range_get(Lower *l, const Inst *i, int64_t *lo, int64_t *hi) {
    IrRange r = ir_range_of(i, l->ranges.data, l->ranges.len);
    *lo = (int64_t)r.lo, *hi = (int64_t)r.hi;
}

/* i clamped into [0, n), without code where its range is inside. */
Inst *clamp_index(Lower *l, Inst *i, bool is_unsigned, uint32_t n) {
    int64_t lo, hi;
    range_get(l, i, &lo, &hi);
    if (lo >= 0 && hi < (int64_t)n) return i;
    if (is_unsigned && lo < 0) return op2(l, OP_umin, i, ki(l, (int64_t)n - 1));
    if (hi >= (int64_t)n) i = op2(l, OP_imin, i, ki(l, (int64_t)n - 1));
    if (lo < 0) i = op2(l, OP_imax, i, ki(l, 0));
    return i;
}
