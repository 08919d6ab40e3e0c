/* What `bounds` notes of the iterations of loops with lists.
 *
 * Two questions are asked of an iteration, in the program's own terms: does it change a carried value (or leave the
 * loop)? Does it overwrite all of them with values that do not hang on the old ones? The answers are booleans that this
 * adds to a clone, `note` hands them on, and on a box they are bounded like any other boolean: an iteration matters if
 * it may change something, and hides those before it if it certainly overwrites. Hiding needs that every iteration
 * runs, once. Of a loop that keeps the iteration with the least key (variant_argmin.c) one matters only if its key may
 * be the least of all, whatever came before it: a loop ahead finds that. */
#include <math.h>

#include "compiler/pass/variant.h"

typedef struct Noter {
    Fn *fn;
    Arena *arena;
    uint32_t n;        /* ids before anything was added */
    Inst *no, *yes;    /* constants at the top */
    const Block *body; /* of the loop in hand */
    const Inst *p;     /* the carried parameter in question */
    Inst **changed;    /* by id: the boolean for p, where it is known already */
    Inst **renewed;    /* by id: likewise of the second question */
    uint8_t *old;      /* by id: hangs on what the loop carries */
    bool image;        /* lists are for the value alone */
    Vec(Argmin) argmins;
} Noter;

/* ---- which values hang on what the loop carries: forwards, until nothing changes */

static bool mark_old(uint8_t *to, const Inst *i, bool old) {
    bool news = old && !to[i->id];
    if (news) to[i->id] = 1;
    return news;
}

static bool find_old(const Block *b, uint8_t *to) {
    bool news = false;
    for (const Inst *i = b->first; i; i = i->next) {
        bool old = i->op == OP_load; /* of memory nothing is known */
        for (uint32_t r = 0; r < i->nregions; r++) news |= find_old(i->region[r], to);
        if (i->op == OP_loop)
            for (uint32_t c = 0; c < i->nargs; c++)
                news |= mark_old(to, i->region[0]->params[c + 1],
                                 to[i->args[c]->id] || to[i->region[0]->last->args[c + 1]->id]);
        if (i->op == OP_proj) {
            const Inst *s = i->args[0];
            old |= to[s->op == OP_if_ ? s->args[0]->id : s->region[0]->last->args[0]->id] != 0;
            for (uint32_t r = 0; r < s->nregions; r++) old |= to[walk_results(s, s->region[r])[i->imm.i]->id] != 0;
        } else {
            for (uint32_t a = 0; a < i->nargs; a++) old |= to[i->args[a]->id] != 0;
        }
        news |= mark_old(to, i, old);
    }
    return news;
}

void variant_find_carried(const Block *body, uint8_t *old) {
    while (find_old(body, old)) continue;
}

/* ---- the two booleans of a value v, as instructions that are visible where v is */

typedef Inst *Question(Noter *t, Inst *v);

static Inst *known(Noter *t, Inst **memo, const Inst *v, Inst *answer) {
    if (v->id < t->n) memo[v->id] = answer;
    return answer;
}

static Builder behind(Noter *t, Inst *v) {
    Builder b = ir_after(t->fn, v);
    b.fold = true;
    return b;
}

/* The answer for a result of an if_: that of the side taken. */
static Inst *of_sides(Noter *t, Inst *v, Question *ask) {
    Inst *i = v->args[0], *x[2];
    for (uint32_t r = 0; r < 2; r++) x[r] = ask(t, i->region[r]->last->args[v->imm.i]);
    if (x[0] == x[1]) return x[0];
    uint32_t n = ir_nresults(i), at = 0;
    while (at < n && !(i->region[0]->last->args[at] == x[0] && i->region[1]->last->args[at] == x[1])) at++;
    for (uint32_t r = 0; at == n && r < 2; r++) ir_append_arg(t->fn, i->region[r]->last, x[r]);
    Builder b = behind(t, i);
    return ir_proj(&b, i, at);
}

static Inst *of_choice(Noter *t, Inst *v, Question *ask) {
    Inst *x = ask(t, v->args[1]), *y = ask(t, v->args[2]);
    Builder b = behind(t, v);
    return x == y ? x : ir_select(&b, v->args[0], x, y);
}

static Inst *changes(Noter *t, Inst *v);

/* v is the minimum (or its kin) of a and b: does it take `other`, and not p, or is p another already? */
static Inst *takes(Noter *t, Inst *v, uint32_t own) {
    Inst *p = v->args[own], *other = v->args[1 - own];
    Builder b = behind(t, v);
    Inst *won;
    switch ((Op)v->op) {
    case OP_fmin:
        won = own ? ir_emit1(&b, OP_bnot, ir_emit2(&b, OP_flt, p, other)) : ir_emit2(&b, OP_flt, other, p);
        break;
    case OP_fmax:
        won = own ? ir_emit1(&b, OP_bnot, ir_emit2(&b, OP_flt, other, p)) : ir_emit2(&b, OP_flt, p, other);
        break;
    case OP_imin: won = ir_emit2(&b, OP_ilt, other, p); break;
    case OP_imax: won = ir_emit2(&b, OP_ilt, p, other); break;
    case OP_band: won = ir_emit2(&b, OP_band, p, ir_emit1(&b, OP_bnot, other)); break;
    default: won = ir_emit2(&b, OP_band, ir_emit1(&b, OP_bnot, p), other); break; /* bor */
    }
    return ir_emit2(&b, OP_bor, changes(t, p), won);
}

/* An inner loop carries the answer along. */
static Inst *of_loop(Noter *t, Inst *v) {
    Inst *loop = v->args[0];
    Block *body = loop->region[0];
    uint32_t r = (uint32_t)v->imm.i;
    Inst *first = changes(t, loop->args[r]);
    if (first == t->yes) return first;
    const Inst *outer = t->p;
    t->p = body->params[r + 1];
    Inst *again = changes(t, body->last->args[r + 1]);
    t->p = outer;
    if (again == t->yes || again == t->no) return again == t->yes ? again : first;
    ir_append_arg(t->fn, loop, first);
    Inst *so_far = ir_block_param(t->fn, body, TY_BOOL);
    Builder b = ir_before(t->fn, body->last);
    ir_append_arg(t->fn, body->last, ir_emit2(&b, OP_bor, so_far, again));
    b = behind(t, loop);
    return ir_proj(&b, loop, ir_nresults(loop) - 1);
}

/* Is v another value than parameter p? */
static Inst *changes(Noter *t, Inst *v) {
    if (v == t->p) return t->no;
    if (v->id >= t->n || !walk_inside(v->block, t->body)) return t->yes;
    if (t->changed[v->id]) return t->changed[v->id];
    Inst *answer = t->yes;
    if (ir_ops[v->op].selects) {
        answer = of_choice(t, v, changes);
    } else if (v->op == OP_proj) {
        if (v->args[0]->op == OP_if_) answer = of_sides(t, v, changes);
        if (v->args[0]->op == OP_loop) answer = of_loop(t, v);
    } else if (variant_is_site(v)) {
        answer = changes(t, v->args[0]);
    } else {
        switch ((Op)v->op) {
        case OP_fmin:
        case OP_fmax:
        case OP_imin:
        case OP_imax:
        case OP_band:
        case OP_bor:
            for (uint32_t a = 0; a < 2 && answer == t->yes; a++)
                if (changes(t, v->args[a]) != t->yes) answer = takes(t, v, a);
            break;
        default: break;
        }
    }
    return known(t, t->changed, v, answer);
}

/* Does v hang on nothing that the loop carries? */
static Inst *renews(Noter *t, Inst *v) {
    if (v->id >= t->n) return t->no;
    if (!t->old[v->id]) return t->yes;
    if (t->renewed[v->id]) return t->renewed[v->id];
    Inst *answer = t->no;
    if (ir_ops[v->op].selects && !t->old[v->args[0]->id]) answer = of_choice(t, v, renews);
    if (v->op == OP_proj && v->args[0]->op == OP_if_ && !t->old[v->args[0]->args[0]->id])
        answer = of_sides(t, v, renews);
    if (variant_is_site(v)) answer = renews(t, v->args[0]);
    return known(t, t->renewed, v, answer);
}

/* ---- loops that keep the iteration with the least key */
enum { KEY_SIZE = 64 }; /* operations that a loop ahead is worth */

static void find_argmins(PassCtx *ctx, Noter *t, const Block *b) {
    Argmin found;
    for (const Inst *i = b->first; i; i = i->next) {
        bool may = variant_is_site(i) && t->fn->sites[i->imm.i].argmin && b->owner->imm.loop.cull;
        if (may && variant_argmin(ctx, t->fn, i, &found)) vec_push(t->arena, &t->argmins, found);
        for (uint32_t r = 0; r < i->nregions; r++) find_argmins(ctx, t, i->region[r]);
    }
}

/* A loop ahead of another, which iterates as that does, and what it makes of values of the other's body. */
typedef struct Ahead {
    Builder b;
    const Block *body; /* of the other */
    Inst *k, **made;   /* made: by id */
    uint32_t most;     /* that may yet be made */
} Ahead;

/* NULL: it is not made in few operations of numbers alone. */
static Inst *make_ahead(Ahead *a, Inst *v) {
    enum { ARGS = 4 };
    Inst *args[ARGS];
    if (v == a->body->params[0]) return a->k;
    if (!walk_inside(v->block, a->body)) return v;
    if (a->made[v->id]) return a->made[v->id];
    if (variant_is_site(v)) return make_ahead(a, v->args[0]);
    if (!walk_is_pure(v) || v->nargs > ARGS || v->nregions || !a->most) return NULL;
    a->most--;
    for (uint32_t i = 0; i < v->nargs; i++)
        if (!(args[i] = make_ahead(a, v->args[i]))) return NULL;
    return a->made[v->id] = ir_special(&a->b, (Op)v->op, (IrType)v->type, v->nargs, args, v->imm);
}

/* May this iteration's key be the least one? NULL: that is not asked. */
static Inst *may_be_kept(Noter *t, Inst *loop) {
    const Argmin *of = NULL;
    for (uint32_t i = 0; i < t->argmins.len; i++)
        if (t->argmins.data[i].loop == loop) of = &t->argmins.data[i];
    if (!of) return NULL;
    Builder b = ir_before(t->fn, loop);
    Inst *none = ir_constf(&b, of->least ? INFINITY : -INFINITY), *own = (Inst *)of->key;
    Inst *ahead = ir_loop(&b, 1, &none, loop->imm.loop), **params = ahead->region[0]->params;
    Ahead a = {ir_at_end(t->fn, ahead->region[0]), loop->region[0], params[0], ARENA_ARRAY(t->arena, Inst *, t->n + 1),
               KEY_SIZE};
    Inst *on = make_ahead(&a, loop->region[0]->last->args[0]), *key = make_ahead(&a, own);
    bool known = on && key;
    if (known) key = ir_emit2(&a.b, of->least ? OP_fmin : OP_fmax, params[1], key);
    ir_yield(&a.b, 2, (Inst *[]){known ? on : ir_constb(&a.b, false), known ? key : params[1]});
    if (!known) return NULL; /* nobody asks for the loop: it goes */
    b = ir_after(t->fn, ahead);
    Inst *best = ir_proj(&b, ahead, 0);
    b = ir_before(t->fn, loop->region[0]->last);
    return of->least ? ir_emit2(&b, OP_fle, own, best) : ir_emit2(&b, OP_fle, best, own);
}

/* ---- loops */

static void clear_below(Noter *t, const Block *b, Inst **memo) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->id < t->n) memo[i->id] = NULL;
        for (uint32_t r = 0; r < i->nregions; r++) clear_below(t, i->region[r], memo);
    }
}

/* Does v say that another iteration is left of those that the loop runs at most? */
static bool is_count(const Inst *v, const Inst *loop) {
    const Inst *k = loop->region[0]->params[0];
    return v->op == OP_ilt && v->args[0] == k && v->args[1]->op == OP_consti &&
           v->args[1]->imm.i + 1 >= (int64_t)loop->imm.loop.max_iters;
}

/* Does the loop go on, as far as something else decides than how many iterations it has? */
static Inst *goes_on(Noter *t, Inst *v, const Inst *loop) {
    if (is_count(v, loop)) return t->yes;
    if (v->op != OP_band) return v;
    Inst *p = goes_on(t, v->args[0], loop), *q = goes_on(t, v->args[1], loop);
    Builder b = ir_before(t->fn, loop->region[0]->last);
    b.fold = true;
    return p == v->args[0] && q == v->args[1] ? v : p == t->yes ? q : q == t->yes ? p : ir_emit2(&b, OP_band, p, q);
}

static void note_loop(Noter *t, Inst *loop, bool repeats) {
    Block *body = loop->region[0];
    uint32_t carried = loop->nargs;
    t->body = body;
    for (uint32_t c = 0; c < carried; c++) t->old[body->params[c + 1]->id] = 1;
    variant_find_carried(body, t->old);
    Inst *args[2] = {t->no, loop->imm.loop.exact && !repeats ? t->yes : t->no};
    for (uint32_t c = 0; c < carried; c++) {
        Inst *next = body->last->args[c + 1];
        clear_below(t, body, t->changed);
        t->p = body->params[c + 1];
        Inst *change = changes(t, next), *renewed = renews(t, next);
        Builder b = ir_before(t->fn, body->last);
        b.fold = true;
        if (change != args[0]) args[0] = ir_emit2(&b, OP_bor, args[0], change);
        if (renewed != args[1]) args[1] = ir_emit2(&b, OP_band, args[1], renewed);
    }
    Builder b = ir_before(t->fn, body->last);
    b.fold = true;
    Inst *kept = may_be_kept(t, loop);
    if (kept) args[0] = ir_emit2(&b, OP_band, args[0], kept);
    Inst *on = body->last->args[0];
    if (loop->imm.loop.exact) on = t->yes;
    /* A list ends by itself. But on boxes a loop that lanes leave is left by an iteration, and of what bounds say of
     * images no bounds are asked again. */
    else if (t->image && loop->imm.loop.found) on = goes_on(t, on, loop);
    if (on != t->yes) args[0] = ir_emit2(&b, OP_bor, args[0], ir_emit1(&b, OP_bnot, on));
    ir_special(&b, OP_note, TY_VOID, 2, args, (Imm){.i = loop->imm.loop.cull_id});
}

static void note_block(Noter *t, Block *b, bool repeats) {
    for (Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_loop && i->imm.loop.cull && walk_can_leave_out(t->fn, i)) {
            note_loop(t, i, repeats);
            continue;
        }
        for (uint32_t r = 0; r < i->nregions; r++) note_block(t, i->region[r], repeats || i->op == OP_loop);
    }
}

void variant_note_lists(PassCtx *ctx, Fn *fn, bool image) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark m = arena_mark(scratch);
    Noter t = {.fn = fn, .arena = scratch, .image = image};
    find_argmins(ctx, &t, fn->body);
    t.n = ir_number(fn);
    t.changed = ARENA_ARRAY(scratch, Inst *, t.n + 1);
    t.renewed = ARENA_ARRAY(scratch, Inst *, t.n + 1);
    t.old = ARENA_ARRAY(scratch, uint8_t, t.n + 1);
    Builder top = ir_before(fn, fn->body->first);
    t.no = ir_constb(&top, false), t.yes = ir_constb(&top, true);
    note_block(&t, fn->body, false);
    arena_reset(scratch, m);
}
