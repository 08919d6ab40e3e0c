/* Loops of which iterations can be left out: the runtime may give a list of those that can matter (LoopInfo.cull), as
 * for [Cull], which `bounds` makes without anybody's promise.
 *
 * An iteration can be left out where every carried value passes through it unchanged and the loop goes on. So there
 * must be decisions for which all of them do: a search over the choices (if_, selects, minima) through which they come.
 * A loop with a break can have a list, the iteration that leaves is one that matters; a ray march, where the way
 * changes in all iterations but that one, cannot. An inner loop can if the outer one cannot: its list serves all its
 * executions. Nothing but carried values may leave the body. Marks only: without a list nothing runs otherwise. */
#include "compiler/pass/walk.h"

enum {
    LEAST = 8, /* iterations that a list is worth; */
    LEAST_REPEATED = 4,
    REPEATS = 4, /* in a loop of no more iterations, which images write out */
    MAX_STEPS = 4096
};

/* v is to be the value of carried parameter p; without p, a boolean that is to be `value`. */
typedef struct Goal {
    const Inst *v, *p;
    bool value;
    const struct Goal *next;
} Goal;

typedef struct Choice {
    const Inst *condition;
    bool value;
    const struct Choice *next;
} Choice;

static bool reach(const Goal *g, const Choice *made, uint32_t *steps);

static bool reach_both(Goal first, Goal second, const Goal *rest, const Choice *made, uint32_t *steps) {
    second.next = rest;
    first.next = &second;
    return reach(&first, made, steps);
}

/* v chooses x where `condition` holds, y elsewhere: either reaches the goal. */
static bool reach_choice(const Goal *g, const Inst *condition, const Inst *x, const Inst *y, const Choice *made,
                         uint32_t *steps) {
    return reach_both((Goal){.v = condition, .value = true}, (Goal){x, g->p, g->value, NULL}, g->next, made, steps) ||
           reach_both((Goal){.v = condition, .value = false}, (Goal){y, g->p, g->value, NULL}, g->next, made, steps);
}

/* a & b, or with `any` a | b, of which one is p (passing) while the other leaves it alone. */
static bool reach_logic(const Goal *g, bool any, const Choice *made, uint32_t *steps) {
    const Inst *a = g->v->args[0], *b = g->v->args[1];
    Goal x = {a, g->p, g->value, NULL}, y = {b, g->p, g->value, NULL};
    if (!g->p) { /* and: both true, or one false */
        if (g->value != any) return reach_both(x, y, g->next, made, steps);
        x.next = y.next = g->next;
        return reach(&x, made, steps) || reach(&y, made, steps);
    }
    return reach_both(x, (Goal){.v = b, .value = !any}, g->next, made, steps) ||
           reach_both(y, (Goal){.v = a, .value = !any}, g->next, made, steps);
}

static bool reach_result(const Goal *g, const Choice *made, uint32_t *steps) {
    const Inst *s = g->v->args[0];
    uint32_t r = (uint32_t)g->v->imm.i;
    if (s->op == OP_if_)
        return reach_choice(g, s->args[0], s->region[0]->last->args[r], s->region[1]->last->args[r], made, steps);
    if (s->op != OP_loop || !g->p) return false;
    const Block *body = s->region[0];
    return reach_both((Goal){.v = body->last->args[r + 1], .p = body->params[r + 1]},
                      (Goal){.v = s->args[r], .p = g->p}, g->next, made, steps);
}

/* A decision that nothing decides here: can it be so, after those made before? */
static bool reach_decision(const Goal *g, const Choice *made, uint32_t *steps) {
    Choice c = {g->v, g->value, made};
    if (g->v->op == OP_constb) return (g->v->imm.i != 0) == g->value && reach(g->next, made, steps);
    for (const Choice *m = made; m; m = m->next)
        if (m->condition == g->v) return m->value == g->value && reach(g->next, made, steps);
    return reach(g->next, &c, steps);
}

/* Are there decisions by which all goals are reached? */
static bool reach(const Goal *g, const Choice *made, uint32_t *steps) {
    if (!g) return true;
    if (!*steps) return false;
    --*steps;
    const Inst *v = g->v;
    if (v == g->p) return reach(g->next, made, steps);
    if (ir_ops[v->op].selects) return reach_choice(g, v->args[0], v->args[1], v->args[2], made, steps);
    Goal one = *g;
    switch (v->op) {
    case OP_band: return reach_logic(g, false, made, steps);
    case OP_bor: return reach_logic(g, true, made, steps);
    case OP_bnot:
        if (g->p) return false;
        one.v = v->args[0], one.value = !g->value;
        return reach(&one, made, steps);
    case OP_site:
    case OP_siten: /* of a minimum: `bounds` asks again, of a clone with seams */
        one.v = v->args[0];
        return reach(&one, made, steps);
    case OP_fmin:
    case OP_fmax:
    case OP_imin:
    case OP_imax:
        for (uint32_t a = 0; a < 2 && g->p; a++) {
            if (ir_is_const(v->args[1 - a])) continue; /* which takes the derivative where both are equal */
            one.v = v->args[a];
            if (reach(&one, made, steps)) return true;
        }
        return false;
    case OP_proj:
        if (reach_result(g, made, steps)) return true;
        return !g->p && v->args[0]->op == OP_loop && reach_decision(g, made, steps);
    default: return !g->p && reach_decision(g, made, steps);
    }
}

/* Does anything leave the block but the values that it yields? */
static bool leaves(const Fn *fn, const Block *b, const Block *body) {
    for (const Inst *i = b->first; i; i = i->next) {
        bool cut = b == body && i->op == OP_count && i->imm.i == COUNTER_TRUNCATED; /* by an iteration that leaves */
        if (ir_ops[i->op].kind == KIND_EFFECT && !cut) return true;
        if ((i->op == OP_store || i->op == OP_acopy) && !walk_inside(i->args[0]->block, body)) return true;
        if ((i->op == OP_site || i->op == OP_siten) && fn->sites[i->imm.i].skip_loop) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (leaves(fn, i->region[r], body)) return true;
    }
    return false;
}

bool walk_can_leave_out(const Fn *fn, const Inst *loop) {
    const Block *body = loop->region[0];
    Arena *scratch = &fn->session->scratch;
    ArenaMark m = arena_mark(scratch);
    uint32_t n = loop->nargs, steps = MAX_STEPS;
    Goal *goal = ARENA_ARRAY(scratch, Goal, n + 1);
    goal[n] = (Goal){.v = body->last->args[0], .value = true};
    for (uint32_t c = 0; c < n; c++)
        goal[c] = (Goal){.v = body->last->args[c + 1], .p = body->params[c + 1], .next = &goal[c + 1]};
    bool can = n && reach(goal, NULL, &steps) && !leaves(fn, body, body);
    arena_reset(scratch, m);
    return can;
}

static uint32_t lists(const Block *b) {
    uint32_t n = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_loop && i->imm.loop.cull && i->imm.loop.cull_id >= n) n = i->imm.loop.cull_id + 1;
        for (uint32_t r = 0; r < i->nregions; r++) {
            uint32_t below = lists(i->region[r]);
            n = below > n ? below : n;
        }
    }
    return n;
}

static bool mark(const Fn *fn, Block *b, uint32_t least, uint32_t *next) {
    bool changed = false;
    for (Inst *i = b->first; i; i = i->next) {
        bool listed = i->op == OP_loop && walk_can_leave_out(fn, i);
        const uint32_t inside = i->op == OP_loop && i->imm.loop.max_iters <= REPEATS ? LEAST_REPEATED : least;
        for (uint32_t r = 0; r < i->nregions && !listed; r++) changed |= mark(fn, i->region[r], inside, next);
        if (!listed || i->imm.loop.cull || i->imm.loop.max_iters < least || *next >= SLT_MAX_CULL) continue;
        i->imm.loop.cull = i->imm.loop.found = true;
        i->imm.loop.cull_id = (*next)++;
        changed = true;
    }
    return changed;
}

bool opt_lists(PassCtx *ctx, Fn *fn) {
    uint32_t next = lists(fn->body), promised = ctx->program ? ctx->program->ncull : 0;
    if (next < promised) next = promised;
    return mark(fn, fn->body, LEAST, &next);
}
