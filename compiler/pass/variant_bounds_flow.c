/* Bounds of structured operations.
 *
 * An if_ whose condition may differ within the box becomes two one-sided ones, of which both run where it does; one, if
 * a side only passes values through. A loop runs as long as it may go on somewhere; what it may have been left with
 * before is kept in an exit hull. */
#include "compiler/pass/variant_bounds.h"

typedef Vec(Inst *) Insts;

/* ---- a Boxed as the values that an operation yields or carries: lo, [hi], [open], [error] by its facts */

static void pack(Boxes *x, Builder *b, Insts *to, uint8_t fact, Boxed v) {
    if ((v.is.lo != v.is.hi && !(fact & FACT_WIDE)) || (v.open && !(fact & FACT_OPEN)))
        ice(x->to->session, "bounds: a value has more than its facts");
    vec_push(x->arena, to, v.is.lo);
    if (fact & FACT_WIDE) vec_push(x->arena, to, v.is.hi);
    if (fact & FACT_OPEN) vec_push(x->arena, to, v.open ? v.open : ir_consti(b, 0));
    if (fact & FACT_ERROR) vec_push(x->arena, to, v.error ? v.error : ir_constf(b, 0));
}

static uint32_t packed(uint8_t fact) {
    return 1u + (fact & FACT_WIDE ? 1u : 0u) + (fact & FACT_OPEN ? 1u : 0u) + (fact & FACT_ERROR ? 1u : 0u);
}

static Boxed unpack_params(const Block *body, uint32_t *at, uint8_t fact) {
    Boxed v = {0};
    v.is.lo = v.is.hi = body->params[(*at)++];
    if (fact & FACT_WIDE) v.is.hi = body->params[(*at)++];
    if (fact & FACT_OPEN) v.open = body->params[(*at)++];
    if (fact & FACT_ERROR) v.error = body->params[(*at)++];
    return v;
}

static Boxed unpack_results(Builder *b, Inst *op, uint32_t *at, uint8_t fact) {
    Boxed v = {0};
    v.is.lo = v.is.hi = ir_proj(b, op, (*at)++);
    if (fact & FACT_WIDE) v.is.hi = ir_proj(b, op, (*at)++);
    if (fact & FACT_OPEN) v.open = ir_proj(b, op, (*at)++);
    if (fact & FACT_ERROR) v.error = ir_proj(b, op, (*at)++);
    return v;
}

/* The same value under fewer facts. */
static Boxed with_facts(Boxed v, uint8_t fact) {
    if (!(fact & FACT_WIDE)) v.is.hi = v.is.lo;
    if (!(fact & FACT_OPEN)) v.open = NULL;
    if (!(fact & FACT_ERROR)) v.error = NULL;
    return v;
}

static Boxed zero(Builder *b, unsigned type) {
    Inst *z = ir_zero(b, (IrType)type);
    return (Boxed){.is = {z, z}};
}

static Boxed value_of(const Boxes *x, const Inst *v) { return x->value[v->id]; }

/* which ? p : q, of bounds and sets */
static Boxed choose(Builder *b, Inst *which, Boxed p, Boxed q) {
    Boxed r;
    r.is.lo = bounds_choose(b, which, p.is.lo, q.is.lo);
    r.is.hi = p.is.lo == p.is.hi && q.is.lo == q.is.hi ? r.is.lo : bounds_choose(b, which, p.is.hi, q.is.hi);
    r.open = p.open || q.open ? open_where(b, which, p.open, q.open) : NULL;
    r.error = error_larger(b, p.error, q.error);
    return r;
}

/* Either of the two, by something that is open itself. But an event is captured once: what holds g on both sides holds
 * the same, and where one side has nothing, what was decided is only whether the event exists. */
static Boxed either(Builder *b, Boxed p, Boxed q, Inst *open, uint8_t fact) {
    Boxed r = {.error = error_larger(b, p.error, q.error)};
    bool same = p.is.lo == q.is.lo && p.is.hi == q.is.hi;
    r.is = same ? p.is : ir_bound_hull(b, p.is, q.is);
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

static void uniform_if(Boxes *x, Builder *b, const Inst *i) {
    Inst *br = ir_if(b, value_of(x, i->args[0]).is.lo);
    br->imm = i->imm;
    for (uint32_t r = 0; r < 2; r++) {
        Builder in = ir_at_end(x->to, br->region[r]);
        bounds_block(x, &in, i->region[r]);
        Insts out = {0};
        for (const Inst *p = NULL; next_result(i, &p);) pack(x, &in, &out, x->fact[p->id], value_of(x, side(p, r)));
        ir_yield(&in, out.len, out.data);
    }
    uint32_t at = 0;
    for (const Inst *p = NULL; next_result(i, &p);) x->value[p->id] = unpack_results(b, br, &at, x->fact[p->id]);
}

static bool passes_through(const Block *region) { return region->first == region->last; }

/* Where the condition holds on a part of the box only, the set that a result gets from it. */
static Boxed joined(Boxes *x, Builder *b, const Inst *p, Boxed yes, Boxed no) {
    const Inst *i = p->args[0];
    bool same = side(p, 0) == side(p, 1); /* but known better on either side */
    return either(b, yes, no, same ? NULL : bounds_choice_open(x, b, i->args[0], side(p, 0), side(p, 1)),
                  x->fact[p->id]);
}

/* Values of one side for all results, under what its condition teaches. */
static void region_values(Boxes *x, Builder *b, const Inst *i, uint32_t r, Boxed *out) {
    Boxed cond = value_of(x, i->args[0]);
    vec_push(x->arena, &x->path, ((PathStep){r ? bounds_not(b, cond.is.hi) : cond.is.lo, cond.open}));
    uint32_t mark = bounds_learn(x, b, i->args[0], r == 0);
    bounds_block(x, b, i->region[r]);
    uint32_t n = 0;
    for (const Inst *p = NULL; next_result(i, &p);) out[n++] = value_of(x, side(p, r));
    bounds_forget(x, mark);
    x->path.len--;
}

static void yield_all(Boxes *x, Builder *b, const Inst *i, const Boxed *v) {
    Insts out = {0};
    uint32_t n = 0;
    for (const Inst *p = NULL; next_result(i, &p); n++) pack(x, b, &out, x->fact[p->id], v[n]);
    ir_yield(b, out.len, out.data);
}

static void read_all(Boxes *x, Builder *b, const Inst *i, Inst *br, Boxed *v) {
    uint32_t at = 0, n = 0;
    for (const Inst *p = NULL; next_result(i, &p); n++) v[n] = unpack_results(b, br, &at, x->fact[p->id]);
}

static void open_if(Boxes *x, Builder *b, const Inst *i) {
    Boxed cond = value_of(x, i->args[0]);
    Inst *certain = cond.is.lo, *possible = cond.is.hi, *maybe_not = bounds_not(b, certain);
    uint32_t n = 0;
    for (const Inst *p = NULL; next_result(i, &p);) n++;
    Boxed *v[2] = {ARENA_ARRAY(x->arena, Boxed, n + 1), ARENA_ARRAY(x->arena, Boxed, n + 1)};
    Boxed *result = ARENA_ARRAY(x->arena, Boxed, n + 1);
    bool through[2] = {passes_through(i->region[0]), passes_through(i->region[1])};
    uint32_t r = through[0] ? 1 : 0; /* the side that does something */
    if (through[0] && through[1]) {
        for (r = 0; r < 2; r++) region_values(x, b, i, r, v[r]);
        n = 0;
        for (const Inst *p = NULL; next_result(i, &p); n++)
            result[n] = choose(b, certain, v[0][n], choose(b, possible, joined(x, b, p, v[0][n], v[1][n]), v[1][n]));
    } else if (through[!r]) {
        Inst *br = ir_if(b, r ? maybe_not : possible);
        br->imm = i->imm;
        Builder in = ir_at_end(x->to, br->region[0]), out = ir_at_end(x->to, br->region[1]);
        region_values(x, &in, i, r, v[r]);
        region_values(x, &in, i, !r, v[!r]);
        Inst *wholly = r ? bounds_not(&in, possible) : certain;
        n = 0;
        for (const Inst *p = NULL; next_result(i, &p); n++)
            result[n] = choose(&in, wholly, v[r][n], joined(x, &in, p, v[0][n], v[1][n]));
        yield_all(x, &in, i, result);
        n = 0;
        for (const Inst *p = NULL; next_result(i, &p); n++) v[!r][n] = value_of(x, side(p, !r));
        yield_all(x, &out, i, v[!r]);
        read_all(x, b, i, br, result);
    } else {
        Inst *first = ir_if(b, possible);
        first->imm = i->imm;
        Builder in = ir_at_end(x->to, first->region[0]), out = ir_at_end(x->to, first->region[1]);
        region_values(x, &in, i, 0, v[0]);
        yield_all(x, &in, i, v[0]);
        n = 0;
        for (const Inst *p = NULL; next_result(i, &p); n++) v[1][n] = zero(&out, p->type);
        yield_all(x, &out, i, v[1]);
        read_all(x, b, i, first, v[0]);
        Inst *second = ir_if(b, maybe_not);
        second->imm = i->imm;
        in = ir_at_end(x->to, second->region[0]), out = ir_at_end(x->to, second->region[1]);
        region_values(x, &in, i, 1, v[1]);
        n = 0;
        for (const Inst *p = NULL; next_result(i, &p); n++)
            result[n] = choose(&in, possible, joined(x, &in, p, v[0][n], v[1][n]), v[1][n]);
        yield_all(x, &in, i, result);
        yield_all(x, &out, i, v[0]);
        read_all(x, b, i, second, result);
    }
    n = 0;
    for (const Inst *p = NULL; next_result(i, &p); n++) x->value[p->id] = result[n];
}

void bounds_if(Boxes *x, Builder *b, const Inst *i) {
    if (bounds_wide(x, i->args[0])) open_if(x, b, i);
    else uniform_if(x, b, i);
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
    bounds_block(x, &in, body);
    if (leaves) x->path.len--;
    Boxed go_on = value_of(x, flag);
    Insts out = {0};
    vec_push(x->arena, &out, go_on.is.hi);
    for (uint32_t c = 0; c < i->nargs; c++)
        pack(x, &in, &out, x->fact[body->params[c + 1]->id], value_of(x, body->last->args[c + 1]));
    if (leaves) {
        Inst *leaving = bounds_not(&in, go_on.is.lo);
        Inst *open = open_union(&in, left_open, go_on.open);
        vec_push(x->arena, &out, bounds_op2(&in, OP_bor, left, leaving));
        vec_push(x->arena, &out, open);
        for (const Inst *p = NULL; next_result(i, &p);) {
            Boxed before = unpack_params(in_body, &at, x->fact[p->id]);
            Boxed now = value_of(x, body->last->args[p->imm.i + 1]);
            Boxed both = either(&in, before, now, open, x->fact[p->id]);
            Boxed kept = choose(&in, leaving, choose(&in, left, both, now), before);
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
