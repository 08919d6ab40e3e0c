/* The tape of reverse mode: pushing a frame, and the loop that pops them. */
#include "compiler/back/cpu/emit.h"

#include <string.h>

static void store_bits(Emit *e, const Part *bits, Part at) {
    LLVMTypeRef t = LL(IntTypeInContext)(e->ctx, e->L);
    for (uint32_t p = 0; p < e->P; p++) {
        Part v = LL(BuildBitCast)(e->b, bits[p], t, "");
        if (e->L < 8) v = LL(BuildZExt)(e->b, v, e->t_i8, "");
        emit_store(e, v, emit_at_byte(e, at, (uint64_t)p * (e->L < 8 ? 1 : e->L / 8)), 1);
    }
}

void emit_load_bits(Emit *e, Part *bits, Part at) {
    LLVMTypeRef t = LL(IntTypeInContext)(e->ctx, e->L), v = emit_vector_type(e, e->t_i1);
    for (uint32_t p = 0; p < e->P; p++) {
        Part x = emit_load(e, e->L < 8 ? e->t_i8 : t, emit_at_byte(e, at, (uint64_t)p * (e->L < 8 ? 1 : e->L / 8)), 1,
                           false);
        if (e->L < 8) x = LL(BuildTrunc)(e->b, x, t, "");
        bits[p] = LL(BuildBitCast)(e->b, x, v, "");
    }
}

void emit_tapepush(Emit *e, Inst *i) {
    FrameClass *c = back_frame_class(&e->plan.frames, e->arena, i->nargs, i->args);
    Part top = emit_load(e, e->t_i64, e->tape_top, 8, false), next = LL(BuildAdd)(e->b, top, emit_i64(e, c->bytes), "");
    LLVMBasicBlockRef push = emit_new_block(e, "push"), full = emit_new_block(e, "full"),
                      done = emit_new_block(e, "pushed");
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntULE, next, e->tape_end, ""), push, full);
    emit_at(e, full);
    Part counter = emit_field_ptr(e, offsetof(SltKernelArgs, counters) + COUNTER_TAPE_OVERFLOW * sizeof(uint64_t));
    emit_store(e, LL(BuildAdd)(e->b, emit_load(e, e->t_i64, counter, 8, false), emit_i64(e, 1), ""), counter, 8);
    LL(BuildBr)(e->b, done);
    emit_at(e, push);
    Part frame = emit_gep(e, e->t_i8, e->tape, top);
    for (uint32_t j = 0; j < i->nargs; j++) {
        const Inst *x = i->args[j];
        Part at = emit_at_byte(e, frame, c->offset[j]);
        if (!c->varying[j]) {
            Part v = emit_scalar(e, x);
            emit_store(e, x->type == TY_BOOL ? LL(BuildZExt)(e->b, v, e->t_i8, "") : v, at, x->type == TY_BOOL ? 1 : 4);
            continue;
        }
        Part v[BACK_MAX_PARTS];
        emit_parts(e, x, v);
        if (x->type == TY_BOOL) {
            store_bits(e, v, at);
            continue;
        }
        unsigned bytes = back_type_bytes(&e->plan, x->type),
                 align = e->W * 4 < 64 ? e->L * 4 : emit_part_align(e, bytes);
        for (uint32_t p = 0; p < e->P; p++)
            emit_store(e, v[p], emit_at_byte(e, at, (uint64_t)p * e->L * bytes),
                       align < emit_part_align(e, bytes) ? align : emit_part_align(e, bytes));
    }
    if (c->masked) {
        Part on[BACK_MAX_PARTS];
        for (uint32_t p = 0; p < e->P; p++) on[p] = e->mask ? e->mask[p] : emit_all_on(e);
        store_bits(e, on, emit_at_byte(e, frame, c->mask_offset));
    }
    emit_store(e, next, e->tape_top, 8);
    LL(BuildBr)(e->b, done);
    emit_at(e, done);
}

static void pop_frame(Emit *e, const FrameClass *c, Block *body, Part frame) {
    for (uint32_t j = 0; j < c->n; j++) {
        const Inst *x = body->params[j];
        Part *out = emit_slot(e, x), at = emit_at_byte(e, frame, c->offset[j]);
        if (!c->varying[j]) {
            out[0] = emit_load(e, x->type == TY_BOOL ? e->t_i8 : emit_scalar_type(e, x->type), at,
                               x->type == TY_BOOL ? 1 : 4, false);
            if (x->type == TY_BOOL) out[0] = LL(BuildTrunc)(e->b, out[0], e->t_i1, "");
            continue;
        }
        if (x->type == TY_BOOL) {
            emit_load_bits(e, out, at);
            continue;
        }
        unsigned bytes = back_type_bytes(&e->plan, x->type),
                 align = e->W * 4 < 64 ? e->L * 4 : emit_part_align(e, bytes);
        for (uint32_t p = 0; p < e->P; p++)
            out[p] = emit_load(e, emit_vector_type(e, emit_scalar_type(e, x->type)),
                               emit_at_byte(e, at, (uint64_t)p * e->L * bytes),
                               align < emit_part_align(e, bytes) ? align : emit_part_align(e, bytes), false);
    }
}

/* Pops frames until the mark. Lanes outside a frame's mask keep their carried values. */
void emit_revloop(Emit *e, Inst *i) {
    Block *body = i->region[0];
    uint32_t carried = i->nargs - 1, nframe = body->nparams - carried;
    FrameClass *c = back_frame_class(&e->plan.frames, e->arena, nframe, body->params);
    Inst **params = body->params + nframe;
    Part(*init)[BACK_MAX_PARTS] = arena_alloc(e->arena, (carried + 1) * sizeof *init);
    uint32_t *n = ARENA_ARRAY(e->arena, uint32_t, carried + 1);
    for (uint32_t r = 0; r < carried; r++) {
        n[r] = emit_is_vector(e, params[r]) ? e->P : 1;
        if (n[r] == e->P && emit_is_vector(e, params[r])) emit_parts(e, i->args[1 + r], init[r]);
        else init[r][0] = emit_scalar(e, i->args[1 + r]);
    }
    Part mark = emit_scalar(e, i->args[0]);
    LLVMBasicBlockRef from = emit_here(e), head = emit_new_block(e, "unwind"), pop = emit_new_block(e, "pop"),
                      done = emit_new_block(e, "unwound");
    LL(BuildBr)(e->b, head);
    emit_at(e, head);
    for (uint32_t r = 0; r < carried; r++)
        for (uint32_t k = 0; k < n[r]; k++) {
            LLVMTypeRef t = emit_scalar_type(e, params[r]->type);
            emit_slot(e, params[r])[k] = emit_phi(e, emit_is_vector(e, params[r]) ? emit_vector_type(e, t) : t, "");
            emit_incoming(e, emit_slot(e, params[r])[k], init[r][k], from);
        }
    Part top = emit_load(e, e->t_i64, e->tape_top, 8, false);
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntUGT, top, mark, ""), pop, done);
    emit_at(e, pop);
    top = LL(BuildSub)(e->b, top, emit_i64(e, c->bytes), "");
    emit_store(e, top, e->tape_top, 8);
    Part frame = emit_gep(e, e->t_i8, e->tape, top);
    pop_frame(e, c, body, frame);
    Part *outer = e->mask, *mask = ARENA_ARRAY(e->arena, Part, e->P);
    if (c->masked) {
        emit_load_bits(e, mask, emit_at_byte(e, frame, c->mask_offset));
        emit_and_mask(e, mask, mask);
        e->mask = mask;
    }
    emit_block(e, body);
    e->mask = outer;
    if (e->error) return;
    const Inst *y = ir_yield_of(body);
    Part(*next)[BACK_MAX_PARTS] = arena_alloc(e->arena, (carried + 1) * sizeof *next);
    for (uint32_t r = 0; r < carried; r++) {
        if (!emit_is_vector(e, params[r])) {
            next[r][0] = emit_scalar(e, y->args[r]);
            continue;
        }
        emit_parts(e, y->args[r], next[r]);
        for (uint32_t k = 0; c->masked && k < e->P; k++)
            next[r][k] = LL(BuildSelect)(e->b, mask[k], next[r][k], emit_slot(e, params[r])[k], "");
    }
    LLVMBasicBlockRef latch = emit_here(e);
    LL(BuildBr)(e->b, head);
    for (uint32_t r = 0; r < carried; r++)
        for (uint32_t k = 0; k < n[r]; k++) emit_incoming(e, emit_slot(e, params[r])[k], next[r][k], latch);
    emit_at(e, done);
    for (const Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
        memcpy(emit_slot(e, p), emit_slot(e, params[p->imm.i]), n[p->imm.i] * sizeof(Part));
}
