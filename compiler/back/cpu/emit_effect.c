/* What leaves the kernel beside its outputs: counters, notes and print; lists that come in. */
#include "compiler/back/cpu/emit.h"

typedef struct LaneLoop {
    LLVMBasicBlockRef head, skip, done;
    Part lane; /* i64 */
} LaneLoop;

/* Runs what follows, up to lane_loop_end, for every lane that is on in `mask` (P parts), in lane order. */
static LaneLoop lane_loop_begin(Emit *e, const Part *mask) {
    Part bytes = emit_alloca(e, LL(ArrayType2)(e->t_i8, e->W), 1, 64);
    for (uint32_t p = 0; p < e->P; p++)
        emit_store(e, LL(BuildZExt)(e->b, mask[p], emit_vector_type(e, e->t_i8), ""),
                   emit_at_byte(e, bytes, (uint64_t)p * e->L), 1);
    LaneLoop l = {
        .head = emit_new_block(e, "lane"), .skip = emit_new_block(e, "next"), .done = emit_new_block(e, "lanes")};
    LLVMBasicBlockRef from = emit_here(e), on = emit_new_block(e, "on");
    LL(BuildBr)(e->b, l.head);
    emit_at(e, l.head);
    l.lane = emit_phi(e, e->t_i64, "lane");
    emit_incoming(e, l.lane, emit_i64(e, 0), from);
    Part active = emit_load(e, e->t_i8, emit_gep(e, e->t_i8, bytes, l.lane), 1, false);
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntNE, active, emit_int(e, e->t_i8, 0), ""), on, l.skip);
    emit_at(e, on);
    return l;
}

static void lane_loop_end(Emit *e, LaneLoop *l) {
    LL(BuildBr)(e->b, l->skip);
    emit_at(e, l->skip);
    Part next = LL(BuildAdd)(e->b, l->lane, emit_i64(e, 1), "");
    emit_incoming(e, l->lane, next, l->skip);
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntULT, next, emit_i64(e, e->W), ""), l->head, l->done);
    emit_at(e, l->done);
}

/* Spills the parts of a value so that lanes can be picked at run time; elements of type t. */
static Part spill_lanes(Emit *e, const Part *parts, LLVMTypeRef t, unsigned bytes) {
    Part mem = emit_alloca(e, LL(ArrayType2)(t, e->W), 1, 64);
    for (uint32_t p = 0; p < e->P; p++)
        emit_store(e, parts[p], emit_gep(e, t, mem, emit_i64(e, (uint64_t)p * e->L)), emit_part_align(e, bytes));
    return mem;
}

void emit_count(Emit *e, Inst *i) {
    Part cond[BACK_MAX_PARTS];
    emit_parts(e, i->args[0], cond);
    LLVMBasicBlockRef some = emit_new_block(e, "count"), done = emit_new_block(e, "counted");
    LL(BuildCondBr)(e->b, emit_any(e, cond), some, done);
    emit_at(e, some);
    Part sum = emit_i64(e, 0);
    LLVMTypeRef bits = LL(IntTypeInContext)(e->ctx, e->L);
    for (uint32_t p = 0; p < e->P; p++) {
        Part m = emit_counting_lanes(e, p, cond[p]);
        m = LL(BuildZExt)(e->b, e->W == 1 ? m : LL(BuildBitCast)(e->b, m, bits, ""), e->t_i64, "");
        sum = LL(BuildAdd)(e->b, sum, emit_intrinsic(e, "llvm.ctpop", e->t_i64, &m, 1), "");
    }
    Part at = emit_field_ptr(e, offsetof(SltKernelArgs, counters) + (size_t)i->imm.i * sizeof(uint64_t));
    emit_store(e, LL(BuildAdd)(e->b, emit_load(e, e->t_i64, at, 8, false), sum, ""), at, 8);
    LL(BuildBr)(e->b, done);
    emit_at(e, done);
}

/* One bit a lane where `cond` holds, shifted to the boxes of this vector. */
static Part box_bits(Emit *e, const Inst *cond) {
    Part m[BACK_MAX_PARTS], word = NULL;
    LLVMTypeRef bits = LL(IntTypeInContext)(e->ctx, e->L);
    emit_parts(e, cond, m);
    emit_and_mask(e, m, m);
    for (uint32_t p = 0; p < e->P; p++) {
        Part part = e->W == 1 ? m[p] : LL(BuildBitCast)(e->b, m[p], bits, "");
        if (e->L < 64) part = LL(BuildZExt)(e->b, part, e->t_i64, "");
        if (p) part = LL(BuildShl)(e->b, part, emit_i64(e, (uint64_t)p * e->L), "");
        word = word ? LL(BuildOr)(e->b, word, part, "") : part;
    }
    Part box = LL(BuildAnd)(e->b, e->i, emit_i64(e, SLT_PAD - 1), "");
    return LL(BuildShl)(e->b, word, box, "");
}

/* Without a branch: where no notes are wanted they go to scratch. */
void emit_note(Emit *e, Inst *i) {
    static const size_t member[2] = {offsetof(SltNote, may), offsetof(SltNote, must)};
    const CullSlot *c = &e->cull[i->imm.i];
    Part place = LL(BuildAnd)(e->b, LL(BuildZExt)(e->b, c->place, e->t_i64, ""), c->noted, "");
    Part note = emit_gep(e, e->t_i8, c->notes, LL(BuildMul)(e->b, place, emit_i64(e, sizeof(SltNote)), ""));
    for (uint32_t a = 0; a < 2; a++) {
        if (i->args[a]->op == OP_constb && !i->args[a]->imm.i) continue;
        Part at = emit_at_byte(e, note, member[a]);
        Part old = emit_load(e, e->t_i64, at, 8, false);
        emit_store(e, LL(BuildOr)(e->b, old, box_bits(e, i->args[a]), ""), at, 8);
    }
}

/* Places stay inside the list whatever the loop does: a place too far gives the last item. */
void emit_item(Emit *e, Inst *i) {
    if (emit_is_vector(e, i)) {
        emit_fail(e, "a place in a list that differs between lanes");
        return;
    }
    const CullSlot *c = &e->cull[i->imm.i];
    Part a = emit_scalar(e, i->args[0]), zero = emit_int(e, e->t_i32, 0), one = emit_int(e, e->t_i32, 1), v;
    if (i->op == OP_items) {
        Part x[2] = {c->count, one}, given = LL(BuildICmp)(e->b, LLVMIntSGE, c->count, zero, "");
        v = LL(BuildSelect)(e->b, given, emit_intrinsic(e, "llvm.smax", e->t_i32, x, 2), a, "");
    } else {
        Part x[2] = {a, LL(BuildSub)(e->b, c->count, one, "")},
             some = LL(BuildICmp)(e->b, LLVMIntSGT, c->count, zero, "");
        Part at = LL(BuildSelect)(e->b, some, emit_intrinsic(e, "llvm.umin", e->t_i32, x, 2), zero, "");
        Part item =
            emit_load(e, e->t_i32, emit_gep(e, e->t_i32, c->items, LL(BuildZExt)(e->b, at, e->t_i64, "")), 4, true);
        v = LL(BuildSelect)(e->b, some, item, a, "");
    }
    emit_slot(e, i)[0] = v;
}

static Part as_double(Emit *e, const Inst *x, Part v) {
    LLVMTypeRef d = emit_vector_type(e, e->t_f64);
    if (x->type == TY_BOOL) return LL(BuildUIToFP)(e->b, v, d, "");
    if (x->type == TY_INT) return LL(BuildSIToFP)(e->b, v, d, "");
    return e->t_flt == e->t_f32 ? LL(BuildFPExt)(e->b, v, d, "") : v;
}

void emit_print(Emit *e, Inst *i) {
    LLVMBasicBlockRef on = emit_new_block(e, "print"), done = emit_new_block(e, "printed");
    Part f = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, print)), 8, true);
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntNE, f, LL(ConstNull)(e->t_ptr), ""), on, done);
    emit_at(e, on);
    Part *spilled = ARENA_ARRAY(e->arena, Part, i->nargs + 1), mask[BACK_MAX_PARTS];
    for (uint32_t j = 0; j < i->nargs; j++) {
        Part v[BACK_MAX_PARTS];
        emit_parts(e, i->args[j], v);
        for (uint32_t p = 0; p < e->P; p++) v[p] = as_double(e, i->args[j], v[p]);
        spilled[j] = spill_lanes(e, v, e->t_f64, 8);
    }
    for (uint32_t p = 0; p < e->P; p++) mask[p] = emit_counting_lanes(e, p, NULL);
    char *text = arena_strndup(e->arena, i->imm.text.text, i->imm.text.len);
    Part name = LL(BuildGlobalStringPtr)(e->b, text, "text");
    Part values = emit_alloca(e, LL(ArrayType2)(e->t_f64, i->nargs + 1), 1, 8);
    LaneLoop l = lane_loop_begin(e, mask);
    for (uint32_t j = 0; j < i->nargs; j++)
        emit_store(e, emit_load(e, e->t_f64, emit_gep(e, e->t_f64, spilled[j], l.lane), 8, false),
                   emit_gep(e, e->t_f64, values, emit_i64(e, j)), 8);
    Part lane = LL(BuildTrunc)(e->b, LL(BuildAdd)(e->b, e->i, l.lane, ""), e->t_i32, "");
    Part user = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, user)), 8, true);
    LLVMTypeRef types[6] = {e->t_ptr, e->t_ptr, e->t_i32, e->t_ptr, e->t_i32, e->t_i32};
    Part args[6] = {user, name, emit_int(e, e->t_i32, i->imm.text.len), values, emit_int(e, e->t_i32, i->nargs), lane};
    LL(BuildCall2)(e->b, LL(FunctionType)(e->t_void, types, 6, false), f, args, 6, "");
    lane_loop_end(e, &l);
    LL(BuildBr)(e->b, done);
    emit_at(e, done);
}
