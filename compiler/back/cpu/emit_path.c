/* An iteration of a loop, emitted as a path along the ifs at the end of the body whose one side computes nothing.
 *
 * Where that side is a `break`, the lanes that take it are gone, and the rest runs for those that stay: what the rest
 * computes needs no blend for lanes that nobody looks at again, and the test whether any lane is left is the test of
 * that branch. Where it is the side that goes on (a disc that is missed), iterations in which no lane takes the other
 * go straight to the next. So an iteration has one test for the loop's end, which is behind what decides it. */
#include "compiler/back/cpu/emit_loop.h"

#include <string.h>

enum { LEAVE_BUDGET = 4 }; /* blends that cost no more than a branch around them */

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
/* The last if of b at which lanes part. */
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
    if (!back_is_empty(last->region[!side]) || p->nsteps == MAX_STEPS) return false;
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
    Part live[BACK_MAX_PARTS];
    const Part *on = p->on;
    Flag f = {0};
    and_flag(e, p, s->yield->args[0], false, false, &f);
    if (s->diverges) memcpy(live, p->live, e->P * sizeof *live);
    for (uint32_t r = 0; r < s->n; r++) {
        const Carried *c = &s->carried[r];
        if (!loop_needed(c)) continue;
        const Inst *v = value_of(s, p, r);
        if (c->apart && f.varies) take(e, on, v, true, &p->held[r].result); /* of those that leave here */
        bool blends = s->diverges && c->vector && (!p->alike || (c->wanted && !c->apart));
        if (blends && back_keeps_itself(&e->plan, v, c->param) && p->held[r].next.v[0] == emit_slot(e, c->param)[0])
            blends = false;
        take(e, blends ? on : NULL, v, c->vector, &p->held[r].next);
    }
    if (!s->diverges) {
        loop_to_latch(e, s, NULL, f.scalar, p->held);
        LL(BuildBr)(e->b, s->latch.at);
        return;
    }
    for (uint32_t k = 0; f.varies && k < e->P; k++) {
        Part stays = p->alike ? f.lanes[k] : LL(BuildOr)(e->b, f.lanes[k], LL(BuildNot)(e->b, on[k], ""), "");
        live[k] = LL(BuildAnd)(e->b, live[k], stays, "");
    }
    if (f.varies || !p->some) {
        Part any = emit_any(e, live);
        loop_to_done(e, s, p->held);
        loop_to_latch(e, s, live, f.scalar, p->held);
        LL(BuildCondBr)(e->b, any, s->latch.at, s->done.at);
    } else {
        loop_to_latch(e, s, live, f.scalar, p->held);
        LL(BuildBr)(e->b, s->latch.at);
    }
}

/* Does r change for lanes that leave where the others go on? */
static bool changes(const LoopState *s, const Path *p, const Path *skip, uint32_t r) {
    const Carried *c = &s->carried[r];
    const Held *h = &p->held[r];
    return c->apart || (c->wanted && value_of(s, skip, r) != h->next.of);
}

/* Lanes aside leave, which is rare and dear: only where some do, they take what they leave with, and it is asked
 * whether any stays. The builder stands in the region then. */
static void leave_apart(Emit *e, LoopState *s, Path *p, const Path *skip, Part *aside, LLVMBasicBlockRef region) {
    Part on[BACK_MAX_PARTS], live[BACK_MAX_PARTS];
    LLVMBasicBlockRef from = emit_here(e), leave = emit_new_block(e, "leave");
    LL(BuildCondBr)(e->b, emit_any(e, aside), leave, region);
    emit_at(e, leave);
    Held *held = loop_copy_held(e, s, p->held);
    for (uint32_t r = 0; r < s->n; r++) {
        const Carried *c = &s->carried[r];
        if (changes(s, p, skip, r))
            give(e, aside, value_of(s, skip, r), true, c->apart ? &held[r].result : &held[r].next);
    }
    for (uint32_t k = 0; k < e->P; k++) {
        Part not = LL(BuildNot)(e->b, aside[k], "");
        on[k] = LL(BuildAnd)(e->b, p->on[k], not, ""), live[k] = LL(BuildAnd)(e->b, p->live[k], not, "");
    }
    Part any = emit_any(e, live), *old_on = p->on, *old_live = p->live;
    loop_to_done(e, s, held);
    LL(BuildCondBr)(e->b, any, region, s->done.at);
    emit_at(e, region);
    loop_new_phis(e, emit_vector_type(e, e->t_i1), e->P, p->on = emit_new_parts(e));
    if (p->alike) p->live = p->on;
    else loop_new_phis(e, emit_vector_type(e, e->t_i1), e->P, p->live = emit_new_parts(e));
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
            Part phi = emit_phi(e, loop_result_type(e, c), "");
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
    Part live[BACK_MAX_PARTS], aside[BACK_MAX_PARTS], *wants = emit_new_parts(e);
    const Part *on = p->on;
    memcpy(live, p->live, e->P * sizeof *live);
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
        loop_path(e, s, p, last->region[side]);
        return;
    }
    for (uint32_t r = 0; r < s->n; r++) { /* what the empty side yields is known: lanes aside take it before they go */
        const Carried *c = &s->carried[r];
        Held *h = &p->held[r];
        const Inst *v = value_of(s, &skip, r), *rest = value_of(s, p, r);
        if (c->apart && other == LEAVES) {
            take(e, on, v, true, &h->result);
        } else if (loop_needed(c) && (other == STAYS || c->wanted)) {
            bool blends = c->vector && (!p->alike || !c->apart);
            if (blends && h->next.of == rest && v != rest) give(e, aside, v, true, &h->next);
            else take(e, blends ? on : NULL, v, c->vector, &h->next);
        }
    }
    p->on = wants;
    if (other == LEAVES) {
        if (p->alike) {
            p->live = p->on;
        } else {
            p->live = emit_new_parts(e);
            memcpy(p->live, live, e->P * sizeof *live);
        }
        p->some = false;
    } else {
        p->alike = false;
    }
    if (back_if_form(&e->plan, last) != IF_BLEND) {
        LLVMBasicBlockRef region = emit_new_block(e, side ? "else" : "then");
        if (other == LEAVES) {
            loop_to_done(e, s, p->held);
            LL(BuildCondBr)(e->b, emit_any(e, live), region, s->done.at);
            p->some = true;
        } else {
            Flag f = {0};
            and_flag(e, &skip, s->yield->args[0], false, false, &f);
            loop_to_latch(e, s, p->live, f.scalar, p->held);
            LL(BuildCondBr)(e->b, emit_any(e, wants), region, s->latch.at);
        }
        emit_at(e, region);
    }
    p->held = loop_copy_held(e, s, p->held);
    loop_path(e, s, p, last->region[side]);
}

void loop_path(Emit *e, LoopState *s, Path *p, Block *b) {
    Part *outer = e->mask;
    if (s->diverges) e->mask = p->on;
    Inst *last = s->diverges ? last_if(e, b) : NULL;
    emit_range(e, b->first, last);
    const bool known = last && emit_behind(e, last);
    for (uint32_t k = 0; known && !e->error && k < 4; k++) { /* a side that leaves first: both may be empty */
        const uint32_t side = k & 1;
        const Fate other = k < 2 ? LEAVES : STAYS;
        if ((other == STAYS && !p->some) || !can_step(e, s, p, last, side, other)) continue;
        e->mask = outer;
        step_into(e, s, p, last, side, other);
        return;
    }
    if (last) emit_range(e, last, NULL);
    e->mask = outer;
    if (!e->error) end_path(e, s, p);
}
