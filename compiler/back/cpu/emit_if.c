/* if_: a uniform condition jumps or picks, a varying one runs each side under a mask, or both for everybody. */
#include "compiler/back/cpu/emit_control.h"

static void select_results(Emit *e, Inst *i, const Part *cond, Part scalar_cond) {
    for (const Inst *p = emit_next_proj(i, NULL); p; p = emit_next_proj(i, p)) {
        uint32_t r = (uint32_t)p->imm.i;
        Part x[BACK_MAX_PARTS], y[BACK_MAX_PARTS];
        emit_result_parts(e, ir_yield_of(i->region[0])->args[r], emit_is_vector(e, p), x);
        emit_result_parts(e, ir_yield_of(i->region[1])->args[r], emit_is_vector(e, p), y);
        for (uint32_t k = 0; k < back_value_parts(&e->plan, p); k++)
            emit_slot(e, p)[k] =
                x[k] == y[k] ? x[k] : LL(BuildSelect)(e->b, cond ? cond[k] : scalar_cond, x[k], y[k], "");
    }
}

static void emit_if_jump(Emit *e, Inst *i) {
    Part cond = emit_scalar(e, i->args[0]);
    LLVMBasicBlockRef side[2] = {emit_new_block(e, "then"), emit_new_block(e, "else")}, end[2],
                      join = emit_new_block(e, "join");
    const size_t n = emit_proj_count(i) * e->P;
    Part *x = ARENA_ARRAY(e->arena, Part, 2 * n + 1);
    LL(BuildCondBr)(e->b, cond, side[0], side[1]);
    for (uint32_t s = 0; s < 2; s++) {
        emit_at(e, side[s]);
        emit_block(e, i->region[s]);
        Part *at = x + s * n;
        for (const Inst *p = emit_next_proj(i, NULL); p; p = emit_next_proj(i, p), at += e->P)
            emit_result_parts(e, ir_yield_of(i->region[s])->args[p->imm.i], emit_is_vector(e, p), at);
        end[s] = emit_here(e);
        LL(BuildBr)(e->b, join);
    }
    emit_at(e, join);
    Part *at = x;
    for (const Inst *p = emit_next_proj(i, NULL); p; p = emit_next_proj(i, p), at += e->P)
        for (uint32_t k = 0; k < back_value_parts(&e->plan, p); k++) {
            Part phi = emit_phi(e, emit_value_type(e, p), "");
            emit_incoming(e, phi, at[k], end[0]);
            emit_incoming(e, phi, at[n + k], end[1]);
            emit_slot(e, p)[k] = phi;
        }
}

/* Runs one side under `mask`, behind a test whether any lane wants it, which is the end of block *from. Leaves the
 * builder at the end of the side; the caller branches to the block that is returned. */
static LLVMBasicBlockRef emit_side(Emit *e, Inst *i, uint32_t side, Part *mask, LLVMBasicBlockRef *from) {
    Part *outer = e->mask;
    *from = emit_here(e);
    LLVMBasicBlockRef region = emit_new_block(e, side ? "else" : "then"), join = emit_new_block(e, "join");
    LL(BuildCondBr)(e->b, emit_any(e, mask), region, join);
    emit_at(e, region);
    e->mask = mask;
    emit_block(e, i->region[side]);
    e->mask = outer;
    return join;
}

/* One side is empty: its values are known before, the blend is inside the branch, and lanes that never want the other
 * side pay one test. */
static void emit_if_one_sided(Emit *e, Inst *i, const Part *cond, uint32_t full) {
    Part *mask = emit_new_parts(e);
    for (uint32_t p = 0; p < e->P; p++) mask[p] = full ? LL(BuildNot)(e->b, cond[p], "") : cond[p];
    emit_and_mask(e, mask, mask);
    const size_t n = emit_proj_count(i) * e->P + 1;
    Part *skipped = ARENA_ARRAY(e->arena, Part, n), *at = skipped;
    for (const Inst *p = emit_next_proj(i, NULL); p; p = emit_next_proj(i, p), at += e->P)
        emit_result_parts(e, ir_yield_of(i->region[!full])->args[p->imm.i], emit_is_vector(e, p), at);
    LLVMBasicBlockRef from, join = emit_side(e, i, full, mask, &from);
    Part *taken = ARENA_ARRAY(e->arena, Part, n), *to = taken;
    at = skipped;
    for (const Inst *p = emit_next_proj(i, NULL); p; p = emit_next_proj(i, p), at += e->P, to += e->P) {
        const bool vector = emit_is_vector(e, p);
        const Inst *v = ir_yield_of(i->region[full])->args[p->imm.i],
                   *kept = ir_yield_of(i->region[!full])->args[p->imm.i];
        emit_result_parts(e, v, vector, to);
        const bool blends = vector && !back_keeps_itself(&e->plan, v, kept);
        for (uint32_t k = 0; blends && k < e->P; k++)
            if (to[k] != at[k]) to[k] = LL(BuildSelect)(e->b, mask[k], to[k], at[k], "");
    }
    LLVMBasicBlockRef end = emit_here(e);
    LL(BuildBr)(e->b, join);
    emit_at(e, join);
    at = skipped, to = taken;
    for (const Inst *p = emit_next_proj(i, NULL); p; p = emit_next_proj(i, p), at += e->P, to += e->P)
        for (uint32_t k = 0; k < back_value_parts(&e->plan, p); k++) {
            Part phi = emit_phi(e, emit_value_type(e, p), "");
            emit_incoming(e, phi, at[k], from);
            emit_incoming(e, phi, to[k], end);
            emit_slot(e, p)[k] = phi;
        }
}

/* Both sides do work: each behind its own test; where a side was skipped its value is never selected. */
static void emit_if_two_sided(Emit *e, Inst *i, const Part *cond) {
    const size_t n = emit_proj_count(i) * e->P + 1;
    Part *x[2];
    for (uint32_t s = 0; s < 2; s++) {
        x[s] = ARENA_ARRAY(e->arena, Part, n);
        Part *mask = emit_new_parts(e);
        for (uint32_t p = 0; p < e->P; p++) mask[p] = s ? LL(BuildNot)(e->b, cond[p], "") : cond[p];
        emit_and_mask(e, mask, mask);
        LLVMBasicBlockRef from, join = emit_side(e, i, s, mask, &from);
        Part *at = x[s];
        for (const Inst *p = emit_next_proj(i, NULL); p; p = emit_next_proj(i, p), at += e->P)
            emit_result_parts(e, ir_yield_of(i->region[s])->args[p->imm.i], emit_is_vector(e, p), at);
        LLVMBasicBlockRef end = emit_here(e);
        LL(BuildBr)(e->b, join);
        emit_at(e, join);
        at = x[s];
        for (const Inst *p = emit_next_proj(i, NULL); p; p = emit_next_proj(i, p), at += e->P)
            for (uint32_t k = 0; k < back_value_parts(&e->plan, p); k++) {
                LLVMTypeRef t = emit_value_type(e, p);
                Part phi = emit_phi(e, t, "");
                emit_incoming(e, phi, at[k], end);
                emit_incoming(e, phi, LL(ConstNull)(t), from);
                at[k] = phi;
            }
    }
    const Part *a = x[0], *b = x[1];
    for (const Inst *p = emit_next_proj(i, NULL); p; p = emit_next_proj(i, p), a += e->P, b += e->P) {
        if (!emit_is_vector(e, p)) /* the same uniform value on both sides, from outside */
            emit_slot(e, p)[0] = emit_scalar(e, ir_yield_of(i->region[0])->args[p->imm.i]);
        for (uint32_t k = 0; emit_is_vector(e, p) && k < e->P; k++)
            emit_slot(e, p)[k] = LL(BuildSelect)(e->b, cond[k], a[k], b[k], "");
    }
}

void emit_if(Emit *e, Inst *i) {
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
