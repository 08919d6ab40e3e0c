/* Structured control flow: if_ and loop, uniform as real branches, varying under masks.
 *
 * Dead lanes run along and compute garbage: nothing traps (integer operations are total, indices are clamped), stores
 * and effects look at the mask, and values are blended only where lanes with different histories meet. A region is
 * entered only if some lane wants it. */
#include "compiler/back/cpu/emit.h"

#include <string.h>

void emit_control(Emit *e, Inst *i);

/* The parts of a value as result r of a structured operation: vector if the result varies. */
static uint32_t result_parts(Emit *e, const Inst *value, bool vector, Part *out) {
    if (vector) {
        emit_parts(e, value, out);
        return e->P;
    }
    out[0] = emit_scalar(e, value);
    return 1;
}

static LLVMTypeRef value_type(Emit *e, const Inst *i) {
    LLVMTypeRef t = emit_scalar_type(e, i->type);
    return emit_is_vector(e, i) ? emit_vector_type(e, t) : t;
}

static Part *new_parts(Emit *e) { return ARENA_ARRAY(e->arena, Part, e->P); }

static const Inst *next_proj(const Inst *s, const Inst *p) {
    p = p ? p->next : s->next;
    return p && p->op == OP_proj && p->args[0] == s ? p : NULL;
}

static size_t proj_count(const Inst *i) {
    size_t n = 0;
    for (const Inst *p = next_proj(i, NULL); p; p = next_proj(i, p)) n++;
    return n;
}

/* A mask that crosses blocks: before AVX-512 vectors of i1 are kept as narrow integers there, with a pack and an unpack
 * at every use, so such a mask travels as integers of the width of its floats, whose signs blend directly. */
static LLVMTypeRef wide_type(Emit *e) { return e->fn->precision == PREC_F64 ? e->t_i64 : e->t_i32; }
static bool masks_are_vectors(const Emit *e) { return e->W > 1 && e->opt->target.vector_bytes < 64; }
static LLVMTypeRef travelling_type(Emit *e) {
    return emit_vector_type(e, masks_are_vectors(e) ? wide_type(e) : e->t_i1);
}

static void widen(Emit *e, const Part *mask, Part *wide) {
    for (uint32_t p = 0; p < e->P; p++)
        wide[p] = masks_are_vectors(e) ? LL(BuildSExt)(e->b, mask[p], travelling_type(e), "") : mask[p];
}

static void narrow(Emit *e, const Part *wide, Part *mask) {
    for (uint32_t p = 0; p < e->P; p++)
        mask[p] = masks_are_vectors(e) ? LL(BuildICmp)(e->b, LLVMIntSLT, wide[p], LL(ConstNull)(travelling_type(e)), "")
                                       : wide[p];
}

/* ---- if_ */
static void select_results(Emit *e, Inst *i, const Part *cond, Part scalar_cond) {
    for (const Inst *p = next_proj(i, NULL); p; p = next_proj(i, p)) {
        uint32_t r = (uint32_t)p->imm.i;
        Part x[BACK_MAX_PARTS], y[BACK_MAX_PARTS];
        result_parts(e, ir_yield_of(i->region[0])->args[r], emit_is_vector(e, p), x);
        result_parts(e, ir_yield_of(i->region[1])->args[r], emit_is_vector(e, p), y);
        for (uint32_t k = 0; k < back_value_parts(&e->plan, p); k++)
            emit_slot(e, p)[k] =
                x[k] == y[k] ? x[k] : LL(BuildSelect)(e->b, cond ? cond[k] : scalar_cond, x[k], y[k], "");
    }
}

static void emit_if_jump(Emit *e, Inst *i) {
    Part cond = emit_scalar(e, i->args[0]);
    LLVMBasicBlockRef side[2] = {emit_new_block(e, "then"), emit_new_block(e, "else")}, end[2],
                      join = emit_new_block(e, "join");
    const size_t n = proj_count(i) * e->P;
    Part *x = ARENA_ARRAY(e->arena, Part, 2 * n + 1);
    LL(BuildCondBr)(e->b, cond, side[0], side[1]);
    for (uint32_t s = 0; s < 2; s++) {
        emit_at(e, side[s]);
        emit_block(e, i->region[s]);
        Part *at = x + s * n;
        for (const Inst *p = next_proj(i, NULL); p; p = next_proj(i, p), at += e->P)
            result_parts(e, ir_yield_of(i->region[s])->args[p->imm.i], emit_is_vector(e, p), at);
        end[s] = emit_here(e);
        LL(BuildBr)(e->b, join);
    }
    emit_at(e, join);
    Part *at = x;
    for (const Inst *p = next_proj(i, NULL); p; p = next_proj(i, p), at += e->P)
        for (uint32_t k = 0; k < back_value_parts(&e->plan, p); k++) {
            Part phi = emit_phi(e, value_type(e, p), "");
            emit_incoming(e, phi, at[k], end[0]);
            emit_incoming(e, phi, at[n + k], end[1]);
            emit_slot(e, p)[k] = phi;
        }
}

/* Runs one side under `mask`, behind a test whether any lane wants it, which is the end of block *from. Leaves the
 * builder at the end of the side; the caller branches to the block that is returned. */
static LLVMBasicBlockRef emit_side(Emit *e, Inst *i, uint32_t side, Part *mask, LLVMBasicBlockRef *from) {
    Part *outer = e->mask, wide[BACK_MAX_PARTS];
    widen(e, mask, wide);
    *from = emit_here(e);
    LLVMBasicBlockRef region = emit_new_block(e, side ? "else" : "then"), join = emit_new_block(e, "join");
    LL(BuildCondBr)(e->b, emit_any(e, mask), region, join);
    emit_at(e, region);
    narrow(e, wide, mask);
    e->mask = mask;
    emit_block(e, i->region[side]);
    e->mask = outer;
    return join;
}

/* One side is empty: its values are known before, the blend is inside the branch, and lanes that never want the other
 * side pay one test. */
static void emit_if_one_sided(Emit *e, Inst *i, const Part *cond, uint32_t full) {
    Part *mask = new_parts(e);
    for (uint32_t p = 0; p < e->P; p++) mask[p] = full ? LL(BuildNot)(e->b, cond[p], "") : cond[p];
    emit_and_mask(e, mask, mask);
    const size_t n = proj_count(i) * e->P + 1;
    Part *skipped = ARENA_ARRAY(e->arena, Part, n), *at = skipped;
    for (const Inst *p = next_proj(i, NULL); p; p = next_proj(i, p), at += e->P)
        result_parts(e, ir_yield_of(i->region[!full])->args[p->imm.i], emit_is_vector(e, p), at);
    LLVMBasicBlockRef from, join = emit_side(e, i, full, mask, &from);
    Part *taken = ARENA_ARRAY(e->arena, Part, n), *to = taken;
    at = skipped;
    for (const Inst *p = next_proj(i, NULL); p; p = next_proj(i, p), at += e->P, to += e->P) {
        bool vector = emit_is_vector(e, p);
        result_parts(e, ir_yield_of(i->region[full])->args[p->imm.i], vector, to);
        for (uint32_t k = 0; vector && k < e->P; k++)
            if (to[k] != at[k]) to[k] = LL(BuildSelect)(e->b, mask[k], to[k], at[k], "");
    }
    LLVMBasicBlockRef end = emit_here(e);
    LL(BuildBr)(e->b, join);
    emit_at(e, join);
    at = skipped, to = taken;
    for (const Inst *p = next_proj(i, NULL); p; p = next_proj(i, p), at += e->P, to += e->P)
        for (uint32_t k = 0; k < back_value_parts(&e->plan, p); k++) {
            Part phi = emit_phi(e, value_type(e, p), "");
            emit_incoming(e, phi, at[k], from);
            emit_incoming(e, phi, to[k], end);
            emit_slot(e, p)[k] = phi;
        }
}

/* Both sides do work: each behind its own test; where a side was skipped its value is never selected. */
static void emit_if_two_sided(Emit *e, Inst *i, const Part *cond) {
    const size_t n = proj_count(i) * e->P + 1;
    Part *x[2], wide_cond[BACK_MAX_PARTS], again[BACK_MAX_PARTS];
    widen(e, cond, wide_cond);
    for (uint32_t s = 0; s < 2; s++) {
        x[s] = ARENA_ARRAY(e->arena, Part, n);
        Part *mask = new_parts(e);
        if (s) narrow(e, wide_cond, again);
        for (uint32_t p = 0; p < e->P; p++) mask[p] = s ? LL(BuildNot)(e->b, again[p], "") : cond[p];
        emit_and_mask(e, mask, mask);
        LLVMBasicBlockRef from, join = emit_side(e, i, s, mask, &from);
        Part *at = x[s];
        for (const Inst *p = next_proj(i, NULL); p; p = next_proj(i, p), at += e->P)
            result_parts(e, ir_yield_of(i->region[s])->args[p->imm.i], emit_is_vector(e, p), at);
        LLVMBasicBlockRef end = emit_here(e);
        LL(BuildBr)(e->b, join);
        emit_at(e, join);
        at = x[s];
        for (const Inst *p = next_proj(i, NULL); p; p = next_proj(i, p), at += e->P)
            for (uint32_t k = 0; k < back_value_parts(&e->plan, p); k++) {
                LLVMTypeRef t = value_type(e, p);
                Part phi = emit_phi(e, t, "");
                emit_incoming(e, phi, at[k], end);
                emit_incoming(e, phi, LL(ConstNull)(t), from);
                at[k] = phi;
            }
    }
    const Part *a = x[0], *b = x[1];
    narrow(e, wide_cond, again);
    for (const Inst *p = next_proj(i, NULL); p; p = next_proj(i, p), a += e->P, b += e->P) {
        if (!emit_is_vector(e, p)) /* the same uniform value on both sides, from outside */
            emit_slot(e, p)[0] = emit_scalar(e, ir_yield_of(i->region[0])->args[p->imm.i]);
        for (uint32_t k = 0; emit_is_vector(e, p) && k < e->P; k++)
            emit_slot(e, p)[k] = LL(BuildSelect)(e->b, again[k], a[k], b[k], "");
    }
}

static void emit_if(Emit *e, Inst *i) {
    Part *cond = emit_slot(e, i->args[0]);
    switch (back_if_form(&e->plan, i)) {
    case IF_PICK:
        emit_block(e, i->region[0]);
        emit_block(e, i->region[1]);
        select_results(e, i, NULL, emit_scalar(e, i->args[0]));
        break;
    case IF_JUMP: emit_if_jump(e, i); break;
    case IF_BLEND:
        emit_block(e, i->region[0]);
        emit_block(e, i->region[1]);
        select_results(e, i, cond, NULL);
        break;
    case IF_THEN_ONLY: emit_if_one_sided(e, i, cond, 0); break;
    case IF_ELSE_ONLY: emit_if_one_sided(e, i, cond, 1); break;
    case IF_BOTH: emit_if_two_sided(e, i, cond); break;
    }
}

/* ---- loop */
/* Is a list given? Small loops are emitted twice, for yes and for no: then whoever gives none pays nothing. */
typedef enum Listed { LISTED_NO, LISTED_YES, LISTED_PERHAPS } Listed;
enum { SMALL_LOOP = 64 }; /* instructions of the body */

typedef struct LoopState {
    Inst *i;
    Listed listed;
    bool diverges;
    Part j;            /* iterations done */
    Part *live, *wide; /* the lanes still inside; the phis that carry them */
    Part **result;     /* phis of results that are not carried as vectors */
    bool *blend;       /* carried value r is blended in place */
    LLVMBasicBlockRef head;
} LoopState;

static Part *new_phis(Emit *e, LLVMTypeRef t, uint32_t n, const Part *init, LLVMBasicBlockRef from) {
    Part *phi = new_parts(e);
    for (uint32_t k = 0; k < n; k++) {
        phi[k] = emit_phi(e, t, "");
        emit_incoming(e, phi[k], init[k], from);
    }
    return phi;
}

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

static void loop_head(Emit *e, LoopState *s) {
    Inst *i = s->i;
    Block *body = i->region[0];
    uint32_t nc = body->nparams - 1;
    Part(*init)[BACK_MAX_PARTS] = arena_alloc(e->arena, (nc + 1) * sizeof *init);
    for (uint32_t r = 0; r < nc; r++) result_parts(e, i->args[r], emit_is_vector(e, body->params[r + 1]), init[r]);
    Part on[BACK_MAX_PARTS];
    for (uint32_t p = 0; p < e->P; p++) on[p] = e->mask ? e->mask[p] : emit_all_on(e);
    if (s->diverges) widen(e, on, on);
    s->blend = ARENA_ARRAY(e->arena, bool, nc + 1);
    s->result = ARENA_ARRAY(e->arena, Part *, nc + 1);
    LLVMBasicBlockRef from = emit_here(e);
    s->head = emit_new_block(e, "loop");
    LL(BuildBr)(e->b, s->head);
    emit_at(e, s->head);
    s->j = emit_phi(e, e->t_i32, "j");
    emit_incoming(e, s->j, emit_int(e, e->t_i32, 0), from);
    for (uint32_t r = 0; r < nc; r++) {
        Inst *c = body->params[r + 1];
        uint32_t n = emit_is_vector(e, c) ? e->P : 1;
        memcpy(emit_slot(e, c), new_phis(e, value_type(e, c), n, init[r], from), n * sizeof(Part));
    }
    if (s->diverges) s->wide = new_phis(e, travelling_type(e), e->P, on, from);
    for (const Inst *p = next_proj(i, NULL); s->diverges && p; p = next_proj(i, p)) {
        uint32_t r = (uint32_t)p->imm.i;
        s->blend[r] = emit_is_vector(e, body->params[r + 1]);
        if (!s->blend[r]) {
            LLVMTypeRef t = emit_vector_type(e, emit_scalar_type(e, p->type));
            Part zero[BACK_MAX_PARTS];
            for (uint32_t k = 0; k < e->P; k++) zero[k] = LL(ConstNull)(t);
            s->result[r] = new_phis(e, t, e->P, zero, from);
        }
    }
    if (s->diverges) narrow(e, s->wide, s->live = new_parts(e));
    emit_slot(e, body->params[0])[0] = iteration_number(e, s);
    if (i->imm.loop.cull) e->cull[i->imm.loop.cull_id].place = s->j;
}

/* Whether to go round again; fills the lanes that will. */
static Part loop_condition(Emit *e, LoopState *s, Part j_next, Part *live_next) {
    Conjuncts c = {0};
    back_split_flag(&e->plan, ir_yield_of(s->i->region[0])->args[0], &c);
    Part go = NULL;
    if (s->diverges) {
        narrow(e, s->wide, s->live); /* the body may have many blocks */
        memcpy(live_next, s->live, e->P * sizeof(Part));
        for (uint32_t v = 0; v < c.nvarying; v++)
            for (uint32_t p = 0; p < e->P; p++)
                live_next[p] = LL(BuildAnd)(e->b, live_next[p], emit_slot(e, c.varying[v])[p], "");
        go = emit_any(e, live_next);
        widen(e, live_next, live_next);
    }
    for (uint32_t u = 0; u < c.nuniform; u++) {
        Part f = emit_scalar(e, c.uniform[u]);
        go = go ? LL(BuildAnd)(e->b, go, f, "") : f;
    }
    if (s->listed != LISTED_NO) {
        const CullSlot *list = &e->cull[s->i->imm.loop.cull_id];
        go = LL(BuildAnd)(e->b, go, LL(BuildICmp)(e->b, LLVMIntULT, j_next, list->count, ""), "");
    }
    return go;
}

static void emit_loop_as(Emit *e, Inst *i, Listed listed) {
    Block *body = i->region[0];
    LoopState s = {.i = i, .listed = listed, .diverges = e->W > 1 && (i->flags & BACK_DIVERGES)};
    uint32_t nc = body->nparams - 1;
    LLVMBasicBlockRef before = NULL, skip_join = NULL;
    Part(*init)[BACK_MAX_PARTS] = arena_alloc(e->arena, (nc + 1) * sizeof *init);
    if (listed != LISTED_NO) { /* an empty list: no iteration, the results are the initial values */
        LLVMBasicBlockRef some = emit_new_block(e, "some");
        skip_join = emit_new_block(e, "culled");
        Part empty = LL(BuildICmp)(e->b, LLVMIntEQ, e->cull[i->imm.loop.cull_id].count, emit_int(e, e->t_i32, 0), "");
        for (const Inst *p = next_proj(i, NULL); p; p = next_proj(i, p))
            result_parts(e, i->args[p->imm.i], emit_is_vector(e, p), init[p->imm.i]);
        before = emit_here(e);
        LL(BuildCondBr)(e->b, empty, skip_join, some);
        emit_at(e, some);
    }
    loop_head(e, &s);
    Part *outer = e->mask;
    if (s.diverges) e->mask = s.live;
    emit_block(e, body);
    e->mask = outer;
    if (e->error) return;

    const Inst *y = ir_yield_of(body);
    Part live_next[BACK_MAX_PARTS];
    Part j_next = LL(BuildAdd)(e->b, s.j, emit_int(e, e->t_i32, 1), "");
    Part go = loop_condition(e, &s, j_next, live_next);
    Part(*next)[BACK_MAX_PARTS] = arena_alloc(e->arena, (nc + 1) * sizeof *next);
    Part(*result)[BACK_MAX_PARTS] = arena_alloc(e->arena, (nc + 1) * sizeof *result);
    for (uint32_t r = 0; r < nc; r++) {
        Inst *c = body->params[r + 1];
        result_parts(e, y->args[r + 1], emit_is_vector(e, c), next[r]);
        if (s.blend[r] && !back_keeps_itself(&e->plan, y->args[r + 1], c))
            for (uint32_t k = 0; k < e->P; k++)
                next[r][k] = LL(BuildSelect)(e->b, s.live[k], next[r][k], emit_slot(e, c)[k], "");
    }
    for (const Inst *p = next_proj(i, NULL); p; p = next_proj(i, p)) {
        uint32_t r = (uint32_t)p->imm.i;
        if (s.blend[r]) {
            memcpy(result[r], next[r], e->P * sizeof(Part));
        } else {
            result_parts(e, y->args[r + 1], emit_is_vector(e, p), result[r]);
            for (uint32_t k = 0; s.result[r] && k < e->P; k++)
                result[r][k] = LL(BuildSelect)(e->b, s.live[k], result[r][k], s.result[r][k], "");
        }
    }
    LLVMBasicBlockRef latch = emit_here(e), done = emit_new_block(e, "done");
    LL(BuildCondBr)(e->b, go, s.head, done);
    emit_incoming(e, s.j, j_next, latch);
    for (uint32_t r = 0; r < nc; r++)
        for (uint32_t k = 0; k < (emit_is_vector(e, body->params[r + 1]) ? e->P : 1); k++)
            emit_incoming(e, emit_slot(e, body->params[r + 1])[k], next[r][k], latch);
    for (uint32_t k = 0; s.diverges && k < e->P; k++) emit_incoming(e, s.wide[k], live_next[k], latch);
    for (uint32_t r = 0; r < nc; r++)
        for (uint32_t k = 0; s.result[r] && k < e->P; k++) emit_incoming(e, s.result[r][k], result[r][k], latch);
    emit_at(e, done);
    if (skip_join) {
        LL(BuildBr)(e->b, skip_join);
        emit_at(e, skip_join);
    }
    for (const Inst *p = next_proj(i, NULL); p; p = next_proj(i, p))
        for (uint32_t k = 0; k < back_value_parts(&e->plan, p); k++) {
            Part v = result[p->imm.i][k];
            if (skip_join) {
                Part phi = emit_phi(e, value_type(e, p), "");
                emit_incoming(e, phi, init[p->imm.i][k], before);
                emit_incoming(e, phi, v, done);
                v = phi;
            }
            emit_slot(e, p)[k] = v;
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

static void emit_loop(Emit *e, Inst *i) {
    if (!i->imm.loop.cull || size_of(i->region[0]) > SMALL_LOOP) {
        emit_loop_as(e, i, i->imm.loop.cull ? LISTED_PERHAPS : LISTED_NO);
        return;
    }
    LLVMBasicBlockRef start[2] = {emit_new_block(e, "all"), emit_new_block(e, "listed")}, end[2],
                      join = emit_new_block(e, "join");
    const size_t n = proj_count(i) * e->P;
    Part *x = ARENA_ARRAY(e->arena, Part, 2 * n + 1);
    LL(BuildCondBr)(e->b, is_listed(e, &e->cull[i->imm.loop.cull_id]), start[1], start[0]);
    for (uint32_t s = 0; s < 2 && !e->error; s++) {
        emit_at(e, start[s]);
        forget_values(e, i->region[0]);
        emit_loop_as(e, i, s ? LISTED_YES : LISTED_NO);
        Part *at = x + s * n;
        for (const Inst *p = next_proj(i, NULL); p; p = next_proj(i, p), at += e->P)
            memcpy(at, emit_slot(e, p), back_value_parts(&e->plan, p) * sizeof *at);
        end[s] = emit_here(e);
        LL(BuildBr)(e->b, join);
    }
    if (e->error) return;
    emit_at(e, join);
    Part *at = x;
    for (const Inst *p = next_proj(i, NULL); p; p = next_proj(i, p), at += e->P)
        for (uint32_t k = 0; k < back_value_parts(&e->plan, p); k++) {
            Part phi = emit_phi(e, value_type(e, p), "");
            for (uint32_t s = 0; s < 2; s++) emit_incoming(e, phi, at[s * n + k], end[s]);
            emit_slot(e, p)[k] = phi;
        }
}

void emit_control(Emit *e, Inst *i) {
    if (i->op == OP_if_) emit_if(e, i);
    else emit_loop(e, i);
}
