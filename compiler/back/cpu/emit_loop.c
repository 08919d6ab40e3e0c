/* loop. Lanes leave a loop one by one, and the loop ends when none is left.
 *
 * An iteration is emitted as a path: along the ifs at the end of the body whose one side computes nothing. Where that
 * side is a `break`, the lanes that take it are gone, and the rest runs for those that stay: what the rest computes
 * needs no blend for lanes that nobody looks at again, and the test whether any lane is left is the test of that
 * branch. Where it is the side that goes on (a disc that is missed), iterations in which no lane takes the other go
 * straight to the next. So an iteration has one test for the loop's end, which is behind what decides it. */
#include "compiler/back/cpu/emit_control.h"

#include <string.h>

/* Is a list given? Small loops are emitted twice, for yes and for no: then whoever gives none pays nothing. */
typedef enum Listed { LISTED_NO, LISTED_YES, LISTED_PERHAPS } Listed;
enum {
    SMALL_LOOP = 64,  /* instructions of the body */
    LEAVE_BUDGET = 4, /* blends that cost no more than a branch around them */
};

/* A carried value. */
typedef struct Carried {
    Inst *param;
    bool vector; /* the parameter is */
    bool wanted; /* after the loop */
    bool read;   /* in the body */
    bool apart; /* lanes that have left hold its result in vectors of their own: the parameter is uniform, or none reads
                   it. Else they hold it in the parameter's. */
} Carried;

/* What lanes hold of a carried value. */
typedef struct Kept {
    Part *v;        /* vectors or a scalar */
    const Inst *of; /* the value that the lanes on a path have there; NULL: of several */
} Kept;
typedef struct Held {
    Kept next;   /* of the parameter */
    Kept result; /* apart: of lanes that have left */
} Held;

/* Where edges meet that carry masks and values. */
typedef struct Join {
    LLVMBasicBlockRef at;
    Part go;    /* latch: the uniform part of the flag */
    Part *live; /* latch: travelling */
    Held *held;
} Join;

typedef struct LoopState {
    Inst *i;
    const Inst *yield;
    Listed listed;
    bool diverges;
    Part j; /* iterations done */
    uint32_t n;
    Carried *carried; /* [n] */
    LLVMBasicBlockRef head;
    Join latch, done; /* done: of each value `next` or, apart, `result` */
} LoopState;

/* Which side of an if at the end of a block the path takes. */
typedef struct Step {
    const Inst *at;
    uint32_t side;
} Step;
enum { MAX_STEPS = 8 };

typedef struct Path {
    Step step[MAX_STEPS];
    uint32_t nsteps;
    Part *on, *live; /* travelling masks: the lanes that execute here, and those inside the loop, others than these
                        have skipped what is here. NULL: the loop does not diverge */
    bool alike;      /* on and live are the same */
    bool some;       /* live is known not to be empty */
    Held *held;      /* [n] */
} Path;

/* ---- what the flag and the values are along a path */
static const Inst *along(const Path *p, const Inst *v) {
    while (v->op == OP_proj) {
        uint32_t k = p->nsteps;
        while (k && p->step[k - 1].at != v->args[0]) k--;
        if (!k) break;
        v = ir_yield_of(p->step[k - 1].at->region[p->step[k - 1].side])->args[v->imm.i];
    }
    return v;
}

/* What a path does with its lanes, as far as constants tell. */
typedef enum Fate { LEAVES, STAYS, OPEN } Fate;

/* here: f is not of all lanes of the loop but of those on the path */
static Fate fate_of(const Emit *e, const Path *p, const Inst *f, bool negated, bool here) {
    const Inst *v = along(p, f);
    here |= v != f;
    if (v->op == OP_constb) return (v->imm.i != 0) != negated ? STAYS : LEAVES;
    if (v->op == OP_bnot) return fate_of(e, p, v->args[0], !negated, here);
    if ((v->op == OP_band && !negated) || (v->op == OP_bor && negated)) {
        Fate a = fate_of(e, p, v->args[0], negated, here), b = fate_of(e, p, v->args[1], negated, here);
        return a == LEAVES || b == LEAVES ? LEAVES : a == STAYS && b == STAYS ? STAYS : OPEN;
    }
    return here || emit_is_vector(e, v) ? OPEN : STAYS; /* of a uniform flag all lanes leave or none */
}
static Fate fate(const Emit *e, const LoopState *s, const Path *p) {
    return fate_of(e, p, s->yield->args[0], false, false);
}

/* A conjunction: of a uniform part, NULL: true, and of lanes. */
typedef struct Flag {
    Part scalar;
    bool varies;
    Part lanes[BACK_MAX_PARTS];
} Flag;

static void and_lanes(Emit *e, Flag *to, const Part *lanes) {
    for (uint32_t p = 0; p < e->P; p++)
        to->lanes[p] = to->varies ? LL(BuildAnd)(e->b, to->lanes[p], lanes[p], "") : lanes[p];
    to->varies = true;
}

static void and_scalar(Emit *e, Flag *to, Part f) {
    to->scalar = to->scalar ? LL(BuildAnd)(e->b, to->scalar, f, "") : f;
}

static void and_flag(Emit *e, const Path *p, const Inst *f, bool negated, bool here, Flag *to) {
    const Inst *v = along(p, f);
    here |= v != f && !p->alike;
    if (v->op == OP_bnot) {
        and_flag(e, p, v->args[0], !negated, here, to);
    } else if ((v->op == OP_band && !negated) || (v->op == OP_bor && negated)) {
        and_flag(e, p, v->args[0], negated, here, to);
        and_flag(e, p, v->args[1], negated, here, to);
    } else if (emit_is_vector(e, v) || here) {
        Part lanes[BACK_MAX_PARTS];
        if (v->op == OP_constb && (v->imm.i != 0) != negated) return;
        emit_parts(e, v, lanes);
        for (uint32_t k = 0; negated && k < e->P; k++) lanes[k] = LL(BuildNot)(e->b, lanes[k], "");
        and_lanes(e, to, lanes);
    } else {
        and_scalar(e, to, negated ? LL(BuildNot)(e->b, emit_scalar(e, v), "") : emit_scalar(e, v));
    }
}

/* Does v wait until the path's end, where what it is follows from the sides taken? */
static bool waits(Emit *e, const LoopState *s, const Block *b, const Inst *v) {
    if (ir_is_const(v) || v->op == OP_arg || emit_slot(e, v)[0]) return false;
    for (const Block *body = s->i->region[0];; b = b->owner->block) {
        if (v->block == b) return true;
        if (b == body) return false;
    }
}

/* Can and_flag take f apart into what is known by then? */
static bool parts_of_flag_known(Emit *e, const LoopState *s, const Path *p, const Block *b, const Inst *f,
                                bool negated) {
    f = along(p, f);
    if (f->op == OP_bnot) return parts_of_flag_known(e, s, p, b, f->args[0], !negated);
    if ((f->op == OP_band && !negated) || (f->op == OP_bor && negated))
        return parts_of_flag_known(e, s, p, b, f->args[0], negated) &&
               parts_of_flag_known(e, s, p, b, f->args[1], negated);
    return !waits(e, s, b, f);
}

static const Inst *value_of(const LoopState *s, const Path *p, uint32_t r) { return along(p, s->yield->args[r + 1]); }

/* ---- the if at the end of a block */
static bool is_empty(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next)
        if (i->op != OP_yield && !ir_is_const(i)) return false;
    return true;
}

static Inst *last_if(const Emit *e, const Block *b) {
    for (Inst *i = b->last; i; i = i->prev)
        if (i->op == OP_if_ && emit_is_vector(e, i->args[0]) && i->args[0]->op != OP_live) return i;
    return NULL;
}

/* Emits what is behind `last` and does not need its results, so that it is known on all ways. False if any of it that
 * does is more than what flags are made of, or must stay where it is. */
static bool emit_behind(Emit *e, Inst *last) {
    enum { MOST = 16 };
    const Inst *need[MOST];
    uint32_t n = 0;
    for (int emits = 0; emits < 2; emits++)
        for (Inst *i = last->next; i; i = i->next) {
            if (ir_is_const(i) || i->op == OP_yield || (i->op == OP_proj && i->args[0] == last)) continue;
            bool needs = false;
            for (uint32_t j = 0; j < i->nargs; j++) {
                needs |= i->args[j]->op == OP_proj && i->args[j]->args[0] == last;
                for (uint32_t k = 0; k < n; k++) needs |= need[k] == i->args[j];
            }
            if (needs && emits) continue;
            if (emits) emit_range(e, i, i->next);
            else if (!needs && ir_ops[i->op].special) return false;
            else if (needs && ((i->op != OP_bnot && i->op != OP_band && i->op != OP_bor) || n == MOST)) return false;
            else if (needs) need[n++] = i;
        }
    return true;
}

/* Tries to take `side` of last: the other computes nothing, and all lanes that want it leave, or all of them stay. */
static bool can_step(Emit *e, const LoopState *s, const Path *p, const Inst *last, uint32_t side, Fate other) {
    if (!is_empty(last->region[!side]) || p->nsteps == MAX_STEPS) return false;
    Path x = *p;
    x.nsteps++;
    for (uint32_t k = 0; k < 2; k++) {
        x.step[x.nsteps - 1] = (Step){last, k};
        if (k != side && fate(e, s, &x) != other) return false;
        if (!parts_of_flag_known(e, s, &x, last->block, s->yield->args[0], false)) return false;
        for (uint32_t r = 0; r < s->n; r++)
            if ((s->carried[r].wanted || s->carried[r].read) && waits(e, s, last->block, value_of(s, &x, r)))
                return false;
    }
    return true;
}

/* ---- joins */
static bool needed(const Carried *c) { return c->wanted || c->read; }

static Held *new_held(Emit *e, uint32_t n) {
    Held *h = ARENA_ARRAY(e->arena, Held, n + 1);
    for (uint32_t r = 0; r < n; r++) h[r] = (Held){{emit_new_parts(e), NULL}, {emit_new_parts(e), NULL}};
    return h;
}

static Kept copy_kept(Emit *e, Kept from) {
    Kept k = {emit_new_parts(e), from.of};
    memcpy(k.v, from.v, e->P * sizeof *k.v);
    return k;
}

static Held *copy_held(Emit *e, const LoopState *s, const Held *from) {
    Held *h = ARENA_ARRAY(e->arena, Held, s->n + 1);
    for (uint32_t r = 0; r < s->n; r++) h[r] = (Held){copy_kept(e, from[r].next), copy_kept(e, from[r].result)};
    return h;
}

static void new_phis(Emit *e, LLVMTypeRef t, uint32_t n, Part *out) {
    for (uint32_t k = 0; k < n; k++) out[k] = emit_phi(e, t, "");
}
static void add_to(Emit *e, const Part *phi, uint32_t n, const Part *v) {
    for (uint32_t k = 0; k < n; k++) emit_incoming(e, phi[k], v[k], emit_here(e));
}

static LLVMTypeRef result_type(Emit *e, const Carried *c) {
    return emit_vector_type(e, emit_scalar_type(e, c->param->type));
}
static uint32_t next_parts(const Emit *e, const Carried *c) { return c->vector ? e->P : 1; }

static void new_join(Emit *e, const LoopState *s, bool latch, Join *to) {
    LLVMBasicBlockRef here = emit_here(e);
    to->at = emit_new_block(e, latch ? "latch" : "done");
    emit_at(e, to->at);
    to->held = new_held(e, s->n);
    if (latch) {
        to->go = emit_phi(e, e->t_i1, "go");
        to->live = emit_new_parts(e);
        if (s->diverges) new_phis(e, emit_travelling_type(e), e->P, to->live);
    }
    for (uint32_t r = 0; r < s->n; r++) {
        const Carried *c = &s->carried[r];
        if (latch ? needed(c) : c->wanted && !c->apart)
            new_phis(e, emit_value_type(e, c->param), next_parts(e, c), to->held[r].next.v);
        if (c->apart) new_phis(e, result_type(e, c), e->P, to->held[r].result.v);
    }
    emit_at(e, here);
}

static void to_done(Emit *e, const LoopState *s, const Held *h) {
    for (uint32_t r = 0; r < s->n; r++) {
        const Carried *c = &s->carried[r];
        if (c->apart) add_to(e, s->done.held[r].result.v, e->P, h[r].result.v);
        else if (c->wanted) add_to(e, s->done.held[r].next.v, next_parts(e, c), h[r].next.v);
    }
}

static void to_latch(Emit *e, const LoopState *s, const Part *live, Part go, const Held *h) {
    emit_incoming(e, s->latch.go, go ? go : emit_int(e, e->t_i1, 1), emit_here(e));
    if (live) add_to(e, s->latch.live, e->P, live);
    for (uint32_t r = 0; r < s->n; r++) {
        const Carried *c = &s->carried[r];
        if (needed(c)) add_to(e, s->latch.held[r].next.v, next_parts(e, c), h[r].next.v);
        if (c->apart) add_to(e, s->latch.held[r].result.v, e->P, h[r].result.v);
    }
}

/* ---- a path */
/* Lanes of the mask take v, all for NULL. The others keep theirs. */
static void give(Emit *e, const Part *mask, const Inst *v, bool vector, Kept *to) {
    Part x[BACK_MAX_PARTS];
    uint32_t n = emit_result_parts(e, v, vector, x);
    for (uint32_t k = 0; k < n; k++)
        if (x[k] != to->v[k]) to->v[k] = mask ? LL(BuildSelect)(e->b, mask[k], x[k], to->v[k], "") : x[k];
}

/* So do at least all lanes that are on the path. */
static void take(Emit *e, const Part *mask, const Inst *v, bool vector, Kept *to) {
    if (to->of != v) give(e, mask, v, vector, to);
    to->of = v;
}

static void end_path(Emit *e, LoopState *s, Path *p) {
    Part on[BACK_MAX_PARTS], live[BACK_MAX_PARTS], travelling[BACK_MAX_PARTS];
    Flag f = {0};
    and_flag(e, p, s->yield->args[0], false, false, &f);
    if (s->diverges) emit_narrow(e, p->on, on), emit_narrow(e, p->live, live);
    for (uint32_t r = 0; r < s->n; r++) {
        const Carried *c = &s->carried[r];
        if (!needed(c)) continue;
        const Inst *v = value_of(s, p, r);
        if (c->apart && f.varies) take(e, on, v, true, &p->held[r].result); /* of those that leave here */
        bool blends = s->diverges && c->vector && (!p->alike || (c->wanted && !c->apart));
        if (blends && back_keeps_itself(&e->plan, v, c->param) && p->held[r].next.v[0] == emit_slot(e, c->param)[0])
            blends = false;
        take(e, blends ? on : NULL, v, c->vector, &p->held[r].next);
    }
    if (!s->diverges) {
        to_latch(e, s, NULL, f.scalar, p->held);
        LL(BuildBr)(e->b, s->latch.at);
        return;
    }
    for (uint32_t k = 0; f.varies && k < e->P; k++) {
        Part stays = p->alike ? f.lanes[k] : LL(BuildOr)(e->b, f.lanes[k], LL(BuildNot)(e->b, on[k], ""), "");
        live[k] = LL(BuildAnd)(e->b, live[k], stays, "");
    }
    if (f.varies) emit_widen(e, live, travelling);
    else memcpy(travelling, p->live, sizeof travelling);
    if (f.varies || !p->some) {
        Part any = emit_any(e, live);
        to_done(e, s, p->held);
        to_latch(e, s, travelling, f.scalar, p->held);
        LL(BuildCondBr)(e->b, any, s->latch.at, s->done.at);
    } else {
        to_latch(e, s, travelling, f.scalar, p->held);
        LL(BuildBr)(e->b, s->latch.at);
    }
}

static void emit_path(Emit *e, LoopState *s, Path *p, Block *b);

/* Does r change for lanes that leave where the others go on? */
static bool changes(const LoopState *s, const Path *p, const Path *skip, uint32_t r) {
    const Carried *c = &s->carried[r];
    const Held *h = &p->held[r];
    return c->apart || (c->wanted && value_of(s, skip, r) != h->next.of);
}

/* Lanes aside leave, which is rare and dear: only where some do, they take what they leave with, and it is asked
 * whether any stays. The builder stands in the region then. */
static void leave_apart(Emit *e, LoopState *s, Path *p, const Path *skip, Part *aside, LLVMBasicBlockRef region) {
    Part on[BACK_MAX_PARTS], live[BACK_MAX_PARTS], wide[BACK_MAX_PARTS];
    LLVMBasicBlockRef from = emit_here(e), leave = emit_new_block(e, "leave");
    emit_widen(e, aside, wide);
    LL(BuildCondBr)(e->b, emit_any(e, aside), leave, region);
    emit_at(e, leave);
    emit_narrow(e, wide, aside), emit_narrow(e, p->on, on), emit_narrow(e, p->live, live);
    Held *held = copy_held(e, s, p->held);
    for (uint32_t r = 0; r < s->n; r++) {
        const Carried *c = &s->carried[r];
        if (changes(s, p, skip, r))
            give(e, aside, value_of(s, skip, r), true, c->apart ? &held[r].result : &held[r].next);
    }
    for (uint32_t k = 0; k < e->P; k++) {
        Part not = LL(BuildNot)(e->b, aside[k], "");
        on[k] = LL(BuildAnd)(e->b, on[k], not, ""), live[k] = LL(BuildAnd)(e->b, live[k], not, "");
    }
    Part any = emit_any(e, live), *old_on = p->on, *old_live = p->live;
    emit_widen(e, on, on), emit_widen(e, live, live);
    to_done(e, s, held);
    LL(BuildCondBr)(e->b, any, region, s->done.at);
    emit_at(e, region);
    new_phis(e, emit_travelling_type(e), e->P, p->on = emit_new_parts(e));
    if (p->alike) p->live = p->on;
    else new_phis(e, emit_travelling_type(e), e->P, p->live = emit_new_parts(e));
    for (uint32_t k = 0; k < e->P; k++) {
        emit_incoming(e, p->on[k], old_on[k], from), emit_incoming(e, p->on[k], on[k], leave);
        if (p->alike) continue;
        emit_incoming(e, p->live[k], old_live[k], from), emit_incoming(e, p->live[k], live[k], leave);
    }
    for (uint32_t r = 0; r < s->n; r++) {
        const Carried *c = &s->carried[r];
        if (!changes(s, p, skip, r)) continue;
        Kept *to = c->apart ? &held[r].result : &held[r].next, *was = c->apart ? &p->held[r].result : &p->held[r].next;
        for (uint32_t k = 0; k < e->P; k++) {
            Part phi = emit_phi(e, result_type(e, c), "");
            emit_incoming(e, phi, was->v[k], from), emit_incoming(e, phi, to->v[k], leave);
            to->v[k] = phi;
        }
    }
    p->held = held;
    p->some = true;
}

/* Goes on into the side that computes something. */
static void step_into(Emit *e, LoopState *s, Path *p, Inst *last, uint32_t side, Fate other) {
    Path skip = *p;
    skip.step[skip.nsteps++] = (Step){last, !side};
    p->step[p->nsteps++] = (Step){last, side};
    Part on[BACK_MAX_PARTS], live[BACK_MAX_PARTS], wants[BACK_MAX_PARTS], aside[BACK_MAX_PARTS];
    emit_narrow(e, p->on, on), emit_narrow(e, p->live, live);
    for (uint32_t k = 0; k < e->P; k++) {
        Part cond = emit_slot(e, last->args[0])[k], not = LL(BuildNot)(e->b, cond, "");
        wants[k] = LL(BuildAnd)(e->b, on[k], side ? not : cond, "");
        aside[k] = LL(BuildAnd)(e->b, on[k], side ? cond : not, "");
        if (other == LEAVES)
            live[k] = p->alike ? wants[k] : LL(BuildAnd)(e->b, live[k], LL(BuildNot)(e->b, aside[k], ""), "");
    }
    uint32_t blends = 0;
    for (uint32_t r = 0; r < s->n; r++) blends += changes(s, p, &skip, r) ? e->P : 0;
    if (other == LEAVES && p->some && blends > LEAVE_BUDGET) {
        leave_apart(e, s, p, &skip, aside, emit_new_block(e, side ? "else" : "then"));
        emit_path(e, s, p, last->region[side]);
        return;
    }
    for (uint32_t r = 0; r < s->n; r++) { /* what the empty side yields is known: lanes aside take it before they go */
        const Carried *c = &s->carried[r];
        Held *h = &p->held[r];
        const Inst *v = value_of(s, &skip, r), *rest = value_of(s, p, r);
        if (c->apart && other == LEAVES) {
            take(e, on, v, true, &h->result);
        } else if (needed(c) && (other == STAYS || c->wanted)) {
            bool blends = c->vector && (!p->alike || !c->apart);
            if (blends && h->next.of == rest && v != rest) give(e, aside, v, true, &h->next);
            else take(e, blends ? on : NULL, v, c->vector, &h->next);
        }
    }
    p->on = emit_new_parts(e);
    emit_widen(e, wants, p->on);
    if (other == LEAVES) {
        if (p->alike) {
            p->live = p->on;
        } else {
            p->live = emit_new_parts(e);
            emit_widen(e, live, p->live);
        }
        p->some = false;
    } else {
        p->alike = false;
    }
    if (back_if_form(&e->plan, last) != IF_BLEND) {
        LLVMBasicBlockRef region = emit_new_block(e, side ? "else" : "then");
        if (other == LEAVES) {
            to_done(e, s, p->held);
            LL(BuildCondBr)(e->b, emit_any(e, live), region, s->done.at);
            p->some = true;
        } else {
            Flag f = {0};
            and_flag(e, &skip, s->yield->args[0], false, false, &f);
            to_latch(e, s, p->live, f.scalar, p->held);
            LL(BuildCondBr)(e->b, emit_any(e, wants), region, s->latch.at);
        }
        emit_at(e, region);
    }
    p->held = copy_held(e, s, p->held);
    emit_path(e, s, p, last->region[side]);
}

static void emit_path(Emit *e, LoopState *s, Path *p, Block *b) {
    Part *outer = e->mask;
    if (s->diverges) emit_narrow(e, p->on, e->mask = emit_new_parts(e));
    Inst *last = s->diverges ? last_if(e, b) : NULL;
    emit_range(e, b->first, last);
    for (uint32_t side = 0; last && !e->error && side < 2; side++) {
        if (!side && !emit_behind(e, last)) break;
        Fate other = can_step(e, s, p, last, side, LEAVES)             ? LEAVES
                     : p->some && can_step(e, s, p, last, side, STAYS) ? STAYS
                                                                       : OPEN;
        if (other == OPEN) continue;
        e->mask = outer;
        step_into(e, s, p, last, side, other);
        return;
    }
    if (last) emit_range(e, last, NULL);
    e->mask = outer;
    if (!e->error) end_path(e, s, p);
}

/* ---- the loop */
static Part is_listed(Emit *e, const CullSlot *c) {
    return LL(BuildICmp)(e->b, LLVMIntSGE, c->count, emit_int(e, e->t_i32, 0), "");
}

/* The number of the iteration, after j others. */
static Part iteration_number(Emit *e, const LoopState *s) {
    if (s->listed == LISTED_NO) return s->j;
    const CullSlot *c = &e->cull[s->i->imm.loop.cull_id];
    Part some = s->listed == LISTED_PERHAPS ? is_listed(e, c) : NULL, at = s->j;
    if (some) at = LL(BuildSelect)(e->b, some, at, emit_int(e, e->t_i32, 0), "");
    at = LL(BuildZExt)(e->b, at, e->t_i64, "");
    Part item = emit_load(e, e->t_i32, emit_gep(e, e->t_i32, c->items, at), 4, true);
    return some ? LL(BuildSelect)(e->b, some, item, s->j, "k") : item;
}

static void note_reads(const Block *b, bool *read) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t j = 0; j < i->nargs; j++) read[i->args[j]->id] = true;
        for (uint32_t r = 0; r < i->nregions; r++) note_reads(i->region[r], read);
    }
}

static void note_carried(Emit *e, LoopState *s) {
    const Block *body = s->i->region[0];
    s->n = body->nparams - 1;
    s->carried = ARENA_ARRAY(e->arena, Carried, s->n + 1);
    bool *read = ARENA_ARRAY(e->arena, bool, e->fn->ninsts + 1);
    note_reads(body, read);
    for (uint32_t r = 0; r < s->n; r++) {
        Inst *param = body->params[r + 1];
        s->carried[r] = (Carried){.param = param, .vector = emit_is_vector(e, param), .read = read[param->id]};
    }
    for (const Inst *p = emit_next_proj(s->i, NULL); p; p = emit_next_proj(s->i, p)) s->carried[p->imm.i].wanted = true;
    for (uint32_t r = 0; r < s->n; r++) {
        Carried *c = &s->carried[r];
        c->apart = s->diverges && c->wanted && !(c->vector && c->read);
    }
}

/* The head of the loop, and the way in. `loop` gets what lanes hold where an iteration begins. */
static void loop_head(Emit *e, LoopState *s, Path *loop) {
    Inst *i = s->i;
    Part(*init)[BACK_MAX_PARTS] = arena_alloc(e->arena, (s->n + 1) * sizeof *init), on[BACK_MAX_PARTS];
    for (uint32_t r = 0; r < s->n; r++) emit_result_parts(e, i->args[r], s->carried[r].vector, init[r]);
    for (uint32_t p = 0; s->diverges && p < e->P; p++) on[p] = e->mask ? e->mask[p] : emit_all_on(e);
    if (s->diverges) emit_widen(e, on, on);
    LLVMBasicBlockRef from = emit_here(e);
    s->head = emit_new_block(e, "loop");
    LL(BuildBr)(e->b, s->head);
    emit_at(e, s->head);
    s->j = emit_phi(e, e->t_i32, "j");
    emit_incoming(e, s->j, emit_int(e, e->t_i32, 0), from);
    loop->held = new_held(e, s->n);
    for (uint32_t r = 0; r < s->n; r++) {
        const Carried *c = &s->carried[r];
        Held *h = &loop->held[r];
        new_phis(e, emit_value_type(e, c->param), next_parts(e, c), h->next.v);
        for (uint32_t k = 0; k < next_parts(e, c); k++) emit_incoming(e, h->next.v[k], init[r][k], from);
        memcpy(emit_slot(e, c->param), h->next.v, next_parts(e, c) * sizeof(Part));
        h->next.of = c->param;
        if (!c->apart) continue;
        new_phis(e, result_type(e, c), e->P, h->result.v);
        for (uint32_t k = 0; k < e->P; k++) emit_incoming(e, h->result.v[k], LL(ConstNull)(result_type(e, c)), from);
    }
    if (s->diverges) {
        new_phis(e, emit_travelling_type(e), e->P, loop->live = loop->on = emit_new_parts(e));
        for (uint32_t k = 0; k < e->P; k++) emit_incoming(e, loop->live[k], on[k], from);
    }
    loop->alike = loop->some = true;
    emit_slot(e, i->region[0]->params[0])[0] = iteration_number(e, s);
    if (i->imm.loop.cull) e->cull[i->imm.loop.cull_id].place = s->j;
}

/* The way back, or out where the flag or the list says so. */
static void loop_latch(Emit *e, LoopState *s, const Path *head) {
    emit_at(e, s->latch.at);
    Part j_next = LL(BuildAdd)(e->b, s->j, emit_int(e, e->t_i32, 1), ""), go = s->latch.go;
    if (s->listed != LISTED_NO) {
        const CullSlot *list = &e->cull[s->i->imm.loop.cull_id];
        go = LL(BuildAnd)(e->b, go, LL(BuildICmp)(e->b, LLVMIntULT, j_next, list->count, ""), "");
    }
    LLVMBasicBlockRef last = emit_new_block(e, "last");
    LL(BuildCondBr)(e->b, go, s->head, last);
    emit_incoming(e, s->j, j_next, s->latch.at);
    if (s->diverges) add_to(e, head->live, e->P, s->latch.live);
    for (uint32_t r = 0; r < s->n; r++) {
        const Carried *c = &s->carried[r];
        const Held *h = &s->latch.held[r];
        for (uint32_t k = 0; k < next_parts(e, c); k++)
            emit_incoming(e, head->held[r].next.v[k],
                          needed(c) ? h->next.v[k] : LL(ConstNull)(emit_value_type(e, c->param)), s->latch.at);
        if (c->apart) add_to(e, head->held[r].result.v, e->P, h->result.v);
    }
    emit_at(e, last);
    Part live[BACK_MAX_PARTS];
    if (s->diverges) emit_narrow(e, s->latch.live, live);
    for (uint32_t r = 0; r < s->n; r++) {
        const Carried *c = &s->carried[r];
        Held *h = &s->latch.held[r];
        if (!c->apart) continue;
        for (uint32_t k = 0; k < e->P; k++)
            h->result.v[k] = LL(BuildSelect)(e->b, live[k], c->vector ? h->next.v[k] : emit_splat(e, h->next.v[0]),
                                             h->result.v[k], "");
    }
    to_done(e, s, s->latch.held);
    LL(BuildBr)(e->b, s->done.at);
}

static void emit_loop_as(Emit *e, Inst *i, Listed listed) {
    LoopState s = {.i = i,
                   .yield = ir_yield_of(i->region[0]),
                   .listed = listed,
                   .diverges = e->W > 1 && (i->flags & BACK_DIVERGES)};
    note_carried(e, &s);
    LLVMBasicBlockRef before = NULL, skip_join = NULL;
    Part(*init)[BACK_MAX_PARTS] = arena_alloc(e->arena, (s.n + 1) * sizeof *init);
    if (listed != LISTED_NO) { /* an empty list: no iteration, the results are the initial values */
        LLVMBasicBlockRef some = emit_new_block(e, "some");
        skip_join = emit_new_block(e, "culled");
        Part empty = LL(BuildICmp)(e->b, LLVMIntEQ, e->cull[i->imm.loop.cull_id].count, emit_int(e, e->t_i32, 0), "");
        for (const Inst *p = emit_next_proj(i, NULL); p; p = emit_next_proj(i, p))
            emit_result_parts(e, i->args[p->imm.i], emit_is_vector(e, p), init[p->imm.i]);
        before = emit_here(e);
        LL(BuildCondBr)(e->b, empty, skip_join, some);
        emit_at(e, some);
    }
    Path head = {0};
    loop_head(e, &s, &head);
    new_join(e, &s, true, &s.latch);
    new_join(e, &s, false, &s.done);
    Path path = head;
    path.held = copy_held(e, &s, head.held);
    emit_path(e, &s, &path, i->region[0]);
    if (e->error) return;
    loop_latch(e, &s, &head);
    emit_at(e, s.done.at);
    if (skip_join) {
        LL(BuildBr)(e->b, skip_join);
        emit_at(e, skip_join);
    }
    for (const Inst *p = emit_next_proj(i, NULL); p; p = emit_next_proj(i, p)) {
        const Carried *c = &s.carried[p->imm.i];
        const Part *v = c->apart ? s.done.held[p->imm.i].result.v : s.done.held[p->imm.i].next.v;
        for (uint32_t k = 0; k < back_value_parts(&e->plan, p); k++) {
            Part out = v[k];
            if (!emit_is_vector(e, p) && c->vector) /* only its first value differs between lanes */
                out = LL(BuildExtractElement)(e->b, v[0], emit_int(e, e->t_i32, 0), "");
            else if (emit_is_vector(e, p) && !c->apart && !c->vector) /* likewise, of an empty list */
                out = emit_splat(e, v[0]);
            if (skip_join) {
                Part phi = emit_phi(e, emit_value_type(e, p), "");
                emit_incoming(e, phi, init[p->imm.i][k], before);
                emit_incoming(e, phi, out, s.done.at);
                out = phi;
            }
            emit_slot(e, p)[k] = out;
        }
    }
}
static void forget_values(Emit *e, const Block *b) {
    for (uint32_t p = 0; p < b->nparams; p++) emit_slot(e, b->params[p])[0] = NULL;
    for (const Inst *i = b->first; i; i = i->next) {
        emit_slot(e, i)[0] = NULL;
        for (uint32_t r = 0; r < i->nregions; r++) forget_values(e, i->region[r]);
    }
}

static uint32_t size_of(const Block *b) {
    uint32_t n = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        n += !ir_is_const(i) && i->op != OP_proj && i->op != OP_yield;
        for (uint32_t r = 0; r < i->nregions; r++) n += size_of(i->region[r]);
    }
    return n;
}

void emit_loop(Emit *e, Inst *i) {
    if (!i->imm.loop.cull || size_of(i->region[0]) > SMALL_LOOP) {
        emit_loop_as(e, i, i->imm.loop.cull ? LISTED_PERHAPS : LISTED_NO);
        return;
    }
    LLVMBasicBlockRef start[2] = {emit_new_block(e, "all"), emit_new_block(e, "listed")}, end[2],
                      join = emit_new_block(e, "join");
    const size_t n = emit_proj_count(i) * e->P;
    Part *x = ARENA_ARRAY(e->arena, Part, 2 * n + 1);
    LL(BuildCondBr)(e->b, is_listed(e, &e->cull[i->imm.loop.cull_id]), start[1], start[0]);
    for (uint32_t s = 0; s < 2 && !e->error; s++) {
        emit_at(e, start[s]);
        forget_values(e, i->region[0]);
        emit_loop_as(e, i, s ? LISTED_YES : LISTED_NO);
        Part *at = x + s * n;
        for (const Inst *p = emit_next_proj(i, NULL); p; p = emit_next_proj(i, p), at += e->P)
            memcpy(at, emit_slot(e, p), back_value_parts(&e->plan, p) * sizeof *at);
        end[s] = emit_here(e);
        LL(BuildBr)(e->b, join);
    }
    if (e->error) return;
    emit_at(e, join);
    Part *at = x;
    for (const Inst *p = emit_next_proj(i, NULL); p; p = emit_next_proj(i, p), at += e->P)
        for (uint32_t k = 0; k < back_value_parts(&e->plan, p); k++) {
            Part phi = emit_phi(e, emit_value_type(e, p), "");
            for (uint32_t s = 0; s < 2; s++) emit_incoming(e, phi, at[s * n + k], end[s]);
            emit_slot(e, p)[k] = phi;
        }
}
