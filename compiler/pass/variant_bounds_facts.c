/* Which values differ within a box, and which may hang on something open: forwards, until nothing changes. */
#include "compiler/pass/variant_bounds.h"

typedef struct Flow {
    const Boxes *x;
    uint8_t *fact;
    bool changed;
} Flow;

static void add(Flow *f, const Inst *to, uint8_t fact) {
    bool error = f->x->wanted && f->x->wanted[to->id] && (to->type == TY_FLT || to->type == TY_ARRAY);
    if (!error) fact &= (uint8_t)~FACT_ERROR;
    if (!f->x->leans || !f->x->leans[to->id] || to->type != TY_FLT) fact &= (uint8_t)~FACT_LEAN;
    if (fact & ~f->fact[to->id]) f->fact[to->id] |= fact, f->changed = true;
}

/* May a value row jump or bend for reasons of its own? */
static bool may_open(Op op) { return ir_ops[op].arg == TY_FLT && !ir_ops[op].selects && ir_bound_has_events(op); }

/* Rows whose result is what its arguments are, or one of them, are exact; those of integers carry none. */
static bool rounds(Op op) {
    if (ir_ops[op].special || ir_ops[op].result != TY_FLT || ir_ops[op].selects) return false;
    return op != OP_fneg && op != OP_fabs && op != OP_fmin && op != OP_fmax && op != OP_fcopysign;
}

uint8_t bounds_result_fact(const Boxes *x, const Inst *i, uint32_t index) {
    uint8_t fact = 0;
    for (uint32_t r = 0; r < i->nregions; r++) fact |= x->fact[walk_results(i, i->region[r])[index]->id];
    if (i->op == OP_if_ && bounds_wide(x, i->args[0]) &&
        i->region[0]->last->args[index] != i->region[1]->last->args[index])
        fact |= FACT_WIDE | FACT_OPEN;
    if (i->op == OP_loop && bounds_wide(x, i->region[0]->last->args[0])) fact |= FACT_WIDE | FACT_OPEN;
    return fact;
}

bool bounds_slopes(const Boxes *x, const Inst *i) {
    for (uint32_t a = 0; a < i->nargs; a++)
        if (x->fact[i->args[a]->id] & FACT_SLOPE) return true;
    return false;
}

static bool is_rounding(Op op) { return op == OP_ffloor || op == OP_fceil || op == OP_fround || op == OP_ftrunc; }

/* partly: what stands here may run on a part of the box only. */
static void flow(Flow *f, const Block *b, bool partly);

static void flow_loop(Flow *f, const Inst *i, bool partly) {
    const Block *body = i->region[0];
    for (uint32_t p = 1; p < body->nparams; p++)
        add(f, body->params[p], f->fact[i->args[p - 1]->id] | f->fact[body->last->args[p]->id]);
    flow(f, body, partly || bounds_wide(f->x, body->last->args[0]));
}

static void flow(Flow *f, const Block *b, bool partly) {
    for (const Inst *i = b->first; i; i = i->next) {
        uint8_t fact = 0;
        switch ((Op)i->op) {
        case OP_input:
            if (i->imm.i <= IN_X2) fact = FACT_WIDE | FACT_SLOPE | (i->imm.i <= IN_X1 ? FACT_LEAN : 0);
            else if (i->imm.i <= IN_SAMPLE) fact = FACT_WIDE | FACT_OPEN;
            break;
        case OP_constf:
            if (variant_is_uncaptured(i)) fact = FACT_WIDE | FACT_SLOPE | FACT_CAPTURE;
            break;
        case OP_rand:
        case OP_query:
        case OP_window: fact = FACT_WIDE | FACT_OPEN; break;
        case OP_store:
            fact = f->fact[i->args[1]->id] | f->fact[i->args[2]->id]; /* an index has no slope */
            add(f, i->args[0], partly || (fact & FACT_WIDE) ? fact | FACT_WIDE | FACT_OPEN : fact);
            continue;
        case OP_acopy:
            add(f, i->args[0], (uint8_t)(f->fact[i->args[1]->id] | (partly ? FACT_WIDE | FACT_OPEN : 0)));
            continue;
        case OP_if_:
            for (uint32_t r = 0; r < 2; r++) flow(f, i->region[r], partly || bounds_wide(f->x, i->args[0]));
            continue;
        case OP_loop: flow_loop(f, i, partly); continue;
        case OP_proj: fact = bounds_result_fact(f->x, i->args[0], (uint32_t)i->imm.i); break;
        case OP_choice:
        case OP_give:
        case OP_yield: continue;
        case OP_take: /* of a tangent it is not asked what it hangs on */
            fact = FACT_WIDE;
            if (!f->x->ends_alone && !i->imm.frame.place) fact |= FACT_OPEN | FACT_SLOPE | FACT_ERROR;
            break;
        default:
            for (uint32_t a = 0; a < i->nargs; a++) fact |= f->fact[i->args[a]->id];
            if (variant_is_site(i)) fact = f->fact[i->args[0]->id];
            if (i->op != OP_fmul && i->op != OP_fadd && i->op != OP_fsel) fact &= (uint8_t)~FACT_CAPTURE;
            if (!bounds_hands_on_lean(i)) fact &= (uint8_t)~FACT_LEAN;
            if (rounds((Op)i->op)) fact |= FACT_ERROR;
            if (i->type != TY_FLT || is_rounding((Op)i->op)) fact &= (uint8_t)~FACT_SLOPE;
            if ((fact & FACT_WIDE) && (variant_is_site(i) || may_open((Op)i->op))) fact |= FACT_OPEN;
        }
        add(f, i, fact);
    }
}

/* ---- whose error g needs: backwards */

static void want(Boxes *x, const Inst *v);

static void want_stores(Boxes *x, const Block *b, const Inst *array) {
    for (const Inst *i = b->first; i; i = i->next) {
        if ((i->op == OP_store || i->op == OP_acopy) && i->args[0] == array)
            want(x, i->args[i->op == OP_store ? 2 : 1]);
        for (uint32_t r = 0; r < i->nregions; r++) want_stores(x, i->region[r], array);
    }
}

/* Whatever chunks hand on may be what is taken. */
static void want_given(Boxes *x, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_give && !i->imm.frame.place) want(x, i->args[0]);
        for (uint32_t r = 0; r < i->nregions; r++) want_given(x, i->region[r]);
    }
}

static void want(Boxes *x, const Inst *v) {
    if ((v->type != TY_FLT && v->type != TY_ARRAY) || x->wanted[v->id]) return;
    x->wanted[v->id] = true;
    if (v->op == OP_alloc) want_stores(x, x->from->body, v);
    if (v->op == OP_take && !x->wants_given) x->wants_given = true, want_given(x, x->from->body);
    if (v->op == OP_arg) {
        const Inst *loop = v->block->owner;
        want(x, loop->args[v->imm.i - 1]), want(x, v->block->last->args[v->imm.i]);
    } else if (v->op == OP_proj) {
        const Inst *owner = v->args[0];
        for (uint32_t r = 0; r < owner->nregions; r++) want(x, walk_results(owner, owner->region[r])[v->imm.i]);
        if (owner->op == OP_loop) want(x, owner->region[0]->params[v->imm.i + 1]);
    } else {
        for (uint32_t a = 0; a < v->nargs; a++) want(x, v->args[a]);
    }
}

void bounds_want_error(Boxes *x, const Inst *v) { want(x, v); }

void bounds_facts(Boxes *x) {
    Flow f = {.x = x, .fact = x->fact};
    do {
        f.changed = false;
        flow(&f, x->from->body, false);
    } while (f.changed);
}
