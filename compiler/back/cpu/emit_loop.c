/* loop. Lanes leave a loop one by one, and the loop ends when none is left. Here are its head, its latch, and what
 * lanes hold where edges meet; an iteration is in emit_path.c. */
#include "compiler/back/cpu/emit_loop.h"

#include <string.h>

enum { SMALL_LOOP = 64 }; /* instructions of the body */

/* ---- joins */
bool loop_needed(const Carried *c) { return c->wanted || c->read; }

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

Held *loop_copy_held(Emit *e, const LoopState *s, const Held *from) {
    Held *h = ARENA_ARRAY(e->arena, Held, s->n + 1);
    for (uint32_t r = 0; r < s->n; r++) h[r] = (Held){copy_kept(e, from[r].next), copy_kept(e, from[r].result)};
    return h;
}

void loop_new_phis(Emit *e, LLVMTypeRef t, uint32_t n, Part *out) {
    for (uint32_t k = 0; k < n; k++) out[k] = emit_phi(e, t, "");
}
static void add_to(Emit *e, const Part *phi, uint32_t n, const Part *v) {
    for (uint32_t k = 0; k < n; k++) emit_incoming(e, phi[k], v[k], emit_here(e));
}

LLVMTypeRef loop_result_type(Emit *e, const Carried *c) {
    return emit_vector_type(e, emit_scalar_type(e, c->param->type));
}
uint32_t loop_next_parts(const Emit *e, const Carried *c) { return c->vector ? e->P : 1; }

static void new_join(Emit *e, const LoopState *s, bool latch, Join *to) {
    LLVMBasicBlockRef here = emit_here(e);
    to->at = emit_new_block(e, latch ? "latch" : "done");
    emit_at(e, to->at);
    to->held = new_held(e, s->n);
    if (latch) {
        to->go = emit_phi(e, e->t_i1, "go");
        to->live = emit_new_parts(e);
        if (s->diverges) loop_new_phis(e, emit_vector_type(e, e->t_i1), e->P, to->live);
    }
    for (uint32_t r = 0; r < s->n; r++) {
        const Carried *c = &s->carried[r];
        if (latch ? loop_needed(c) : c->wanted && !c->apart)
            loop_new_phis(e, emit_value_type(e, c->param), loop_next_parts(e, c), to->held[r].next.v);
        if (c->apart) loop_new_phis(e, loop_result_type(e, c), e->P, to->held[r].result.v);
    }
    emit_at(e, here);
}

void loop_to_done(Emit *e, const LoopState *s, const Held *h) {
    for (uint32_t r = 0; r < s->n; r++) {
        const Carried *c = &s->carried[r];
        if (c->apart) add_to(e, s->done.held[r].result.v, e->P, h[r].result.v);
        else if (c->wanted) add_to(e, s->done.held[r].next.v, loop_next_parts(e, c), h[r].next.v);
    }
}

void loop_to_latch(Emit *e, const LoopState *s, const Part *live, Part go, const Held *h) {
    emit_incoming(e, s->latch.go, go ? go : emit_int(e, e->t_i1, 1), emit_here(e));
    if (live) add_to(e, s->latch.live, e->P, live);
    for (uint32_t r = 0; r < s->n; r++) {
        const Carried *c = &s->carried[r];
        if (loop_needed(c)) add_to(e, s->latch.held[r].next.v, loop_next_parts(e, c), h[r].next.v);
        if (c->apart) add_to(e, s->latch.held[r].result.v, e->P, h[r].result.v);
    }
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
        loop_new_phis(e, emit_value_type(e, c->param), loop_next_parts(e, c), h->next.v);
        for (uint32_t k = 0; k < loop_next_parts(e, c); k++) emit_incoming(e, h->next.v[k], init[r][k], from);
        memcpy(emit_slot(e, c->param), h->next.v, loop_next_parts(e, c) * sizeof(Part));
        h->next.of = c->param;
        if (!c->apart) continue;
        loop_new_phis(e, loop_result_type(e, c), e->P, h->result.v);
        for (uint32_t k = 0; k < e->P; k++)
            emit_incoming(e, h->result.v[k], LL(ConstNull)(loop_result_type(e, c)), from);
    }
    if (s->diverges) {
        loop_new_phis(e, emit_vector_type(e, e->t_i1), e->P, loop->live = loop->on = emit_new_parts(e));
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
        for (uint32_t k = 0; k < loop_next_parts(e, c); k++)
            emit_incoming(e, head->held[r].next.v[k],
                          loop_needed(c) ? h->next.v[k] : LL(ConstNull)(emit_value_type(e, c->param)), s->latch.at);
        if (c->apart) add_to(e, head->held[r].result.v, e->P, h->result.v);
    }
    emit_at(e, last);
    for (uint32_t r = 0; r < s->n; r++) {
        const Carried *c = &s->carried[r];
        Held *h = &s->latch.held[r];
        if (!c->apart) continue;
        for (uint32_t k = 0; k < e->P; k++)
            h->result.v[k] = LL(BuildSelect)(
                e->b, s->latch.live[k], c->vector ? h->next.v[k] : emit_splat(e, h->next.v[0]), h->result.v[k], "");
    }
    loop_to_done(e, s, s->latch.held);
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
    emit_choose_roots(e, i->region[0]);
    Path head = {0};
    loop_head(e, &s, &head);
    new_join(e, &s, true, &s.latch);
    new_join(e, &s, false, &s.done);
    Path path = head;
    path.held = loop_copy_held(e, &s, head.held);
    loop_path(e, &s, &path, i->region[0]);
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
