/* Bounds of structured operations.
 *
 * An if_ whose condition may differ within the box becomes two one-sided ones, of which both run where it does; one, if
 * a side only passes values through. A loop runs as long as it may go on somewhere; what it may have been left with
 * before is kept in an exit hull. */
#include <string.h>

#include "compiler/pass/variant_bounds.h"

typedef Vec(Inst *) Insts;

/* ---- a Boxed as the values that an operation yields or carries: lo, [hi], [open], [error] by its facts */

enum { LEAN_PARTS = 4 };

static void pack(Boxes *x, Builder *b, Insts *to, uint8_t fact, Boxed v) {
    if ((v.is.lo != v.is.hi && !(fact & FACT_WIDE)) || (v.open && !(fact & FACT_OPEN)))
        ice(x->to->session, "bounds: a value has more than its facts");
    vec_push(x->arena, to, v.is.lo);
    if (fact & FACT_WIDE) vec_push(x->arena, to, v.is.hi);
    if (fact & FACT_OPEN) vec_push(x->arena, to, v.open ? v.open : ir_consti(b, 0));
    if (fact & FACT_ERROR) vec_push(x->arena, to, v.error ? v.error : ir_constf(b, 0));
    if (!(fact & FACT_LEAN)) return;
    const Lean lean = bounds_lean_of(x, b, v);
    Inst *const part[LEAN_PARTS] = {lean.mid, lean.slope[0], lean.slope[1], lean.rest};
    for (uint32_t k = 0; k < LEAN_PARTS; k++) vec_push(x->arena, to, part[k] ? part[k] : ir_constf(b, 0));
}

static uint32_t packed(uint8_t fact) {
    return 1u + (fact & FACT_WIDE ? 1u : 0u) + (fact & FACT_OPEN ? 1u : 0u) + (fact & FACT_ERROR ? 1u : 0u) +
           (fact & FACT_LEAN ? (uint32_t)LEAN_PARTS : 0u);
}

static Boxed unpack_params(const Block *body, uint32_t *at, uint8_t fact) {
    Boxed v = {0};
    v.is.lo = v.is.hi = body->params[(*at)++];
    if (fact & FACT_WIDE) v.is.hi = body->params[(*at)++];
    if (fact & FACT_OPEN) v.open = body->params[(*at)++];
    if (fact & FACT_ERROR) v.error = body->params[(*at)++];
    if (fact & FACT_LEAN) {
        Inst *const *part = &body->params[*at];
        v.lean = (Lean){part[0], {part[1], part[2]}, part[3]}, *at += LEAN_PARTS;
    }
    return v;
}

static Boxed unpack_results(Builder *b, Inst *op, uint32_t *at, uint8_t fact) {
    Boxed v = {0};
    v.is.lo = v.is.hi = ir_proj(b, op, (*at)++);
    if (fact & FACT_WIDE) v.is.hi = ir_proj(b, op, (*at)++);
    if (fact & FACT_OPEN) v.open = ir_proj(b, op, (*at)++);
    if (fact & FACT_ERROR) v.error = ir_proj(b, op, (*at)++);
    if (fact & FACT_LEAN) {
        Inst *part[LEAN_PARTS];
        for (uint32_t k = 0; k < LEAN_PARTS; k++) part[k] = ir_proj(b, op, (*at)++);
        v.lean = (Lean){part[0], {part[1], part[2]}, part[3]};
    }
    return v;
}

/* The same value under fewer facts. */
static Boxed with_facts(Boxed v, uint8_t fact) {
    if (!(fact & FACT_WIDE)) v.is.hi = v.is.lo;
    if (!(fact & FACT_OPEN)) v.open = NULL;
    if (!(fact & FACT_ERROR)) v.error = NULL;
    if (!(fact & FACT_LEAN)) v.lean = (Lean){0};
    return v;
}

static Boxed zero(Builder *b, unsigned type) {
    Inst *z = ir_zero(b, (IrType)type);
    return (Boxed){.is = {z, z}};
}

static Boxed value_of(const Boxes *x, const Inst *v) { return x->value[v->id]; }

/* which ? p : q, of bounds and sets */
static Boxed choose(const Boxes *x, Builder *b, Inst *which, Boxed p, Boxed q) {
    Boxed r = {0};
    r.is.lo = bounds_choose(b, which, p.is.lo, q.is.lo);
    r.is.hi = p.is.lo == p.is.hi && q.is.lo == q.is.hi ? r.is.lo : bounds_choose(b, which, p.is.hi, q.is.hi);
    r.open = p.open || q.open ? open_where(b, which, p.open, q.open) : NULL;
    r.error = error_where(b, which, p.error, q.error);
    if (p.lean.mid || q.lean.mid) r.lean = bounds_lean_where(x, b, which, p, q);
    return r;
}

/* Either of the two, by something that is open itself. But an event is captured once: what holds g on both sides holds
 * the same, and where one side has nothing, what was decided is only whether the event exists. */
static Boxed either(Builder *b, Boxed p, Boxed q, Inst *open, uint8_t fact) {
    Boxed r = {.error = error_larger(b, p.error, q.error)};
    bool same = p.is.lo == q.is.lo && p.is.hi == q.is.hi;
    r.is = same ? p.is : ir_bound_hull(b, p.is, q.is);
    if (same && !memcmp(&p.lean, &q.lean, sizeof p.lean)) r.lean = p.lean;
    if (!(fact & FACT_CAPTURE)) {
        r.open = open_union(b, open, open_union(b, p.open, q.open));
        return r;
    }
    Inst *no_p = bounds_is_nothing(b, p.is), *no_q = bounds_is_nothing(b, q.is);
    Inst *both = open_union(b, p.open, q.open);
    r.open = open_where(b, no_p, q.open, open_where(b, no_q, p.open, both));
    return r;
}

/* ---- if_ */

static bool next_result(const Inst *owner, const Inst **p) {
    *p = *p ? (*p)->next : owner->next;
    return *p && (*p)->op == OP_proj && (*p)->args[0] == owner;
}

static const Inst *side(const Inst *proj, uint32_t r) { return proj->args[0]->region[r]->last->args[proj->imm.i]; }

/* ---- goals: to go on, a loop needs certain results of the ifs in its body. What is carried around is taken as it is
 * then: behind `if (c) break;` c is false, whatever the box leaves open. */

/* Where v must be `truth`, what must ifs give? One before the loop has been worked off: what it gave does not hang on
 * whether this loop goes on. */
static void want_truth(Boxes *x, const Inst *v, bool truth) {
    if (v->op == OP_bnot) want_truth(x, v->args[0], !truth);
    if (v->op == (truth ? OP_band : OP_bor))
        for (uint32_t a = 0; a < 2; a++) want_truth(x, v->args[a], truth);
    if (v->op != OP_proj || v->args[0]->op != OP_if_ || x->goal[v->args[0]->id].set || value_of(x, v).is.lo) return;
    x->goal[v->args[0]->id] = (Goal){.set = true, .truth = truth, .index = (uint32_t)v->imm.i};
    for (uint32_t r = 0; r < 2; r++) want_truth(x, side(v, r), truth);
}

/* The region after which the goal is missed; 2: there is none. */
static uint32_t missing(const Boxes *x, const Inst *i) {
    const Goal *goal = &x->goal[i->id];
    for (uint32_t r = 0; r < 2 && goal->set; r++) {
        const Inst *got = i->region[r]->last->args[goal->index];
        if (got->op == OP_constb && (got->imm.i != 0) != goal->truth) return r;
    }
    return 2;
}

static Boxed value_given(const Boxes *x, const Inst *v) {
    return v->op == OP_proj && x->goal[v->args[0]->id].set ? x->given[v->id] : value_of(x, v);
}

/* ---- the results of an if_, and behind them, with a goal, the same where it is reached */

typedef struct Results {
    uint32_t n, all;        /* how many, and with those of the goal */
    const Inst **proj;      /* [all] */
    Boxed *side[2], *value; /* [all] */
} Results;

static Results results_of(const Boxes *x, const Inst *i) {
    Results t = {0};
    for (const Inst *p = NULL; next_result(i, &p);) t.n++;
    t.all = x->goal[i->id].set ? 2 * t.n : t.n;
    t.proj = ARENA_ARRAY(x->arena, const Inst *, t.all + 1);
    for (uint32_t r = 0; r < 2; r++) t.side[r] = ARENA_ARRAY(x->arena, Boxed, t.all + 1);
    t.value = ARENA_ARRAY(x->arena, Boxed, t.all + 1);
    uint32_t n = 0;
    for (const Inst *p = NULL; next_result(i, &p); n++)
        for (uint32_t k = n; k < t.all; k += t.n) t.proj[k] = p;
    return t;
}

/* What region r makes of the results, before what it has learned is forgotten. */
static void take_side(const Boxes *x, Results *t, uint32_t r) {
    for (uint32_t k = 0; k < t->all; k++) {
        const Inst *v = side(t->proj[k], r);
        t->side[r][k] = k < t->n ? value_of(x, v) : value_given(x, v);
    }
}

static void yield_all(Boxes *x, Builder *b, const Results *t, const Boxed *v) {
    Insts out = {0};
    for (uint32_t k = 0; k < t->all; k++) pack(x, b, &out, x->fact[t->proj[k]->id], v[k]);
    ir_yield(b, out.len, out.data);
}

static void read_all(Boxes *x, Builder *b, const Results *t, Inst *br, Boxed *v) {
    uint32_t at = 0;
    for (uint32_t k = 0; k < t->all; k++) v[k] = unpack_results(b, br, &at, x->fact[t->proj[k]->id]);
}

static void uniform_if(Boxes *x, Builder *b, const Inst *i, Results *t) {
    Inst *br = ir_if(b, value_of(x, i->args[0]).is.lo);
    br->imm = i->imm;
    for (uint32_t r = 0; r < 2; r++) {
        Builder in = ir_at_end(x->to, br->region[r]);
        bounds_block(x, &in, i->region[r]);
        take_side(x, t, r);
        yield_all(x, &in, t, t->side[r]);
    }
    read_all(x, b, t, br, t->value);
}

static bool passes_through(const Block *region) { return region->first == region->last; }

/* A result where the condition holds on a part of the box only. */
static Boxed joined(Boxes *x, Builder *b, const Results *t, uint32_t k) {
    const Inst *p = t->proj[k], *i = p->args[0];
    uint32_t miss = missing(x, i);
    if (k >= t->n && miss < 2) return t->side[!miss][k];
    /* What is equal on all of the box is what it was, though an if_ may have handed on that of side 0. */
    if (!(x->fact[p->id] & FACT_WIDE)) return t->side[1][k];
    bool same = side(p, 0) == side(p, 1); /* but known better on either side */
    return either(b, t->side[0][k], t->side[1][k],
                  same ? NULL : bounds_choice_open(x, b, i->args[0], side(p, 0), side(p, 1)), x->fact[p->id]);
}

/* The result `whole` where the condition surely leads to one side. One of the goal does not ask where it leads. */
static Boxed unless_whole(Boxes *x, Builder *b, const Results *t, uint32_t k, Inst *wholly, Boxed whole, Boxed other) {
    return k >= t->n && missing(x, t->proj[k]->args[0]) < 2 ? other : choose(x, b, wholly, whole, other);
}

/* Values of one side for all results, under what its condition teaches. */
static void region_values(Boxes *x, Builder *b, const Inst *i, uint32_t r, Results *t) {
    Boxed cond = value_of(x, i->args[0]);
    vec_push(x->arena, &x->path, ((PathStep){r ? bounds_not(b, cond.is.hi) : cond.is.lo, cond.open}));
    uint32_t mark = bounds_learn(x, b, i->args[0], r == 0);
    bounds_block(x, b, i->region[r]);
    take_side(x, t, r);
    bounds_forget(x, mark);
    x->path.len--;
}

static void zeros(Builder *b, const Results *t, Boxed *v) {
    for (uint32_t k = 0; k < t->all; k++) v[k] = zero(b, t->proj[k]->type);
}

static void open_if(Boxes *x, Builder *b, const Inst *i, Results *t) {
    Boxed cond = value_of(x, i->args[0]), *result = t->value;
    Inst *certain = cond.is.lo, *possible = cond.is.hi, *maybe_not = bounds_not(b, certain);
    bool through[2] = {passes_through(i->region[0]), passes_through(i->region[1])};
    uint32_t r = through[0] ? 1 : 0; /* the side that does something */
    if (through[0] && through[1]) {
        for (r = 0; r < 2; r++) region_values(x, b, i, r, t);
        for (uint32_t k = 0; k < t->all; k++)
            result[k] =
                unless_whole(x, b, t, k, certain, t->side[0][k],
                             unless_whole(x, b, t, k, bounds_not(b, possible), t->side[1][k], joined(x, b, t, k)));
    } else if (through[!r]) {
        Inst *br = ir_if(b, r ? maybe_not : possible);
        br->imm = i->imm;
        Builder in = ir_at_end(x->to, br->region[0]), out = ir_at_end(x->to, br->region[1]);
        region_values(x, &in, i, r, t);
        region_values(x, &in, i, !r, t);
        Inst *wholly = r ? bounds_not(&in, possible) : certain;
        for (uint32_t k = 0; k < t->all; k++)
            result[k] = unless_whole(x, &in, t, k, wholly, t->side[r][k], joined(x, &in, t, k));
        yield_all(x, &in, t, result);
        take_side(x, t, !r);
        yield_all(x, &out, t, t->side[!r]);
        read_all(x, b, t, br, result);
    } else {
        Inst *first = ir_if(b, possible);
        first->imm = i->imm;
        Builder in = ir_at_end(x->to, first->region[0]), out = ir_at_end(x->to, first->region[1]);
        region_values(x, &in, i, 0, t);
        yield_all(x, &in, t, t->side[0]);
        zeros(&out, t, t->side[1]);
        yield_all(x, &out, t, t->side[1]);
        read_all(x, b, t, first, t->side[0]);
        Inst *second = ir_if(b, maybe_not);
        second->imm = i->imm;
        in = ir_at_end(x->to, second->region[0]), out = ir_at_end(x->to, second->region[1]);
        region_values(x, &in, i, 1, t);
        for (uint32_t k = 0; k < t->all; k++)
            result[k] = unless_whole(x, &in, t, k, bounds_not(&in, possible), t->side[1][k], joined(x, &in, t, k));
        yield_all(x, &in, t, result);
        yield_all(x, &out, t, t->side[0]);
        read_all(x, b, t, second, result);
    }
}

void bounds_if(Boxes *x, Builder *b, const Inst *i) {
    Results t = results_of(x, i);
    if (bounds_wide(x, i->args[0])) open_if(x, b, i, &t);
    else uniform_if(x, b, i, &t);
    for (uint32_t k = 0; k < t.all; k++) (k < t.n ? x->value : x->given)[t.proj[k]->id] = t.value[k];
}

/* ---- loop */

void bounds_loop(Boxes *x, Builder *b, const Inst *i) {
    const Block *body = i->region[0];
    const Inst *flag = body->last->args[0];
    bool leaves = bounds_wide(x, flag); /* parts of the box may leave at different iterations */
    Insts init = {0};
    for (uint32_t c = 0; c < i->nargs; c++)
        pack(x, b, &init, x->fact[body->params[c + 1]->id], value_of(x, i->args[c]));
    uint32_t nstate = init.len;
    if (leaves) {
        vec_push(x->arena, &init, ir_constb(b, false)); /* some part may have left */
        vec_push(x->arena, &init, ir_consti(b, 0));     /* what that hung on */
        for (const Inst *p = NULL; next_result(i, &p);) pack(x, b, &init, x->fact[p->id], zero(b, p->type));
    }
    LoopInfo info = i->imm.loop;
    info.exact = info.exact && !leaves;
    Inst *loop = ir_loop(b, init.len, init.data, info);
    Block *in_body = loop->region[0];
    Builder in = ir_at_end(x->to, in_body);
    Inst *k = in_body->params[0];
    x->value[body->params[0]->id] = (Boxed){.is = {k, k}};
    uint32_t at = 1;
    for (uint32_t c = 0; c < i->nargs; c++) {
        const Inst *p = body->params[c + 1];
        x->value[p->id] = unpack_params(in_body, &at, x->fact[p->id]);
    }
    Inst *left = NULL, *left_open = NULL;
    if (leaves) {
        left = in_body->params[at++], left_open = in_body->params[at++];
        vec_push(x->arena, &x->path, ((PathStep){bounds_not(&in, left), left_open}));
    }
    if (leaves) want_truth(x, flag, true);
    bounds_block(x, &in, body);
    if (leaves) x->path.len--;
    Boxed go_on = value_of(x, flag);
    Insts out = {0};
    vec_push(x->arena, &out, go_on.is.hi);
    uint32_t mark = leaves ? bounds_learn(x, &in, flag, true) : 0;
    for (uint32_t c = 0; c < i->nargs; c++)
        pack(x, &in, &out, x->fact[body->params[c + 1]->id], value_given(x, body->last->args[c + 1]));
    if (leaves) bounds_forget(x, mark);
    if (leaves) {
        Inst *leaving = bounds_not(&in, go_on.is.lo);
        Inst *open = open_union(&in, left_open, go_on.open);
        vec_push(x->arena, &out, bounds_op2(&in, OP_bor, left, leaving));
        vec_push(x->arena, &out, open);
        for (const Inst *p = NULL; next_result(i, &p);) {
            Boxed before = unpack_params(in_body, &at, x->fact[p->id]);
            Boxed now = value_of(x, body->last->args[p->imm.i + 1]);
            Boxed both = either(&in, before, now, open, x->fact[p->id]);
            Boxed kept = choose(x, &in, leaving, choose(x, &in, left, both, now), before);
            pack(x, &in, &out, x->fact[p->id], kept);
        }
    }
    ir_yield(&in, out.len, out.data);
    if (leaves) {
        at = nstate + 2;
        for (const Inst *p = NULL; next_result(i, &p);) x->value[p->id] = unpack_results(b, loop, &at, x->fact[p->id]);
        return;
    }
    for (const Inst *p = NULL; next_result(i, &p);) {
        at = 0;
        for (uint32_t c = 0; c < (uint32_t)p->imm.i; c++) at += packed(x->fact[body->params[c + 1]->id]);
        uint8_t carried = x->fact[body->params[p->imm.i + 1]->id];
        x->value[p->id] = with_facts(unpack_results(b, loop, &at, carried), x->fact[p->id]);
    }
}

void bounds_block(Boxes *x, Builder *b, const Block *from) {
    for (const Inst *i = from->first; i; i = i->next) {
        b->span = i->span;
        switch ((Op)i->op) {
        case OP_yield:
        case OP_proj: break; /* read by their operations */
        case OP_print:
        case OP_count: break; /* said once, by the samples */
        case OP_if_: bounds_if(x, b, i); break;
        case OP_loop: bounds_loop(x, b, i); break;
        case OP_alloc: bounds_alloc(x, b, i); break;
        case OP_load: bounds_load(x, b, i); break;
        case OP_store: bounds_store(x, b, i); break;
        case OP_acopy: bounds_acopy(x, b, i); break;
        case OP_note: /* may it, and is it certain to (variant_lists.c) */
            ir_special(b, OP_note, TY_VOID, 2, (Inst *[]){value_of(x, i->args[0]).is.hi, value_of(x, i->args[1]).is.lo},
                       i->imm);
            break;
        default: bounds_value(x, b, i);
        }
    }
}
